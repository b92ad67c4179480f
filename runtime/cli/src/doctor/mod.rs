//! `plumbline doctor`: whether this host, this configuration and these sensors are fit for a flight.
//!
//! Without a source it looks at the host ([`host`]) and at what else a flight needs ([`certificates`], [`disk`], [`autopilot`]);
//! with one, or live, at what the sensors deliver ([`data`]), which is judged by the crate `plumbline-checkup`.

mod autopilot;
mod certificates;
mod data;
mod disk;
mod host;
mod verdict;

use super::topics::TopicArgs;
use super::{Usage, load_config, say};
use anyhow::{Result, bail};
use clap::Args;
use plumbline_checkup::{CheckupReport, Fitness, Measure, NAMED_ABOVE};
use plumbline_config::Config;
use plumbline_flight::flight::with_overrides;
use plumbline_flight::schedule::tasks::TaskTable;
use serde_json::{Value, json};
use std::path::PathBuf;
use std::time::{Duration, SystemTime};
use verdict::Check;

const EXAMPLES: &str = "Examples:
  plumbline doctor --config my.toml             check the host: priorities, memory, timer; certificates; autopilot
  plumbline doctor --config my.toml --record /data
                                                also check the disk for recordings
  plumbline doctor --config my.toml --live      also check the configured sensors, for half a minute
  plumbline doctor V1_01_easy                   check the sensor data of a recording
  plumbline doctor log.mcap --json              check a flight log, print JSON

To measure the mounting of the IMU, let the vehicle stand level for three seconds, lift its nose by 30 degrees, and put it down \
again. Then turn it by hand about all axes in front of a textured scene. Gravity and biases are measured at rest, time offset and \
rotation between camera and IMU in motion, vibration with running motors. \
Exit status 1: something is not fit for a flight. Exit status 4: the data do not show everything that a flight needs.";

/// Seconds of data that are looked at without `--seconds`.
const SECONDS: f64 = 30.0;
/// Longest time that may be asked for.
const MAX_SECONDS: f64 = 3600.0;

/// Arguments of `plumbline doctor`.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct DoctorArgs {
    /// Check the data of a EuRoC data set, a flight log, a ROS bag (with --config) or a simulated flight (sim:room?duration=10)
    /// instead of this host.
    pub source: Option<String>,
    /// Configuration file or preset. Default: the calibration of the source; for the host, the preset `sim`.
    #[arg(long)]
    pub config: Option<PathBuf>,
    /// Change a key of the configuration, such as runtime.tick_cpus=[0]; may be repeated.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub overrides: Vec<String>,
    /// Check the data of the configured sensors, in addition to this host.
    #[arg(long, requires = "config", conflicts_with = "source")]
    pub live: bool,
    /// Recording folder. The check covers its free space and its speed.
    #[arg(long, value_name = "FOLDER", conflicts_with = "source")]
    pub record: Option<PathBuf>,
    /// Duration of the check of the host's timer, seconds.
    #[arg(long, default_value_t = 2.0)]
    pub watch: f64,
    /// Duration of the data to check, seconds. Default: 30.
    #[arg(long, value_name = "N")]
    pub seconds: Option<f64>,
    /// Topics of a bag.
    #[command(flatten)]
    pub topics: TopicArgs,
    /// Print JSON.
    #[arg(long)]
    pub json: bool,
}

impl DoctorArgs {
    /// Checks of this host and of the sensors of a configuration, with every option as by default.
    #[must_use]
    pub fn live(config: PathBuf) -> Self {
        Self {
            source: None,
            config: Some(config),
            overrides: Vec::new(),
            live: true,
            record: None,
            watch: 2.0,
            seconds: None,
            topics: TopicArgs::default(),
            json: false,
        }
    }
}

