//! The topics: everything that a flight says, each with every way on which it is said.
//!
//! A row names the message and, where there is one, the channel of the log, the kind of the local socket, the key of the network
//! with its quality of service and its rates, and the question that is answered with it. Log, local socket, network process,
//! station, fuzzers and tests go over these rows; the table of messages in docs/guide.md is made of them.

use crate::event::Event;
use crate::fields::{Parts, Value};
use crate::said::{Kind, Told};
use plumbline_config::Timestamp;
use plumbline_config::options::{ImageRecording, Link};

pub use crate::row::{Decode, Key, Priority, Question, Row, Subscription};

/// Defines the topics by their rows: description, name, the variant of [`Said`] and its type where a stage says it, message, ways.
macro_rules! topics {
    ($($(#[doc = $about:literal])+ $topic:ident $(($said:ident: $held:ty))? = $message:literal $(. $way:ident $(::<$record:ty>)? ($($of:tt)*))*;)*) => {
        /// Something that a flight says.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
        pub enum Topic {
            $($(#[doc = $about])+ $topic,)*
        }

        /// Input, order, output or event of a flight: a value of fixed size, copied without allocation. Images are handed over
        /// apart.
        // The estimate is the largest by far, and boxing it would allocate.
        #[allow(clippy::large_enum_variant)]
        #[derive(Clone, Debug)]
        pub enum Said {
            $($(
                #[doc = concat!("Record of [`Topic::", stringify!($topic), "`].")]
                $said($held),
            )?)*
        }

        impl Said {
            /// Its topic.
            #[must_use]
            pub const fn topic(&self) -> Topic {
                match self {
                    $($(Self::$said(_) => Topic::$topic,)?)*
                }
            }

            /// Its record; none for an event, which is drawn.
            #[must_use]
            pub fn record(&self) -> Option<&dyn Parts> {
                match self {
                    $($(Self::$said(record) => Told::record(record),)?)*
                }
            }
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
    pub use crate::orders::{CorrectionOrder, FrameOrder, InstantAnswer, InstantOrder, MapOrder, ResetOrder};
    pub use crate::parts::{FrameAbout, Recording};
    pub use crate::said::FullEstimate;
    pub use plumbline_drivers::ImuReading;
    pub use plumbline_estimator::places::{MapEstimate, MapPath};
    pub use plumbline_estimator::{Estimate, MapSnapshot, Odometry, Trail};
}

use crate::row::ALL_OF_IT;
use Priority::{Background, Data, DataHigh, DataLow, InteractiveHigh, RealTime};
use Subscription::{Always, Asked, Other};

// Those of the log come first, in the order that seals of logs have: new ones come last among them.
topics! {
    /// Inertial samples.
    Imu (Imu: records::ImuReading) = "plumbline.v1.log.Imu".record::<records::ImuReading>().log("/input/imu").input();
    /// Left images.
    Left = "foxglove.CompressedImage".log("/input/left").input();
    /// Right images.
    Right = "foxglove.CompressedImage".log("/input/right").input();
    /// Frames: number, stamp, hashes of the images.
    Frame = "plumbline.v1.log.Frame".record::<records::FrameAbout>().log("/input/frame").input();
    /// What became of frames.
    FrameOrder (Order: records::FrameOrder) = "plumbline.v1.log.FrameOrder".record::<records::FrameOrder>().log("/order/frame").input();
    /// When estimates took effect.
    CorrectionOrder (Correction: records::CorrectionOrder) = "plumbline.v1.log.CorrectionOrder".record::<records::CorrectionOrder>().log("/order/correction").input();
    /// Resets.
    ResetOrder (Reset: records::ResetOrder) = "plumbline.v1.log.ResetOrder".record::<records::ResetOrder>().log("/order/reset").input();
    /// What became of frames for the map.
    MapOrder (MapOrder: records::MapOrder) = "plumbline.v1.log.MapOrder".record::<records::MapOrder>().log("/order/map").input();
    /// Main part of an estimate.
    Estimate = "plumbline.v1.log.Estimate".record::<records::Estimate>().log("/output/estimate").kind(17, Always);
    /// Pose of the odometry frame in the map.
    MapEstimate (MapEstimate: records::MapEstimate) = "plumbline.v1.log.MapEstimate".record::<records::MapEstimate>().log("/output/map").kind(20, Asked).key("map/correction", Data, [5.0, 5.0, 1.0]);
    /// Odometry at the rate of the IMU.
    Odometry (Odometry: records::Odometry) = "plumbline.v1.log.Odometry".record::<records::Odometry>().log("/output/odometry").kind(16, Always).key("odom", RealTime, [f64::INFINITY, 50.0, 10.0]);
    /// Position of the body, to be drawn.
    Transform = "foxglove.FrameTransform".log("/tf");
    /// Pose of the body, to be drawn.
    Pose = "foxglove.PoseInFrame".log("/pose");
    /// Events.
    Event (Event: Event) = "foxglove.Log".log("/event");
    /// State of the recording.
    Recording = "plumbline.v1.log.Recording".record::<records::Recording>().log("/recorder");
    /// Calibration of the left camera.
    LeftCalibration = "foxglove.CameraCalibration".log("/calibration/left");
    /// Calibration of the right camera.
    RightCalibration = "foxglove.CameraCalibration".log("/calibration/right");
    /// Where cameras and vehicle are on the body.
    Mounting = "foxglove.FrameTransforms".log("/tf_static");
    /// When states at instants were asked for.
    InstantOrder (InstantOrder: records::InstantOrder) = "plumbline.v1.log.InstantOrder".record::<records::InstantOrder>().log("/order/instant").input();
    /// State at an instant that was asked for: to the one who asked, and on subscription those of camera triggers.
    Instant (Instant: records::InstantAnswer) = "plumbline.v1.log.Instant".record::<records::InstantAnswer>().log("/output/instant").kind(27, Asked);

    /// Greeting, first on every connection.
    Hello = "".kind(1, Other);
    /// Count of the records that this reader has lost.
    Lost = "".kind(2, Other);
    /// Answer to a request.
    Result = "".kind(3, Other);
    /// Configuration in force, once on each subscription.
    Configuration = "plumbline.v1.Configuration".record::<records::Configuration>().kind(18, Asked).answers("config");
    /// Complete estimate, with figures of the frame's processing.
    FullEstimate (Estimate: records::FullEstimate) = "plumbline.v1.FullEstimate".record::<records::FullEstimate>().kind(19, Asked).key("state", DataHigh, [f64::INFINITY, 10.0, 1.0]);
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
    /// Trail of the last seconds, smoothed: the poses of the window as they are known now, after each frame.
    Trail = "plumbline.v1.Trail".record::<records::Trail>().kind(28, Asked);

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

impl Said {
    /// Its kind, as it is counted when it is dropped.
    #[must_use]
    pub fn kind(&self) -> Kind {
        match self {
            Self::Imu(_) => Kind::Imu,
            Self::Order(_)
            | Self::Correction(_)
            | Self::Reset(_)
            | Self::MapOrder(_)
            | Self::InstantOrder(_) => Kind::Order,
            Self::Instant(_) => Kind::Instant,
            Self::Estimate(_) => Kind::Estimate,
            Self::Odometry(_) => Kind::Odometry,
            Self::MapEstimate(_) => Kind::MapEstimate,
            // What nothing depends on.
            _ => Kind::Event,
        }
    }

    /// Its measurement time; none for an order, which has no time of its own.
    #[must_use]
    pub fn stamp(&self) -> Option<Timestamp> {
        let mut stamp = None;
        self.record()?.visit(&mut |about, value| {
            if let ("stamp_ns", Value::Whole(ns)) = (about.wire, value) {
                stamp = Some(Timestamp::from_nanos(ns));
            }
        });
        stamp
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
