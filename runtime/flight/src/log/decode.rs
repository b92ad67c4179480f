//! From the messages of a log back to the words of the runtime; what does not fit is refused with a reason.

use super::entry::{Dropped, Kind};
use super::proto;
use crate::pipeline::orders::{CorrectionOrder, FrameOrder, MapOrder, MapVerdict, ResetOrder, Verdict};
use nalgebra::{Isometry3, Quaternion, UnitQuaternion, Vector3};
use plumbline_config::{ImuSample, Timestamp};
use plumbline_drivers::ImuReading;
use plumbline_estimator::places::MapEstimate;
use plumbline_estimator::{
    BiasVariances, Estimate, FrameFigures, HealthBits, NavCovariance, Odometry, OriginUncertainty, ResetKind,
    TrackingState,
};
use prost::Message;

/// What a message must be turned into.
pub trait FromLog: Sized {
    /// The message of the log.
    type Message: Message + Default;

    /// The value of a message.
    ///
    /// # Errors
    /// When the message is not one that a recorder writes: what is wrong, in words.
    fn from_message(message: &Self::Message) -> Result<Self, &'static str>;

    /// The value of an encoded message.
    ///
    /// # Errors
    /// When the bytes are no such message.
    fn from_bytes(bytes: &[u8]) -> Result<Self, &'static str> {
        let message = Self::Message::decode(bytes).map_err(|_| "not a message of its schema")?;
        Self::from_message(&message)
    }
}

fn vector(values: &[f64]) -> Result<Vector3<f64>, &'static str> {
    let values: [f64; 3] = values.try_into().map_err(|_| "a vector has not three numbers")?;
    Ok(Vector3::from(values))
}

fn pose(values: &[f64]) -> Result<Isometry3<f64>, &'static str> {
    let [x, y, z, qx, qy, qz, qw]: [f64; 7] =
        values.try_into().map_err(|_| "a pose has not seven numbers")?;
    // As it was: normalising would change bits.
    let rotation = UnitQuaternion::new_unchecked(Quaternion::new(qw, qx, qy, qz));
    Ok(Isometry3::from_parts(Vector3::new(x, y, z).into(), rotation))
}

/// None in logs from before there were any: those of a sensor whose biases are known.
fn bias_variances(values: &[f64]) -> Result<BiasVariances, &'static str> {
    match values.len() {
        0 => Ok(BiasVariances::zeros()),
        6 => Ok(BiasVariances::from_column_slice(values)),
        _ => Err("the variances of the biases are not six numbers"),
    }
}

fn covariance(values: &[f64]) -> Result<NavCovariance, &'static str> {
    if values.len() == 81 {
        Ok(NavCovariance::from_column_slice(values))
    } else {
        Err("a covariance has not 81 numbers")
    }
}

fn state(state: i32) -> Result<TrackingState, &'static str> {
    match proto::State::try_from(state) {
        Ok(proto::State::Initialising) => Ok(TrackingState::Initialising),
        Ok(proto::State::Tracking) => Ok(TrackingState::Tracking),
        Ok(proto::State::Blind) => Ok(TrackingState::Blind),
        Ok(proto::State::Failed) => Ok(TrackingState::Failed),
        Ok(proto::State::Unspecified) | Err(_) => Err("an unknown state"),
    }
}

fn quality(quality: i32) -> Result<i8, &'static str> {
    i8::try_from(quality).map_err(|_| "a quality out of range")
}

impl FromLog for ImuReading {
    type Message = proto::Imu;

    fn from_message(m: &proto::Imu) -> Result<Self, &'static str> {
        let stamp = Timestamp::from_nanos(m.stamp_ns);
        let sample = ImuSample { stamp, gyro: vector(&m.gyro)?, accel: vector(&m.accel)? };
        Ok(Self { sequence: m.sequence, sample })
    }
}

impl FromLog for FrameOrder {
    type Message = proto::FrameOrder;

    fn from_message(m: &proto::FrameOrder) -> Result<Self, &'static str> {
        let level = u8::try_from(m.level).map_err(|_| "a level out of range")?;
        let verdict = match (m.lost, m.refused) {
            (true, _) => Verdict::Lost,
            (false, true) => Verdict::Refused,
            (false, false) => Verdict::Taken { level },
        };
        Ok(Self { frame: m.frame, readings_before: m.readings_before, verdict })
    }
}

impl FromLog for CorrectionOrder {
    type Message = proto::CorrectionOrder;

    fn from_message(m: &proto::CorrectionOrder) -> Result<Self, &'static str> {
        Ok(Self { frame: m.frame, readings_before: m.readings_before })
    }
}

impl FromLog for ResetOrder {
    type Message = proto::ResetOrder;

