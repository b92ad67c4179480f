//! Mounting of the sensors in the vehicle.

use nalgebra::UnitQuaternion;
use plumbline_keys::keys;
use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// Mounting of the IMU in the vehicle. Ground station, autopilot and ROS 2 speak of the vehicle's attitude
/// by it; the estimator does not depend on it.
#[keys]
pub struct VehicleConfig {
    /// Roll, pitch and yaw of the rotation from the IMU's axes to the vehicle's (x forward, y left, z up). Rz(yaw)
    /// Ry(pitch) Rx(roll) transforms coordinates from the IMU to the vehicle. "unknown" if not known: then neither
    /// autopilot nor ROS 2 is served; `plumbline doctor --live` measures the rotation.
    #[key(default, range = -180.0..=180.0, unit = DEGREES, cure = "write it in degrees, from -180 to 180")]
    pub imu_to_vehicle_deg: Mounting,
}

/// Rotation from the IMU to the vehicle, as far as it is known.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(untagged, expecting = "a list of 3 numbers or \"unknown\" is expected")]
pub enum Mounting {
    /// Not known: nothing that depends on the vehicle's attitude may start.
    #[default]
    #[serde(serialize_with = "write_unknown", deserialize_with = "read_unknown")]
    Unknown,
    /// Roll, pitch and yaw, degrees.
    Known([f64; 3]),
}

fn write_unknown<S: Serializer>(serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_str(Mounting::UNKNOWN)
}

fn read_unknown<'de, D: Deserializer<'de>>(deserializer: D) -> Result<(), D::Error> {
    let is_unknown = String::deserialize(deserializer)? == Mounting::UNKNOWN;
    is_unknown.then_some(()).ok_or_else(|| D::Error::custom("another word"))
}

impl Mounting {
    /// Word of a configuration for a mounting that is not known.
    pub const UNKNOWN: &'static str = "unknown";

    /// Mounting of this rotation from the IMU to the vehicle; angles are rounded to a thousandth of a degree.
    pub fn of_rotation(rot_v_b: &UnitQuaternion<f64>) -> Self {
        let (roll, pitch, yaw) = rot_v_b.euler_angles();
        let rounded = |angle: f64| (angle.to_degrees() * 1e3).round() / 1e3;
        // Adding zero turns -0 into 0.
        Self::Known([roll, pitch, yaw].map(|angle| rounded(angle) + 0.0))
    }

    /// Roll, pitch and yaw, degrees.
    pub fn degrees(&self) -> Option<[f64; 3]> {
        match self {
            Self::Known(degrees) => Some(*degrees),
            Self::Unknown => None,
        }
    }
}