/// Runs the command: a line for each check.
///
/// # Errors
/// When the configuration is refused, the source cannot be used, or what it holds is not fit to fly.
pub fn run(args: &DoctorArgs) -> Result<()> {
    let is_length = |seconds: f64| seconds > 0.0 && seconds <= MAX_SECONDS;
    if !is_length(args.watch) {
        return Err(Usage("--watch: give up to 3600 seconds".into()).into());
    }
    let seconds = args.seconds.unwrap_or(SECONDS);
    if !is_length(seconds) {
        return Err(Usage("--seconds: give up to 3600 seconds".into()).into());
    }
    let config = load_config(args.config.as_deref())?;
    if let Some(source) = &args.source {
        let mut flight = data::open(source, config, &args.topics.names()?, seconds)?;
        flight.config = with_overrides(&flight.config, &args.overrides)?;
        return tell(args, None, Some((flight.name.clone(), data::examine(flight.into())?)));
    }
    if args.seconds.is_some() && !args.live {
        return Err(Usage("--seconds: name a source to check, or give --live".into()).into());
    }
    let config = config.map_or_else(|| Config::preset("sim"), Ok)?;
    let config = with_overrides(&config, &args.overrides)?;
    // Opened first: what is wrong with the configuration of the sensors is told at once.
    let streams = args.live.then(|| data::open_live(&config, seconds)).transpose()?;
    let report = streams.map(data::examine).transpose()?;
    let table = TaskTable::new(&config, 1.0);
    let mut checks = host::checks(&config, &table, Duration::from_secs_f64(args.watch));
    checks.push(("certificates", certificates::check(&config.network.tls, SystemTime::now())));
    checks.extend(args.record.as_ref().map(|folder| ("disk", disk::check(&config, folder))));
    checks.push(("autopilot", autopilot::check(&config.autopilot)));
    tell(args, Some((checks, table)), report.map(|report| ("the configured sensors".to_owned(), report)))
}

/// Lines of the findings about the host, and about the sensors of a source.
fn tell(
    args: &DoctorArgs,
    host: Option<(Vec<Check>, TaskTable)>,
    sensors: Option<(String, CheckupReport)>,
) -> Result<()> {
    if args.json {
        say(serde_json::to_string_pretty(&as_json(host.as_ref(), sensors.as_ref()))?);
    } else {
        host.iter().for_each(|(checks, table)| print_host(checks, table));
        sensors.iter().for_each(|(name, report)| print(name, report));
    }
    let (checks, measures) = (all_checks(host.as_ref()), all_measures(sensors.as_ref()));
    let checks_against = checks.iter().filter(|(_, verdict)| verdict.is_not_fit()).map(|(name, _)| *name);
    let measures_against = measures.iter().filter(|m| m.verdict == Fitness::NotFit).map(|m| m.name);
    let against: Vec<&str> = checks_against.chain(measures_against).collect();
    if !against.is_empty() {
        bail!("not fit to fly: {}", against.join(", "));
    }
    let missing: Vec<&Measure> = sensors.iter().flat_map(|(_, report)| report.missing()).collect();
    if !missing.is_empty() {
        return Err(NotShown::of(&missing).into());
    }
    if !args.json {
        let poor = checks.iter().filter(|(_, verdict)| verdict.is_poor()).map(|(name, _)| *name);
        let to_mind = measures.iter().filter(|m| m.verdict == Fitness::Mind).map(|m| m.name);
        let to_mend: Vec<&str> = poor.chain(to_mind).collect();
        say(format_args!("\n{}", fit(&to_mend, host.is_some(), sensors.as_ref())));
    }
    Ok(())
}

/// Data that do not show everything that a flight needs.
#[derive(Debug, thiserror::Error)]
#[error("not shown: {names}; fly this: {motions}")]
pub struct NotShown {
    names: String,
    motions: String,
}

impl NotShown {
    fn of(missing: &[&Measure]) -> Self {
        let mut motions: Vec<&str> = missing.iter().filter_map(|measure| measure.motion).collect();
        motions.dedup();
        let names: Vec<&str> = missing.iter().map(|measure| measure.name).collect();
        Self { names: names.join(", "), motions: motions.join("; ") }
    }
}

fn all_checks(host: Option<&(Vec<Check>, TaskTable)>) -> &[Check] {
    host.map_or(&[], |(checks, _)| checks)
}

fn all_measures(sensors: Option<&(String, CheckupReport)>) -> &[Measure] {
    sensors.map_or(&[], |(_, report)| &report.measures)
}

