//! Data received from all vehicles, in bounded memory.

use super::history::History;
use super::vehicle::VehicleState;
use plumbline_estimator::Odometry;
use plumbline_link::net::read::Heard;
use plumbline_record::Severity;
use plumbline_record::messages::Health;
use plumbline_record::said::FullEstimate;
use serde::Serialize;
use std::collections::BTreeMap;
use std::time::Instant;

/// Largest number of vehicles kept. A new one evicts the vehicle with the fewest received messages.
pub const MAX_VEHICLES: usize = 64;
/// Longest name of a vehicle, bytes.
pub const MAX_NAME: usize = 64;
/// Events that are kept.
const MAX_EVENTS: usize = 200;

/// An entry of the list of events.
#[derive(Clone, Debug, Serialize)]
pub struct FleetEvent {
    /// Vehicle that it concerns; `None` for the station.
    pub vehicle: Option<String>,
    /// Severity.
    pub severity: Severity,
    /// Time since the station started, s.
    pub time_s: f64,
    /// Description for people.
    pub text: String,
}

/// All vehicles, by name.
#[derive(Clone, Debug)]
pub struct Fleet {
    /// The vehicles.
    pub vehicles: BTreeMap<String, VehicleState>,
    /// Messages that could not be decoded.
    pub malformed: u64,
    /// Messages of vehicles with impossible names.
    pub refused: u64,
    /// Description of how the station tries to reach its vehicles, in plain words; empty while nothing is
    /// known of it.
    pub network: String,
    /// Start of the station.
    pub start: Instant,
    arrivals: u64,
    /// More vehicles came than there is room for.
    is_full: bool,
    /// Events.
    pub events: History<FleetEvent>,
}

impl Default for Fleet {
    fn default() -> Self {
        Self {
            vehicles: BTreeMap::new(),
            malformed: 0,
            refused: 0,
            network: String::new(),
            start: Instant::now(),
            arrivals: 0,
            is_full: false,
            events: History::default(),
        }
    }
}

impl Fleet {
    /// The vehicle that sent a message; `None`, and counted, if its name is impossible.
    pub fn vehicle(&mut self, name: &str) -> Option<&mut VehicleState> {
        if !self.vehicles.contains_key(name) {
            if !is_name(name) {
                self.refused += 1;
                return None;
            }
            self.make_room();
            self.arrivals += 1;
            self.vehicles.insert(name.to_owned(), VehicleState::arrived(self.arrivals));
        }
        self.vehicles.get_mut(name)
    }

    /// Makes room for another vehicle. The one with the fewest received messages is evicted: a client that invents names
    /// has few messages under each, so it cannot lock out a real vehicle that appears late.
    fn make_room(&mut self) {
        if self.vehicles.len() < MAX_VEHICLES {
            return;
        }
        if !std::mem::replace(&mut self.is_full, true) {
            let words =
                format!("more than {MAX_VEHICLES} vehicles: those with the fewest messages are not shown");
            tracing::warn!("{words}; start another station with --vehicle");
            self.announce(None, Severity::Warning, words);
        }
        let least = self.vehicles.iter().min_by_key(|(_, vehicle)| (vehicle.heard(), vehicle.arrival));
        if let Some(name) = least.map(|(name, _)| name.clone()) {
            self.vehicles.remove(&name);
        }
    }

    /// Applies that the liveliness token of a vehicle appeared or disappeared.
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

    /// Counts a payload that could not be decoded.
    pub fn malformed(&mut self) {
        self.malformed += 1;
    }

    /// Applies odometry of `bytes`, received at `now_ns` by this host's clock.
    pub fn odom(&mut self, name: &str, message: &Heard<Odometry>, bytes: usize, now: Instant, now_ns: i64) {
        self.update(name, now, |vehicle| vehicle.apply_odom(message, bytes, now, now_ns));
    }

    /// Applies an estimate of `bytes`.
    pub fn state(&mut self, name: &str, message: &Heard<FullEstimate>, bytes: usize, now: Instant) {
        self.update(name, now, |vehicle| vehicle.apply_state(message, bytes, now));
    }

    /// Applies a health message of `bytes`.
    pub fn health(&mut self, name: &str, message: &Heard<Health>, bytes: usize, now: Instant) {
        self.update(name, now, |vehicle| vehicle.apply_health(message, bytes, now));
    }

