//! Recorded outputs against those of a re-execution, bit for bit.

use Field::{Floats, Whole};
use plumbline_config::Timestamp;
use plumbline_estimator::places::MapEstimate;
use plumbline_estimator::{Estimate, FrameFigures, Odometry};
use serde::Serialize;
use std::cmp::Ordering;
use std::collections::VecDeque;
use std::fmt;
use std::slice::from_ref;

/// A field of an output.
#[derive(Clone, Copy, Debug)]
pub enum Field<'a> {
    /// Real numbers.
    Floats(&'a [f64]),
    /// A whole number.
    Whole(i64),
}

/// The first thing in which a re-execution differs from the log.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Difference {
    /// Which output, such as `estimate of frame 7`.
    pub output: String,
    /// Its measurement time, s with nine decimals.
    pub stamp: String,
    /// The field with its index, such as `pose_o_b[2]`.
    pub field: String,
    /// What the log says.
    pub recorded: String,
    /// What came out.
    pub executed: String,
}

impl fmt::Display for Difference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { output, stamp, field, recorded, executed } = self;
        write!(f, "{output} at {stamp} s: {field} was {recorded}, and is {executed}")
    }
}

/// An output that is recorded and executed again.
pub trait Output {
    /// What it is called.
    const NAME: &'static str;
    /// Its number in its stream.
    fn sequence(&self) -> u64;
    /// Its measurement time.
    fn stamp(&self) -> Timestamp;
    /// Every field of it, in a fixed order.
    fn fields(&self) -> Vec<(&'static str, Field<'_>)>;
}

impl Output for Estimate {
    const NAME: &'static str = "estimate of frame";

    fn sequence(&self) -> u64 {
        self.frame_sequence
    }

    fn stamp(&self) -> Timestamp {
        self.stamp
    }

    fn fields(&self) -> Vec<(&'static str, Field<'_>)> {
        // Every field by its name: a new one is compared, or does not compile.
        let Self {
            frame_sequence,
            stamp,
            state,
            pose_o_b,
            v_o_b,
            bias_gyro,
            bias_accel,
            covariance,
            // Not recorded: its share is in the covariance.
            origin: _,
            bias_variances,
            time_offset_s,
            time_offset_sigma_s,
            pose_b_c0,
            quality,
            health,
            reset_counter,
            figures,
        } = self;
        let mut fields = vec![
            ("frame_sequence", Whole(*frame_sequence as i64)),
            ("stamp", Whole(stamp.as_nanos())),
            ("state", Whole(*state as i64)),
            ("pose_o_b position", Floats(pose_o_b.translation.vector.as_slice())),
            ("pose_o_b rotation", Floats(pose_o_b.rotation.coords.as_slice())),
            ("v_o_b", Floats(v_o_b.as_slice())),
            ("bias_gyro", Floats(bias_gyro.as_slice())),
            ("bias_accel", Floats(bias_accel.as_slice())),
            ("covariance", Floats(covariance.as_slice())),
            ("bias_variances", Floats(bias_variances.as_slice())),
            ("time_offset_s", Floats(from_ref(time_offset_s))),
            ("time_offset_sigma_s", Floats(from_ref(time_offset_sigma_s))),
            ("pose_b_c0 position", Floats(pose_b_c0.translation.vector.as_slice())),
            ("pose_b_c0 rotation", Floats(pose_b_c0.rotation.coords.as_slice())),
            ("quality", Whole((*quality).into())),
            ("health", Whole(health.0.into())),
            ("reset_counter", Whole((*reset_counter).into())),
        ];
        fields.extend(FrameFigures::NAMES.into_iter().zip(figures.values().map(|value| Whole(value.into()))));
        fields
    }
}

impl Output for MapEstimate {
    const NAME: &'static str = "pose in the map of frame";

    fn sequence(&self) -> u64 {
        self.frame_sequence
    }

    fn stamp(&self) -> Timestamp {
        self.stamp
    }

    fn fields(&self) -> Vec<(&'static str, Field<'_>)> {
        let Self { frame_sequence, stamp, pose_m_o, reset_counter, keyframes, sightings, loops_used } = self;
        let mut fields = vec![
            ("frame_sequence", Whole(*frame_sequence as i64)),
            ("stamp", Whole(stamp.as_nanos())),
            ("is known", Whole(pose_m_o.is_some().into())),
            ("reset_counter", Whole((*reset_counter).into())),
            ("keyframes", Whole((*keyframes).into())),
            ("sightings", Whole((*sightings).into())),
            ("loops_used", Whole((*loops_used).into())),
        ];
        if let Some(pose) = pose_m_o {
            fields.push(("pose_m_o position", Floats(pose.translation.vector.as_slice())));
            fields.push(("pose_m_o rotation", Floats(pose.rotation.coords.as_slice())));
        }
        fields
    }
}

