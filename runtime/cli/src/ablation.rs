//! `plumbline ablation`: what each part of the line path brings, as the two tables of the paper, and on top of it what loops and the
//! knowledge of the end of the flight bring.

use super::choice::{FlightChoice, TrialArgs};
use super::sweep::progress_bar;
use super::topics::TopicArgs;
use super::{Usage, check_outputs, load_config, say, stop_on_signal, sweep};
use anyhow::{Context, Result, ensure};
use clap::Args;
use plumbline_flight::flight::{RecordingKind, recording_kind};
use plumbline_lab::campaign::Entry;
use plumbline_lab::report::Report;
use plumbline_lab::sweep::{Common, Plan, Subject};
use plumbline_simulator::Scenario;
use serde::Serialize;
use std::path::PathBuf;
use std::sync::atomic::Ordering;

/// Variants compared: a name, and the changes of the configuration that make it.
const VARIANTS: [(&str, &[&str]); 4] = [
    ("points", &["estimator.lines.enabled=false", NO_PLACES]),
    ("+ raw segments", &["estimator.lines.length_filter=false", "estimator.lines.merge=false", NO_PLACES]),
    ("+ length filter", &["estimator.lines.length_filter=true", "estimator.lines.merge=false", NO_PLACES]),
    ("+ filter and merging", &["estimator.lines.length_filter=true", "estimator.lines.merge=true"]),
];
/// The odometry is the same without: only the last variant makes a map.
const NO_PLACES: &str = "estimator.places.enabled=false";
/// Contribution of the last variant's map to its odometry. A pose as known at the end uses later images too, loops or not.
const LOOPS: [&str; 2] = ["+ loops, as flown", "as known at the end"];

/// Arguments of `plumbline ablation`.
#[derive(Debug, Args)]
pub struct AblationArgs {
    /// EuRoC data sets, ROS bags (with --config), or simulated flights (sim:room?path=demo&duration=10). Default: the built-in simulated flights.
    pub datasets: Vec<PathBuf>,
    /// Which of the built-in flights.
    #[command(flatten)]
    pub choice: FlightChoice,
    /// Laps of each built-in flight. Loops can be closed from the second lap on.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=100))]
    pub laps: u32,
    /// Topics of bags.
    #[command(flatten)]
    pub topics: TopicArgs,
    /// Flight, and what is kept of it.
    #[command(flatten)]
    pub trial: TrialArgs,
}

/// Name of a flight in the tables.
fn name(subject: &Subject) -> String {
    let file_name = match subject {
        Subject::Recorded { path } => path.file_name(),
        Subject::Simulated { .. } => None,
    };
    file_name.map_or_else(|| subject.name(), |name| name.to_string_lossy().into())
}

#[derive(Serialize)]
struct Row<'a> {
    flight: String,
    variants: Vec<(&'a str, &'a Report)>,
}

/// Runs the command.
///
/// # Errors
/// When a flight cannot be opened or simulated.
pub fn run(args: &AblationArgs) -> Result<()> {
    check_outputs(&args.trial.json)?;
    let subjects = subjects(args)?;
    let names: Vec<String> = subjects.iter().map(name).collect();
    let flown = fly_all(args, subjects)?;
    let rows = names.into_iter().enumerate().map(|(k, flight)| {
        let reports = flown.iter().skip(k).step_by(flown.len() / VARIANTS.len());
        Row { flight, variants: VARIANTS.iter().map(|(name, _)| *name).zip(reports).collect() }
    });
    let rows: Vec<Row<'_>> = rows.collect();
    say(extraction_table(&rows));
    if rows.iter().any(has_truth) {
        say(format_args!("\n{}", accuracy_table(&rows)));
    }
    let unknown: Vec<&str> =
        rows.iter().filter(|row| !has_truth(row)).map(|row| row.flight.as_str()).collect();
    if !unknown.is_empty() {
        say(format_args!(
            "\nWithout ground truth there is no error to compare: {} (only times and numbers of segments are known).",
            unknown.join(", ")
        ));
    }
    if let Some(file) = &args.trial.json {
        std::fs::write(file, serde_json::to_string_pretty(&rows)?).context(file.display().to_string())?;
    }
    Ok(())
}

/// Reports of all flights in the first variant, then of all in the second, and so on.
fn fly_all(args: &AblationArgs, subjects: Vec<Subject>) -> Result<Vec<Report>> {
    let setting = |(_, changes): &(_, &[&str])| {
        args.trial.overrides.iter().cloned().chain(changes.iter().map(ToString::to_string)).collect()
    };
    let config = load_config(args.trial.config.as_deref())?;
    let topics = args.topics.names()?;
    let common =
        Common { config, truth: None, topics, mono: args.trial.mono, cache: args.trial.cache.clone() };
    let cells = Plan::of_settings(VARIANTS.iter().map(setting).collect(), subjects, common).cells();
    let stop = stop_on_signal()?;
    let bar = progress_bar("flights", cells.len(), 0);
    let mut reports = Vec::new();
    for cell in &cells {
        let (variant, _) = VARIANTS[cell.index * VARIANTS.len() / cells.len()];
        bar.set_message(format!("{}, {variant}", name(&cell.subject)));
        let report = cell.report(&stop);
        ensure!(!stop.load(Ordering::Relaxed), "stopped");
        reports.push(report.with_context(|| name(&cell.subject))?);
        bar.inc(1);
    }
    bar.finish_and_clear();
    Ok(reports)
}

