//! ROS 2 messages from an estimate.
//!
//! ROS and Plumbline differ in three ways:
//!
//! - a robot's frame `base_link` has x forward, y left, z up (REP 103), our body `B` has the axes of the IMU: poses
//!   and twists are published of the vehicle's frame `V`, with its origin in the IMU;
//! - a twist is in the **child frame**, our velocity is in the odometry frame;
//! - covariances are about other axes ([`super::covariance`]).

use super::covariance::{pose_covariance_o, rotated, twist_covariance_b};
use super::messages::{
    Header, OdometryMessage, PoseStamped, PoseWithCovariance, Rows6, TfMessage, Time, TransformStamped,
    Twist, TwistWithCovariance,
};
use nalgebra::{Isometry3, Matrix6, UnitQuaternion, Vector3};
use plumbline_config::options::RosConfig;
use plumbline_estimator::Odometry;

/// Names and mounting that the messages of a vehicle share.
#[derive(Clone, Copy, Debug)]
pub struct RosFrames<'a> {
    /// Name of the map frame `M`.
    pub map: &'a str,
    /// Name of the odometry frame `O`.
    pub odom: &'a str,
    /// Name of the vehicle's frame `V`.
    pub base: &'a str,
    /// Name of the body frame `B`, the IMU's.
    pub body: &'a str,
    /// Takes coordinates from `B` to `V`.
    pub rot_v_b: UnitQuaternion<f64>,
    /// Standard deviation of the angular rate, rad/s.
    pub angular_rate_sigma_rad_s: f64,
}

impl<'a> RosFrames<'a> {
    /// Names of the configuration, and the mounting of the IMU.
    pub fn new(options: &'a RosConfig, rot_v_b: UnitQuaternion<f64>) -> Self {
        Self {
            map: &options.map_frame,
            odom: &options.odom_frame,
            base: &options.base_frame,
            body: &options.body_frame,
            rot_v_b,
            angular_rate_sigma_rad_s: options.angular_rate_sigma_rad_s,
        }
    }

    /// Pose and twist with their covariances.
    pub fn odometry(&self, o: &Odometry, stamp: Time) -> OdometryMessage<'a> {
        let rot_o_b = &o.pose_o_b.rotation;
        let v_b = rot_o_b.inverse() * o.v_o_b;
        let twist_b = twist_covariance_b(rot_o_b, &v_b, &o.covariance, self.angular_rate_sigma_rad_s);
        OdometryMessage {
            header: self.header(stamp),
            child_frame_id: self.base,
            pose: PoseWithCovariance {
                pose: self.vehicle(&o.pose_o_b).into(),
                covariance: rows(&pose_covariance_o(rot_o_b, &o.covariance)),
            },
            twist: TwistWithCovariance {
                twist: Twist {
                    linear: (self.rot_v_b * v_b).into(),
                    angular: (self.rot_v_b * o.angular_rate_b).into(),
                },
                covariance: rows(&rotated(&self.rot_v_b, &twist_b)),
            },
        }
    }

    /// Pose of the vehicle where the body has this pose.
    pub fn vehicle(&self, pose_b: &Isometry3<f64>) -> Isometry3<f64> {
        Isometry3::from_parts(pose_b.translation, pose_b.rotation * self.rot_v_b.inverse())
    }

    /// The pose alone.
    pub fn pose(&self, o: &Odometry, stamp: Time) -> PoseStamped<'a> {
        PoseStamped { header: self.header(stamp), pose: self.vehicle(&o.pose_o_b).into() }
    }

    /// The tree as `/tf` has it: `O` is the parent of `V`, and `V` that of `B`. Where it is known how `O` lies in `M`, that
    /// is the parent of `O`. All have one stamp, so that every frame can be brought to every other at it: tf2 looks into no
    /// future.
    pub fn transforms(&self, o: &Odometry, pose_m_o: Option<&Isometry3<f64>>, stamp: Time) -> TfMessage<'a> {
        let pose_v_b = Isometry3::from_parts(Vector3::zeros().into(), self.rot_v_b);
        let map = pose_m_o.map(|pose_m_o| TransformStamped {
            header: Header { stamp, frame_id: self.map },
            child_frame_id: self.odom,
            transform: (*pose_m_o).into(),
        });
        let vehicle = [
            TransformStamped {
                header: self.header(stamp),
                child_frame_id: self.base,
                transform: self.vehicle(&o.pose_o_b).into(),
            },
            TransformStamped {
                header: Header { stamp, frame_id: self.base },
                child_frame_id: self.body,
                transform: pose_v_b.into(),
            },
        ];
        TfMessage { transforms: map.into_iter().chain(vehicle).collect() }
    }

    /// Header of a message in the odometry frame.
    pub fn header(&self, stamp: Time) -> Header<'a> {
        Header { stamp, frame_id: self.odom }
    }
}

