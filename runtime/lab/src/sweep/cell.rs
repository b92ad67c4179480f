//! One cell: a setting on a flight. Flown, it is a file of its own.

use super::SweepError;
use super::subject::{Common, Subject};
use crate::evaluate::FlightConsistency;
use crate::report::Report;
use crate::report::accuracy::ForeignTruth;
use crate::tracking::{TrackingFigures, TrackingWatch};
use plumbline_drivers::BagTopics;
use plumbline_flight::flight::{FlightError, Truth, fly, with_overrides};
use plumbline_flight::log::build_id::BuildId;
use plumbline_flight::pipeline::{Control, RunOptions};
use plumbline_record::digest::config_hash;
use serde::{Deserialize, Serialize};
use sha2::{Digest as _, Sha256};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Bytes of the digest in a folder's name.
const FOLDER_BYTES: usize = 8;

/// Why a cell has no figures.
#[derive(Debug, thiserror::Error)]
pub enum CellError {
    /// It cannot be opened or flown.
    #[error(transparent)]
    Flight(#[from] FlightError),
    /// The truth that was named is of another flight.
    #[error(transparent)]
    Truth(#[from] ForeignTruth),
}

/// A setting on a flight.
#[derive(Clone, Debug)]
pub struct Cell {
    /// Its number in the sweep, from 0.
    pub index: usize,
    /// Cells of the sweep.
    pub of: usize,
    /// Changes `key=value` of the configuration.
    pub setting: Vec<String>,
    /// Subject of the flight.
    pub subject: Subject,
    /// The seed, of a simulated flight.
    pub seed: Option<u64>,
    /// Start in the data set or path, s; `None` for its own.
    pub start_s: Option<f64>,
    pub(super) common: Arc<Common>,
}

/// Result of a cell, as its file has it.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct CellResult {
    /// Its number in the sweep, from 0.
    pub cell: usize,
    /// Cells of the sweep.
    pub of: usize,
    /// SHA-256 of what was asked for: another sweep's cells are told apart by it.
    pub asked: String,
    /// SHA-256 of the executable that flew it.
    pub executable: String,
    /// Changes `key=value` of the configuration.
    pub setting: Vec<String>,
    /// Name of the flight.
    pub subject: String,
    /// The seed, of a simulated flight.
    pub seed: Option<u64>,
    /// Start in the data set or path, s; `None` for its own.
    #[serde(default)]
    pub start_s: Option<f64>,
    /// The figures; `None` if it could not be flown.
    pub figures: Option<CellFigures>,
    /// Why it could not be flown.
    pub error: Option<String>,
    /// The whole report, as `replay --report` writes it.
    pub report: Option<serde_json::Value>,
}

/// The figures of a flight that cells are compared by.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CellFigures {
    /// Frames taken.
    pub frames: u64,
    /// Cameras that were used.
    #[serde(default)]
    pub cameras: Option<usize>,
    /// Poses over frames.
    pub completion: f64,
    /// Resets of the estimate.
    pub resets: u32,
    /// Data time from the first image to the first pose, s.
    pub first_pose_s: Option<f64>,
    /// Root mean square position error after SE(3) alignment, m.
    pub ate_rmse_m: Option<f64>,
    /// Root mean square position error over the distance, percent.
    pub ate_percent: Option<f64>,
    /// Root mean square position error of the trajectory as known at the end, after SE(3) alignment, m.
    #[serde(default)]
    pub ate_final_m: Option<f64>,
    /// Length of the true path, m.
    #[serde(default)]
    pub distance_m: Option<f64>,
    /// Root mean square translation error over each second, m.
    #[serde(default)]
    pub rpe_1s_m: Option<f64>,
    /// Growth of the yaw error, degrees a minute.
    pub yaw_drift_deg_per_min: Option<f64>,
    /// NEES over its expectation, of estimates and odometry.
    pub consistency: Option<FlightConsistency>,
    /// Computation of a frame, median, ms of processor time.
    pub frame_cpu_ms_p50: f64,
    /// Computation of a frame, 99th percentile, ms of processor time.
    pub frame_cpu_ms_p99: f64,
    /// Computation of a frame, largest, ms of processor time.
    #[serde(default)]
    pub frame_cpu_ms_max: Option<f64>,
    /// Lives and residuals of tracks.
    #[serde(default)]
    pub tracking: Option<TrackingFigures>,
    /// SHA-256 over the bits of all estimates.
    pub estimate_digest: String,
}

