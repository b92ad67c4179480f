//! The tables of the log: each field of what a flight says, once. Those of other messages are in [`messages`](crate::messages).
//!
//! A row is the number in the messages of the log, the field in Rust, its name in the schema, and what else reads it:
//! `digest` (place in the digest, from 1), `at` (first byte in the fixed layout of the local socket), `columns` (place in
//! the table of `--states`, from 1, and names). What stands before a row becomes a comment of the schema. A field that no
//! row names is left out on purpose, and named after `besides`: a new one does not compile until it is in one of both.
//!
//! Numbers, places and bytes are those of logs, digests and programs that exist: a new field takes the next number, and
//! goes to the end.

use crate::columns::VARIANCES;
use crate::fields::{Field, Part, Shape, Value};
use crate::orders::{
    CorrectionOrder, FrameOrder, InstantAnswer, InstantOrder, InstantSource, MapOrder, MapVerdict,
    ResetOrder, Verdict,
};
use crate::parts::{End, FrameAbout, ImageAbout, Recording};
use crate::said::{Dropped, FullEstimate, Kind};
use nalgebra::Vector3;
use plumbline_config::{ImuSample, Timestamp};
use plumbline_drivers::ImuReading;
use plumbline_estimator::places::MapEstimate;
use plumbline_estimator::{Estimate, FrameFigures, Odometry, ResetKind};

record! {
    /// /input/imu: an inertial sample, in the order in which the odometry was given them.
    ImuReading as "Imu",
    blank ImuReading {
        sequence: 0,
        sample: ImuSample { stamp: Timestamp::default(), gyro: Vector3::zeros(), accel: Vector3::zeros() },
    };
    /// Counts samples of the sensor.
    1 sequence as "sequence";
    besides { sample: _ };
    more field!((2, "stamp", "stamp_ns", ""), sample.stamp);
    more field!((3, "gyro", "gyro", "Angular rate x y z in B, rad/s."), sample.gyro);
    more field!((4, "accel", "accel", "Specific force x y z in B, m/s^2."), sample.accel);
}

record! {
    /// An image of a frame.
    ImageAbout as "Image", blank ImageAbout::default();
    1 width_px as "width_px";
    2 height_px as "height_px";
    /// SHA-256 of the pixels, row by row.
    3 sha256 as "sha256";
}

record! {
    /// /input/frame: a stereo frame. Its images, where they are kept, come before it on /input/left and /input/right.
    FrameAbout as "Frame", blank FrameAbout::default();
    /// Counts frames of the sensor.
    1 sequence as "sequence";
    /// By the camera's clock.
    2 stamp as "stamp_ns";
    /// Absent when the image did not arrive.
    3 left as "left";
    4 right as "right";
}

record! {
    /// /order/frame: what became of a frame.
    FrameOrder as "FrameOrder",
    blank FrameOrder { frame: 0, readings_before: 0, verdict: Verdict::Taken { level: 0 } };
    /// Sequence number of the frame.
    1 frame as "frame";
    /// Inertial samples that the estimator had been given before, since the start.
    2 readings_before as "readings_before";
    besides { verdict: _ };
    more Field::<Self>::new(
        (3, "refused", "refused", "The estimator never saw it."),
        Shape::Flag,
        |o| Value::Whole((o.verdict == Verdict::Refused).into()),
        |o, value| {
            if value.whole() != 0 {
                o.verdict = Verdict::Refused;
            }
            Ok(())
        },
    );
    more Field::<Self>::new(
        (4, "level", "level", "Steps down from full work; 0 when refused."),
        Shape::Uint32,
        |o| Value::Whole(if let Verdict::Taken { level } = o.verdict { level.into() } else { 0 }),
        |o, value| {
            let given = u8::try_from(value.whole()).map_err(|_| "a level out of range")?;
            if let Verdict::Taken { level } = &mut o.verdict {
                *level = given;
            }
            Ok(())
        },
    );
    more Field::<Self>::new(
        (
            5,
            "lost",
            "lost",
            "Front-end or window ended by a fault of its own while it had the frame: there is no estimate, whatever an order \
             before this one said.",
        ),
        Shape::Flag,
        |o| Value::Whole((o.verdict == Verdict::Lost).into()),
        |o, value| {
            if value.whole() != 0 {
                o.verdict = Verdict::Lost;
            }
            Ok(())
        },
    );
}

