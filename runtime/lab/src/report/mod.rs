//! The report of a run: one JSON object, and the same for people.

pub mod accuracy;
mod clock;
pub mod honesty;
pub mod places;
pub mod sensors;

use crate::evaluate::{FlightConsistency, Nees};
use accuracy::Accuracy;
use honesty::Honesty;
use places::PlacesReport;
use plumbline_drivers::Faults;
use plumbline_drivers::euroc::FileDefects;
use plumbline_estimator::HealthBits;
use plumbline_flight::autopilot::BridgeFigures;
use plumbline_flight::flight::outputs::OutputFigures;
use plumbline_flight::flight::plausibility::{
    self, BURSTS, Finding, Fitness, GIVEN_UP, HealthTally, JITTER_WORD,
};
use plumbline_flight::flight::{Flown, LiveSensors};
use plumbline_flight::log::recorder::RecorderSummary;
use plumbline_flight::log::source::LogEnd;
use plumbline_flight::pipeline::{DriverFaults, LiveFigures, RunOutcome};
use plumbline_flight::schedule::times::Percentiles;
use plumbline_record::digest::config_hash;
use sensors::SensorReport;
use serde::Serialize;
use std::collections::BTreeMap;

/// Everything a run tells.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// Name of the flight.
    pub name: String,
    /// Frames taken.
    pub frames: u64,
    /// Frames whose stamp was not later than the one before.
    pub frames_refused: u64,
    /// Data time from the first image to the first pose, s.
    pub first_pose_s: Option<f64>,
    /// Poses over frames.
    pub completion: f64,
    /// Data time over wall time.
    pub realtime_factor: f64,
    /// Largest resident memory of the process, MB.
    pub peak_rss_mb: f64,
    /// Resets of the estimate.
    pub resets: u32,
    /// Allocations and frees while estimating, after two seconds of data.
    pub hot_path_allocations: u64,
    /// Root mean square position error of the causal trajectory after SE(3) alignment, m.
    pub ate_rmse_m: Option<f64>,
    /// SHA-256 over the bits of all estimates.
    pub estimate_digest: String,
    /// SHA-256 over the bits of all odometry.
    pub odometry_digest: String,
    /// The map, where places are switched on.
    pub places: Option<PlacesReport>,
    /// Computation of a frame, ms of wall time.
    pub frame_ms: Percentiles,
    /// Computation of a frame, ms of processor time.
    pub frame_cpu_ms: Percentiles,
    /// Stages of the computation, ms.
    pub stage_ms: BTreeMap<&'static str, Percentiles>,
    /// From an inertial sample to its odometry, microseconds.
    pub odometry_handout_us: Percentiles,
    /// Timing of a live run.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub live: Option<LiveFigures>,
    /// Figures of the sensors of a live flight.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sensors: Option<SensorReport>,
    /// Points, means per frame.
    pub points: BTreeMap<&'static str, f64>,
    /// Line segments of the left image, means per frame.
    pub lines: BTreeMap<&'static str, f64>,
    /// Median quality from the first pose on; `null` without one.
    pub median_quality: Option<i8>,
    /// Number of frames with each health bit, by its name; bits that were never set are left out.
    pub health_frames: BTreeMap<&'static str, u64>,
    /// Health bits and qualities.
    #[serde(skip)]
    pub health: HealthTally,
    /// Cameras of the configuration.
    #[serde(skip)]
    pub cameras: usize,
    /// Errors against the truth, where it is known.
    pub accuracy: Option<Accuracy>,
    /// NEES over its expectation, of estimates and odometry, where the truth is known: 1 is honest, above is overconfident.
    pub consistency: Option<FlightConsistency>,
    /// Faults that were injected.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub injected: Vec<String>,
    /// Honesty of the estimates that may be used, where the truth is known.
    pub honesty: Option<Honesty>,
    /// `t_imu - t_camera` at the end, s.
    pub time_offset_s: f64,
    /// Faults that the drivers survived.
    pub faults: DriverFaults,
    /// Inertial samples that the estimator refused.
    pub imu_refused: u64,
    /// Threads of the run.
    pub threads: usize,
    /// Mounting of the IMU in the vehicle: roll, pitch and yaw, degrees; `null` if it is unknown.
    pub imu_to_vehicle_deg: Option<[f64; 3]>,
    /// SHA-256 of the configuration.
    pub config_hash: String,
    /// Figures of the recorder, where there was one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub recording: Option<RecorderSummary>,
    /// Figures of the autopilot's bridge, where there was one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub autopilot: Option<BridgeFigures>,
    /// Findings about data, calibration or flight that cannot be right.
    pub warnings: Vec<Finding>,
}

