//! Rates of publishing by link: the excess over its capacity is left out at the source. Rates of keys are in
//! the table of topics.

use plumbline_config::options::Link;
use plumbline_record::topics::Topic;
use std::time::Duration;

pub use plumbline_rings::pace::Pace;

/// Rates of publishing over a link.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rates {
    /// The link.
    pub link: Link,
    /// Points, and lines, of a keyframe at most.
    pub keyframe_landmarks: usize,
    /// Poses, and loops, of a corrected path at most.
    pub path_poses: usize,
    /// Their width at most, px.
    pub camera_width_px: usize,
    /// Their JPEG quality.
    pub camera_quality: u8,
}

impl Rates {
    /// Rates for a link.
    pub fn of(link: Link) -> Self {
        match link {
            Link::Lan => Self {
                link,
                keyframe_landmarks: usize::MAX,
                path_poses: 2_000,
                camera_width_px: 376,
                camera_quality: 70,
            },
            Link::Wifi => Self {
                link,
                keyframe_landmarks: usize::MAX,
                path_poses: 1_000,
                camera_width_px: 256,
                camera_quality: 50,
            },
            Link::Radio => {
                Self { link, keyframe_landmarks: 20, path_poses: 100, camera_width_px: 0, camera_quality: 0 }
            }
        }
    }

    /// Messages of a topic a second; infinity is everything, zero nothing.
    pub fn hz(&self, topic: Topic) -> f64 {
        topic.rate_hz(self.link)
    }

    /// Time between two messages of a topic.
    pub fn period(&self, topic: Topic) -> Duration {
        Duration::from_secs_f64(1.0 / self.hz(topic))
    }
}
