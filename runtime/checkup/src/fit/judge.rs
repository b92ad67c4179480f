//! Verdicts of a fit: each part of the calibration as measured against the configured one, the causes first.

use super::causes::{Cause, Causes, SIGMAS};
use super::parts::{Course, Part, TURN, parts};
use super::rig::{ACCEL, GYRO};
use super::{FirstLook, Fitted, fit, orientation};
use crate::NAMED_ABOVE;
use crate::tracks::Tracks;
use crate::verdict::{Fitness, Measure, TOO_SHORT};
use nalgebra::DVector;
use plumbline_config::{Config, ImuSample};

/// A part is off for good from so many standard deviations on, those of a calibration and of the measurement together.
const FAULT_SIGMAS: f64 = SIGMAS + 1.0;
/// Offsets of the gyroscope between pieces, rad/s, that no gyroscope has in flight, and by how much more than it says.
const MOVING: (f64, f64) = (0.01, 10.0);

/// Subjects of focal lengths and of the gyroscope.
const FOCAL: usize = 0;
const OF_GYRO: usize = 10;

/// Scale of the gyroscope that one camera makes up, twice what data sheets have at most (MEMS: 1 to 3 %).
const TRADED: f64 = 0.06;

const AXES: [&str; 3] = ["x", "y", "z"];

/// Name of the measure of the noise.
pub(crate) const NOISE: &str = "noise of the IMU";
/// Noise against the configured one from which it is minded: that of a vehicle in flight against a data sheet.
const NOISY: f64 = 3.0;

/// Shortest recording that holds enough pieces for their scatter to show, s.
const LEAST_S: f64 = 10.0;
/// Instructions for a recording that can be fitted.
const HOLD: &str = "turn it by hand about all three axes and move it to and fro for ten seconds and more, with texture in view";

/// Cure of a part that is off, and explains nothing.
const CONSEQUENCE: &str = "it explains nothing by itself: look at what is named above, and measure again";

/// Measures of the calibration by one fit of everything: what explains most first. Of a recording that is too short for it, that alone.
pub(crate) fn judge(config: &Config, tracks: &Tracks, samples: &[ImuSample]) -> Vec<Measure> {
    let measures = fitted(config, tracks, samples);
    let span_s = tracks.span_s();
    let is_whole = span_s >= LEAST_S || !measures.iter().any(Measure::is_missing);
    if is_whole || measures.iter().any(|measure| measure.verdict > Fitness::Good) {
        return measures;
    }
    let value = format!("too short: {LEAST_S:.0} s of motion are needed, and these are {span_s:.1} s");
    let short = Measure::new(TOO_SHORT, Fitness::NotMeasured, value, HOLD, &[("span_s", span_s)]);
    vec![short.shown_by(Some(HOLD))]
}

