//! `plumbline sweep`: settings of the configuration, on data sets, on all cores.

use super::simulated::simulated;
use super::topics::TopicArgs;
use super::{Usage, check_outputs, load_config, paired, say, stop_on_signal};
use anyhow::{Context, Result, bail, ensure};
use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};
use plumbline_config::Config;
use plumbline_flight::flight::with_overrides;
use plumbline_lab::evaluate::load_trajectory;
use plumbline_lab::sweep::open_table::{Format, OpenTable};
use plumbline_lab::sweep::{
    Cell, CellResult, Common, NamedTruth, Plan, Subject, SweepAxis, cell, folder, run, side_by_side, table,
};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Starts of the data sets of a folder, s: the median of five flights is that of the open table.
const FOLDER_STARTS_S: [f64; 5] = [0.0, 1.0, 2.0, 3.0, 4.0];

const EXAMPLES: &str = "Examples:
  plumbline sweep --set estimator.points.sigma_px=0.3,0.4,0.5 V1_01_easy MH_05_difficult --out results.csv
  plumbline sweep --set estimator.lines.enabled=true,false 'sim:room?path=demo&duration=10' --seeds 1..8 --paired
  plumbline sweep MH_05_mono_clip --starts 0,0.5,1,1.5,2,2.5,3,3.5,4

The open table of EuRoC or TUM-VI: errors as flown and as known at the end, coverage, RPE, NEES, times of a frame and digests, \
medians over five starts, published figures of others beside, and what is missing:
  plumbline sweep --folder euroc/ --table table.md --table table.csv --table table.tex
  plumbline sweep --folder tum-vi/ --config tum-vi.toml --table table.md

As an array of jobs, on any batch system (see docs/at-scale.md):
  plumbline sweep ... --list                       print the cells, one per line, numbered from 0
  plumbline sweep ... --cell 4 --cells FOLDER      fly one cell, and write FOLDER/cell-4.json
  plumbline sweep --collect FOLDER                 print the table of all finished cells

Simulated flights are sim:room, sim:hall, sim:low-texture and sim:far. After ? append options of `plumbline replay` without their \
dashes, joined by &, such as path=V1_02, imu=recorded (samples of a real sensor along it), duration=20, start=15, seed=2, scale=0.5, motion-blur. \
Finished cells are not flown again: after an interruption, repeat the same command.";