/// Findings that show only at the end of a flight: what its drivers survived, and a log that breaks off. `known` were found before.
pub fn late_findings(
    flown: &Flown,
    log_end: Option<&LogEnd>,
    files: &FileDefects,
    known: &[Finding],
) -> Vec<Finding> {
    if known.iter().any(|finding| finding.explains_all) {
        return Vec::new();
    }
    let faults = &flown.outcome.faults;
    // Between bursts, and between stamps that scatter, a driver misses samples that were never there.
    let is_uneven = |finding: &Finding| finding.what.contains(BURSTS) || finding.what.ends_with(JITTER_WORD);
    let missing = if known.iter().any(is_uneven) { 0 } else { faults.imu.missing };
    let imu = Faults { missing, ..faults.imu };
    let of_drivers = plausibility::of_faults(imu, faults.cameras, Some(&files.words()));
    let has_gaps = imu.missing + imu.corrupt + faults.cameras.missing > 0;
    let of_drivers = match of_drivers {
        Some(_) if files.are_other_sizes() && !has_gaps => Some(Finding::new(
            "images change their size",
            files.words().join("; "),
            "another mode of the camera while it recorded, or images of another recording among these",
            "record in one mode of the camera, and fly this recording up to there (`--stop`)",
        )),
        of_drivers => of_drivers,
    };
    // The files of a recording may have named it already, with the place.
    let are_stamps_known =
        known.iter().any(|finding| finding.what.contains("stamp") || finding.what.contains("clock"));
    let of_stamps = (!are_stamps_known)
        .then(|| plausibility::of_stamps(faults.imu, faults.cameras, flown.outcome.figures.frames, false))
        .flatten();
    let of_log = log_end.and_then(LogEnd::words).map(|words| {
        let seconds = flown.outcome.figures.span_s;
        Finding::new(
            "the log breaks off",
            format!("{words}; {seconds:.2} s of data were flown"),
            "that the flight or the recorder ended without closing the log",
            "what comes before is sound; `plumbline log` says what it holds",
        )
    });
    of_drivers.into_iter().chain(of_stamps).chain(of_log).collect()
}

impl Report {
    /// The report of a flight, compared with the truth where that is known.
    pub fn new(flown: &Flown) -> Self {
        let outcome = &flown.outcome;
        let f = &outcome.figures;
        let stepped = clock::on_true_clock(flown);
        let (poses, published) = match &stepped {
            Some((poses, published)) => (poses, published.as_ref()),
            None => (&flown.poses, flown.published.as_ref()),
        };
        let accuracy = Accuracy::of(poses, &flown.truth);
        let begin_s = flown.injected.iter().map(|fault| fault.span_s().start).reduce(f64::min);
        Self {
            name: flown.name.clone(),
            frames: f.frames,
            frames_refused: f.frames_refused,
            first_pose_s: f.first_pose_s,
            completion: f.poses as f64 / f.frames.max(1) as f64,
            realtime_factor: if f.wall_s > 0.0 { f.span_s / f.wall_s } else { 0.0 },
            peak_rss_mb: peak_rss_mb().unwrap_or(0.0),
            resets: f.resets,
            hot_path_allocations: f.hot_path_allocations,
            ate_rmse_m: accuracy.as_ref().map(|a| a.ate_rmse_m),
            estimate_digest: outcome.estimate_digest.clone(),
            odometry_digest: outcome.odometry_digest.clone(),
            places: PlacesReport::of(flown),
            frame_ms: f.frame_ms.percentiles(),
            frame_cpu_ms: f.frame_cpu_ms.percentiles(),
            stage_ms: stages_ms(outcome),
            odometry_handout_us: f.handout_us.percentiles(),
            live: outcome.live.clone(),
            sensors: None,
            points: f.means("points_").collect(),
            lines: f.means("lines_").collect(),
            median_quality: f.health.median_quality(),
            health_frames: health_frames(outcome),
            health: f.health.clone(),
            cameras: flown.config.camera.len(),
            accuracy,
            consistency: published.and_then(|p| FlightConsistency::of(poses, p, &flown.truth)),
            injected: flown.injected.iter().map(ToString::to_string).collect(),
            honesty: published.and_then(|p| Honesty::of(poses, &p.frames, &flown.truth, begin_s)),
            time_offset_s: f.time_offset_s,
            faults: outcome.faults,
            imu_refused: f.imu_refused,
            threads: flown.threads,
            imu_to_vehicle_deg: flown.config.vehicle.imu_to_vehicle_deg.degrees(),
            config_hash: config_hash(&flown.config),
            recording: None,
            autopilot: None,
            warnings: Vec::new(),
        }
    }

