//! The state of one vehicle at the ground station.

mod motion;
mod shown;

use super::channel::{Channel, Delays, SequencePlace};
use super::clock::ClockEstimate;
use super::corrected::Corrected;
use super::history::History;
use super::map::Map;
use super::news::StateNews;
use super::track::{MAX_POSES, PoseSample, Track};
use motion::Motion;
use nalgebra::{Isometry3, Vector3};
use plumbline_estimator::{Estimate, HealthBits, Odometry, TrackingState};
use plumbline_link::net::plain;
use plumbline_link::net::read::Heard;
use plumbline_record::messages::{Envelope, Health, PastPose, Picture as Shown};
use plumbline_record::said::FullEstimate;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// A vehicle without a message for so long is lost, even while its liveliness token is there.
pub const LOST_AFTER: Duration = Duration::from_millis(1_500);

/// A camera image as it was received.
#[derive(Clone, Debug)]
pub struct ReceivedPicture {
    /// The message.
    pub message: Arc<Heard<Shown>>,
    /// Counts images.
    pub version: u64,
}

/// Name of a tracking state.
pub const fn state_words(state: TrackingState) -> &'static str {
    match state {
        TrackingState::Initialising => "initialising",
        TrackingState::Tracking => "tracking",
        TrackingState::Blind => "blind",
        TrackingState::Failed => "failed",
    }
}

/// One vehicle.
#[derive(Clone, Debug, Default)]
pub struct VehicleState {
    /// True while its liveliness token is there.
    pub is_alive: bool,
    /// Number of the vehicle in the order in which the station received them.
    pub arrival: u64,
    /// Counts appearances on the network: after each, its past is queried.
    pub appeared: u64,
    /// Odometry.
    pub odom: Channel,
    /// Estimates.
    pub state: Channel,
    /// Health.
    pub health: Channel,
    /// Delays of odometry.
    pub delays: Delays,
    /// Measurement time of the newest message, ns.
    pub stamp_ns: i64,
    /// Newest pose of the body in the odometry frame; `None` while there is no valid estimate, whose pose says nothing.
    pub pose_o_b: Option<Isometry3<f64>>,
    /// Place of the odometry in the map, and the corrected path.
    pub corrected: Corrected,
    /// Newest velocity in O, m/s.
    pub v_o_b: Vector3<f64>,
    /// Newest angular rate in B, rad/s.
    pub rate_b: Vector3<f64>,
    /// Standard deviations of position (m), attitude (rad), velocity (m/s).
    pub sigmas: [f64; 9],
    /// Newest estimate.
    pub estimate: Option<Estimate>,
    /// Newest health message, its texts made plain.
    pub news: Health,
    /// 0 to 100; -1 while there is no valid estimate.
    pub quality: i32,
    /// Tracking state, once it was received.
    pub tracking: Option<TrackingState>,
    /// Changes of the state that were reported.
    pub state_news: StateNews,
    /// Resets.
    pub resets: u32,
    /// Health bits, of whatever came last.
    pub bits: HealthBits,
    /// Delay from publication to reception, corrected for the clock offset, ms; smoothed.
    pub latency_ms: Option<f64>,
    /// Offset of its clock against this host's.
    pub clock: ClockEstimate,
    /// Path.
    pub track: Track,
    /// It was reset, or restarted, since the newest valid pose.
    is_after_reset: bool,
    /// The newest valid pose.
    last_motion: Option<Motion>,
    /// The count of resets at the start of the odometry frame is known.
    has_frame: bool,
    /// Poses.
    pub poses: History<PoseSample>,
    /// Map.
    pub map: Map,
    /// Newest picture.
    pub picture: Option<ReceivedPicture>,
}

impl VehicleState {
    /// One that nothing was heard of yet.
    pub fn arrived(arrival: u64) -> Self {
        Self { arrival, quality: -1, ..Self::default() }
    }

