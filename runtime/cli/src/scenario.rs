//! The arguments that describe a simulated flight.

use super::paths::flown_path;
use super::{Usage, parse_range};
use anyhow::Result;
use clap::Args;
use plumbline_flight::flight::Flight;
use plumbline_simulator::InjectedFault;
use plumbline_simulator::{
    Effects, FlightPath, ImuError, Inertial, Scenario, Scene, SimulatedCondition, USUAL_DURATION_S,
    recorded_along,
};
use std::ops::Range;

/// Relative standard deviation of the gain with `--flicker`.
const FLICKER: f64 = 0.15;

/// A simulated flight.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Simulated flight")]
pub struct ScenarioArgs {
    /// Path: `demo` (take-off and figures of eight), `hand-held` (about all axes), `hover`, `drift` (slowly to the left),
    /// `carried` (starts and ends at rest), `yaws` (500 degrees/s), `sweeps` (banked), a TUM file (or .gz), or a name in the shared
    /// data: V1_02.
    #[arg(long, default_value = "demo")]
    pub path: String,
    /// Inertial samples: `simulated`, `recorded` (by a real sensor along this path, such as `--path V1_02 --imu recorded`), or a
    /// file of recorded samples. `recorded` reads .../imu/NAME.csv.gz for --path .../trajectories/NAME.tum.gz. Recorded samples
    /// are used unchanged, and the path is adjusted to them.
    #[arg(long, value_name = "simulated|recorded|FILE", default_value = "simulated")]
    pub imu: String,
    /// Error of the simulated inertial sensor, such as force:0.07:2; may be repeated: see
    /// `plumbline help imu-errors`.
    #[arg(long, value_name = "NAME[:DOSE...]", value_delimiter = ',')]
    pub imu_error: Vec<ImuError>,
    /// Condition of light, camera, scene or motion, such as blur:10:6; may be repeated: see
    /// `plumbline help conditions`.
    #[arg(long, value_name = "NAME[:DOSE...]", value_delimiter = ',')]
    pub condition: Vec<SimulatedCondition>,
    /// Give the estimator a calibration that the seed draws around the true one, with K times the standard deviations
    /// in [rig] of the configuration (before --set).
    #[allow(rustdoc::broken_intra_doc_links)]
    #[arg(long, value_name = "K", default_value_t = 0.0)]
    pub calibration_error: f64,
    /// Tilt of the whole scene from the vertical, degrees, in a direction drawn by the seed.
    #[arg(long, value_name = "DEG", default_value_t = 0.0, allow_hyphen_values = true)]
    pub lean_deg: f64,
    /// Start, seconds into the path, data set or log.
    #[arg(long, value_name = "S", default_value_t = 0.0)]
    pub start: f64,
    /// Length, seconds. Default: 20 for a simulated flight, else to the end.
    #[arg(long, value_name = "S")]
    pub duration: Option<f64>,
    /// Number of laps, with a smooth return path between them.
    #[arg(long, default_value_t = 1)]
    pub laps: u32,
    /// Seed of all random draws: world, noise, biases.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Size of the images relative to the configured size.
    #[arg(long, default_value_t = 1.0)]
    pub scale: f64,
    /// Time by which the stamps of images are too early, ms.
    #[arg(long, default_value_t = 0.0, allow_hyphen_values = true)]
    pub time_offset_ms: f64,
    /// Give the estimator extrinsics rotated by this angle from the true ones, degrees.
    #[arg(long, default_value_t = 0.0, allow_hyphen_values = true)]
    pub extrinsics_error_deg: f64,
    /// Faults of frames.
    #[command(flatten)]
    pub faults: FaultArgs,
}

/// Faults of frames, simulated or recorded. Times are seconds since the first frame.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Faults, in any flight")]
pub struct FaultArgs {
    /// Make both images black from A to B, seconds.
    #[arg(long, value_name = "A..B")]
    pub blackout: Option<String>,
    /// Probability that a frame is lost.
    #[arg(long, default_value_t = 0.0)]
    pub drop_rate: f64,
    /// Vary the exposure from frame to frame (simulated flights).
    #[arg(long)]
    pub flicker: bool,
    /// Fault to inject, such as accel-pulse:x:30@6+0.1; may be repeated: see
    /// `plumbline help faults`.
    #[arg(long, value_name = "KIND[:DOSE...][@FROM]", value_delimiter = ',')]
    pub fault: Vec<InjectedFault>,
}