/// Arguments of `plumbline sweep`.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct SweepArgs {
    /// EuRoC data sets, flight logs (.mcap), ROS bags (with --config), or simulated flights
    /// (sim:room?path=demo&duration=10).
    #[arg(required_unless_present_any = ["collect", "folder"], value_name = "DATASET")]
    pub datasets: Vec<String>,
    /// Fly all data sets in this folder and below (EuRoC, TUM-VI), each from 0, 1, 2, 3 and 4 s unless --starts says
    /// otherwise.
    #[arg(long, value_name = "FOLDER", conflicts_with = "collect")]
    pub folder: Option<PathBuf>,
    /// Write the open table: a row for each data set with the median over its starts, published figures beside it, and the
    /// sequences that are missing, with their DOI. Markdown (.md), CSV (.csv) or LaTeX (.tex); may be repeated.
    #[arg(long = "table", value_name = "OUT.md|OUT.csv|OUT.tex")]
    pub tables: Vec<PathBuf>,
    /// Key of the configuration with its values; may be repeated. All combinations of the values are flown.
    #[arg(long = "set", value_name = "KEY=VALUE,VALUE...")]
    pub axes: Vec<String>,
    /// Seeds of simulated flights, such as 1,2,5 or 1..3 (that is 1, 2 and 3).
    #[arg(long, value_parser = parse_seeds, value_name = "SEEDS")]
    pub seeds: Option<SeedList>,
    /// Start times, seconds into each data set or path, such as 0,0.5,1. Each flight is flown from each start to its
    /// end.
    #[arg(long, value_delimiter = ',', value_name = "S,S")]
    pub starts: Vec<f64>,
    /// Compare each setting with the first, flight by flight: means, mean paired differences and their bootstrap
    /// intervals of 95 %. A decision needs at least eight flights.
    #[arg(long)]
    pub paired: bool,
    /// Write the paired comparison (JSON).
    #[arg(long, value_name = "OUT.json")]
    pub paired_json: Option<PathBuf>,
    /// Also print tracks, residuals, NEES and errors of each data set, and the ratio of each figure to that of the first: how well a
    /// simulated flight predicts a recorded one.
    #[arg(long)]
    pub figures: bool,
    /// Configuration file or preset that the settings change. Default: as for `plumbline replay`.
    #[arg(long)]
    pub config: Option<PathBuf>,
    /// Ground truth in place of that of the data sets: TUM (plain or .gz) or a EuRoC table. It must cover each of them.
    #[arg(long, value_name = "FILE")]
    pub truth: Option<PathBuf>,
    /// Topics of bags.
    #[command(flatten)]
    pub topics: TopicArgs,
    /// Use the left camera only.
    #[arg(long)]
    pub mono: bool,
    /// Cache rendered frames of simulated flights in this folder. Flights along one file (--path FILE) share frames
    /// whatever their length. The built-in flight is rendered again for each duration, because its room is built
    /// around the path.
    #[arg(long, value_name = "FOLDER")]
    pub cache: Option<PathBuf>,
    /// Folder with `euroc/trajectories`, for path=NAME. Default: $PLUMBLINE_SHARED, or ../shared.
    #[arg(long)]
    pub shared: Option<PathBuf>,
    /// Parallel flights. Default: the number of processors. The results do not depend on it.
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub jobs: Option<u16>,
    /// Folder of the finished cells of this sweep. Default: the name of --out with the extension .cells; without
    /// --out, a folder in $XDG_CACHE_HOME/plumbline (~/.cache/plumbline), which is deleted after all cells have been
    /// flown.
    #[arg(long, value_name = "FOLDER")]
    pub cells: Option<PathBuf>,
    /// Write every cell with all its figures (CSV).
    #[arg(long, value_name = "OUT.csv")]
    pub out: Option<PathBuf>,
    /// List the cells without flying them.
    #[arg(long, conflicts_with_all = ["cell", "collect"])]
    pub list: bool,
    /// Fly only this cell, and write its file.
    #[arg(long, value_name = "K", conflicts_with = "collect")]
    pub cell: Option<usize>,
    /// Print the table of the cells in this folder, without flying any.
    #[arg(long, value_name = "FOLDER", conflicts_with = "datasets")]
    pub collect: Option<PathBuf>,
}

/// Seeds of simulated flights.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SeedList(Vec<u64>);

/// `1,2,5` or `1..3`.
fn parse_seeds(text: &str) -> Result<SeedList, String> {
    const MOST: u64 = 10_000;
    let bad = || format!("'{text}' is not a list of seeds: write 1,2,5 or 1..3 (that is 1, 2 and 3)");
    let number = |text: &str| text.trim().parse::<u64>().map_err(|_| bad());
    let seeds: Vec<u64> = match text.split_once("..") {
        Some((first, last)) => {
            let (first, last) = (number(first)?, number(last)?);
            if first > last || last - first >= MOST {
                return Err(bad());
            }
            (first..=last).collect()
        }
        None => text.split(',').map(number).collect::<Result<_, _>>()?,
    };
    let mut distinct = seeds.clone();
    distinct.sort_unstable();
    distinct.dedup();
    if distinct.len() == seeds.len() {
        Ok(SeedList(seeds))
    } else {
        Err(format!("'{text}' has a seed twice"))
    }
}

