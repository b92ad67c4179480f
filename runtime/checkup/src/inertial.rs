//! IMU at rest: gravity, its direction, the bias of the gyroscope, and axes that are stuck or at the end of
//! their range.

use crate::finding::Finding;
use crate::statistics::mean_and_spread;
use crate::verdict::{Fitness, Measure};
use nalgebra::Vector3;
use plumbline_config::options::ImuConfig;
use plumbline_config::{Config, ImuSample, Timestamp};

/// Length of a piece that is looked at for rest, s.
const PIECE_S: f64 = 0.5;
/// The vehicle rests while the gyroscope (rad/s) and the accelerometer (m/s²) scatter by less; a hand scatters by more.
const STILL: (f64, f64) = (0.02, 0.35);
/// Least time at rest in one attitude, s.
const MIN_STAND_S: f64 = 1.0;
/// Least time at rest in all, s: where images confirm it, and without.
const MIN_REST_S: (f64, f64) = (1.0, 2.0);
/// Deviation of gravity's magnitude, m/s²: what a bias of the accelerometer at switch-on explains, and what nothing does.
const GRAVITY: (f64, f64) = (0.4, 1.2);
/// An axis that repeats its value for so long is stuck, s, and so many samples.
const STUCK: (f64, usize) = (0.5, 50);
/// ... while another of its sensor changes from sample to sample in this share of them.
const ALIVE: f64 = 0.5;
/// This close to the end of the range counts as at it.
const AT_END: f64 = 0.995;
/// Noise over the configured one: that of a vehicle in flight against a data sheet, and what tracking hardly bears.
const NOISY: (f64, f64) = (3.0, 10.0);
/// Share of samples at the end of the range.
const SATURATED: (f64, f64) = (0.0, 0.002);

/// Measurements at rest.
#[derive(Clone, Copy, Debug, Default)]
pub struct Rest {
    /// Time at rest, s.
    pub seconds: f64,
    /// Mean of the gyroscope, rad/s.
    pub gyro: Vector3<f64>,
    /// Mean magnitude of the specific force, m/s², whichever way the vehicle stands.
    pub gravity_m_s2: f64,
    /// Mean of the accelerometer in the first attitude at rest, m/s²; its direction is the vertical.
    pub accel: Vector3<f64>,
    /// End of the time in the first attitude at rest.
    pub first_end: Option<Timestamp>,
    /// Least time at rest that is judged, s.
    least_s: f64,
}

/// The times in which the vehicle rests, by the samples alone.
pub fn rest(samples: &[ImuSample]) -> Rest {
    rest_of(samples, |_, _| false, MIN_REST_S.1)
}

/// The times in which the vehicle rests, outside of those in which images move.
pub(crate) fn rest_seen(samples: &[ImuSample], moving: &[(Timestamp, Timestamp)]) -> Rest {
    rest_of(samples, |begin, end| moving.iter().any(|(from, to)| *to > begin && *from < end), MIN_REST_S.0)
}

fn rest_of(samples: &[ImuSample], moves: impl Fn(Timestamp, Timestamp) -> bool, least_s: f64) -> Rest {
    let mut pieces = Vec::new();
    let mut from = 0;
    while let Some(first) = samples.get(from) {
        let end = first.stamp.plus_seconds(PIECE_S);
        let count = samples[from..].partition_point(|sample| sample.stamp < end).max(1);
        pieces.push((end, still(&samples[from..from + count]).filter(|_| !moves(first.stamp, end))));
        from += count;
    }
    let mut found = Rest { least_s, ..Rest::default() };
    // In one attitude, and for more than a moment.
    for stand in pieces.chunk_by(|(_, a), (_, b)| a.zip(*b).is_some_and(is_same_attitude)) {
        let means: Vec<_> = stand.iter().filter_map(|(_, means)| *means).collect();
        let seconds = means.len() as f64 * PIECE_S;
        if seconds < MIN_STAND_S {
            continue;
        }
        if found.first_end.is_none() {
            found.first_end = stand.last().map(|(end, _)| *end);
            found.accel = means.iter().map(|(_, accel)| accel).sum::<Vector3<f64>>() / means.len() as f64;
        }
        let weight = PIECE_S / (found.seconds + seconds);
        let (gyro, gravity) = means.iter().fold((Vector3::zeros(), 0.0), |(gyro, gravity), means| {
            (gyro + means.0, gravity + means.1.norm())
        });
        let before = found.seconds / (found.seconds + seconds);
        found.gyro = found.gyro * before + gyro * weight;
        found.gravity_m_s2 = found.gravity_m_s2 * before + gravity * weight;
        found.seconds += seconds;
    }
    found
}

