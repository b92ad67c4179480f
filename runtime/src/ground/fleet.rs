//! What has been heard of all vehicles, in bounded memory.

use super::vehicle::{Picture, Vehicle};
use crate::net::{proto, read};
use nalgebra::Vector3;
use serde::Serialize;
use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;
use std::time::Instant;

/// Vehicles that are followed; more are counted, not kept.
pub const MAX_VEHICLES: usize = 64;
/// Longest name of a vehicle, bytes.
pub const MAX_NAME: usize = 64;
/// Events that are kept.
const MAX_EVENTS: usize = 200;

/// How much an event matters.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Severity {
    /// Good to know.
    Info,
    /// Look.
    Warning,
    /// Act.
    Error,
}

/// Something that happened.
#[derive(Clone, Debug, Serialize)]
pub struct FleetEvent {
    /// To whom; nobody in particular without.
    pub vehicle: Option<String>,
    /// How much it matters.
    pub severity: Severity,
    /// When, since the station started, s.
    pub time_s: f64,
    /// What.
    pub text: String,
}

/// A point of the path that a vehicle remembers.
#[derive(Clone, Copy, Debug)]
pub struct PastPoint {
    /// Measurement time, ns.
    pub stamp_ns: i64,
    /// Position of the body in the odometry frame of this count of resets.
    pub p_o: Vector3<f64>,
    /// Resets so far.
    pub reset_counter: u32,
}

/// All vehicles, by name.
#[derive(Clone, Debug)]
pub struct Fleet {
    /// The vehicles.
    pub vehicles: BTreeMap<String, Vehicle>,
    /// Messages that could not be understood.
    pub malformed: u64,
    /// Messages of vehicles beyond the limit, or with impossible names.
    pub refused: u64,
    /// When the station started.
    pub start: Instant,
    events: VecDeque<FleetEvent>,
    /// Events ever told.
    pub told: u64,
}

impl Default for Fleet {
    fn default() -> Self {
        Self {
            vehicles: BTreeMap::new(),
            malformed: 0,
            refused: 0,
            start: Instant::now(),
            events: VecDeque::new(),
            told: 0,
        }
    }
}

impl Fleet {
    fn vehicle(&mut self, name: &str) -> Option<&mut Vehicle> {
        let is_known = self.vehicles.contains_key(name);
        if !is_known && (self.vehicles.len() >= MAX_VEHICLES || name.len() > MAX_NAME) {
            self.refused += 1;
            return None;
        }
        Some(self.vehicles.entry(name.to_owned()).or_default())
    }

    /// A liveliness token appeared or went.
    pub fn alive(&mut self, name: &str, is_alive: bool) {
        let Some(vehicle) = self.vehicle(name) else { return };
        let was_alive = std::mem::replace(&mut vehicle.is_alive, is_alive);
        if is_alive && !was_alive {
            vehicle.appear();
            self.announce(Some(name), Severity::Info, "on the network".into());
        } else if was_alive && !is_alive {
            self.announce(Some(name), Severity::Error, "has left the network".into());
        }
    }

    /// A payload that could not be understood.
    pub fn malformed(&mut self) {
        self.malformed += 1;
    }

    /// Odometry came, `now_ns` by this host's clock.
    pub fn odom(&mut self, name: &str, message: &proto::Odom, bytes: usize, now: Instant, now_ns: i64) {
        self.watched(name, now, |vehicle| vehicle.take_odom(message, bytes, now, now_ns));
    }

    /// An estimate came.
    pub fn state(&mut self, name: &str, message: &proto::State, bytes: usize, now: Instant) {
        self.watched(name, now, |vehicle| vehicle.take_state(message, bytes, now));
    }

    /// Health came.
    pub fn health(&mut self, name: &str, message: &proto::Health, bytes: usize, now: Instant) {
        self.watched(name, now, |vehicle| vehicle.take_health(message, bytes, now));
    }

    /// A keyframe came, by itself or as an answer.
    pub fn keyframe(&mut self, name: &str, message: &proto::Keyframe) {
        if let Some(vehicle) = self.vehicle(name) {
            vehicle.map.take(message);
        }
    }

    /// A correction of the map came.
    pub fn correction(&mut self, name: &str, message: &proto::MapCorrection) {
        if let Some(vehicle) = self.vehicle(name) {
            vehicle.pose_m_o = message.pose_m_o.as_ref().and_then(read::isometry);
        }
    }

