//! The messages that are sent: what goes into which field.

use super::flow::{FlowMeasurement, GroundDistance};
use super::frames::VehicleOdometry;
use mavlink::dialects::common::{
    DISTANCE_SENSOR_DATA, HEARTBEAT_DATA, MavAutopilot, MavDistanceSensor, MavEstimatorType, MavFrame,
    MavModeFlag, MavSensorOrientation, MavSeverity, MavState, MavType, ODOMETRY_DATA, OPTICAL_FLOW_DATA,
    OPTICAL_FLOW_RAD_DATA, STATUSTEXT_DATA,
};
use nalgebra::{Matrix3, Matrix6, UnitQuaternion};

/// Entries of the upper triangle of a 6x6 matrix, row by row.
type Triangle = [f32; 21];

/// Quality of odometry that is no such thing.
const FAILED: i8 = -1;
/// Standard deviation of the angular rate, rad/s: white noise of a small gyroscope at 200 Hz, and its bias.
const RATE_SIGMA_RAD_S: f64 = 0.02;
/// Standard deviations while the odometry is lost, m or m/s and rad: so large that a filter which fuses the message all the same
/// is not moved by it. PX4 puts its own noise, a small one, in the place of a covariance that is NaN.
const LOST_SIGMA_M: f64 = 1e3;
const LOST_SIGMA_RAD: f64 = 3.2;
/// Version of the MAVLink protocol in a heartbeat.
const MAVLINK_VERSION: u8 = 3;

/// Odometry while the estimator is tracking. `quality` is 1 to 100: MAVLink's 0 stands for an unknown one.
pub fn tracking(v: &VehicleOdometry, time_usec: u64, quality: i8, reset_counter: u32) -> ODOMETRY_DATA {
    let mut rates = Matrix6::zeros();
    rates.fixed_view_mut::<3, 3>(0, 0).copy_from(&v.velocity_covariance);
    rates.fixed_view_mut::<3, 3>(3, 3).copy_from(&(Matrix3::identity() * RATE_SIGMA_RAD_S.powi(2)));
    let [vx, vy, vz] = v.v_f.map(|x| x as f32).into();
    let [rollspeed, pitchspeed, yawspeed] = v.angular_rate_f.map(|x| x as f32).into();
    ODOMETRY_DATA {
        vx,
        vy,
        vz,
        rollspeed,
        pitchspeed,
        yawspeed,
        pose_covariance: triangle(&v.pose_covariance),
        velocity_covariance: triangle(&rates),
        quality: quality.clamp(FAILED, 100),
        ..pose(v, time_usec, reset_counter)
    }
}

/// The last pose that was known, standing still, while the odometry is lost: quality -1, and a covariance that is worth nothing.
pub fn lost(last: &VehicleOdometry, time_usec: u64, reset_counter: u32) -> ODOMETRY_DATA {
    let variances = [LOST_SIGMA_M, LOST_SIGMA_RAD].map(|sigma| sigma * sigma);
    let covariance = Matrix6::from_fn(|i, j| if i == j { variances[i / 3] } else { 0.0 });
    ODOMETRY_DATA {
        quality: FAILED,
        pose_covariance: triangle(&covariance),
        velocity_covariance: triangle(&covariance),
        ..pose(last, time_usec, reset_counter)
    }
}

fn pose(v: &VehicleOdometry, time_usec: u64, reset_counter: u32) -> ODOMETRY_DATA {
    let [x, y, z] = v.pose_l_f.translation.vector.map(|x| x as f32).into();
    ODOMETRY_DATA {
        time_usec,
        frame_id: MavFrame::MAV_FRAME_LOCAL_FRD,
        child_frame_id: MavFrame::MAV_FRAME_BODY_FRD,
        x,
        y,
        z,
        q: wxyz(&v.pose_l_f.rotation),
        // The field has eight bits, the counter wraps around in it.
        reset_counter: (reset_counter % 256) as u8,
        estimator_type: MavEstimatorType::MAV_ESTIMATOR_TYPE_VIO,
        ..ODOMETRY_DATA::default()
    }
}

fn wxyz(rotation: &UnitQuaternion<f64>) -> [f32; 4] {
    [rotation.w, rotation.i, rotation.j, rotation.k].map(|x| x as f32)
}

fn triangle(matrix: &Matrix6<f64>) -> Triangle {
    let mut entries = (0..6).flat_map(|i| (i..6).map(move |j| (i, j)));
    std::array::from_fn(|_| entries.next().map_or(f32::NAN, |entry| matrix[entry] as f32))
}

