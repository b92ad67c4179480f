//! Simulated flights that an argument names: `sim:room?path=demo&duration=10`.

use super::Usage;
use super::scenario::{ScenarioArgs, parse_scene};
use anyhow::Result;
use clap::Parser;
use plumbline_config::ValidConfig;
use plumbline_flight::flight::{Flight, open_simulation};
use plumbline_simulator::Scene;
use std::path::Path;

/// A simulated flight, as it was named.
#[derive(Clone, Debug)]
pub(super) struct SimulatedFlight {
    /// Scene.
    pub scene: Scene,
    /// Options after the `?`.
    pub options: ScenarioArgs,
    /// True if there are any.
    pub has_options: bool,
    /// True for the left camera only.
    pub mono: bool,
}

impl SimulatedFlight {
    /// Opens the flight, with its faults; frames are kept in the folder `cache`, if there is one.
    ///
    /// # Errors
    /// When an option makes no sense, or the flight cannot be simulated.
    pub fn open(&self, config: Option<ValidConfig>, cache: Option<&Path>) -> Result<Flight> {
        let scenario = self.options.scenario(self.scene)?;
        let error_deg = self.options.extrinsics_error_deg;
        let flight = open_simulation(config, &scenario, self.mono, error_deg, cache)?;
        self.options.faults.inject(flight, scenario.seed, true)
    }
}

/// Options of a simulated flight, as a command line of their own.
#[derive(Debug, Parser)]
#[command(no_binary_name = true, disable_help_flag = true)]
struct Simulated {
    #[command(flatten)]
    scenario: ScenarioArgs,
    /// Use the left camera only.
    #[arg(long)]
    mono: bool,
}

/// Simulated flight that `name` names; `None` for the name of a file.
///
/// # Errors
/// When there is no such scene or option.
pub(super) fn simulated(name: &str) -> Result<Option<SimulatedFlight>> {
    let Some(flight) = name.strip_prefix("sim:") else { return Ok(None) };
    let (scene, options) = flight.split_once('?').unwrap_or((flight, ""));
    let scene = parse_scene(scene)?;
    let arguments = arguments(options);
    let has_options = !arguments.is_empty();
    let parsed = Simulated::try_parse_from(arguments).map_err(|e| {
        let text = e.to_string();
        let first = text.lines().next().unwrap_or_default().trim_start_matches("error: ");
        Usage(format!("{name}: {first}; `plumbline simulate --help` lists the options of a simulated flight"))
    })?;
    Ok(Some(SimulatedFlight { scene, options: parsed.scenario, has_options, mono: parsed.mono }))
}

/// True if an option of a simulated flight has another value than its default.
pub(super) fn are_given(options: &ScenarioArgs) -> bool {
    let defaults = Simulated::try_parse_from(std::iter::empty::<&str>()).map(|parsed| parsed.scenario);
    defaults.map_or(true, |defaults| format!("{defaults:?}") != format!("{options:?}"))
}

/// Refuses a simulated flight where a command reads a recording.
///
/// # Errors
/// When `source` names one.
pub(super) fn check_recorded(source: &Path) -> Result<(), Usage> {
    match source.to_str().filter(|name| name.starts_with("sim:")) {
        Some(name) => Err(Usage(format!(
            "{name}: is a simulated flight, and this command reads a recording; write the flight with `plumbline simulate FOLDER` (options \
             as after the ?, with dashes) or record it with `plumbline replay {name} --record LOG.mcap`, and name that"
        ))),
        None => Ok(()),
    }
}

/// `path=demo&flicker` as `--path=demo --flicker`; a switch may be written as `flicker=true`.
fn arguments(options: &str) -> Vec<String> {
    let given = options.split('&').filter(|option| !option.is_empty() && !option.ends_with("=false"));
    given.map(|option| format!("--{}", option.strip_suffix("=true").unwrap_or(option))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_of_the_name_and_of_the_command_line_are_told_apart() {
        let flight = |name| simulated(name).unwrap();
        assert!(flight("V1_01_easy").is_none());
        let plain = flight("sim:room").unwrap();
        assert!(!plain.has_options && !are_given(&plain.options));
        let named = flight("sim:hall?duration=3&seed=2").unwrap();
        assert!(named.has_options && are_given(&named.options));
        assert_eq!((named.scene, named.options.duration, named.options.seed), (Scene::Hall, Some(3.0), 2));
    }

    #[test]
    fn switches_may_have_a_value_and_one_camera_is_one_of_them() {
        let flight = |name| simulated(name).unwrap().unwrap();
        for name in ["sim:room?mono", "sim:room?mono=true&seed=2", "sim:room?flicker=false&mono=true"] {
            assert!(flight(name).mono && !flight(name).options.faults.flicker, "{name}");
        }
        assert!(
            !flight("sim:room?mono=false").mono && flight("sim:room?flicker=true").options.faults.flicker
        );
        let words = simulated("sim:room?stereo=true").unwrap_err().to_string();
        assert!(words.contains("--stereo") && words.contains("plumbline simulate --help"), "{words}");
    }

    #[test]
    fn a_command_that_reads_recordings_says_how_to_write_one() {
        assert!(check_recorded(Path::new("V1_01_easy")).is_ok());
        let words = check_recorded(Path::new("sim:room?duration=3")).unwrap_err().to_string();
        assert!(words.contains("plumbline simulate FOLDER") && words.contains("--record"), "{words}");
    }
}
