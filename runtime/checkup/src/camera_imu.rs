//! Calibration of the cameras on the IMU: pose of the left camera in the body, and time offset, by a recording in which the rig is
//! turned and moved by hand.
//!
//! Points are followed through the recording, and the fit of the checkup (`fit`) holds all of the calibration but the wanted part as it is
//! configured. What the motion does not show, by the covariance of the fit, is refused by name.

use crate::fit::causes::{Causes, SIGMAS};
use crate::fit::parts::{CAMERA_IMU_POSITION, CAMERA_IMU_ROTATION, Course, READOUT_TIME, TIME_OFFSET, parts};
use crate::fit::rig::BIASES;
use crate::fit::{FirstLook, fit};
use crate::tracks::Tracker;
use nalgebra::{DMatrix, DVector, Isometry3, SMatrix, SVector, UnitQuaternion, Vector3};
use plumbline_config::options::rows_from_isometry;
use plumbline_config::{ConfigError, ImageView, ImuSample, Timestamp, ValidConfig};

/// Fewest pieces of two seconds whose scatter tells how sure they are: 20 s.
const LEAST_PIECES: usize = 10;
/// Standard deviations that a calibration is worth its name with: m, rad, s.
const MOST_SIGMAS: [f64; 3] = [0.015, 0.0052, 0.001];
/// Cure for a motion that does not determine the rig.
const TURN: &str =
    "turn it about all axes, by 20 degrees and more to both sides, once a second or two, and for longer";
/// A readout that is shorter is none, s.
const LEAST_READOUT_S: f64 = 0.001;

/// Parts of a calibration that place the cameras on the IMU, in the order of the unknowns.
const RIG: [&str; 3] = [CAMERA_IMU_POSITION, CAMERA_IMU_ROTATION, TIME_OFFSET];

/// Unknowns: position of the left camera (m, body), its attitude (rad, camera), time offset (s).
pub const DIM: usize = 7;
/// Vector of the unknowns.
pub type Step = SVector<f64, DIM>;
/// Covariance of the unknowns.
pub type Covariance = SMatrix<f64, DIM, DIM>;

/// Calibration of the cameras on the IMU.
#[derive(Clone, Debug)]
pub struct FoundRig {
    /// Initial configuration with the calibration in it, and its standard deviations in `[rig]`.
    pub config: ValidConfig,
    /// Change from the initial configuration.
    pub step: Step,
    /// Covariance of the calibration.
    pub covariance: Covariance,
    /// Pieces of two seconds that it comes from.
    pub pieces: usize,
    /// Length of the recording, s.
    pub span_s: f64,
}

/// Reason why there is no calibration.
#[derive(Debug, thiserror::Error)]
pub enum RigError {
    /// The calibration is refused by the configuration.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The recording does not show the rig.
    #[error("{0}")]
    Unseen(String),
}

/// Recording of a rig that is moved by hand.
pub struct ByHand {
    config: ValidConfig,
    tracker: Option<Tracker>,
    samples: Vec<ImuSample>,
}

impl ByHand {
    /// Empty recording of the rig of `config`.
    pub fn new(config: &ValidConfig) -> Self {
        Self { config: config.clone(), tracker: Tracker::new(config), samples: Vec::new() }
    }

    /// Takes an inertial sample.
    pub fn add_sample(&mut self, sample: &ImuSample) {
        self.samples.push(*sample);
    }

