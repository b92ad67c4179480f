//! `plumbline setup`: from a camera that is plugged in to a configuration, in one command.
//!
//! A rig is found ([`plumbline_drivers::video_nodes`]), its calibration is read from the device or from the manufacturer's file, and what
//! neither states is asked for: as an option, or on a terminal. Then the configuration is written, what can be set on the
//! device is set, and the doctor runs. What is known of each rig stands in a module of its own.

mod ask;
mod mipi;
mod realsense;
mod zed_mini;

use super::config::{parse_mounting, summary, warn_of_doubts};
use super::doctor::{self, DoctorArgs};
use super::{Usage, check_new, say, write_config};
use anyhow::{Context, Result};
use clap::{Args, Subcommand};
use plumbline_config::options::{Mounting, VehicleConfig};
use plumbline_config::{Config, ValidConfig};
use plumbline_drivers::video_nodes::{DeviceTree, UsbCamera, usb_cameras};
use std::fmt::Write as _;
use std::path::PathBuf;

const EXAMPLES: &str = "Examples:
  plumbline setup realsense --out drone.toml                      asks for the mounting, runs the doctor
  plumbline setup realsense --imu-to-vehicle -90,0,90 --dry-run   shows what would be written and set
  plumbline setup zed-mini --factory SN12345.conf --imu-to-vehicle 180,0,0 --out drone.toml

No rig has been tried on a device yet: the layouts of tables and controls are those of the manufacturers' public sources, and are tested \
on recorded descriptors. See docs/rigs.";

/// Arguments of `plumbline setup`.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct SetupArgs {
    #[command(subcommand)]
    rig: Rig,
}

#[derive(Debug, Subcommand)]
enum Rig {
    /// RealSense D435i or D455: infrared pair and IMU by the kernel's drivers. Not tried on a device.
    Realsense(realsense::RealsenseArgs),
    /// ZED Mini as a USB camera, with the autopilot's IMU. Not tried on a device.
    ZedMini(zed_mini::ZedMiniArgs),
    /// Two MIPI cameras of the kernel, with the autopilot's IMU. Not tried on a device.
    Mipi(mipi::MipiArgs),
}

/// Options of every rig.
#[derive(Clone, Debug, Args)]
pub struct SetupOptions {
    /// Configuration to write.
    #[arg(long, value_name = "OUT.toml", required_unless_present = "dry_run")]
    out: Option<PathBuf>,
    /// Mounting of the IMU in the vehicle: degrees that turn its axes to forward, left, up (vehicle.imu_to_vehicle_deg).
    /// Default: asked for on a terminal.
    #[arg(long, value_name = "ROLL,PITCH,YAW|unknown", value_parser = parse_mounting, allow_hyphen_values = true)]
    imu_to_vehicle: Option<Mounting>,
    /// Replace a file of that name.
    #[arg(long)]
    overwrite: bool,
    /// Print the configuration and what would be set; write and set nothing.
    #[arg(long)]
    dry_run: bool,
    /// Do not run `plumbline doctor --live` at the end.
    #[arg(long)]
    no_doctor: bool,
    /// Recorded device tree in place of `/`: its `sys` and `dev/v4l/by-path`. Nothing is set, and no doctor runs.
    #[arg(long, value_name = "FOLDER")]
    recorded: Option<PathBuf>,
}

impl SetupOptions {
    /// True if devices of this computer are meant, and may be changed.
    fn is_live(&self) -> bool {
        self.recorded.is_none()
    }

    fn tree(&self) -> DeviceTree {
        self.recorded.clone().map_or_else(DeviceTree::default, |root| DeviceTree { root })
    }

    /// Refuses, before any device is touched, a file that could not be written.
    fn check(&self) -> Result<()> {
        let Some(out) = &self.out else { return Ok(()) };
        Ok(check_new(out, self.overwrite || self.dry_run)?)
    }

    /// Mounting that was named, or is asked for; `usual` is that of a rig that looks forward and stands upright.
    fn mounting(&self, usual: &str) -> Result<Mounting> {
        if let Some(named) = self.imu_to_vehicle {
            return Ok(named);
        }
        let question = format!(
            "Mounting of the IMU: roll,pitch,yaw in degrees that turn its axes to forward, left, up.\nA camera that looks \
             forward and stands upright has {usual}; `unknown` if you do not know it yet"
        );
        ask::ask("--imu-to-vehicle", &question, parse_mounting)
    }
}