record! {
    /// /order/correction: when an estimate took effect on the odometry.
    CorrectionOrder as "CorrectionOrder", blank CorrectionOrder { frame: 0, readings_before: 0 };
    /// Sequence number of the frame that was estimated.
    1 frame as "frame";
    /// Inertial samples that the odometry had been given before, since the start.
    2 readings_before as "readings_before";
}

record! {
    /// /order/reset: a reset that somebody asked for, or that a fault made necessary.
    ResetOrder as "ResetOrder",
    blank ResetOrder { kind: ResetKind::Soft, before_frame: 0, is_renewal: false };
    1 kind as "kind";
    /// Sequence number of the first frame after it.
    2 before_frame as "before_frame";
    /// Front-end and window were made anew, after a fault of one of them.
    3 is_renewal as "renewal";
}

record! {
    /// /order/map: what became of a frame that was to be given to the map.
    MapOrder as "MapOrder", blank MapOrder { frame: 0, verdict: MapVerdict::Applied { at_frame: 0 } };
    /// Sequence number of the frame.
    1 frame as "frame";
    besides { verdict: _ };
    more Field::<Self>::new(
        (2, "passed_over", "passed_over", "The map never saw it: it was not done with the one before."),
        Shape::Flag,
        |o| Value::Whole((o.verdict == MapVerdict::PassedOver).into()),
        |o, value| {
            if value.whole() != 0 {
                o.verdict = MapVerdict::PassedOver;
            }
            Ok(())
        },
    );
    more Field::<Self>::new(
        (3, "at_frame", "at_frame", "Else what was found took effect with the estimate of this frame."),
        Shape::Uint64,
        |o| Value::Whole(if let MapVerdict::Applied { at_frame } = o.verdict { at_frame as i64 } else { 0 }),
        |o, value| {
            if let MapVerdict::Applied { at_frame } = &mut o.verdict {
                *at_frame = value.whole() as u64;
            }
            Ok(())
        },
    );
}

record! {
    /// /order/instant: when the state at an instant was asked for.
    InstantOrder as "InstantOrder",
    blank InstantOrder {
        number: 0, stamp: Timestamp::default(), readings_before: 0, source: InstantSource::Request,
    };
    /// Of the request; of a trigger, the autopilot's; of a list, the row, from 0.
    1 number as "number";
    /// The instant, on the IMU's clock.
    2 stamp as "stamp_ns";
    /// Inertial samples that the odometry had been given before, since the start.
    3 readings_before as "readings_before";
    4 source as "source";
}

record! {
    /// /output/instant: the state at an instant that was asked for.
    InstantAnswer as "Instant", blank InstantAnswer::default();
    /// Counts the answers of the flight.
    1 sequence as "sequence";
    /// Number of the order.
    2 number as "number", [.at(16)];
    3 outcome as "outcome", [.at(502)];
    // That of the order.
    besides { source: _, instant: _ };
    more field!((4, "stamp", "stamp_ns", "The instant."), instant.stamp).at(0);
    more field!((5, "pose_o_b", "pose_o_b", "Body in O: x y z qx qy qz qw. Like all below, without meaning where it was refused."), instant.pose_o_b).at(24);
    more field!((6, "v_o_b", "velocity_o_b", "m/s, in O."), instant.v_o_b).at(80);
    more field!((7, "angular_rate_b", "angular_rate_b", "rad/s, bias removed, in B."), instant.angular_rate_b).at(104);
    more field!((8, "covariance", "covariance", "9x9 by columns: position (m), attitude (rad), velocity (m/s)."), instant.covariance).at(128);
    more field!((9, "state", "state", ""), instant.state).at(500);
    more field!((10, "quality", "quality", ""), instant.quality).at(501);
    more field!((11, "reset_counter", "reset_counter", ""), instant.reset_counter).at(496);
    more field!((12, "estimated", "estimated_ns", "Time of the estimate before the instant."), instant.estimated).at(488);
    more field!((13, "is_settled", "settled", "There is an estimate after the instant too: the answer would not change any more."), instant.is_settled).at(503);
}

