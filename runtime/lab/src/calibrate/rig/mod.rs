//! Where the cameras sit on the IMU, and how far their clocks are apart: by the estimator itself, over a recording in which the
//! rig is moved and turned by hand.
//!
//! The estimator refines place and attitude of the left camera in the body and the time offset as it goes. Here these are
//! set free, and a recording is estimated in pieces (`pass`) that are put together (`fuse`) to a calibration with its
//! covariance. That is done again from the calibration that came out, until it stays: the stereo search, the time stamps
//! and the Jacobians of the first pass are those of the calibration that it began with. What the motion did not
//! show (`motion`) is refused by name. Before that the readout of a rolling shutter can be looked for (`readout`). How the cameras sit to each other is not touched: that is the calibration
//! of the cameras.

mod fuse;
mod motion;
mod pass;
mod readout;
#[cfg(test)]
mod tests;

pub use fuse::{Covariance, DIM, Fused, Step, fuse};
pub use motion::{Excitation, LEAST_RATE_RAD_S, axis_words};
pub use readout::FoundReadout;

use nalgebra::Vector3;
use pass::{Pass, pass};
use plumbline_config::options::rows_from_isometry;
use plumbline_config::{ConfigError, ImuSample, ValidConfig};
use plumbline_estimator::window::state::{RIG_DIM, Rig};
use plumbline_flight::flight::{Flight, FlightError};
use std::fmt::Write as _;
use thiserror::Error;

/// Fewest pieces that a scatter can be seen in.
const LEAST_PIECES: usize = 3;
/// A pass that moves nothing by more than this part of its standard deviation has settled.
const SETTLED_SIGMAS: f64 = 0.25;
/// Standard deviations that a calibration is worth its name with: m, rad, s.
const MOST_SIGMAS: [f64; 3] = [0.015, 0.0052, 0.001];

/// Options of a rig's calibration.
#[derive(Clone, Debug, PartialEq)]
pub struct RigOptions {
    /// Uncertainty of the calibration to begin with, one standard deviation: attitude, rad.
    pub rotation_sigma_rad: f64,
    /// Place, m.
    pub translation_sigma_m: f64,
    /// Time offset, s.
    pub time_offset_sigma_s: f64,
    /// Length of a piece, s.
    pub piece_s: f64,
    /// Passes, at most.
    pub max_passes: usize,
    /// True if the readout of a rolling shutter is looked for first.
    pub finds_readout: bool,
}

impl Default for RigOptions {
    fn default() -> Self {
        Self {
            rotation_sigma_rad: 0.035,
            translation_sigma_m: 0.03,
            time_offset_sigma_s: 0.01,
            piece_s: 8.0,
            max_passes: 5,
            finds_readout: false,
        }
    }
}

/// Result.
#[derive(Clone, Debug)]
pub struct FoundRig {
    /// The configuration with the calibration in it.
    pub config: ValidConfig,
    /// The calibration.
    pub rig: Rig,
    /// Step from the calibration to begin with.
    pub step: Step,
    /// Covariance of place (m, body), attitude (rad, camera) and time offset (s).
    pub covariance: Covariance,
    /// By how much the scatter of the pieces made the standard deviations grow: place, attitude, time.
    pub growth: [f64; 3],
    /// Pieces used.
    pub pieces: usize,
    /// Pieces without a pose, or that lost it.
    pub lost: usize,
    /// Passes made.
    pub passes: usize,
    /// Length of the recording, s.
    pub span_s: f64,
    /// Turning of the rig.
    pub excitation: Excitation,
    /// Readout of the cameras, where it was looked for.
    pub readout: Option<FoundReadout>,
}

