//! The topics: everything that a flight says, each with every way on which it is said.
//!
//! A row names the message and, where there is one, the channel of the log, the kind of the local socket, the key of the network
//! with its quality of service and its rates, and the question that is answered with it. Log, local socket, network process,
//! station, fuzzers and tests go over these rows; the tables in docs/guide.md and docs/local-socket.md are made of them.

use crate::fields::{Parts, Record};
use crate::protobuf::decode;
use plumbline_config::options::{ImageRecording, Link};

/// Priority of a key of the network.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Priority {
    /// Before everything else, and at once.
    RealTime,
    /// Commands and health.
    InteractiveHigh,
    /// Estimates.
    DataHigh,
    /// The map.
    Data,
    /// What is only shown.
    DataLow,
    /// What fills the link.
    Background,
}

/// Key of the network that a topic is published on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Key {
    /// Key below `plumbline/<vehicle>/`.
    pub name: &'static str,
    /// Priority. What finds no room on the link is dropped.
    pub priority: Priority,
    /// Messages a second over LAN, WiFi and radio; infinity is everything, zero nothing.
    pub rates_hz: [f64; 3],
}

/// Question that is answered with the message of a topic.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Question {
    /// Key below `plumbline/<vehicle>/`.
    pub name: &'static str,
    /// Whether something is done.
    pub is_command: bool,
    /// Whether answers have keys of their own below it.
    pub has_several: bool,
}

/// When readers of the local socket receive a kind.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Subscription {
    /// By rules of its own.
    Other,
    /// When they subscribe to it.
    Asked,
    /// From the beginning.
    Always,
}

/// Reads the message of a topic, or says what is wrong with it.
pub type Decode = fn(&[u8]) -> Result<Box<dyn Parts>, &'static str>;

/// Row of a topic.
#[derive(Clone, Copy, Debug)]
pub struct Row {
    /// Description for the documents.
    pub about: &'static str,
    /// Name of its message with its package; empty for a fixed layout alone.
    pub message: &'static str,
    /// Reads its message; none for a fixed layout, and for what is drawn.
    pub decode: Option<Decode>,
    /// Channel of the log.
    pub log: Option<&'static str>,
    /// Whether a re-execution needs it.
    pub is_input: bool,
    /// Number of its kind on the local socket; 0 for none.
    pub kind: u16,
    /// When readers of the local socket receive it.
    pub subscription: Subscription,
    /// Key of the network.
    pub key: Option<Key>,
    /// Question that it answers.
    pub question: Option<Question>,
}

/// Everything that is published.
const ALL_OF_IT: [f64; 3] = [f64::INFINITY; 3];

impl Row {
    const fn of(about: &'static str, message: &'static str) -> Self {
        Self {
            about,
            message,
            decode: None,
            log: None,
            is_input: false,
            kind: 0,
            subscription: Subscription::Other,
            key: None,
            question: None,
        }
    }

    const fn record<T: Record>(mut self) -> Self {
        self.decode = Some(|bytes| Ok(Box::new(decode::<T>(bytes)?)));
        self
    }

    const fn log(mut self, topic: &'static str) -> Self {
        self.log = Some(topic);
        self
    }

    const fn input(mut self) -> Self {
        self.is_input = true;
        self
    }

    const fn kind(mut self, kind: u16, subscription: Subscription) -> Self {
        (self.kind, self.subscription) = (kind, subscription);
        self
    }

    const fn key(mut self, name: &'static str, priority: Priority, rates_hz: [f64; 3]) -> Self {
        self.key = Some(Key { name, priority, rates_hz });
        self
    }

    const fn answers(mut self, name: &'static str) -> Self {
        self.question = Some(Question { name, is_command: false, has_several: false });
        self
    }

    const fn answers_each(mut self, name: &'static str) -> Self {
        self.question = Some(Question { name, is_command: false, has_several: true });
        self
    }

