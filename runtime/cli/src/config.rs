//! `plumbline config`: check a configuration, print a preset, or make a configuration of calibration files.

mod import;

use super::{Usage, check_new, say};
use anyhow::{Context as _, Result};
use clap::{Args, Subcommand};
use plumbline_config::options::Mounting;
use plumbline_config::{Config, PRESETS, every_key, preset_text};
use plumbline_record::digest::config_hash;
use std::path::{Path, PathBuf};

const EXAMPLES: &str = "Examples:
  plumbline config euroc > my.toml         print a preset with a comment at every key
  plumbline config defaults                every key with its default, range and explanation
  plumbline config realsense-d455          print the preset of a real rig (docs/rigs)
  plumbline config my.toml                 check a configuration
  plumbline config my.toml --merged        what a flight uses of it, its base and the defaults
  plumbline config euroc --out my.toml     the same, into a file
  plumbline config import --camchain camchain.yaml --imu imu.yaml --inflate 10 --imu-to-vehicle unknown --out my.toml";

/// Arguments of `plumbline config`.
#[derive(Debug, Args)]
#[command(args_conflicts_with_subcommands = true, after_help = EXAMPLES)]
pub struct ConfigArgs {
    #[command(subcommand)]
    command: Option<ConfigCommand>,
    #[arg(required = true, help = file_help())]
    file: Option<String>,
    /// Print the values that a flight with this file uses: every key, from the file, its base or the defaults.
    #[arg(long)]
    merged: bool,
    /// Print every key, also those for experiments, which no flight needs changed.
    #[arg(long)]
    all: bool,
    /// Write what is printed of a preset, or by --merged, to this file.
    #[arg(long, value_name = "OUT.toml")]
    out: Option<PathBuf>,
    /// Replace an existing file.
    #[arg(long, requires = "out")]
    overwrite: bool,
}

/// Word for the defaults, in the place of a preset.
const DEFAULTS: &str = "defaults";

/// Names every preset that there is.
fn file_help() -> String {
    format!(
        "A configuration file to check, or what to print: {DEFAULTS} (every key with its default), or a preset: {}",
        PRESETS.join(", ")
    )
}

#[derive(Debug, Subcommand)]
enum ConfigCommand {
    /// Make a configuration from a calibration by Kalibr or a EuRoC data set.
    Import(import::ImportArgs),
}

/// Three angles, or the word for a mounting that is not known.
pub fn parse_mounting(text: &str) -> Result<Mounting, String> {
    if text == Mounting::UNKNOWN {
        return Ok(Mounting::Unknown);
    }
    let angles: Vec<f64> = text.split(',').filter_map(|angle| angle.trim().parse().ok()).collect();
    match (angles.try_into(), text.matches(',').count()) {
        (Ok(degrees), 2) => Ok(Mounting::Known(degrees)),
        _ => Err("write three angles in degrees, such as 180,0,0, or unknown".into()),
    }
}

/// Runs the command.
///
/// # Errors
/// When a file cannot be used, or the configuration cannot be written.
pub fn run(args: &ConfigArgs) -> Result<()> {
    match (&args.command, &args.file) {
        (Some(ConfigCommand::Import(args)), _) => import::run(args),
        (None, Some(file)) => check(file, args),
        (None, None) => Err(Usage("config: name a file or a preset".into()).into()),
    }
}

fn check(file: &str, args: &ConfigArgs) -> Result<()> {
    if file == DEFAULTS || PRESETS.contains(&file) {
        return give_preset(file, args);
    }
    if (args.all || args.out.is_some()) && !args.merged {
        let option = if args.all { "--all" } else { "--out" };
        let message = format!(
            "{option}: prints {DEFAULTS} or a preset, and {file} is none; add --merged to print all values of this file, or choose \
             one of {}",
            PRESETS.join(", ")
        );
        return Err(Usage(message).into());
    }
    let config = Config::load_or_preset(file)?;
    if args.merged {
        config.unset_keys().iter().for_each(|unset| tracing::warn!("{unset}"));
        let header = format!("Values of {}, with those of its base and the defaults.", file.escape_debug());
        return give(&config.to_commented_toml(&header, args.all), &format!("all values of {file}"), args);
    }
    config.refuse_unset_keys()?;
    warn_of_doubts(&config);
    say(format_args!("{file}: valid, {} camera(s), hash {}", config.camera.len(), config_hash(&config)));
    Ok(())
}

/// Prints a preset, or writes it to the file that was named.
fn give_preset(name: &str, args: &ConfigArgs) -> Result<()> {
    let text = match args.all || name == DEFAULTS {
        true => every_key(name, args.all)?,
        false if args.merged => every_key(name, false)?,
        false => preset_text(name)?,
    };
    give(&text, &format!("preset {name}"), args)
}

/// Prints a text, or writes it to the file that was named; `what` says what it is.
fn give(text: &str, what: &str, args: &ConfigArgs) -> Result<()> {
    let Some(out) = &args.out else {
        say(text.trim_end());
        return Ok(());
    };
    check_new(out, args.overwrite)?;
    std::fs::write(out, text).with_context(|| out.display().to_string())?;
    say(format_args!("{}: written, {what}", out.display()));
    Ok(())
}

/// Names what is valid, and yet probably a mistake.
pub fn warn_of_doubts(config: &Config) {
    config.doubts().iter().for_each(|doubt| tracing::warn!("{doubt}"));
}

/// Summary of the result, which makes a wrong unit or a wrong file visible.
pub fn summary(config: &Config, out: &Path) -> String {
    let unset: Vec<String> = config
        .unset_keys()
        .iter()
        .map(|unset| format!("`{}`: {}; {}", unset.key, unset.reason, unset.cure))
        .collect();
    let state = if unset.is_empty() { "valid" } else { "not complete" };
    let mut lines = vec![format!("{}: written, {state}, hash {}", out.display(), config_hash(config))];
    lines.extend(unset);
    for (index, camera) in config.camera.iter().enumerate() {
        let p = camera.pose_b_c().translation.vector;
        lines.push(format!(
            "camera[{index}]   {}x{} px, {} Hz, {}, focal {:.1} {:.1} px, at ({:.3} {:.3} {:.3}) m in the body",
            camera.width_px,
            camera.height_px,
            camera.rate_hz,
            camera.distortion.model(),
            camera.focal_px[0],
            camera.focal_px[1],
            p.x,
            p.y,
            p.z
        ));
    }
    if let [left, right, ..] = config.camera.as_slice() {
        let baseline = (left.pose_b_c().inverse() * right.pose_b_c()).translation.vector.norm();
        lines.push(format!("baseline    {baseline:.4} m"));
    }
    let imu = &config.imu;
    lines.push(format!(
        "imu         {} Hz, noise {:e} rad/s/sqrt(Hz) and {:e} m/s^2/sqrt(Hz)",
        imu.rate_hz, imu.gyro_noise_density, imu.accel_noise_density
    ));
    lines.push(match config.vehicle.imu_to_vehicle_deg {
        Mounting::Known([roll, pitch, yaw]) => {
            format!("mounting    roll {roll}, pitch {pitch}, yaw {yaw} degrees (vehicle.imu_to_vehicle_deg)")
        }
        Mounting::Unknown => "mounting    unknown: neither autopilot nor ROS 2 is served".into(),
    });
    lines.push(format!("time offset {:.6} s (t_imu - t_camera)", config.rig.time_offset_s));
    lines.join("\n")
}