fn fitted(config: &Config, tracks: &Tracks, samples: &[ImuSample]) -> Vec<Measure> {
    let parts = parts(config);
    let first = FirstLook::at(config, tracks, samples);
    let otherwise = first.as_ref().and_then(|first| {
        first.silent.map(silent).or_else(|| orientation::judge(config, tracks, samples, first))
    });
    if let Some(measure) = otherwise {
        return std::iter::once(measure).chain(spoilt(config)).collect();
    }
    let first = first.filter(|first| first.turns_enough);
    // By how much more than it says a calibration is uncertain, only several pieces show.
    let fitted = first.and_then(|first| fit(config, tracks, samples, &first, &|_| true));
    let Some(fitted) = fitted.filter(|fitted| fitted.pieces.len() > 1) else {
        return missing(
            &parts,
            "it is too short, the vehicle hardly turns, or images and samples hold no motion together",
            HOLD,
        );
    };
    let causes = Causes::new(&fitted, &parts);
    let found = causes.found();
    let mut measures: Vec<Measure> = carrier(&fitted, config).into_iter().collect();
    let mut told = Vec::new();
    let both = trade(config, &causes, &parts, &found);
    let is_carried = !measures.is_empty();
    for cause in found.iter().filter(|_| !is_carried) {
        let subject = parts[cause.part].subject;
        let is_traded = both.is_some() && [FOCAL, OF_GYRO].contains(&subject);
        let measure = both.clone().filter(|_| is_traded);
        let mut measure = measure.unwrap_or_else(|| of_cause(&causes, &parts, cause, &found, &fitted));
        measure.figures.insert("explains_share", cause.share);
        if measure.verdict != Fitness::Good && !told.contains(&subject) {
            told.extend(if is_traded { vec![FOCAL, OF_GYRO] } else { vec![subject] });
            measures.push(measure);
        }
    }
    for (k, part) in
        parts.iter().enumerate().filter(|(_, part)| part.is_listed && !told.contains(&part.subject))
    {
        let mut measure = constant(&causes, k, part, &found);
        // What is off but explains nothing is a consequence.
        if measure.verdict > Fitness::Good {
            (measure.verdict, measure.cure) = (Fitness::Uncertain, CONSEQUENCE.to_owned());
        }
        measures.push(measure);
    }
    measures.push(noise(&fitted, config));
    measures
}

/// Focal length and scale of the gyroscope of one camera. What a turn moves in the image is their product; what tells them apart, the rim of the
/// image against gravity, is weak. So one of them is off, by the product: the lens, which changes with focus and image size, unless the data want
/// the gyroscope off by more than both errors explain.
fn trade(config: &Config, causes: &Causes<'_>, parts: &[Part], found: &[Cause]) -> Option<Measure> {
    let is_either = |cause: &&Cause| [FOCAL, OF_GYRO].contains(&parts[cause.part].subject);
    let is_one = config.camera.len() == 1 && found.iter().find(is_either)?.course == Course::Constant;
    let at = [FOCAL, OF_GYRO].map(|subject| parts.iter().position(|part| part.subject == subject));
    let [of_lens, of_gyro] = [at[0]?, at[1]?];
    let others = found.iter().filter(|cause| !is_either(cause)).map(|cause| (cause.part, cause.course));
    let free = [of_lens, of_gyro].map(|part| (part, Course::Constant)).into_iter().chain(others);
    let (_, step, _) = causes.freed(&free.collect::<Vec<_>>());
    let (focal, scale, product) = (step[0], step[1], step[0].exp() * (1.0 + step[1]) - 1.0);
    // Columns that are swapped are no scale.
    let is_scale = focal.abs() < 0.5 && scale.abs() < 0.5;
    let is_gyro = scale * scale - focal * focal > TRADED * TRADED;
    let [part, other] = (if is_gyro { [of_gyro, of_lens] } else { [of_lens, of_gyro] }).map(|k| &parts[k]);
    let is_right = product.abs() < SIGMAS * part.worth.hypot(other.worth);
    let (verdict, cure) = if is_right { (Fitness::Uncertain, TURN) } else { (Fitness::NotFit, part.cure) };
    let [both, focal_percent, scale_percent] = [product, focal, scale].map(|value| 1e2 * value);
    let value = format!(
        "off by {both:.1} %, or the {} instead: one camera tells these apart badly (both free: {focal_percent:.1} and {scale_percent:.1} %)",
        other.name
    );
    let measure = Measure::new(part.name, verdict, value, cure, &[("step", product)]);
    // One of them that is off by less is a change within the worth of a calibration.
    let is_trade = is_one && is_scale && (!is_right || found.iter().filter(is_either).count() > 1);
    is_trade.then(|| measure.shown_by(Some(TURN)))
}

