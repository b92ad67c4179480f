//! State of the odometry, and when the pilot is told of it.

use crate::schedule::ticker::Monotonic;
use mavlink::dialects::common::{MavSeverity, MavState};
use plumbline_config::options::FlowMessages;
use plumbline_estimator::TrackingState;

/// Odometry measured longer ago than this is none, ns.
pub const STALE_NS: i64 = 500_000_000;
/// The pilot is told at most this often, ns.
const PAUSE_NS: i64 = 1_000_000_000;

/// Odometry must be usable for so long before flow ends, ns.
const FLOW_HOLD_NS: i64 = 2_000_000_000;

/// State of the odometry.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OdometryCondition {
    /// There has been none yet.
    Starting,
    /// Good.
    Tracking,
    /// Not to be used, and why.
    Lost(Reason),
    /// The run has ended.
    Stopped,
}

/// Why odometry is not to be used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reason {
    /// The newest is too old.
    Silent,
    /// It rests on the IMU alone.
    Blind,
    /// The estimate was given up.
    Failed,
    /// Its velocity is not known well enough.
    Uncertain,
    /// It holds something that is no number.
    NotFinite,
    /// The autopilot's clock, which is to stamp it, is not known.
    NoClock,
}

impl OdometryCondition {
    /// Returns the condition for odometry in this state.
    pub fn of(state: TrackingState) -> Self {
        match state {
            TrackingState::Tracking => Self::Tracking,
            TrackingState::Blind => Self::Lost(Reason::Blind),
            TrackingState::Initialising | TrackingState::Failed => Self::Lost(Reason::Failed),
        }
    }

    /// As a heartbeat says it.
    #[must_use]
    pub fn mav_state(self) -> MavState {
        match self {
            Self::Starting => MavState::MAV_STATE_BOOT,
            Self::Tracking => MavState::MAV_STATE_ACTIVE,
            Self::Lost(_) => MavState::MAV_STATE_CRITICAL,
            Self::Stopped => MavState::MAV_STATE_STANDBY,
        }
    }

    fn words(self) -> Option<(MavSeverity, &'static str)> {
        let warning = MavSeverity::MAV_SEVERITY_WARNING;
        Some(match self {
            Self::Starting => return None,
            Self::Tracking => (MavSeverity::MAV_SEVERITY_INFO, "Plumbline: tracking"),
            Self::Lost(Reason::Silent) => (warning, "Plumbline: lost, estimator is silent"),
            Self::Lost(Reason::Blind) => (warning, "Plumbline: lost, no features"),
            Self::Lost(Reason::Failed) => (warning, "Plumbline: lost, starting anew"),
            Self::Lost(Reason::Uncertain) => (warning, "Plumbline: lost, velocity is uncertain"),
            Self::Lost(Reason::NotFinite) => (warning, "Plumbline: lost, estimate is not a number"),
            Self::Lost(Reason::NoClock) => (warning, "Plumbline: lost, no TIMESYNC answers"),
            Self::Stopped => (warning, "Plumbline: lost, stopped"),
        })
    }
}

/// Tells changes between tracking and lost, once each.
#[derive(Clone, Copy, Debug, Default)]
pub struct Announcer {
    told: Option<OdometryCondition>,
    at: Option<Monotonic>,
}

impl Announcer {
    /// News to be said now. One kind of loss that follows another is no news.
    pub fn news(
        &mut self,
        condition: OdometryCondition,
        now: Monotonic,
    ) -> Option<(MavSeverity, &'static str)> {
        let is_old = match (self.told, condition) {
            (Some(OdometryCondition::Lost(_)), OdometryCondition::Lost(_)) => true,
            (told, condition) => told == Some(condition),
        };
        let is_soon = self.at.is_some_and(|at| now.0.saturating_sub(at.0) < PAUSE_NS);
        if is_old || (is_soon && condition != OdometryCondition::Stopped) {
            return None;
        }
        let words = condition.words()?;
        (self.told, self.at) = (Some(condition), Some(now));
        Some(words)
    }

    /// Sends the last status again: a new listener has appeared.
    pub fn repeat(&mut self) {
        *self = Self::default();
    }
}

/// Decides whether flow is sent: at once when the odometry is lost, and until it has been usable for some time.
#[derive(Clone, Copy, Debug)]
pub struct FlowSwitch {
    mode: FlowMessages,
    is_on: bool,
    usable_since: Option<Monotonic>,
    told: bool,
}

impl FlowSwitch {
    /// A switch that is off until the first update.
    pub fn new(mode: FlowMessages) -> Self {
        Self { mode, is_on: false, usable_since: None, told: false }
    }