fn subjects(args: &AblationArgs) -> Result<Vec<Subject>> {
    if let Some(log) = args.datasets.iter().find(|path| recording_kind(path) == RecordingKind::Log) {
        let message = format!(
            "{}: is a flight log; give the data set that it was recorded from, since each variant needs its images",
            log.display()
        );
        return Err(Usage(message).into());
    }
    if !args.datasets.is_empty() {
        let subject = |path: &PathBuf| sweep::subject(&path.to_string_lossy(), None);
        return args.datasets.iter().map(subject).collect();
    }
    let simulated = |entry: Entry| Subject::Simulated {
        name: format!("{} {} {}", entry.path, entry.scene, entry.scenario.seed),
        scenario: Box::new(Scenario { laps: args.laps, ..entry.scenario }),
        extrinsics_error_deg: 0.0,
        faults: Vec::new(),
    };
    Ok(args.choice.entries(&[])?.into_iter().map(simulated).collect())
}

/// True if the errors of a flight are known.
fn has_truth(row: &Row<'_>) -> bool {
    row.variants.iter().any(|(_, report)| report.ate_rmse_m.is_some())
}

/// The paper's table 1: number of segments in the left image, and times a frame over all cameras.
fn extraction_table(rows: &[Row<'_>]) -> String {
    let mut lines = vec![
        "| flight | variant | segments | extraction ms | description ms | matching ms | sum ms |".to_owned(),
        "|---|---|---:|---:|---:|---:|---:|".to_owned(),
    ];
    for row in rows {
        for (variant, report) in row.variants.iter().skip(1) {
            let ms = |stage: &str| report.stage_ms.get(stage).map_or(0.0, |p| p.p50);
            let parts = [ms("lines_extract"), ms("lines_describe"), ms("lines_match")];
            lines.push(format!(
                "| {} | {variant} | {:.0} | {:.2} | {:.2} | {:.2} | {:.2} |",
                row.flight,
                report.lines.merged,
                parts[0],
                parts[1],
                parts[2],
                parts.iter().sum::<f64>()
            ));
        }
    }
    lines.join("\n")
}

/// ATE of every variant, and of the last with loops, m; without a loop its map adds nothing.
fn ates(row: &Row<'_>) -> Vec<Option<f64>> {
    let places = row.variants.last().and_then(|(_, report)| report.places.as_ref());
    let places = places.filter(|places| places.loops_used > 0);
    let with_loops = [places.and_then(|p| p.ate_map_rmse_m), places.and_then(|p| p.ate_final_rmse_m)];
    row.variants.iter().map(|(_, report)| report.ate_rmse_m).chain(with_loops).collect()
}

/// The paper's table 2: ATE of each variant in metres, with the means and their change against points.
fn accuracy_table(rows: &[Row<'_>]) -> String {
    let has_loops = rows.iter().any(|row| ates(row)[VARIANTS.len()..].iter().any(Option::is_some));
    let loops = LOOPS.into_iter().filter(|_| has_loops);
    let names: Vec<&str> = VARIANTS.iter().map(|(name, _)| *name).chain(loops).collect();
    let mut lines = vec![
        format!("| ATE RMSE m | {} |", names.join(" | ")),
        format!("|---{}|", "|---:".repeat(names.len())),
    ];
    let number = |ate: Option<f64>| ate.map_or_else(|| "-".to_owned(), |ate| format!("{ate:.4}"));
    for row in rows.iter().filter(|row| has_truth(row)) {
        let cells: Vec<String> = ates(row).into_iter().take(names.len()).map(number).collect();
        lines.push(format!("| {} | {} |", row.flight, cells.join(" | ")));
    }
    let means: Vec<Option<f64>> = (0..names.len())
        .map(|k| {
            let ates: Vec<f64> = rows.iter().filter_map(|row| ates(row)[k]).collect();
            (!ates.is_empty()).then(|| ates.iter().sum::<f64>() / ates.len() as f64)
        })
        .collect();
    let with_change = |mean: &Option<f64>| match (mean, means[0]) {
        (Some(mean), Some(points)) => format!("{mean:.4} ({:+.0} %)", 100.0 * (mean / points - 1.0)),
        _ => "-".to_owned(),
    };
    lines.push(format!("| mean | {} |", means.iter().map(with_change).collect::<Vec<_>>().join(" | ")));
    lines.join("\n")
}
