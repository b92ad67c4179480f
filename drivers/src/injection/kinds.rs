//! Table of the kinds of faults.

use crate::simulator::Dose;
use std::fmt;

/// Most doses of a kind.
pub(super) const DOSES: usize = 2;
/// Sensors that break do so at this time if no other is given, s after the first frame.
const BROKEN_FROM_S: f64 = 10.0;
/// Blows come at this time if no other is given, s after the first frame.
const BLOW_FROM_S: f64 = 6.0;

/// A kind of fault.
#[derive(Debug)]
pub struct FaultKind {
    /// Name.
    pub name: &'static str,
    /// Description, in a sentence.
    pub about: &'static str,
    /// Axes or cameras that it is about if none are named.
    pub(super) target: Target,
    /// Doses, in order.
    pub(super) doses: &'static [Dose],
    /// Default beginning, s after the first frame.
    pub(super) from_s: f64,
    /// Default duration, s.
    pub(super) lasts_s: f64,
    pub(super) effect: Effect,
    /// Cases of a campaign: what follows the name.
    pub(super) cases: &'static [&'static str],
}

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

    const fn aimed(self, target: Target) -> Self {
        Self { target, ..self }
    }

    const fn at(self, from_s: f64, lasts_s: f64) -> Self {
        Self { from_s, lasts_s, ..self }
    }

    const fn flown(self, cases: &'static [&'static str]) -> Self {
        Self { cases, ..self }
    }
}

/// Target of a fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Target {
    /// The whole sensor.
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
#[derive(Clone, Copy, Debug)]
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
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Sensor {
    Gyro,
    Accel,
    Both,
}

/// Changes of readings.
#[derive(Clone, Copy, Debug)]
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
#[derive(Clone, Copy, Debug)]
pub(super) enum Stamping {
    Jitter,
    Swing,
    End,
    Late,
}

/// Changes of images.
#[derive(Clone, Copy, Debug)]
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
#[derive(Clone, Copy, Debug)]
pub(super) enum Mistake {
    Baseline,
    Lens,
}

const X: Target = Target::Axes([true, false, false]);
const XY: Target = Target::Axes([true, true, false]);
const XYZ: Target = Target::Axes([true; 3]);
const RIGHT: Target = Target::Cameras([false, true]);
const BOTH: Target = Target::Cameras([true; 2]);

const NOISE: Dose = Dose::new("multiple of the sensor's noise", 1.0, 1000.0);
const GREY: Dose = Dose::new("noise, grey levels", 1.5, 100.0);

/// A fault of the whole sensor that lasts from the first frame to the end.
const fn kind(name: &'static str, effect: Effect, doses: &'static [Dose], about: &'static str) -> FaultKind {
    FaultKind {
        name,
        about,
        target: Target::Nothing,
        doses,
        from_s: 0.0,
        lasts_s: f64::INFINITY,
        effect,
        cases: &[],
    }
}

const fn accel(name: &'static str, change: Change, doses: &'static [Dose], about: &'static str) -> FaultKind {
    kind(name, Effect::Reading(Sensor::Accel, change), doses, about).aimed(X).at(BROKEN_FROM_S, f64::INFINITY)
}

const fn gyro(name: &'static str, change: Change, doses: &'static [Dose], about: &'static str) -> FaultKind {
    kind(name, Effect::Reading(Sensor::Gyro, change), doses, about).aimed(X).at(BROKEN_FROM_S, f64::INFINITY)
}

const fn image(
    name: &'static str,
    change: ImageChange,
    doses: &'static [Dose],
    about: &'static str,
) -> FaultKind {
    kind(name, Effect::Image(change), doses, about).aimed(BOTH)
}