    /// Updates the switch at `now`, with `is_usable` of the odometry; returns true if flow is sent.
    pub fn update(&mut self, is_usable: bool, now: Monotonic) -> bool {
        self.usable_since = is_usable.then(|| self.usable_since.unwrap_or(now));
        let held = self.usable_since.map_or(0, |since| now.0.saturating_sub(since.0));
        self.is_on = match self.mode {
            FlowMessages::Off => false,
            FlowMessages::Always => true,
            FlowMessages::WhenLost => !is_usable || (self.is_on && held < FLOW_HOLD_NS),
        };
        self.is_on
    }

    /// True if flow is sent, by the last update.
    pub fn is_on(&self) -> bool {
        self.is_on
    }

    /// Status text to send now, once for each change.
    pub fn news(&mut self) -> Option<(MavSeverity, &'static str)> {
        let is_news = self.told != self.is_on;
        self.told = self.is_on;
        is_news.then_some(match self.is_on {
            true => (MavSeverity::MAV_SEVERITY_WARNING, "Plumbline: sending optical flow"),
            false => (MavSeverity::MAV_SEVERITY_INFO, "Plumbline: odometry is back, optical flow ends"),
        })
    }

    /// Says again that flow is sent: a new listener has appeared.
    pub fn repeat(&mut self) {
        self.told = false;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECOND: i64 = 1_000_000_000;

    #[test]
    fn start_and_loss_are_told_once_each() {
        let mut announcer = Announcer::default();
        let mut said = Vec::new();
        for k in 0..400_i64 {
            let condition = match k {
                0..100 => OdometryCondition::Starting,
                100..200 => OdometryCondition::Tracking,
                200..250 => OdometryCondition::Lost(Reason::Blind),
                250..300 => OdometryCondition::Lost(Reason::Failed),
                _ => OdometryCondition::Tracking,
            };
            said.extend(announcer.news(condition, Monotonic(k * SECOND / 40)).map(|(_, words)| words));
        }
        assert_eq!(said, ["Plumbline: tracking", "Plumbline: lost, no features", "Plumbline: tracking"]);
    }

    #[test]
    fn a_state_that_flickers_is_told_once_a_second() {
        let mut announcer = Announcer::default();
        let flicker = [OdometryCondition::Tracking, OdometryCondition::Lost(Reason::Blind)];
        let said = (0..400_i64)
            .filter(|k| announcer.news(flicker[*k as usize % 2], Monotonic(k * SECOND / 40)).is_some());
        assert!(said.count() <= 10);
    }

    #[test]
    fn who_comes_later_is_told_what_was_said() {
        let mut announcer = Announcer::default();
        assert!(announcer.news(OdometryCondition::Tracking, Monotonic(0)).is_some());
        assert!(announcer.news(OdometryCondition::Tracking, Monotonic(9 * SECOND)).is_none());
        announcer.repeat();
        assert!(announcer.news(OdometryCondition::Tracking, Monotonic(9 * SECOND)).is_some());
        assert!(
            announcer.news(OdometryCondition::Stopped, Monotonic(9 * SECOND)).is_some(),
            "the end never waits"
        );
    }

    #[test]
    fn flow_begins_at_once_and_ends_when_the_odometry_has_held() {
        let mut switch = FlowSwitch::new(FlowMessages::WhenLost);
        let mut told = Vec::new();
        let mut on = Vec::new();
        for k in 0..400_i64 {
            // Lost for a second, back for one, lost for a fortieth, and back for good.
            let is_usable = !matches!(k, 100..140 | 180);
            if switch.update(is_usable, Monotonic(k * SECOND / 40)) {
                on.push(k);
            }
            told.extend(switch.news().map(|(_, words)| (k, words)));
        }
        assert_eq!(on, (100..261).collect::<Vec<_>>());
        let expected = [
            (100, "Plumbline: sending optical flow"),
            (261, "Plumbline: odometry is back, optical flow ends"),
        ];
        assert_eq!(told, expected);
        assert!(told.iter().all(|(_, words)| words.len() <= 50));
    }

    #[test]
    fn flow_before_the_first_pose_is_sent_and_off_and_always_stay() {
        for (mode, expected) in [
            (FlowMessages::Off, [false, false]),
            (FlowMessages::Always, [true, true]),
            (FlowMessages::WhenLost, [true, false]),
        ] {
            let mut switch = FlowSwitch::new(mode);
            let before = switch.update(false, Monotonic(0));
            switch.update(true, Monotonic(SECOND));
            assert_eq!([before, switch.update(true, Monotonic(3 * SECOND))], expected, "{mode:?}");
        }
    }

    #[test]
    fn all_words_fit_into_a_message() {
        let reasons = [
            Reason::Silent,
            Reason::Blind,
            Reason::Failed,
            Reason::Uncertain,
            Reason::NotFinite,
            Reason::NoClock,
        ];
        let conditions = reasons
            .map(OdometryCondition::Lost)
            .into_iter()
            .chain([OdometryCondition::Tracking, OdometryCondition::Stopped]);
        assert!(conditions.map(|c| c.words().unwrap().1).all(|words| words.len() <= 50));
    }
}
