//! Recorded outputs against those of a re-execution, bit for bit.

use crate::fields::{Parts, Record, Value, stamp_of};
use crate::orders::InstantAnswer;
use plumbline_estimator::places::MapEstimate;
use plumbline_estimator::{Estimate, Odometry};
use serde::Serialize;
use std::cmp::Ordering;
use std::collections::VecDeque;
use std::fmt;

/// The first thing in which a re-execution differs from the log.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Difference {
    /// Which output, such as `estimate of frame 7`.
    pub output: String,
    /// Its measurement time, s with nine decimals.
    pub stamp: String,
    /// The field with its index, such as `pose_o_b[2]`.
    pub field: String,
    /// Value in the log.
    pub recorded: String,
    /// Value of the re-execution.
    pub executed: String,
}

impl fmt::Display for Difference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { output, stamp, field, recorded, executed } = self;
        write!(f, "{output} at {stamp} s: {field} was {recorded}, and is {executed}")
    }
}

/// An output that is recorded and executed again.
pub trait ComparedOutput: Record {
    /// Name in messages.
    const OUTPUT: &'static str;
    /// Its number in its stream.
    fn sequence(&self) -> u64;
}

macro_rules! outputs {
    ($($type:ident, $name:literal, $sequence:ident;)*) => {$(
        impl ComparedOutput for $type {
            const OUTPUT: &'static str = $name;

            fn sequence(&self) -> u64 {
                self.$sequence
            }
        }
    )*};
}

outputs! {
    Estimate, "estimate of frame", frame_sequence;
    InstantAnswer, "state at instant", sequence;
    MapEstimate, "pose in the map of frame", frame_sequence;
    Odometry, "odometry", sequence;
}

/// Every field with its name, those of parts among them.
fn fields(record: &dyn Parts) -> Vec<(&'static str, Value<'_>)> {
    let mut all = Vec::new();
    record.visit(&mut |about, value| match value {
        Value::Part(part) => all.extend(fields(part)),
        _ => all.push((about.name, value)),
    });
    all
}

/// The first number in which two outputs differ.
fn difference<T: ComparedOutput>(recorded: &T, executed: &T) -> Option<Difference> {
    let pairs = fields(recorded).into_iter().zip(fields(executed));
    let (field, was, is) = pairs.into_iter().find_map(|((name, was), (_, is))| different(name, was, is))?;
    Some(Difference { field, ..told(recorded, was, is) })
}

/// A field in which two values differ, and both in words.
fn different(name: &str, was: Value<'_>, is: Value<'_>) -> Option<(String, String, String)> {
    match (was, is) {
        (Value::Whole(was), Value::Whole(is)) => {
            (was != is).then(|| (name.to_owned(), was.to_string(), is.to_string()))
        }
        (Value::Floats(was), Value::Floats(is)) => {
            let mut pairs = was.into_iter().flatten().zip(is.into_iter().flatten()).enumerate();
            let (k, (was, is)) = pairs.find(|(_, (a, b))| a.to_bits() != b.to_bits())?;
            Some((format!("{name}[{k}]"), in_full(*was), in_full(*is)))
        }
        (Value::Missing, Value::Missing) => None,
        (was, is) => {
            let words = |value| if matches!(value, Value::Missing) { "unknown" } else { "known" };
            Some((name.to_owned(), words(was).to_owned(), words(is).to_owned()))
        }
    }
}

/// A number with its bits: no two look the same.
fn in_full(number: f64) -> String {
    format!("{number:e} (bits {:016x})", number.to_bits())
}

fn told<T: ComparedOutput>(output: &T, recorded: String, executed: String) -> Difference {
    Difference {
        output: format!("{} {}", T::OUTPUT, output.sequence()),
        stamp: stamp_of(output).unwrap_or_default().to_string(),
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

impl<T: ComparedOutput> Pairing<T> {
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

    /// Discards the values without partner.
    pub fn forget(&mut self) {
        self.recorded.clear();
        self.executed.clear();
    }

    /// Recorded outputs that nothing was compared with.
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