/// Mean of the gyroscope and of the accelerometer.
type Means = (Vector3<f64>, Vector3<f64>);

fn is_same_attitude((a, b): (Means, Means)) -> bool {
    (a.0 - b.0).norm() < STILL.0 && (a.1 - b.1).norm() < STILL.1
}

/// Means of gyroscope and accelerometer in a piece of time in which both scatter little.
fn still(piece: &[ImuSample]) -> Option<Means> {
    let span_s = piece.last()?.stamp.seconds_since(piece.first()?.stamp);
    let (gyro, turning) = mean_and_spread(piece.iter().map(|sample| sample.gyro));
    let (accel, shaking) = mean_and_spread(piece.iter().map(|sample| sample.accel));
    (span_s >= 0.8 * PIECE_S && turning < STILL.0 && shaking < STILL.1).then_some((gyro, accel))
}

impl Rest {
    /// True if the vehicle stood long enough for a verdict.
    pub(crate) fn is_enough(&self) -> bool {
        self.seconds > 0.0 && self.seconds >= self.least_s
    }

    /// A measure that needs the vehicle at rest: `judged`, unless it did not stand long enough.
    pub(crate) fn measure(&self, name: &'static str, judged: impl FnOnce() -> Measure) -> Measure {
        if !self.is_enough() {
            let cure = "let the vehicle stand for three seconds, motors off";
            return Measure::missing(name, "the vehicle never stood still", cure);
        }
        judged()
    }
}

