//! Opening what is flown: a data set, a flight log, a ROS bag, or a simulated scenario.

use super::cache;
use super::plausibility::{Finding, missing_camera};
use super::truth::read_truth;
use super::{Flight, FlightError, Truth};
use crate::log::source::{LogEnd, LogImu, LogStereo};
use crate::log::{LogError, LogReader};
use nalgebra::{UnitQuaternion, Vector3};
use plumbline_config::import::euroc_into;
use plumbline_config::options::VehicleConfig;
use plumbline_config::{Config, ConfigError, ValidConfig};
use plumbline_drivers::bag::read_bag_imu;
use plumbline_drivers::euroc::{Defect, ground_truth_table, is_of_positions};
use plumbline_drivers::is_bag;
use plumbline_drivers::{BagDataset, BagTopics, EurocDataset, EurocOptions};
use plumbline_simulator::{FlightPath, Scenario, Simulator, draw_calibration, mistake_intrinsics};
use std::ops::Range;
use std::path::Path;

/// Detection cells shrink with the images, down to this, px: two patches must fit.
const SMALLEST_CELL_PX: usize = 28;

/// The part of a recording that is flown: both bounds hold.
#[derive(Clone, Debug, PartialEq)]
pub struct Cut {
    /// Frames, counted from 0; all without.
    pub frames: Option<Range<usize>>,
    /// Seconds of data since the first frame.
    pub seconds: Range<f64>,
}

impl From<Option<Range<usize>>> for Cut {
    fn from(frames: Option<Range<usize>>) -> Self {
        Self { frames, seconds: 0.0..f64::INFINITY }
    }
}

/// Opens a EuRoC data set. Without a configuration the calibration of the data set replaces that of the
/// preset `euroc`.
///
/// # Errors
/// When the data set or its calibration cannot be used.
pub fn open_dataset(
    path: &Path,
    config: Option<ValidConfig>,
    cut: impl Into<Cut>,
    mono: bool,
) -> Result<Flight, FlightError> {
    check_dataset(path)?;
    let (Cut { frames, seconds }, is_given) = (cut.into(), config.is_some());
    let config = match config {
        Some(config) => config,
        None => euroc_into(Config::preset("euroc")?, path).map_err(FlightError::Calibration)?,
    };
    let mut config = with_left(config, mono)?;
    let options = EurocOptions { frames, seconds, ..EurocOptions::for_config(&config) };
    let dataset = EurocDataset::open(path, &options)?;
    let mut findings: Vec<Finding> = dataset.defects().iter().map(of_defect).collect();
    if dataset.cameras() < config.camera.len() {
        findings.push(missing_camera(&format!("{} holds no cam1", path.display())));
        config = with_cameras(&config, dataset.cameras())?;
    }
    let right = dataset.root().join("cam1");
    if config.camera.len() == 1 && right.is_dir() && !is_given && !mono {
        let finding = Finding::new(
            "cam1 is left out: one camera is used",
            format!("{} holds no sensor.yaml", right.display()),
            "a copy that is not complete",
            "copy its calibration too, or give that of both cameras with --config; for one camera take the folder away",
        );
        findings.push(finding.mild());
    }
    let table = ground_truth_table(path);
    findings.extend(table.as_deref().filter(|table| is_of_positions(table)).map(of_positions));
    let truth = match table.filter(|table| !is_of_positions(table)) {
        Some(table) => Truth::of_states(&read_truth(&table)?),
        None => Truth::None,
    };
    let name = path.display().to_string();
    let flight = Flight::new(config, Box::new(dataset.imu()), Box::new(dataset.stereo()), name);
    Ok(Flight { truth, findings, file_defects: dataset.file_defects(), ..flight })
}

/// Finding: the truth of a data set has no attitudes and is not used.
fn of_positions(table: &Path) -> Finding {
    Finding::new(
        "the ground truth has no attitudes",
        format!("{} holds positions alone, and is not used", table.display()),
        "that it was measured by a laser tracker",
        "give a trajectory with attitudes: `--truth FILE`",
    )
    .mild()
}

/// Finding about a defect of a recording.
fn of_defect(defect: &Defect) -> Finding {
    let finding = Finding::new(&defect.what, &defect.evidence, &defect.cause, &defect.cure);
    if defect.is_grave { finding } else { finding.mild() }
}

/// True if `path` is that of a flight log.
pub fn is_log(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension == "mcap") && !path.is_dir()
}