    /// Adds the figures of recording and autopilot.
    #[must_use]
    pub fn with(self, outputs: OutputFigures) -> Self {
        Self { recording: outputs.recording, autopilot: outputs.autopilot, ..self }
    }

    /// Adds the figures of live sensors; allocations of their threads count.
    #[must_use]
    pub fn of_sensors(self, sensors: &LiveSensors) -> Self {
        let sensors = SensorReport::of(sensors);
        let allocations = sensors.imu.stream.allocations + sensors.cameras.stream.allocations;
        Self { hot_path_allocations: self.hot_path_allocations + allocations, sensors: Some(sensors), ..self }
    }

    /// Sets the warnings found during the run.
    #[must_use]
    pub fn warning_of(self, warnings: Vec<Finding>) -> Self {
        Self { warnings, ..self }
    }

    /// Why there is no pose, and what to do: samples that never came, the first grave warning, and what the health bits tell.
    pub fn why_no_pose(&self) -> String {
        if let Some(sensors) = self.sensors.as_ref().filter(|sensors| sensors.imu.stream.count == 0) {
            return format!(
                "no sample of the IMU ({}) arrived: look at its cable and driver",
                sensors.imu.name
            );
        }
        match self.warnings.iter().find(|warning| warning.fitness == Fitness::NotFit) {
            Some(warning) => format!("{}: {}", warning.what, warning.advice()),
            None => self.health.why_no_pose(),
        }
    }

    /// The report for people: a few aligned lines.
    pub fn summary(&self) -> String {
        let mut lines = vec![
            format!("{:<18}{}{}", "flight", self.name, if self.cameras == 1 { ", one camera" } else { "" }),
            format!(
                "{:<18}{} frames, {:.1} % with a pose, first after {}, {} resets",
                "completion",
                self.frames,
                100.0 * self.completion,
                self.first_pose_s.map_or_else(|| "never".into(), |s| format!("{s:.2} s")),
                self.resets
            ),
        ];
        let resets = self.warnings.iter().filter(|warning| warning.what == GIVEN_UP);
        lines.extend(resets.map(|reset| format!("{:<18}{}", "", reset.evidence)));
        lines.extend(self.health.found.map(|found| format!("{:<18}{found}", "start")));
        lines.extend(self.accuracy.iter().flat_map(accuracy_lines));
        lines.extend(self.consistency.iter().flat_map(consistency_lines));
        if !self.injected.is_empty() {
            lines.push(format!("{:<18}{}", "faults", self.injected.join(", ")));
            lines.extend(self.honesty.as_ref().map(|honesty| format!("{:<18}{honesty}", "")));
        }
        lines.extend(self.places.as_ref().map(PlacesReport::line));
        let p = &self.frame_ms;
        // A live flight takes as long as it takes.
        let speed = match &self.sensors {
            None => format!("; {:.1} times real time", self.realtime_factor),
            Some(_) => String::new(),
        };
        lines.push(format!(
            "{:<18}median {:.1} ms, p99 {:.1}, largest {:.1}{speed}",
            "frame", p.p50, p.p99, p.max
        ));
        let (points, l) = (&self.points, &self.lines);
        lines.push(format!(
            "{:<18}{:.0} points tracked, {:.0} landmarks; {:.0} lines, {:.0} tracked, {:.0} landmarks",
            "features", points["tracked"], points["in_window"], l["kept"], l["matched"], l["in_window"]
        ));
        let Percentiles { p50, p99, max, .. } = &self.odometry_handout_us;
        lines.push(format!("{:<18}median {p50:.0} us, p99 {p99:.0}, largest {max:.0}", "odometry"));
        lines.extend(self.live.iter().flat_map(live_lines));
        lines.extend(self.sensors.iter().flat_map(SensorReport::lines));
        lines.push(format!(
            "{:<18}{:.0} MB at most, {} allocations in the hot path",
            "memory", self.peak_rss_mb, self.hot_path_allocations
        ));
        lines.extend(self.recording.iter().map(|recording| format!("{:<18}{recording}", "recording")));
        lines.extend(self.autopilot.iter().map(|autopilot| format!("{:<18}{autopilot}", "autopilot")));
        if self.imu_to_vehicle_deg.is_none() {
            lines.push(format!("{:<18}unknown: the vehicle's attitude is not published", "mounting"));
        }
        lines.push(format!(
            "{:<18}{}",
            "health",
            self.health.line(self.warnings.iter().find(|warning| warning.explains_all))
        ));
        lines.push(format!("{:<18}{}", "estimate digest", &self.estimate_digest[..16]));
        lines.join("\n")
    }
}

