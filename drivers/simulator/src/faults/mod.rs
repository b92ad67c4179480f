//! Faults that are injected on purpose into the streams of a flight, recorded or simulated, or into the calibration that its
//! estimator is given: `KIND[:TARGET][:DOSE...][@FROM[+DURATION[/PERIOD]]]`, such as `accel-pulse:x:30@6+0.1`.
//!
//! `kinds.toml` is the table of what there is: to add a kind, add an entry, and do what it says in [`imu`], [`frames`] or [`rig`].
//! Faults act in the order in which they are given. Every draw is a pure function of the seed, of the fault's place in that order
//! and of the number of the sample or frame. Times count from the first frame.

pub mod frames;
pub mod imu;
mod kinds;
mod pixels;
mod rig;
#[cfg(test)]
mod tests;

pub use frames::InjectedFrames;
pub use imu::InjectedImu;
pub use kinds::FaultKind;

use crate::random::{Purpose, mix};
use kinds::{Change, DOSES, Effect, KINDS, Target};
use plumbline_config::Config;
use std::fmt;
use std::ops::Range;
use std::str::FromStr;

/// A fault with its target, its doses and its time.
#[derive(Clone, Copy)]
pub struct InjectedFault {
    kind: &'static FaultKind,
    target: Target,
    doses: [f64; DOSES],
    from_s: f64,
    lasts_s: f64,
    /// Period of repetition, s. Default: infinite (acts once).
    period_s: f64,
    /// True for draws of the seed of the flight alone, whatever the place: those of `--drop-rate`.
    is_placeless: bool,
}

impl InjectedFault {
    /// All kinds.
    pub fn kinds() -> impl Iterator<Item = &'static FaultKind> {
        KINDS.iter()
    }

    /// `kind` with its defaults.
    fn of(kind: &'static FaultKind) -> Self {
        let doses = std::array::from_fn(|i| kind.doses.get(i).map_or(0.0, |dose| dose.default));
        let (from_s, lasts_s) = (kind.from_s, kind.lasts_s);
        let period_s = f64::INFINITY;
        Self { kind, target: kind.target, doses, from_s, lasts_s, period_s, is_placeless: false }
    }

    /// Returns the fault with draws of the seed of the flight alone, whatever its place.
    #[must_use]
    pub fn placeless(self) -> Self {
        Self { is_placeless: true, ..self }
    }

    /// Seed of its draws, at `place` in the order in which faults are given.
    const fn seed(&self, seed: u64, place: usize) -> u64 {
        if self.is_placeless { seed } else { mix(seed ^ mix(place as u64 + 1)) }
    }

    const fn purpose(&self) -> Purpose {
        if self.is_placeless { Purpose::Drop } else { Purpose::Injected }
    }

    /// Time in which it acts for the first time, s after the first frame.
    pub fn span_s(&self) -> Range<f64> {
        self.from_s..self.from_s + self.lasts_s
    }

    /// True if it affects the second camera, so that a rig of one cannot have it.
    pub fn needs_two_cameras(&self) -> bool {
        let is_of_right = matches!(self.target, Target::Cameras([_, true]));
        is_of_right && self.target != Target::Cameras([true; 2]) || self.kind.is_of_pair()
    }

    /// Checks that a rig of `cameras` can have it.
    ///
    /// # Errors
    /// When it is about a second camera that is not there.
    pub fn check_cameras(&self, cameras: usize) -> Result<(), String> {
        match cameras < 2 && self.needs_two_cameras() {
            true => Err(format!(
                "--fault {self}: is about the right camera or the pair, and this rig has one camera; leave it out"
            )),
            false => Ok(()),
        }
    }

    /// The fault for people: as it is written, what it is, and when.
    pub fn words(&self) -> String {
        let Range { start, end } = self.span_s();
        let when = match (self.is_of_rig(), end.is_finite()) {
            (true, _) => "in the calibration that is written".to_owned(),
            (false, true) => {
                format!("from {start} to {} s after the first frame", (end * 1e6).round() / 1e6)
            }
            (false, false) => format!("from {start} s after the first frame to the end"),
        };
        let again = match self.period_s.is_finite() {
            true => format!(", and every {} s after that", self.period_s),
            false => String::new(),
        };
        format!("{self} ({}), {when}{again}", self.kind.about)
    }

    /// By how much the clocks of all sensors step back, and when, s after the first frame.
    pub fn clock_step_s(&self) -> Option<(f64, f64)> {
        matches!(self.kind.effect, Effect::Clocks).then_some((self.from_s, -self.doses[0]))
    }

    /// True for a mistake in the calibration.
    pub fn is_of_rig(&self) -> bool {
        matches!(self.kind.effect, Effect::Rig(_))
    }

    /// Makes its mistake in `config`, if it is one in the calibration.
    pub fn mistake(&self, config: &mut Config) {
        if let Effect::Rig(mistake) = self.kind.effect {
            rig::mistake(mistake, self.doses[0], config);
        }
    }

    /// One line for each kind: how it is written, with units and defaults, and what it is.
    pub fn help() -> String {
        KINDS.iter().map(FaultKind::help).collect::<Vec<_>>().join("\n")
    }

    fn acts_at(&self, time_s: f64) -> bool {
        let rounds = match self.period_s.is_finite() && time_s > self.from_s {
            true => ((time_s - self.from_s) / self.period_s).floor(),
            false => 0.0,
        };
        let begin_s = if rounds > 0.0 { self.from_s + rounds * self.period_s } else { self.from_s };
        (begin_s..begin_s + self.lasts_s).contains(&time_s)
    }
}

