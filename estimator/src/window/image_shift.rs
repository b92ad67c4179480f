//! Shifts of the images of the newest frame from where its predicted pose has the known landmarks.
//!
//! A pose that is wrong shifts both images of a pair alike: their landmarks are the same. Where the one is shifted and the other is not, the
//! camera has been knocked, or its image is not of this moment, or not of this place.

use super::Window;
use super::epipolar::pair_in;
use super::landmark::{Observation, PointLandmark};
use super::reprojection::PointMeasurement;
use super::state::Mount;
use super::tracks::MIN_WITNESSES;
use super::triangulate::Scene;
use nalgebra::Vector2;

/// Landmarks that are looked at, at most.
const MAX_PAIRS: usize = 128;

/// Medians over the landmarks of how far they are seen from where they were expected, px.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ImageShifts {
    /// Distance in the left image.
    pub left: f64,
    /// Share of its landmarks that are found in the right image as well.
    pub shared: f64,
    /// Shifts by those, if they are enough.
    pub of_pair: Option<PairShifts>,
}

/// Medians over the landmarks that both images show, px.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PairShifts {
    /// Distances in the left and the right image.
    pub of_camera: [f64; 2],
    /// Shift of the right image against the left one.
    pub apart: Vector2<f64>,
}

type Distances = heapless::Vec<f64, MAX_PAIRS>;

impl Window {
    /// Shifts of the newest frame's images by the landmarks that are older; `None` where the left image shows too few.
    pub fn image_shifts(&self) -> Option<ImageShifts> {
        let newest = self.frames.len().checked_sub(1)?;
        let mounts = [Mount::of(&self.rig, 0), Mount::of(&self.rig, 1)];
        let scene = Scene { frames: &self.frames, mounts: &mounts, time_offset_s: self.rig.time_offset_s };
        let mut all: [Distances; 4] = Default::default();
        let mut of_left = Distances::new();
        for landmark in self.points.all() {
            if !landmark.is_triangulated || usize::from(landmark.host) == newest {
                continue;
            }
            if let Some(left) =
                left_in(landmark, newest as u8).and_then(|left| distance(&scene, landmark, left))
            {
                let _ = of_left.push(left.norm());
            }
            let Some([left, right]) = pair_in(landmark, newest as u8) else { continue };
            let of = |observation| distance(&scene, landmark, observation);
            let (Some(left), Some(right)) = (of(left), of(right)) else { continue };
            let apart = right - left;
            for (of_one, value) in all.iter_mut().zip([left.norm(), right.norm(), apart.x, apart.y]) {
                let _ = of_one.push(value);
            }
        }
        let (pairs, count) = (all[0].len(), of_left.len());
        if count < MIN_WITNESSES {
            return None;
        }
        let px = |values| median(values) * self.options.focal_px;
        let of_pair = (pairs >= MIN_WITNESSES).then(|| {
            let [left, right, x, y] = all.map(px);
            PairShifts { of_camera: [left, right], apart: Vector2::new(x, y) }
        });
        Some(ImageShifts { left: px(of_left), shared: pairs as f64 / count as f64, of_pair })
    }
}

/// The observation of a landmark in the left image of frame `index`.
fn left_in(landmark: &PointLandmark, index: u8) -> Option<&Observation<PointMeasurement>> {
    landmark.observations.iter().rev().find(|o| o.frame == index && o.camera == 0)
}

/// Distance of a landmark in an image of the newest frame from where the pose of the frame has it, normalized.
fn distance(
    scene: &Scene<'_>,
    landmark: &PointLandmark,
    observation: &Observation<PointMeasurement>,
) -> Option<Vector2<f64>> {
    let expected = scene.with_view(landmark, observation, |view, _| landmark.feature.project(view))?;
    Some(observation.measured.xy - expected).filter(|distance| distance.iter().all(|x| x.is_finite()))
}

/// The middle one; zero of none.
fn median(mut values: Distances) -> f64 {
    values.sort_unstable_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}
