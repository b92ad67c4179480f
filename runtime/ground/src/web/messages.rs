//! JSON messages to the page; `runtime/ground/web/js` reads them.

use super::super::corrected::Corrected;
use super::super::fields::fields;
use super::super::fleet::{Fleet, FleetEvent};
use super::super::map::{MapKeyframe, WindowScene};
use super::super::vehicle::VehicleState;
use nalgebra::Isometry3;
use plumbline_estimator::Estimate;
use plumbline_link::net::read::Heard;
use plumbline_record::messages::Picture;
use serde::Serialize;
use serde_json::{Value, json};
use std::time::Instant;

/// A pose as x y z qx qy qz qw.
fn pose(pose: &Isometry3<f64>) -> [f64; 7] {
    let (p, q) = (pose.translation.vector, pose.rotation.coords);
    [p.x, p.y, p.z, q.x, q.y, q.z, q.w]
}

/// The first message of a connection.
pub fn hello(commands: bool) -> String {
    json!({"type": "hello", "version": env!("CARGO_PKG_VERSION"), "commands": commands}).to_string()
}

/// The figures of every vehicle.
pub fn fleet(fleet: &Fleet, web_malformed: u64, now: Instant) -> String {
    let vehicles: Vec<Value> = fleet.vehicles.iter().map(|(name, v)| vehicle(name, v, now)).collect();
    json!({
        "type": "fleet",
        "now_s": now.saturating_duration_since(fleet.start).as_secs_f64(),
        "malformed": fleet.malformed + web_malformed,
        "refused": fleet.refused,
        "network": fleet.network,
        "vehicles": vehicles,
    })
    .to_string()
}

fn vehicle(name: &str, v: &VehicleState, now: Instant) -> Value {
    let s = &v.sigmas;
    let largest = |k: usize| s[k..k + 3].iter().copied().fold(0.0, f64::max);
    let sigma = json!({
        "position_m": largest(0), "attitude_deg": largest(3).to_degrees(), "velocity_m_s": largest(6),
    });
    let in_map = v.pose_m_o().zip(v.pose_o_b).map(|(pose_m_o, pose_o_b)| pose(&(pose_m_o * pose_o_b)));
    json!({
        "name": name,
        "presence": v.presence(now),
        "usable": v.is_usable(now),
        "age_s": v.age(now).map(|age| age.as_secs_f64()),
        "quality": v.quality,
        "resets": v.resets,
        "pose": v.pose_o_b.as_ref().map(pose),
        "pose_map": in_map,
        "correction": v.pose_m_o().as_ref().map(pose),
        "map": v.map_words(),
        "velocity": v.pose_o_b.map(|_| v.v_o_b.as_slice()),
        "pose_vehicle": v.pose_o_v().as_ref().map(pose),
        "attitude_deg": v.attitude().map(|a| [a.roll_deg, a.pitch_deg, a.heading_deg]),
        "rate_deg_s": v.attitude_rates().map(|rates| <[f64; 3]>::from(rates.map(f64::to_degrees))),
        "covariance": v.estimate.as_ref().map(position_covariance),
        "sigma": v.pose_o_b.map(|_| sigma),
        "stamp_ns": v.stamp_ns.to_string(),
        "words": v.bits.names().collect::<Vec<_>>(),
        "advice": v.bits.advice().collect::<Vec<_>>(),
        "bits": v.bits.0,
        "health": fields(&v.news),
        "figures": v.estimate.as_ref().map(|e| fields(&e.figures)),
        "bias_gyro": v.estimate.as_ref().map(|e| e.bias_gyro.as_slice()),
        "bias_accel": v.estimate.as_ref().map(|e| e.bias_accel.as_slice()),
        "link": link(v, now),
        "keyframes": {"have": v.map.len(), "total": v.map.announced},
    })
}

/// Upper triangle of the position's covariance, m^2: xx xy xz yy yz zz.
fn position_covariance(e: &Estimate) -> [f64; 6] {
    [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)].map(|at| e.covariance[at])
}

fn link(v: &VehicleState, now: Instant) -> Value {
    let ms = |ns: i64| ns as f64 * 1e-6;
    let channels = [&v.odom, &v.state, &v.health];
    let live = channels.into_iter().filter(|channel| !channel.is_stale(now));
    json!({
        "odom_hz": v.odom.rate_hz(now),
        "state_hz": v.state.rate_hz(now),
        "latency_ms": v.latency_ms,
        "latency_p99_ms": v.delays.quantile_ms(0.99),
        "offset_ms": v.clock.offset_ns().map(ms),
        "rtt_ms": v.clock.round_trip_ns().map(ms),
        "lost": v.odom.lost + v.state.lost,
        "bytes_s": live.map(|channel| channel.bytes_per_s).sum::<f64>(),
        "quality": v.odom.arrived.map(|share| (100.0 * share).round()),
    })
}

/// Points of a path.
pub fn track(vehicle: &str, is_new: bool, points: &[[f64; 4]]) -> String {
    // Millimetres and milliseconds are enough to look at.
    let rounded: Vec<[f64; 4]> = points.iter().map(|p| p.map(|x| (x * 1e3).round() / 1e3)).collect();
    json!({"type": "track", "vehicle": vehicle, "reset": is_new, "points": rounded}).to_string()
}

