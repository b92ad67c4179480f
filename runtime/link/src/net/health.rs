//! Health messages: five times a second, and on change.

use plumbline_config::options::VehicleConfig;
use plumbline_estimator::{Estimate, HealthBits, TrackingState};
use plumbline_record::messages::{Envelope, Health};
use std::time::{Duration, Instant};

/// Weight of a new frame rate in the smoothed one.
const SMOOTHING: f64 = 0.1;

/// State from which health messages are made.
#[derive(Debug)]
pub struct HealthFeed {
    period: Duration,
    /// State of the flight: of its newest estimate, and what is known beside it.
    pub health: Health,
    /// Envelope of the newest estimate, without its message. Its time of measurement stays while no estimate comes, so a station
    /// tells a silent estimator from a bad link.
    envelope: Envelope,
    sent: Instant,
    told: (HealthBits, TrackingState, u32),
    last_stamp_ns: i64,
}

impl HealthFeed {
    /// A message every `period` at least, also before the first estimate.
    pub fn new(period: Duration, health: Health) -> Self {
        let (envelope, told) = (Envelope::default(), Self::told(&health));
        Self { period, health, envelope, sent: Instant::now(), told, last_stamp_ns: 0 }
    }

    /// Changes of this are sent at once.
    fn told(health: &Health) -> (HealthBits, TrackingState, u32) {
        (health.bits, health.state, health.ladder.level)
    }

    /// Takes an estimate; the message to send after it, if one is due: on change, or after the period.
    pub fn update(&mut self, e: &Estimate) -> Option<(Envelope, Health)> {
        let stamp_ns = e.stamp.as_nanos();
        let period_s = (stamp_ns - self.last_stamp_ns) as f64 * 1e-9;
        if self.last_stamp_ns != 0 && period_s > 0.0 {
            self.health.frame_rate_hz += SMOOTHING * (1.0 / period_s - self.health.frame_rate_hz);
        }
        self.last_stamp_ns = stamp_ns;
        (self.health.state, self.health.bits) = (e.state, e.health);
        self.envelope = Envelope::around(e, Vec::new(), 0, 0);
        if Self::told(&self.health) == self.told { self.renew() } else { Some(self.message()) }
    }

    /// The message to send while no estimate comes, once a period.
    pub fn renew(&mut self) -> Option<(Envelope, Health)> {
        (self.sent.elapsed() >= self.period).then(|| self.message())
    }

    fn message(&mut self) -> (Envelope, Health) {
        (self.sent, self.told) = (Instant::now(), Self::told(&self.health));
        let mut health = self.health.clone();
        if health.rot_v_b.is_none() {
            // Before what is wrong with the sensors.
            health.sensors.notices.insert(0, format!("mounting unknown: {}", VehicleConfig::CURE));
        }
        (self.envelope.clone(), health)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use plumbline_config::Timestamp;
    use plumbline_record::fields::StampFigures;

    fn estimate() -> Estimate {
        let stamp = Timestamp::from_nanos(50_000_000);
        Estimate { stamp, state: TrackingState::Tracking, quality: 90, ..Estimate::default() }
    }

    #[test]
    fn health_is_sent_before_the_first_estimate_and_while_none_comes() {
        let mut feed = HealthFeed::new(Duration::ZERO, Health::default());
        feed.health.sensors.notices = vec!["no frames".into()];
        let (envelope, first) = feed.renew().unwrap();
        assert_eq!((envelope, first.state), (Envelope::default(), TrackingState::default()));
        assert!(first.sensors.notices[0].starts_with("mounting unknown: set it"));
        assert_eq!(first.sensors.notices[1..], ["no frames"]);
        assert_eq!(feed.renew().unwrap().1.sensors.notices, first.sensors.notices, "it is told once");
        let mounted = Health { rot_v_b: Some(Default::default()), ..Health::default() };
        assert!(HealthFeed::new(Duration::ZERO, mounted).renew().unwrap().1.sensors.notices.is_empty());
        let (before, tracking) = feed.update(&estimate()).unwrap();
        assert_eq!(tracking.state, TrackingState::Tracking);
        feed.health.sensors.frames = StampFigures { refused: 7, ..StampFigures::default() };
        feed.health.paths = 3;
        let (now, again) = feed.renew().unwrap();
        assert_eq!((now, again.paths, again.sensors.frames.refused), (before, 3, 7), "it goes on");
    }

    #[test]
    fn a_change_is_sent_at_once_and_the_rest_after_the_period() {
        let mut feed = HealthFeed::new(Duration::from_secs(9), Health::default());
        assert!(feed.renew().is_none());
        assert!(feed.update(&estimate()).is_some() && feed.update(&estimate()).is_none());
        feed.health.ladder.level = 1;
        assert!(feed.update(&estimate()).is_some() && feed.renew().is_none());
    }
}
