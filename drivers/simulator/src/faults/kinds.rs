//! Kinds of faults: `kinds.toml` is the table, in the order in which they are listed.

use crate::Dose;
use serde::Deserialize;
use std::fmt;
use std::sync::LazyLock;

/// Most doses of a kind.
pub(super) const DOSES: usize = 2;

/// A kind of fault.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FaultKind {
    /// Name.
    pub name: String,
    /// Description, in a sentence.
    pub about: String,
    pub(super) effect: Effect,
    /// Axes or cameras that it is about if none are named.
    #[serde(default)]
    pub(super) target: Target,
    /// Doses, in order.
    #[serde(default)]
    pub(super) doses: Vec<Dose>,
    /// Default beginning, s after the first frame.
    #[serde(default)]
    pub(super) from_s: f64,
    /// Default duration, s. Default: to the end.
    #[serde(default = "to_the_end")]
    pub(super) lasts_s: f64,
}

fn to_the_end() -> f64 {
    f64::INFINITY
}

/// All kinds.
pub(super) static KINDS: LazyLock<Vec<FaultKind>> = LazyLock::new(|| {
    #[derive(Deserialize)]
    struct Table {
        kind: Vec<FaultKind>,
    }
    let table: Table = toml::from_str(include_str!("kinds.toml")).expect("the table of the kinds of faults");
    table.kind
});

impl FaultKind {
    /// Help text: syntax with units and defaults, and the description.
    pub(super) fn help(&self) -> String {
        let target = match self.target {
            Target::Nothing => String::new(),
            Target::Axes(_) => format!(":AXES [{}]", &self.target.to_string()[1..]),
            Target::Cameras(_) => format!(":left|right|both [{}]", &self.target.to_string()[1..]),
        };
        let doses: String =
            self.doses.iter().map(|dose| format!(":{} [{}]", dose.unit, dose.default)).collect();
        let time = match (&self.effect, self.lasts_s.is_finite()) {
            (Effect::Rig(_), _) => String::new(),
            (_, true) => format!(" [@{}+{}]", self.from_s, self.lasts_s),
            (_, false) => format!(" [@{}]", self.from_s),
        };
        format!("{}{target}{doses}{time} - {}", self.name, self.about)
    }

    /// True if it needs a pair of cameras.
    pub(super) fn is_of_pair(&self) -> bool {
        matches!(self.effect, Effect::Rig(Mistake::Baseline) | Effect::Image(ImageChange::Exchange))
    }
}

/// Target of a fault.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(try_from = "String")]
pub(super) enum Target {
    /// The whole sensor.
    #[default]
    Nothing,
    /// Axes x, y, z of an inertial sensor.
    Axes([bool; 3]),
    /// The left camera and the right one.
    Cameras([bool; 2]),
}

impl Target {
    /// Reads a target of the same family.
    pub(super) fn read(self, text: &str) -> Result<Self, String> {
        match self {
            Self::Nothing => {
                Err(format!("'{text}' is no number, and this fault has no axes or cameras to name"))
            }
            Self::Axes(_) if !text.is_empty() && text.chars().all(|c| matches!(c, 'x' | 'y' | 'z')) => {
                Ok(Self::Axes(['x', 'y', 'z'].map(|axis| text.contains(axis))))
            }
            Self::Axes(_) => {
                Err(format!("'{text}' names no axes; write x, y, z or several of them, such as xz"))
            }
            Self::Cameras(_) => match text {
                "left" => Ok(Self::Cameras([true, false])),
                "right" => Ok(Self::Cameras([false, true])),
                "both" => Ok(Self::Cameras([true; 2])),
                _ => Err(format!("'{text}' names no camera; write left, right or both")),
            },
        }
    }
}

impl TryFrom<String> for Target {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        Self::Axes([false; 3]).read(&text).or_else(|_| Self::Cameras([false; 2]).read(&text))
    }
}

impl fmt::Display for Target {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Nothing => Ok(()),
            Self::Axes(axes) => {
                f.write_str(":")?;
                let named = ["x", "y", "z"].iter().zip(axes).filter(|(_, is_named)| **is_named);
                named.map(|(name, _)| name).try_for_each(|name| f.write_str(name))
            }
            Self::Cameras([true, true]) => f.write_str(":both"),
            Self::Cameras([true, false]) => f.write_str(":left"),
            Self::Cameras(_) => f.write_str(":right"),
        }
    }
}

/// Effect of a fault.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum Effect {
    /// To readings of an inertial sensor.
    Reading(Sensor, Change),
    /// Inertial samples are stamped late.
    ImuStamps,
    /// No inertial sample comes.
    ImuGap,
    /// The clock of all sensors steps back.
    Clocks,
    /// To the stamps of frames.
    FrameStamps(Stamping),
    /// Frames are lost at random.
    FramesMissing,
    /// No frame comes.
    FrameGap,
    /// To images.
    Image(ImageChange),
    /// The calibration that the estimator is given is wrong.
    Rig(Mistake),
}

/// An inertial sensor, or both.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum Sensor {
    Gyro,
    Accel,
    Both,
}

/// Changes of readings.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum Change {
    Add,
    Clip,
    Dead,
    Freeze,
    Negate,
    Exchange,
    Scale,
    Spikes,
    Late,
}

/// Changes of the stamps of frames.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum Stamping {
    Jitter,
    Swing,
    End,
    Late,
}

/// Changes of images.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum ImageChange {
    Lost,
    Black,
    Freeze,
    Shift,
    Late,
    Repeat,
    Exchange,
    Noise,
    Jpeg,
}

/// Mistakes in a calibration.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum Mistake {
    Baseline,
    Lens,
}
