//! Where points must be, by what the window knows of the vehicle and of their depth.
//!
//! A point of inverse depth `rho` at `(x, y, 1)` of the previous image lies along `R (x, y, 1) + rho t` now. `R` and `t` come from a
//! state two frames old and the inertial samples since; `rho` from the landmark of the track, else from its last stereo match, else
//! from the tracks around it.

use super::track::{Depth, Track};
use super::witness::FoundTurn;
use nalgebra::{Isometry3, Matrix3, UnitQuaternion, Vector2, Vector3};
use plumbline_config::Portable;

/// Error of a stereo match, px.
pub(super) const MATCH_SIGMA_PX: f64 = 0.5;
/// Tracks around a point by which its depth is guessed.
const NEIGHBOURS: usize = 4;
/// Distance of these at most, in focal lengths: what lies further away may be another surface, whose depth puts a match into another cell.
pub(super) const AROUND: f64 = 0.26;
/// Share of the depth by which a point may differ from those around it, beyond their own spread.
const GUESSED_SHARE: f64 = 0.1;

/// Landmark in the left camera of the last state that is known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KnownPoint {
    /// Its track.
    pub track_id: u32,
    /// Normalized coordinates.
    pub xy: Vector2<f64>,
    /// Inverse depth, 1/m.
    pub rho: f64,
    /// Standard deviation of the inverse depth, 1/m.
    pub rho_sigma: f64,
}

/// Motion of the body from the previous frame to this one.
#[derive(Clone, Copy, Debug)]
pub struct PredictedMotion {
    /// Takes coordinates of the current body to the previous.
    pub pose_prev_cur_b: Isometry3<f64>,
    /// Takes coordinates of the body where landmarks are known to the previous.
    pub pose_prev_known_b: Isometry3<f64>,
    /// Standard deviation of the way, m.
    pub sigma_m: f64,
}

/// Turn of the body since the frame before, by corners that look like nothing around them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WitnessedTurn {
    /// Takes coordinates of the current body to the previous.
    pub rot_prev_cur_b: UnitQuaternion<f64>,
    /// Covariance in the current body, rad².
    pub covariance: Matrix3<f64>,
    /// True if the inertial samples predicted another turn.
    pub is_other: bool,
}

impl WitnessedTurn {
    /// The turn that a camera mounted by `rot_b_c` `found` beyond the predicted one.
    pub(super) fn new(
        rot_prev_predicted_b: &UnitQuaternion<f64>,
        rot_b_c: &UnitQuaternion<f64>,
        found: &FoundTurn,
    ) -> Self {
        let rot_cur_predicted_c = UnitQuaternion::from_rotation_matrix(&found.rot_cur_predicted);
        let to_b = rot_b_c.to_rotation_matrix();
        Self {
            rot_prev_cur_b: rot_prev_predicted_b
                * (rot_b_c * rot_cur_predicted_c.inverse() * rot_b_c.inverse()),
            covariance: to_b * found.covariance * to_b.transpose(),
            is_other: found.is_other,
        }
    }
}

/// Depths of the tracks by their place in an image.
#[derive(Clone, Debug)]
pub(super) struct DepthMap {
    points: Vec<(Vector2<f64>, Depth)>,
    around_px: f64,
}

impl DepthMap {
    /// Room for `capacity` depths, which count for what is no further from them than `around_px`.
    pub fn new(capacity: usize, around_px: f64) -> Self {
        Self { points: Vec::with_capacity(capacity), around_px }
    }

    pub fn clear(&mut self) {
        self.points.clear();
    }

    pub fn add(&mut self, px: Vector2<f64>, depth: Depth) {
        if self.points.len() < self.points.capacity() {
            self.points.push((px, depth));
        }
    }

    /// Depth at `px` by the nearest points; `None` where too few are near.
    pub fn around(&self, px: &Vector2<f64>) -> Option<Depth> {
        let mut nearest = [(f64::INFINITY, Depth { rho: 0.0, sigma: 0.0 }); NEIGHBOURS];
        for (at, depth) in &self.points {
            let far = (at - px).norm_squared();
            if far < nearest[NEIGHBOURS - 1].0 {
                let mut k = NEIGHBOURS - 1;
                while k > 0 && nearest[k - 1].0 > far {
                    nearest[k] = nearest[k - 1];
                    k -= 1;
                }
                nearest[k] = (far, *depth);
            }
        }
        (nearest[NEIGHBOURS - 1].0 < self.around_px.squared()).then(|| {
            nearest.sort_unstable_by(|a, b| a.1.rho.total_cmp(&b.1.rho));
            let (low, high) = (nearest[0].1, nearest[NEIGHBOURS - 1].1);
            let rho = 0.5 * (nearest[NEIGHBOURS / 2 - 1].1.rho + nearest[NEIGHBOURS / 2].1.rho);
            let spread = 0.5 * (high.rho - low.rho);
            let own = low.sigma.at_least(high.sigma);
            Depth { rho, sigma: (spread + GUESSED_SHARE * rho.abs()).at_least(own) }
        })
    }
}