/// Lines of the summary about the accuracy.
fn accuracy_lines(a: &Accuracy) -> [String; 2] {
    let drift = a.yaw_drift_deg_per_min.unwrap_or(f64::NAN);
    let scale = a.scale_error_percent;
    let scale =
        scale.map_or_else(|| "unknown, too little motion".into(), |percent| format!("{percent:+.2} %"));
    [
        format!(
            "{:<18}ATE {:.4} m over {:.1} m ({:.3} %), largest {:.3} m, scale error {scale}",
            "accuracy", a.ate_rmse_m, a.distance_m, a.ate_percent, a.max_error_m
        ),
        format!("{:<18}yaw drift {drift:+.2} deg/min", ""),
    ]
}

/// Every stage by its name, that of the map too.
fn stages_ms(outcome: &RunOutcome) -> BTreeMap<&'static str, Percentiles> {
    let places = outcome.places.iter().map(|places| ("places", places.figures.times_ms.percentiles()));
    outcome.figures.stages.all().map(|(stage, p)| (stage.name(), p)).chain(places).collect()
}

/// Health bits that were set, with their numbers of frames.
fn health_frames(outcome: &RunOutcome) -> BTreeMap<&'static str, u64> {
    let names = HealthBits::NAMES.iter().map(|(_, name)| *name);
    names.zip(outcome.figures.health.bits).filter(|(_, frames)| *frames > 0).collect()
}

/// Consistency of estimates and odometry, for people.
fn consistency_lines(consistency: &FlightConsistency) -> [String; 2] {
    let line = |nees: &Nees| {
        let parts = Nees::NAMES.iter().zip(nees.ratios()).map(|(name, ratio)| match ratio {
            Some(ratio) => format!("{name} {ratio:.2}"),
            None => format!("{name} unknown"),
        });
        parts.collect::<Vec<_>>().join(", ")
    };
    [
        format!(
            "{:<18}NEES over its expectation (1 is honest): {}",
            "covariance",
            line(&consistency.estimates)
        ),
        format!("{:<18}that of the odometry: {}", "", line(&consistency.odometry)),
    ]
}

/// Timing of a live run, for people.
fn live_lines(live: &LiveFigures) -> [String; 2] {
    let (tick, front_end) = (&live.tick, &live.front_end);
    let late = tick.sample_to_odometry_ms.percentiles();
    [
        format!(
            "{:<18}sample to odometry median {:.2} ms, p99.9 {:.2}, largest {:.2}; {} of {} ticks missed",
            "clock", late.p50, late.p999, late.max, tick.ticks_missed, tick.ticks
        ),
        format!(
            "{:<18}{} frames shed, {} passed over, {} steps down the ladder, {} late corrections, {} stalls",
            "",
            front_end.frames_shed,
            front_end.frames_passed_over,
            front_end.steps_down,
            live.late_corrections,
            live.watchdog.stalls
        ),
    ]
}

/// `VmHWM` of this process.
fn peak_rss_mb() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|l| l.starts_with("VmHWM:"))?;
    let kilobytes: f64 = line.split_whitespace().nth(1)?.parse().ok()?;
    Some(kilobytes / 1024.0)
}