/// Runs the command.
///
/// # Errors
/// When an argument makes no sense, a cell cannot be flown or written, or cells are missing.
pub fn run(args: &SweepArgs) -> Result<()> {
    check_outputs(args.out.iter().chain(&args.paired_json).chain(&args.tables))?;
    if let Some(path) = args.tables.iter().find(|path| Format::of(path).is_none()) {
        bail!(Usage(format!("--table {}: name the file with the ending .md, .csv or .tex", path.display())));
    }
    if let Some(folder) = &args.collect {
        return sum_up(&cell::collect(folder)?, args);
    }
    let plan = plan(args)?;
    check_tables(args, plan.settings().len())?;
    let cells = plan.cells();
    if args.list {
        cells.iter().for_each(|cell| say(format_args!("{}\t{}", cell.index, cell.describe())));
        return Ok(());
    }
    let named = named_folder(args);
    let make = |folder: &Path| std::fs::create_dir_all(folder).with_context(|| folder.display().to_string());
    if let Some(index) = args.cell {
        let cell = plan.cell(index).map_err(|e| Usage(e.to_string()))?;
        let folder =
            named.ok_or_else(|| Usage("--cell: name the folder of the cells with --cells".into()))?;
        make(&folder)?;
        return fly_one(&cell, &folder, &stop_on_signal()?);
    }
    let folder = named.clone().unwrap_or_else(|| cache_folder().join(cell::folder_name(&cells)));
    make(&folder)?;
    fly_missing(&cells, args, &folder, &stop_on_signal()?)?;
    let results = cells.iter().filter_map(|cell| cell.kept_or_failed(&folder).transpose());
    let results = results.collect::<Result<Vec<_>, _>>()?;
    if named.is_none() && results.iter().all(|result| result.error.is_none()) {
        // Nobody asked for these files, and nobody misses them.
        let _ = std::fs::remove_dir_all(&folder);
    }
    sum_up(&results, args)
}

/// The folder of finished cells that the arguments name.
fn named_folder(args: &SweepArgs) -> Option<PathBuf> {
    let beside = |out: &PathBuf| out.with_extension("cells");
    args.cells.clone().or_else(|| args.out.as_ref().map(beside))
}

/// The folder for files that an interrupted command goes on from; the present one where the user has none.
pub(super) fn cache_folder() -> PathBuf {
    let absolute = |name: &str| std::env::var_os(name).map(PathBuf::from).filter(|path| path.is_absolute());
    let of_user = absolute("XDG_CACHE_HOME").or_else(|| Some(absolute("HOME")?.join(".cache")));
    of_user.map(|folder| folder.join("plumbline")).unwrap_or_default()
}

/// The sweep that the arguments describe, every setting checked.
fn plan(args: &SweepArgs) -> Result<Plan> {
    let axes = args.axes.iter().map(|text| SweepAxis::parse(text)).collect::<Result<Vec<_>, _>>();
    let axes = axes.map_err(|e| Usage(e.to_string()))?;
    let mut subjects =
        args.datasets.iter().map(|name| subject(name, args.shared.as_deref())).collect::<Result<Vec<_>>>()?;
    if let Some(folder) = &args.folder {
        subjects.extend(in_folder(folder)?);
    }
    let seeds = args.seeds.as_ref().map_or_else(Vec::new, |seeds| seeds.0.clone());
    if !seeds.is_empty() && !subjects.iter().any(|s| matches!(s, Subject::Simulated { .. })) {
        bail!(Usage(
            "--seeds: none of the flights is simulated; name a flight such as sim:room, or leave it out"
                .into()
        ));
    }
    let common = Common {
        config: load_config(args.config.as_deref())?,
        truth: args.truth.as_deref().map(named_truth).transpose()?.map(Arc::new),
        topics: args.topics.names()?,
        mono: args.mono,
        cache: args.cache.clone(),
    };
    let base = common.config.clone().map_or_else(|| Config::preset("euroc"), Ok)?;
    if let Some(start_s) = args.starts.iter().find(|s| !(s.is_finite() && **s >= 0.0)) {
        bail!(Usage(format!("--starts: {start_s} is not a start time; give seconds from the first frame")));
    }
    let plan = Plan::new(axes, subjects, seeds, common).map_err(|e| Usage(e.to_string()))?;
    let starts = match (&args.folder, args.starts.is_empty()) {
        (Some(_), true) => FOLDER_STARTS_S.to_vec(),
        _ => args.starts.clone(),
    };
    let plan = plan.from_starts(starts);
    for setting in plan.settings() {
        with_overrides(&base, setting)?;
    }
    Ok(plan)
}

/// Truth of a file.
fn named_truth(file: &Path) -> Result<NamedTruth> {
    Ok(NamedTruth { path: file.to_owned(), poses: load_trajectory(file)? })
}