/// All kinds.
pub(super) const KINDS: &[FaultKind] = &[
    kind(
        "stamp-jitter",
        Effect::FrameStamps(Stamping::Jitter),
        &[Dose::new("standard deviation, ms", 1.0, 1000.0)],
        "Stamps of frames with Gaussian jitter",
    )
    .flown(&[":0.5", ":1", ":2", ":4"]),
    kind(
        "stamp-swing",
        Effect::FrameStamps(Stamping::Swing),
        &[Dose::new("amplitude, ms", 3.0, 1000.0), Dose::new("period, s", 8.0, 10_000.0)],
        "Stamps of frames that are late and early by a sine, as those of an exposure that follows the light",
    )
    .flown(&[":1:8", ":3:4", ":3:20", ":5:8"]),
    kind(
        "stamp-end",
        Effect::FrameStamps(Stamping::End),
        &[Dose::new("exposure, ms", 6.0, 1000.0)],
        "Stamps of frames at the end of this exposure, late by half of it",
    )
    .flown(&[":6", ":20"]),
    kind(
        "stamp-late",
        Effect::FrameStamps(Stamping::Late),
        &[Dose::signed("ms", 50.0, 10_000.0)],
        "Stamps of frames that are late (early if negative)",
    )
    .flown(&[":50@10"]),
    kind(
        "clock-back",
        Effect::Clocks,
        &[Dose::signed("s", 0.5, 10_000.0)],
        "Clock of all sensors that steps back (forward if negative)",
    )
    .at(BROKEN_FROM_S, f64::INFINITY)
    .flown(&[":0.1", ":0.5", ":3"]),
    kind(
        "frames-missing",
        Effect::FramesMissing,
        &[Dose::new("share", 0.1, 0.99)],
        "Frames that are lost at random",
    )
    .flown(&[":0.1", ":0.33"]),
    kind("frame-gap", Effect::FrameGap, &[], "No frames for a time")
        .at(BROKEN_FROM_S, 0.5)
        .flown(&["@10+0.5", "@10+2"]),
    image("camera-lost", ImageChange::Lost, &[], "No images of a camera for a time")
        .aimed(RIGHT)
        .at(BROKEN_FROM_S, 5.0)
        .flown(&[":left@5+5"]),
    image("image-black", ImageChange::Black, &[GREY], "Black images with noise")
        .at(BROKEN_FROM_S, 1.5)
        .flown(&["@10+1.5"]),
    image(
        "image-frozen",
        ImageChange::Freeze,
        &[GREY],
        "One image again and again, each time with new noise",
    )
    .at(BROKEN_FROM_S, f64::INFINITY)
    .flown(&[":left", ":right", ":both"]),
    image(
        "image-shift",
        ImageChange::Shift,
        &[Dose::signed("px to the right", 8.0, 1000.0), Dose::signed("px down", 0.0, 1000.0)],
        "Images shifted by whole pixels",
    )
    .aimed(RIGHT)
    .flown(&[":right:4@10", ":right:8@10", ":left:0:4@10"]),
    image(
        "image-late",
        ImageChange::Late,
        &[Dose::new("frames", 1.0, 20.0)],
        "Images of an earlier frame under the stamp of this one",
    )
    .aimed(RIGHT)
    .flown(&[":left:1", ":right:1", ":right:3", ":left:1@10", ":right:1@10", ":right:3@10"]),
    image(
        "image-repeat",
        ImageChange::Repeat,
        &[Dose::new("one of so many", 5.0, 1000.0)],
        "Every so many frames the image of the frame before",
    )
    .aimed(RIGHT)
    .flown(&[":right:5", ":both:2"]),
    kind("images-exchanged", Effect::Image(ImageChange::Exchange), &[], "Left and right image exchanged")
        .at(BROKEN_FROM_S, f64::INFINITY)
        .flown(&[""]),
    image(
        "image-noise",
        ImageChange::Noise,
        &[Dose::new("grey levels", 3.0, 100.0), Dose::new("correlation from frame to frame", 0.9, 1.0)],
        "Noise of pixels that is correlated over frames",
    )
    .flown(&[":3:0.9", ":3:0.99"]),
    image(
        "image-jpeg",
        ImageChange::Jpeg,
        &[Dose { unit: "quality", default: 75.0, least: 1.0, most: 100.0 }],
        "Images compressed as JPEG",
    )
    .flown(&[":90", ":75", ":50"]),
    kind("imu-gap", Effect::ImuGap, &[], "No inertial samples for a time")
        .at(BROKEN_FROM_S, 0.2)
        .flown(&["@10+0.2"]),
    kind(
        "imu-late",
        Effect::ImuStamps,
        &[Dose::signed("ms", 20.0, 10_000.0)],
        "Inertial samples stamped late (early if negative)",
    )
    .at(BROKEN_FROM_S, f64::INFINITY)
    .flown(&[":20", ":50", ":100", ":-20", ":-50"]),
    kind(
        "imu-frozen",
        Effect::Reading(Sensor::Both, Change::Freeze),
        &[NOISE],
        "One inertial sample again and again, each time with new noise",
    )
    .aimed(XYZ)
    .at(BROKEN_FROM_S, f64::INFINITY)
    .flown(&[""]),
    accel(
        "accel-pulse",
        Change::Add,
        &[Dose::signed("m/s²", 30.0, 10_000.0)],
        "Accelerometer reads too much for a short time, as after a blow",
    )
    .at(BLOW_FROM_S, 0.1)
    .flown(&[":x:30@6+0.1", ":y:30@6+0.1", ":z:60@6+0.3", ":x:15@6+0.3", ":z:5@6+1"]),
    accel("accel-step", Change::Add, &[Dose::signed("m/s²", 3.0, 10_000.0)], "Accelerometer reads too much")
        .flown(&[":x:3", ":y:3", ":z:1"]),
    accel(
        "accel-clip",
        Change::Clip,
        &[Dose::new("m/s²", 15.0, 10_000.0)],
        "Accelerometer that reads at most this much, of either sign",
    )
    .aimed(XYZ)
    .flown(&[":xyz:10@10+0.5", ":xyz:15"]),
    accel("accel-dead", Change::Dead, &[NOISE], "Accelerometer that reads noise around zero")
        .flown(&[":x", ":y", ":z", ":xyz"]),
    accel("accel-frozen", Change::Freeze, &[NOISE], "Accelerometer that reads noise around its last reading")
        .flown(&[":x", ":xyz"]),
    accel("accel-sign", Change::Negate, &[], "Accelerometer of the other sign").flown(&[":x", ":y", ":z"]),
    accel("accel-exchanged", Change::Exchange, &[], "Two axes of the accelerometer exchanged")
        .aimed(XY)
        .flown(&[":xy", ":xz"]),
    accel(
        "accel-scale",
        Change::Scale,
        &[Dose::new("factor", 1.1, 1000.0)],
        "Accelerometer that reads a multiple",
    )
    .aimed(XYZ)
    .flown(&[":xyz:1.1", ":xyz:0.9"]),
    accel(
        "accel-spikes",
        Change::Spikes,
        &[Dose::new("share of the samples", 0.01, 1.0), Dose::new("m/s²", 50.0, 10_000.0)],
        "Single readings of the accelerometer that are too large or too small",
    )
    .aimed(XYZ)
    .flown(&[":xyz:0.01:50", ":xyz:0.1:50"]),
    accel("accel-late", Change::Late, &[Dose::new("ms", 20.0, 1000.0)], "Accelerometer alone is late")
        .aimed(XYZ)
        .flown(&[":xyz:20"]),
    gyro(
        "gyro-pulse",
        Change::Add,
        &[Dose::signed("rad/s", 3.0, 1000.0)],
        "Gyroscope reads too much for a short time, as after a blow",
    )
    .at(BLOW_FROM_S, 0.1)
    .flown(&[":y:3@6+0.1"]),
    gyro("gyro-step", Change::Add, &[Dose::signed("rad/s", 0.1, 1000.0)], "Gyroscope reads too much")
        .flown(&[":x:0.1", ":z:0.1"]),
    gyro(
        "gyro-clip",
        Change::Clip,
        &[Dose::new("rad/s", 1.0, 1000.0)],
        "Gyroscope that reads at most this much, of either sign",
    )
    .aimed(XYZ)
    .flown(&[":xyz:1"]),
    gyro("gyro-dead", Change::Dead, &[NOISE], "Gyroscope that reads noise around zero")
        .flown(&[":x", ":y", ":z", ":xyz"]),
    gyro("gyro-frozen", Change::Freeze, &[NOISE], "Gyroscope that reads noise around its last reading")
        .flown(&[":y", ":xyz"]),
    gyro("gyro-sign", Change::Negate, &[], "Gyroscope of the other sign").flown(&[":x", ":y", ":z"]),
    gyro("gyro-exchanged", Change::Exchange, &[], "Two axes of the gyroscope exchanged")
        .aimed(XY)
        .flown(&[":xy", ":yz"]),
    gyro("gyro-scale", Change::Scale, &[Dose::new("factor", 2.0, 1000.0)], "Gyroscope that reads a multiple")
        .aimed(XYZ)
        .flown(&[":xyz:2", ":xyz:0.5"]),
    gyro(
        "gyro-spikes",
        Change::Spikes,
        &[Dose::new("share of the samples", 0.01, 1.0), Dose::new("rad/s", 5.0, 1000.0)],
        "Single readings of the gyroscope that are too large or too small",
    )
    .aimed(XYZ)
    .flown(&[":xyz:0.01:5"]),
    gyro("gyro-late", Change::Late, &[Dose::new("ms", 20.0, 1000.0)], "Gyroscope alone is late")
        .aimed(XYZ)
        .flown(&[":xyz:20"]),
    kind(
        "rig-baseline",
        Effect::Rig(Mistake::Baseline),
        &[Dose { unit: "factor", default: 2.0, least: 0.01, most: 100.0 }],
        "Calibration with the cameras this many times too far apart",
    )
    .flown(&[":0.5", ":1.1", ":2"]),
    kind(
        "rig-lens",
        Effect::Rig(Mistake::Lens),
        &[],
        "Calibration that names the other lens model (equidistant, radial-tangential)",
    )
    .flown(&[""]),
];
