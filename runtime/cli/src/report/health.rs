//! Health of a flight over time.

use plumbline_estimator::{Estimate, HealthBits};
use std::fmt::Write as _;

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

    /// A flight of 200 s at 20 Hz with a health bit from 120 s to 121 s, and one frame of low quality.
    fn rows() -> Vec<Estimate> {
        let row = |k: i64| Estimate {
            stamp: Timestamp::from_nanos(7_000_000_000 + k * 50_000_000),
            quality: if k == 2410 { 12 } else { 90 },
            health: if (2400..2420).contains(&k) { HealthBits::NAMES[0].0 } else { HealthBits::default() },
            ..Estimate::default()
        };
        (0..4000).map(row).collect()
    }

    #[test]
    fn health_has_a_row_a_second_and_loses_no_low_quality() {
        let health = health_csv(&rows());
        assert_eq!(health.lines().count(), 201);
        let line = health.lines().find(|line| line.starts_with("120,")).unwrap();
        assert!(line.contains(",12,0,") && line.ends_with(HealthBits::NAMES[0].1), "{line}");
    }
}