/// Opens a flight log. Without a configuration that of the log is in force.
///
/// # Errors
/// When the log cannot be used, or holds no images.
pub fn open_log(
    path: &Path,
    config: Option<ValidConfig>,
    cut: impl Into<Cut>,
    mono: bool,
) -> Result<Flight, FlightError> {
    let log = LogReader::open(path)?;
    let config = with_left(config.unwrap_or_else(|| log.about().config.clone()), mono)?;
    let (cut, end) = (cut.into(), LogEnd::default());
    let stereo = LogStereo::open(path, cut.frames, config.camera.len() == 1)?;
    let imu = Box::new(LogImu::open(path)?.ending_at(&end));
    let stereo = Box::new(stereo.within_s(cut.seconds).ending_at(&end));
    Ok(Flight { log_end: Some(end), ..Flight::new(config, imu, stereo, path.display().to_string()) })
}

/// Kind of a recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RecordingKind {
    /// A EuRoC data set, or nothing that is known.
    Dataset,
    /// One of our flight logs.
    Log,
    /// A ROS bag.
    Bag,
}

/// Kind of the recording at `path`: an .mcap file is one of our logs if it says so, else a bag.
pub fn recording_kind(path: &Path) -> RecordingKind {
    let is_dataset = ["mav0", "cam0", "imu0"].iter().any(|name| path.join(name).is_dir());
    if is_log(path) {
        match LogReader::open(path) {
            Err(LogError::NotALog { .. }) if path.is_file() => RecordingKind::Bag,
            _ => RecordingKind::Log,
        }
    } else if !is_dataset && is_bag(path) {
        RecordingKind::Bag
    } else {
        RecordingKind::Dataset
    }
}

/// Opens a recorded flight, whatever it is: a EuRoC data set, a flight log or a ROS bag, of which `topics` are flown.
///
/// # Errors
/// When it is none of them, or cannot be used.
pub fn open_recording(
    path: &Path,
    config: Option<ValidConfig>,
    topics: &BagTopics,
    cut: impl Into<Cut>,
    mono: bool,
) -> Result<Flight, FlightError> {
    match recording_kind(path) {
        RecordingKind::Log => open_log(path, config, cut, mono),
        RecordingKind::Bag => open_bag(path, config, topics, cut, mono),
        RecordingKind::Dataset => open_dataset(path, config, cut, mono),
    }
}

/// Opens a ROS bag. It does not say how its cameras were calibrated: there must be a configuration.
///
/// # Errors
/// When there is none, or the bag cannot be used.
pub fn open_bag(
    path: &Path,
    config: Option<ValidConfig>,
    topics: &BagTopics,
    cut: impl Into<Cut>,
    mono: bool,
) -> Result<Flight, FlightError> {
    let Some(config) = config else {
        // What can be said of the bag itself comes first.
        read_bag_imu(path, topics)?;
        let message = "is a ROS bag, which does not hold the calibration of its cameras on the IMU; give it with --config FILE";
        return Err(FlightError::Invalid(format!("{}: {message}", path.display())));
    };
    let Cut { frames, seconds } = cut.into();
    let mut config = with_left(config, mono)?;
    let options = EurocOptions { frames, seconds, ..EurocOptions::for_config(&config) };
    let bag = BagDataset::open(path, topics, &options)?;
    let mut findings: Vec<Finding> = bag.defects().iter().map(of_defect).collect();
    if bag.cameras() < config.camera.len() {
        let of = bag.camera_topics().join(", ");
        findings.push(missing_camera(&format!("{} has images of one camera ({of})", path.display())));
        config = with_cameras(&config, bag.cameras())?;
    }
    if let [gyro, accel] = bag.imu_topics() {
        tracing::info!(
            "gyroscope of {gyro}, accelerometer of {accel}, interpolated to the times of the gyroscope"
        );
    }
    if bag.is_truncated() {
        findings.push(Finding::new(
            "the bag breaks off",
            format!("{}: a file has no end", path.display()),
            "that its recorder was killed",
            "what comes before is sound; `mcap recover`, `rosbag reindex` or `sqlite3 FILE .recover` repairs the file",
        ));
    }
    let name = path.display().to_string();
    Ok(Flight { findings, ..Flight::new(config, Box::new(bag.imu()), Box::new(bag.stereo()), name) })
}

/// Checks that there can be a data set at `path`.
fn check_dataset(path: &Path) -> Result<(), FlightError> {
    let message = if !path.exists() {
        "does not exist; give the directory of a EuRoC data set, or a flight log or ROS bag (.mcap, .db3, .bag). Without data, \
         `plumbline replay sim:room` flies a simulated flight, and `plumbline simulate FOLDER` writes one as a data set"
    } else if !path.is_dir() {
        "is not a directory; give the directory of a EuRoC data set (unpack it first), a flight log or a ROS bag \
         (.mcap, .db3, .bag)"
    } else if !["mav0", "cam0", "imu0"].iter().any(|name| path.join(name).is_dir()) {
        "holds no mav0 and no bag; give the directory of a EuRoC data set or of a ROS bag"
    } else {
        return Ok(());
    };
    Err(FlightError::Invalid(format!("{}: {message}", path.display())))
}