/// Flow as PX4 takes it, its distance with it. `time_usec` is that of the later frame.
pub fn flow_rad(flow: &FlowMeasurement, time_usec: u64) -> OPTICAL_FLOW_RAD_DATA {
    let [integrated_x, integrated_y] = flow.flow_rad.map(|x| x as f32).into();
    let [integrated_xgyro, integrated_ygyro, integrated_zgyro] = flow.gyro_rad.map(|x| x as f32).into();
    OPTICAL_FLOW_RAD_DATA {
        time_usec,
        integration_time_us: (flow.span_s * 1e6).round() as u32,
        integrated_x,
        integrated_y,
        integrated_xgyro,
        integrated_ygyro,
        integrated_zgyro,
        time_delta_distance_us: 0,
        distance: distance_or_unknown(flow),
        temperature: 0,
        sensor_id: 0,
        quality: flow.quality,
    }
}

/// Flow as ArduPilot takes it: rates about the axes, with the turn of the vehicle in them.
pub fn flow_rate(flow: &FlowMeasurement, time_usec: u64) -> OPTICAL_FLOW_DATA {
    let [flow_rate_x, flow_rate_y] = flow.flow_rad.map(|x| (x / flow.span_s) as f32).into();
    OPTICAL_FLOW_DATA {
        time_usec,
        ground_distance: distance_or_unknown(flow),
        quality: flow.quality,
        flow_rate_x,
        flow_rate_y,
        ..OPTICAL_FLOW_DATA::default()
    }
}

fn distance_or_unknown(flow: &FlowMeasurement) -> f32 {
    flow.distance.map_or(-1.0, |distance| distance.m as f32)
}

/// Distance of the ground below the vehicle.
pub fn distance(ground: &GroundDistance, time_usec: u64) -> DISTANCE_SENSOR_DATA {
    let cm = |m: f64| (m * 100.0).round() as u16;
    DISTANCE_SENSOR_DATA {
        // Milliseconds since the boot, which wrap around after 49 days.
        time_boot_ms: (time_usec / 1000) as u32,
        min_distance: cm(ground.limits_m[0]),
        max_distance: cm(ground.limits_m[1]),
        current_distance: cm(ground.m),
        mavtype: MavDistanceSensor::MAV_DISTANCE_SENSOR_UNKNOWN,
        orientation: MavSensorOrientation::MAV_SENSOR_ROTATION_PITCH_270,
        covariance: u8::MAX,
        ..DISTANCE_SENSOR_DATA::default()
    }
}

/// A sign of life; `state` says how far the estimator is.
pub fn heartbeat(state: MavState) -> HEARTBEAT_DATA {
    HEARTBEAT_DATA {
        custom_mode: 0,
        mavtype: MavType::MAV_TYPE_ONBOARD_CONTROLLER,
        autopilot: MavAutopilot::MAV_AUTOPILOT_INVALID,
        base_mode: MavModeFlag::empty(),
        system_status: state,
        mavlink_version: MAVLINK_VERSION,
    }
}

/// Words for the pilot, at most 50 bytes.
pub fn statustext(severity: MavSeverity, text: &str) -> STATUSTEXT_DATA {
    STATUSTEXT_DATA { severity, text: text.into(), id: 0, chunk_seq: 0 }
}

#[cfg(test)]
mod tests {
    use super::super::fixture::odometry;
    use super::super::frames::VehicleFrames;
    use super::*;
    use mavlink::dialects::common::MavMessage;
    use mavlink::{MavHeader, MavlinkVersion};
    use plumbline_config::options::VehicleConfig;

    fn vehicle() -> VehicleOdometry {
        let frames = VehicleFrames::new(&VehicleConfig::mounted([180.0, -90.0, 0.0]).rot_v_b().unwrap());
        let o = odometry();
        frames.convert(&o, &frames.local_frame(&o.pose_o_b))
    }

