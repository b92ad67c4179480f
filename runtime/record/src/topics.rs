//! The topics: everything that a flight says, each with every way on which it is said.
//!
//! A row of the table in [`messages`](crate::messages) names the message and, where there is one, the channel of the log, the kind of
//! the local socket, the key of the network with its quality of service and its rates, and the question that is answered with it. Log,
//! local socket, network process, station, fuzzers and tests go over these rows; the table of messages in docs/guide.md is made of
//! them.

use crate::fields::stamp_of;
use crate::said::EntryKind;
use plumbline_config::Timestamp;
use plumbline_config::options::{ImageRecording, Link};

pub use crate::messages::{Said, Topic};
pub use crate::row::{Decode, NetworkKey, Priority, Question, Row, Subscription};

impl Topic {
    /// Topics that have a channel of the log, in the order of its seal.
    pub const LOGGED: [Self; logged()] = {
        let (mut logged, mut k) = ([Self::Imu; logged()], 0);
        while k < logged.len() {
            logged[k] = Self::ALL[k];
            k += 1;
        }
        logged
    };

    /// Name of its channel in the log; empty where it has none.
    #[must_use]
    pub const fn channel(self) -> &'static str {
        match self.row().log {
            Some(topic) => topic,
            None => "",
        }
    }

    /// The topic of a channel of the log.
    pub fn of_channel(channel: &str) -> Option<Self> {
        Self::LOGGED.into_iter().find(|topic| topic.channel() == channel)
    }

    /// Name of its message with its package, in a log with such images.
    #[must_use]
    pub const fn schema(self, images: ImageRecording) -> &'static str {
        match (self, images) {
            (Self::Left | Self::Right, ImageRecording::Raw) => "foxglove.RawImage",
            _ => self.row().message,
        }
    }

    /// True if people look at it: its schema is one of Foxglove's.
    #[must_use]
    pub fn is_drawn(self) -> bool {
        self.row().message.starts_with("foxglove.")
    }

    /// True if a re-execution needs it.
    #[must_use]
    pub const fn is_input(self) -> bool {
        self.row().is_input
    }

    /// True if it holds images of a log.
    #[must_use]
    pub const fn is_image(self) -> bool {
        matches!(self, Self::Left | Self::Right)
    }

    /// Number of its kind on the local socket; 0 for none.
    #[must_use]
    pub const fn kind(self) -> u16 {
        self.row().kind
    }

    /// The topic of this kind on the local socket.
    pub fn of_kind(kind: u16) -> Option<Self> {
        Self::ALL.into_iter().find(|topic| kind > 0 && topic.kind() == kind)
    }

    /// Topics that are published on a key of the network.
    pub fn published() -> impl Iterator<Item = (Self, NetworkKey)> {
        Self::ALL.into_iter().filter_map(|topic| Some((topic, topic.row().key?)))
    }

    /// Messages a second over a link; infinity is everything, zero nothing.
    #[must_use]
    pub const fn rate_hz(self, link: Link) -> f64 {
        match self.row().key {
            Some(key) => key.rates_hz[link as usize],
            None => 0.0,
        }
    }
}

impl Said {
    /// Its kind, as it is counted when it is dropped.
    pub fn kind(&self) -> EntryKind {
        match self {
            Self::Imu(_) => EntryKind::Imu,
            Self::Order(_)
            | Self::Correction(_)
            | Self::Reset(_)
            | Self::MapOrder(_)
            | Self::InstantOrder(_) => EntryKind::Order,
            Self::Instant(_) => EntryKind::Instant,
            Self::Estimate(_) => EntryKind::Estimate,
            Self::Odometry(_) => EntryKind::Odometry,
            Self::MapEstimate(_) => EntryKind::MapEstimate,
            // What nothing depends on.
            _ => EntryKind::Event,
        }
    }

    /// Its measurement time; none for an order, which has no time of its own.
    pub fn stamp(&self) -> Option<Timestamp> {
        stamp_of(self.record()?)
    }
}

const fn logged() -> usize {
    let mut k = 0;
    while k < Topic::ALL.len() && Topic::ALL[k].row().log.is_some() {
        k += 1;
    }
    k
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn every_way_leads_to_one_topic() {
        for topic in Topic::ALL {
            assert_eq!(topic.row().log.is_some(), Topic::LOGGED.contains(&topic), "{topic:?}");
            assert_eq!(Topic::of_channel(topic.channel()), topic.row().log.map(|_| topic));
            assert_eq!(Topic::of_kind(topic.kind()), (topic.kind() > 0).then_some(topic));
        }
        assert_eq!(Topic::of_channel("/elsewhere"), None);
        let keys: BTreeSet<&str> = Topic::published().map(|(_, key)| key.name).collect();
        assert_eq!(keys.len(), Topic::published().count());
    }

    #[test]
    fn logs_keep_the_order_of_their_seal() {
        let begin = "/input/imu /input/left /input/right /input/frame /order/frame /order/correction /order/reset /order/map \
                     /output/estimate /output/map /output/odometry /tf /pose /event /recorder /calibration/left \
                     /calibration/right /tf_static";
        assert!(Topic::LOGGED.map(Topic::channel).join(" ").starts_with(begin));
    }
}
