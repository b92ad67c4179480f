//! What has been heard of every vehicle, in bounded memory.

use crate::net::{proto, wire};
use nalgebra::{Isometry3, Vector3};
use std::collections::BTreeMap;
use std::time::{Duration, Instant};

/// Vehicles that are followed; more are counted, not kept.
pub const MAX_VEHICLES: usize = 64;
/// Data older than this are shown as stale.
pub const STALE_AFTER: Duration = Duration::from_millis(500);
/// Rates are measured over this time.
const RATE_WINDOW: Duration = Duration::from_secs(1);

/// Counts the messages of one key.
#[derive(Clone, Debug, Default)]
pub struct Channel {
    /// Messages received.
    pub received: u64,
    /// Messages missing by their sequence numbers.
    pub lost: u64,
    /// Messages a second.
    pub rate_hz: f64,
    next_sequence: Option<u64>,
    last: Option<Instant>,
    window: Option<(Instant, u64)>,
}

impl Channel {
    fn heard(&mut self, sequence: u64, now: Instant) {
        self.received += 1;
        if let Some(expected) = self.next_sequence {
            self.lost += sequence.saturating_sub(expected);
        }
        self.next_sequence = Some(sequence.saturating_add(1));
        self.last = Some(now);
        let (since, count) = *self.window.get_or_insert((now, self.received));
        let elapsed = now.duration_since(since);
        if elapsed >= RATE_WINDOW {
            self.rate_hz = (self.received - count) as f64 / elapsed.as_secs_f64();
            self.window = Some((now, self.received));
        }
    }

    /// Whether nothing has come for a while.
    #[must_use]
    pub fn is_stale(&self, now: Instant) -> bool {
        self.last.is_none_or(|last| now.duration_since(last) > STALE_AFTER)
    }
}

/// One vehicle.
#[derive(Clone, Debug, Default)]
pub struct Vehicle {
    /// Its liveliness token is there.
    pub is_alive: bool,
    /// Odometry.
    pub odom: Channel,
    /// Estimates.
    pub state: Channel,
    /// Newest pose of the body in the odometry frame.
    pub pose_o_b: Option<Isometry3<f64>>,
    /// Newest velocity, m/s.
    pub v_o_b: Vector3<f64>,
    /// Largest standard deviation of the position, m.
    pub sigma_m: f64,
    /// -1 failed, else 0 to 100.
    pub quality: i32,
    /// State in words.
    pub state_words: &'static str,
    /// Resets.
    pub resets: u32,
    /// Health in words.
    pub health: Vec<String>,
    /// Computation of a frame, ms.
    pub frame_ms: f64,
    /// Frames a second.
    pub frame_rate_hz: f64,
    /// Messages that the vehicle dropped.
    pub dropped: u64,
    /// From publication to reception by the clocks of both hosts, ms; smoothed.
    pub latency_ms: Option<f64>,
}

/// All vehicles, by name.
#[derive(Clone, Debug, Default)]
pub struct Fleet {
    /// The vehicles.
    pub vehicles: BTreeMap<String, Vehicle>,
    /// Messages that could not be understood.
    pub malformed: u64,
    /// Messages of vehicles beyond the limit.
    pub refused: u64,
}

impl Fleet {
    fn vehicle(&mut self, name: &str) -> Option<&mut Vehicle> {
        if !self.vehicles.contains_key(name) && self.vehicles.len() >= MAX_VEHICLES {
            self.refused += 1;
            return None;
        }
        Some(self.vehicles.entry(name.to_owned()).or_default())
    }

    /// A liveliness token appeared or went.
    pub fn alive(&mut self, name: &str, is_alive: bool) {
        if let Some(vehicle) = self.vehicle(name) {
            vehicle.is_alive = is_alive;
        }
    }

    /// A payload that could not be understood.
    pub fn malformed(&mut self) {
        self.malformed += 1;
    }

    /// Odometry came, `now_ns` by this host's clock.
    pub fn odom(&mut self, name: &str, message: &proto::Odom, now: Instant, now_ns: i64) {
        let (Some(header), Some(vehicle)) = (&message.header, self.vehicle(name)) else { return };
        vehicle.odom.heard(header.sequence, now);
        vehicle.take_header(header, message.state);
        vehicle.pose_o_b = message.pose.as_ref().and_then(wire::isometry);
        if let Some(v) = &message.velocity_o_b {
            vehicle.v_o_b = Vector3::new(v.x, v.y, v.z);
        }
        vehicle.sigma_m = message.sigmas.iter().take(3).copied().fold(0.0, f64::max);
        let latency_ms = now_ns.saturating_sub(header.published_ns) as f64 * 1e-6;
        let smoothed = vehicle.latency_ms.map_or(latency_ms, |old| old + 0.05 * (latency_ms - old));
        vehicle.latency_ms = Some(smoothed);
    }