impl FromStr for InjectedFault {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (what, time) = text.split_once('@').map_or((text, None), |(what, time)| (what, Some(time)));
        let mut parts = what.split(':').peekable();
        let name = parts.next().unwrap_or_default();
        let kind = KINDS.iter().find(|kind| kind.name == name).ok_or_else(|| {
            let names: Vec<_> = KINDS.iter().map(|kind| kind.name.as_str()).collect();
            format!("unknown fault '{name}'; choose {}", names.join(", "))
        })?;
        let mut fault = Self::of(kind);
        if let Some(target) = parts.next_if(|part| part.starts_with(|c: char| c.is_ascii_alphabetic())) {
            fault.target = kind.target.read(target).map_err(|why| format!("'{text}': {why}"))?;
        }
        for (i, part) in parts.enumerate() {
            let count = kind.doses.len();
            let dose = kind
                .doses
                .get(i)
                .ok_or_else(|| format!("'{text}': {name} has {count} doses; {}", kind.help()))?;
            fault.doses[i] = dose.read(part, text)?;
        }
        if let Some(time) = time {
            fault.set_time(time).map_err(|why| format!("'{text}': {why}"))?;
        }
        if let (Effect::Reading(_, Change::Exchange), Target::Axes(axes)) = (kind.effect, fault.target)
            && axes.iter().filter(|axis| **axis).count() != 2
        {
            return Err(format!("'{text}': {name} exchanges two axes; give xy, xz or yz"));
        }
        Ok(fault)
    }
}

impl InjectedFault {
    /// Reads `FROM`, `FROM+DURATION` or `FROM+DURATION/PERIOD`.
    fn set_time(&mut self, time: &str) -> Result<(), String> {
        if self.is_of_rig() {
            return Err(
                "a mistake in the calibration is there from the start to the end; leave out the time".into(),
            );
        }
        let seconds = |text: &str| {
            let value = text.parse::<f64>().ok().filter(|s| s.is_finite() && *s >= 0.0);
            value.ok_or_else(|| format!("'{text}' is not a number of seconds from 0; write @FROM or @FROM+DURATION, such as @6+0.1"))
        };
        let (span, period) = time.split_once('/').map_or((time, None), |(span, period)| (span, Some(period)));
        match span.split_once('+') {
            Some((from, lasts)) => (self.from_s, self.lasts_s) = (seconds(from)?, seconds(lasts)?),
            None => self.from_s = seconds(span)?,
        }
        let Some(period) = period else { return Ok(()) };
        self.period_s = seconds(period)?;
        match span.contains('+') && self.period_s > self.lasts_s {
            true => Ok(()),
            false => Err(format!(
                "a fault that repeats needs a duration that is shorter than its period; write @FROM+DURATION/PERIOD, such as @5+0.5/10, \
                 instead of '@{time}'"
            )),
        }
    }
}

impl fmt::Display for InjectedFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}{}", self.kind.name, self.target)?;
        self.doses[..self.kind.doses.len()].iter().try_for_each(|dose| write!(f, ":{dose}"))?;
        if self.is_of_rig() {
            return Ok(());
        }
        write!(f, "@{}", self.from_s)?;
        if self.lasts_s.is_finite() {
            write!(f, "+{}", self.lasts_s)?;
        }
        if self.period_s.is_finite() { write!(f, "/{}", self.period_s) } else { Ok(()) }
    }
}

impl fmt::Debug for InjectedFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

/// Two faults are the same if they are written alike.
impl PartialEq for InjectedFault {
    fn eq(&self, other: &Self) -> bool {
        self.to_string() == other.to_string()
    }
}

impl Eq for InjectedFault {}
