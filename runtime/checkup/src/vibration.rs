//! The spectrum of the IMU: how loud it is against the configured noise, which lines stand out, and what these may be.
//!
//! Mean of overlapping periodograms with a Hann window (Welch 1967), one-sided, in units² per Hz. A white noise of density
//! `sigma` (per sqrt(Hz), as configured) has the level `2 sigma²`. Below [`LOWEST_HZ`] is flight, above is vibration. What
//! turns faster than half the rate is sampled as something slower: a line at `f` may be one at `k rate - f` or
//! `k rate + f`, and the samples alone do not say which. A few periodograms that are far louder than the others are of blows, and are
//! left out.

use crate::fft::power;
use crate::statistics::median;
use crate::verdict::{Fitness, Measure};
use nalgebra::Vector3;
use plumbline_config::ImuSample;
use plumbline_config::options::ImuConfig;
use std::f64::consts::TAU;
use std::fmt::Write as _;
use std::ops::Range;

/// Vibration begins here, Hz: a vehicle does not fly faster than that.
const LOWEST_HZ: f64 = 10.0;
/// Length of a periodogram, s; lines are told apart by a hertz or two.
const PIECE_S: f64 = 1.28;
/// Periodograms that are needed.
const MIN_PIECES: usize = 3;
/// Periodograms are those of a blow from this multiple of the median power on, if at most this number follow each other (they overlap),
/// and all are at most this share.
const BLOW: f64 = 10.0;
const MAX_IN_BLOW: usize = 3;
const MAX_BLOWS: f64 = 0.34;
/// An interval that differs by this share from the usual one is a gap, and no periodogram crosses it.
const GAP: f64 = 0.5;
/// A line stands above the median of the spectrum by this factor.
const LINE: f64 = 25.0;
/// Lines that are told, at most.
const MAX_LINES: usize = 3;
/// Root mean square of a line that is minded, m/s² and rad/s.
const LOUD: (f64, f64) = (1.0, 0.05);
/// Equivalent white noise against the configured density.
const LEVEL: (f64, f64) = (3.0, 10.0);
/// Rotors and their blades, Hz: what aliases are looked for in.
const ROTORS_HZ: std::ops::RangeInclusive<f64> = 40.0..=600.0;
/// A line above this share of half the rate lies near it.
const NEAR_NYQUIST: f64 = 0.85;

/// A line of the spectrum.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpectralLine {
    /// Frequency as sampled, Hz.
    pub hz: f64,
    /// Root mean square over the axes together, in the sensor's unit.
    pub rms: f64,
}

/// The spectrum of one sensor, its axes together.
#[derive(Clone, Debug)]
pub struct Spectrum {
    /// From one entry to the next, Hz.
    pub step_hz: f64,
    /// One-sided level of each frequency from 0 to half the rate, units² per Hz, summed over the axes.
    pub level: Vec<f64>,
    /// Blows that are left out: time, s after the first sample, and largest deviation from the mean around.
    pub blows: Vec<(f64, f64)>,
}

/// Periodogram of some samples.
struct Periodogram {
    first: usize,
    level: Vec<f64>,
    /// Sum of the levels from [`LOWEST_HZ`] on.
    power: f64,
}

/// The spectrum of a sensor; `None` without long enough pieces free of gaps.
#[must_use]
pub fn spectrum(samples: &[ImuSample], of: impl Fn(&ImuSample) -> [f64; 3]) -> Option<Spectrum> {
    let intervals: Vec<f64> =
        samples.windows(2).map(|pair| pair[1].stamp.seconds_since(pair[0].stamp)).collect();
    let usual = median(&intervals);
    let is_usable = usual > 1e-5 && usual < 0.1;
    if !is_usable {
        return None;
    }
    let length = ((PIECE_S / usual) as usize).next_power_of_two().max(64);
    let window: Vec<f64> = (0..length).map(|k| 0.5 - 0.5 * (TAU * k as f64 / length as f64).cos()).collect();
    // |X|² over rate and power of the window is the level of both sides.
    let scale = 2.0 * usual / window.iter().map(|w| w * w).sum::<f64>();
    let step_hz = 1.0 / (usual * length as f64);
    let (mut pieces, mut start) = (Vec::new(), 0);
    while start + length <= samples.len() {
        let is_gap = |dt: &f64| (dt / usual - 1.0).abs() > GAP;
        if let Some(at) = intervals[start..start + length - 1].iter().rposition(is_gap) {
            start += at + 1;
            continue;
        }
        let piece = &samples[start..start + length];
        let mut level = vec![0.0; length / 2 + 1];
        for axis in 0..3 {
            let mean = piece.iter().map(|sample| of(sample)[axis]).sum::<f64>() / length as f64;
            let series: Vec<f64> =
                piece.iter().zip(&window).map(|(sample, w)| (of(sample)[axis] - mean) * w).collect();
            level.iter_mut().zip(power(&series)).for_each(|(level, power)| *level += scale * power);
        }
        let power = level[first_of_band(step_hz, level.len())..].iter().sum();
        pieces.push(Periodogram { first: start, level, power });
        start += length / 2;
    }
    let (quiet, loud) = without_blows(pieces);
    let mean = |k: usize| quiet.iter().map(|piece| piece.level[k]).sum::<f64>() / quiet.len() as f64;
    let blows = loud.iter().map(|piece| peak(samples, piece.first..piece.first + length, &of)).collect();
    (quiet.len() >= MIN_PIECES).then(|| Spectrum {
        step_hz,
        level: (0..=length / 2).map(mean).collect(),
        blows: apart(blows),
    })
}

