//! Messages of a flight: the table of topics, and the messages whose types are no other crate's.
//!
//! A new message is a struct here, or where it is made, and a row of the table.

use crate::event::Event;
use crate::orders::{CorrectionOrder, FrameOrder, InstantAnswer, InstantOrder, MapOrder, ResetOrder};
use crate::parts::{FrameAbout, RecordingState};
use crate::row::ALL_OF_IT;
use crate::row::Priority::{Background, Data, DataHigh, DataLow, InteractiveHigh, RealTime};
use crate::row::Subscription::{Always, Asked, Other};
use crate::said::FullEstimate;
use nalgebra::{Isometry3, UnitQuaternion};
use plumbline_config::Timestamp;
use plumbline_estimator::places::{MapEstimate, MapPath};
use plumbline_estimator::{Estimate, HealthBits, MapSnapshot, Odometry, TrackingState, Trail};
use plumbline_fields::{ImuReading, Parts, Record, StampFigures, Value};

// Those of the log come first, in the order that seals of logs have: new ones come last among them.
topics! {
    /// Inertial samples.
    Imu (Imu: ImuReading) = "plumbline.v1.log.Imu".record::<ImuReading>().log("/input/imu").input();
    /// Left images.
    Left = "foxglove.CompressedImage".log("/input/left").input();
    /// Right images.
    Right = "foxglove.CompressedImage".log("/input/right").input();
    /// Frames: number, stamp, hashes of the images.
    Frame = "plumbline.v1.log.Frame".record::<FrameAbout>().log("/input/frame").input();
    /// Fate of frames.
    FrameOrder (Order: FrameOrder) = "plumbline.v1.log.FrameOrder".record::<FrameOrder>().log("/order/frame").input();
    /// When estimates took effect.
    CorrectionOrder (Correction: CorrectionOrder) = "plumbline.v1.log.CorrectionOrder".record::<CorrectionOrder>().log("/order/correction").input();
    /// Resets.
    ResetOrder (Reset: ResetOrder) = "plumbline.v1.log.ResetOrder".record::<ResetOrder>().log("/order/reset").input();
    /// Fate of frames for the map.
    MapOrder (MapOrder: MapOrder) = "plumbline.v1.log.MapOrder".record::<MapOrder>().log("/order/map").input();
    /// Main part of an estimate.
    Estimate = "plumbline.v1.log.Estimate".record::<Estimate>().log("/output/estimate").kind(17, Always);
    /// Pose of the odometry frame in the map.
    MapEstimate (MapEstimate: MapEstimate) = "plumbline.v1.log.MapEstimate".record::<MapEstimate>().log("/output/map").kind(20, Asked).key("map/correction", Data, [5.0, 5.0, 1.0]);
    /// Odometry at the rate of the IMU.
    Odometry (Odometry: Odometry) = "plumbline.v1.log.Odometry".record::<Odometry>().log("/output/odometry").kind(16, Always).key("odom", RealTime, [f64::INFINITY, 50.0, 10.0]);
    /// Position of the body, to be drawn.
    Transform = "foxglove.FrameTransform".log("/tf");
    /// Pose of the body, to be drawn.
    Pose = "foxglove.PoseInFrame".log("/pose");
    /// Events.
    Event (Event: Event) = "foxglove.Log".log("/event");
    /// State of the recording.
    Recording = "plumbline.v1.log.Recording".record::<RecordingState>().log("/recorder");
    /// Calibration of the left camera.
    LeftCalibration = "foxglove.CameraCalibration".log("/calibration/left");
    /// Calibration of the right camera.
    RightCalibration = "foxglove.CameraCalibration".log("/calibration/right");
    /// Where cameras and vehicle are on the body.
    Mounting = "foxglove.FrameTransforms".log("/tf_static");
    /// When states at instants were asked for.
    InstantOrder (InstantOrder: InstantOrder) = "plumbline.v1.log.InstantOrder".record::<InstantOrder>().log("/order/instant").input();
    /// State at an instant that was asked for: to the one who asked, and on subscription those of camera triggers.
    Instant (Instant: InstantAnswer) = "plumbline.v1.log.Instant".record::<InstantAnswer>().log("/output/instant").kind(27, Asked);

    /// Greeting, first on every connection.
    Hello = "".kind(1, Other);
    /// Count of the records that this reader has lost.
    Lost = "".kind(2, Other);
    /// Answer to a request.
    Result = "".kind(3, Other);
    /// Configuration in force, once on each subscription.
    Configuration = "plumbline.v1.Configuration".record::<Configuration>().kind(18, Asked).answers("config");
    /// Complete estimate, with figures of the frame's processing.
    FullEstimate (Estimate: FullEstimate) = "plumbline.v1.FullEstimate".record::<FullEstimate>().kind(19, Asked).key("state", DataHigh, [f64::INFINITY, 10.0, 1.0]);
    /// Keyframes and landmarks of the window, after each keyframe.
    Window = "plumbline.v1.Window".record::<MapSnapshot>().kind(21, Asked).key("scene", DataLow, [2.0, 1.0, 0.0]);
    /// Path corrected by loop closures, after each keyframe of the map.
    Path = "plumbline.v1.Path".record::<MapPath>().kind(22, Asked).key("map/path", Data, [1.0, 0.5, 0.1]).answers("map/path");
    /// Rung of the degradation ladder, on subscription and on change.
    Ladder = "plumbline.v1.Ladder".record::<LadderRung>().kind(23, Asked);
    /// Left camera picture with what is tracked in it, while somebody asks for it.
    Picture = "plumbline.v1.Picture".record::<Picture>().kind(24, Other).key("camera", Background, [5.0, 2.0, 0.0]);
    /// End of the flight.
    End = "".kind(25, Other);
    /// State of live sensors, on subscription and on change: clocks of the stamps, faults, what the data show to be wrong.
    Sensors = "plumbline.v1.Sensors".record::<SensorNews>().kind(26, Asked);
    /// Trail of the last seconds, smoothed: the poses of the window as they are known now, after each frame.
    Trail = "plumbline.v1.Trail".record::<Trail>().kind(28, Asked);

    /// Health: state, bits, rates, notices; also on change.
    Health = "plumbline.v1.Health".record::<Health>().key("health", InteractiveHigh, [5.0, 5.0, 1.0]);
    /// Keyframe that has left the window, with its landmarks as last estimated.
    Keyframe = "plumbline.v1.Window".record::<MapSnapshot>().key("map/keyframe", Data, ALL_OF_IT).answers_each("map/keyframe");
    /// Poses of the past.
    Trajectory = "plumbline.v1.Trajectory".record::<PastTrajectory>().answers_each("trajectory");
    /// The vehicle's clock.
    Clock = "plumbline.v1.Clock".record::<Clock>().answers("clock");
    /// Resets the estimator: `?kind=soft` keeps the pose, `?kind=hard` starts at the origin.
    Reset = "plumbline.v1.ResetDone".record::<ResetDone>().commands("command/reset");
    /// Writes the map to the file that the vehicle was started with.
    MapSave = "plumbline.v1.MapSaved".record::<MapSaved>().commands("command/map_save");
}