/// The corrected path in the map frame, piece by piece, and both ends of each loop.
pub fn corrected(vehicle: &str, map: &Corrected) -> String {
    // Millimetres are enough to look at.
    let rounded = |p: &[f32; 3]| p.map(|x| (f64::from(x) * 1e3).round() / 1e3);
    let pieces: Vec<Vec<[f64; 3]>> =
        map.pieces().iter().map(|piece| piece.iter().map(rounded).collect()).collect();
    let loops: Vec<[[f64; 3]; 2]> =
        map.loops().iter().map(|ends| [rounded(&ends[0]), rounded(&ends[1])]).collect();
    json!({"type": "corrected", "vehicle": vehicle, "pieces": pieces, "loops": loops}).to_string()
}

fn keyframe_row(id: u64, at: &Isometry3<f64>) -> Vec<f64> {
    std::iter::once(id as f64).chain(pose(at)).collect()
}

/// Keyframes that no longer change.
pub fn map(vehicle: &str, is_new: bool, keyframes: &[(u64, &MapKeyframe)]) -> String {
    let rows: Vec<_> = keyframes.iter().map(|(id, k)| keyframe_row(*id, &k.pose_o_b)).collect();
    let points: Vec<f32> = keyframes.iter().flat_map(|(_, k)| k.points_o.iter().copied()).collect();
    let lines: Vec<f32> = keyframes.iter().flat_map(|(_, k)| k.lines_o.iter().copied()).collect();
    json!({
        "type": "map", "vehicle": vehicle, "reset": is_new, "keyframes": rows, "points": points, "lines": lines,
    })
    .to_string()
}

/// Keyframes and landmarks of the window.
pub fn scene(vehicle: &str, scene: &WindowScene) -> String {
    let rows: Vec<_> = (0u64..).zip(&scene.keyframes).map(|(id, pose)| keyframe_row(id, pose)).collect();
    json!({
        "type": "scene", "vehicle": vehicle, "keyframes": rows, "points": scene.points_o, "lines": scene.lines_o,
    })
    .to_string()
}

#[derive(Serialize)]
struct Event<'a> {
    r#type: &'static str,
    #[serde(flatten)]
    event: &'a FleetEvent,
}

/// An event.
pub fn event(event: &FleetEvent) -> String {
    serde_json::to_string(&Event { r#type: "event", event }).unwrap_or_default()
}

/// A camera image: length of a JSON header (u32, little-endian), the header, and the JPEG.
pub fn picture(vehicle: &str, Heard { envelope, message }: &Heard<Picture>) -> Vec<u8> {
    let header = json!({
        "vehicle": vehicle, "stamp_ns": envelope.stamp_ns.to_string(),
        "width": message.width_px, "height": message.height_px,
        "points": message.points.as_flattened(), "lines": message.lines.as_flattened(),
    })
    .to_string();
    let length = u32::try_from(header.len()).unwrap_or_default().to_le_bytes();
    [&length[..], header.as_bytes(), &message.jpeg].concat()
}

#[cfg(test)]
mod tests {
    use super::super::super::test_messages::{health, heard};
    use super::*;
    use plumbline_record::fields::StampFigures;
    use plumbline_record::messages::{Health, SensorNews};

    #[test]
    fn a_vehicle_that_was_never_heard_has_no_numbers() {
        let mut known = Fleet::default();
        known.alive("drone", true);
        known.network = "Connecting to tcp/127.0.0.1:7447".into();
        let told: Value = serde_json::from_str(&fleet(&known, 2, Instant::now())).unwrap();
        let vehicle = &told["vehicles"][0];
        assert_eq!(vehicle["presence"], "unknown");
        assert!(
            vehicle["pose"].is_null() && vehicle["age_s"].is_null() && vehicle["link"]["rtt_ms"].is_null()
        );
        assert_eq!(told["malformed"], 2);
        assert_eq!(told["network"], "Connecting to tcp/127.0.0.1:7447");
    }

    #[test]
    fn notices_and_bad_stamps_reach_the_page() {
        let mut known = Fleet::default();
        known.alive("drone", true);
        let sensors = SensorNews {
            notices: vec!["mounting unknown: set it".into()],
            frames: StampFigures { restamped: 3, ..StampFigures::default() },
            samples: StampFigures { refused: 5, ..StampFigures::default() },
        };
        known.health("drone", &health(0, Health { sensors, ..Health::default() }), 100, Instant::now());
        let told: Value = serde_json::from_str(&fleet(&known, 0, Instant::now())).unwrap();
        let vehicle = &told["vehicles"][0];
        let sensors = &vehicle["health"]["sensors"];
        assert_eq!(sensors["notices"][0], "mounting unknown: set it");
        assert_eq!((&sensors["frames"]["restamped"], &sensors["samples"]["refused"]), (&json!(3), &json!(5)));
        assert!(vehicle["attitude_deg"].is_null());
    }

    #[test]
    fn a_picture_is_a_length_a_header_and_the_bytes() {
        let sent = heard(0, Picture { jpeg: vec![0xff, 0xd8, 1], width_px: 4, ..Picture::default() });
        let bytes = picture("drone", &sent);
        let length = u32::from_le_bytes(bytes[..4].try_into().unwrap()) as usize;
        let header: Value = serde_json::from_slice(&bytes[4..4 + length]).unwrap();
        assert_eq!((header["vehicle"].as_str(), header["width"].as_u64()), (Some("drone"), Some(4)));
        assert_eq!(&bytes[4 + length..], [0xff, 0xd8, 1]);
    }
}
