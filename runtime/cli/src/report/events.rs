//! Events of a flight, and its health over time.

use plumbline_estimator::{Estimate, HealthBits};
use std::fmt::Write as _;

/// A health bit that was clear for this long is an event when it is set again, s.
const QUIET_S: f64 = 2.0;
/// Estimates further apart are a gap, s.
const GAP_S: f64 = 0.5;
/// Most events that are listed; the rest is counted.
pub const MAX_EVENTS: usize = 200;

/// Something that happened.
#[derive(Clone, Debug, PartialEq)]
pub struct ReportEvent {
    /// Time of the event, s after the first estimate.
    pub time_s: f64,
    /// Description of the event.
    pub what: String,
}

/// The events of a flight in order.
pub fn events(rows: &[Estimate]) -> Vec<ReportEvent> {
    let Some(first) = rows.first() else { return Vec::new() };
    let mut events: Vec<ReportEvent> = Vec::new();
    let mut last_set = [f64::NEG_INFINITY; HealthBits::NAMES.len()];
    let mut before: Option<&Estimate> = None;
    let mut had_pose = false;
    for row in rows {
        let time_s = row.stamp.seconds_since(first.stamp);
        let mut tell = |what: String| events.push(ReportEvent { time_s, what });
        if row.has_pose() && !had_pose {
            had_pose = true;
            tell("first pose".into());
        }
        if let Some(before) = before {
            let gap_s = row.stamp.seconds_since(before.stamp);
            if gap_s > GAP_S {
                tell(format!("no estimate for {gap_s:.2} s"));
            }
            if row.reset_counter != before.reset_counter {
                tell(format!("reset {}", row.reset_counter));
            }
            if row.state != before.state {
                tell(format!("state {:?}", row.state).to_lowercase());
            }
        }
        for ((bit, name), last) in HealthBits::NAMES.into_iter().zip(&mut last_set) {
            if row.health.contains(bit) {
                if time_s - *last > QUIET_S {
                    tell(format!("health: {name}"));
                }
                *last = time_s;
            }
        }
        before = Some(row);
    }
    events
}

/// Events as CSV.
pub fn events_csv(events: &[ReportEvent]) -> String {
    let mut text = String::from("time_s,event\n");
    for event in events.iter().take(MAX_EVENTS) {
        let _ = writeln!(text, "{:.3},{}", event.time_s, event.what);
    }
    if let Some(rest) = events.len().checked_sub(MAX_EVENTS).filter(|rest| *rest > 0) {
        let _ = writeln!(text, ",and {rest} more");
    }
    text
}

/// Health over time, a row a second: the lowest quality, and every bit that was set.
pub fn health_csv(rows: &[Estimate]) -> String {
    let mut text = String::from(
        "time_s,frames,state,quality_least,reset_counter,points_least,position_sigma_m,health\n",
    );
    let Some(first) = rows.first() else { return text };
    let second = |row: &Estimate| row.stamp.seconds_since(first.stamp).floor();
    for group in rows.chunk_by(|a, b| second(a) == second(b)) {
        let Some(last) = group.last() else { continue };
        let quality = group.iter().map(|row| row.quality).min().unwrap_or_default();
        let points = group.iter().map(|row| row.figures.points_tracked).min().unwrap_or_default();
        let sigma_m = last.covariance.fixed_view::<3, 3>(0, 0).trace().max(0.0).sqrt();
        let set =
            HealthBits::NAMES.iter().filter(|(bit, _)| group.iter().any(|row| row.health.contains(*bit)));
        let set: Vec<&str> = set.map(|(_, name)| *name).collect();
        let state = format!("{:?}", last.state).to_lowercase();
        let (seconds, frames, resets) = (second(last), group.len(), last.reset_counter);
        let _ = writeln!(
            text,
            "{seconds},{frames},{state},{quality},{resets},{points},{sigma_m:.4},{}",
            set.join("; ")
        );
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use plumbline_config::Timestamp;
    use plumbline_estimator::TrackingState;

    /// A flight of 200 s at 20 Hz with a reset at 100 s, and a health bit from 120 s to 121 s.
    fn rows() -> Vec<Estimate> {
        let row = |k: i64| Estimate {
            stamp: Timestamp::from_nanos(7_000_000_000 + k * 50_000_000),
            state: TrackingState::Tracking,
            quality: if k == 2410 { 12 } else { 90 },
            reset_counter: u32::from(k >= 2000),
            health: if (2400..2420).contains(&k) { HealthBits::NAMES[0].0 } else { HealthBits::default() },
            ..Estimate::default()
        };
        (0..4000).map(row).collect()
    }

    #[test]
    fn resets_and_health_bits_are_events_once() {
        let events = events(&rows());
        let told: Vec<(f64, &str)> =
            events.iter().map(|event| (event.time_s.round(), event.what.as_str())).collect();
        let bit = format!("health: {}", HealthBits::NAMES[0].1);
        assert_eq!(told, [(0.0, "first pose"), (100.0, "reset 1"), (120.0, bit.as_str())]);
        assert_eq!(events_csv(&events).lines().count(), 4);
    }

    #[test]
    fn health_has_a_row_a_second_and_loses_no_low_quality() {
        let health = health_csv(&rows());
        assert_eq!(health.lines().count(), 201);
        let line = health.lines().find(|line| line.starts_with("120,")).unwrap();
        assert!(line.contains(",12,1,") && line.ends_with(HealthBits::NAMES[0].1), "{line}");
    }
}
