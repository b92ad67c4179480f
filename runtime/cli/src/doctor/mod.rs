//! `plumbline doctor`: whether this host, this configuration and these sensors are fit for a flight.
//!
//! Without a source it looks at the host ([`host`]) and at what else a flight needs ([`certificates`], [`disk`], [`autopilot`]);
//! with one, or live, at what the sensors deliver ([`data`]), which is judged by the crate `plumbline-checkup`.

mod autopilot;
mod certificates;
mod data;
mod disk;
mod host;

use super::topics::TopicArgs;
use super::{Usage, load_config, say};
use anyhow::{Result, bail};
use clap::Args;
use plumbline_checkup::{Fitness, Measure};
use plumbline_config::Config;
use plumbline_flight::flight::with_overrides;
use plumbline_flight::schedule::tasks::TaskTable;
use serde_json::json;
use std::path::PathBuf;
use std::time::{Duration, SystemTime};

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

/// Verdict of a check of the host or its equipment, and what was found.
type Verdict = (Fitness, String);
/// A check by its name.
type Check = (&'static str, Verdict);

/// Arguments of `plumbline doctor`.
#[derive(Debug, Default, Args)]
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
    /// Seconds of data to check, from the start of a recording. Default: 30.
    #[arg(long, value_name = "N")]
    pub seconds: Option<f64>,
    /// Topics of a bag.
    #[command(flatten)]
    pub topics: TopicArgs,
    /// Print JSON.
    #[arg(long)]
    pub json: bool,
}

/// Runs the command: a line for each check.
///
/// # Errors
/// When the configuration is refused, the source cannot be used, or what it holds is not fit to fly.
pub fn run(args: &DoctorArgs) -> Result<()> {
    let seconds = args.seconds.unwrap_or(SECONDS);
    for (option, length_s) in [("--watch", args.watch), ("--seconds", seconds)] {
        if !(length_s > 0.0 && length_s <= MAX_SECONDS) {
            return Err(Usage(format!("{option}: give up to {MAX_SECONDS:.0} seconds")).into());
        }
    }
    let config = load_config(args.config.as_deref())?;
    if let Some(source) = &args.source {
        let mut flight = data::open(source, config, &args.topics.names()?, seconds)?;
        flight.config = with_overrides(&flight.config, &args.overrides)?;
        let sensors = Some((flight.name.clone(), data::examine(flight, None)?));
        return Report { host: None, sensors }.tell(args.json);
    }
    if args.seconds.is_some() && !args.live {
        return Err(Usage("--seconds: name a source to check, or give --live".into()).into());
    }
    let config = config.map_or_else(|| Config::preset("sim"), Ok)?;
    let config = with_overrides(&config, &args.overrides)?;
    // Opened first: what is wrong with the configuration of the sensors is told at once.
    let streams = args.live.then(|| data::open_live(&config, seconds)).transpose()?;
    let sensors = streams.map(|(flight, live)| data::examine(flight, Some(live))).transpose()?;
    let table = TaskTable::new(&config, 1.0);
    let mut checks = host::checks(&config, &table, Duration::from_secs_f64(args.watch));
    checks.push(("certificates", certificates::check(&config.network.tls, SystemTime::now())));
    checks.extend(args.record.as_ref().map(|folder| ("disk", disk::check(&config, folder))));
    checks.push(("autopilot", autopilot::check(&config.autopilot)));
    let checks =
        checks.into_iter().map(|(name, (verdict, words))| Measure::new(name, verdict, words, "", &[]));
    let sensors = sensors.map(|measures| ("the configured sensors".to_owned(), measures));
    Report { host: Some((checks.collect(), table)), sensors }.tell(args.json)
}

/// What was looked at.
struct Report {
    /// The host, with the tasks of a flight.
    host: Option<(Vec<Measure>, TaskTable)>,
    /// Sensors with the name of their source.
    sensors: Option<(String, Vec<Measure>)>,
}

