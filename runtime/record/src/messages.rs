//! Messages that are in no log: what the local socket and the network carry besides, each field once.
//!
//! Types of the estimator have their tables here, others are defined by them. Frames, units and rules are those of
//! [`tables`](crate::tables).

use crate::fields::{Field, Part, Parts, Record, Value};
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use plumbline_config::Timestamp;
use plumbline_drivers::clock::StampFigures;
use plumbline_estimator::places::mapper::path::{LoopEnd, MapPath, PathPose};
use plumbline_estimator::window::snapshot::{MapSnapshot, SnapshotKeyframe, SnapshotLine, SnapshotPoint};
use plumbline_estimator::{HealthBits, TrackingState, Trail, TrailState};

message! {
    /// What every message on a key of the network comes in. The message itself is that of log or local socket, byte by byte.
    Envelope as "Envelope";
    /// Measurement time, ns on the sensors' time axis.
    1 stamp_ns: i64;
    /// Time of publication by the vehicle's system clock, ns since 1970.
    2 published_ns: i64;
    /// Counts the messages of this key: a jump tells of lost ones.
    3 sequence: u64;
    /// Counts resets: the pose may jump when it changes.
    4 reset_counter: u32;
    /// -1 failed, else 0 to 100; 0 in messages that have none.
    5 quality: i8;
    /// The message.
    6 message: Vec<u8>;
}

impl Envelope {
    /// Envelope of a record and its message, with the stamp, the count of resets and the quality that the record has.
    #[must_use]
    pub fn around(record: &dyn Parts, message: Vec<u8>, sequence: u64, published_ns: i64) -> Self {
        let mut envelope = Self { published_ns, sequence, message, ..Self::default() };
        envelope.look(record);
        envelope
    }

    /// Measurement time.
    #[must_use]
    pub const fn stamp(&self) -> Timestamp {
        Timestamp::from_nanos(self.stamp_ns)
    }

    fn look(&mut self, record: &dyn Parts) {
        record.visit(&mut |about, value| match (about.wire, value) {
            ("stamp_ns", Value::Whole(stamp_ns)) => self.stamp_ns = stamp_ns,
            ("reset_counter", Value::Whole(count)) => self.reset_counter = count as u32,
            ("quality", Value::Whole(quality)) => self.quality = quality as i8,
            (_, Value::Part(part)) => self.look(part),
            _ => {}
        });
    }
}

message! {
    /// Configuration in force.
    Configuration as "Configuration";
    /// TOML, every key.
    1 toml: String;
    /// SHA-256 of `toml`, hexadecimal.
    2 sha256: String;
    /// Stamps are CLOCK_MONOTONIC of the vehicle's computer; otherwise those of a recording or simulation.
    3 stamps_of_host: bool;
    /// Version of the program.
    4 version: String;
}

record! {
    /// A keyframe of the window. No two share a stamp.
    SnapshotKeyframe as "WindowKeyframe",
    blank Self { stamp: Timestamp::default(), pose_o_b: Isometry3::identity() };
    1 stamp as "stamp_ns";
    /// Body in O: x y z qx qy qz qw.
    2 pose_o_b as "pose_o_b";
}

record! {
    /// A point of the window.
    SnapshotPoint as "WindowPoint", blank Self { host: Timestamp::default(), p_o: Vector3::zeros() };
    /// Stamp of the keyframe that hosts it.
    1 host as "host_ns";
    /// x y z in O, m.
    2 p_o as "position_o", [.single()];
}

record! {
    /// A line of the window.
    SnapshotLine as "WindowLine", blank Self { host: Timestamp::default(), ends_o: [Vector3::zeros(); 2] };
    /// Stamp of the keyframe that hosts it.
    1 host as "host_ns";
    /// Both ends, x y z x y z in O, m.
    2 ends_o as "ends_o", [.single()];
}