/// Envelope of every message on a key of the network. The message itself is that of log or local socket, byte by byte.
#[derive(Clone, Debug, Default, PartialEq, Record)]
#[record("Envelope")]
pub struct Envelope {
    /// Measurement time, ns on the sensors' time axis.
    #[field(1)]
    pub stamp_ns: i64,
    /// Time of publication by the vehicle's system clock, ns since 1970.
    #[field(2)]
    pub published_ns: i64,
    /// Counts the messages of this key: a jump tells of lost ones.
    #[field(3)]
    pub sequence: u64,
    /// Counts resets: the pose may jump when it changes.
    #[field(4)]
    pub reset_counter: u32,
    /// -1 failed, else 0 to 100; 0 in messages that have none.
    #[field(5)]
    pub quality: i8,
    /// The message.
    #[field(6)]
    pub message: Vec<u8>,
}

impl Envelope {
    /// Envelope of a record and its message, with the stamp, the count of resets and the quality that the record has.
    pub fn around(record: &dyn Parts, message: Vec<u8>, sequence: u64, published_ns: i64) -> Self {
        let mut envelope = Self { published_ns, sequence, message, ..Self::default() };
        envelope.look(record);
        envelope
    }

    /// Measurement time.
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

/// Configuration in force.
#[derive(Clone, Debug, Default, PartialEq, Record)]
#[record("Configuration")]
pub struct Configuration {
    /// TOML, every key.
    #[field(1)]
    pub toml: String,
    /// SHA-256 of `toml`, hexadecimal.
    #[field(2)]
    pub sha256: String,
    /// Stamps are CLOCK_MONOTONIC of the vehicle's computer; otherwise those of a recording or simulation.
    #[field(3)]
    pub stamps_of_host: bool,
    /// Version of the program.
    #[field(4)]
    pub version: String,
}

/// Rung of the degradation ladder, when it changes.
#[derive(Clone, Debug, Default, PartialEq, Record)]
#[record("Ladder")]
pub struct LadderRung {
    /// Steps down from full work.
    #[field(1)]
    pub level: u32,
    /// Name of the rung.
    #[field(2)]
    pub name: String,
}

/// Live sensors, once for each subscription and on change.
#[derive(Clone, Debug, Default, PartialEq, Record)]
#[record("Sensors")]
pub struct SensorNews {
    /// Fault and cure: one line each.
    #[field(1, most = 16)]
    pub notices: Vec<String>,
    /// Stamps of the frames.
    #[field(2)]
    pub frames: StampFigures,
    /// Stamps of the inertial samples.
    #[field(3)]
    pub samples: StampFigures,
}

/// Left image with what is tracked in it: grey levels on the local socket, a JPEG on the network.
#[derive(Clone, Debug, Default, PartialEq, Record)]
#[record("Picture")]
pub struct Picture {
    /// Sequence number of the frame.
    #[field(1)]
    pub frame: u64,
    /// Time of the frame, on the IMU's time axis.
    #[field(2)]
    pub stamp_ns: Timestamp,
    /// Width, px.
    #[field(3)]
    pub width_px: u32,
    /// Height, px.
    #[field(4)]
    pub height_px: u32,
    /// Grey levels, row by row.
    #[field(5)]
    pub pixels: Vec<u8>,
    /// x, y (px) and age (frames) of each point.
    #[field(6)]
    pub points: Vec<[f32; 3]>,
    /// Both ends of each line, px.
    #[field(7)]
    pub lines: Vec<[f32; 4]>,
    /// JPEG image.
    #[field(8)]
    pub jpeg: Vec<u8>,
}

/// Health of a vehicle, five times a second (once over radio) and on change.
#[derive(Clone, Debug, Default, PartialEq, Record)]
#[record("Health")]
pub struct Health {
    /// Progress of the estimator.
    #[field(1)]
    pub state: TrackingState,
    /// Error and warning bits.
    #[field(2)]
    pub bits: HealthBits,
    /// Frames a second over the last second.
    #[field(3, one)]
    pub frame_rate_hz: f64,
    /// Computation of the last frame, ms.
    #[field(4, one)]
    pub frame_ms: f64,
    /// Messages dropped because the network was slower than the vehicle.
    #[field(5)]
    pub dropped: u64,
    /// Rung of the degradation ladder.
    #[field(6)]
    pub ladder: LadderRung,
    /// Keyframes that left the window so far: who has fewer asks for those that are missing.
    #[field(7)]
    pub keyframes: u64,
    /// Messages on map/path so far: who has an older one asks for the newest.
    #[field(8)]
    pub paths: u64,
    /// The vehicle sends camera pictures to whom it may concern.
    #[field(9)]
    pub offers_camera: bool,
    /// Mounting of the IMU: takes coordinates from B to V (`vehicle.imu_to_vehicle_deg` of the configuration). The rotation from V
    /// to O is that from B to O times the inverse of this. Empty where it is unknown: then nothing is known of the vehicle's attitude.
    #[field(10)]
    pub rot_v_b: Option<UnitQuaternion<f64>>,
    /// Live sensors, and what is wrong beyond the bits.
    #[field(11)]
    pub sensors: SensorNews,
}

/// Poses of frames that the vehicle still holds, oldest first.
#[derive(Clone, Debug, Default, PartialEq, Record)]
#[record("Trajectory")]
pub struct PastTrajectory {
    /// The poses.
    #[field(1)]
    pub poses: Vec<PastPose>,
}

/// A pose of the past.
#[derive(Clone, Copy, Debug, Default, PartialEq, Record)]
#[record("PastPose")]
pub struct PastPose {
    /// Measurement time.
    #[field(1, wire = "stamp_ns")]
    pub stamp: Timestamp,
    /// Pose of the body in the odometry frame.
    #[field(2)]
    pub pose_o_b: Isometry3<f64>,
    /// Resets so far.
    #[field(3)]
    pub reset_counter: u32,
}

/// For the offset between two clocks. The asker notes when it asked and when the answer came.
#[derive(Clone, Debug, Default, PartialEq, Record)]
#[record("Clock")]
pub struct Clock {
    /// When the vehicle saw the question, ns since 1970 by its system clock.
    #[field(1)]
    pub received_ns: i64,
    /// When it answered.
    #[field(2)]
    pub answered_ns: i64,
}

/// Answer of a reset.
#[derive(Clone, Debug, Default, PartialEq, Record)]
#[record("ResetDone")]
pub struct ResetDone {
    /// Count of resets after it.
    #[field(1)]
    pub reset_counter: u32,
    /// The outcome in words.
    #[field(2)]
    pub words: String,
}

/// Answer of a map that was saved.
#[derive(Clone, Debug, Default, PartialEq, Record)]
#[record("MapSaved")]
pub struct MapSaved {
    /// Keyframes of the map.
    #[field(1)]
    pub keyframes: u32,
    /// The outcome in words.
    #[field(2)]
    pub words: String,
}