    /// Name of the tracking state.
    pub fn state_words(&self) -> &'static str {
        self.tracking.map_or("unknown", state_words)
    }

    /// Handles that it has appeared on the network: statistics start again, and its past can be queried.
    pub fn appear(&mut self) {
        self.appeared += 1;
        [&mut self.odom, &mut self.state, &mut self.health].into_iter().for_each(Channel::reappear);
        self.clock = ClockEstimate::default();
    }

    /// Applies odometry of `bytes`, received at `now_ns` by this host's clock.
    pub fn apply_odom(&mut self, heard: &Heard<Odometry>, bytes: usize, now: Instant, now_ns: i64) {
        let Heard { envelope, message } = heard;
        let place = self.odom.receive(envelope.sequence, envelope.published_ns, bytes, now);
        if place == SequencePlace::Late {
            return;
        }
        self.is_after_reset |= place == SequencePlace::Restarted;
        self.apply_envelope(envelope, message.state);
        let offset_ns = self.clock.offset_ns().unwrap_or(0);
        let delay_ns = now_ns.saturating_add(offset_ns).saturating_sub(envelope.published_ns);
        self.delays.record(delay_ns);
        let latency_ms = delay_ns as f64 * 1e-6;
        self.latency_ms = Some(self.latency_ms.map_or(latency_ms, |old| old + 0.05 * (latency_ms - old)));
        self.apply_motion(&message.pose_o_b, &message.v_o_b);
        self.rate_b = message.angular_rate_b;
        self.sigmas = std::array::from_fn(|k| message.covariance[(k, k)].max(0.0).sqrt());
    }

    /// Applies an estimate of `bytes`.
    pub fn apply_state(&mut self, heard: &Heard<FullEstimate>, bytes: usize, now: Instant) {
        let Heard { envelope, message: FullEstimate { estimate, .. } } = heard;
        let is_newest = envelope.stamp_ns >= self.stamp_ns || self.odom.is_stale(now);
        self.is_after_reset |= self.state.receive(envelope.sequence, envelope.published_ns, bytes, now)
            == SequencePlace::Restarted;
        if is_newest {
            self.apply_envelope(envelope, estimate.state);
            self.apply_motion(&estimate.pose_o_b, &estimate.v_o_b);
        }
        self.bits = estimate.health;
        self.estimate = Some(estimate.clone());
        if envelope.quality >= 0 {
            let sample = PoseSample { stamp_ns: envelope.stamp_ns, pose_o_b: estimate.pose_o_b };
            self.poses.push(sample, MAX_POSES);
        }
    }

    /// Applies a health message of `bytes`.
    pub fn apply_health(&mut self, heard: &Heard<Health>, bytes: usize, now: Instant) {
        let Heard { envelope, message } = heard;
        let place = self.health.receive(envelope.sequence, envelope.published_ns, bytes, now);
        if place == SequencePlace::Late {
            return;
        }
        // Odometry is newer than the frame of this message: taking both, the state would alternate.
        if self.odom.is_stale(now) {
            self.tracking = Some(message.state);
        }
        self.bits = message.bits;
        self.news = message.clone();
        let texts = self.news.sensors.notices.iter_mut().chain([&mut self.news.ladder.name]);
        texts.for_each(|text| *text = plain(text));
        self.map.announce(message.keyframes, envelope.published_ns, place == SequencePlace::Restarted);
        self.corrected.announce(message.paths);
    }

    fn apply_envelope(&mut self, envelope: &Envelope, state: TrackingState) {
        self.stamp_ns = envelope.stamp_ns;
        self.quality = i32::from(envelope.quality).clamp(-1, 100);
        self.is_after_reset |= envelope.reset_counter != self.resets;
        self.resets = envelope.reset_counter;
        if !std::mem::replace(&mut self.has_frame, true) {
            self.map.start_frame(self.resets);
        }
        self.tracking = Some(state);
    }

    fn apply_motion(&mut self, pose: &Isometry3<f64>, velocity: &Vector3<f64>) {
        self.v_o_b = *velocity;
        self.pose_o_b = (self.quality >= 0).then_some(*pose);
        if self.quality < 0 {
            return;
        }
        let now = Motion { stamp_ns: self.stamp_ns, pose_o_b: *pose, speed_m_s: self.v_o_b.norm() };
        let last = self.last_motion.replace(now);
        // A jump without a reset is the distance flown during an interruption of the link.
        let is_after_reset = std::mem::take(&mut self.is_after_reset);
        if is_after_reset && last.is_some_and(|last| now.is_in_another_frame(&last)) {
            self.track.clear();
            self.map.start_frame(self.resets);
        }
        self.track.push(self.stamp_ns, &pose.translation.vector);
    }

    /// Applies the trajectory that it keeps, in order of time; only points since its last reset are used.
    pub fn fill(&mut self, past: &[PastPose]) {
        let same = past.iter().filter(|past| past.reset_counter == self.resets);
        let place = |past: &PastPose| (past.stamp.as_nanos(), past.pose_o_b.translation.vector);
        let path: Vec<_> = same.map(place).collect();
        self.track.fill(&path);
    }

    /// Applies a camera image.
    pub fn show(&mut self, message: Heard<Shown>) {
        let version = self.picture.as_ref().map_or(0, |picture| picture.version) + 1;
        self.picture = Some(ReceivedPicture { message: Arc::new(message), version });
    }
}
