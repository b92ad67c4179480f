//! `plumbline campaign`: the built-in set of simulated flights, tabulated.

use super::overrides::with_overrides;
use super::{Usage, check_outputs, load_config, say};
use crate::campaign::table::{TABLE_HEAD, means};
use crate::campaign::{Entry, Fault, PATHS, SCENES, Setup};
use crate::report::Report;
use anyhow::{Context, Result, ensure};
use clap::Args;
use plumbline_config::Config;
use plumbline_drivers::simulator::Scene;
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};

/// Where flights along trajectories that are not built in start, s.
const OTHER_START_S: f64 = 15.0;

/// Arguments of `plumbline campaign`.
#[derive(Debug, Args)]
pub struct CampaignArgs {
    /// Folder with `euroc/trajectories`; else the environment variable PLUMBLINE_SHARED, else ../shared.
    #[arg(long)]
    pub shared: Option<PathBuf>,
    /// Only scenes whose names begin so: room, hall, low-texture.
    #[arg(long, value_delimiter = ',')]
    pub scene: Vec<String>,
    /// Only built-in trajectories whose names begin so, or any other one by its full name.
    #[arg(long, value_delimiter = ',')]
    pub path: Vec<String>,
    /// Seeds to fly with.
    #[arg(long, value_delimiter = ',', default_value = "1")]
    pub seed: Vec<u64>,
    /// Start, seconds into the trajectory; else where the vehicle is in full flight.
    #[arg(long)]
    pub start: Option<f64>,
    /// Length of each flight, seconds.
    #[arg(long, default_value_t = 15.0)]
    pub duration: f64,
    /// Fly each fault once on top, along the first trajectory in the first scene of the choice.
    #[arg(long)]
    pub faults: bool,
    /// The left camera alone.
    #[arg(long)]
    pub mono: bool,
    /// Configuration file or preset of the simulated rig and of the estimator.
    #[arg(long)]
    pub config: Option<PathBuf>,
    /// Change a key of the estimator's configuration, such as estimator.points.sigma_px=0.3; may be
    /// repeated. What is simulated stays the same.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub overrides: Vec<String>,
    /// Keep rendered frames in this folder (about 220 MB for 15 s of stereo) and take them from there.
    #[arg(long)]
    pub cache: Option<PathBuf>,
    /// Flights at a time.
    #[arg(long, default_value_t = 2, value_parser = clap::value_parser!(u8).range(1..=64))]
    pub jobs: u8,
    /// 1 renders between frames, 2 ahead on another thread.
    #[arg(long, default_value_t = 2, value_parser = clap::value_parser!(u8).range(1..=8))]
    pub threads: u8,
    /// Write all reports (JSON).
    #[arg(long, value_name = "OUT.json")]
    pub json: Option<PathBuf>,
}

#[derive(Serialize)]
struct Row<'a> {
    path: &'a str,
    scene: &'a str,
    fault: String,
    seed: u64,
    report: &'a Report,
}

/// Runs the command.
///
/// # Errors
/// When a flight cannot be simulated.
pub fn run(args: &CampaignArgs) -> Result<()> {
    check_outputs(&args.json)?;
    let config = load_config(args.config.as_deref())?.map_or_else(|| Config::preset("sim"), Ok)?;
    with_overrides(&config, &args.overrides)?;
    let entries = entries(args)?;
    let setup = Setup {
        config: Some(config),
        overrides: args.overrides.clone(),
        mono: args.mono,
        cache: args.cache.clone(),
        threads: usize::from(args.threads),
    };
    say(TABLE_HEAD);
    let flown = fly_all(&entries, &setup, usize::from(args.jobs));
    let reports = || entries.iter().zip(&flown).filter_map(|(e, r)| Some((e, r.as_ref()?)));
    say(format_args!("\n{}", means(reports())));
    if let Some(file) = &args.json {
        let rows: Vec<Row<'_>> = reports().map(json_row).collect();
        std::fs::write(file, serde_json::to_string_pretty(&rows)?).context(file.display().to_string())?;
    }
    let failed = flown.iter().filter(|report| report.is_none()).count();
    ensure!(failed == 0, "{failed} of {} flights could not be flown", entries.len());
    Ok(())
}

fn json_row<'a>((entry, report): (&'a Entry, &'a Report)) -> Row<'a> {
    let fault = format!("{:?}", entry.fault);
    Row { path: &entry.path, scene: entry.scene, fault, seed: entry.scenario.seed, report }
}