record! {
    /// Work and outcome of one frame.
    FrameFigures as "Figures", blank FrameFigures::default();
    1 points_tracked as "points_tracked", [.columns(14, &["points_tracked"])];
    2 points_stereo as "points_stereo", [.columns(15, &["points_stereo"])];
    3 points_in_window as "points_in_window", [.columns(16, &["points_in_window"])];
    4 lines_raw as "lines_raw", [.columns(17, &["lines_raw"])];
    5 lines_kept as "lines_kept", [.columns(18, &["lines_kept"])];
    6 lines_merged as "lines_merged", [.columns(19, &["lines_merged"])];
    7 lines_matched as "lines_matched", [.columns(20, &["lines_matched"])];
    8 lines_cut_short as "lines_cut_short", [.columns(21, &["lines_cut_short"])];
    9 lines_in_window as "lines_in_window", [.columns(22, &["lines_in_window"])];
    /// Lines in the window along a direction of the structure.
    13 lines_in_structure as "lines_in_structure", [.columns(23, &["lines_in_structure"])];
    10 keyframes as "keyframes", [.columns(24, &["keyframes"])];
    11 iterations as "iterations", [.columns(25, &["iterations"])];
    12 is_keyframe as "is_keyframe", [.at(530).columns(26, &["is_keyframe"])];
}

record! {
    /// /output/estimate: the estimate after a frame.
    Estimate as "Estimate", blank Estimate::default();
    1 frame_sequence as "frame_sequence", [.digest(2).at(16).columns(2, &["frame"])];
    2 stamp as "stamp_ns", [.digest(1).at(0).columns(1, &["stamp_ns"])];
    3 state as "state", [.digest(10).at(528).columns(3, &["tracking"])];
    4 pose_o_b as "pose_o_b", [.digest(3).at(24).columns(7, &[
        "p_o_b_x_m", "p_o_b_y_m", "p_o_b_z_m", "q_o_b_x", "q_o_b_y", "q_o_b_z", "q_o_b_w",
    ])];
    /// m/s, in O.
    5 v_o_b as "velocity_o_b", [.digest(4).at(80).columns(8, &["v_o_b_x_m_s", "v_o_b_y_m_s", "v_o_b_z_m_s"])];
    /// rad/s.
    6 bias_gyro as "bias_gyro", [.digest(5).at(104).columns(9, &[
        "bias_gyro_x_rad_s", "bias_gyro_y_rad_s", "bias_gyro_z_rad_s",
    ])];
    /// m/s^2.
    7 bias_accel as "bias_accel", [.digest(6).at(128).columns(10, &[
        "bias_accel_x_m_s2", "bias_accel_y_m_s2", "bias_accel_z_m_s2",
    ])];
    /// 9x9 by columns: position (m), attitude (rad), velocity (m/s).
    8 covariance as "covariance", [.digest(7).at(152).columns(11, VARIANCES)];
    /// t_imu - t_camera and its standard deviation, s.
    9 time_offset_s & time_offset_sigma_s as "time_offset_s", [
        .digest_as(8, |o| Part::get(&o.time_offset_s)).at(512).columns(12, &["time_offset_s", "time_offset_sigma_s"])
    ];
    /// The left camera in the body.
    10 pose_b_c0 as "pose_b_c0", [.digest(9).columns(13, &[
        "p_b_c0_x_m", "p_b_c0_y_m", "p_b_c0_z_m", "q_b_c0_x", "q_b_c0_y", "q_b_c0_z", "q_b_c0_w",
    ])];
    11 quality as "quality", [.digest(11).at(529).columns(4, &["quality"])];
    12 health as "health_bits", [.digest(12).at(520).columns(5, &["health_bits"])];
    13 reset_counter as "reset_counter", [.digest(13).at(524).columns(6, &["reset_counter"])];
    14 figures as "figures";
    /// Variances of the biases: gyroscope (rad^2/s^2), accelerometer (m^2/s^4).
    15 bias_variances as "bias_variances", [.columns(27, &[
        "var_bias_gyro_x_rad2_s2", "var_bias_gyro_y_rad2_s2", "var_bias_gyro_z_rad2_s2",
        "var_bias_accel_x_m2_s4", "var_bias_accel_y_m2_s4", "var_bias_accel_z_m2_s4",
    ])];
    // Its share is in the covariance.
    besides { origin: _ };
}

