//! Shifts of the images of the newest frame from where its predicted pose has the known landmarks.
//!
//! A pose that is wrong shifts both images of a pair alike: their landmarks are the same. Where the one is shifted and the other is not, the
//! camera has been knocked, or its image is not of this moment, or not of this place.

use super::Window;
use super::epipolar::pair_in;
use super::landmark::{Observation, PointLandmark};
use super::reprojection::PointMeasurement;
use super::state::Mount;
use super::triangulate::Scene;
use nalgebra::Vector2;

/// Fewest landmarks that tell a shift, and as many as are looked at.
const MIN_PAIRS: usize = 12;
const MAX_PAIRS: usize = 128;

/// Medians over the landmarks of how far they are seen from where they were expected, px.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ImageShifts {
    /// Distances in the left and the right image.
    pub of_camera: [f64; 2],
    /// Shift of the right image against the left one.
    pub of_pair: Vector2<f64>,
}

type Distances = heapless::Vec<f64, MAX_PAIRS>;

impl Window {
    /// Shifts of the newest frame's images by the landmarks that both cameras see and that are older; `None` where they are too few.
    #[must_use]
    pub fn image_shifts(&self) -> Option<ImageShifts> {
        let newest = self.frames.len().checked_sub(1)?;
        let mounts = [Mount::of(&self.rig, 0), Mount::of(&self.rig, 1)];
        let scene = Scene { frames: &self.frames, mounts: &mounts, time_offset_s: self.rig.time_offset_s };
        let mut all: [Distances; 4] = Default::default();
        for landmark in self.points.all() {
            if !landmark.is_triangulated || usize::from(landmark.host) == newest {
                continue;
            }
            let Some(pair) = pair_in(landmark, newest as u8) else { continue };
            let Some([left, right]) = distances(&scene, landmark, pair) else { continue };
            let apart = right - left;
            for (of_one, value) in all.iter_mut().zip([left.norm(), right.norm(), apart.x, apart.y]) {
                let _ = of_one.push(value);
            }
        }
        if all[0].len() < MIN_PAIRS {
            return None;
        }
        let [left, right, x, y] = all.map(|of_one| median(of_one) * self.options.focal_px);
        Some(ImageShifts { of_camera: [left, right], of_pair: Vector2::new(x, y) })
    }
}

/// Distance of a landmark, in each image of the newest frame, from where the pose of the frame has it, normalized.
fn distances(
    scene: &Scene<'_>,
    landmark: &PointLandmark,
    pair: [&Observation<PointMeasurement>; 2],
) -> Option<[Vector2<f64>; 2]> {
    let of = |o: &Observation<PointMeasurement>| {
        let expected = scene.with_view(landmark, o, |view, _| landmark.feature.project(view))?;
        Some(o.measured.xy - expected).filter(|distance| distance.iter().all(|x| x.is_finite()))
    };
    Some([of(pair[0])?, of(pair[1])?])
}

/// The middle one; zero of none.
fn median(mut values: Distances) -> f64 {
    values.sort_unstable_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}
