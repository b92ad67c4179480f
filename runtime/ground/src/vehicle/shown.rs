//! A vehicle as it is shown: presence, attitude, and its state as text.

use super::{LOST_AFTER, VehicleState};
use crate::attitude::Attitude;
use nalgebra::{Isometry3, Vector3};
use plumbline_record::QUALITY_TO_USE;
use std::time::{Duration, Instant};

impl VehicleState {
    /// True if two vehicles publish under its name.
    pub fn is_shared(&self) -> bool {
        self.odom.is_shared || self.state.is_shared
    }

    /// Time since the last message on any key.
    pub fn age(&self, now: Instant) -> Option<Duration> {
        [&self.odom, &self.state, &self.health].into_iter().filter_map(|channel| channel.age(now)).min()
    }

    /// Presence at `now`: "lost", "stale", "unknown", or the name of its tracking state.
    pub fn presence(&self, now: Instant) -> &'static str {
        let is_silent = self.age(now).is_none_or(|age| age > LOST_AFTER);
        if !self.is_alive || (is_silent && self.age(now).is_some()) {
            return "lost";
        }
        if is_silent {
            return "unknown";
        }
        let has_pose = self.state_words() != "initialising" || self.odom.age(now).is_some();
        if has_pose && self.odom.is_stale(now) && self.state.is_stale(now) {
            "stale"
        } else {
            self.state_words()
        }
    }

    /// Takes coordinates from the odometry to the map frame; `None` while that is not known.
    pub fn pose_m_o(&self) -> Option<Isometry3<f64>> {
        self.corrected.pose_m_o(self.resets)
    }

    /// The map as text; `None` where the vehicle has said nothing of one.
    pub fn map_words(&self) -> Option<String> {
        self.corrected.words(self.resets)
    }

    /// Number of messages received from the vehicle.
    pub fn heard(&self) -> u64 {
        self.odom.received + self.state.received + self.health.received
    }

    /// Largest standard deviation of the position, m.
    pub fn sigma_m(&self) -> f64 {
        self.sigmas[..3].iter().copied().fold(0.0, f64::max)
    }

    /// Newest pose of the vehicle `V` in the odometry frame; its origin is the IMU's.
    pub fn pose_o_v(&self) -> Option<Isometry3<f64>> {
        let (pose_o_b, rot_v_b) = (self.pose_o_b?, self.news.rot_v_b?);
        Some(Isometry3::from_parts(pose_o_b.translation, pose_o_b.rotation * rot_v_b.inverse()))
    }

    /// Attitude of the vehicle; `None` without a pose, or while its mounting is unknown.
    pub fn attitude(&self) -> Option<Attitude> {
        self.pose_o_v().map(|pose_o_v| Attitude::of(&pose_o_v.rotation))
    }

    /// Rates of roll (right wing going down), pitch (nose going up) and yaw (turning right), rad/s.
    pub fn attitude_rates(&self) -> Option<Vector3<f64>> {
        let rate_v = self.news.rot_v_b? * self.rate_b;
        Some(Vector3::new(rate_v.x, -rate_v.y, -rate_v.z))
    }

    /// True if its last state is its present one: messages arrive, with a pose if there was one.
    pub fn is_current(&self, now: Instant) -> bool {
        !["lost", "stale", "unknown"].contains(&self.presence(now))
    }

    /// True if its pose may be used: it tracks, and its quality is that which autopilots ask for.
    pub(crate) fn is_usable(&self, now: Instant) -> bool {
        self.presence(now) == "tracking" && self.quality >= QUALITY_TO_USE.into()
    }

    /// Quality as text: percent, or "invalid" without a valid estimate; a dash for a vehicle that is gone.
    pub fn quality_words(&self, now: Instant) -> String {
        if !self.is_current(now) {
            return "-".into();
        }
        if self.quality < 0 { "invalid".into() } else { format!("{} %", self.quality) }
    }

    /// Health as text: the faults and the first words of the notices; without any "no faults", or "no valid estimate"; "health unknown"
    /// for a vehicle that is gone.
    pub fn health_summary(&self, now: Instant) -> String {
        if !self.is_current(now) {
            return "health unknown".into();
        }
        let notices = self.news.sensors.notices.iter();
        let notices = notices.map(|notice| notice.split(": ").next().unwrap_or(notice));
        let mut all: Vec<&str> = self.bits.names().collect();
        all.extend(notices);
        match (all.is_empty(), self.quality) {
            (false, _) => all.join(", "),
            (true, ..0) => "no valid estimate".into(),
            (true, _) => "no faults".into(),
        }
    }

    /// Position as text, with its standard deviation.
    pub(crate) fn position_words(&self) -> String {
        self.pose_o_b.map_or_else(
            || "no pose".to_owned(),
            |pose| {
                let p = pose.translation.vector;
                format!("{:+8.3} {:+8.3} {:+8.3} m  1σ {:.3} m", p.x, p.y, p.z, self.sigma_m())
            },
        )
    }

    /// Attitude as text.
    pub(crate) fn attitude_words(&self) -> String {
        self.attitude().map_or_else(
            || "unknown".to_owned(),
            |a| {
                let heading_deg = a.heading_deg.round() % 360.0;
                format!("roll {:+6.1}°  pitch {:+5.1}°  heading {heading_deg:03}°", a.roll_deg, a.pitch_deg)
            },
        )
    }

    /// Rates and latency as text.
    pub(crate) fn link_words(&self, now: Instant) -> String {
        let latency_ms = self.latency_ms.unwrap_or(0.0);
        let [odometry_hz, state_hz] = [&self.odom, &self.state].map(|channel| channel.rate_hz(now));
        format!("odometry {odometry_hz:.0} Hz  state {state_hz:.0} Hz  latency {latency_ms:.1} ms")
    }

    /// Presence as text, with whether a pose is for use.
    pub(crate) fn presence_words(&self, now: Instant) -> &'static str {
        match self.presence(now) {
            "tracking" if !self.is_usable(now) => "tracking, not for use",
            "blind" => "blind, not for use",
            presence => presence,
        }
    }

    /// Position, attitude, speed, rates and health in one line of text.
    pub fn line(&self, name: &str, now: Instant) -> String {
        let last = if self.is_current(now) || self.pose_o_b.is_none() { "" } else { "last " };
        format!(
            "{name}: {}, quality {}, {last}position {}, {}, speed {:.2} m/s, {}, lost {}, {}{}",
            self.presence_words(now),
            self.quality_words(now),
            self.position_words(),
            self.attitude_words(),
            self.v_o_b.norm(),
            self.link_words(now),
            self.odom.lost + self.state.lost,
            self.health_summary(now),
            self.map_words().map_or_else(String::new, |words| format!(", map: {words}")),
        )
    }
}