impl CellFigures {
    fn of(report: &Report) -> Self {
        let accuracy = report.accuracy.as_ref();
        Self {
            frames: report.frames,
            cameras: Some(report.cameras),
            completion: report.completion,
            resets: report.resets,
            first_pose_s: report.first_pose_s,
            ate_rmse_m: accuracy.map(|a| a.ate_rmse_m),
            ate_percent: accuracy.map(|a| a.ate_percent),
            ate_final_m: report.places.as_ref().and_then(|places| places.ate_final_rmse_m),
            distance_m: accuracy.map(|a| a.distance_m),
            rpe_1s_m: accuracy.and_then(|a| a.rpe_1s_m),
            yaw_drift_deg_per_min: accuracy.and_then(|a| a.yaw_drift_deg_per_min),
            consistency: report.consistency.clone(),
            frame_cpu_ms_p50: report.frame_cpu_ms.p50,
            frame_cpu_ms_p99: report.frame_cpu_ms.p99,
            frame_cpu_ms_max: Some(report.frame_cpu_ms.max),
            tracking: report.tracking.clone(),
            estimate_digest: report.estimate_digest.clone(),
        }
    }
}

impl Cell {
    /// Setting, flight and seed in one line.
    #[must_use]
    pub fn describe(&self) -> String {
        let setting = if self.setting.is_empty() { "as configured".into() } else { self.setting.join(" ") };
        let seed = self.seed.map_or_else(String::new, |seed| format!("\tseed {seed}"));
        let start = self.start_s.map_or_else(String::new, |s| format!("\tfrom {s} s"));
        format!("{setting}\t{}{seed}{start}", self.subject.name())
    }

    /// Flies it; `None` if `stop` was set meanwhile. A flight that cannot be flown is a result too.
    #[must_use]
    pub fn fly(&self, stop: &Arc<AtomicBool>) -> Option<CellResult> {
        let flown = self.report(stop);
        if stop.load(Ordering::Relaxed) {
            return None;
        }
        let (report, error) = match flown {
            Ok(report) => (Some(report), None),
            Err(error) => (None, Some(with_causes(&error))),
        };
        Some(CellResult {
            cell: self.index,
            of: self.of,
            asked: self.asked(),
            executable: BuildId::current().executable.clone(),
            setting: self.setting.clone(),
            subject: self.subject.name(),
            seed: self.seed,
            start_s: self.start_s,
            figures: report.as_ref().map(CellFigures::of),
            error,
            report: report.and_then(|report| serde_json::to_value(report).ok()),
        })
    }

    /// Flies it for its report alone, which is of no use if `stop` was set meanwhile.
    ///
    /// # Errors
    /// When it cannot be opened or flown.
    pub fn report(&self, stop: &Arc<AtomicBool>) -> Result<Report, CellError> {
        let mut flight = self.subject.open(&self.common, self.seed, self.start_s)?;
        flight.config = with_overrides(&flight.config, &self.setting)?;
        let named = self.common.truth.as_ref().filter(|_| matches!(self.subject, Subject::Recorded { .. }));
        if let Some(truth) = named {
            flight.truth = Truth::of_poses(&truth.poses);
        }
        // One thread a flight: the cores are shared among the cells.
        let options = RunOptions { speed: None, threads: 1 };
        let control = Control::stopped_by(Arc::clone(stop));
        let mut tracking = TrackingWatch::new(&flight.config);
        let flown = fly(flight, &options, &control, vec![&mut tracking])?;
        if let Some(truth) = named.filter(|_| !stop.load(Ordering::Relaxed)) {
            ForeignTruth::check(&flown.name, &flown.poses, &flown.truth, &truth.path)?;
        }
        Ok(Report::new(&flown).with_tracking(tracking.figures()))
    }