/// Prepares a simulated flight. The estimator's cameras are turned against the true ones by
/// `extrinsics_error_deg`, after what the scenario says of the calibration. With `rendered`, a folder, its frames are read from there, and rendered first if they are
/// not there yet.
///
/// # Errors
/// When the scenario is impossible, its trajectory cannot be read, or the folder cannot be used.
pub fn open_simulation(
    config: Option<ValidConfig>,
    scenario: &Scenario,
    mono: bool,
    extrinsics_error_deg: f64,
    rendered: Option<&Path>,
) -> Result<Flight, FlightError> {
    let config = scenario_config(Some(config.map_or_else(|| preset_for(scenario), Ok)?), mono)?;
    let simulator = Simulator::new(&config, scenario).map_err(FlightError::Simulation)?;
    if !extrinsics_error_deg.is_finite() || extrinsics_error_deg.abs() > 30.0 {
        let message =
            format!("--extrinsics-error-deg {extrinsics_error_deg}: give an angle of at most 30 degrees");
        return Err(FlightError::Invalid(message));
    }
    let scale = scenario.resolution_scale;
    let mut config = scenario.rig(&config);
    let cell_px = config.estimator.points.cell_px as f64 * scale;
    config.estimator.points.cell_px = (cell_px.round() as usize).max(SMALLEST_CELL_PX);
    turn_cameras(&mut config, extrinsics_error_deg.to_radians());
    if scenario.calibration_error > 0.0 {
        draw_calibration(&mut config, scenario.calibration_error, scenario.seed);
    }
    mistake_intrinsics(&mut config, &scenario.intrinsics_error, scale, scenario.seed);
    let config = config.validated(&format!("the simulated rig at a scale of {scale}"))?;
    let stereo = match rendered {
        Some(folder) => cache::frames(folder, &simulator, scenario)?,
        None => Box::new(simulator.stereo()),
    };
    let name = format!("simulated flight, {:?}, seed {}", scenario.scene, scenario.seed);
    let flight = Flight::new(config, Box::new(simulator.imu()), stereo, name);
    Ok(Flight { truth: Truth::Simulated(simulator), ..flight })
}

/// The preset for a flight of which no configuration is given: `sim`, or `euroc` where the inertial samples are real ones. How
/// the IMU is mounted in a vehicle that flies along a file is not known.
///
/// # Errors
/// Never, as long as the presets are valid.
pub fn preset_for(scenario: &Scenario) -> Result<ValidConfig, FlightError> {
    if scenario.has_recorded_samples() {
        return Ok(Config::preset("euroc")?);
    }
    let sim = Config::preset("sim")?;
    match scenario.path {
        FlightPath::Tum(_) => Ok(sim.with("preset sim", |config| config.vehicle = VehicleConfig::default())?),
        _ => Ok(sim),
    }
}

/// The rig to simulate: the given one, or the preset `sim`; with `mono` its left camera alone.
///
/// # Errors
/// Never, as long as the preset is valid.
pub fn scenario_config(config: Option<ValidConfig>, mono: bool) -> Result<ValidConfig, FlightError> {
    Ok(with_left(config.map_or_else(|| Config::preset("sim"), Ok)?, mono)?)
}

/// `config`, with the left camera alone where that is all that is flown.
fn with_left(config: ValidConfig, mono: bool) -> Result<ValidConfig, ConfigError> {
    if mono { with_cameras(&config, 1) } else { Ok(config) }
}

/// `config` with its first `cameras` cameras alone.
fn with_cameras(config: &ValidConfig, cameras: usize) -> Result<ValidConfig, ConfigError> {
    config.with("the rig with fewer cameras", |config| config.camera.truncate(cameras))
}

/// Turns both cameras, as one rig, about an oblique axis through the body's origin.
fn turn_cameras(config: &mut Config, angle_rad: f64) {
    let axis = Vector3::new(0.6, -0.5, 0.62).normalize();
    let turn = UnitQuaternion::from_scaled_axis(axis * angle_rad);
    for camera in &mut config.camera {
        let matrix = (turn * camera.pose_b_c()).to_homogeneous();
        camera.pose_b_c = std::array::from_fn(|i| std::array::from_fn(|j| matrix[(i, j)]));
    }
}