record! {
    /// Keyframes and landmarks of the window, after each keyframe; on `map/keyframe` a keyframe that has left it, with its own
    /// landmarks as last estimated, which never changes again.
    MapSnapshot as "Window", blank Self::default();
    1 stamp as "stamp_ns";
    2 reset_counter as "reset_counter";
    3 keyframes as "keyframes", [.at_most(64)];
    4 points as "points", [.at_most(10_000)];
    5 lines as "lines", [.at_most(5_000)];
}

record! {
    /// A state of the trail.
    TrailState as "TrailState",
    blank Self { stamp: Timestamp::default(), pose_o_b: Isometry3::identity(), v_o_b: Vector3::zeros() };
    1 stamp as "stamp_ns";
    /// Body in O: x y z qx qy qz qw.
    2 pose_o_b as "pose_o_b";
    /// m/s, in O.
    3 v_o_b as "velocity_o_b";
}

record! {
    /// Trail of the last seconds: the states of the frames in the window as they are known now, oldest first.
    Trail as "Trail", blank Self::default();
    1 stamp as "stamp_ns";
    2 reset_counter as "reset_counter";
    3 states as "states", [.at_most(64)];
}

record! {
    /// A keyframe on the corrected path.
    PathPose as "PathPose",
    blank Self { stamp: Timestamp::default(), reset_counter: 0, pose_m_b: Isometry3::identity() };
    1 stamp as "stamp_ns";
    /// Count of resets: where it changes, the path is broken.
    2 reset_counter as "reset_counter";
    /// Body in M: x y z qx qy qz qw.
    3 pose_m_b as "pose_m_b", [.single()];
}

record! {
    /// One end of a loop: a keyframe of this flight.
    LoopEnd as "LoopEnd", blank Self { stamp: Timestamp::default(), p_m_b: Vector3::zeros() };
    1 stamp as "stamp_ns";
    /// Body in M, x y z, m.
    2 p_m_b as "position_m", [.single()];
}

impl Record for [LoopEnd; 2] {
    const NAME: &'static str = "Loop";
    const ABOUT: &'static str = "A place that was seen again.";
    const FIELDS: &'static [Field<Self>] = &[
        Field::new(
            (1, "seen", "seen", "The keyframe that was seen again."),
            LoopEnd::SHAPE,
            |o| Part::get(&o[0]),
            |o, value| o[0].set(value),
        ),
        Field::new(
            (2, "seen_by", "seen_by", "The keyframe that saw it."),
            LoopEnd::SHAPE,
            |o| Part::get(&o[1]),
            |o, value| o[1].set(value),
        ),
    ];

    fn blank() -> Self {
        [LoopEnd::blank(); 2]
    }
}

record! {
    /// Path corrected by loop closures, as a whole, after each keyframe of the map.
    MapPath as "Path", blank Self::new(0);
    /// Keyframes of this flight whose place in the map is known, oldest first; at most 2000, evenly thinned out.
    1 poses as "poses", [.at_most(2_000)];
    /// The newest loops that count, at most 2000. What was seen again of a loaded map is not among them.
    2 loops as "loops", [.at_most(2_000)];
    /// How far the odometry alone would have put the newest keyframe from where the map has it, counted from the beginning of
    /// its piece of unbroken odometry, m; empty while its place in the map is not known.
    3 drift_m as "drift_m";
    // The limit of the list.
    besides { .. };
}

message! {
    /// Rung of the degradation ladder, when it changes.
    Ladder as "Ladder";
    /// Steps down from full work.
    1 level: u32;
    /// Name of the rung.
    2 name: String;
}

record! {
    /// Stamps of a live sensor.
    StampFigures as "Stamps", blank Self::default();
    /// Frames or samples that were handed out.
    1 used as "used";
    /// Stamped by their arrival, since their stamp was of no clock of this computer.
    2 restamped as "restamped";
    /// Dropped, since their stamp was repeated, went back, or was of no use.
    3 refused as "refused";
    besides { problem: _ };
}

