//! ROS 2 messages from an estimate.
//!
//! What differs between ROS and us:
//!
//! - a pose's covariance is about the **axes of the header's frame** (`geometry_msgs/PoseWithCovariance`: "fixed
//!   axes"), ours of the attitude is about those of the body;
//! - a twist is in the **child frame**, our velocity is in the odometry frame.
//!
//! The fields of the structures are those of the `.msg` files, in their order: it is the order on the wire.

use nalgebra::{Isometry3, Matrix3, Matrix6, SMatrix, UnitQuaternion, Vector3};
use plumbline_estimator::{NavCovariance, Odometry};
use serde::Serialize;

/// `builtin_interfaces/msg/Time`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Time {
    /// Seconds since the origin of the clock.
    pub sec: i32,
    /// And nanoseconds, less than a second.
    pub nanosec: u32,
}

impl Time {
    /// The time `nanos` after the origin; seconds end in 2038.
    #[must_use]
    pub fn from_nanos(nanos: i64) -> Self {
        let sec = nanos.div_euclid(1_000_000_000).clamp(i32::MIN.into(), i32::MAX.into());
        Self { sec: sec as i32, nanosec: nanos.rem_euclid(1_000_000_000) as u32 }
    }
}

/// `std_msgs/msg/Header`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Header<'a> {
    stamp: Time,
    frame_id: &'a str,
}

/// `geometry_msgs/msg/Point` and `Vector3`, which are written alike.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Xyz {
    x: f64,
    y: f64,
    z: f64,
}

/// `geometry_msgs/msg/Quaternion`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Quaternion {
    x: f64,
    y: f64,
    z: f64,
    w: f64,
}

/// `geometry_msgs/msg/Pose` and `Transform`, which are written alike.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Pose {
    position: Xyz,
    orientation: Quaternion,
}

/// `geometry_msgs/msg/PoseWithCovariance`; its 36 numbers by rows, as an array of fixed length has them.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PoseWithCovariance {
    pose: Pose,
    covariance: [[f64; 6]; 6],
}

/// `geometry_msgs/msg/Twist`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Twist {
    linear: Xyz,
    angular: Xyz,
}

/// `geometry_msgs/msg/TwistWithCovariance`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TwistWithCovariance {
    twist: Twist,
    covariance: [[f64; 6]; 6],
}

/// `nav_msgs/msg/Odometry`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct OdometryMessage<'a> {
    header: Header<'a>,
    child_frame_id: &'a str,
    pose: PoseWithCovariance,
    twist: TwistWithCovariance,
}

/// `geometry_msgs/msg/PoseStamped`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PoseStamped<'a> {
    header: Header<'a>,
    pose: Pose,
}

/// `geometry_msgs/msg/TransformStamped`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TransformStamped<'a> {
    header: Header<'a>,
    child_frame_id: &'a str,
    transform: Pose,
}

/// `tf2_msgs/msg/TFMessage`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TfMessage<'a> {
    transforms: Vec<TransformStamped<'a>>,
}

/// What the messages of one estimate share.
#[derive(Clone, Copy, Debug)]
pub struct Frames<'a> {
    /// Name of the odometry frame `O`.
    pub odom: &'a str,
    /// Name of the body frame `B`.
    pub body: &'a str,
    /// Standard deviation of the angular rate, rad/s.
    pub angular_rate_sigma_rad_s: f64,
}

impl<'a> Frames<'a> {
    /// Pose and twist with their covariances.
    #[must_use]
    pub fn odometry(&self, o: &Odometry, stamp: Time) -> OdometryMessage<'a> {
        let rot_o_b = &o.pose_o_b.rotation;
        let v_b = rot_o_b.inverse() * o.v_o_b;
        OdometryMessage {
            header: self.header(stamp),
            child_frame_id: self.body,
            pose: PoseWithCovariance {
                pose: pose(&o.pose_o_b),
                covariance: rows(&pose_covariance_o(rot_o_b, &o.covariance)),
            },
            twist: TwistWithCovariance {
                twist: Twist { linear: xyz(&v_b), angular: xyz(&o.angular_rate_b) },
                covariance: rows(&twist_covariance_b(
                    rot_o_b,
                    &v_b,
                    &o.covariance,
                    self.angular_rate_sigma_rad_s,
                )),
            },
        }
    }

    /// The pose alone.
    #[must_use]
    pub fn pose(&self, o: &Odometry, stamp: Time) -> PoseStamped<'a> {
        PoseStamped { header: self.header(stamp), pose: pose(&o.pose_o_b) }
    }

    /// The transform from the body to the odometry frame, as `/tf` has it: parent `O`, child `B`.
    #[must_use]
    pub fn transform(&self, o: &Odometry, stamp: Time) -> TfMessage<'a> {
        let transform = pose(&o.pose_o_b);
        let stamped = TransformStamped { header: self.header(stamp), child_frame_id: self.body, transform };
        TfMessage { transforms: vec![stamped] }
    }

    fn header(&self, stamp: Time) -> Header<'a> {
        Header { stamp, frame_id: self.odom }
    }
}

