//! `plumbline config`: check a configuration, print a preset, or make a configuration of calibration files.

#[cfg(feature = "yaml")]
mod import;

use super::{Usage, say};
use anyhow::Result;
use clap::{Args, Subcommand};
use plumbline_config::Config;
use plumbline_config::options::Mounting;
use plumbline_record::digest::config_hash;
use std::path::Path;

const EXAMPLES: &str = "Examples:
  plumbline config euroc > my.toml         print a preset with a comment at every key
  plumbline config realsense-d455          print the preset of a real rig (docs/rigs)
  plumbline config my.toml                 check a configuration
  plumbline config import --camchain camchain.yaml --imu imu.yaml --imu-to-vehicle unknown --out my.toml";

/// Arguments of `plumbline config`.
#[derive(Debug, Args)]
#[command(args_conflicts_with_subcommands = true, after_help = EXAMPLES)]
pub struct ConfigArgs {
    #[command(subcommand)]
    command: Option<ConfigCommand>,
    #[arg(required = true, help = file_help())]
    file: Option<String>,
}

/// Names every preset that there is.
fn file_help() -> String {
    format!(
        "A configuration file to check, or the name of a preset to print: {}",
        plumbline_config::PRESETS.join(", ")
    )
}

#[derive(Debug, Subcommand)]
enum ConfigCommand {
    /// Make a configuration from a calibration by Kalibr or a EuRoC data set.
    #[cfg(feature = "yaml")]
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
        #[cfg(feature = "yaml")]
        (Some(ConfigCommand::Import(args)), _) => import::run(args),
        #[cfg(not(feature = "yaml"))]
        (Some(never), _) => match *never {},
        (None, Some(file)) => check(file),
        (None, None) => Err(Usage("config: name a file or a preset".into()).into()),
    }
}

fn check(file: &str) -> Result<()> {
    if plumbline_config::PRESETS.contains(&file) {
        say(plumbline_config::preset_text(file)?.trim_end());
        return Ok(());
    }
    let config = Config::load(file)?;
    config.refuse_unset_keys(file)?;
    warn_of_doubts(&config);
    say(format_args!("{file}: valid, {} camera(s), hash {}", config.camera.len(), config_hash(&config)));
    Ok(())
}

/// Names what is valid, and yet probably a mistake.
pub fn warn_of_doubts(config: &Config) {
    config.doubts().iter().for_each(|doubt| tracing::warn!("{doubt}"));
}

/// What came out, so that a wrong unit or a wrong file meets the eye.
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
            "camera[{index}]   {}x{} px, {} Hz, focal {:.1} {:.1} px, at ({:.3} {:.3} {:.3}) m in the body",
            camera.width_px,
            camera.height_px,
            camera.rate_hz,
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
    lines.push(format!("time offset {} s (t_imu - t_camera)", config.rig.time_offset_s));
    lines.join("\n")
}