    /// Written by the library and read back by it.
    fn through_the_wire(message: ODOMETRY_DATA) -> ODOMETRY_DATA {
        let mut wire = Vec::new();
        mavlink::write_v2_msg(&mut wire, MavHeader::default(), &MavMessage::ODOMETRY(message)).unwrap();
        let mut reader = mavlink::MavlinkReader::new(&wire[..]);
        let (_, read) = reader.read_message::<MavMessage>(MavlinkVersion::V2).unwrap();
        match read {
            MavMessage::ODOMETRY(message) => message,
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn odometry_comes_through_the_wire_in_the_autopilots_frames() {
        let v = vehicle();
        let read = through_the_wire(tracking(&v, 123_456_789, 80, 2));
        assert_eq!((read.time_usec, read.quality, read.reset_counter), (123_456_789, 80, 2));
        assert_eq!(read.frame_id, MavFrame::MAV_FRAME_LOCAL_FRD);
        assert_eq!(read.child_frame_id, MavFrame::MAV_FRAME_BODY_FRD);
        assert_eq!(read.estimator_type, MavEstimatorType::MAV_ESTIMATOR_TYPE_VIO);
        assert_eq!(
            [read.x, read.y, read.z],
            <[f32; 3]>::from(v.pose_l_f.translation.vector.map(|x| x as f32))
        );
        assert_eq!([read.vx, read.vy, read.vz], <[f32; 3]>::from(v.v_f.map(|x| x as f32)));
        assert_eq!(read.q[0], v.pose_l_f.rotation.w as f32);
    }

    #[test]
    fn covariances_are_upper_triangles_by_rows_and_finite() {
        let v = vehicle();
        let read = through_the_wire(tracking(&v, 1, 80, 0));
        let diagonal = [0, 6, 11, 15, 18, 20];
        for (k, place) in diagonal.into_iter().enumerate() {
            assert_eq!(read.pose_covariance[place], v.pose_covariance[(k, k)] as f32);
        }
        assert_eq!(read.pose_covariance[2], v.pose_covariance[(0, 2)] as f32);
        assert_eq!(read.pose_covariance[9], v.pose_covariance[(1, 4)] as f32);
        for (k, place) in diagonal.into_iter().enumerate().take(3) {
            assert_eq!(read.velocity_covariance[place], v.velocity_covariance[(k, k)] as f32);
        }
        assert_eq!(read.velocity_covariance[7], v.velocity_covariance[(1, 2)] as f32);
        assert!([15, 18, 20].into_iter().all(|k| read.velocity_covariance[k] > 1e-4));
        assert!(read.velocity_covariance.iter().all(|x| x.is_finite()));
    }

    #[test]
    fn lost_odometry_keeps_the_last_pose_and_is_worth_nothing() {
        let v = vehicle();
        let read = through_the_wire(lost(&v, 5, 258));
        assert_eq!((read.quality, read.reset_counter), (-1, 2));
        assert_eq!(read.x, v.pose_l_f.translation.x as f32);
        assert_eq!([read.vx, read.vy, read.vz, read.rollspeed, read.pitchspeed, read.yawspeed], [0.0; 6]);
        for place in [0, 6, 11] {
            assert!(read.pose_covariance[place] > 1e5 && read.velocity_covariance[place] > 1e5);
        }
        assert!([15, 18, 20].into_iter().all(|place| read.pose_covariance[place] > 9.0));
        assert!(read.pose_covariance.iter().chain(&read.velocity_covariance).all(|x| x.is_finite()));
    }

    #[test]
    fn flow_and_distance_come_through_the_wire_in_their_units() {
        let measured = FlowMeasurement {
            stamp: plumbline_config::Timestamp::from_nanos(0),
            span_s: 0.05,
            flow_rad: nalgebra::Vector2::new(-0.02, 0.03),
            gyro_rad: nalgebra::Vector3::new(0.01, -0.015, 0.1),
            quality: 200,
            distance: Some(GroundDistance { m: 1.234, limits_m: [0.22, 11.0] }),
        };
        let mut wire = Vec::new();
        for message in [
            MavMessage::OPTICAL_FLOW_RAD(flow_rad(&measured, 5_000_000_123)),
            MavMessage::OPTICAL_FLOW(flow_rate(&measured, 5_000_000_123)),
            MavMessage::DISTANCE_SENSOR(distance(&measured.distance.unwrap(), 5_000_000_123)),
        ] {
            mavlink::write_v2_msg(&mut wire, MavHeader::default(), &message).unwrap();
        }
        let mut reader = mavlink::MavlinkReader::new(&wire[..]);
        let mut next = || reader.read_message::<MavMessage>(MavlinkVersion::V2).unwrap().1;
        let MavMessage::OPTICAL_FLOW_RAD(rad) = next() else { panic!() };
        assert_eq!((rad.time_usec, rad.integration_time_us, rad.quality), (5_000_000_123, 50_000, 200));
        assert_eq!([rad.integrated_x, rad.integrated_y], [-0.02, 0.03]);
        assert_eq!([rad.integrated_xgyro, rad.integrated_ygyro, rad.integrated_zgyro], [0.01, -0.015, 0.1]);
        assert_eq!(rad.distance, 1.234);
        let MavMessage::OPTICAL_FLOW(rate) = next() else { panic!() };
        assert_eq!((rate.flow_rate_x, rate.flow_rate_y, rate.quality), (-0.4, 0.6, 200));
        let MavMessage::DISTANCE_SENSOR(down) = next() else { panic!() };
        assert_eq!((down.min_distance, down.current_distance, down.max_distance), (22, 123, 1100));
        assert_eq!((down.time_boot_ms, down.covariance), (5_000_000, 255));
        assert_eq!(down.orientation as u8, 25);
        let mono = FlowMeasurement { distance: None, ..measured };
        assert_eq!(flow_rad(&mono, 1).distance, -1.0);
    }

    #[test]
    fn a_quality_that_is_none_is_not_lifted() {
        let v = vehicle();
        assert_eq!(tracking(&v, 1, 0, 0).quality, 0);
        assert_eq!(tracking(&v, 1, 100, 0).quality, 100);
    }

    #[test]
    fn texts_are_cut_at_fifty_bytes() {
        let text = statustext(MavSeverity::MAV_SEVERITY_INFO, &"x".repeat(60)).text;
        assert_eq!(text.to_str().unwrap().len(), 50);
    }
}