    /// What is in the window came.
    pub fn scene(&mut self, name: &str, message: &proto::Scene) {
        if let Some(vehicle) = self.vehicle(name) {
            vehicle.map.take_scene(message);
        }
    }

    /// A picture came.
    pub fn picture(&mut self, name: &str, message: proto::Picture) {
        if let Some(vehicle) = self.vehicle(name) {
            let version = vehicle.picture.as_ref().map_or(0, |picture| picture.version) + 1;
            vehicle.picture = Some(Picture { message: Arc::new(message), version });
        }
    }

    /// What a vehicle remembers of its path came, in order of time. Of use is what was since its last reset.
    pub fn past(&mut self, name: &str, past: &[PastPoint]) {
        if let Some(vehicle) = self.vehicle(name) {
            let same = past.iter().filter(|point| point.reset_counter == vehicle.resets);
            let path: Vec<_> = same.map(|point| (point.stamp_ns, point.p_o)).collect();
            vehicle.track.fill(&path);
        }
    }

    /// Lets a vehicle change, and tells what people would want to know of the change.
    fn watched(&mut self, name: &str, now: Instant, change: impl FnOnce(&mut Vehicle)) {
        let Some(vehicle) = self.vehicle(name) else { return };
        let before = (vehicle.resets, vehicle.rung.clone());
        change(vehicle);
        let after = (vehicle.resets, vehicle.rung.clone());
        let words = vehicle.state_words;
        if vehicle.state_news.is_due(words, now) {
            let severity = match words {
                "tracking" | "initialising" => Severity::Info,
                "blind" => Severity::Warning,
                _ => Severity::Error,
            };
            self.announce(Some(name), severity, words.to_owned());
        }
        if before.0 != after.0 {
            self.announce(Some(name), Severity::Warning, format!("reset: the counter is {} now", after.0));
        }
        if let (Some(old), Some(new)) = (before.1, after.1)
            && old != new
        {
            self.announce(Some(name), Severity::Warning, format!("works with: {new}"));
        }
    }

    /// Tells an event.
    pub fn announce(&mut self, vehicle: Option<&str>, severity: Severity, text: String) {
        if self.events.len() == MAX_EVENTS {
            self.events.pop_front();
        }
        let time_s = self.start.elapsed().as_secs_f64();
        self.events.push_back(FleetEvent { vehicle: vehicle.map(str::to_owned), severity, time_s, text });
        self.told += 1;
    }

    /// Events from number `from` on.
    pub fn events_since(&self, from: u64) -> impl Iterator<Item = &FleetEvent> {
        let first = self.told - self.events.len() as u64;
        let skip = usize::try_from(from.saturating_sub(first)).unwrap_or(usize::MAX);
        self.events.iter().skip(skip)
    }

