//! Health messages: five times a second, and on change.

use super::{now_ns, proto, wire};
use nalgebra::UnitQuaternion;
use plumbline_config::options::VehicleConfig;
use plumbline_estimator::Estimate;
use plumbline_flight::local::SensorNews;
use plumbline_flight::schedule::ladder::Rung;
use std::time::{Duration, Instant};

/// How much of a new frame rate enters the smoothed one.
const SMOOTHING: f64 = 0.1;

/// What a health message reports beside the estimate.
#[derive(Clone, Debug)]
pub struct Circumstances {
    /// Messages dropped because the network was slower than the vehicle.
    pub dropped: u64,
    /// Step of the degradation ladder.
    pub rung: Rung,
    /// Keyframes of the map so far.
    pub keyframes: u64,
    /// Whether camera images are offered.
    pub offers_camera: bool,
    /// Takes coordinates from the IMU `B` to the vehicle `V` (x forward, y left, z up), where the mounting is known.
    pub rot_v_b: Option<UnitQuaternion<f64>>,
    /// State of live sensors.
    pub sensors: SensorNews,
}

/// What is wrong beyond the health bits, and what to do.
fn notices(is_mounted: bool, sensors: &SensorNews) -> Vec<String> {
    let mounting = (!is_mounted).then(|| format!("mounting unknown: {}", VehicleConfig::CURE));
    mounting.into_iter().chain(sensors.notices.iter().cloned()).collect()
}

/// State from which health messages are made.
#[derive(Debug)]
pub struct HealthFeed {
    period: Duration,
    last: Option<proto::Health>,
    sent: Instant,
    sequence: u64,
    frame_rate_hz: f64,
    last_stamp_ns: i64,
}

impl HealthFeed {
    /// A message every `period` at least.
    #[must_use]
    pub fn new(period: Duration) -> Self {
        let sent = Instant::now();
        Self { period, last: None, sent, sequence: 0, frame_rate_hz: 0.0, last_stamp_ns: 0 }
    }

    /// The message to send after this estimate, if one is due: on change, or after the period.
    pub fn update(&mut self, e: &Estimate, frame_ms: f64, around: &Circumstances) -> Option<proto::Health> {
        let stamp_ns = e.stamp.as_nanos();
        let period_s = (stamp_ns - self.last_stamp_ns) as f64 * 1e-9;
        if self.last_stamp_ns != 0 && period_s > 0.0 {
            self.frame_rate_hz += SMOOTHING * (1.0 / period_s - self.frame_rate_hz);
        }
        self.last_stamp_ns = stamp_ns;
        let (state, rung) = (i32::from(wire::state_of(e.state)), u32::from(around.rung.level()));
        let is_same = |l: &proto::Health| (l.bits, l.state, l.rung) == (e.health.0, state, rung);
        if self.last.as_ref().is_some_and(is_same) && self.sent.elapsed() < self.period {
            return None;
        }
        let message = proto::Health {
            header: Some(proto::Header {
                stamp_ns,
                published_ns: now_ns(),
                sequence: self.sequence,
                reset_counter: e.reset_counter,
                quality: i32::from(e.quality),
            }),
            state,
            bits: e.health.0,
            words: wire::health_words(e.health.0),
            frame_rate_hz: self.frame_rate_hz,
            frame_ms,
            dropped: around.dropped,
            rung,
            rung_words: around.rung.name().into(),
            keyframes: around.keyframes,
            offers_camera: around.offers_camera,
            rotation_v_b: around.rot_v_b.as_ref().map(wire::quaternion),
            notices: notices(around.rot_v_b.is_some(), &around.sensors),
            frames_restamped: around.sensors.frames.restamped,
            frames_refused: around.sensors.frames.refused,
            samples_refused: around.sensors.samples.refused,
        };
        Some(self.sending(message))
    }

    /// The message to send while no estimate comes, once a period: the last one with the present state of the sensors. Its time
    /// of measurement stays, so a station tells a silent estimator from a bad link.
    pub fn renew(&mut self, sensors: &SensorNews) -> Option<proto::Health> {
        let last = self.last.as_ref().filter(|_| self.sent.elapsed() >= self.period)?;
        let mut message = last.clone();
        message.notices = notices(last.rotation_v_b.is_some(), sensors);
        message.frames_restamped = sensors.frames.restamped;
        message.frames_refused = sensors.frames.refused;
        message.samples_refused = sensors.samples.refused;
        if let Some(header) = &mut message.header {
            (header.sequence, header.published_ns) = (self.sequence, now_ns());
        }
        Some(self.sending(message))
    }

    fn sending(&mut self, message: proto::Health) -> proto::Health {
        self.sequence += 1;
        self.sent = Instant::now();
        self.last = Some(message.clone());
        message
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Isometry3, SVector, Vector3};
    use plumbline_config::Timestamp;
    use plumbline_drivers::clock::StampFigures;
    use plumbline_estimator::{FrameFigures, HealthBits, NavCovariance, OriginUncertainty, TrackingState};

    fn estimate() -> Estimate {
        Estimate {
            frame_sequence: 1,
            stamp: Timestamp::from_nanos(50_000_000),
            state: TrackingState::Tracking,
            pose_o_b: Isometry3::identity(),
            v_o_b: Vector3::zeros(),
            bias_gyro: Vector3::zeros(),
            bias_accel: Vector3::zeros(),
            covariance: NavCovariance::identity(),
            origin: OriginUncertainty::default(),
            bias_variances: SVector::zeros(),
            time_offset_s: 0.0,
            time_offset_sigma_s: 1e-3,
            pose_b_c0: Isometry3::identity(),
            quality: 90,
            health: HealthBits::default(),
            reset_counter: 0,
            figures: FrameFigures::default(),
        }
    }

    #[test]
    fn an_unknown_mounting_and_bad_stamps_are_told_also_while_no_estimate_comes() {
        let mut feed = HealthFeed::new(Duration::ZERO);
        let around = Circumstances {
            dropped: 0,
            rung: Rung::Full,
            keyframes: 0,
            offers_camera: false,
            rot_v_b: None,
            sensors: SensorNews::default(),
        };
        assert_eq!(feed.renew(&around.sensors), None, "nothing was sent yet");
        let first = feed.update(&estimate(), 1.0, &around).unwrap();
        assert!(first.rotation_v_b.is_none() && first.notices[0].starts_with("mounting unknown: set it"));
        let again = feed.renew(&around.sensors).unwrap();
        let (before, now) = (first.header.unwrap(), again.header.unwrap());
        assert_eq!((now.stamp_ns, now.sequence), (before.stamp_ns, before.sequence + 1), "it goes on");
        assert_eq!(HealthFeed { period: Duration::from_secs(9), ..feed }.renew(&around.sensors), None);
        let mut feed = HealthFeed::new(Duration::ZERO);
        let first = feed.update(&estimate(), 1.0, &around).unwrap();
        let frames = StampFigures { refused: 7, ..StampFigures::default() };
        let news = SensorNews { notices: vec!["stamps repeat".into()], frames, ..SensorNews::default() };
        let renewed = feed.renew(&news).unwrap();
        assert_eq!((renewed.frames_refused, renewed.notices.len()), (7, 2));
        assert_eq!(renewed.header.unwrap().sequence, first.header.unwrap().sequence + 1);
    }
}
