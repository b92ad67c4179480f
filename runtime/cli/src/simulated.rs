//! Simulated flights that an argument names: `sim:room?path=demo&duration=10`.

use super::Usage;
use super::scenario::{ScenarioArgs, parse_scene};
use anyhow::Result;
use clap::Parser;
use plumbline_drivers::simulator::{FlightPath, Scene};
use std::path::{Path, PathBuf};

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
pub(super) fn simulated(name: &str, shared: Option<&Path>) -> Result<Option<SimulatedFlight>> {
    let Some(flight) = name.strip_prefix("sim:") else { return Ok(None) };
    let (scene, options) = flight.split_once('?').unwrap_or((flight, ""));
    let scene = parse_scene(scene)?;
    let arguments = arguments(options, shared)?;
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

/// `path=demo&motion-blur` as `--path=demo --motion-blur`; a switch may be written as `motion-blur=true`. A built-in trajectory of the
/// shared data begins where the vehicle is in full flight.
fn arguments(options: &str, shared: Option<&Path>) -> Result<Vec<String>, Usage> {
    let mut arguments = Vec::new();
    for option in options.split('&').filter(|option| !option.is_empty() && !option.ends_with("=false")) {
        let Some(name) = option.strip_prefix("path=") else {
            arguments.push(format!("--{}", option.strip_suffix("=true").unwrap_or(option)));
            continue;
        };
        let path = flown_path(name, shared)?;
        arguments.push(format!("--path={path}"));
        let is_named = path != name && !options.contains("start=");
        if let Some(start_s) = full_flight_s(&path).filter(|_| is_named) {
            arguments.push(format!("--start={start_s}"));
        }
    }
    Ok(arguments)
}

/// A built-in path, a file, or the file of the trajectory in the shared data whose name begins so.
///
/// # Errors
/// When there is none, or several.
pub(super) fn flown_path(name: &str, shared: Option<&Path>) -> Result<String, Usage> {
    if !matches!(FlightPath::named(name), FlightPath::Tum(_)) || Path::new(name).exists() {
        return Ok(name.to_owned());
    }
    let folder = trajectories(shared);
    let known = folder.as_deref().map(known_trajectories).unwrap_or_default();
    let found: Vec<&String> =
        known.iter().filter(|known| !name.is_empty() && known.starts_with(name)).collect();
    if let (Ok(folder), [one]) = (&folder, found.as_slice()) {
        return Ok(folder.join(format!("{one}.tum.gz")).display().to_string());
    }
    let names = match &folder {
        Ok(folder) => format!("a trajectory in {}: {}", folder.display(), known.join(", ")),
        Err(_) => {
            "the name of a trajectory in the shared data ($PLUMBLINE_SHARED, or ../shared; not found)".into()
        }
    };
    let what = if found.len() > 1 { "is the beginning of several names" } else { "no such path or file" };
    Err(Usage(format!(
        "--path {name}: {what}; give {}, a TUM file such as FOLDER/NAME.tum.gz, or {names}",
        FlightPath::NAMES.join(", ")
    )))
}

/// Names of the trajectories in a folder.
fn known_trajectories(folder: &Path) -> Vec<String> {
    let files = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let names = files.filter_map(|file| file.file_name().into_string().ok());
    let mut names: Vec<String> =
        names.filter_map(|name| name.strip_suffix(".tum.gz").map(str::to_owned)).collect();
    names.sort();
    names
}

/// Start of the flight along the file of a built-in trajectory, s.
fn full_flight_s(path: &str) -> Option<f64> {
    let name = Path::new(path).file_name()?.to_str()?.strip_suffix(".tum.gz")?;
    #[cfg(feature = "lab")]
    let built_in = &plumbline_lab::campaign::PATHS[..];
    #[cfg(not(feature = "lab"))]
    let built_in: &[(&str, f64)] = &[];
    built_in.iter().find(|(known, _)| *known == name).map(|(_, start_s)| *start_s)
}

/// The folder of trajectories in the shared data: `shared`, else that of the environment, else `../shared`.
pub(super) fn trajectories(shared: Option<&Path>) -> Result<PathBuf, Usage> {
    let shared =
        shared.map(Path::to_owned).or_else(|| std::env::var_os("PLUMBLINE_SHARED").map(PathBuf::from));
    let folder = shared.unwrap_or_else(|| "../shared".into()).join("euroc/trajectories");
    if folder.is_dir() {
        return Ok(folder);
    }
    Err(Usage(format!("{}: no such folder; name the shared data with --shared", folder.display())))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_of_the_name_and_of_the_command_line_are_told_apart() {
        let flight = |name| simulated(name, None).unwrap();
        assert!(flight("V1_01_easy").is_none());
        let plain = flight("sim:room").unwrap();
        assert!(!plain.has_options && !are_given(&plain.options));
        let named = flight("sim:hall?duration=3&seed=2").unwrap();
        assert!(named.has_options && are_given(&named.options));
        assert_eq!((named.scene, named.options.duration, named.options.seed), (Scene::Hall, Some(3.0), 2));
    }

    #[test]
    fn switches_may_have_a_value_and_one_camera_is_one_of_them() {
        let flight = |name| simulated(name, None).unwrap().unwrap();
        for name in ["sim:room?mono", "sim:room?mono=true&seed=2", "sim:room?motion-blur=false&mono=true"] {
            assert!(flight(name).mono && !flight(name).options.motion_blur, "{name}");
        }
        assert!(
            !flight("sim:room?mono=false").mono && flight("sim:room?motion-blur=true").options.motion_blur
        );
        let words = simulated("sim:room?stereo=true", None).unwrap_err().to_string();
        assert!(words.contains("--stereo") && words.contains("plumbline simulate --help"), "{words}");
    }

    #[test]
    fn a_path_is_built_in_or_a_file_or_the_beginning_of_a_name_in_the_shared_data() {
        let shared = tempfile::tempdir().unwrap();
        let folder = shared.path().join("euroc/trajectories");
        std::fs::create_dir_all(&folder).unwrap();
        for name in ["V1_01_easy", "V1_02_medium"] {
            std::fs::write(folder.join(format!("{name}.tum.gz")), "").unwrap();
        }
        let path = |name: &str| flown_path(name, Some(shared.path())).map_err(|error| error.to_string());
        assert_eq!(path("yaws").unwrap(), "yaws");
        let file = folder.join("V1_02_medium.tum.gz").display().to_string();
        assert_eq!((path("V1_02").unwrap(), path(&file).unwrap()), (file.clone(), file));
        for (name, why) in
            [("V1", "several names"), ("V9", "no such path or file"), ("", "no such path or file")]
        {
            let words = path(name).unwrap_err();
            for part in [why, "hand-held", ".tum.gz", "V1_01_easy, V1_02_medium"] {
                assert!(words.contains(part), "{part}: {words}");
            }
        }
        let words = flown_path("V9", Some(Path::new("/nowhere"))).unwrap_err().to_string();
        assert!(words.contains("yaws") && words.contains("PLUMBLINE_SHARED"), "{words}");
    }

    #[test]
    fn a_command_that_reads_recordings_says_how_to_write_one() {
        assert!(check_recorded(Path::new("V1_01_easy")).is_ok());
        let words = check_recorded(Path::new("sim:room?duration=3")).unwrap_err().to_string();
        assert!(words.contains("plumbline simulate FOLDER") && words.contains("--record"), "{words}");
    }
}