/// Gives the tracks, in order of their ids, the depths of `known` landmarks, moved to the left camera of the previous frame by
/// `pose_prev_known_c`; else those of their last stereo match, which is certain to `match_sigma`, 1/m.
pub(super) fn take_depths(
    tracks: &mut [Track],
    known: &[KnownPoint],
    pose_prev_known_c: &Isometry3<f64>,
    match_sigma: f64,
) {
    let mut landmarks = known.iter().peekable();
    for track in tracks {
        while landmarks.next_if(|point| point.track_id < track.id).is_some() {}
        let landmark = landmarks.next_if(|point| point.track_id == track.id).and_then(|point| {
            let bearing = Vector3::new(point.xy.x, point.xy.y, 1.0);
            let p = pose_prev_known_c.rotation * bearing + pose_prev_known_c.translation.vector * point.rho;
            (p.z > 0.1).then(|| Depth { rho: point.rho / p.z, sigma: point.rho_sigma / p.z })
        });
        let by_match = track.stereo.map(|stereo| Depth { rho: stereo.inverse_depth, sigma: match_sigma });
        track.depth = match (landmark, by_match) {
            (Some(a), Some(b)) if b.sigma < a.sigma && (a.rho - b.rho).abs() < 3.0 * a.sigma => Some(b),
            (landmark, by_match) => landmark.or(by_match),
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn depth(rho: f64) -> Depth {
        Depth { rho, sigma: 0.01 }
    }

    #[test]
    fn depth_around_a_point_is_that_of_the_nearest_four() {
        let mut map = DepthMap::new(8, 60.0);
        for k in 0..3 {
            map.add(Vector2::new(f64::from(k), 0.0), depth(0.5));
        }
        assert_eq!(map.around(&Vector2::zeros()), None);
        map.add(Vector2::new(0.0, 1.0), depth(0.52));
        map.add(Vector2::new(50.0, 50.0), depth(3.0));
        let found = map.around(&Vector2::zeros()).expect("enough points");
        assert!((found.rho - 0.5).abs() < 1e-12 && found.sigma < 0.1, "{found:?}");
        assert_eq!(map.around(&Vector2::new(0.0, 62.0)), None, "another surface");
    }

    #[test]
    fn depth_around_an_edge_is_as_uncertain_as_the_edge_is_deep() {
        let mut map = DepthMap::new(8, 60.0);
        for (k, rho) in [0.2, 0.2, 1.0, 1.0].into_iter().enumerate() {
            map.add(Vector2::new(k as f64, 0.0), depth(rho));
        }
        let found = map.around(&Vector2::zeros()).expect("enough points");
        assert!((found.rho - 0.6).abs() < 1e-12 && found.sigma > 0.4, "{found:?}");
    }

    #[test]
    fn a_landmark_comes_before_a_match_that_contradicts_it() {
        let mut store = crate::points::track::TrackStore::new(4);
        let image = crate::image::Pyramid::new(64, 64, 1);
        for _ in 0..3 {
            let track = store.begin(&image, &Vector2::new(30.0, 30.0)).expect("room");
            track.stereo = Some(crate::points::track::StereoMemory {
                inverse_depth: 0.5,
                change: 0.0,
                offset_px: Vector2::zeros(),
            });
        }
        let known = [KnownPoint { track_id: 1, xy: Vector2::zeros(), rho: 0.25, rho_sigma: 0.01 }];
        // The camera came a metre nearer to what was four metres away.
        let nearer = Isometry3::translation(0.0, 0.0, -1.0);
        take_depths(&mut store.tracks, &known, &nearer, 0.02);
        let rho = [0, 1, 2].map(|k| store.tracks[k].depth.map(|depth| depth.rho));
        assert_eq!(rho, [Some(0.5), Some(0.25 / 0.75), Some(0.5)]);
    }

    #[test]
    fn the_turn_of_the_body_is_that_of_a_camera_however_it_is_mounted() {
        let rot_b_c = UnitQuaternion::from_euler_angles(0.1, -0.2, 1.5);
        let rot_prev_cur_b = UnitQuaternion::from_euler_angles(0.02, -0.05, 0.03);
        let predicted = rot_prev_cur_b * UnitQuaternion::from_euler_angles(0.01, 0.004, -0.006);
        let of_camera = |rot_b: UnitQuaternion<f64>| rot_b_c.inverse() * rot_b * rot_b_c;
        let found = FoundTurn {
            rot_cur_predicted: (of_camera(rot_prev_cur_b).inverse() * of_camera(predicted))
                .to_rotation_matrix(),
            covariance: Matrix3::from_diagonal(&Vector3::new(1.0, 2.0, 3.0)),
            is_other: true,
        };
        let turn = WitnessedTurn::new(&predicted, &rot_b_c, &found);
        assert!(turn.rot_prev_cur_b.angle_to(&rot_prev_cur_b) < 1e-9);
        let axis_c = Vector3::z();
        let axis_b = rot_b_c * axis_c;
        assert!((axis_b.dot(&(turn.covariance * axis_b)) - 3.0).abs() < 1e-9, "variance goes with the axis");
    }
}