/// Why there is no calibration.
#[derive(Debug, Error)]
pub enum RigError {
    /// The recording cannot be opened or read.
    #[error(transparent)]
    Flight(#[from] FlightError),
    /// The configuration is refused.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The recording does not show the rig.
    #[error("{0}")]
    Unseen(String),
}

impl RigError {
    /// Too few pieces of a recording are usable.
    fn too_short(span_s: f64, pieces: usize, piece_s: f64, lost: usize) -> Self {
        Self::Unseen(format!(
            "the recording has {span_s:.1} s, but only {pieces} pieces of {piece_s} s are usable; record a minute, with texture in \
             view all the time ({lost} pieces lost tracking)"
        ))
    }
}

/// Calibrates the rig of `config`. `open` opens the recording from its beginning, each time anew; `progress` is told pass and
/// frames so far.
///
/// # Errors
/// When the recording cannot be read, or does not show the rig; the message says what it lacks.
pub fn calibrate(
    config: &ValidConfig,
    options: &RigOptions,
    open: &mut dyn FnMut(&ValidConfig) -> Result<Flight, FlightError>,
    progress: &mut dyn FnMut(usize, u64),
) -> Result<FoundRig, RigError> {
    let mut config = config.clone();
    let mut now = set_free(&config, options)?;
    let samples = all_samples(open(&now)?)?;
    let excitation = turned(&samples, &now)?;
    let readout = options.finds_readout.then(|| readout::find(&now, options, open, progress)).transpose()?;
    if let Some(found) = &readout {
        config = readout::with_readout(&config, found.readout_s)?;
        now = readout::with_readout(&now, found.readout_s)?;
    }
    let before = if readout.is_some() { readout::PASSES } else { 0 };
    let begin = Rig::of(now.setup());
    let mut largest = f64::INFINITY;
    for number in 1..=options.max_passes {
        let start = Rig::of(now.setup());
        let found = pass(open(&now)?, now.setup(), options.piece_s, &mut |frames| {
            progress(before + number, frames);
        })?;
        let fused = put_together(&found, &start, &now, options)?;
        let rig = moved(&start, &fused.step);
        largest = (0..DIM).map(|k| fused.step[k].abs() / fused.covariance[(k, k)].sqrt()).fold(0.0, f64::max);
        now = with_rig(&now, &rig)?;
        if largest < SETTLED_SIGMAS {
            check_seen(&fused, &excitation, &rig)?;
            let step = step_between(&begin, &rig);
            let Fused { covariance, growth, .. } = fused;
            let Pass { pieces, lost, span_s, .. } = found;
            let (pieces, passes) = (pieces.len(), number);
            let config = finished(&config, &rig, &covariance)?;
            return Ok(FoundRig {
                config,
                rig,
                step,
                covariance,
                growth,
                pieces,
                lost,
                passes,
                span_s,
                excitation,
                readout,
            });
        }
    }
    Err(RigError::Unseen(format!(
        "the calibration does not converge in {} passes: it still changes by {largest:.1} standard deviations; is the calibration of \
         the cameras that of this rig, and does the recording begin at rest?",
        options.max_passes
    )))
}

/// The configuration to estimate with: the rig free, points alone.
fn set_free(config: &ValidConfig, options: &RigOptions) -> Result<ValidConfig, ConfigError> {
    config.with("calibrate rig", |config| {
        config.rig.camera_imu_rotation_sigma_rad = options.rotation_sigma_rad;
        config.rig.camera_imu_translation_sigma_m = options.translation_sigma_m;
        config.rig.time_offset_sigma_s = options.time_offset_sigma_s;
        config.estimator.window.correct_stamps = false;
        // The rig of a calibration is a constant.
        config.rig.memory_s = 0.0;
        (config.rig.camera_focal_sigma, config.rig.camera_centre_sigma_px) = (0.0, 0.0);
        config.estimator.lines.enabled = false;
    })
}

fn all_samples(flight: Flight) -> Result<Vec<ImuSample>, FlightError> {
    let mut imu = flight.imu;
    let mut samples = Vec::new();
    while let Some(reading) = imu.next_reading()? {
        samples.push(reading.sample);
    }
    Ok(samples)
}

/// Turning of the rig, if that is enough.
fn turned(samples: &[ImuSample], config: &ValidConfig) -> Result<Excitation, RigError> {
    let Some(excitation) = Excitation::of(samples) else {
        return Err(RigError::too_short(0.0, 0, 0.0, 0));
    };
    if excitation.is_enough() {
        return Ok(excitation);
    }
    let pose_b_c = config.setup().left().pose_b_c();
    let missing: Vec<_> = excitation.missing().iter().map(|axis| axis_words(axis, &pose_b_c)).collect();
    let rates = excitation.body_rates_rad_s.map(f64::to_degrees);
    Err(RigError::Unseen(format!(
        "the motion does not determine the rig: it lacks rotation about {} (rates about x y z of the IMU: {:.0} {:.0} {:.0} deg/s); \
         turn it about all axes, by 20 degrees and more to both sides, once a second or two",
        missing.join(" and about "),
        rates.x,
        rates.y,
        rates.z
    )))
}

fn put_together(
    found: &Pass,
    start: &Rig,
    config: &ValidConfig,
    options: &RigOptions,
) -> Result<Fused, RigError> {
    let sigmas = Rig::sigmas(&config.rig, &config.camera);
    let fused = if found.pieces.len() < LEAST_PIECES { None } else { fuse(&found.pieces, start, &sigmas) };
    fused.ok_or_else(|| RigError::too_short(found.span_s, found.pieces.len(), options.piece_s, found.lost))
}

/// `start` with the step applied.
fn moved(start: &Rig, step: &Step) -> Rig {
    let mut whole = nalgebra::SVector::<f64, RIG_DIM>::zeros();
    whole.fixed_rows_mut::<6>(Rig::P_B_C0).copy_from(&step.fixed_rows::<6>(0));
    whole[Rig::TIME_OFFSET] = step[6];
    start.plus(&whole)
}

fn step_between(from: &Rig, to: &Rig) -> Step {
    let step = to.minus(from);
    let mut own = Step::zeros();
    own.fixed_rows_mut::<6>(0).copy_from(&step.fixed_rows::<6>(Rig::P_B_C0));
    own[6] = step[Rig::TIME_OFFSET];
    own
}

/// The configuration with this rig in it; how the cameras sit to each other stays.
fn with_rig(config: &ValidConfig, rig: &Rig) -> Result<ValidConfig, ConfigError> {
    config.with("calibrate rig", |config| {
        for (k, camera) in config.camera.iter_mut().enumerate() {
            camera.pose_b_c = rows_from_isometry(&rig.pose_b_c(k));
        }
        config.rig.time_offset_s = rig.time_offset_s;
    })
}

/// The configuration as it was, with this rig and how well it is known.
fn finished(config: &ValidConfig, rig: &Rig, covariance: &Covariance) -> Result<ValidConfig, ConfigError> {
    let sigma = |range: std::ops::Range<usize>| range.map(|k| covariance[(k, k)].sqrt()).fold(0.0, f64::max);
    with_rig(config, rig)?.with("calibrate rig", |config| {
        config.rig.camera_imu_translation_sigma_m = sigma(0..3);
        config.rig.camera_imu_rotation_sigma_rad = sigma(3..6);
        config.rig.time_offset_sigma_s = sigma(6..7);
    })
}

/// Refuses what the motion did not show.
fn check_seen(fused: &Fused, excitation: &Excitation, rig: &Rig) -> Result<(), RigError> {
    let sigma =
        |range: std::ops::Range<usize>| range.map(|k| fused.covariance[(k, k)].sqrt()).fold(0.0, f64::max);
    let [place, attitude, time] = [sigma(0..3), sigma(3..6), sigma(6..7)];
    let (what, sigma) = if place > MOST_SIGMAS[0] {
        ("the place of the cameras", format!("{:.1} mm", 1e3 * place))
    } else if attitude > MOST_SIGMAS[1] {
        ("the attitude of the cameras", format!("{:.2} degrees", attitude.to_degrees()))
    } else if time > MOST_SIGMAS[2] {
        ("the time offset", format!("{:.2} ms", 1e3 * time))
    } else {
        return Ok(());
    };
    let weakest = axis_words(&excitation.axes_b[2], &rig.pose_b_c0);
    Err(RigError::Unseen(format!(
        "the motion does not determine the rig well enough: {what} is known to {sigma} only; turn it faster, most of all about \
         {weakest}, and for longer"
    )))
}

impl FoundRig {
    /// The figures, a line each.
    #[must_use]
    pub fn table(&self) -> Vec<String> {
        let sigma = |k: usize| self.covariance[(k, k)].sqrt();
        let three = |from: usize, scale: f64| Vector3::from_fn(|k, _| sigma(from + k) * scale);
        let degrees = 180.0 / std::f64::consts::PI;
        let p = 1e3 * self.rig.pose_b_c0.translation.vector;
        let (ps, moved_p) = (three(0, 1e3), 1e3 * self.step.fixed_rows::<3>(0).into_owned());
        let (rs, moved_r) = (three(3, degrees), degrees * self.step.fixed_rows::<3>(3).into_owned());
        let rates = self.excitation.body_rates_rad_s * degrees;
        let words = |v: &Vector3<f64>, decimals: usize| {
            format!("{:.*} {:.*} {:.*}", decimals, v.x, decimals, v.y, decimals, v.z)
        };
        let readout = self.readout.map(|found| match found.readout_s {
            0.0 => format!("readout        none: a global shutter (one sigma {:.2} ms)", 1e3 * found.sigma_s),
            readout_s => {
                format!("readout        {:.2} ms, one sigma {:.2} ms", 1e3 * readout_s, 1e3 * found.sigma_s)
            }
        });
        let mut lines = vec![
            format!("left camera    at ({}) mm in the body, one sigma ({})", words(&p, 2), words(&ps, 2)),
            format!("               moved by ({}) mm", words(&moved_p, 2)),
            format!("attitude       one sigma ({}) deg about its x, y and z", words(&rs, 4)),
            format!("               turned by ({}) deg", words(&moved_r, 4)),
            format!(
                "time offset    {:.3} ms (t_imu - t_camera), one sigma {:.3}, moved by {:.3} ms",
                1e3 * self.rig.time_offset_s,
                1e3 * sigma(6),
                1e3 * self.step[6]
            ),
            format!(
                "of             {} pieces in {:.1} s ({} lost), {} passes; turned by {} deg/s about x y z of the IMU",
                self.pieces,
                self.span_s,
                self.lost,
                self.passes,
                words(&rates, 0)
            ),
            format!(
                "scatter        the pieces scatter {:.1}, {:.1}, {:.1} times as much as they say of themselves (place, \
                 attitude, time; at least 1): in the sigmas",
                self.growth[0], self.growth[1], self.growth[2]
            ),
        ];
        lines.extend(readout);
        lines
    }

    /// The covariance as comments of a file: rows of place (m), attitude (rad) and time offset (s).
    #[must_use]
    pub fn covariance_comment(&self) -> String {
        let mut text = String::from(
            "# Covariance of place x y z in the body (m), attitude about x y z of the left camera (rad), time offset (s):\n",
        );
        for row in self.covariance.row_iter() {
            text.push_str("#  ");
            for value in row.iter() {
                let _ = write!(text, " {value:.3e}");
            }
            text.push('\n');
        }
        text
    }
}