/// Covariance of position and of the rotation about the axes of `O`: `dtheta_o = R dtheta_b`.
fn pose_covariance_o(rot_o_b: &UnitQuaternion<f64>, covariance: &NavCovariance) -> Matrix6<f64> {
    let mut jacobian = Matrix6::identity();
    jacobian.fixed_view_mut::<3, 3>(3, 3).copy_from(rot_o_b.to_rotation_matrix().matrix());
    let own = covariance.fixed_view::<6, 6>(0, 0);
    jacobian * own * jacobian.transpose()
}

/// Covariance of the velocity in `B` and of the angular rate. `v_b = Rᵀ v_o` changes with velocity and attitude
/// by `Rᵀ dv_o + [v_b]x dtheta_b`; so an uncertain heading, which no velocity in the body depends on, drops out.
fn twist_covariance_b(
    rot_o_b: &UnitQuaternion<f64>,
    v_b: &Vector3<f64>,
    covariance: &NavCovariance,
    angular_rate_sigma_rad_s: f64,
) -> Matrix6<f64> {
    let jacobian = velocity_jacobian(rot_o_b, v_b);
    let own = covariance.fixed_view::<6, 6>(3, 3);
    let linear = jacobian * own * jacobian.transpose();
    let mut twist = Matrix6::zeros();
    twist.fixed_view_mut::<3, 3>(0, 0).copy_from(&linear);
    let angular = Matrix3::from_diagonal_element(angular_rate_sigma_rad_s.powi(2));
    twist.fixed_view_mut::<3, 3>(3, 3).copy_from(&angular);
    twist
}

/// Change of `v_b` with attitude (right perturbation) and `v_o`.
fn velocity_jacobian(rot_o_b: &UnitQuaternion<f64>, v_b: &Vector3<f64>) -> SMatrix<f64, 3, 6> {
    let mut jacobian = SMatrix::<f64, 3, 6>::zeros();
    jacobian.fixed_view_mut::<3, 3>(0, 0).copy_from(&v_b.cross_matrix());
    jacobian.fixed_view_mut::<3, 3>(0, 3).copy_from(rot_o_b.inverse().to_rotation_matrix().matrix());
    jacobian
}

fn xyz(v: &Vector3<f64>) -> Xyz {
    Xyz { x: v.x, y: v.y, z: v.z }
}

fn pose(pose: &Isometry3<f64>) -> Pose {
    let q = pose.rotation.coords;
    Pose {
        position: xyz(&pose.translation.vector),
        orientation: Quaternion { x: q.x, y: q.y, z: q.z, w: q.w },
    }
}

fn rows(matrix: &Matrix6<f64>) -> [[f64; 6]; 6] {
    std::array::from_fn(|i| std::array::from_fn(|j| matrix[(i, j)]))
}

#[cfg(test)]
mod tests {
    use super::super::cdr::encode;
    use super::*;
    use plumbline_config::Timestamp;
    use plumbline_estimator::TrackingState;

    const FRAMES: Frames<'static> =
        Frames { odom: "odom", body: "base_link", angular_rate_sigma_rad_s: 0.01 };

    fn odometry() -> Odometry {
        // Any positive definite matrix: A Aᵀ with blocks that differ.
        let root =
            NavCovariance::from_fn(
                |i, j| if i == j { 0.1 * (i + 1) as f64 } else { 0.01 * (i * 2 + j) as f64 },
            );
        Odometry {
            sequence: 7,
            stamp: Timestamp::from_nanos(1_403_715_273_262_142_976),
            pose_o_b: Isometry3::from_parts(
                Vector3::new(1.0, -2.0, 0.1).into(),
                UnitQuaternion::from_euler_angles(0.1, 0.2, 3.0),
            ),
            v_o_b: Vector3::new(1.1, 0.2, -0.3),
            angular_rate_b: Vector3::new(0.4, 0.5, 0.6),
            covariance: root * root.transpose(),
            state: TrackingState::Tracking,
            quality: 80,
            reset_counter: 2,
        }
    }

    fn number(bytes: &[u8], at: usize) -> f64 {
        f64::from_le_bytes(bytes[at..at + 8].try_into().unwrap())
    }

    #[test]
    fn the_bytes_of_a_pose_are_where_its_definition_puts_them() {
        let o = odometry();
        let bytes = encode(&FRAMES.pose(&o, Time::from_nanos(5_000_000_007))).unwrap();
        // Encapsulation, stamp, length and text of the frame, padding to 8 from behind the encapsulation.
        let expected: [&[u8]; 6] =
            [&[0, 1, 0, 0], &[5, 0, 0, 0], &[7, 0, 0, 0], &[5, 0, 0, 0], b"odom\0", &[0; 7]];
        assert_eq!(bytes[..28], expected.concat());
        let numbers: Vec<f64> = (0..7).map(|k| number(&bytes, 28 + 8 * k)).collect();
        let q = o.pose_o_b.rotation.coords;
        assert_eq!(numbers, [1.0, -2.0, 0.1, q.x, q.y, q.z, q.w]);
        assert_eq!(bytes.len(), 28 + 56);
    }

