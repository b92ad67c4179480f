//! Turning of a recording, enough for its rig to be seen or not: the spread of the angular rate over all axes.
//!
//! Where a camera sits on the IMU shows in what turning does to it. As long as a rig turns about one axis alone, neither
//! a turn of the camera about that axis nor a place further along it changes anything that is measured; so there must
//! be turns about a second axis (Kelly and Sukhatme 2011; Yang, Geneva, Zuo and Huang 2019).

use nalgebra::{Isometry3, Matrix3, SymmetricEigen, Vector3};
use plumbline_config::ImuSample;

/// Axes about which the rate is less than this, root of the mean square, were not turned about, rad/s.
pub const LEAST_RATE_RAD_S: f64 = 0.15;

/// Turning of a rig.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Excitation {
    /// Principal axes of the angular rate in the body, the liveliest first.
    pub axes_b: [Vector3<f64>; 3],
    /// Root mean square of the rate about each of them, rad/s.
    pub rates_rad_s: [f64; 3],
    /// Root mean square of the rate about x, y and z of the body, rad/s.
    pub body_rates_rad_s: Vector3<f64>,
    /// Scatter of the specific force, m/s².
    pub force_m_s2: f64,
}

impl Excitation {
    /// Measures the excitation of a recording; `None` if it has no samples.
    #[must_use]
    pub fn of(samples: &[ImuSample]) -> Option<Self> {
        let count = samples.len() as f64;
        if samples.is_empty() {
            return None;
        }
        let mean_of =
            |value: fn(&ImuSample) -> Vector3<f64>| samples.iter().map(value).sum::<Vector3<f64>>() / count;
        let (gyro, accel) = (mean_of(|s| s.gyro), mean_of(|s| s.accel));
        let outer = |s: &ImuSample| (s.gyro - gyro) * (s.gyro - gyro).transpose();
        let spread = samples.iter().map(outer).sum::<Matrix3<f64>>() / count;
        let force2 = samples.iter().map(|s| (s.accel - accel).norm_squared()).sum::<f64>() / count;
        let eigen = SymmetricEigen::new(spread);
        let mut order = [0, 1, 2];
        order.sort_by(|a, b| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]));
        Some(Self {
            axes_b: order.map(|k| eigen.eigenvectors.column(k).into_owned()),
            rates_rad_s: order.map(|k| eigen.eigenvalues[k].max(0.0).sqrt()),
            body_rates_rad_s: spread.diagonal().map(|x| x.max(0.0).sqrt()),
            force_m_s2: force2.sqrt(),
        })
    }

    /// The axes that were not turned about.
    #[must_use]
    pub fn missing(&self) -> Vec<Vector3<f64>> {
        let pairs = self.axes_b.iter().zip(self.rates_rad_s);
        pairs.filter(|(_, rate)| *rate < LEAST_RATE_RAD_S).map(|(axis, _)| *axis).collect()
    }

    /// True if it was turned about two axes at least.
    #[must_use]
    pub fn is_enough(&self) -> bool {
        self.missing().len() < 2
    }
}

/// An axis of the body in words, as the IMU has it and as one does it who holds the camera.
#[must_use]
pub fn axis_words(axis_b: &Vector3<f64>, pose_b_c: &Isometry3<f64>) -> String {
    let axis_c = pose_b_c.rotation.inverse() * axis_b;
    let motions = [
        "nodding: about the camera's x",
        "looking left and right: about its y",
        "rolling: about its viewing axis",
    ];
    format!("{} of the IMU ({})", axis_name(axis_b), motions[axis_c.iamax()])
}

/// x, y or z where it is nearly one, else its coordinates.
fn axis_name(axis: &Vector3<f64>) -> String {
    let largest = axis.iamax();
    match axis[largest].abs() > 0.9 {
        true => ["x", "y", "z"][largest].to_owned(),
        false => {
            let axis = axis * axis[largest].signum();
            format!("({:.1} {:.1} {:.1})", axis.x, axis.y, axis.z)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::UnitQuaternion;
    use plumbline_config::Timestamp;

    fn samples(rate: impl Fn(f64) -> Vector3<f64>) -> Vec<ImuSample> {
        let sample = |k: i64| ImuSample {
            stamp: Timestamp::from_nanos(5_000_000 * k),
            gyro: rate(0.005 * k as f64) + Vector3::new(0.02, -0.01, 0.03),
            accel: Vector3::new(0.0, 0.0, 9.81),
        };
        (0..4000).map(sample).collect()
    }

    #[test]
    fn a_turn_about_one_axis_lacks_the_two_others_however_it_lies() {
        let about = Vector3::new(1.0, 2.0, -0.5).normalize();
        let excitation = Excitation::of(&samples(|t| about * t.sin())).unwrap();
        assert!(!excitation.is_enough());
        assert!((excitation.axes_b[0].dot(&about).abs() - 1.0).abs() < 1e-6);
        assert!(excitation.missing().iter().all(|axis| axis.dot(&about).abs() < 1e-6));
        assert!((excitation.rates_rad_s[0] - 0.5_f64.sqrt()).abs() < 0.02);
    }

    #[test]
    fn turns_about_two_axes_are_enough_and_a_rest_is_not() {
        let two = |t: f64| Vector3::new(t.sin(), (1.7 * t).cos(), 0.0);
        let excitation = Excitation::of(&samples(two)).unwrap();
        assert!(excitation.is_enough() && excitation.missing().len() == 1);
        assert!(!Excitation::of(&samples(|_| Vector3::zeros())).unwrap().is_enough());
        assert_eq!(Excitation::of(&[]), None);
    }

    #[test]
    fn an_axis_is_told_as_the_imu_has_it_and_as_the_camera_is_moved() {
        // Camera z along body x, as of a camera that looks forward.
        let turn = nalgebra::Matrix3::new(0.0, 0.0, 1.0, -1.0, 0.0, 0.0, 0.0, -1.0, 0.0);
        let rotation =
            UnitQuaternion::from_rotation_matrix(&nalgebra::Rotation3::from_matrix_unchecked(turn));
        let pose_b_c = Isometry3::from_parts(Vector3::zeros().into(), rotation);
        assert_eq!(axis_words(&Vector3::x(), &pose_b_c), "x of the IMU (rolling: about its viewing axis)");
        let oblique = Vector3::new(0.1, -0.7, 0.7);
        assert!(axis_words(&oblique, &pose_b_c).starts_with("(-0.1 0.7 -0.7) of the IMU"));
    }
}