    /// Tells what is asked for from everything else that could be.
    fn asked(&self) -> String {
        let Common { config, topics, truth, mono, cache: _ } = &*self.common;
        let subject = match &self.subject {
            Subject::Recorded { path } => path.display().to_string(),
            Subject::Simulated { scenario, extrinsics_error_deg, faults, .. } => {
                format!("{scenario:?} {extrinsics_error_deg} {faults:?}")
            }
        };
        let config = config.as_ref().map(|config| config_hash(config));
        let text = format!("{subject:?} {:?} {:?} {mono} {config:?}", self.setting, self.seed);
        let mut hash = Sha256::new_with_prefix(text.as_bytes());
        if *topics != BagTopics::default() {
            hash.update(format!("{topics:?}"));
        }
        if let Some(start_s) = self.start_s {
            hash.update(start_s.to_le_bytes());
        }
        for pose in truth.iter().flat_map(|truth| &truth.poses) {
            hash.update(pose.stamp.as_nanos().to_le_bytes());
            pose.pose.translation.vector.iter().for_each(|value| hash.update(value.to_le_bytes()));
        }
        hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect()
    }

    /// Its file in `folder`.
    #[must_use]
    pub fn path(&self, folder: &Path) -> PathBuf {
        folder.join(format!("cell-{}.json", self.index))
    }

    /// Its result from `folder`, if it was flown there by this build, and not in vain.
    ///
    /// # Errors
    /// When the file cannot be read, or is that of another sweep.
    pub fn kept(&self, folder: &Path) -> Result<Option<CellResult>, SweepError> {
        Ok(self.kept_or_failed(folder)?.filter(|result| result.error.is_none()))
    }

    /// Reads the result even if the flight failed.
    ///
    /// # Errors
    /// As [`Self::kept`].
    pub fn kept_or_failed(&self, folder: &Path) -> Result<Option<CellResult>, SweepError> {
        let path = self.path(folder);
        if !path.exists() {
            return Ok(None);
        }
        let result = read(&path)?;
        if result.asked != self.asked() || result.of != self.of {
            return Err(SweepError::OtherSweep { path });
        }
        Ok((result.executable == BuildId::current().executable).then_some(result))
    }
}

/// An error and its causes on one line; a cause that is quoted already says nothing new.
fn with_causes(error: &dyn std::error::Error) -> String {
    let mut line = error.to_string();
    let mut cause = error.source();
    while let Some(error) = cause {
        let words = error.to_string();
        if !line.contains(&words) {
            line = format!("{line}: {words}");
        }
        cause = error.source();
    }
    line
}

/// A name for the folder of a sweep's cells, which no other sweep has: it is of what is asked for, and of where.
#[must_use]
pub fn folder_name(cells: &[Cell]) -> String {
    // Names of data sets count from here.
    let here = std::env::current_dir().unwrap_or_default();
    let mut hash = Sha256::new_with_prefix(here.as_os_str().as_encoded_bytes());
    cells.iter().for_each(|cell| hash.update(cell.asked()));
    let bytes = hash.finalize();
    let digits: String = bytes.iter().take(FOLDER_BYTES).map(|byte| format!("{byte:02x}")).collect();
    format!("sweep-{digits}.cells")
}

/// Writes a result to its file in `folder`, at once or not at all.
///
/// # Errors
/// When it cannot be written.
pub fn keep(result: &CellResult, folder: &Path) -> Result<(), SweepError> {
    let path = folder.join(format!("cell-{}.json", result.cell));
    let partial = folder.join(format!("cell-{}.partial-{}", result.cell, std::process::id()));
    let io = |path: &Path| {
        let path = path.to_owned();
        move |source| SweepError::Io { path, source }
    };
    let text = serde_json::to_string_pretty(result)
        .map_err(|e| SweepError::NotACell { path: path.clone(), reason: e.to_string() })?;
    std::fs::write(&partial, text + "\n").map_err(io(&partial))?;
    std::fs::rename(&partial, &path).map_err(io(&path))
}

fn read(path: &Path) -> Result<CellResult, SweepError> {
    let text =
        std::fs::read_to_string(path).map_err(|source| SweepError::Io { path: path.to_owned(), source })?;
    serde_json::from_str(&text)
        .map_err(|e| SweepError::NotACell { path: path.to_owned(), reason: e.to_string() })
}

