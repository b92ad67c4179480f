//! Health messages: five times a second, and on change.

use plumbline_config::options::VehicleConfig;
use plumbline_estimator::Estimate;
use plumbline_record::messages::{Envelope, Health, SensorNews};
use std::time::{Duration, Instant};

/// Weight of a new frame rate in the smoothed one.
const SMOOTHING: f64 = 0.1;

/// State of live sensors, with what is wrong beyond the health bits before their notices.
fn noticed(is_mounted: bool, sensors: &SensorNews) -> SensorNews {
    let mounting = (!is_mounted).then(|| format!("mounting unknown: {}", VehicleConfig::CURE));
    let notices = mounting.into_iter().chain(sensors.notices.iter().cloned()).collect();
    SensorNews { notices, ..sensors.clone() }
}

/// State from which health messages are made.
#[derive(Debug)]
pub struct HealthFeed {
    period: Duration,
    last: Option<(Envelope, Health)>,
    sent: Instant,
    frame_rate_hz: f64,
    last_stamp_ns: i64,
}

impl HealthFeed {
    /// A message every `period` at least.
    #[must_use]
    pub fn new(period: Duration) -> Self {
        Self { period, last: None, sent: Instant::now(), frame_rate_hz: 0.0, last_stamp_ns: 0 }
    }

    /// The message to send after this estimate, if one is due: on change, or after the period. `around` has what is known beside the
    /// estimate; the envelope, still empty, what is known of it.
    pub fn update(&mut self, e: &Estimate, around: Health) -> Option<(Envelope, Health)> {
        let stamp_ns = e.stamp.as_nanos();
        let period_s = (stamp_ns - self.last_stamp_ns) as f64 * 1e-9;
        if self.last_stamp_ns != 0 && period_s > 0.0 {
            self.frame_rate_hz += SMOOTHING * (1.0 / period_s - self.frame_rate_hz);
        }
        self.last_stamp_ns = stamp_ns;
        let is_same = |(_, last): &(Envelope, Health)| {
            (last.bits, last.state, last.ladder.level) == (e.health, e.state, around.ladder.level)
        };
        if self.last.as_ref().is_some_and(is_same) && self.sent.elapsed() < self.period {
            return None;
        }
        let health = Health {
            state: e.state,
            bits: e.health,
            frame_rate_hz: self.frame_rate_hz,
            sensors: noticed(around.rot_v_b.is_some(), &around.sensors),
            ..around
        };
        Some(self.sending(Envelope::around(e, Vec::new(), 0, 0), health))
    }

    /// The message to send while no estimate comes, once a period: the last one with the present state of the sensors and size of
    /// the map. Its time of measurement stays, so a station tells a silent estimator from a bad link.
    pub fn renew(&mut self, sensors: &SensorNews, keyframes: u64, paths: u64) -> Option<(Envelope, Health)> {
        let (envelope, last) = self.last.as_ref().filter(|_| self.sent.elapsed() >= self.period)?;
        let sensors = noticed(last.rot_v_b.is_some(), sensors);
        let (envelope, health) = (envelope.clone(), Health { sensors, keyframes, paths, ..last.clone() });
        Some(self.sending(envelope, health))
    }

    fn sending(&mut self, envelope: Envelope, health: Health) -> (Envelope, Health) {
        self.sent = Instant::now();
        self.last = Some((envelope.clone(), health.clone()));
        (envelope, health)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use plumbline_config::Timestamp;
    use plumbline_drivers::clock::StampFigures;
    use plumbline_estimator::TrackingState;

    fn estimate() -> Estimate {
        let stamp = Timestamp::from_nanos(50_000_000);
        Estimate { stamp, state: TrackingState::Tracking, quality: 90, ..Estimate::default() }
    }

    #[test]
    fn an_unknown_mounting_and_bad_stamps_are_told_also_while_no_estimate_comes() {
        let mut feed = HealthFeed::new(Duration::ZERO);
        let sensors = SensorNews::default();
        assert_eq!(feed.renew(&sensors, 0, 0), None, "nothing was sent yet");
        let (before, first) = feed.update(&estimate(), Health::default()).unwrap();
        assert!(first.rot_v_b.is_none() && first.sensors.notices[0].starts_with("mounting unknown: set it"));
        let (now, again) = feed.renew(&sensors, 2, 3).unwrap();
        assert_eq!((now, again.keyframes, again.paths), (before, 2, 3), "it goes on");
        assert_eq!(HealthFeed { period: Duration::from_secs(9), ..feed }.renew(&sensors, 2, 3), None);
        let mut feed = HealthFeed::new(Duration::ZERO);
        feed.update(&estimate(), Health::default()).unwrap();
        let frames = StampFigures { refused: 7, ..StampFigures::default() };
        let news = SensorNews { notices: vec!["stamps repeat".into()], frames, ..SensorNews::default() };
        let (_, renewed) = feed.renew(&news, 0, 0).unwrap();
        assert_eq!((renewed.sensors.frames.refused, renewed.sensors.notices.len()), (7, 2));
    }
}