/// Noise that motions and samples show, against the configured one.
fn noise(fitted: &Fitted, config: &Config) -> Measure {
    let imu = &config.imu;
    let [gyro, accel] =
        [fitted.noise.gyro / imu.gyro_noise_density, fitted.noise.accel / imu.accel_noise_density];
    Measure::new(
        NOISE,
        Fitness::within(gyro.max(accel), NOISY, f64::INFINITY),
        format!("gyroscope {gyro:.1}, accelerometer {accel:.1} times the configured density"),
        "damp the mounting of the IMU, and give the noise in flight as `imu.gyro_noise_density` and `imu.accel_noise_density`; a vibration \
         above half the rate shows at a lower frequency: filter in the sensor, or sample faster",
        &[("gyro", gyro), ("accel", accel)],
    )
}

/// The parts of the calibration of a recording through which nothing can be fitted.
pub(crate) fn spoilt(config: &Config) -> Vec<Measure> {
    missing(&parts(config), NAMED_ABOVE.0, NAMED_ABOVE.1)
}

fn missing(parts: &[Part], why: &str, cure: &str) -> Vec<Measure> {
    let listed = parts.iter().filter(|part| part.is_listed);
    listed.map(|part| Measure::missing(part.name, why, cure).shown_by(part.motion)).collect()
}

/// Axis of the gyroscope that does not measure.
fn silent(axis: usize) -> Measure {
    let value = format!(
        "{} as delivered agrees with no turning that the images show: it is dead, or noise",
        AXES[axis]
    );
    Measure::not_fit(
        "gyroscope axes",
        value,
        "look at the driver and the range of the gyroscope, and replace the sensor if it stays so",
    )
}

/// What the camera sees turns with the vehicle, or rather not with the ground.
fn carrier(fitted: &Fitted, config: &Config) -> Option<Measure> {
    let sigma = fitted.noise.biases[0];
    let usual = config.imu.gyro_bias_walk * fitted.span_s.sqrt() + config.imu.gyro_error_sigma_rad_s;
    (sigma > MOVING.0 && sigma > MOVING.1 * usual).then(|| {
        let value = format!("the scene turns by {sigma:.3} rad/s that the gyroscope does not agree with, otherwise in each piece of two seconds");
        let cure = "probably a cabin, deck or other carrier that moves and fills the view, or a gyroscope that fails; fly where the ground is seen, \
                    or replace the sensor";
        Measure::not_fit("gyroscope against the scene", value, cure)
    })
}

/// How far values are off, in standard deviations of calibration and measurement together, of a matrix its largest; and the largest sigma over the
/// worth.
fn off(part: &Part, (value, sigma): &(DVector<f64>, DVector<f64>)) -> (f64, f64) {
    let off = value.zip_map(sigma, |v, s| v / part.worth.hypot(s));
    (if off.len() < 9 { off.norm() } else { off.amax() }, sigma.max() / part.worth)
}

fn verdict(off: f64) -> Fitness {
    Fitness::within(off, SIGMAS, FAULT_SIGMAS)
}

/// A part that holds for the whole recording.
fn constant(causes: &Causes<'_>, k: usize, part: &Part, found: &[Cause]) -> Measure {
    let values = causes.values(k, Course::Constant, found);
    let (off, poor) = off(part, &values[0]);
    // Of columns the signs have to show, which flights without side slip do not.
    let gains = [0, 4, 8].map(|k| values[0].1.get(k).map_or(0.0, |sigma| SIGMAS * SIGMAS * sigma));
    let poor = if part.counted == 9 { gains.into_iter().fold(0.0, f64::max) } else { poor };
    let (worst, sigma) = (verdict(off), values[0].1.map(|sigma| part.worth.hypot(sigma)));
    let value = words(part, &values[0].0, &sigma);
    let figures = [("step", values[0].0[values[0].0.iamax()]), ("sigma", sigma.max())];
    let measure = if poor > SIGMAS && worst == Fitness::Good {
        Measure::new(part.name, Fitness::Uncertain, value, part.motion.unwrap_or(HOLD), &figures)
    } else {
        let set = |before| format!("set `{} = {:.4}`", part.cure, before + values[0].0[0]);
        let cure = part.configured.map_or_else(|| part.cure.to_owned(), set);
        Measure::new(part.name, worst, format!("off by {value}"), cure, &figures)
    };
    measure.shown_by(part.motion.filter(|_| part.counted < 9 || poor > SIGMAS))
}