    const fn commands(mut self, name: &'static str) -> Self {
        self.question = Some(Question { name, is_command: true, has_several: false });
        self
    }
}

/// Defines the topics by their rows.
macro_rules! topics {
    ($($(#[doc = $about:literal])+ $topic:ident = $message:literal $(. $way:ident $(::<$record:ty>)? ($($of:tt)*))*;)*) => {
        /// Something that a flight says.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
        pub enum Topic {
            $($(#[doc = $about])+ $topic,)*
        }

        impl Topic {
            /// Every topic, in the order of the enumeration.
            pub const ALL: [Self; [$(stringify!($topic)),*].len()] = [$(Self::$topic),*];

            /// Its row.
            #[must_use]
            pub const fn row(self) -> &'static Row {
                const ROWS: [Row; Topic::ALL.len()] =
                    [$(Row::of(concat!($($about),+).trim_ascii(), $message)$(.$way $(::<$record>)? ($($of)*))*),*];
                &ROWS[self as usize]
            }
        }
    };
}

/// Types of the messages.
mod records {
    pub use crate::messages::*;
    pub use crate::orders::{CorrectionOrder, FrameOrder, MapOrder, ResetOrder};
    pub use crate::parts::{FrameAbout, Recording};
    pub use crate::said::FullEstimate;
    pub use plumbline_drivers::ImuReading;
    pub use plumbline_estimator::places::{MapEstimate, MapPath};
    pub use plumbline_estimator::{Estimate, MapSnapshot, Odometry};
}

use Priority::{Background, Data, DataHigh, DataLow, InteractiveHigh, RealTime};
use Subscription::{Always, Asked, Other};

// Those of the log come first, in the order that seals of logs have: new ones come last among them.
topics! {
    /// Inertial samples.
    Imu = "plumbline.v1.log.Imu".record::<records::ImuReading>().log("/input/imu").input();
    /// Left images.
    Left = "foxglove.CompressedImage".log("/input/left").input();
    /// Right images.
    Right = "foxglove.CompressedImage".log("/input/right").input();
    /// Frames: number, stamp, hashes of the images.
    Frame = "plumbline.v1.log.Frame".record::<records::FrameAbout>().log("/input/frame").input();
    /// What became of frames.
    FrameOrder = "plumbline.v1.log.FrameOrder".record::<records::FrameOrder>().log("/order/frame").input();
    /// When estimates took effect.
    CorrectionOrder = "plumbline.v1.log.CorrectionOrder".record::<records::CorrectionOrder>().log("/order/correction").input();
    /// Resets.
    ResetOrder = "plumbline.v1.log.ResetOrder".record::<records::ResetOrder>().log("/order/reset").input();
    /// What became of frames for the map.
    MapOrder = "plumbline.v1.log.MapOrder".record::<records::MapOrder>().log("/order/map").input();
    /// Main part of an estimate.
    Estimate = "plumbline.v1.log.Estimate".record::<records::Estimate>().log("/output/estimate").kind(17, Always);
    /// Pose of the odometry frame in the map.
    MapEstimate = "plumbline.v1.log.MapEstimate".record::<records::MapEstimate>().log("/output/map").kind(20, Asked).key("map/correction", Data, [5.0, 5.0, 1.0]);
    /// Odometry at the rate of the IMU.
    Odometry = "plumbline.v1.log.Odometry".record::<records::Odometry>().log("/output/odometry").kind(16, Always).key("odom", RealTime, [f64::INFINITY, 50.0, 10.0]);
    /// Position of the body, to be drawn.
    Transform = "foxglove.FrameTransform".log("/tf");
    /// Pose of the body, to be drawn.
    Pose = "foxglove.PoseInFrame".log("/pose");
    /// Events.
    Event = "foxglove.Log".log("/event");
    /// State of the recording.
    Recording = "plumbline.v1.log.Recording".record::<records::Recording>().log("/recorder");
    /// Calibration of the left camera.
    LeftCalibration = "foxglove.CameraCalibration".log("/calibration/left");
    /// Calibration of the right camera.
    RightCalibration = "foxglove.CameraCalibration".log("/calibration/right");
    /// Where cameras and vehicle are on the body.
    Mounting = "foxglove.FrameTransforms".log("/tf_static");

    /// Greeting, first on every connection.
    Hello = "".kind(1, Other);
    /// Count of the records that this reader has lost.
    Lost = "".kind(2, Other);
    /// Answer to a request.
    Result = "".kind(3, Other);
    /// Configuration in force, once on each subscription.
    Configuration = "plumbline.v1.Configuration".record::<records::Configuration>().kind(18, Asked).answers("config");
    /// Complete estimate, with figures of the frame's processing.
    FullEstimate = "plumbline.v1.FullEstimate".record::<records::FullEstimate>().kind(19, Asked).key("state", DataHigh, [f64::INFINITY, 10.0, 1.0]);
    /// Keyframes and landmarks of the window, after each keyframe.
    Window = "plumbline.v1.Window".record::<records::MapSnapshot>().kind(21, Asked).key("scene", DataLow, [2.0, 1.0, 0.0]);
    /// Path corrected by loop closures, after each keyframe of the map.
    Path = "plumbline.v1.Path".record::<records::MapPath>().kind(22, Asked).key("map/path", Data, [1.0, 0.5, 0.1]).answers("map/path");
    /// Rung of the degradation ladder, on subscription and on change.
    Ladder = "plumbline.v1.Ladder".record::<records::Ladder>().kind(23, Asked);
    /// Left camera picture with what is tracked in it, while somebody asks for it.
    Picture = "plumbline.v1.Picture".record::<records::Picture>().kind(24, Other).key("camera", Background, [5.0, 2.0, 0.0]);
    /// End of the flight.
    End = "".kind(25, Other);
    /// State of live sensors, on subscription and on change: clocks of the stamps, faults, what the data show to be wrong.
    Sensors = "plumbline.v1.Sensors".record::<records::SensorNews>().kind(26, Asked);

    /// Health: state, bits, rates, notices; also on change.
    Health = "plumbline.v1.Health".record::<records::Health>().key("health", InteractiveHigh, [5.0, 5.0, 1.0]);
    /// Keyframe that has left the window, with its landmarks as last estimated.
    Keyframe = "plumbline.v1.Window".record::<records::MapSnapshot>().key("map/keyframe", Data, ALL_OF_IT).answers_each("map/keyframe");
    /// Poses of the past.
    Trajectory = "plumbline.v1.Trajectory".record::<records::Trajectory>().answers_each("trajectory");
    /// The vehicle's clock.
    Clock = "plumbline.v1.Clock".record::<records::Clock>().answers("clock");
    /// Resets the estimator: `?kind=soft` keeps the pose, `?kind=hard` starts at the origin.
    Reset = "plumbline.v1.ResetDone".record::<records::ResetDone>().commands("command/reset");
    /// Writes the map to the file that the vehicle was started with.
    MapSave = "plumbline.v1.MapSaved".record::<records::MapSaved>().commands("command/map_save");
}

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
    #[must_use]
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

    /// Whether people look at it: its schema is one of Foxglove's.
    #[must_use]
    pub fn is_drawn(self) -> bool {
        self.row().message.starts_with("foxglove.")
    }

    /// Whether a re-execution needs it.
    #[must_use]
    pub const fn is_input(self) -> bool {
        self.row().is_input
    }

    /// Whether it holds images of a log.
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
    #[must_use]
    pub fn of_kind(kind: u16) -> Option<Self> {
        Self::ALL.into_iter().find(|topic| kind > 0 && topic.kind() == kind)
    }

    /// Topics that are published on a key of the network.
    pub fn published() -> impl Iterator<Item = (Self, Key)> {
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
