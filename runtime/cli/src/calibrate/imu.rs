//! `plumbline calibrate imu`: noise densities and bias walks of a recording at rest.

use super::super::simulated::check_recorded;
use super::super::topics::TopicArgs;
use super::super::{Usage, load_config, say};
use super::output;
use anyhow::Result;
use clap::Args;
use plumbline_config::{Config, ValidConfig, import};
use plumbline_flight::flight::inertial_samples;
use plumbline_lab::calibrate::imu::{SHORTEST_REST_S, find, write_figure};
use plumbline_lab::plot;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

const EXAMPLES: &str = "Examples:
  plumbline calibrate imu rest.mcap --config my.toml --out my-imu.toml --plot allan.svg
  plumbline calibrate imu rest/mav0/imu0/data.csv --out my-imu.toml --inflate 10

Lay the vehicle on something solid, rotors off, and record two hours or more. The white noise needs one minute, the bias \
random walk about two hours. A value that cannot be determined keeps its value in the configuration.";

/// Arguments of `plumbline calibrate imu`.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct ImuArgs {
    /// A recording at rest: a EuRoC data set or its imu0/data.csv, a flight log or a ROS bag (.mcap, .db3, .bag).
    pub source: PathBuf,
    /// Configuration to write.
    #[arg(long, value_name = "OUT.toml")]
    pub out: PathBuf,
    /// Configuration file or preset for all other values. Default: the configuration of the log, or the preset
    /// `euroc` with the calibration of the data set, if it has one.
    #[arg(long, value_name = "FILE|PRESET")]
    pub config: Option<PathBuf>,
    /// Draw the Allan deviations (.svg or .png).
    #[arg(long, value_name = "OUT.svg|OUT.png")]
    pub plot: Option<PathBuf>,
    /// Factor for the white noise densities: a sensor is noisier in flight than at rest.
    #[arg(long, default_value_t = 1.0, value_name = "FACTOR")]
    pub inflate: f64,
    /// Topics of a bag.
    #[command(flatten)]
    pub topics: TopicArgs,
    /// Replace an existing file.
    #[arg(long)]
    pub overwrite: bool,
}

/// Runs the command.
pub(super) fn run(args: &ImuArgs) -> Result<()> {
    output::check(&args.out, args.overwrite, &args.plot.iter().collect::<Vec<_>>())?;
    if !(args.inflate.is_finite() && args.inflate > 0.0) {
        return Err(Usage("--inflate: give a positive number, such as 10".into()).into());
    }
    if let Some(path) = &args.plot {
        plot::check_name(path).map_err(|e| Usage(format!("--plot: {e}")))?;
    }
    check_recorded(&args.source)?;
    let named = load_config(args.config.as_deref())?;
    let (samples, own) = inertial_samples(&args.source, &args.topics.names()?)?;
    let base = match named.or(own) {
        Some(config) => config,
        None => base_of(&args.source)?,
    };
    let name = args.source.display();
    let found = find(&samples).ok_or_else(|| {
        anyhow::anyhow!("{name}: holds {} inertial samples: record a minute or more", samples.len())
    })?;
    let rest = &found.rest;
    say(format_args!(
        "{name}: {:.1} s at {:.1} Hz, at rest from {:.1} s on for {:.1} s",
        rest.recording_s,
        1.0 / rest.dt_s,
        rest.begin_s,
        rest.length_s
    ));
    let remarks = found.remarks(base.imu.gravity_m_s2);
    if rest.length_s >= SHORTEST_REST_S {
        found.table().iter().for_each(say);
    }
    remarks.iter().for_each(|remark| tracing::warn!("{remark}"));
    let mut written = Vec::new();
    let config =
        base.with("calibrate imu", |config| written = found.write_into(&mut config.imu, args.inflate))?;
    anyhow::ensure!(
        written.len() > 1,
        "{name}: no noise could be estimated, so nothing is written; check that the recording is at rest"
    );
    if let Some(path) = &args.plot {
        write_figure(&found, &name.to_string(), path)?;
    }
    output::write(&args.out, &comment(args, &written, &remarks), &config)
}

/// Without a configuration: that of the data set, or the preset.
fn base_of(source: &Path) -> Result<ValidConfig> {
    let preset = Config::preset("euroc")?;
    if !source.is_dir() {
        return Ok(preset);
    }
    Ok(import::euroc_into(preset.clone(), source).unwrap_or(preset))
}

fn comment(args: &ImuArgs, written: &[&str], remarks: &[String]) -> String {
    let mut text = format!("# Made by `plumbline calibrate imu` of {}.\n", args.source.display());
    let _ = writeln!(
        text,
        "# Measured: imu.{}; white noise times {}. All else is of {}.",
        written.join(", imu."),
        args.inflate,
        args.config.as_ref().map_or("the recording or the preset euroc".into(), |c| c.display().to_string())
    );
    for remark in remarks {
        let _ = writeln!(text, "# Beware: {remark}.");
    }
    text
}
