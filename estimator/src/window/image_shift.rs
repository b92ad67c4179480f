//! Shifts of the images of the newest frame from where its predicted pose has the known landmarks.
//!
//! A pose that is wrong shifts both images of a pair alike: their landmarks are the same. Where the one is shifted and the other is not, the
//! camera has been knocked, or its image is not of this moment, or not of this place.

use super::Window;
use super::epipolar::pair_in;
use super::landmark::PointLandmark;
use super::reprojection::PointMeasurement;
use super::state::Mount;
use nalgebra::{Vector2, Vector3};

/// Fewest landmarks that tell a shift, and as many as are looked at.
const MIN_PAIRS: usize = 12;
const MAX_PAIRS: usize = 128;
/// Forward component of a ray, scaled by the inverse depth, below which it is not seen.
const MIN_FORWARD: f64 = 0.02;

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
        let mut distances: [Distances; 4] = Default::default();
        for landmark in self.points.all() {
            if !landmark.is_triangulated || usize::from(landmark.host) == newest {
                continue;
            }
            let Some(pair) = pair_in(landmark, newest as u8) else { continue };
            let Some([left, right]) = self.distances(landmark, pair, &mounts) else { continue };
            let apart = right - left;
            for (all, one) in distances.iter_mut().zip([left.norm(), right.norm(), apart.x, apart.y]) {
                let _ = all.push(one);
            }
        }
        if distances[0].len() < MIN_PAIRS {
            return None;
        }
        let [left, right, x, y] = distances.map(|all| median(all) * self.options.focal_px);
        Some(ImageShifts { of_camera: [left, right], of_pair: Vector2::new(x, y) })
    }

    /// Distance of a landmark in each image of the newest frame from where its pose has it, normalized.
    fn distances(
        &self,
        landmark: &PointLandmark,
        pair: [&PointMeasurement; 2],
        mounts: &[Mount; 2],
    ) -> Option<[Vector2<f64>; 2]> {
        let (host, newest) = (&self.frames[usize::from(landmark.host)].nav, &self.frames.last()?.nav);
        let (point, mount) = (&landmark.feature, &mounts[usize::from(landmark.host_camera)]);
        let q_b = mount.rot_b_c * Vector3::new(point.xy.x, point.xy.y, 1.0) + mount.p_b_c * point.rho;
        let q_o = host.rot_o_b * q_b + (host.p_o_b - newest.p_o_b) * point.rho;
        let q_b = newest.rot_o_b.inverse_transform_vector(&q_o);
        let mut distances = [Vector2::zeros(); 2];
        for ((distance, measured), mount) in distances.iter_mut().zip(pair).zip(mounts) {
            let q_c = mount.rot_b_c.tr_mul(&(q_b - mount.p_b_c * point.rho));
            if q_c.z < MIN_FORWARD {
                return None;
            }
            *distance = measured.xy - q_c.xy() / q_c.z;
        }
        distances.iter().all(|distance| distance.iter().all(|x| x.is_finite())).then_some(distances)
    }
}

/// The middle one; zero of none.
fn median(mut values: Distances) -> f64 {
    values.sort_unstable_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}
