//! The built-in set of simulated flights: every trajectory in every scene, and what may go wrong.
//!
//! The paths are those of real flights (ground truth of EuRoC sequences); the world around them is
//! simulated. Rendered frames can be kept on disk ([`cache`]), so that a change of the estimator is
//! measured in a fraction of the time.

pub mod cache;

use crate::cli::replay::fly;
use crate::flight::{Flight, Truth, open_simulation};
use crate::pipeline::RunOptions;
use crate::record::Recorder;
use crate::report::Report;
use anyhow::Result;
use plumbline_config::Config;
use plumbline_drivers::simulator::{Effects, FlightPath, Scenario, Scene};
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

/// Trajectories and where in them the vehicle is in full flight, s.
pub const PATHS: [(&str, f64); 4] =
    [("V1_02_medium", 15.0), ("V2_02_medium", 15.0), ("MH_04_difficult", 20.0), ("V1_03_difficult", 15.0)];
/// Scenes by name.
pub const SCENES: [(&str, Scene); 3] =
    [("room", Scene::Room), ("hall", Scene::Hall), ("low-texture", Scene::LowTexture)];

/// What goes wrong in a flight.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Fault {
    /// Nothing.
    None,
    /// Both images black for 1.5 s.
    Blackout,
    /// 5 % of the frames lost.
    Drops,
    /// Left camera silent for 5 s.
    LeftLost,
    /// Right camera silent for 5 s.
    RightLost,
    /// Exposure jumps by 15 % from frame to frame.
    Flicker,
    /// Image stamps 8 ms early.
    Offset,
    /// Cameras turned by 1 degree against the calibration.
    Extrinsics,
}

impl Fault {
    /// All that can go wrong.
    pub const ALL: [Self; 7] = [
        Self::Blackout,
        Self::Drops,
        Self::LeftLost,
        Self::RightLost,
        Self::Flicker,
        Self::Offset,
        Self::Extrinsics,
    ];

    fn apply(self, effects: &mut Effects) {
        match self {
            Self::None | Self::Extrinsics => {}
            Self::Blackout => effects.blackout = Some((6.0, 7.5)),
            Self::Drops => effects.drop_probability = 0.05,
            Self::LeftLost => effects.lost_camera = Some((0, 5.0, 10.0)),
            Self::RightLost => effects.lost_camera = Some((1, 5.0, 10.0)),
            Self::Flicker => effects.flicker = 0.15,
            Self::Offset => effects.time_offset_s = 0.008,
        }
    }

    fn extrinsics_error_deg(self) -> f64 {
        if self == Self::Extrinsics { 1.0 } else { 0.0 }
    }
}

/// One flight of the campaign.
#[derive(Clone, Debug)]
pub struct Entry {
    /// Name of the trajectory.
    pub path: String,
    /// Name of the scene.
    pub scene: &'static str,
    /// What goes wrong.
    pub fault: Fault,
    /// What is simulated.
    pub scenario: Scenario,
}

impl Entry {
    /// The flight along `path` of the folder `trajectories`.
    #[must_use]
    pub fn new(
        trajectories: &Path,
        (path, start_s): (&str, f64),
        (scene_name, scene): (&'static str, Scene),
        seed: u64,
        duration_s: f64,
        fault: Fault,
    ) -> Self {
        let mut effects = Effects::default();
        fault.apply(&mut effects);
        let file = trajectories.join(format!("{path}.tum.gz"));
        let scenario = Scenario {
            scene,
            path: FlightPath::Tum(file),
            start_s,
            duration_s,
            seed,
            effects,
            ..Scenario::default()
        };
        Self { path: path.to_owned(), scene: scene_name, fault, scenario }
    }

    /// Flies it.
    ///
    /// # Errors
    /// When it cannot be simulated, or the cache cannot be used.
    pub fn fly(&self, config: Option<&Config>, mono: bool, cache: Option<&PathBuf>, threads: usize) -> Result<Report> {
        let error_deg = self.fault.extrinsics_error_deg();
        let mut flight: Flight = open_simulation(config.cloned(), &self.scenario, mono, error_deg)?;
        if let (Some(folder), Truth::Simulated(simulator)) = (cache, &flight.truth) {
            flight.stereo = cache::frames(folder, simulator, &self.scenario)?;
        }
        let options = RunOptions { speed: None, threads };
        let (report, _, _) = fly(flight, Recorder::default(), &options, &AtomicBool::new(false))?;
        Ok(report)
    }

    /// A row of the table.
    #[must_use]
    pub fn row(&self, report: &Report) -> String {
        let accuracy = report.accuracy.as_ref();
        let number = |value: Option<f64>, digits: usize| {
            value.map_or_else(|| "-".to_owned(), |v| format!("{v:.digits$}"))
        };
        format!(
            "| {} | {} | {:?} | {} | {:.1} | {} | {} | {} | {} | {} | {} | {} | {:.1} / {:.1} / {:.1} |",
            self.path,
            self.scene,
            self.fault,
            self.scenario.seed,
            100.0 * report.completion,
            number(report.first_pose_s, 2),
            number(accuracy.map(|a| a.distance_m), 1),
            number(accuracy.map(|a| a.ate_rmse_m), 4),
            number(accuracy.map(|a| a.ate_percent), 3),
            number(accuracy.and_then(|a| a.yaw_drift_deg_per_min), 2),
            number(accuracy.and_then(|a| a.nees_ratio), 2),
            report.resets,
            report.frame_cpu_ms.p50,
            report.frame_cpu_ms.p99,
            report.frame_cpu_ms.max
        )
    }
}

/// The head of the table.
pub const TABLE_HEAD: &str = "| path | scene | fault | seed | completion % | first pose s | distance m | ATE m | ATE % | yaw deg/min | NEES | resets | frame cpu ms p50 / p99 / max |
|---|---|---|---|---|---|---|---|---|---|---|---|---|";