/// Refusal of an output of this name, which needs the vehicle's attitude, while the mounting of the IMU is unknown.
#[derive(Clone, Copy, Debug, thiserror::Error)]
#[error("{unknown}, and {0} would receive a wrong attitude: {cure}", unknown = VehicleConfig::UNKNOWN, cure = VehicleConfig::CURE)]
pub struct UnknownMounting(pub &'static str);

impl VehicleConfig {
    /// Words of a message that refuses an unknown mounting: what is missing.
    pub const UNKNOWN: &'static str = "vehicle.imu_to_vehicle_deg is \"unknown\"";
    /// Words of a message that refuses an unknown mounting: what to do.
    pub const CURE: &'static str = "set it to roll, pitch and yaw of the IMU in the vehicle, degrees, such as [180.0, 0.0, \
                                    0.0]; `plumbline doctor --live` measures it";

    /// Mounting by roll, pitch and yaw, degrees.
    pub fn mounted(imu_to_vehicle_deg: [f64; 3]) -> Self {
        Self { imu_to_vehicle_deg: Mounting::Known(imu_to_vehicle_deg) }
    }

    /// `R_VB`: takes coordinates from the IMU's axes `B` to the vehicle's axes `V` (x forward, y left, z up). `None` if
    /// the mounting is unknown.
    pub fn rot_v_b(&self) -> Option<UnitQuaternion<f64>> {
        let [roll, pitch, yaw] = self.imu_to_vehicle_deg.degrees()?.map(f64::to_radians);
        Some(UnitQuaternion::from_euler_angles(roll, pitch, yaw))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Config;
    use nalgebra::Vector3;

    fn rotated(imu_to_vehicle_deg: [f64; 3], v_b: [f64; 3]) -> Vector3<f64> {
        VehicleConfig::mounted(imu_to_vehicle_deg).rot_v_b().unwrap() * Vector3::from(v_b)
    }

    fn assert_near(a: Vector3<f64>, b: [f64; 3]) {
        assert!((a - Vector3::from(b)).norm() < 1e-12, "{a} against {b:?}");
    }

    #[test]
    fn angles_follow_the_right_hand_about_forward_left_and_up() {
        let (x, y) = ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0]);
        assert_near(rotated([0.0, 0.0, 90.0], x), [0.0, 1.0, 0.0]);
        assert_near(rotated([0.0, 90.0, 0.0], x), [0.0, 0.0, -1.0]);
        assert_near(rotated([90.0, 0.0, 0.0], y), [0.0, 0.0, 1.0]);
    }

    #[test]
    fn an_imu_with_x_up_y_right_z_forward_is_turned_upright() {
        let turned = |v_b| rotated([180.0, -90.0, 0.0], v_b);
        assert_near(turned([1.0, 0.0, 0.0]), [0.0, 0.0, 1.0]);
        assert_near(turned([0.0, 1.0, 0.0]), [0.0, -1.0, 0.0]);
        assert_near(turned([0.0, 0.0, 1.0]), [1.0, 0.0, 0.0]);
    }

    #[test]
    fn a_rotation_is_written_by_its_angles() {
        let Mounting::Known(degrees) =
            Mounting::of_rotation(&VehicleConfig::mounted([-168.527, -85.105, -10.032]).rot_v_b().unwrap())
        else {
            panic!("it is known")
        };
        for (angle, expected) in degrees.into_iter().zip([-168.527, -85.105, -10.032]) {
            assert!((angle - expected).abs() < 2e-3, "{degrees:?}");
        }
    }

    #[test]
    fn a_mounting_that_nobody_has_set_is_unknown() {
        assert_eq!(VehicleConfig::default().rot_v_b(), None);
    }

    /// Angles of `up_v` against the vehicle's z: roll (right wing down) and pitch (nose up), degrees.
    fn tilt_deg(up_v: &Vector3<f64>) -> [f64; 2] {
        [libm::atan2(up_v.y, up_v.z), libm::asin(up_v.x / up_v.norm())].map(f64::to_degrees)
    }

    #[test]
    fn the_vehicle_of_the_euroc_data_sets_is_level_at_rest_with_its_nose_where_the_cameras_look() {
        let config = Config::preset("euroc").unwrap();
        // What the accelerometer of V1_01_easy says at the end of the flight, on the ground: mean of a second, m/s².
        let up_v = config.vehicle.rot_v_b().unwrap() * Vector3::new(9.244, 0.293, -3.223);
        let [roll, pitch] = tilt_deg(&up_v);
        assert!(roll.abs() < 2.0 && pitch.abs() < 1.0, "roll {roll} pitch {pitch}");
        let optical_axis_v =
            config.vehicle.rot_v_b().unwrap() * config.camera[0].pose_b_c().rotation * Vector3::z();
        let azimuth_deg = libm::atan2(optical_axis_v.y, optical_axis_v.x).to_degrees();
        assert!(azimuth_deg.abs() < 2.0, "{azimuth_deg}");
    }

    #[test]
    fn the_simulated_vehicle_looks_a_little_downwards() {
        let config = Config::preset("sim").unwrap();
        let rot_v_c = config.vehicle.rot_v_b().unwrap() * config.camera[0].pose_b_c().rotation;
        // Camera axes: x right, y down, z forward, turned down by 0.08 rad.
        let (sin, cos) = 0.08_f64.sin_cos();
        for (axis_c, axis_v) in [
            (Vector3::x(), Vector3::new(0.0, -1.0, 0.0)),
            (Vector3::y(), Vector3::new(-sin, 0.0, -cos)),
            (Vector3::z(), Vector3::new(cos, 0.0, -sin)),
        ] {
            assert!((rot_v_c * axis_c - axis_v).norm() < 1e-4, "{axis_v}");
        }
    }
}