message! {
    /// Live sensors, once for each subscription and on change.
    SensorNews as "Sensors";
    /// What is wrong, and what to do: one line each.
    1 notices: Vec<String>, [.at_most(16)];
    /// Stamps of the frames.
    2 frames: StampFigures;
    /// Stamps of the inertial samples.
    3 samples: StampFigures;
}

message! {
    /// Left image with what is tracked in it: grey levels on the local socket, a JPEG on the network.
    Picture as "Picture";
    /// Sequence number of the frame.
    1 frame: u64;
    /// Time of the frame, on the IMU's time axis.
    2 stamp_ns: Timestamp;
    /// Width, px.
    3 width_px: u32;
    /// Height, px.
    4 height_px: u32;
    /// Grey levels, row by row.
    5 pixels: Vec<u8>;
    /// x, y (px) and age (frames) of each point.
    6 points: Vec<[f32; 3]>;
    /// Both ends of each line, px.
    7 lines: Vec<[f32; 4]>;
    /// JPEG image.
    8 jpeg: Vec<u8>;
}

message! {
    /// Health of a vehicle, five times a second (once over radio) and on change.
    Health as "Health";
    /// How far the estimator is.
    1 state: TrackingState;
    /// Error and warning bits.
    2 bits: HealthBits;
    /// Frames a second over the last second.
    3 frame_rate_hz: f64, [.one()];
    /// Computation of the last frame, ms.
    4 frame_ms: f64, [.one()];
    /// Messages dropped because the network was slower than the vehicle.
    5 dropped: u64;
    /// Rung of the degradation ladder.
    6 ladder: Ladder;
    /// Keyframes that left the window so far: who has fewer asks for those that are missing.
    7 keyframes: u64;
    /// Messages on map/path so far: who has an older one asks for the newest.
    8 paths: u64;
    /// The vehicle sends camera pictures to whom it may concern.
    9 offers_camera: bool;
    /// How the IMU is mounted: takes coordinates from B to V (`vehicle.imu_to_vehicle_deg` of the configuration). The rotation from V
    /// to O is that from B to O times the inverse of this. Empty where it is unknown: then nothing is known of the vehicle's attitude.
    10 rot_v_b: Option<UnitQuaternion<f64>>;
    /// Live sensors, and what is wrong beyond the bits.
    11 sensors: SensorNews;
}

message! {
    /// Poses of frames that the vehicle still holds, oldest first.
    Trajectory as "Trajectory";
    /// The poses.
    1 poses: Vec<PastPose>;
}

record! {
    /// A pose of the past.
    PastPose as "PastPose", blank Self { stamp: Timestamp::default(), pose_o_b: Isometry3::identity(), reset_counter: 0 };
    1 stamp as "stamp_ns";
    /// Body in O: x y z qx qy qz qw.
    2 pose_o_b as "pose_o_b";
    3 reset_counter as "reset_counter";
}

/// A pose of the past.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PastPose {
    /// Measurement time.
    pub stamp: Timestamp,
    /// Pose of the body in the odometry frame.
    pub pose_o_b: Isometry3<f64>,
    /// Resets so far.
    pub reset_counter: u32,
}

message! {
    /// For the offset between two clocks. The asker notes when it asked and when the answer came.
    Clock as "Clock";
    /// When the vehicle saw the question, ns since 1970 by its system clock.
    1 received_ns: i64;
    /// When it answered.
    2 answered_ns: i64;
}

message! {
    /// Answer of a reset.
    ResetDone as "ResetDone";
    /// Count of resets after it.
    1 reset_counter: u32;
    /// The outcome in words.
    2 words: String;
}

message! {
    /// Answer of a map that was saved.
    MapSaved as "MapSaved";
    /// Keyframes of the map.
    1 keyframes: u32;
    /// The outcome in words.
    2 words: String;
}
