//! Distances of a frame's right points from the epipolar lines of the left ones, and their velocities across them.

use super::Window;
use super::landmark::{Observation, PointLandmark};
use super::reprojection::PointMeasurement;
use super::state::Rig;
use nalgebra::{Vector2, Vector3};

/// Fewest pairs of points that count as a frame.
const MIN_PAIRS: usize = 8;

/// Means over the pairs of points of a frame, or sums of such over frames.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct EpipolarMoments {
    /// Speed across the epipolar line in the right image, px/s.
    pub speed: f64,
    /// Distance from the line, px.
    pub off: f64,
    /// Square of the speed, px²/s².
    pub speed_squared: f64,
    /// Product of speed and distance, px²/s.
    pub product: f64,
}

impl EpipolarMoments {
    /// All of it times `factor`.
    pub fn scaled(&self, factor: f64) -> Self {
        Self {
            speed: self.speed * factor,
            off: self.off * factor,
            speed_squared: self.speed_squared * factor,
            product: self.product * factor,
        }
    }

    /// The sum with `other`.
    pub fn plus(&self, other: &Self) -> Self {
        Self {
            speed: self.speed + other.speed,
            off: self.off + other.off,
            speed_squared: self.speed_squared + other.speed_squared,
            product: self.product + other.product,
        }
    }
}

impl EpipolarMoments {
    /// Moments of points by their normalized coordinates in the left and the right image, and the rate of the right ones, 1/s; `None`
    /// where they are too few.
    pub fn of_pairs(
        rig: &Rig,
        focal_px: f64,
        pairs: impl Iterator<Item = ([Vector2<f64>; 2], Vector2<f64>)>,
    ) -> Option<Self> {
        let (left, right) = (rig.pose_b_c(0), rig.pose_b_c(1));
        let right_from_left = right.inverse() * left;
        let t = right_from_left.translation.vector;
        let rot = right_from_left.rotation.to_rotation_matrix().into_inner();
        let (mut sum, mut count) = (Self::default(), 0);
        for ([left_xy, right_xy], right_rate) in pairs {
            let line = t.cross(&(rot * Vector3::new(left_xy.x, left_xy.y, 1.0)));
            let scale = focal_px / line.xy().norm();
            let off = (line.x * right_xy.x + line.y * right_xy.y + line.z) * scale;
            let speed = line.xy().dot(&right_rate) * scale;
            if off.is_finite() && speed.is_finite() {
                sum = sum.plus(&Self { speed, off, speed_squared: speed * speed, product: speed * off });
                count += 1;
            }
        }
        (count >= MIN_PAIRS).then(|| sum.scaled(1.0 / count as f64))
    }
}

impl Window {
    /// Moments of the points that both cameras see in the newest frame, by their predicted image rates; `None` where they are too few.
    pub fn epipolar_moments(&self) -> Option<EpipolarMoments> {
        let newest = self.frames.len().checked_sub(1)? as u8;
        let pairs = self.points.all().iter().filter_map(|landmark| {
            let [left, right] = pair_in(landmark, newest)?.map(|o| &o.measured);
            Some(([left.xy, right.xy], right.xy_rate))
        });
        EpipolarMoments::of_pairs(&self.rig, self.options.focal_px, pairs)
    }
}

/// Observations of a landmark by the left and the right camera of frame `index`.
pub(super) fn pair_in(landmark: &PointLandmark, index: u8) -> Option<[&Observation<PointMeasurement>; 2]> {
    let [.., left, right] = &landmark.observations[..] else { return None };
    let is_pair = left.frame == index && right.frame == index && left.camera == 0 && right.camera == 1;
    is_pair.then_some([left, right])
}