/// The verdict, of what was looked at alone, and what was not.
fn fit(to_mend: &[&str], has_host: bool, sensors: Option<&(String, CheckupReport)>) -> String {
    let what = match (has_host, sensors) {
        (true, Some(_)) => "Fit to fly",
        (true, None) => "This host is fit to fly",
        (false, _) => "The sensors are fit to fly",
    };
    let mend = match to_mend {
        [] => String::new(),
        [one] => format!(", with one thing to mend ({one})"),
        several => format!(", with {} things to mend ({})", several.len(), several.join(", ")),
    };
    let aside = left_aside(has_host, sensors).join(", ");
    let aside = if aside.is_empty() { String::new() } else { format!(" Not looked at: {aside}.") };
    format!("{what}{mend}.{aside}")
}

/// Subjects that were not to be looked at.
fn left_aside(has_host: bool, sensors: Option<&(String, CheckupReport)>) -> Vec<&'static str> {
    let host = (!has_host).then_some("this host (`plumbline doctor --config`)");
    host.into_iter().chain(sensors.is_none().then_some("the sensors (--live)")).collect()
}

fn print_host(checks: &[Check], table: &TaskTable) {
    for (name, verdict) in checks {
        let (mark, words) = verdict.told();
        say(format_args!("{mark:<7}  {name:<19} {words}"));
    }
    say(format_args!("\nTasks of a flight at these rates:\n{table}"));
}

/// A line for each measure, and its cure below it; one for all that something else makes worthless.
fn print(name: &str, report: &CheckupReport) {
    lines(name, report).into_iter().for_each(say);
}

fn lines(name: &str, report: &CheckupReport) -> Vec<String> {
    let mut lines = vec![format!("{name}:")];
    let (worthless, judged): (Vec<&Measure>, Vec<&Measure>) =
        report.measures.iter().partition(|measure| measure.cure == NAMED_ABOVE);
    let mut told = Vec::new();
    for measure in &judged {
        let has_reason_of = |other: &&&Measure| {
            measure.verdict == Fitness::NotMeasured
                && (other.verdict, &other.value, &other.cure)
                    == (measure.verdict, &measure.value, &measure.cure)
        };
        // What was not measured for one reason is told once.
        let alike: Vec<&str> = judged.iter().filter(has_reason_of).map(|other| other.name).collect();
        if told.contains(&measure.name) {
            continue;
        }
        if let [_, others @ .., last] = alike.as_slice() {
            lines.push(format!("{:<13} {}", measure.verdict, alike.join(", ")));
            lines.push(format!("{:<13} {:<31} {}", "", "", measure.value));
            told.extend(others.iter().chain([last]));
        } else {
            lines.push(format!("{:<13} {:<31} {}", measure.verdict, measure.name, measure.value));
        }
        if !measure.cure.is_empty() {
            lines.push(format!("{:<13} {:<31} -> {}", "", "", measure.cure));
        }
    }
    if !worthless.is_empty() {
        let names: Vec<&str> = worthless.iter().map(|measure| measure.name).collect();
        lines.push(format!("{:<13} {}", Fitness::NotMeasured, names.join(", ")));
        lines.push(format!("{:<13} {:<31} -> {NAMED_ABOVE}", "", ""));
    }
    lines
}

fn as_json(host: Option<&(Vec<Check>, TaskTable)>, sensors: Option<&(String, CheckupReport)>) -> Value {
    let is_host_fit = !all_checks(host).iter().any(|(_, verdict)| verdict.is_not_fit());
    let mut all = json!({
        "fit": is_host_fit && sensors.is_none_or(|(_, report)| report.is_fit() && report.missing().next().is_none()),
        "not_looked_at": left_aside(host.is_some(), sensors),
        "not_shown": sensors.iter().flat_map(|(_, report)| report.missing()).map(|m| m.name).collect::<Vec<_>>(),
    });
    if let Some((checks, _)) = host {
        let checks = checks.iter().map(|(name, verdict)| {
            let (mark, words) = verdict.told();
            json!({"name": name, "verdict": mark, "value": words})
        });
        all["host"] = checks.collect();
    }
    if let Some((name, report)) = sensors {
        all["source"] = json!(name);
        all["measures"] = report.measures.iter().map(measure_json).collect();
    }
    all
}

fn measure_json(measure: &Measure) -> Value {
    let figures: serde_json::Map<String, Value> =
        measure.figures.iter().map(|(name, value)| ((*name).to_owned(), json!(value))).collect();
    json!({
        "name": measure.name,
        "verdict": measure.verdict.to_string(),
        "value": measure.value,
        "cure": measure.cure,
        "figures": figures,
    })
}