    /// Applies `change` to a vehicle, and announces changes of its state, resets and work budget.
    fn update(&mut self, name: &str, now: Instant, change: impl FnOnce(&mut VehicleState)) {
        let Some(vehicle) = self.vehicle(name) else { return };
        let before = (vehicle.resets, vehicle.news.clone());
        let was_shared = vehicle.is_shared();
        change(vehicle);
        let is_news = vehicle.is_shared() && !was_shared;
        let after = (vehicle.resets, vehicle.news.ladder.name.clone());
        let is_fresh = |notice: &&String| {
            let mut known = before.1.sensors.notices.iter();
            !known.any(|known| without_digits(known).eq(without_digits(notice)))
        };
        let fresh: Vec<String> = vehicle.news.sensors.notices.iter().filter(is_fresh).cloned().collect();
        let state = vehicle.state_words();
        if vehicle.state_news.is_due(state, now) {
            let severity = match state {
                "tracking" | "initialising" => Severity::Info,
                "blind" => Severity::Warning,
                _ => Severity::Error,
            };
            self.announce(Some(name), severity, state.to_owned());
        }
        if is_news {
            let words = "two vehicles publish under this name; set network.vehicle of one of them";
            tracing::warn!("{name}: {words}");
            self.announce(Some(name), Severity::Error, words.into());
        }
        if before.0 != after.0 {
            self.announce(Some(name), Severity::Warning, format!("reset: the counter is now {}", after.0));
        }
        for notice in fresh {
            self.announce(Some(name), Severity::Warning, notice);
        }
        let (old, new) = (before.1.ladder.name, after.1);
        if !old.is_empty() && !new.is_empty() && old != new {
            self.announce(Some(name), Severity::Warning, format!("work budget: {new}"));
        }
    }

    /// Measurement time of the newest message of the first vehicle by name that is heard now, ns: vehicles may have other clocks.
    pub fn data_time_ns(&self, now: Instant) -> Option<i64> {
        let is_heard = |vehicle: &&VehicleState| !vehicle.odom.is_stale(now) || !vehicle.state.is_stale(now);
        self.vehicles.values().find(is_heard).map(|vehicle| vehicle.stamp_ns)
    }

    /// Adds an event.
    pub fn announce(&mut self, vehicle: Option<&str>, severity: Severity, text: String) {
        let time_s = self.start.elapsed().as_secs_f64();
        let event = FleetEvent { vehicle: vehicle.map(str::to_owned), severity, time_s, text };
        self.events.push(event, MAX_EVENTS);
    }

    /// A line for each vehicle.
    pub fn lines(&self, now: Instant) -> Vec<String> {
        self.vehicles.iter().map(|(name, vehicle)| vehicle.line(name, now)).collect()
    }
}

/// A notice whose counts go on is the same.
fn without_digits(notice: &str) -> impl Iterator<Item = char> {
    notice.chars().filter(|c| !c.is_ascii_digit())
}

/// True if a vehicle can have this name: it is one part of a key, and is shown in terminals.
pub fn is_name(name: &str) -> bool {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_');
    !name.is_empty() && name.len() <= MAX_NAME && name.chars().all(is_plain)
}

#[cfg(test)]
mod tests {
    use super::super::channel::STALE_AFTER;
    use super::super::test_messages::{heard, odometry as odom, window};
    use super::super::vehicle::LOST_AFTER;
    use super::*;
    use nalgebra::{Isometry3, Vector3};
    use plumbline_config::Timestamp;
    use plumbline_record::messages::PastPose;
    use std::time::Duration;