impl FaultArgs {
    /// Faults of the options beside `--fault`, with the option of each.
    fn of_options(&self) -> Result<Vec<(&'static str, InjectedFault)>, Usage> {
        let parsed = |option: &'static str, text: String| {
            let fault = text.parse::<InjectedFault>().map_err(|why| Usage(format!("{option}: {why}")))?;
            Ok((option, fault))
        };
        let mut faults = Vec::new();
        if let Some(text) = &self.blackout {
            let Range { start, end } = span("--blackout", text)?;
            faults.push(parsed("--blackout", format!("image-black:0@{start}+{}", end - start))?);
        }
        if self.drop_rate != 0.0 {
            let (option, fault) = parsed("--drop-rate", format!("frames-missing:{}", self.drop_rate))?;
            faults.push((option, fault.placeless()));
        }
        Ok(faults)
    }

    /// The faults for people, each with its time.
    ///
    /// # Errors
    /// When an argument makes no sense.
    pub fn words(&self) -> Result<Vec<String>, Usage> {
        let flicker = self.flicker.then(|| "exposure that varies from frame to frame".to_owned());
        let options = self.of_options()?.into_iter().map(|(_, fault)| fault);
        Ok(options.chain(self.fault.iter().copied()).map(|fault| fault.words()).chain(flicker).collect())
    }

    /// True if there are no faults.
    fn are_none(&self) -> bool {
        self.blackout.is_none() && self.drop_rate == 0.0 && !self.flicker && self.fault.is_empty()
    }

    /// Refuses faults that would begin after the end of the flight.
    ///
    /// # Errors
    /// When one does.
    pub fn check_begin_before(&self, end_s: f64) -> Result<(), Usage> {
        let options = self.of_options()?.into_iter().map(|(option, fault)| (option.to_owned(), fault));
        let injected = self.fault.iter().map(|fault| (format!("--fault {fault}"), *fault));
        match options.chain(injected).find(|(_, fault)| fault.span_s().start >= end_s) {
            Some((option, fault)) => Err(Usage(format!(
                "{option}: begins at {} s, after the flight's end at {end_s:.2} s",
                fault.span_s().start
            ))),
            None => Ok(()),
        }
    }

    /// The faults of the options beside `--fault` in the streams of a flight; in a simulated one, darkness is an effect on its
    /// images.
    ///
    /// # Errors
    /// When an argument makes no sense.
    pub fn in_streams(&self, is_simulated: bool) -> Result<Vec<InjectedFault>, Usage> {
        let is_left = |option: &str| !(is_simulated && option == "--blackout");
        let options = self.of_options()?.into_iter().filter(|(option, _)| is_left(option));
        Ok(options.map(|(_, fault)| fault).collect())
    }

    /// The flight with these faults.
    ///
    /// # Errors
    /// When an argument makes no sense, or the flight cannot have such a fault.
    pub fn inject(&self, flight: Flight, seed: u64, is_simulated: bool) -> Result<Flight> {
        let flight = flight.with_injected(&self.in_streams(is_simulated)?, seed)?;
        Ok(flight.with_injected(&self.fault, seed)?)
    }
}

/// The scene of that name.
///
/// # Errors
/// When there is none.
pub fn parse_scene(name: &str) -> Result<Scene, Usage> {
    let full_name = if name == "low" { "low-texture" } else { name };
    Scene::named(full_name)
        .ok_or_else(|| Usage(format!("no scene '{name}': choose room, hall, low-texture or far")))
}

