//! Landmarks and the fixed store that holds them.

use super::feature::Feature;
use super::frame::Frame;
use super::line::HostedLine;
use super::options::Options;
use super::reprojection::InversePoint;
use super::state::MAX_FRAMES;
use plumbline_config::Portable;

/// A point.
pub type PointLandmark = Landmark<InversePoint>;
/// A line.
pub type LineLandmark = Landmark<HostedLine>;

/// Most observations of one landmark: both cameras in every frame.
pub const MAX_OBSERVATIONS: usize = 2 * MAX_FRAMES;

/// Memory of the errors of a track, whose surroundings look alike while the view changes slowly, s: their correlation is
/// `1 / (1 + dt / memory)`. Measured on recorded images: see notes/covariance.md.
pub(super) const ERROR_MEMORY_S: f64 = 0.4;

/// Independence of the errors of observations that are `dt_s` apart, `(1 - rho) / (1 + rho)` for a correlation `rho`.
#[inline]
fn independence(dt_s: f64) -> f64 {
    dt_s / (2.0 * ERROR_MEMORY_S + dt_s)
}

/// One measured place of a landmark.
#[derive(Clone, Copy, Debug)]
pub struct Observation<M> {
    /// Index of the frame in the window.
    pub frame: u8,
    /// Camera 0 or 1.
    pub camera: u8,
    /// The measurement.
    pub measured: M,
}

/// A feature that the window estimates, or waits to triangulate.
#[derive(Clone, Debug)]
pub struct Landmark<F: Feature> {
    /// The track that observes it.
    pub track_id: u32,
    /// Index of the host frame in the window.
    pub host: u8,
    /// The host's camera.
    pub host_camera: u8,
    /// True if `feature` has been triangulated.
    pub is_triangulated: bool,
    /// Its parameters in the host camera.
    pub feature: F,
    /// Measurements, in order of frame and camera.
    pub observations: heapless::Vec<Observation<F::Measurement>, MAX_OBSERVATIONS>,
}

impl<F: Feature> Landmark<F> {
    /// Weight of an observation: the sum over the inverse of their correlations, by their number, and by their variance. They are a Markov chain,
    /// of which each link adds its independence. With two cameras the root of the share serves better: see notes/covariance.md.
    pub fn information(&self, frames: &[Frame], options: &Options) -> f64 {
        let stamp = |o: &Observation<F::Measurement>| frames[usize::from(o.frame)].stamp;
        let links = self.observations.windows(2);
        let links = links.map(|o| independence(stamp(&o[1]).seconds_since(stamp(&o[0]))));
        let share = (1.0 + links.sum::<f64>()) / self.observations.len() as f64;
        let share = if options.cameras > 1 { share.sqrt() } else { share };
        share / F::sigma(options).squared()
    }
}

/// The landmarks of the window, at most as many as configured.
#[derive(Clone, Debug)]
pub struct LandmarkStore<F: Feature> {
    landmarks: Vec<Landmark<F>>,
    capacity: usize,
    by_track: Vec<(u32, u16)>,
}

impl<F: Feature> LandmarkStore<F> {
    /// Room for `capacity` landmarks.
    pub fn new(capacity: usize) -> Self {
        Self { landmarks: Vec::with_capacity(capacity), capacity, by_track: Vec::with_capacity(capacity) }
    }

    /// All landmarks.
    pub fn all(&self) -> &[Landmark<F>] {
        &self.landmarks
    }

    /// All landmarks, to be changed. Their `track_id` must stay.
    pub fn all_mut(&mut self) -> &mut [Landmark<F>] {
        &mut self.landmarks
    }

    /// Forgets everything.
    pub fn clear(&mut self) {
        self.landmarks.clear();
        self.by_track.clear();
    }

    /// The landmark of a track.
    pub fn of_track(&self, track_id: u32) -> Option<usize> {
        let at = self.by_track.binary_search_by_key(&track_id, |entry| entry.0).ok()?;
        Some(usize::from(self.by_track[at].1))
    }

    /// Adds a landmark of a track that has none, if there is room.
    pub fn insert(&mut self, landmark: Landmark<F>) {
        if self.landmarks.len() == self.capacity {
            return;
        }
        if let Err(at) = self.by_track.binary_search_by_key(&landmark.track_id, |entry| entry.0) {
            self.by_track.insert(at, (landmark.track_id, self.landmarks.len() as u16));
            self.landmarks.push(landmark);
        }
    }

    /// Keeps the landmarks for which `keep` holds.
    pub fn retain(&mut self, keep: impl FnMut(&mut Landmark<F>) -> bool) {
        let before = self.landmarks.len();
        self.landmarks.retain_mut(keep);
        if self.landmarks.len() == before {
            return;
        }
        self.by_track.clear();
        self.by_track.extend(self.landmarks.iter().enumerate().map(|(k, l)| (l.track_id, k as u16)));
        self.by_track.sort_unstable();
    }
}

#[cfg(test)]
mod tests {
    use super::super::Window;
    use super::super::test_room::Room;
    use super::*;
    use nalgebra::DMatrix;

    #[test]
    fn the_share_is_the_sum_over_the_inverse_correlations() {
        let mut window = Room { frames: 6, ..Room::default() }.window();
        window.options.cameras = 1;
        check(&window.points, &window);
        check(&window.lines, &window);
    }

    fn check<F: Feature>(store: &LandmarkStore<F>, window: &Window) {
        let mut landmark = store.all()[0].clone();
        landmark.observations.retain(|o| o.camera == 0);
        let stamps: Vec<_> =
            landmark.observations.iter().map(|o| window.frames[usize::from(o.frame)].stamp).collect();
        let n = stamps.len();
        assert!(n > 3);
        let correlation = |i: usize, k: usize| {
            let links = stamps[i.min(k)..=i.max(k)].windows(2);
            let links = links.map(|s| independence(s[1].seconds_since(s[0])));
            links.map(|i| (1.0 - i) / (1.0 + i)).product::<f64>()
        };
        let inverse = DMatrix::from_fn(n, n, correlation).try_inverse().expect("is regular");
        let share = landmark.information(&window.frames, &window.options);
        assert!((share - inverse.sum() / n as f64).abs() < 1e-9, "{share}");
    }
}