/// Rig whose configuration is complete.
struct Found {
    /// Name of the device, such as `RealSense D435i 123 (USB 3)`.
    device: String,
    /// Configuration of the rig.
    config: Config,
    /// Where the values come from, and what is left to do; a line each.
    notes: Vec<String>,
    /// Settings of the device, in words.
    settings: Vec<String>,
}

/// Runs the command.
///
/// # Errors
/// When the device is not there or does not answer, something is missing, or the configuration cannot be written.
pub fn run(args: &SetupArgs) -> Result<()> {
    match &args.rig {
        Rig::Realsense(args) => realsense::run(args),
        Rig::ZedMini(args) => zed_mini::run(args),
        Rig::Mipi(args) => mipi::run(args),
    }
}

/// Writes the configuration, sets the device by `apply`, and runs the doctor; or says what would be done.
fn finish(options: &SetupOptions, found: Found, apply: impl FnOnce() -> Result<()>) -> Result<()> {
    let out = options.out.clone().unwrap_or_else(|| PathBuf::from("drone.toml"));
    let origin = out.display().to_string();
    let config = found.config.validated(&origin)?;
    let text = format!("{}\n{}", header(&found.device, &found.notes), config.to_toml()?);
    // What is written is what will be read.
    let back = Config::from_toml_str(&text, &origin)?;
    say(format_args!("found       {}", found.device));
    if options.dry_run {
        say(format_args!("would write {origin}:\n\n{}", text.trim_end()));
        found.settings.iter().for_each(|setting| say(format_args!("would set   {setting}")));
        return Ok(());
    }
    write_config(&out, &text)?;
    say(summary(&back, &out));
    found.notes.iter().for_each(|note| say(format_args!("note        {note}")));
    warn_of_doubts(&back);
    if options.is_live() {
        apply()?;
        found.settings.iter().for_each(|setting| say(format_args!("set         {setting}")));
    }
    examine(options, &back, out)
}

/// Runs the doctor with the configuration, if a flight could use it.
fn examine(options: &SetupOptions, config: &ValidConfig, out: PathBuf) -> Result<()> {
    let is_complete = config.unset_keys().is_empty();
    if options.no_doctor || !options.is_live() || !is_complete {
        say(format_args!("next        plumbline doctor --config {} --live", out.display()));
        return Ok(());
    }
    doctor::run(&DoctorArgs { config: Some(out), live: true, watch: 2.0, ..DoctorArgs::default() })
}

/// Heading of the file: where its values come from.
fn header(device: &str, notes: &[String]) -> String {
    let mut text = format!("# Made by `plumbline setup` for {device}.\n");
    for note in notes {
        let _ = writeln!(text, "# {note}");
    }
    text
}

/// Preset of a rig with this mounting.
fn preset(name: &str, mounting: Mounting) -> Result<Config> {
    let mut config = Config::preset(name)?.into_inner();
    config.vehicle = VehicleConfig { imu_to_vehicle_deg: mounting };
    Ok(config)
}

/// The one camera on USB of a manufacturer; `is_it` knows its products, `serial` chooses among several.
///
/// # Errors
/// When there is none, or there are several.
fn one_camera(
    options: &SetupOptions,
    what: &str,
    serial: Option<&str>,
    is_it: impl Fn(&UsbCamera) -> bool,
) -> Result<UsbCamera> {
    let mut there: Vec<UsbCamera> = usb_cameras(&options.tree()).into_iter().filter(is_it).collect();
    let serials: Vec<String> = there.iter().map(|camera| camera.serial.clone()).collect();
    if let Some(serial) = serial {
        there.retain(|camera| camera.serial == serial);
    }
    match (there.len(), serial) {
        (1, _) => Ok(there.remove(0)),
        (0, Some(serial)) if !serials.is_empty() => {
            anyhow::bail!("{what} {serial}: not found; give --serial one of {}", serials.join(", "))
        }
        (0, _) => anyhow::bail!(
            "{what}: not found on USB; plug it in at a USB 3 port, and see `lsusb` and the kernel's log (`dmesg`)"
        ),
        _ => {
            Err(Usage(format!("{what}: several are there; give --serial one of {}", serials.join(", ")))
                .into())
        }
    }
}

/// Name that stays of a camera's node, as a configuration has it.
fn stable_path(camera: &UsbCamera, name: &str) -> Result<String> {
    let node = camera.nodes.iter().find(|node| node.name == name);
    let path = node.and_then(|node| node.stable_path.as_ref());
    let path = path.with_context(|| {
        format!("/dev/{name}: has no link in /dev/v4l/by-path; is udev running? See `plumbline devices`")
    })?;
    Ok(path.display().to_string())
}
