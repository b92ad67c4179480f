//! Which of the built-in simulated flights a command flies.

use super::Usage;
use super::paths::trajectories;
use clap::Args;
use plumbline_lab::campaign::{CampaignFault, Entry, PATHS, RECORDED_PATHS, SCENES};
use plumbline_simulator::{FlightPath, Scene};
use std::path::{Path, PathBuf};

/// Where flights along trajectories that are not built in start, s.
const OTHER_START_S: f64 = 15.0;

/// Trajectories, scenes and seeds; every one of each is flown with every one of the others.
#[derive(Clone, Debug, Args)]
pub struct FlightChoice {
    /// Folder with `euroc/trajectories`. Default: $PLUMBLINE_SHARED, or ../shared.
    #[arg(long)]
    pub shared: Option<PathBuf>,
    /// Use only scenes with these name prefixes: room, hall, low-texture.
    #[arg(long, value_delimiter = ',')]
    pub scene: Vec<String>,
    /// Use only built-in trajectories with these name prefixes, or any other trajectory by its full name, or paths
    /// such as yaws, sweeps and hover (see `plumbline replay --path`).
    #[arg(long, value_delimiter = ',')]
    pub path: Vec<String>,
    /// Seeds to fly with.
    #[arg(long, visible_alias = "seeds", value_delimiter = ',', default_value = "1")]
    pub seed: Vec<u64>,
    /// Length of each simulated flight, seconds.
    #[arg(long, default_value_t = 15.0)]
    pub duration: f64,
    /// Size of the images relative to the configured size. With 0.5 they render four times as fast.
    #[arg(long, default_value_t = 1.0)]
    pub scale: f64,
}

/// Flight, and what is kept of it.
#[derive(Clone, Debug, Args)]
pub struct TrialArgs {
    /// Use the left camera only.
    #[arg(long)]
    pub mono: bool,
    /// Configuration file or preset of the simulated rig and of the estimator.
    #[arg(long)]
    pub config: Option<PathBuf>,
    /// Change a key of the estimator's configuration, such as estimator.points.sigma_px=0.3; may be repeated. The
    /// simulated rig keeps its own values.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub overrides: Vec<String>,
    /// Cache rendered frames in this folder (about 220 MB for 15 s of stereo).
    #[arg(long)]
    pub cache: Option<PathBuf>,
    /// Write all reports (JSON).
    #[arg(long, value_name = "OUT.json")]
    pub json: Option<PathBuf>,
}

impl FlightChoice {
    /// The flights, without a fault, from each of `starts_s` into the trajectory or, without any, where the vehicle is in full
    /// flight; never none.
    ///
    /// # Errors
    /// When a name is unknown, or the trajectories are not there.
    pub fn entries(&self, starts_s: &[f64]) -> Result<Vec<Entry>, Usage> {
        self.entries_along(&PATHS, starts_s)
    }

    /// The flights with the inertial samples that were recorded along their paths; else as [`Self::entries`].
    ///
    /// # Errors
    /// As [`Self::entries`].
    pub fn recorded_entries(&self, starts_s: &[f64]) -> Result<Vec<Entry>, Usage> {
        let imu = trajectories(self.shared.as_deref())?.with_file_name("imu");
        let entries = self.entries_along(&RECORDED_PATHS, starts_s)?;
        Ok(entries.into_iter().map(|entry| entry.with_recorded_imu(&imu)).collect())
    }

