//! Validation of the autopilot's address, and of what its line can carry.

use crate::Config;
use crate::error::Violation;
use crate::options::{AutopilotEndpoint, FlowMessages};
use nalgebra::Vector3;

/// An ODOMETRY message on the wire, bytes.
const ODOMETRY_BYTES: f64 = 245.0;
/// OPTICAL_FLOW_RAD, OPTICAL_FLOW and DISTANCE_SENSOR at 30 frames a second, bytes a second.
const FLOW_BYTES_S: f64 = 4600.0;
/// Cosine of the largest angle between the optical axis of a camera that looks down and the vehicle's down.
const MIN_COS_DOWN: f64 = 0.7;
/// All other messages in a second, bytes.
const OTHERS_BYTES_S: f64 = 800.0;

pub(super) fn check(config: &Config, found: &mut Vec<Violation>) {
    let autopilot = &config.autopilot;
    if autopilot.connect.is_empty() {
        return;
    }
    let mut refuse = |reason: String, cure: &str| {
        found.push(Violation::new("autopilot.connect", reason, cure));
    };
    match AutopilotEndpoint::parse(&autopilot.connect) {
        Err(reason) => refuse(
            reason,
            "write udp://HOST:PORT, udpin://ADDRESS:PORT or serial://DEVICE:BAUD, such as \
             \"udp://127.0.0.1:14540\" or \"serial:///dev/ttyS0:921600\", or \"\" for no autopilot",
        ),
        Ok(AutopilotEndpoint::Serial(line)) => {
            let flow_bytes_s = if autopilot.flow == FlowMessages::Off { 0.0 } else { FLOW_BYTES_S };
            let bytes_s = autopilot.rate_hz * ODOMETRY_BYTES + OTHERS_BYTES_S + flow_bytes_s;
            if let Some(reason) =
                line.too_slow(bytes_s, &format!("autopilot.rate_hz = {}", autopilot.rate_hz))
            {
                refuse(reason, "use a faster line, such as 921600");
            }
        }
        Ok(AutopilotEndpoint::Udp(_) | AutopilotEndpoint::UdpIn { .. }) => {}
    }
    if autopilot.flow != FlowMessages::Off {
        check_flow(config, found);
    }
}

/// Checks that the left camera looks down: autopilots accept flow from no other direction.
fn check_flow(config: &Config, found: &mut Vec<Violation>) {
    let (Some(rot_v_b), Some(left)) = (config.vehicle.rot_v_b(), config.camera.first()) else { return };
    let axis_v = rot_v_b * (left.pose_b_c().rotation * Vector3::z());
    if axis_v.z > -MIN_COS_DOWN {
        let angle_deg = libm::acos((-axis_v.z).clamp(-1.0, 1.0)).to_degrees();
        found.push(Violation::new(
            "autopilot.flow",
            format!("camera[0] looks {angle_deg:.0} degrees away from the vehicle's down; autopilots take the flow of the ground alone"),
            "set autopilot.flow = \"off\", or mount the left camera within 45 degrees of down; if it is, correct \
             vehicle.imu_to_vehicle_deg or camera[0].pose_b_c",
        ));
    }
}