    fn texts(fleet: &Fleet) -> Vec<&str> {
        fleet.events.iter().map(|event| event.text.as_str()).collect()
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
    fn two_vehicles_of_one_name_are_told() {
        let (mut fleet, start) = (Fleet::default(), Instant::now());
        for k in 0..500_u64 {
            let sequence = k / 2 + if k % 2 == 0 { 9_000 } else { 0 };
            fleet.odom("a", &odom(sequence, 0.0, 0), 100, start + Duration::from_millis(5 * k), 0);
        }
        let told = texts(&fleet).iter().filter(|text| text.starts_with("two vehicles")).count();
        assert_eq!(told, 1, "{:?}", texts(&fleet));
    }

    #[test]
    fn a_reset_is_told_and_a_jump_begins_a_new_path() {
        let (mut fleet, now) = (Fleet::default(), Instant::now());
        for k in 0..100 {
            fleet.odom("a", &odom(k, k as f64 * 0.1, 0), 100, now, 0);
        }
        assert!(fleet.vehicles["a"].track.points.len() > 50);
        fleet.odom("a", &odom(100, 0.0, 1), 100, now, 0);
        assert_eq!(fleet.vehicles["a"].track.points.len(), 1);
        assert!(texts(&fleet).contains(&"reset: the counter is now 1"));
    }

    #[test]
    fn a_notice_with_other_counts_is_no_new_event() {
        let (mut fleet, now) = (Fleet::default(), Instant::now());
        for k in 0..50 {
            let mut health = Health::default();
            health.sensors.notices = vec![format!("IMU: {k} of 201 samples are not finite")];
            fleet.health("a", &heard(k, health), 100, now);
        }
        assert_eq!(texts(&fleet).iter().filter(|text| text.starts_with("IMU")).count(), 1);
    }

    #[test]
    fn time_is_of_a_vehicle_that_is_heard() {
        let (mut fleet, start) = (Fleet::default(), Instant::now());
        let later = start + 2 * STALE_AFTER;
        fleet.odom("alpha", &odom(0, 0.0, 0), 100, start, 0);
        fleet.odom("bravo", &odom(1_000, 0.0, 0), 100, later, 0);
        assert_eq!(fleet.data_time_ns(start), Some(fleet.vehicles["alpha"].stamp_ns));
        assert_eq!(fleet.data_time_ns(later), Some(fleet.vehicles["bravo"].stamp_ns));
    }

    /// A keyframe and a window of before, as the vehicle sends them.
    fn mapped(fleet: &mut Fleet, sequence: u64, reset_counter: u32) {
        let map = &mut fleet.vehicle("a").unwrap().map;
        map.insert(&heard(sequence, window(0, reset_counter, 1)));
        map.set_scene(&window(0, reset_counter, 1));
    }

    /// Lengths of path, map and window after a reset at `x`, 5 ms after a pose at `before`.
    fn left_after_reset(before: f64, after: &Isometry3<f64>) -> [usize; 3] {
        let (mut fleet, now) = (Fleet::default(), Instant::now());
        for k in 0..100 {
            fleet.odom("a", &odom(k, before * k as f64 / 99.0, 0), 100, now, 0);
        }
        mapped(&mut fleet, 0, 0);
        let mut message = odom(100, 0.0, 1);
        message.message.pose_o_b = *after;
        fleet.odom("a", &message, 100, now, 0);
        let vehicle = &fleet.vehicles["a"];
        [vehicle.track.points.len(), vehicle.map.len(), vehicle.map.scene.points_o.len()]
    }

    #[test]
    fn a_hard_reset_clears_what_lies_in_the_old_odometry_frame() {
        for far in [9.9, 0.4] {
            assert_eq!(left_after_reset(far, &Isometry3::identity()), [1, 0, 0], "from {far} m");
        }
        // At the origin, and turned.
        assert_eq!(left_after_reset(0.1, &Isometry3::rotation(Vector3::z())), [1, 0, 0]);
    }

    #[test]
    fn a_soft_reset_keeps_path_and_map() {
        for place in [9.9, 0.1] {
            let left = left_after_reset(place, &Isometry3::translation(place, 0.1, 0.0));
            assert!(left[0] > 1 && left[1..] == [1, 3], "at {place} m: {left:?}");
        }
    }

    #[test]
    fn a_station_that_joins_late_takes_keyframes_of_the_present_frame_only() {
        let (mut fleet, now) = (Fleet::default(), Instant::now());
        fleet.alive("a", true);
        mapped(&mut fleet, 0, 2);
        fleet.odom("a", &odom(0, 0.0, 3), 100, now, 0);
        mapped(&mut fleet, 1, 2);
        mapped(&mut fleet, 2, 3);
        let map = &fleet.vehicles["a"].map;
        assert_eq!((map.len(), map.missing(64)), (1, None));
    }

    #[test]
    fn a_partition_leaves_the_path_whole() {
        let (mut fleet, now) = (Fleet::default(), Instant::now());
        fleet.alive("a", true);
        fleet.odom("a", &odom(0, 0.0, 0), 100, now, 0);
        fleet.alive("a", false);
        fleet.alive("a", true);
        fleet.odom("a", &odom(4_000, 30.0, 0), 100, now, 0);
        assert_eq!(fleet.vehicles["a"].track.points.len(), 2);
        assert_eq!(fleet.vehicles["a"].odom.lost, 0);
        let past = |k: i64, reset_counter| PastPose {
            stamp: Timestamp::from_nanos(k * 1_000_000_000),
            pose_o_b: Isometry3::translation(k as f64, 0.0, 0.0),
            reset_counter,
        };
        let answer: Vec<_> = (0..10).map(|k| past(k, 1)).chain((10..20).map(|k| past(k, 0))).collect();
        fleet.vehicle("a").unwrap().fill(&answer);
        assert_eq!(fleet.vehicles["a"].track.points.len(), 12);
    }

    #[test]
    fn a_vehicle_that_started_anew_begins_a_new_path() {
        let (mut fleet, now) = (Fleet::default(), Instant::now());
        fleet.odom("a", &odom(4_000, 30.0, 0), 100, now, 0);
        let mut message = odom(0, 0.0, 0);
        message.envelope.stamp_ns = 60_000_000_000;
        fleet.odom("a", &message, 100, now, 0);
        assert_eq!(fleet.vehicles["a"].track.points.len(), 1);
    }

    #[test]
    fn invented_names_lock_no_vehicle_out() {
        let (mut fleet, now) = (Fleet::default(), Instant::now());
        (0..MAX_VEHICLES).for_each(|k| fleet.alive(&format!("invented{k}"), true));
        let hear = |fleet: &mut Fleet, sequence: u64| {
            fleet.alive("drone", true);
            fleet.odom("drone", &odom(sequence, 0.0, 0), 100, now, 0);
        };
        (0..3).for_each(|sequence| hear(&mut fleet, sequence));
        // Names go on being invented, faster than the vehicle speaks.
        for k in 0..1_000u64 {
            fleet.alive(&format!("more{k}"), true);
            fleet.odom(&format!("more{k}"), &odom(0, 0.0, 0), 100, now, 0);
            if k.is_multiple_of(10) {
                hear(&mut fleet, 3 + k / 10);
            }
        }
        assert_eq!(fleet.vehicles.len(), MAX_VEHICLES);
        assert_eq!(fleet.vehicles["drone"].odom.received, 103, "it was never thrown out");
        assert!(fleet.events.len() <= MAX_EVENTS);
    }

    #[test]
    fn more_vehicles_than_places_are_told_once() {
        let mut fleet = Fleet::default();
        (0..2 * MAX_VEHICLES).for_each(|k| fleet.alive(&format!("v{k}"), true));
        let told = texts(&fleet).iter().filter(|text| text.starts_with("more than 64 vehicles")).count();
        assert_eq!((fleet.vehicles.len(), told), (MAX_VEHICLES, 1));
    }

    #[test]
    fn impossible_names_are_refused_and_counted() {
        let mut fleet = Fleet::default();
        for name in ["", "\u{1b}[2J", "a b", "a\u{85}b", &"x".repeat(MAX_NAME + 1)] {
            fleet.alive(name, true);
        }
        assert_eq!((fleet.vehicles.len(), fleet.refused), (0, 5));
    }

    #[test]
    fn latency_is_brought_to_one_clock() {
        let (mut fleet, now) = (Fleet::default(), Instant::now());
        fleet.alive("a", true);
        let ahead_ns = 3_600_000_000_000;
        fleet.vehicles.get_mut("a").unwrap().clock.add(super::super::clock::Exchange {
            asked_ns: 0,
            received_ns: ahead_ns + 100,
            answered_ns: ahead_ns + 100,
            came_ns: 200,
        });
        let mut message = odom(0, 0.0, 0);
        message.envelope.published_ns = ahead_ns + 1_000_000;
        fleet.odom("a", &message, 100, now, 3_000_000);
        assert!((fleet.vehicles["a"].latency_ms.unwrap() - 2.0).abs() < 1e-9);
    }
}
