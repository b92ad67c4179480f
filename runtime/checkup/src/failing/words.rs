//! Failures in words, and their rank among the findings of a checkup.

use super::fault::Kind;
use super::{Failure, InertialSensor};
use crate::finding::Finding;
use crate::inertial::Axes;
use crate::plausibility::gravity::{self, DISAGREE, UPSIDE_DOWN};
use crate::plausibility::inertial::{ANOTHER_UNIT, NOT_GRAVITY, WITH_GRAVITY};
use crate::plausibility::rotation::{OTHER_AXES, OTHER_RATE, STAND_STILL};
use crate::verdict::{Fitness, Measure};
use crate::{mounting, scale};

/// Accelerations from which images show that an accelerometer should measure more than gravity, m/s².
const MOVES_M_S2: f64 = 0.3;

impl Failure {
    /// What the axes read instead of what, and when.
    pub(super) fn value(&self) -> String {
        let names: Vec<&str> = (0..3).filter(|k| self.fault.axes[*k]).map(|k| ["x", "y", "z"][k]).collect();
        let names = if names.len() == 3 { "x, y and z".to_owned() } else { names.join(" and ") };
        let what = match self.fault.kind {
            Kind::Dead => "noise alone",
            Kind::Negated => "the opposite of the motion",
            Kind::Exchanged => "each other's motion",
            Kind::Offset => "too much or too little by a constant",
        };
        let verb = if self.fault.count() == 1 { "reads" } else { "read" };
        let (motion, [from_s, to_s]) = (self.motion, self.span_s);
        let (sensor, shown) = match self.sensor {
            InertialSensor::Gyroscope => ("gyroscope", format!("turns of {motion:.2} rad/s")),
            InertialSensor::Accelerometer => ("accelerometer", format!("accelerations of {motion:.2} m/s²")),
        };
        format!(
            "{sensor} {names} {verb} {what} from {from_s:.0} to {to_s:.0} s after the first image, while images show {shown}"
        )
    }

    /// What to do.
    pub(super) fn cure(&self) -> String {
        let cure = match self.fault.kind {
            Kind::Dead | Kind::Offset => {
                "look at wiring, bus and driver of the sensor, and replace it if that does not help: no setting corrects it"
            }
            Kind::Negated => "negate this column in the driver",
            Kind::Exchanged => "put these columns in order in the driver",
        };
        let restart = "it was right before: look for a restart of sensor or driver at";
        if self.was_sound { format!("{restart} {:.0} s; {cure}", self.span_s[0]) } else { cure.to_owned() }
    }

    /// True if this finding is a consequence of it.
    fn explains(&self, finding: &Finding) -> bool {
        let is_gyroscope = self.sensor == InertialSensor::Gyroscope;
        match finding.what.as_str() {
            OTHER_AXES | OTHER_RATE | STAND_STILL => is_gyroscope,
            DISAGREE => true,
            UPSIDE_DOWN => !is_gyroscope,
            // A filter may have taken gravity out: at rest both look alike.
            NOT_GRAVITY => {
                let is_unknown = [ANOTHER_UNIT, WITH_GRAVITY].contains(&finding.cure.as_str());
                !is_gyroscope && self.fault.kind == Kind::Dead && is_unknown && self.motion >= MOVES_M_S2
            }
            _ => false,
        }
    }
}

/// Leaves one name for one trouble. Sensors that are silent, or that failed while they recorded, have findings of other columns as a
/// consequence; with any other finding the failures are the consequence.
pub(crate) fn reconcile(failures: &mut Vec<Failure>, findings: &mut Vec<Finding>) {
    failures.retain(|failure| failure.fault.kind == Kind::Dead || failure.was_sound || findings.is_empty());
    findings.retain(|finding| !failures.iter().any(|failure| failure.explains(finding)));
    if !findings.is_empty() {
        failures.clear();
    }
}

/// The measures of the axes with the failures.
pub(crate) fn judge(axes: &Axes, failures: &[Failure]) -> Vec<Measure> {
    let failing = |sensor| {
        let of_sensor = failures.iter().filter(move |failure| failure.sensor == sensor);
        [0, 1, 2].map(|k| of_sensor.clone().any(|failure| failure.fault.axes[k]))
    };
    let failing = [failing(InertialSensor::Gyroscope), failing(InertialSensor::Accelerometer)];
    [named(axes.judge(), failures)].into_iter().chain(axes.unmoved(failing)).collect()
}

/// The measure of the axes with the failures.
fn named(axes: Measure, failures: &[Failure]) -> Measure {
    if failures.is_empty() || axes.verdict == Fitness::NotFit {
        return axes;
    }
    let join = |of: &dyn Fn(&Failure) -> String| {
        let mut words: Vec<String> = failures.iter().map(of).collect();
        words.dedup();
        words.join("; ")
    };
    let count = failures.iter().map(|failure| failure.fault.count()).sum::<usize>() as f64;
    let figures = [&axes.figures[..], &[("failing_axes", count)]].concat();
    Measure::new(axes.name, Fitness::NotFit, join(&Failure::value), join(&Failure::cure), &figures)
}

/// Names of the measures that failures spoil.
pub(crate) fn spoiled(failures: &[Failure]) -> impl Iterator<Item = &'static str> {
    const OF_BOTH: [&str; 3] = [gravity::NAME, mounting::HEADING_NAME, scale::NAME];
    const OF_GYROSCOPE: &[&str] = &[
        "gyroscope bias",
        "vibration of the gyroscope",
        "blur",
        "time offset",
        "camera-IMU rotation",
        "focal length",
    ];
    const OF_ACCELEROMETER: &[&str] = &["gravity", mounting::NAME, "vibration of the accelerometer"];
    let of_one = |failure: &Failure| match failure.sensor {
        InertialSensor::Gyroscope => OF_GYROSCOPE,
        InertialSensor::Accelerometer => OF_ACCELEROMETER,
    };
    failures.iter().flat_map(move |failure| OF_BOTH.iter().chain(of_one(failure))).copied()
}
