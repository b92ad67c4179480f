//! How often each key is published over which link: what is too much for it is left out at the source.

use plumbline_config::Timestamp;
use plumbline_config::options::Link;
use std::time::Duration;

/// What is published over a link. Rates in Hz; infinity is everything, zero nothing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rates {
    /// Odometry.
    pub odom_hz: f64,
    /// Estimates.
    pub state_hz: f64,
    /// Health, beside changes.
    pub health_hz: f64,
    /// What is in the window.
    pub scene_hz: f64,
    /// Points, and lines, of a keyframe at most.
    pub keyframe_landmarks: usize,
    /// Where the odometry lies in the map.
    pub correction_hz: f64,
    /// The corrected path.
    pub path_hz: f64,
    /// Poses, and loops, of a corrected path at most.
    pub path_poses: usize,
    /// Camera pictures.
    pub camera_hz: f64,
    /// Their width at most, px.
    pub camera_width_px: usize,
    /// Their JPEG quality.
    pub camera_quality: u8,
}

impl Rates {
    /// Those for a link.
    #[must_use]
    pub fn of(link: Link) -> Self {
        match link {
            Link::Lan => Self {
                odom_hz: f64::INFINITY,
                state_hz: f64::INFINITY,
                health_hz: 5.0,
                scene_hz: 2.0,
                keyframe_landmarks: usize::MAX,
                correction_hz: 5.0,
                path_hz: 1.0,
                path_poses: 2_000,
                camera_hz: 5.0,
                camera_width_px: 376,
                camera_quality: 70,
            },
            Link::Wifi => Self {
                odom_hz: 50.0,
                state_hz: 10.0,
                health_hz: 5.0,
                scene_hz: 1.0,
                keyframe_landmarks: usize::MAX,
                correction_hz: 5.0,
                path_hz: 0.5,
                path_poses: 1_000,
                camera_hz: 2.0,
                camera_width_px: 256,
                camera_quality: 50,
            },
            Link::Radio => Self {
                odom_hz: 10.0,
                state_hz: 1.0,
                health_hz: 1.0,
                scene_hz: 0.0,
                keyframe_landmarks: 20,
                correction_hz: 1.0,
                path_hz: 0.1,
                path_poses: 100,
                camera_hz: 0.0,
                camera_width_px: 0,
                camera_quality: 0,
            },
        }
    }

    /// Time between two health messages without change.
    #[must_use]
    pub fn health_period(&self) -> Duration {
        Duration::from_secs_f64(1.0 / self.health_hz)
    }

    /// Time between two corrected paths, at least.
    #[must_use]
    pub fn path_period(&self) -> Duration {
        Duration::from_secs_f64(1.0 / self.path_hz)
    }
}

/// Stamps jitter: a sample that is early by so much counts for its place on the grid, ns.
const JITTER_NS: i64 = 2_000_000;

/// Lets messages through at a rate of data time, without drift: a grid of due times, of which none is made
/// up for.
#[derive(Clone, Debug)]
pub struct Pace {
    period_ns: Option<i64>,
    due: Option<Timestamp>,
}

impl Pace {
    /// At `rate_hz` at most.
    #[must_use]
    pub fn new(rate_hz: f64) -> Self {
        Self { period_ns: (rate_hz > 0.0).then(|| (1e9 / rate_hz) as i64), due: None }
    }

    /// Whether the message of `stamp` goes.
    pub fn admits(&mut self, stamp: Timestamp) -> bool {
        let Some(period_ns) = self.period_ns else { return false };
        let due = *self.due.get_or_insert(stamp);
        let late_ns = stamp.nanos_since(due);
        // A clock that was set back starts the grid anew.
        if (-4 * period_ns..-(period_ns / 8).min(JITTER_NS)).contains(&late_ns) {
            return false;
        }
        let next = if late_ns.abs() > period_ns { stamp } else { due };
        self.due = Some(next.plus_nanos(period_ns));
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn admitted(rate_hz: f64, source_hz: f64, seconds: f64) -> usize {
        let mut pace = Pace::new(rate_hz);
        let count = (seconds * source_hz) as i64;
        (0..count).filter(|k| pace.admits(Timestamp::from_nanos(k * (1e9 / source_hz) as i64))).count()
    }

    #[test]
    fn messages_are_thinned_to_the_rate() {
        assert_eq!(admitted(50.0, 200.0, 10.0), 500);
        assert_eq!(admitted(10.0, 200.0, 10.0), 100);
        assert_eq!(admitted(2.0, 20.0, 10.0), 20);
        assert!((295..=305).contains(&admitted(30.0, 200.0, 10.0)));
    }

    #[test]
    fn everything_and_nothing_are_rates_too() {
        assert_eq!(admitted(f64::INFINITY, 200.0, 1.0), 200);
        assert_eq!(admitted(0.0, 200.0, 1.0), 0);
    }

    #[test]
    fn a_gap_is_not_made_up_for_and_a_clock_set_back_does_not_silence() {
        let mut pace = Pace::new(10.0);
        let at = |s: f64| Timestamp::default().plus_seconds(s);
        assert!(pace.admits(at(0.0)));
        assert!(pace.admits(at(5.0)));
        assert!(!pace.admits(at(5.05)));
        assert!(pace.admits(at(5.1)));
        assert!(pace.admits(at(1.0)));
        assert!(!pace.admits(at(1.05)));
    }
}