record! {
    /// Estimate of a frame, all of it.
    FullEstimate as "FullEstimate", blank FullEstimate::default();
    1 estimate as "estimate";
    /// Computation of the frame, ms.
    2 frame_ms as "frame_ms", [.one()];
}

record! {
    /// /output/odometry: the newest state at an inertial sample.
    Odometry as "Odometry", blank Odometry::default();
    1 sequence as "sequence", [.at(16)];
    2 stamp as "stamp_ns", [.digest(1).at(0)];
    3 pose_o_b as "pose_o_b", [.digest(2).at(24)];
    4 v_o_b as "velocity_o_b", [.digest(3).at(80)];
    /// rad/s, bias removed, in B.
    5 angular_rate_b as "angular_rate_b", [.digest(4).at(104)];
    6 covariance as "covariance", [.digest(5).at(128)];
    7 state as "state", [.at(500)];
    8 quality as "quality", [.at(501)];
    9 reset_counter as "reset_counter", [.at(492)];
    /// Steps within the same odometry frame so far: corrections taken at once, and resumed odometry.
    10 jumps as "jumps", [.digest_as(6, |o| Value::Whole(o.steps().into())).at(496)];
    // Its share is in the covariance.
    besides { origin: _ };
}

record! {
    /// /output/map: where the odometry frame lies in the map, for each frame.
    MapEstimate as "MapEstimate", blank MapEstimate::default();
    1 frame_sequence as "frame_sequence", [.digest(2)];
    2 stamp as "stamp_ns", [.digest(1)];
    /// Takes coordinates from O to M: x y z qx qy qz qw; empty while it is not known.
    3 pose_m_o as "pose_m_o", [.digest(3)];
    4 reset_counter as "reset_counter", [.digest(4)];
    5 keyframes as "keyframes", [.digest(5)];
    6 sightings as "sightings", [.digest(6)];
    7 loops_used as "loops_used", [.digest(7)];
}

/// The count of dropped entries of a kind.
macro_rules! dropped {
    ($tag:literal, $kind:ident, $wire:literal, $about:literal) => {
        Field::<Self>::new(
            ($tag, "dropped", $wire, $about),
            Shape::Uint64,
            |o| Value::Whole(o.dropped.of(Kind::$kind) as i64),
            |o, value| {
                o.dropped.0[Kind::$kind as usize] = value.whole() as u64;
                Ok(())
            },
        )
    };
}

record! {
    /// /recorder: the state of the recording, once in every chunk.
    Recording as "Recording", blank Recording { end: End::NotYet, seal: Vec::new(), dropped: Dropped::default() };
    1 end as "end";
    /// Running SHA-256 over the inputs and orders of this file up to here.
    2 seal as "seal";
    besides { dropped: _ };
    more dropped!(3, Imu, "imu_dropped", "Entries that found the recorder's queue full since the start of the flight. What a re-execution needs:");
    more dropped!(4, Frame, "frames_dropped", "");
    more dropped!(5, Order, "orders_dropped", "");
    more dropped!(6, Estimate, "estimates_dropped", "And what it makes again:");
    more dropped!(7, Odometry, "odometry_dropped", "");
    more dropped!(8, Event, "events_dropped", "");
    more dropped!(9, MapEstimate, "map_estimates_dropped", "");
    more dropped!(10, Instant, "instants_dropped", "");
}