/// Index of the first frequency that is vibration.
fn first_of_band(step_hz: f64, count: usize) -> usize {
    ((LOWEST_HZ / step_hz).ceil() as usize).min(count - 1)
}

/// The usual periodograms, and those of blows.
fn without_blows(pieces: Vec<Periodogram>) -> (Vec<Periodogram>, Vec<Periodogram>) {
    let limit = BLOW * median(&pieces.iter().map(|piece| piece.power).collect::<Vec<_>>());
    let is_loud: Vec<bool> = pieces.iter().map(|piece| piece.power > limit).collect();
    let of_run = |run: &[bool]| vec![run[0] && run.len() <= MAX_IN_BLOW; run.len()];
    let are_blows: Vec<bool> = is_loud.chunk_by(|a, b| a == b).flat_map(of_run).collect();
    let count = are_blows.iter().filter(|is_blow| **is_blow).count() as f64;
    let are_few = count <= MAX_BLOWS * pieces.len() as f64;
    let (mut quiet, mut loud) = (Vec::new(), Vec::new());
    for (piece, is_blow) in pieces.into_iter().zip(are_blows) {
        let those = if is_blow && are_few { &mut loud } else { &mut quiet };
        those.push(piece);
    }
    (quiet, loud)
}

/// Time of the sample that is furthest from the mean of some, s after the first of all, and how far.
fn peak(samples: &[ImuSample], range: Range<usize>, of: impl Fn(&ImuSample) -> [f64; 3]) -> (f64, f64) {
    let values: Vec<Vector3<f64>> = samples[range.clone()].iter().map(|sample| of(sample).into()).collect();
    let middle = Vector3::from_fn(|k, _| median(&values.iter().map(|value| value[k]).collect::<Vec<_>>()));
    let sizes = values.iter().zip(range).map(|(value, k)| (k, (value - middle).norm()));
    let (k, size) = sizes.max_by(|a, b| a.1.total_cmp(&b.1)).unwrap_or((0, 0.0));
    (samples[k].stamp.seconds_since(samples[0].stamp), size)
}

/// Blows without those of the same time: periodograms overlap.
fn apart(blows: Vec<(f64, f64)>) -> Vec<(f64, f64)> {
    let mut found: Vec<(f64, f64)> = Vec::new();
    for blow in blows {
        match found.last_mut().filter(|last| blow.0 - last.0 < PIECE_S) {
            Some(last) if last.1 < blow.1 => *last = blow,
            Some(_) => {}
            None => found.push(blow),
        }
    }
    found
}

impl Spectrum {
    /// Half the rate, Hz.
    #[must_use]
    pub fn nyquist_hz(&self) -> f64 {
        self.step_hz * (self.level.len() - 1) as f64
    }

    /// The part that is vibration, with the index of its first entry.
    fn band(&self) -> (usize, &[f64]) {
        let first = first_of_band(self.step_hz, self.level.len());
        (first, &self.level[first..])
    }

    /// Density of the white noise of equal power in the band, per axis and sqrt(Hz).
    #[must_use]
    pub fn density(&self) -> f64 {
        let (_, band) = self.band();
        (band.iter().sum::<f64>() / band.len() as f64 / 3.0 / 2.0).sqrt()
    }

    /// Root mean square in the band, axes together.
    #[must_use]
    pub fn rms(&self) -> f64 {
        (self.band().1.iter().sum::<f64>() * self.step_hz).sqrt()
    }