    /// A line for each vehicle.
    #[must_use]
    pub fn lines(&self, now: Instant) -> Vec<String> {
        self.vehicles.iter().map(|(name, vehicle)| vehicle.line(name, now)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::super::channel::STALE_AFTER;
    use super::super::vehicle::LOST_AFTER;
    use super::*;
    use crate::net::wire;
    use nalgebra::Isometry3;

    fn odom(sequence: u64, x: f64, reset_counter: u32) -> proto::Odom {
        proto::Odom {
            header: Some(proto::Header {
                sequence,
                quality: 80,
                reset_counter,
                stamp_ns: sequence as i64 * 5_000_000,
                ..proto::Header::default()
            }),
            state: proto::TrackingState::Tracking.into(),
            pose: wire::pose(&Isometry3::translation(x, 0.0, 0.0)),
            velocity_o_b: Some(proto::Vector3::default()),
            ..proto::Odom::default()
        }
    }

    fn texts(fleet: &Fleet) -> Vec<&str> {
        fleet.events_since(0).map(|event| event.text.as_str()).collect()
    }

    #[test]
    fn presence_follows_token_and_data() {
        let (mut fleet, now) = (Fleet::default(), Instant::now());
        fleet.alive("a", true);
        assert_eq!(fleet.vehicles["a"].presence(now), "unknown");
        fleet.odom("a", &odom(0, 0.0, 0), 100, now, 0);
        let vehicle = &fleet.vehicles["a"];
        assert_eq!(vehicle.presence(now), "tracking");
        assert_eq!(vehicle.presence(now + STALE_AFTER * 2), "stale");
        assert_eq!(vehicle.presence(now + LOST_AFTER * 2), "lost");
        fleet.alive("a", false);
        assert_eq!(fleet.vehicles["a"].presence(now), "lost");
        assert_eq!(texts(&fleet), ["on the network", "tracking", "has left the network"]);
    }

    #[test]
    fn a_reset_is_told_and_a_jump_begins_a_new_path() {
        let (mut fleet, now) = (Fleet::default(), Instant::now());
        for k in 0..100 {
            fleet.odom("a", &odom(k, k as f64 * 0.1, 0), 100, now, 0);
        }
        assert!(fleet.vehicles["a"].track.len() > 50);
        fleet.odom("a", &odom(100, 0.0, 1), 100, now, 0);
        assert_eq!(fleet.vehicles["a"].track.len(), 1);
        assert!(texts(&fleet).contains(&"reset: the counter is 1 now"));
    }

    #[test]
    fn a_partition_leaves_the_path_whole() {
        let (mut fleet, now) = (Fleet::default(), Instant::now());
        fleet.alive("a", true);
        fleet.odom("a", &odom(0, 0.0, 0), 100, now, 0);
        fleet.alive("a", false);
        fleet.alive("a", true);
        fleet.odom("a", &odom(4_000, 30.0, 0), 100, now, 0);
        assert_eq!(fleet.vehicles["a"].track.len(), 2);
        assert_eq!(fleet.vehicles["a"].odom.lost, 0);
        let past = |k: i64, reset_counter| PastPoint {
            stamp_ns: k * 1_000_000_000,
            p_o: Vector3::new(k as f64, 0.0, 0.0),
            reset_counter,
        };
        fleet.past("a", &(0..10).map(|k| past(k, 1)).chain((10..20).map(|k| past(k, 0))).collect::<Vec<_>>());
        assert_eq!(fleet.vehicles["a"].track.len(), 12);
    }

    #[test]
    fn a_vehicle_that_started_anew_begins_a_new_path() {
        let (mut fleet, now) = (Fleet::default(), Instant::now());
        fleet.odom("a", &odom(4_000, 30.0, 0), 100, now, 0);
        let mut message = odom(0, 0.0, 0);
        message.header.as_mut().unwrap().stamp_ns = 60_000_000_000;
        fleet.odom("a", &message, 100, now, 0);
        assert_eq!(fleet.vehicles["a"].track.len(), 1);
    }

    #[test]
    fn vehicles_beyond_the_limit_are_refused_and_counted() {
        let mut fleet = Fleet::default();
        (0..MAX_VEHICLES + 3).for_each(|k| fleet.alive(&format!("v{k}"), true));
        fleet.alive(&"x".repeat(MAX_NAME + 1), true);
        assert_eq!((fleet.vehicles.len(), fleet.refused), (MAX_VEHICLES, 4));
        assert!(fleet.events_since(0).count() <= MAX_EVENTS);
    }

    #[test]
    fn a_recording_holds_what_came_while_it_went_on() {
        let (mut fleet, now) = (Fleet::default(), Instant::now());
        for k in 0..30 {
            if let Some(vehicle) = fleet.vehicles.get_mut("a") {
                vehicle.set_recording((10..20).contains(&k));
            }
            fleet.odom("a", &odom(k, 0.0, 0), 100, now, 0);
        }
        let vehicle = &fleet.vehicles["a"];
        assert!(!vehicle.is_recording);
        assert_eq!(vehicle.recording.as_ref().unwrap().len(), 10);
    }

    #[test]
    fn latency_is_brought_to_one_clock() {
        let (mut fleet, now) = (Fleet::default(), Instant::now());
        fleet.alive("a", true);
        let ahead_ns = 3_600_000_000_000;
        fleet.vehicles.get_mut("a").unwrap().clock.take(super::super::clock::Exchange {
            asked_ns: 0,
            received_ns: ahead_ns + 100,
            answered_ns: ahead_ns + 100,
            came_ns: 200,
        });
        let mut message = odom(0, 0.0, 0);
        message.header.as_mut().unwrap().published_ns = ahead_ns + 1_000_000;
        fleet.odom("a", &message, 100, now, 3_000_000);
        assert!((fleet.vehicles["a"].latency_ms.unwrap() - 2.0).abs() < 1e-9);
    }
}