fn names(measures: &[&Measure]) -> String {
    measures.iter().map(|measure| measure.title()).collect::<Vec<_>>().join(", ")
}

impl Report {
    /// The measures of the host or of the sensors of which this holds.
    fn those(&self, wanted: impl Fn(&Measure) -> bool) -> Vec<&Measure> {
        let host = self.host.iter().flat_map(|(checks, _)| checks);
        host.chain(self.sensors.iter().flat_map(|(_, measures)| measures)).filter(|m| wanted(m)).collect()
    }

    /// Prints everything, and fails where a flight is not to be begun.
    fn tell(&self, is_json: bool) -> Result<()> {
        let of = |verdict: Fitness| self.those(|measure| measure.verdict == verdict);
        let (against, missing) = (of(Fitness::NotFit), self.those(Measure::is_missing));
        let aside = [
            self.host.is_none().then_some("this host (`plumbline doctor --config`)"),
            self.sensors.is_none().then_some("the sensors (--live)"),
        ];
        let aside: Vec<&str> = aside.into_iter().flatten().collect();
        if is_json {
            let mut json = json!({
                "fit": against.is_empty() && missing.is_empty(),
                "not_looked_at": aside,
                "not_shown": missing.iter().map(|measure| measure.name).collect::<Vec<_>>(),
            });
            if let Some((checks, _)) = &self.host {
                json["host"] = json!(checks);
            }
            if let Some((name, measures)) = &self.sensors {
                (json["source"], json["measures"]) = (json!(name), json!(measures));
            }
            say(serde_json::to_string_pretty(&json)?);
        } else {
            if let Some((checks, table)) = &self.host {
                lines("this host", checks).into_iter().for_each(say);
                say(format_args!("\nTasks of a flight at these rates:\n{table}"));
            }
            if let Some((name, measures)) = &self.sensors {
                lines(name, measures).into_iter().for_each(say);
            }
        }
        if !against.is_empty() {
            bail!("not fit to fly: {}", names(&against));
        }
        if !missing.is_empty() {
            return Err(NotShown::of(&missing).into());
        }
        if !is_json {
            let what = match (&self.host, &self.sensors) {
                (Some(_), Some(_)) => "Fit to fly",
                (Some(_), None) => "This host is fit to fly",
                (None, _) => "The sensors are fit to fly",
            };
            let mend = match names(&of(Fitness::Mind)) {
                names if names.is_empty() => names,
                names => format!(", with these to mend: {names}"),
            };
            let aside = aside.join(", ");
            let aside = if aside.is_empty() { aside } else { format!(" Not looked at: {aside}.") };
            say(format_args!("\n{what}{mend}.{aside}"));
        }
        Ok(())
    }
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
        Self { names: names(missing), motions: motions.join("; ") }
    }
}

/// A line for each measure, and its cure below it; one for all that were not measured for one reason.
fn lines(name: &str, measures: &[Measure]) -> Vec<String> {
    let mut lines = vec![format!("{name}:")];
    let mut told = Vec::new();
    for measure in measures {
        let Measure { name, verdict, value, cure, .. } = measure;
        if told.contains(name) {
            continue;
        }
        let is_alike = |m: &&Measure| (m.verdict, &m.value, &m.cure) == (Fitness::NotMeasured, value, cure);
        let alike: Vec<&str> = measures.iter().filter(is_alike).map(|m| m.name).collect();
        match alike.len() {
            0 | 1 => lines.push(format!("{verdict:<13} {name:<31} {value}")),
            _ => {
                lines.push(format!("{verdict:<13} {}", alike.join(", ")));
                lines.push(format!("{:<13} {:<31} {value}", "", ""));
            }
        }
        if !cure.is_empty() {
            lines.push(format!("{:<13} {:<31} -> {cure}", "", ""));
        }
        told.extend(alike);
    }
    lines
}
