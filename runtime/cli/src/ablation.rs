//! `plumbline ablation`: what each part of the line path brings, as the two tables of the paper, and what loops bring
//! on top.

use super::choice::FlightChoice;
use super::{Usage, check_outputs, load_config, say, stop_on_signal};
use anyhow::{Context, Result, ensure};
use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};
use plumbline_config::ValidConfig;
use plumbline_drivers::BagTopics;
use plumbline_flight::flight::{RecordingKind, fly, open_recording, recording_kind, with_overrides};
use plumbline_flight::pipeline::{Control, RunOptions};
use plumbline_lab::campaign::{Entry, Setup};
use plumbline_lab::report::Report;
use serde::Serialize;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// What is compared: a name, and the changes of the configuration that make it.
const VARIANTS: [(&str, &[&str]); 4] = [
    ("points", &["estimator.lines.enabled=false", NO_PLACES]),
    ("+ raw segments", &["estimator.lines.length_filter=false", "estimator.lines.merge=false", NO_PLACES]),
    ("+ length filter", &["estimator.lines.length_filter=true", "estimator.lines.merge=false", NO_PLACES]),
    ("+ filter and merging", &["estimator.lines.length_filter=true", "estimator.lines.merge=true"]),
];
/// The odometry is the same without: only the last variant makes a map.
const NO_PLACES: &str = "estimator.places.enabled=false";
/// What the map of the last variant adds to its odometry.
const LOOPS: [&str; 2] = ["+ loops, as flown", "+ loops, at the end"];

/// Arguments of `plumbline ablation`.
#[derive(Debug, Args)]
pub struct AblationArgs {
    /// EuRoC data sets. Default: the built-in simulated flights.
    pub datasets: Vec<PathBuf>,
    /// Which of the built-in flights.
    #[command(flatten)]
    pub choice: FlightChoice,
    /// Laps of each built-in flight. Loops can be closed from the second lap on.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=100))]
    pub laps: u32,
    /// Use the left camera only.
    #[arg(long)]
    pub mono: bool,
    /// Configuration file or preset.
    #[arg(long)]
    pub config: Option<PathBuf>,
    /// Change a key of the estimator's configuration in all variants; may be repeated.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub overrides: Vec<String>,
    /// Cache rendered frames in this folder. Default: each variant renders them again.
    #[arg(long)]
    pub cache: Option<PathBuf>,
    /// Write all reports (JSON).
    #[arg(long, value_name = "OUT.json")]
    pub json: Option<PathBuf>,
}

/// One data set or simulated flight.
enum Subject {
    Recorded(PathBuf),
    Simulated(Box<Entry>),
}

impl Subject {
    fn name(&self) -> String {
        match self {
            Self::Recorded(path) => {
                path.file_name().map_or_else(|| path.display().to_string(), |n| n.to_string_lossy().into())
            }
            Self::Simulated(entry) => format!("{} {} {}", entry.path, entry.scene, entry.scenario.seed),
        }
    }

    fn fly(
        &self,
        args: &AblationArgs,
        config: Option<&ValidConfig>,
        overrides: &[String],
        stop: &Arc<AtomicBool>,
    ) -> Result<Report> {
        match self {
            Self::Recorded(path) => {
                let mut flight =
                    open_recording(path, config.cloned(), &BagTopics::default(), None, args.mono)?;
                let control = Control::stopped_by(Arc::clone(stop));
                flight.config = with_overrides(&flight.config, overrides)?;
                let options = RunOptions { speed: None, threads: 1 };
                Ok(Report::new(&fly(flight, &options, &control, vec![])?))
            }
            Self::Simulated(entry) => Ok(entry.fly_as(&Setup {
                config: config.cloned(),
                overrides: overrides.to_vec(),
                mono: args.mono,
                cache: args.cache.clone(),
                threads: 1,
            })?),
        }
    }
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
    check_outputs(&args.json)?;
    let config = load_config(args.config.as_deref())?;
    let subjects = subjects(args)?;
    let stop = stop_on_signal()?;
    let bar = ProgressBar::new((subjects.len() * VARIANTS.len()) as u64);
    let template = "{bar:32} {pos}/{len} flights  {msg}  {elapsed} (eta {eta})";
    bar.set_style(ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar()));
    let mut flown: Vec<Vec<Report>> = Vec::new();
    for subject in &subjects {
        let mut reports = Vec::new();
        for (variant, changes) in VARIANTS {
            ensure!(!stop.load(Ordering::Relaxed), "stopped");
            bar.set_message(format!("{}, {variant}", subject.name()));
            let overrides: Vec<String> =
                args.overrides.iter().cloned().chain(changes.iter().map(ToString::to_string)).collect();
            reports.push(subject.fly(args, config.as_ref(), &overrides, &stop).context(subject.name())?);
            ensure!(!stop.load(Ordering::Relaxed), "stopped");
            bar.inc(1);
        }
        flown.push(reports);
    }
    bar.finish_and_clear();
    let rows: Vec<Row<'_>> = subjects
        .iter()
        .zip(&flown)
        .map(|(subject, reports)| Row {
            flight: subject.name(),
            variants: VARIANTS.iter().map(|(name, _)| *name).zip(reports).collect(),
        })
        .collect();
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
    if let Some(file) = &args.json {
        std::fs::write(file, serde_json::to_string_pretty(&rows)?).context(file.display().to_string())?;
    }
    Ok(())
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
        return Ok(args.datasets.iter().cloned().map(Subject::Recorded).collect());
    }
    let mut entries = args.choice.entries(&[])?;
    for entry in &mut entries {
        entry.scenario.laps = args.laps;
    }
    Ok(entries.into_iter().map(|entry| Subject::Simulated(Box::new(entry))).collect())
}

/// Whether the errors of a flight are known.
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

/// ATE of every variant, and of the last with loops, m.
fn ates(row: &Row<'_>) -> Vec<Option<f64>> {
    let places = row.variants.last().and_then(|(_, report)| report.places.as_ref());
    let with_loops = [places.and_then(|p| p.ate_map_rmse_m), places.and_then(|p| p.ate_final_rmse_m)];
    row.variants.iter().map(|(_, report)| report.ate_rmse_m).chain(with_loops).collect()
}

/// The paper's table 2: ATE of each variant in metres, with the means and their change against points.
fn accuracy_table(rows: &[Row<'_>]) -> String {
    let names: Vec<&str> = VARIANTS.iter().map(|(name, _)| *name).chain(LOOPS).collect();
    let mut lines = vec![
        format!("| ATE RMSE m | {} |", names.join(" | ")),
        format!("|---{}|", "|---:".repeat(names.len())),
    ];
    let number = |ate: Option<f64>| ate.map_or_else(|| "-".to_owned(), |ate| format!("{ate:.4}"));
    for row in rows.iter().filter(|row| has_truth(row)) {
        let cells: Vec<String> = ates(row).into_iter().map(number).collect();
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