fn of_cause(causes: &Causes<'_>, parts: &[Part], cause: &Cause, found: &[Cause], fitted: &Fitted) -> Measure {
    let part = &parts[cause.part];
    if cause.course == Course::Constant {
        let mut measure = constant(causes, cause.part, part, found);
        let columns = if part.basis.ncols() == 9 { columns(part, fitted) } else { None };
        if let Some(words) = columns {
            measure.value = format!("{words} ({})", measure.value);
        }
        return measure;
    }
    let values = causes.values(cause.part, cause.course, found);
    // The component that changes most: scatter in standard deviations, and from where to where.
    let changes = |i: usize| {
        let mean = values.iter().map(|(value, _)| value[i]).sum::<f64>() / values.len() as f64;
        let off =
            |(value, sigma): &(DVector<f64>, DVector<f64>)| (value[i] - mean) / part.worth.hypot(sigma[i]);
        let scatter = (values.iter().map(|v| off(v).powi(2)).sum::<f64>() / values.len() as f64).sqrt();
        let known = values.iter().filter(|(value, sigma)| sigma[i] < value[i].abs() / SIGMAS);
        let (low, high) = known.fold((0.0, 0.0), |(low, high), (v, _)| (v[i].min(low), v[i].max(high)));
        (scatter, low, high)
    };
    let most = (0..part.counted).map(changes).max_by(|a, b| a.0.total_cmp(&b.0));
    let (scatter, low, high) = most.unwrap_or_default();
    let cure = match part.subject {
        0 => "a lens with autofocus, or whose focus moves: fix it, and calibrate with that focus",
        4..=5 | 12..=13 => "the mount is loose: fasten cameras and IMU to each other",
        6 => "stamp samples and images by one clock, when they are measured: the delay between them changes",
        _ => part.cure,
    };
    let [low, high] = [low, high].map(|value: f64| value * part.unit.1);
    let value = format!("changes over the recording, from {low:+.3} to {high:+.3} {}", part.unit.0);
    Measure::new(part.name, verdict(scatter), value, cure, &[("scatter_sigmas", scatter)])
}

/// Columns that stand for x, y and z where they are not these.
fn columns(part: &Part, fitted: &Fitted) -> Option<String> {
    let matrix = fitted.rig.sensor(if part.subject == 10 { GYRO } else { ACCEL }).0;
    let name = |row: usize| {
        let at = matrix.row(row).transpose().iamax();
        format!("{}{}", if matrix[(row, at)] < 0.0 { "-" } else { "" }, AXES[at])
    };
    let names: Vec<String> = (0..3).map(name).collect();
    (names != AXES).then(|| {
        format!("columns are swapped or negated: x y z of the body are {} as delivered", names.join(" "))
    })
}

/// Values with their standard deviations; of the columns of a sensor the one that is off most.
fn words(part: &Part, values: &DVector<f64>, sigmas: &DVector<f64>) -> String {
    let (unit, size) = part.unit;
    let list = |values: &DVector<f64>| {
        values.iter().map(|value| format!("{:.3}", value * size)).collect::<Vec<_>>().join(" ")
    };
    if values.len() < 9 {
        return format!("{} {unit}, one sigma {}", list(values), list(sigmas));
    }
    let most = values.component_div(sigmas).iamax();
    let [value, sigma] = [values, sigmas].map(|of| of[most] * size);
    format!(
        "{value:.3} {unit} ({} of the body by {} as delivered), one sigma {sigma:.3}",
        AXES[most / 3],
        AXES[most % 3]
    )
}