fn rows(matrix: &Matrix6<f64>) -> Rows6 {
    Rows6(std::array::from_fn(|i| std::array::from_fn(|j| matrix[(i, j)])))
}

#[cfg(test)]
pub(super) mod tests {
    use super::super::messages;
    use super::*;
    use plumbline_config::Timestamp;
    use plumbline_estimator::{NavCovariance, TrackingState};
    use std::f64::consts::PI;

    /// An IMU that sits as the vehicle does.
    fn aligned() -> RosFrames<'static> {
        RosFrames {
            map: "map",
            odom: "odom",
            base: "base_link",
            body: "body",
            rot_v_b: UnitQuaternion::identity(),
            angular_rate_sigma_rad_s: 0.01,
        }
    }

    /// One with x up, y right and z forward.
    pub fn upright() -> RosFrames<'static> {
        let rot_v_b = UnitQuaternion::from_euler_angles(PI, -PI / 2.0, 0.0);
        RosFrames { rot_v_b, ..aligned() }
    }

    pub fn odometry() -> Odometry {
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
            jumps: 0,
            origin: plumbline_estimator::OriginUncertainty::default(),
        }
    }

    #[test]
    fn pose_and_twist_are_the_vehicle_s_whose_x_is_forward_and_z_up() {
        let mut o = odometry();
        // Level, the nose along x of the odometry frame, flying forward and climbing, turning to the left.
        let rot_v_b = upright().rot_v_b;
        o.pose_o_b.rotation = rot_v_b;
        o.v_o_b = Vector3::new(2.0, 0.0, 0.5);
        o.angular_rate_b = rot_v_b.inverse() * Vector3::new(0.0, 0.0, 0.7);
        let message = upright().odometry(&o, Time::from_nanos(0));
        assert_eq!(message.child_frame_id, "base_link");
        assert!((message.pose.pose.orientation.w.abs() - 1.0).abs() < 1e-12);
        let near = |a: &messages::Vector3, b: [f64; 3]| {
            [a.x - b[0], a.y - b[1], a.z - b[2]].iter().all(|d| d.abs() < 1e-12)
        };
        assert!(near(&message.twist.twist.linear, [2.0, 0.0, 0.5]), "{:?}", message.twist.twist.linear);
        assert!(near(&message.twist.twist.angular, [0.0, 0.0, 0.7]), "{:?}", message.twist.twist.angular);
        // The velocity in V has the covariance of R_VB v_b, which is R_VB C R_VBᵀ.
        let b = aligned().odometry(&o, Time::from_nanos(0)).twist.covariance.0;
        let v = message.twist.covariance.0;
        // x of V is z of B, and z of V is x of B.
        assert!((v[0][0] - b[2][2]).abs() < 1e-12 && (v[2][2] - b[0][0]).abs() < 1e-12);
        assert!((v[0][2] - b[2][0]).abs() < 1e-12);
    }

    #[test]
    fn the_twist_is_the_body_s_where_the_imu_sits_as_the_vehicle_does() {
        let o = odometry();
        let message = aligned().odometry(&o, Time::from_nanos(0));
        assert_eq!(message.twist.twist.linear, (o.pose_o_b.rotation.inverse() * o.v_o_b).into());
        assert_eq!(message.twist.twist.angular, o.angular_rate_b.into());
        // Both covariances are those that belong to it.
        let own = pose_covariance_o(&o.pose_o_b.rotation, &o.covariance);
        assert_eq!(message.pose.covariance, rows(&own));
    }
}