    #[test]
    fn an_odometry_message_has_its_definition_s_length() {
        let bytes = encode(&FRAMES.odometry(&odometry(), Time::from_nanos(0))).unwrap();
        // Header up to 17, child frame at 20 with 4 + 10 bytes, then doubles from 40: 7 + 36 + 6 + 36.
        assert_eq!(bytes.len(), 4 + 40 + 8 * (7 + 36 + 6 + 36));
        let twist = 4 + 40 + 8 * (7 + 36);
        assert_eq!((number(&bytes, twist + 24), number(&bytes, twist + 40)), (0.4, 0.6));
    }

    #[test]
    fn one_transform_is_a_sequence_of_one() {
        let bytes = encode(&FRAMES.transform(&odometry(), Time::from_nanos(0))).unwrap();
        assert_eq!(bytes[4..8], [1, 0, 0, 0]);
    }

    #[test]
    fn stamps_before_the_origin_and_after_2038_are_times() {
        assert_eq!(Time::from_nanos(-1), Time { sec: -1, nanosec: 999_999_999 });
        assert_eq!(Time::from_nanos(i64::MAX).sec, i32::MAX);
        assert_eq!(
            Time::from_nanos(1_403_715_273_262_142_976),
            Time { sec: 1_403_715_273, nanosec: 262_142_976 }
        );
    }

    #[test]
    fn the_velocity_is_the_body_s_and_changes_with_the_state_as_the_jacobian_says() {
        let o = odometry();
        let rot = o.pose_o_b.rotation;
        let v_b = |theta: Vector3<f64>, dv: Vector3<f64>| {
            (rot * UnitQuaternion::from_scaled_axis(theta)).inverse() * (o.v_o_b + dv)
        };
        let nominal = v_b(Vector3::zeros(), Vector3::zeros());
        assert_eq!(FRAMES.odometry(&o, Time::from_nanos(0)).twist.twist.linear, xyz(&nominal));
        let jacobian = velocity_jacobian(&rot, &nominal);
        let step = 1e-6;
        for k in 0..3 {
            let e = Vector3::ith(k, step);
            let by_attitude = (v_b(e, Vector3::zeros()) - v_b(-e, Vector3::zeros())) / (2.0 * step);
            let by_velocity = (v_b(Vector3::zeros(), e) - v_b(Vector3::zeros(), -e)) / (2.0 * step);
            assert!((by_attitude - jacobian.column(k)).norm() < 1e-8, "{by_attitude} {jacobian}");
            assert!((by_velocity - jacobian.column(k + 3)).norm() < 1e-8, "{by_velocity} {jacobian}");
        }
    }

    #[test]
    fn the_covariance_of_the_attitude_is_about_the_axes_of_the_odometry_frame() {
        let mut o = odometry();
        // The body's x axis points along y of the odometry frame: what is uncertain about the one is
        // uncertain about the other.
        o.pose_o_b.rotation =
            UnitQuaternion::from_axis_angle(&Vector3::z_axis(), std::f64::consts::FRAC_PI_2);
        o.covariance = NavCovariance::zeros();
        o.covariance[(3, 3)] = 0.04;
        o.covariance[(0, 3)] = 0.1;
        o.covariance[(3, 0)] = 0.1;
        let covariance = FRAMES.odometry(&o, Time::from_nanos(0)).pose.covariance;
        assert!((covariance[4][4] - 0.04).abs() < 1e-15 && covariance[3][3].abs() < 1e-15);
        assert!((covariance[0][4] - 0.1).abs() < 1e-15 && (covariance[4][0] - 0.1).abs() < 1e-15);
    }

    #[test]
    fn an_uncertain_heading_makes_no_velocity_of_the_body_uncertain() {
        let mut o = odometry();
        // The whole trajectory is turned about the vertical by an unknown angle, velocity and attitude alike.
        let axis_b = o.pose_o_b.rotation.inverse() * Vector3::z();
        let turned = Vector3::z().cross(&o.v_o_b);
        let mut direction = SMatrix::<f64, 9, 1>::zeros();
        direction.fixed_rows_mut::<3>(3).copy_from(&axis_b);
        direction.fixed_rows_mut::<3>(6).copy_from(&turned);
        o.covariance = direction * direction.transpose();
        let covariance = FRAMES.odometry(&o, Time::from_nanos(0)).twist.covariance;
        assert!((0..3).all(|k| covariance[k][k].abs() < 1e-14), "{covariance:?}");
        assert!((covariance[5][5] - 1e-4).abs() < 1e-18);
    }
}