    /// The lines that stand out, the loudest first.
    #[must_use]
    pub fn lines(&self) -> Vec<SpectralLine> {
        let (first, band) = self.band();
        let floor = median(band);
        let mut found = Vec::new();
        for (k, level) in band.iter().enumerate() {
            let around = &band[k.saturating_sub(2)..(k + 3).min(band.len())];
            // A local maximum: strictly above what follows, so that one of two equal ones counts.
            let is_top = band[k.saturating_sub(2)..k].iter().all(|other| other < level)
                && band[k + 1..(k + 3).min(band.len())].iter().all(|other| other <= level);
            if is_top && *level > LINE * floor {
                let rms = (around.iter().sum::<f64>() * self.step_hz).sqrt();
                found.push(SpectralLine { hz: self.step_hz * (first + k) as f64, rms });
            }
        }
        found.sort_by(|a, b| b.rms.total_cmp(&a.rms).then(a.hz.total_cmp(&b.hz)));
        found.truncate(MAX_LINES);
        found
    }
}

/// Frequencies of rotors that would be sampled as `hz`, beside itself.
#[must_use]
pub fn aliases(hz: f64, rate_hz: f64) -> Vec<f64> {
    let candidates = (1..=3).flat_map(|k| [f64::from(k) * rate_hz - hz, f64::from(k) * rate_hz + hz]);
    candidates.filter(|hz| ROTORS_HZ.contains(hz)).take(3).collect()
}

/// Judges both sensors.
#[must_use]
pub fn judge(samples: &[ImuSample], imu: &ImuConfig) -> Vec<Measure> {
    let accel = spectrum(samples, |sample| sample.accel.into());
    let gyro = spectrum(samples, |sample| sample.gyro.into());
    let one = |name, spectrum: Option<Spectrum>, density, loud, unit| match spectrum {
        Some(spectrum) => judge_one(name, &spectrum, density, loud, unit),
        None => Measure::missing(name, "no four seconds without a gap", "record ten seconds, motors running"),
    };
    vec![
        one(
            "vibration of the accelerometer",
            accel,
            ("imu.accel_noise_density", imu.accel_noise_density),
            LOUD.0,
            "m/s²",
        ),
        one(
            "vibration of the gyroscope",
            gyro,
            ("imu.gyro_noise_density", imu.gyro_noise_density),
            LOUD.1,
            "rad/s",
        ),
    ]
}

/// Blows in words; empty without any.
fn blow_words(blows: &[(f64, f64)], unit: &str) -> String {
    let Some((time_s, size)) = blows.iter().copied().max_by(|a, b| a.1.total_cmp(&b.1)) else {
        return String::new();
    };
    let at = format!("of {size:.1} {unit} at {time_s:.1} s after the first sample");
    match blows.len() {
        1 => format!(" without a blow {at}"),
        count => format!(" without {count} blows, the largest {at}"),
    }
}

fn judge_one(
    name: &'static str,
    spectrum: &Spectrum,
    (key, configured): (&str, f64),
    loud: f64,
    unit: &str,
) -> Measure {
    let (rate_hz, density) = (2.0 * spectrum.nyquist_hz(), spectrum.density());
    let lines = spectrum.lines();
    let ratio = density / configured;
    let mut verdict = Fitness::within(ratio, LEVEL.0, LEVEL.1);
    if lines.iter().any(|line| line.rms > loud) {
        verdict = verdict.max(Fitness::Mind);
    }
    let mut value = format!(
        "{:.3} {unit} rms from {LOWEST_HZ:.0} to {:.0} Hz, {ratio:.1} times the configured noise",
        spectrum.rms(),
        spectrum.nyquist_hz()
    );
    value += &blow_words(&spectrum.blows, unit);
    // At rest, with motors off, the noise of a data sheet or of an Allan deviation holds; in flight it is several times as much.
    let mut cure = format!(
        "if the configured noise is that of a data sheet or of a calibration at rest, set `{key} = {density:.2e}`, the noise in \
         flight (`plumbline config import --inflate 10`); else balance the propellers and damp the mounting"
    );
    for line in &lines {
        let _ = write!(value, "; line at {:.1} Hz, {:.3} {unit}", line.hz, line.rms);
        let aliases: Vec<String> = aliases(line.hz, rate_hz).iter().map(|hz| format!("{hz:.0}")).collect();
        if !aliases.is_empty() {
            let _ = write!(value, " (or aliased from {} Hz)", aliases.join(", "));
        }
        if line.hz > NEAR_NYQUIST * spectrum.nyquist_hz() {
            value += ", near half the rate";
        }
    }
    if !lines.is_empty() {
        cure += "; a line that moves against the throttle is an alias: filter in the sensor below half the rate, or \
                sample faster";
    }
    let loudest = lines.first().copied().unwrap_or(SpectralLine { hz: f64::NAN, rms: 0.0 });
    let figures = [
        ("rms", spectrum.rms()),
        ("times_configured", ratio),
        ("line_hz", loudest.hz),
        ("line_rms", loudest.rms),
        ("nyquist_hz", spectrum.nyquist_hz()),
    ];
    Measure::new(name, verdict, value, cure, &figures)
}