    /// An estimate came.
    pub fn state(&mut self, name: &str, message: &proto::State, now: Instant) {
        let (Some(header), Some(vehicle)) = (&message.header, self.vehicle(name)) else { return };
        vehicle.state.heard(header.sequence, now);
        vehicle.take_header(header, message.state);
        vehicle.health = wire::health_words(message.health_bits);
    }

    /// Health came.
    pub fn health(&mut self, name: &str, message: &proto::Health) {
        let (Some(header), Some(vehicle)) = (&message.header, self.vehicle(name)) else { return };
        vehicle.take_header(header, message.state);
        vehicle.health = wire::health_words(message.bits);
        vehicle.frame_ms = message.frame_ms;
        vehicle.frame_rate_hz = message.frame_rate_hz;
        vehicle.dropped = message.dropped;
    }

    /// A line for each vehicle.
    #[must_use]
    pub fn lines(&self, now: Instant) -> Vec<String> {
        self.vehicles.iter().map(|(name, vehicle)| vehicle.line(name, now)).collect()
    }
}

impl Vehicle {
    fn take_header(&mut self, header: &proto::Header, state: i32) {
        self.quality = header.quality.clamp(-1, 100);
        self.resets = header.reset_counter;
        self.state_words = wire::state_words(state);
    }

    /// What can be said of its presence.
    #[must_use]
    pub fn presence(&self, now: Instant) -> &'static str {
        match (self.is_alive, self.odom.is_stale(now) && self.state.is_stale(now)) {
            (false, _) => "LOST",
            (true, true) => "STALE",
            (true, false) => self.state_words,
        }
    }

    /// Roll, pitch and yaw, degrees.
    #[must_use]
    pub fn attitude_deg(&self) -> Option<(f64, f64, f64)> {
        let (roll, pitch, yaw) = self.pose_o_b?.rotation.euler_angles();
        Some((roll.to_degrees(), pitch.to_degrees(), yaw.to_degrees()))
    }

    fn line(&self, name: &str, now: Instant) -> String {
        let p = self.pose_o_b.map_or_else(Vector3::zeros, |pose| pose.translation.vector);
        let health = if self.health.is_empty() { "healthy".into() } else { self.health.join(", ") };
        format!(
            "{name}: {} quality {} position {:.3} {:.3} {:.3} m (sigma {:.3}) speed {:.2} m/s, odom {:.0} Hz, \
             state {:.0} Hz, latency {:.2} ms, lost {}, {health}",
            self.presence(now),
            self.quality,
            p.x,
            p.y,
            p.z,
            self.sigma_m,
            self.v_o_b.norm(),
            self.odom.rate_hz,
            self.state.rate_hz,
            self.latency_ms.unwrap_or(f64::NAN),
            self.odom.lost + self.state.lost
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn odom(sequence: u64) -> proto::Odom {
        proto::Odom {
            header: Some(proto::Header { sequence, quality: 90, ..proto::Header::default() }),
            state: proto::TrackingState::Tracking.into(),
            ..proto::Odom::default()
        }
    }

    #[test]
    fn gaps_in_the_sequence_are_losses_and_silence_is_stale() {
        let mut fleet = Fleet::default();
        let now = Instant::now();
        fleet.alive("a", true);
        for sequence in [0, 1, 5] {
            fleet.odom("a", &odom(sequence), now, 0);
        }
        let vehicle = &fleet.vehicles["a"];
        assert_eq!((vehicle.odom.received, vehicle.odom.lost), (3, 3));
        assert_eq!(vehicle.presence(now), "tracking");
        assert_eq!(vehicle.presence(now + Duration::from_secs(1)), "STALE");
        fleet.alive("a", false);
        assert_eq!(fleet.vehicles["a"].presence(now), "LOST");
    }

    #[test]
    fn a_flood_of_names_is_bounded() {
        let mut fleet = Fleet::default();
        (0..1000).for_each(|k| fleet.alive(&format!("v{k}"), true));
        assert_eq!(fleet.vehicles.len(), MAX_VEHICLES);
        assert_eq!(fleet.refused, 1000 - MAX_VEHICLES as u64);
    }
}