    fn entries_along(&self, built_in: &[(&str, f64)], starts_s: &[f64]) -> Result<Vec<Entry>, Usage> {
        let is_built_in = |name: &String| !matches!(FlightPath::named(name), FlightPath::Tum(_));
        let folder = match !self.path.is_empty() && self.path.iter().all(is_built_in) {
            // Such paths need no data.
            true => PathBuf::new(),
            false => trajectories(self.shared.as_deref())?,
        };
        let (paths, scenes) = (paths(&self.path, built_in, &folder)?, scenes(&self.scene)?);
        let mut entries = Vec::new();
        for scene in scenes {
            for (path, full_flight_s) in &paths {
                let starts_s =
                    if starts_s.is_empty() { std::slice::from_ref(full_flight_s) } else { starts_s };
                for start_s in starts_s {
                    let start = (path.as_str(), *start_s);
                    let new =
                        |&seed| Entry::new(&folder, start, scene, seed, self.duration, CampaignFault::None);
                    entries.extend(self.seed.iter().map(new));
                }
            }
        }
        for entry in &mut entries {
            entry.scenario.resolution_scale = self.scale;
        }
        Ok(entries)
    }
}

/// The trajectories of the choice with their starts, s; never empty.
fn paths(
    wanted: &[String],
    built_in: &[(&str, f64)],
    trajectories: &Path,
) -> Result<Vec<(String, f64)>, Usage> {
    let built_in = |prefix: &str| {
        let paths = built_in.iter().filter(|(name, _)| name.starts_with(prefix));
        paths.map(|(name, start_s)| ((*name).to_owned(), *start_s)).collect::<Vec<_>>()
    };
    if wanted.is_empty() {
        return Ok(built_in(""));
    }
    let mut paths = Vec::new();
    for name in wanted {
        let found = built_in(name);
        let other = trajectories.join(format!("{name}.tum.gz"));
        if !found.is_empty() {
            paths.extend(found);
        } else if !matches!(FlightPath::named(name), FlightPath::Tum(_)) {
            paths.push((name.clone(), 0.0));
        } else if other.is_file() {
            paths.push((name.clone(), OTHER_START_S));
        } else {
            return Err(Usage(format!("--path: no trajectory '{name}', and no {}", other.display())));
        }
    }
    Ok(paths)
}

/// The scenes of the choice; never empty.
fn scenes(wanted: &[String]) -> Result<Vec<(&'static str, Scene)>, Usage> {
    if let Some(name) = wanted.iter().find(|w| !SCENES.iter().any(|(name, _)| name.starts_with(w.as_str()))) {
        return Err(Usage(format!("--scene: no scene '{name}': choose room, hall or low-texture")));
    }
    let chosen = |name: &str| wanted.is_empty() || wanted.iter().any(|w| name.starts_with(w.as_str()));
    Ok(SCENES.into_iter().filter(|(name, _)| chosen(name)).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    #[derive(Parser)]
    struct Command {
        #[command(flatten)]
        choice: FlightChoice,
    }

    #[test]
    fn built_in_paths_need_no_shared_data() {
        let entries = |paths| {
            let line = ["", "--shared", "/nowhere", "--scene", "room", "--path", paths];
            Command::parse_from(line).choice.entries(&[])
        };
        assert_eq!(entries("yaws,hover").unwrap().len(), 2);
        assert!(entries("yaws,V1_02").unwrap_err().0.contains("/nowhere"));
    }

    #[test]
    fn names_choose_and_unknown_names_are_refused() {
        let none = Path::new("/nowhere");
        assert_eq!(paths(&[], &PATHS, none).unwrap().len(), PATHS.len());
        let chosen = paths(&["V1".into()], &PATHS, none).unwrap();
        assert_eq!(
            chosen.iter().map(|p| p.0.as_str()).collect::<Vec<_>>(),
            ["V1_02_medium", "V1_03_difficult"]
        );
        assert_eq!(paths(&["yaws".into()], &PATHS, none).unwrap(), [("yaws".to_owned(), 0.0)]);
        assert!(paths(&["V9".into()], &PATHS, none).unwrap_err().0.contains("'V9'"));
        assert_eq!(scenes(&["low".into(), "hall".into()]).unwrap().len(), 2);
        assert!(scenes(&["moon".into()]).unwrap_err().0.contains("moon"));
    }
}