/// Data sets of a folder; what is left out is logged.
fn in_folder(path: &Path) -> Result<Vec<Subject>> {
    ensure!(path.is_dir(), Usage(format!("--folder {}: is not a directory", path.display())));
    let found = folder::data_sets(path).map_err(|e| Usage(e.to_string()))?;
    for (path, why) in &found.left_out {
        tracing::warn!("{}: left out, because {why}", path.display());
    }
    Ok(found.data_sets.into_iter().map(|path| Subject::Recorded { path }).collect())
}

/// Refuses a table of several settings: a row has one.
fn check_tables(args: &SweepArgs, settings: usize) -> Result<(), Usage> {
    match !args.tables.is_empty() && settings > 1 {
        true => Err(Usage(format!(
            "--table: has one setting, and --set makes {settings}; give one value of each key, or fly one table for each setting"
        ))),
        false => Ok(()),
    }
}

/// Subject of a flight that the argument `name` names.
pub(super) fn subject(name: &str, shared: Option<&Path>) -> Result<Subject> {
    let Some(flight) = simulated(name, shared)? else {
        let path = PathBuf::from(name);
        ensure!(path.exists(), Usage(format!("{name}: does not exist; give a data set, a log, or sim:room")));
        return Ok(Subject::Recorded { path });
    };
    ensure!(
        !flight.mono,
        Usage(format!(
            "{name}: `mono` is an option of `replay` and `doctor` here; leave it out, and give --mono where the command has it"
        ))
    );
    Ok(Subject::Simulated {
        name: name.to_owned(),
        scenario: Box::new(flight.options.scenario(flight.scene)?),
        extrinsics_error_deg: flight.options.extrinsics_error_deg,
        faults: flight.options.faults.fault.clone(),
    })
}

/// Flies one cell, unless it is there already.
fn fly_one(one: &Cell, folder: &Path, stop: &Arc<AtomicBool>) -> Result<()> {
    let path = one.path(folder);
    if one.kept(folder)?.is_some() {
        say(format_args!("{}: is there already", path.display()));
        return Ok(());
    }
    let result = one.fly(stop).context("stopped; the cell is not written")?;
    cell::keep(&result, folder)?;
    if let Some(error) = &result.error {
        bail!("cell {}: {error}", one.index);
    }
    say(format_args!("{}: written, {}", path.display(), outcome(&result)));
    Ok(())
}

/// Flies the cells that are not there yet.
fn fly_missing(cells: &[Cell], args: &SweepArgs, folder: &Path, stop: &Arc<AtomicBool>) -> Result<()> {
    let mut missing = Vec::new();
    for cell in cells {
        if cell.kept(folder)?.is_none() {
            missing.push(cell.clone());
        }
    }
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let jobs = args.jobs.map_or(cores, usize::from);
    let bar = progress_bar("cells", cells.len(), cells.len() - missing.len());
    let landed = |result: &CellResult| {
        bar.inc(1);
        let words = format!("cell {} ({} cells): {}", result.cell, result.of, outcome(result));
        if bar.is_hidden() { eprintln!("{words}") } else { bar.set_message(words) }
    };
    run::fly_all(&missing, folder, jobs, stop, &landed)?;
    bar.finish_and_clear();
    if stop.load(Ordering::Relaxed) {
        let there = cells.iter().filter(|cell| cell.path(folder).exists()).count();
        bail!(
            "stopped: {there} of {} cells are in {}; the same command flies the others",
            cells.len(),
            folder.display()
        );
    }
    Ok(())
}

/// The bar of a batch: how many of its `things` are done, and for how long.
pub(super) fn progress_bar(things: &str, of: usize, done: usize) -> ProgressBar {
    let bar = ProgressBar::new(of as u64).with_position(done as u64);
    let template = format!("{{bar:32}} {{pos}}/{{len}} {things}  {{msg}}  {{elapsed}} (eta {{eta}})");
    bar.with_style(ProgressStyle::with_template(&template).unwrap_or_else(|_| ProgressStyle::default_bar()))
}

/// Outcome of a cell, in a few words.
fn outcome(result: &CellResult) -> String {
    match (&result.figures, &result.error) {
        (_, Some(error)) => error.clone(),
        (None, None) => "nothing".into(),
        (Some(figures), None) => match figures.ate_rmse_m {
            Some(ate_m) => format!("ATE {ate_m:.4} m, digest {}", &figures.estimate_digest[..16]),
            None => {
                format!("completion {:.3}, digest {}", figures.completion, &figures.estimate_digest[..16])
            }
        },
    }
}