/// All results in `folder`, in the order of their numbers.
///
/// # Errors
/// When the folder or a result cannot be read, there is none, or they are not of one sweep.
pub fn collect(folder: &Path) -> Result<Vec<CellResult>, SweepError> {
    let io = |source| SweepError::Io { path: folder.to_owned(), source };
    let mut results = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(io)? {
        let path = entry.map_err(io)?.path();
        let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
        if name.starts_with("cell-") && name.ends_with(".json") {
            results.push((read(&path)?, path));
        }
    }
    results.sort_by_key(|(result, _)| result.cell);
    let Some((first, _)) = results.first() else {
        return Err(SweepError::NoCells { path: folder.to_owned() });
    };
    let of = first.of;
    if let Some((_, path)) = results.iter().find(|(result, _)| result.of != of) {
        return Err(SweepError::OtherSweep { path: path.clone() });
    }
    Ok(results.into_iter().map(|(result, _)| result).collect())
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::sweep::plan::tests::plan;

    /// A result without a flight.
    pub(in crate::sweep) fn result(cell: &Cell, ate_rmse_m: f64) -> CellResult {
        let figures = CellFigures {
            frames: 4_000,
            cameras: Some(2),
            completion: 0.98,
            resets: 0,
            first_pose_s: Some(0.5),
            ate_rmse_m: Some(ate_rmse_m),
            ate_percent: Some(10.0 * ate_rmse_m),
            ate_final_m: None,
            distance_m: Some(10.0),
            rpe_1s_m: Some(0.01),
            yaw_drift_deg_per_min: Some(0.1),
            consistency: None,
            frame_cpu_ms_p50: 7.0,
            frame_cpu_ms_p99: 11.0,
            frame_cpu_ms_max: Some(20.0),
            tracking: None,
            estimate_digest: "ab".into(),
        };
        CellResult {
            cell: cell.index,
            of: cell.of,
            asked: cell.asked(),
            executable: BuildId::current().executable.clone(),
            setting: cell.setting.clone(),
            subject: cell.subject.name(),
            seed: cell.seed,
            start_s: cell.start_s,
            figures: Some(figures),
            error: None,
            report: None,
        }
    }

    #[test]
    fn a_kept_cell_is_found_again_and_no_other() {
        let folder = tempfile::tempdir().unwrap();
        let cells = plan().cells();
        assert!(cells[3].kept(folder.path()).unwrap().is_none());
        keep(&result(&cells[3], 0.1), folder.path()).unwrap();
        assert_eq!(cells[3].kept(folder.path()).unwrap().unwrap().figures, result(&cells[3], 0.1).figures);
        // The same number in another sweep.
        let other = Cell { setting: vec!["a.b=1".into()], ..cells[3].clone() };
        assert!(matches!(other.kept(folder.path()), Err(SweepError::OtherSweep { .. })));
        // One that failed, and one of another build, are flown again.
        for again in [
            CellResult { error: Some("no disk".into()), figures: None, ..result(&cells[3], 0.1) },
            CellResult { executable: "another".into(), ..result(&cells[3], 0.1) },
        ] {
            keep(&again, folder.path()).unwrap();
            assert!(cells[3].kept(folder.path()).unwrap().is_none());
        }
        std::fs::write(cells[3].path(folder.path()), "{}").unwrap();
        let message = cells[3].kept(folder.path()).unwrap_err().to_string();
        assert!(message.contains("cell-3.json: not the result of a cell"), "{message}");
    }

    #[test]
    fn each_sweep_has_a_folder_of_its_own() {
        let cells = plan().cells();
        assert_eq!(folder_name(&cells), folder_name(&plan().cells()));
        assert_ne!(folder_name(&cells), folder_name(&cells[1..]));
    }

    #[test]
    fn another_start_is_another_cell() {
        let cell = plan().cells().remove(0);
        let later = Cell { start_s: Some(0.5), ..cell.clone() };
        assert_ne!(cell.asked(), later.asked());
    }

    #[test]
    fn cells_are_collected_in_the_order_of_their_numbers() {
        let folder = tempfile::tempdir().unwrap();
        assert!(matches!(collect(folder.path()), Err(SweepError::NoCells { .. })));
        for cell in plan().cells().iter().rev() {
            keep(&result(cell, 0.1), folder.path()).unwrap();
        }
        std::fs::write(folder.path().join("notes.txt"), "mine").unwrap();
        let numbers: Vec<usize> = collect(folder.path()).unwrap().iter().map(|r| r.cell).collect();
        assert_eq!(numbers, (0..18).collect::<Vec<_>>());
    }
}
