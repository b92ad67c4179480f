//! The report of a station: messages received and lost, gaps and delays, as JSON.

use super::channel::Channel;
use super::fleet::Fleet;
use super::vehicle::VehicleState;
use serde_json::{Value, json};
use std::io;
use std::path::Path;

/// Writes the report.
///
/// # Errors
/// When the file cannot be written.
pub fn write(path: &Path, fleet: &Fleet) -> io::Result<()> {
    let vehicles: serde_json::Map<String, Value> =
        fleet.vehicles.iter().map(|(name, v)| (name.clone(), vehicle(v))).collect();
    let report = json!({
        "seconds": fleet.start.elapsed().as_secs_f64(),
        "malformed": fleet.malformed,
        "refused": fleet.refused,
        "vehicles": vehicles,
    });
    let text = serde_json::to_string_pretty(&report)?;
    std::fs::write(path, text)
}

fn channel(channel: &Channel) -> Value {
    json!({
        "received": channel.received,
        "lost": channel.lost,
        "longest_gap_s": channel.longest_gap_s,
    })
}

fn vehicle(v: &VehicleState) -> Value {
    let ms = |ns: i64| ns as f64 * 1e-6;
    json!({
        "odom": channel(&v.odom),
        "state": channel(&v.state),
        "health": channel(&v.health),
        "latency_ms": {
            "p50": v.delays.quantile_ms(0.5), "p99": v.delays.quantile_ms(0.99),
            "p999": v.delays.quantile_ms(0.999), "max": v.delays.quantile_ms(1.0),
        },
        "clock": {"offset_ms": v.clock.offset_ns().map(ms), "round_trip_ms": v.clock.round_trip_ns().map(ms)},
        "keyframes": {"have": v.map.len(), "announced": v.map.announced},
        "dropped_by_vehicle": v.news.dropped,
        "resets": v.resets,
    })
}