    /// Takes a frame with its number.
    pub fn add_frame(&mut self, number: u64, stamp: Timestamp, images: &[Option<ImageView<'_>>; 2]) {
        if let Some(tracker) = &mut self.tracker {
            tracker.add(number, stamp, images);
        }
    }

    /// Calibration that the recording shows.
    ///
    /// # Errors
    /// When the motion does not determine it; the message says what it lacks.
    pub fn calibrate(&self) -> Result<FoundRig, RigError> {
        let (pieces, moved, covariance) = self.freed(&RIG)?;
        let step = moved.fixed_rows::<DIM>(0).into_owned();
        let covariance = covariance.fixed_view::<DIM, DIM>(0, 0).into_owned();
        let config = calibrated(&self.config, &step, &covariance)?;
        check_seen(&covariance)?;
        Ok(FoundRig { config, step, covariance, pieces, span_s: self.span_s() })
    }

    /// Takes over the readout that the recording shows, from the first to the last row, and returns it with its standard deviation, s; 0
    /// where it does not differ from that of a global shutter.
    ///
    /// # Errors
    /// When the motion does not determine it; the message says what it lacks.
    pub fn find_readout(&mut self) -> Result<(f64, f64), RigError> {
        let [position, rotation, offset] = RIG;
        let (_, moved, covariance) = self.freed(&[READOUT_TIME, position, rotation, offset])?;
        let found_s = self.config.camera.first().map_or(0.0, |camera| camera.readout_s) + moved[0];
        let sigma_s = covariance[(0, 0)].sqrt();
        let is_none = found_s < LEAST_READOUT_S.max(SIGMAS * sigma_s);
        let readout_s = if is_none { 0.0 } else { found_s };
        self.config = self.config.with("calibrate rig", |config| {
            config.camera.iter_mut().for_each(|camera| camera.readout_s = readout_s);
        })?;
        Ok((readout_s, sigma_s))
    }

    fn span_s(&self) -> f64 {
        self.tracker.as_ref().map_or(0.0, |tracker| tracker.found.span_s())
    }

    /// Number of pieces, and change of the parts of these names that fits the recording best, with its covariance, in their order.
    fn freed(&self, names: &[&str]) -> Result<(usize, DVector<f64>, DMatrix<f64>), RigError> {
        let parts = parts(&self.config);
        let named = |name: &&str| parts.iter().position(|part| part.name == *name);
        let free: Vec<usize> = names.iter().filter_map(named).collect();
        let is_free =
            |k: usize| k >= BIASES || free.iter().any(|part| parts[*part].basis.row(k).amax() > 0.0);
        let tracks = self.tracker.as_ref().map(|tracker| &tracker.found).ok_or_else(|| self.too_short(0))?;
        let first = FirstLook::at(&self.config, tracks, &self.samples);
        if first.as_ref().is_some_and(|first| !first.turns_enough) {
            return Err(RigError::Unseen(format!(
                "the motion does not determine the rig: it hardly turns; {TURN}"
            )));
        }
        let fitted = first.and_then(|first| fit(&self.config, tracks, &self.samples, &first, &is_free));
        let pieces = fitted.as_ref().map_or(0, |fitted| fitted.pieces.len());
        let fitted = fitted.filter(|_| pieces >= LEAST_PIECES).ok_or_else(|| self.too_short(pieces))?;
        let free: Vec<_> = free.into_iter().map(|part| (part, Course::Constant)).collect();
        let (_, moved, covariance) = Causes::new(&fitted, &parts).freed(&free);
        let is_known = moved.iter().chain(&covariance).all(|x| x.is_finite());
        is_known.then_some((pieces, moved, covariance)).ok_or_else(|| {
            let words = "the motion does not determine the rig, or images and samples hold none together: is the calibration of the \
                         cameras theirs?";
            RigError::Unseen(format!("{words} {TURN}"))
        })
    }

    fn too_short(&self, pieces: usize) -> RigError {
        RigError::Unseen(format!(
            "the recording has {:.1} s, but only {pieces} pieces of two seconds are usable; record a minute, with texture in view all \
             the time",
            self.span_s()
        ))
    }
}

/// The configuration with this change of both cameras, whose pose to each other stays, and how well it is known.
fn calibrated(
    config: &ValidConfig,
    step: &Step,
    covariance: &Covariance,
) -> Result<ValidConfig, ConfigError> {
    let left = config.setup().left().pose_b_c();
    let turn = UnitQuaternion::from_scaled_axis(step.fixed_rows::<3>(3).into_owned());
    let place = left.translation.vector + step.fixed_rows::<3>(0);
    let moved = Isometry3::from_parts(place.into(), left.rotation * turn);
    let [place, attitude, time] = sigmas(covariance);
    config.with("calibrate rig", |config| {
        for camera in &mut config.camera {
            camera.pose_b_c = rows_from_isometry(&(moved * (left.inverse() * camera.pose_b_c())));
        }
        config.rig.time_offset_s += step[6];
        config.rig.camera_imu_translation_sigma_m = place;
        config.rig.camera_imu_rotation_sigma_rad = attitude;
        config.rig.time_offset_sigma_s = time;
    })
}

/// Largest standard deviations of position, attitude and time offset.
fn sigmas(covariance: &Covariance) -> [f64; 3] {
    [0..3, 3..6, 6..7].map(|range| range.map(|k| covariance[(k, k)].sqrt()).fold(0.0, f64::max))
}

/// Refuses what the motion did not show, and names the axis about which the attitude is known least: turns about any other show it.
fn check_seen(covariance: &Covariance) -> Result<(), RigError> {
    let sigmas = sigmas(covariance);
    let Some(which) = (0..3).find(|k| sigmas[*k] > MOST_SIGMAS[*k]) else { return Ok(()) };
    let attitude = covariance.fixed_view::<3, 3>(3, 3).into_owned().symmetric_eigen();
    let mut weakest = attitude.eigenvectors.column(attitude.eigenvalues.imax()).into_owned();
    weakest *= weakest[weakest.iamax()].signum();
    let known = [
        format!("the position of the cameras is known to {:.1} mm", 1e3 * sigmas[0]),
        format!("the attitude of the cameras is known to {:.2} degrees", sigmas[1].to_degrees()),
        format!("the time offset is known to {:.2} ms", 1e3 * sigmas[2]),
    ];
    Err(RigError::Unseen(format!(
        "the motion does not determine the rig: {} only, and it turns too little about axes across ({}) of the left camera; {TURN}",
        known[which],
        words(&weakest, 1)
    )))
}

impl FoundRig {
    /// The figures, a line each.
    pub fn table(&self) -> [String; 4] {
        let three = |from: usize| {
            [self.step, self.covariance.diagonal().map(f64::sqrt)]
                .map(|v| v.fixed_rows::<3>(from).into_owned())
        };
        let place = self.config.setup().left().pose_b_c().translation.vector;
        let [moved, place_sigma] = three(0).map(|v| words(&(v * 1e3), 2));
        let [turned, attitude_sigma] = three(3).map(|v| words(&v.map(f64::to_degrees), 4));
        let [offset, late, late_sigma] =
            [self.config.rig.time_offset_s, self.step[6], self.covariance[(6, 6)].sqrt()].map(|s| 1e3 * s);
        [
            format!(
                "left camera    at ({}) mm in the body, moved by ({moved}), one sigma ({place_sigma})",
                words(&(place * 1e3), 2)
            ),
            format!(
                "attitude       turned by ({turned}) deg about its x, y and z, one sigma ({attitude_sigma})"
            ),
            format!(
                "time offset    {offset:.3} ms (t_imu - t_camera), moved by {late:.3}, one sigma {late_sigma:.3}"
            ),
            format!("of             {} pieces of two seconds in {:.1} s", self.pieces, self.span_s),
        ]
    }
}

/// Three numbers.
fn words(v: &Vector3<f64>, decimals: usize) -> String {
    format!("{:.*} {:.*} {:.*}", decimals, v.x, decimals, v.y, decimals, v.z)
}