impl ScenarioArgs {
    /// Refuses options that have no meaning for a recorded flight.
    ///
    /// # Errors
    /// When one was given.
    pub fn check_recorded(&self) -> Result<(), Usage> {
        let given = [
            ("--path", self.path != "demo"),
            ("--imu", self.imu != "simulated"),
            ("--imu-error", !self.imu_error.is_empty()),
            ("--condition", !self.condition.is_empty()),
            ("--calibration-error", self.calibration_error != 0.0),
            ("--lean-deg", self.lean_deg != 0.0),
            ("--laps", self.laps != 1),
            ("--seed", self.seed != 1 && self.faults.are_none()),
            ("--scale", self.scale != 1.0),
            ("--flicker", self.faults.flicker),
            ("--time-offset-ms", self.time_offset_ms != 0.0),
            ("--extrinsics-error-deg", self.extrinsics_error_deg != 0.0),
        ];
        match given.into_iter().find(|(_, is_given)| *is_given) {
            Some((option, _)) => Err(Usage(format!(
                "{option}: is for simulated flights (sim:room and the like); leave it out"
            ))),
            None => Ok(()),
        }
    }

    /// The seconds of a recorded flight that are flown, up to `stop` where that is given.
    ///
    /// # Errors
    /// When there are none.
    pub fn seconds(&self, stop: Option<f64>) -> Result<std::ops::Range<f64>, Usage> {
        let by_duration = self.duration.map(|duration| self.start + duration);
        let end = stop.or(by_duration).unwrap_or(f64::INFINITY);
        if !(self.start.is_finite() && self.start >= 0.0 && end > self.start) {
            return Err(Usage(format!(
                "--start {} and the end at {end} s leave no frame: give seconds from the first frame",
                self.start
            )));
        }
        Ok(self.start..end)
    }

    /// The scenario in `scene`.
    ///
    /// # Errors
    /// When an argument makes no sense.
    pub fn scenario(&self, scene: Scene) -> Result<Scenario, Usage> {
        let mut effects = Effects { time_offset_s: self.time_offset_ms * 1e-3, ..Effects::default() };
        if let Some(text) = &self.faults.blackout {
            let dark = span("--blackout", text)?;
            effects.blackout = Some((dark.start, dark.end));
        }
        if self.faults.flicker {
            effects.flicker = FLICKER;
        }
        let duration_s = self.duration.unwrap_or(USUAL_DURATION_S);
        self.faults.check_begin_before(duration_s)?;
        let path = FlightPath::named(&flown_path(&self.path)?);
        let mut scenario = Scenario {
            scene,
            inertial: self.inertial(&path)?,
            path,
            start_s: self.start,
            duration_s,
            laps: self.laps,
            seed: self.seed,
            resolution_scale: self.scale,
            effects,
            lean_deg: self.lean_deg,
            calibration_error: self.calibration_error,
            ..Scenario::default()
        };
        self.imu_error.iter().for_each(|error| error.apply(&mut scenario));
        self.condition.iter().for_each(|condition| condition.apply(&mut scenario));
        Ok(scenario)
    }

    fn inertial(&self, path: &FlightPath) -> Result<Inertial, Usage> {
        match (self.imu.as_str(), path) {
            ("simulated", _) => Ok(Inertial::Simulated),
            ("recorded", FlightPath::Tum(file)) => Ok(Inertial::Recorded(recorded_along(file))),
            ("recorded", _) => Err(Usage(format!(
                "--imu recorded: nothing was recorded along the path {}; give --path the trajectory of a recording, such as V1_02",
                self.path
            ))),
            (file, _) => Ok(Inertial::Recorded(file.into())),
        }
    }
}

fn span(flag: &str, text: &str) -> Result<Range<f64>, Usage> {
    match parse_range::<f64>(text).map_err(|e| Usage(format!("{flag}: {e}")))? {
        (Some(from), Some(to)) => Ok(from..to),
        _ => Err(Usage(format!("{flag}: '{text}' needs both ends, such as 5..6.5"))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_document_of_the_simulator_lists_every_fault() {
        let document = include_str!("../../../docs/simulator.md");
        for kind in InjectedFault::kinds() {
            assert!(document.contains(&format!("`{}`", kind.name)), "{}", kind.name);
        }
    }
}
