//! Health messages: five times a second, and on change.

use super::{now_ns, proto, wire};
use nalgebra::UnitQuaternion;
use plumbline_estimator::Estimate;
use plumbline_flight::schedule::ladder::Rung;
use std::time::{Duration, Instant};

/// How much of a new frame rate enters the smoothed one.
const SMOOTHING: f64 = 0.1;

/// What a health message reports beside the estimate.
#[derive(Clone, Copy, Debug)]
pub struct Circumstances {
    /// Messages dropped because the network was slower than the vehicle.
    pub dropped: u64,
    /// Step of the degradation ladder.
    pub rung: Rung,
    /// Keyframes of the map so far.
    pub keyframes: u64,
    /// Whether camera images are offered.
    pub offers_camera: bool,
    /// Takes coordinates from the IMU `B` to the vehicle `V` (x forward, y left, z up).
    pub rot_v_b: UnitQuaternion<f64>,
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
            rotation_v_b: Some(wire::quaternion(&around.rot_v_b)),
        };
        self.sequence += 1;
        self.sent = Instant::now();
        self.last = Some(message.clone());
        Some(message)
    }
}
