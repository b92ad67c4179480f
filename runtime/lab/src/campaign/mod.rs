//! The built-in set of simulated flights: every trajectory in every scene, and what may go wrong.
//!
//! The paths are those of real flights (ground truth of EuRoC sequences); the world around them is
//! simulated. Rendered frames can be kept on disk (see [`plumbline_flight::flight`]), so that a change of the estimator is
//! measured in a fraction of the time.

pub mod drawn;
mod fault;
pub mod honest;
mod silent;
pub mod table;

pub use fault::{CampaignFault, SILENT_FROM_S};

use crate::report::Report;
use crate::report::silence::SilentFailure;
use crate::report::trust::Trust;
use crate::tracking::TrackingWatch;
use plumbline_config::ValidConfig;
use plumbline_estimator::{Estimate, HealthBits};
use plumbline_flight::flight::{FlightError, Flown, KeptStates, Truth, fly, open_simulation, with_overrides};
use plumbline_flight::pipeline::listener::Subscriber;
use plumbline_flight::pipeline::{Control, RunOptions};
use plumbline_simulator::{FlightPath, Inertial, Scenario, Scene};
use std::path::{Path, PathBuf};

/// Trajectories and where in them the vehicle is in full flight, s.
pub const PATHS: [(&str, f64); 4] =
    [("V1_02_medium", 15.0), ("V2_02_medium", 15.0), ("MH_04_difficult", 20.0), ("V1_03_difficult", 15.0)];
/// Trajectories with the samples of their inertial sensor, and where in them the vehicle is in flight, s.
pub const RECORDED_PATHS: [(&str, f64); 7] = [
    ("V1_01_easy", 15.0),
    ("V1_02_medium", 15.0),
    ("V2_01_easy", 15.0),
    ("V2_02_medium", 15.0),
    ("MH_01_easy", 50.0),
    ("MH_03_medium", 25.0),
    ("MH_04_difficult", 20.0),
];
/// Scenes by name.
pub const SCENES: [(&str, Scene); 3] =
    [("room", Scene::Room), ("hall", Scene::Hall), ("low-texture", Scene::LowTexture)];

/// Options of the flights.
#[derive(Clone, Debug)]
pub struct Setup {
    /// The rig that is simulated and believed; the preset `sim` without one.
    pub config: Option<ValidConfig>,
    /// Changes of what the estimator is told, `key=value`; the simulated rig stays as it is.
    pub overrides: Vec<String>,
    /// The left camera alone.
    pub mono: bool,
    /// Folder of rendered frames.
    pub cache: Option<PathBuf>,
    /// 1 renders between frames, more do so ahead on another thread.
    pub threads: usize,
}

/// One flight of the campaign.
#[derive(Clone, Debug)]
pub struct Entry {
    /// Name of the trajectory.
    pub path: String,
    /// Name of the scene.
    pub scene: &'static str,
    /// Fault.
    pub fault: CampaignFault,
    /// Disturbances beside it.
    pub beside: Vec<CampaignFault>,
    /// Simulated flight.
    pub scenario: Scenario,
}