/// Gravity and bias.
pub fn at_rest(rest: &Rest, config: &Config) -> [Measure; 2] {
    [("gravity", gravity as fn(&'static str, &Rest, &Config) -> Measure), ("gyroscope bias", bias)]
        .map(|(name, judge)| rest.measure(name, || judge(name, rest, config)))
}

fn gravity(name: &'static str, rest: &Rest, config: &Config) -> Measure {
    let norm = rest.gravity_m_s2;
    let off = (norm - config.imu.gravity_m_s2).abs();
    Measure::new(
        name,
        Fitness::within(off, GRAVITY.0, GRAVITY.1),
        format!("{norm:.3} m/s² over {:.1} s at rest, off by {off:.3}", rest.seconds),
        "calibrate the accelerometer (scale and bias); a factor of 9.8 or 1000 is a unit: m/s² is expected",
        &[("norm_m_s2", norm), ("off_m_s2", off), ("rest_s", rest.seconds)],
    )
}

fn bias(name: &'static str, rest: &Rest, config: &Config) -> Measure {
    let norm = rest.gyro.norm();
    // By axis, as the prior is.
    let largest = rest.gyro.amax();
    let (good, mind) =
        (config.imu.gyro_bias_sigma_rad_s, config.estimator.health.max_gyro_bias_rad_s.max(0.1) * 0.6);
    Measure::new(
        name,
        Fitness::within(largest, good, mind),
        format!("{:.4} {:.4} {:.4} rad/s at rest", rest.gyro.x, rest.gyro.y, rest.gyro.z),
        "let the sensor get warm and calibrate its gyroscope; a factor of 57 is a unit: rad/s is expected",
        &[("norm_rad_s", norm), ("largest_rad_s", largest)],
    )
}

/// Share of samples that a driver drops as impossible, beyond which it is no noise.
const REFUSED: f64 = 0.02;

/// Judges how many samples the driver refused as impossible, beside those that it handed out.
pub fn refused(count: u64, used: usize) -> Option<Finding> {
    let all = count + used as u64;
    (count as f64 > REFUSED * all as f64).then(|| {
        Finding::new(
            "samples of the IMU exceed its configured range",
            format!("{count} of {all} samples are beyond the range and were dropped"),
            "that the gyroscope is in degrees a second, or that the range is configured too small",
            "send rad/s and m/s^2; else set `imu.gyro_range_rad_s` and `imu.accel_range_m_s2` to those of the sensor",
        )
    })
}

/// Number of the axes of both sensors, and the names of these.
const AXES: usize = 6;
const SENSORS: [&str; 2] = ["gyroscope", "accelerometer"];

fn axis(sample: &ImuSample, axis: usize) -> f64 {
    if axis < 3 { sample.gyro[axis] } else { sample.accel[axis - 3] }
}

/// Axes that are stuck, and samples at the end of the range.
pub(crate) fn axes(samples: &[ImuSample], imu: &ImuConfig) -> Option<Measure> {
    const NAME: &str = "IMU axes";
    let longest = STUCK.1.max((STUCK.0 * imu.rate_hz) as usize);
    let stuck: Vec<String> = (0..AXES)
        .filter(|k| is_stuck(samples, *k, longest))
        .map(|k| format!("{} {}", SENSORS[k / 3], ["x", "y", "z"][k % 3]))
        .collect();
    if !stuck.is_empty() {
        let cure = "replace the sensor, or check its bus: the register that is read no longer changes";
        let value = format!("{} repeats its value", stuck.join(" and "));
        return Some(Measure::new(NAME, Fitness::NotFit, value, cure, &[("stuck_axes", stuck.len() as f64)]));
    }
    let at_end = |sample: &&ImuSample| {
        sample.gyro.amax() >= AT_END * imu.gyro_range_rad_s
            || sample.accel.amax() >= AT_END * imu.accel_range_m_s2
    };
    let saturated = samples.iter().filter(at_end).count();
    (samples.len() >= STUCK.1).then(|| {
        Measure::new(
            NAME,
            Fitness::within(saturated as f64 / samples.len() as f64, SATURATED.0, SATURATED.1),
            format!("{saturated} of {} samples at the end of the range", samples.len()),
            "choose a larger range of the sensor, damp its mounting, or correct `imu.gyro_range_rad_s` and `accel_range_m_s2`",
            &[("saturated_samples", saturated as f64)],
        )
    })
}

/// Noise of both sensors from sample to sample, with vibration, against the configured one. A third difference takes out what a
/// vehicle does; that of white noise is the root of 20 times it.
pub(crate) fn noise(samples: &[ImuSample], imu: &ImuConfig) -> Vec<Measure> {
    let of = |name: &'static str, density: f64, value: &dyn Fn(&ImuSample) -> Vector3<f64>| {
        let squares = samples.windows(4).map(|s| {
            (value(&s[3]) - value(&s[0]) - (value(&s[2]) - value(&s[1])) * 3.0).norm_squared() / (3.0 * 20.0)
        });
        let sigma = (squares.sum::<f64>() / samples.len().max(4) as f64).sqrt();
        let measured = sigma / imu.rate_hz.sqrt();
        Measure::new(
            name,
            Fitness::within(measured / density, NOISY.0, NOISY.1),
            format!("{sigma:.4} from sample to sample, {:.1} times the configured noise", measured / density),
            "damp the mounting of the IMU, and give the noise in flight as `imu.accel_noise_density` and `gyro_noise_density`; a \
             vibration above half the rate shows at a lower frequency: filter in the sensor, or sample faster",
            &[("density", measured)],
        )
    };
    vec![
        of("vibration of the accelerometer", imu.accel_noise_density, &|sample| sample.accel),
        of("vibration of the gyroscope", imu.gyro_noise_density, &|sample| sample.gyro),
    ]
}

/// True if an axis repeats itself for `longest` samples in which another of its sensor does not.
fn is_stuck(samples: &[ImuSample], k: usize, longest: usize) -> bool {
    let others = if k < 3 { 0..3 } else { 3..6 };
    let mut run = 0;
    for (i, pair) in samples.windows(2).enumerate() {
        run = if axis(&pair[0], k) == axis(&pair[1], k) { run + 1 } else { 0 };
        if run >= longest {
            let piece = &samples[i + 1 - run..=i + 1];
            let changes = |other: usize| {
                piece.windows(2).filter(|pair| axis(&pair[0], other) != axis(&pair[1], other)).count()
            };
            let lives = |other: usize| changes(other) as f64 >= ALIVE * run as f64;
            if others.clone().filter(|other| *other != k).any(lives) {
                return true;
            }
            run = 0;
        }
    }
    false
}