/// Flies the entries, `jobs` at a time, and prints each as it lands; the reports are in the order of the
/// entries.
fn fly_all(entries: &[Entry], setup: &Setup, jobs: usize) -> Vec<Option<Report>> {
    let next = AtomicUsize::new(0);
    let worker = || {
        let mut flown = Vec::new();
        let take = || {
            let index = next.fetch_add(1, Ordering::Relaxed);
            entries.get(index).map(|entry| (index, entry))
        };
        for (index, entry) in std::iter::from_fn(take) {
            match entry.fly_as(setup) {
                Ok(report) => {
                    say(entry.row(&report));
                    flown.push((index, report));
                }
                Err(error) => eprintln!("plumbline: {} in {}: {error:#}", entry.path, entry.scene),
            }
        }
        flown
    };
    let mut reports = vec![None; entries.len()];
    std::thread::scope(|scope| {
        let workers: Vec<_> = (0..jobs.min(entries.len())).map(|_| scope.spawn(worker)).collect();
        for flown in workers {
            let flown = flown.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
            flown.into_iter().for_each(|(index, report)| reports[index] = Some(report));
        }
    });
    reports
}

fn entries(args: &CampaignArgs) -> Result<Vec<Entry>, Usage> {
    let trajectories = trajectories(args.shared.as_deref())?;
    let (paths, scenes) = (paths(&args.path, &trajectories)?, scenes(&args.scene)?);
    let new = |(name, start_s): &(String, f64), scene, seed, fault| {
        let start_s = args.start.unwrap_or(*start_s);
        Entry::new(&trajectories, (name, start_s), scene, seed, args.duration, fault)
    };
    let mut entries = Vec::new();
    for &scene in &scenes {
        for path in &paths {
            entries.extend(args.seed.iter().map(|&seed| new(path, scene, seed, Fault::None)));
        }
    }
    if args.faults {
        // With one camera there is no right one to lose, and without the left there is none.
        let possible = |fault: &Fault| !(args.mono && matches!(fault, Fault::LeftLost | Fault::RightLost));
        let faults = Fault::ALL.into_iter().filter(possible);
        entries.extend(faults.map(|fault| new(&paths[0], scenes[0], args.seed[0], fault)));
    }
    Ok(entries)
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

/// The trajectories of the choice with their starts, s; never empty.
pub(super) fn paths(wanted: &[String], trajectories: &Path) -> Result<Vec<(String, f64)>, Usage> {
    let built_in = |prefix: &str| {
        let paths = PATHS.into_iter().filter(|(name, _)| name.starts_with(prefix));
        paths.map(|(name, start_s)| (name.to_owned(), start_s)).collect::<Vec<_>>()
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
        } else if other.is_file() {
            paths.push((name.clone(), OTHER_START_S));
        } else {
            return Err(Usage(format!("--path: no trajectory '{name}', and no {}", other.display())));
        }
    }
    Ok(paths)
}

/// The scenes of the choice; never empty.
pub(super) fn scenes(wanted: &[String]) -> Result<Vec<(&'static str, Scene)>, Usage> {
    if let Some(name) = wanted.iter().find(|w| !SCENES.iter().any(|(name, _)| name.starts_with(w.as_str()))) {
        return Err(Usage(format!("--scene: no scene '{name}': choose room, hall or low-texture")));
    }
    let chosen = |name: &str| wanted.is_empty() || wanted.iter().any(|w| name.starts_with(w.as_str()));
    Ok(SCENES.into_iter().filter(|(name, _)| chosen(name)).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_choose_and_unknown_names_are_refused() {
        let none = Path::new("/nowhere");
        assert_eq!(paths(&[], none).unwrap().len(), PATHS.len());
        let chosen = paths(&["V1".into()], none).unwrap();
        assert_eq!(
            chosen.iter().map(|p| p.0.as_str()).collect::<Vec<_>>(),
            ["V1_02_medium", "V1_03_difficult"]
        );
        assert!(paths(&["V9".into()], none).unwrap_err().0.contains("'V9'"));
        assert_eq!(scenes(&["low".into(), "hall".into()]).unwrap().len(), 2);
        assert!(scenes(&["moon".into()]).unwrap_err().0.contains("moon"));
    }
}