impl Output for Odometry {
    const NAME: &'static str = "odometry";

    fn sequence(&self) -> u64 {
        self.sequence
    }

    fn stamp(&self) -> Timestamp {
        self.stamp
    }

    fn fields(&self) -> Vec<(&'static str, Field<'_>)> {
        let Self {
            sequence,
            stamp,
            pose_o_b,
            v_o_b,
            angular_rate_b,
            covariance,
            state,
            quality,
            reset_counter,
            jumps,
            // Not recorded: its share is in the covariance.
            origin: _,
        } = self;
        vec![
            ("sequence", Whole(*sequence as i64)),
            ("stamp", Whole(stamp.as_nanos())),
            ("pose_o_b position", Floats(pose_o_b.translation.vector.as_slice())),
            ("pose_o_b rotation", Floats(pose_o_b.rotation.coords.as_slice())),
            ("v_o_b", Floats(v_o_b.as_slice())),
            ("angular_rate_b", Floats(angular_rate_b.as_slice())),
            ("covariance", Floats(covariance.as_slice())),
            ("state", Whole(*state as i64)),
            ("quality", Whole((*quality).into())),
            ("reset_counter", Whole((*reset_counter).into())),
            ("jumps", Whole((*jumps).into())),
        ]
    }
}

/// The first number in which two outputs differ.
fn difference<T: Output>(recorded: &T, executed: &T) -> Option<Difference> {
    for ((name, was), (_, is)) in recorded.fields().into_iter().zip(executed.fields()) {
        let (field, was, is) = match (was, is) {
            (Whole(was), Whole(is)) if was != is => (name.to_owned(), was.to_string(), is.to_string()),
            (Floats(was), Floats(is)) => {
                let mut pairs = was.iter().zip(is).enumerate();
                let Some((k, (was, is))) = pairs.find(|(_, (a, b))| a.to_bits() != b.to_bits()) else {
                    continue;
                };
                (format!("{name}[{k}]"), in_full(*was), in_full(*is))
            }
            _ => continue,
        };
        return Some(Difference { field, ..told(recorded, was, is) });
    }
    None
}

/// A number with its bits: no two look the same.
fn in_full(number: f64) -> String {
    format!("{number:e} (bits {:016x})", number.to_bits())
}

fn told<T: Output>(output: &T, recorded: String, executed: String) -> Difference {
    Difference {
        output: format!("{} {}", T::NAME, output.sequence()),
        stamp: output.stamp().to_string(),
        field: "the output".into(),
        recorded,
        executed,
    }
}

/// Pairs the outputs of log and re-execution as they come, by their numbers.
#[derive(Debug)]
pub struct Pairing<T> {
    recorded: VecDeque<T>,
    executed: VecDeque<T>,
    /// Pairs that are the same in every bit.
    pub identical: u64,
    /// Outputs that came out and are not in the log.
    pub missing: u64,
    /// The first pair that is not the same.
    pub difference: Option<Difference>,
}

impl<T> Default for Pairing<T> {
    fn default() -> Self {
        Self {
            recorded: VecDeque::new(),
            executed: VecDeque::new(),
            identical: 0,
            missing: 0,
            difference: None,
        }
    }
}

impl<T: Output> Pairing<T> {
    /// The next output of the log.
    pub fn recorded(&mut self, output: T) {
        self.recorded.push_back(output);
        self.compare();
    }

    /// The next output of the re-execution.
    pub fn executed(&mut self, output: T) {
        self.executed.push_back(output);
        self.compare();
    }

    /// What has no partner yet shall not be compared.
    pub fn forget(&mut self) {
        self.recorded.clear();
        self.executed.clear();
    }

    /// Recorded outputs that nothing was compared with.
    #[must_use]
    pub fn left_over(&self) -> u64 {
        self.recorded.len() as u64
    }

    /// Nothing more will come: what has no partner is missing, or was never put out again.
    pub fn finish(&mut self, is_log_complete: bool) {
        self.missing += self.executed.len() as u64;
        self.executed.clear();
        if let (Some(extra), true, None) = (self.recorded.front(), is_log_complete, &self.difference) {
            self.difference = Some(told(extra, "recorded".into(), "not put out".into()));
        }
    }

    fn compare(&mut self) {
        while let (Some(was), Some(is), None) =
            (self.recorded.front(), self.executed.front(), &self.difference)
        {
            match was.sequence().cmp(&is.sequence()) {
                Ordering::Less => {
                    self.difference = Some(told(was, "recorded".into(), "not put out".into()));
                }
                Ordering::Greater => {
                    self.missing += 1;
                    self.executed.pop_front();
                }
                Ordering::Equal => {
                    self.difference = difference(was, is);
                    self.identical += u64::from(self.difference.is_none());
                    self.recorded.pop_front();
                    self.executed.pop_front();
                }
            }
        }
    }
}