impl Entry {
    /// The flight along `path`: built in, or of the folder `trajectories`.
    #[must_use]
    pub fn new(
        trajectories: &Path,
        (path, start_s): (&str, f64),
        (scene_name, scene): (&'static str, Scene),
        seed: u64,
        duration_s: f64,
        fault: CampaignFault,
    ) -> Self {
        let flown = match FlightPath::named(path) {
            FlightPath::Tum(_) => FlightPath::Tum(trajectories.join(format!("{path}.tum.gz"))),
            built_in => built_in,
        };
        let scenario = Scenario { scene, path: flown, start_s, duration_s, seed, ..Scenario::default() };
        Self {
            path: path.to_owned(),
            scene: scene_name,
            fault: CampaignFault::None,
            beside: Vec::new(),
            scenario,
        }
        .with_fault(fault)
    }

    /// Flight with the inertial samples of `folder` that were recorded along its path.
    #[must_use]
    pub fn with_recorded_imu(mut self, folder: &Path) -> Self {
        self.scenario.inertial = Inertial::Recorded(folder.join(format!("{}.csv.gz", self.path)));
        self
    }

    /// Flight with a calibration drawn around the true one, with `multiple` of the stated standard deviations.
    #[must_use]
    pub fn with_calibration_error(mut self, multiple: f64) -> Self {
        self.scenario.calibration_error = multiple;
        self
    }

    /// Returns the flight with a fault.
    #[must_use]
    pub fn with_fault(&self, fault: CampaignFault) -> Self {
        let mut faulty = Self { fault, ..self.clone() };
        fault.shape(&mut faulty);
        faulty
    }

    /// Returns the flight with a disturbance beside its fault.
    #[must_use]
    pub fn with_beside(mut self, disturbance: CampaignFault) -> Self {
        if let CampaignFault::Condition(condition) = disturbance {
            condition.apply(&mut self.scenario);
        }
        self.beside.push(disturbance);
        self
    }

    /// Name of all that goes wrong.
    #[must_use]
    pub fn failure(&self) -> String {
        let names: Vec<String> = [self.fault].iter().chain(&self.beside).map(|fault| fault.name()).collect();
        names.join(" ")
    }

    /// Flies it with `config` (else the preset `sim`).
    ///
    /// # Errors
    /// When it cannot be simulated, or the cache cannot be used.
    pub fn fly(
        &self,
        config: Option<&ValidConfig>,
        mono: bool,
        cache: Option<&PathBuf>,
        threads: usize,
    ) -> Result<Report, FlightError> {
        self.fly_as(&Setup {
            config: config.cloned(),
            overrides: Vec::new(),
            mono,
            cache: cache.cloned(),
            threads,
        })
    }

    /// Flies it as `setup` says.
    ///
    /// # Errors
    /// When it cannot be simulated, the cache cannot be used, or a change of the configuration is refused.
    pub fn fly_as(&self, setup: &Setup) -> Result<Report, FlightError> {
        let error_deg = self.fault.extrinsics_error_deg();
        let mut flight = open_simulation(
            setup.config.clone(),
            &self.scenario,
            setup.mono,
            error_deg,
            setup.cache.as_deref(),
        )?;
        flight.config = with_overrides(&flight.config, &setup.overrides)?;
        let flight = self.fault.strike(flight, self.scenario.seed)?;
        let beside = self.beside.iter().filter_map(|fault| fault.injected_fault()).collect::<Vec<_>>();
        let flight = flight.with_injected(&beside, self.scenario.seed)?;
        let options = RunOptions { speed: None, threads: setup.threads };
        let mut states = self.fault.is_silent().then(|| KeptStates::for_flight(&flight));
        let mut tracking = TrackingWatch::new(&flight.config);
        let states_too = states.iter_mut().map(|states| states as &mut dyn Subscriber);
        let subscribers = [&mut tracking as &mut dyn Subscriber].into_iter().chain(states_too).collect();
        let flown = fly(flight, &options, &Control::default(), subscribers)?;
        let silence = states.and_then(|states| self.silence(&flown, &states.into_rows()));
        Ok(Report {
            trust: self.trust(&flown),
            silence,
            ..Report::new(&flown).with_tracking(tracking.figures())
        })
    }

    /// Judgement of the estimate's trust, where something went wrong.
    fn trust(&self, flown: &Flown) -> Option<Trust> {
        let Truth::Simulated(simulator) = &flown.truth else { return None };
        Trust::of(&flown.poses, &flown.truth, simulator.frame_time(0), &self.fault.span_s()?)
    }

    /// Fate of the estimate, where a sensor failed in silence.
    fn silence(&self, flown: &Flown, rows: &[Estimate]) -> Option<SilentFailure> {
        let Truth::Simulated(simulator) = &flown.truth else { return None };
        SilentFailure::of(rows, &flown.truth, simulator.frame_time(0), SILENT_FROM_S)
    }

    /// True if the sensor that failed in silence was named in time, and the estimates that could be used were as good as they
    /// said.
    #[must_use]
    pub fn is_honest_of_silence(&self, report: &Report) -> bool {
        let bits = self.fault.names();
        let names: Vec<&str> =
            HealthBits::NAMES.iter().filter(|(bit, _)| bits.contains(bit)).map(|(_, name)| *name).collect();
        report.silence.as_ref().is_some_and(|silence| silence.is_honest(&names))
    }

    /// Its row of the table.
    #[must_use]
    pub fn row(&self, report: &Report) -> String {
        table::row(self, report)
    }
}
