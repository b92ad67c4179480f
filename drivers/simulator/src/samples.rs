//! Inertial samples of a simulated flight: made of its motion, or recorded.

use super::reconcile::reconcile;
use super::trajectory::Trajectory;
use nalgebra::Vector3;
use plumbline_config::options::ImuConfig;
use plumbline_config::{ImuSample, Timestamp};
use plumbline_drivers::DriverError;
use plumbline_drivers::euroc::read_imu_samples;
use plumbline_drivers::tum::read_tum;
use std::path::{Path, PathBuf};

/// The rate of recorded samples may be off the configured one by this share.
const RATE_TOLERANCE: f64 = 0.02;

/// Source of the inertial samples of a simulated flight.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Inertial {
    /// Derivatives of the path, with the errors of [`ImuEffects`](super::ImuEffects).
    #[default]
    Simulated,
    /// Samples recorded along the path (columns of EuRoC's `imu0/data.csv`, plain or gzip), as they are. The path, a TUM file,
    /// is made to agree with them first.
    Recorded(PathBuf),
}

/// The file of the samples that were recorded along the trajectory `path`, in the folders of the shared data:
/// `.../imu/NAME.csv.gz` for `.../trajectories/NAME.tum.gz`.
pub fn recorded_along(path: &Path) -> PathBuf {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let name = name.split_once(".tum").map_or(&*name, |(name, _)| name);
    let folder = path.parent().and_then(Path::parent).unwrap_or_else(|| Path::new(".."));
    folder.join("imu").join(format!("{name}.csv.gz"))
}

/// Biases at one time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Biases {
    /// rad/s.
    pub(super) gyro: Vector3<f64>,
    /// m/s².
    pub(super) accel: Vector3<f64>,
}

/// The inertial samples of a flight.
#[derive(Debug)]
pub(super) struct Samples {
    pub(super) samples: Vec<ImuSample>,
    /// Biases at every sample from `begin` on; of recorded samples, their means over the whole recording.
    pub(super) biases: Vec<Biases>,
    pub(super) begin: Timestamp,
    pub(super) rate_hz: f64,
}

impl Samples {
    /// The recorded samples of `file`, and the flight along the path of `poses` that agrees with them.
    pub(super) fn read(
        file: &Path,
        poses: &Path,
        imu: &ImuConfig,
    ) -> Result<(Self, Trajectory), DriverError> {
        let samples = read_samples(file, imu)?;
        let reconciled = reconcile(&read_tum(poses)?, &samples, imu.gravity_m_s2)
            .map_err(|why| DriverError::refused(file, format!("does not fit {}: {why}", poses.display())))?;
        let biases = vec![Biases { gyro: reconciled.bias_gyro, accel: reconciled.bias_accel }];
        let samples = samples[reconciled.within].to_vec();
        let begin = reconciled.flight.begin();
        Ok((Self { samples, biases, begin, rate_hz: imu.rate_hz }, reconciled.flight))
    }

    /// Biases at `stamp`, between samples by interpolation.
    pub(super) fn biases(&self, stamp: Timestamp) -> Biases {
        let last = self.biases.len() - 1;
        let at = (stamp.seconds_since(self.begin) * self.rate_hz).clamp(0.0, last as f64);
        let (low, part) = (at as usize, at.fract());
        let (a, b) = (self.biases[low], self.biases[(low + 1).min(last)]);
        Biases { gyro: a.gyro.lerp(&b.gyro, part), accel: a.accel.lerp(&b.accel, part) }
    }
}

/// The samples of `file`, of the rate that `imu` says.
fn read_samples(file: &Path, imu: &ImuConfig) -> Result<Vec<ImuSample>, DriverError> {
    let samples = read_imu_samples(file)?;
    let span_s = match samples.as_slice() {
        [first, .., last] => last.stamp.seconds_since(first.stamp),
        _ => 0.0,
    };
    let rate_hz = (samples.len() as f64 - 1.0) / span_s;
    let is_expected = (rate_hz / imu.rate_hz - 1.0).abs() < RATE_TOLERANCE;
    if !is_expected {
        let message =
            format!("holds {rate_hz:.1} samples a second; set imu.rate_hz, now {}, to that", imu.rate_hz);
        return Err(DriverError::refused(file, message));
    }
    Ok(samples)
}
