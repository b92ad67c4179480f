//! Events of a flight, and tables of it at a reduced rate.

use plumbline_config::{ImuSample, Timestamp};
use plumbline_estimator::{Estimate, HealthBits, TrackingState};
use plumbline_record::columns;
use std::fmt::Write as _;

/// Data before and after an event, s: a minute in all.
pub const AROUND_S: f64 = 30.0;
/// A health bit that was clear for this long is an event when it is set again, s.
const QUIET_S: f64 = 2.0;
/// Rates of the tables of states and of inertial samples, Hz.
const STATES_HZ: f64 = 4.0;
const SAMPLES_HZ: f64 = 20.0;
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
    /// True if the report includes a minute of data around the event.
    pub is_trouble: bool,
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
        let mut tell = |what: String, is_trouble| events.push(ReportEvent { time_s, what, is_trouble });
        if row.has_pose() && !had_pose {
            had_pose = true;
            tell("first pose".into(), false);
        }
        if let Some(before) = before {
            let gap_s = row.stamp.seconds_since(before.stamp);
            if gap_s > GAP_S {
                tell(format!("no estimate for {gap_s:.2} s"), true);
            }
            if row.reset_counter != before.reset_counter {
                tell(format!("reset {}", row.reset_counter), true);
            }
            if row.state != before.state {
                let is_trouble = matches!(row.state, TrackingState::Failed | TrackingState::Blind);
                tell(format!("state {:?}", row.state).to_lowercase(), is_trouble);
            }
        }
        for ((bit, name), last) in HealthBits::NAMES.into_iter().zip(&mut last_set) {
            if row.health.contains(bit) {
                if time_s - *last > QUIET_S {
                    tell(format!("health: {name}"), had_pose);
                }
                *last = time_s;
            }
        }
        before = Some(row);
    }
    events
}

/// Spans around the troubles, merged, s after the first estimate.
pub fn spans(events: &[ReportEvent]) -> Vec<(f64, f64)> {
    let mut spans: Vec<(f64, f64)> = Vec::new();
    for event in events.iter().filter(|event| event.is_trouble).take(MAX_EVENTS) {
        let (from, to) = ((event.time_s - AROUND_S).max(0.0), event.time_s + AROUND_S);
        match spans.last_mut() {
            Some(last) if from <= last.1 => last.1 = to,
            _ => spans.push((from, to)),
        }
    }
    spans
}

/// True if a time is in one of the spans.
pub fn is_within(spans: &[(f64, f64)], time_s: f64) -> bool {
    spans.iter().any(|(from, to)| (*from..*to).contains(&time_s))
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

/// All columns of the estimates around the troubles, four a second, with times from the first estimate.
pub fn states_csv(rows: &[Estimate], spans: &[(f64, f64)]) -> String {
    let mut text = format!("time_s,{}\n", columns::names().join(","));
    let Some(first) = rows.first() else { return text };
    let mut next_s = f64::NEG_INFINITY;
    for row in rows {
        let time_s = row.stamp.seconds_since(first.stamp);
        if time_s < next_s || !is_within(spans, time_s) {
            continue;
        }
        next_s = time_s + 1.0 / STATES_HZ - 1e-3;
        let _ = write!(text, "{time_s:.3},");
        let mut line = String::new();
        columns::write_row(&mut line, row);
        text += line.trim_end();
        text.push('\n');
    }
    text
}

/// Inertial samples around the troubles: means and largest sizes of twentieths of a second, so that a spike is not lost.
pub fn samples_csv(samples: &[ImuSample], first: Timestamp, spans: &[(f64, f64)]) -> String {
    let mut text = String::from(
        "time_s,samples,gyro_x_rad_s,gyro_y_rad_s,gyro_z_rad_s,accel_x_m_s2,accel_y_m_s2,accel_z_m_s2,gyro_largest_rad_s,accel_largest_m_s2\n",
    );
    let bin = |sample: &ImuSample| (sample.stamp.seconds_since(first) * SAMPLES_HZ).floor();
    for group in samples.chunk_by(|a, b| bin(a) == bin(b)) {
        let Some(time_s) = group.first().map(|sample| bin(sample) / SAMPLES_HZ) else { continue };
        if !is_within(spans, time_s) {
            continue;
        }
        let count = group.len() as f64;
        let gyro = group.iter().map(|s| s.gyro).sum::<nalgebra::Vector3<f64>>() / count;
        let accel = group.iter().map(|s| s.accel).sum::<nalgebra::Vector3<f64>>() / count;
        let gyro_most = group.iter().map(|s| s.gyro.norm()).fold(0.0, f64::max);
        let accel_most = group.iter().map(|s| s.accel.norm()).fold(0.0, f64::max);
        let means: Vec<String> = gyro.iter().chain(accel.iter()).map(|x| format!("{x:.5}")).collect();
        let _ =
            writeln!(text, "{time_s:.2},{},{},{gyro_most:.5},{accel_most:.5}", group.len(), means.join(","));
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

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
    fn troubles_are_listed_and_have_a_minute_around_them() {
        let events = events(&rows());
        let told: Vec<(f64, &str)> =
            events.iter().map(|event| (event.time_s.round(), event.what.as_str())).collect();
        let bit = format!("health: {}", HealthBits::NAMES[0].1);
        assert_eq!(told, [(0.0, "first pose"), (100.0, "reset 1"), (120.0, bit.as_str())]);
        let [(from, to)] = spans(&events)[..] else { panic!("one span") };
        assert!((from - 70.0).abs() < 1e-6 && (to - 150.0).abs() < 1e-6);
        assert!(events_csv(&events).lines().count() == 4);
        assert!(spans(&events[..1]).is_empty());
    }

    #[test]
    fn tables_are_thinned_and_lose_no_low_quality() {
        let (rows, spans) = (rows(), [(70.0, 150.0)]);
        let health = health_csv(&rows);
        assert_eq!(health.lines().count(), 201);
        let line = health.lines().find(|line| line.starts_with("120,")).unwrap();
        assert!(line.contains(",12,1,") && line.ends_with(HealthBits::NAMES[0].1), "{line}");
        let states = states_csv(&rows, &spans);
        assert_eq!(states.lines().count(), 1 + 80 * 4);
        let columns =
            states.lines().map(|line| line.split(',').count()).collect::<std::collections::BTreeSet<_>>();
        assert_eq!(columns.len(), 1);
    }

    #[test]
    fn a_spike_between_thinned_samples_shows() {
        let first = Timestamp::from_nanos(0);
        let sample = |k: i64| ImuSample {
            stamp: Timestamp::from_nanos(k * 5_000_000),
            gyro: nalgebra::Vector3::zeros(),
            accel: nalgebra::Vector3::z() * if k == 203 { 150.0 } else { 9.81 },
        };
        let samples: Vec<ImuSample> = (0..400).map(sample).collect();
        let text = samples_csv(&samples, first, &[(1.0, 2.0)]);
        assert_eq!(text.lines().count(), 21);
        assert!(text.lines().nth(1).unwrap().ends_with(",150.00000"), "{text}");
    }
}