    fn from_message(m: &proto::ResetOrder) -> Result<Self, &'static str> {
        let kind = match proto::reset_order::Kind::try_from(m.kind) {
            Ok(proto::reset_order::Kind::Soft) => ResetKind::Soft,
            Ok(proto::reset_order::Kind::Hard) => ResetKind::Hard,
            Ok(proto::reset_order::Kind::Unspecified) | Err(_) => return Err("an unknown kind of reset"),
        };
        Ok(Self { kind, before_frame: m.before_frame, is_renewal: m.renewal })
    }
}

impl FromLog for MapOrder {
    type Message = proto::MapOrder;

    fn from_message(m: &proto::MapOrder) -> Result<Self, &'static str> {
        let verdict = match m.passed_over {
            true => MapVerdict::PassedOver,
            false => MapVerdict::Applied { at_frame: m.at_frame },
        };
        Ok(Self { frame: m.frame, verdict })
    }
}

impl FromLog for MapEstimate {
    type Message = proto::MapEstimate;

    fn from_message(m: &proto::MapEstimate) -> Result<Self, &'static str> {
        Ok(Self {
            frame_sequence: m.frame_sequence,
            stamp: Timestamp::from_nanos(m.stamp_ns),
            pose_m_o: if m.pose_m_o.is_empty() { None } else { Some(pose(&m.pose_m_o)?) },
            reset_counter: m.reset_counter,
            keyframes: m.keyframes,
            sightings: m.sightings,
            loops_used: m.loops_used,
        })
    }
}

impl FromLog for Estimate {
    type Message = proto::Estimate;

    fn from_message(m: &proto::Estimate) -> Result<Self, &'static str> {
        let [time_offset_s, time_offset_sigma_s] =
            m.time_offset_s.as_slice().try_into().map_err(|_| "a time offset has not two numbers")?;
        Ok(Self {
            frame_sequence: m.frame_sequence,
            stamp: Timestamp::from_nanos(m.stamp_ns),
            state: state(m.state)?,
            pose_o_b: pose(&m.pose_o_b)?,
            v_o_b: vector(&m.velocity_o_b)?,
            bias_gyro: vector(&m.bias_gyro)?,
            bias_accel: vector(&m.bias_accel)?,
            covariance: covariance(&m.covariance)?,
            // Its share is in the covariance.
            origin: OriginUncertainty::default(),
            bias_variances: bias_variances(&m.bias_variances)?,
            time_offset_s,
            time_offset_sigma_s,
            pose_b_c0: pose(&m.pose_b_c0)?,
            quality: quality(m.quality)?,
            health: HealthBits(m.health_bits),
            reset_counter: m.reset_counter,
            figures: figures(m.figures.as_ref().ok_or("an estimate without figures")?),
        })
    }
}

fn figures(m: &proto::Figures) -> FrameFigures {
    FrameFigures {
        points_tracked: m.points_tracked,
        points_stereo: m.points_stereo,
        points_in_window: m.points_in_window,
        lines_raw: m.lines_raw,
        lines_kept: m.lines_kept,
        lines_merged: m.lines_merged,
        lines_matched: m.lines_matched,
        lines_cut_short: m.lines_cut_short,
        lines_in_window: m.lines_in_window,
        lines_in_structure: m.lines_in_structure,
        keyframes: m.keyframes,
        iterations: m.iterations,
        is_keyframe: m.is_keyframe,
    }
}

impl FromLog for Odometry {
    type Message = proto::Odometry;

    fn from_message(m: &proto::Odometry) -> Result<Self, &'static str> {
        Ok(Self {
            sequence: m.sequence,
            stamp: Timestamp::from_nanos(m.stamp_ns),
            pose_o_b: pose(&m.pose_o_b)?,
            v_o_b: vector(&m.velocity_o_b)?,
            angular_rate_b: vector(&m.angular_rate_b)?,
            covariance: covariance(&m.covariance)?,
            state: state(m.state)?,
            quality: quality(m.quality)?,
            reset_counter: m.reset_counter,
            jumps: m.jumps,
            // Its share is in the covariance.
            origin: OriginUncertainty::default(),
        })
    }
}

/// What a recording says was dropped.
#[must_use]
pub fn dropped(m: &proto::Recording) -> Dropped {
    let mut dropped = Dropped::default();
    let counts = [
        (Kind::Imu, m.imu_dropped),
        (Kind::Frame, m.frames_dropped),
        (Kind::Order, m.orders_dropped),
        (Kind::Estimate, m.estimates_dropped),
        (Kind::Odometry, m.odometry_dropped),
        (Kind::Event, m.events_dropped),
        (Kind::MapEstimate, m.map_estimates_dropped),
    ];
    for (kind, count) in counts {
        dropped.0[kind as usize] = count;
    }
    dropped
}