/// Writes all files, then prints the table, and says what is missing or failed: a closed pipe must not lose a file.
fn sum_up(results: &[CellResult], args: &SweepArgs) -> Result<()> {
    if let Some(path) = &args.out {
        std::fs::write(path, table::csv(results)).with_context(|| path.display().to_string())?;
    }
    let is_open = args.folder.is_some() || !args.tables.is_empty();
    let table = if is_open { write_tables(results, args)? } else { table::table(results) };
    let is_paired = args.paired || args.paired_json.is_some();
    let comparisons = is_paired.then(|| paired::with_first(&paired::variants(results)));
    if let Some(comparisons) = &comparisons {
        paired::write(comparisons, args.paired_json.as_deref())?;
    }
    say(table);
    if args.figures {
        say(format_args!("\n{}", side_by_side::table(results)));
    }
    comparisons.as_deref().map_or(Ok(()), paired::say_each)?;
    let of = results.first().map_or(0, |result| result.of);
    let missing: Vec<String> =
        (0..of).filter(|k| results.iter().all(|r| r.cell != *k)).map(|k| k.to_string()).collect();
    ensure!(missing.is_empty(), "{} of {of} cells are missing: {}", missing.len(), missing.join(","));
    let failed: Vec<&CellResult> = results.iter().filter(|result| result.error.is_some()).collect();
    if let Some(first) = failed.first() {
        bail!("{} of {of} cells could not be flown; cell {}: {}", failed.len(), first.cell, outcome(first));
    }
    Ok(())
}

/// Writes the open table to the files that are named; returns it as it is printed.
fn write_tables(results: &[CellResult], args: &SweepArgs) -> Result<String> {
    let settings = results.iter().filter(|result| result.setting != results[0].setting).count();
    check_tables(args, 1 + settings)?;
    let table = OpenTable::new(results);
    for path in &args.tables {
        let format = Format::of(path).unwrap_or(Format::Markdown);
        std::fs::write(path, table.text(format).trim_end().to_owned() + "\n")
            .with_context(|| path.display().to_string())?;
    }
    Ok(table.text(Format::Markdown))
}

#[cfg(test)]
mod tests {
    use super::*;
    use plumbline_simulator::FlightPath;

    #[test]
    fn seeds_are_a_list_or_a_range_with_both_ends() {
        assert_eq!(parse_seeds("1..3"), Ok(SeedList(vec![1, 2, 3])));
        assert_eq!(parse_seeds("7,2"), Ok(SeedList(vec![7, 2])));
        for bad in ["3..1", "x", "1,,2", "0..99999999", "1,1"] {
            assert!(parse_seeds(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn a_simulated_flight_takes_faults_and_built_in_paths() {
        let name = "sim:room?path=yaws&fault=stamp-jitter:2&fault=accel-pulse:x:30@6+0.1";
        let Ok(Subject::Simulated { scenario, faults, .. }) = subject(name, None) else {
            panic!("is a simulated flight")
        };
        assert_eq!(scenario.path, FlightPath::Yaws);
        assert_eq!(format!("{faults:?}"), "[stamp-jitter:2@0, accel-pulse:x:30@6+0.1]");
    }

    #[test]
    fn a_simulated_flight_takes_the_options_of_replay() {
        let Ok(Subject::Simulated { scenario, extrinsics_error_deg, .. }) =
            subject("sim:hall?duration=7.5&seed=3&motion-blur&blackout=2..3&extrinsics-error-deg=-1", None)
        else {
            panic!("is a simulated flight")
        };
        assert_eq!((scenario.duration_s, scenario.seed, extrinsics_error_deg), (7.5, 3, -1.0));
        assert_eq!(scenario.effects.blackout, Some((2.0, 3.0)));
        assert!(scenario.effects.exposure_s > 0.0);
        for (bad, named) in [
            ("sim:moon", "moon"),
            ("sim:room?durations=3", "--durations"),
            ("sim:room?duration=long", "long"),
            ("/nowhere/at/all", "/nowhere/at/all"),
        ] {
            let message = subject(bad, None).unwrap_err().to_string();
            assert!(message.contains(named) && !message.contains('\n'), "{message}");
        }
    }
}
