//! How often each key is published over which link: what is too much for it is left out at the source.

use plumbline_config::options::Link;
use std::time::Duration;

pub use plumbline_flight::schedule::pace::Pace;

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
