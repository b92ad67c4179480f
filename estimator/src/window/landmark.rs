//! Landmarks and the fixed store that holds them.

use super::feature::Feature;
use super::line::HostedLine;
use super::reprojection::InversePoint;
use super::state::MAX_FRAMES;

/// A point.
pub type PointLandmark = Landmark<InversePoint>;
/// A line.
pub type LineLandmark = Landmark<HostedLine>;

/// Most observations of one landmark: both cameras in every frame.
pub const MAX_OBSERVATIONS: usize = 2 * MAX_FRAMES;

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
