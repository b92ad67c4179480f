//! ZED Mini: both images side by side over USB, and the autopilot's IMU.

use super::{Found, SetupOptions, finish, one_camera, preset, stable_path};
use anyhow::{Context, Result, bail};
use clap::Args;
use plumbline_config::options::ImuEndpoint;
use plumbline_drivers::video_nodes::UsbCamera;
use std::path::PathBuf;

/// Identifiers of the manufacturer and of the product, with either firmware, on USB.
const VENDOR: u16 = 0x2b03;
const PRODUCTS: [u16; 2] = [0xf680, 0xf682];
/// Mounting of a Pixhawk: forward, right, down.
const FORWARD: &str = "180,0,0";

/// Arguments of `plumbline setup zed-mini`.
#[derive(Debug, Args)]
pub struct ZedMiniArgs {
    #[command(flatten)]
    options: SetupOptions,
    /// Serial number, where several cameras are plugged in.
    #[arg(long)]
    serial: Option<String>,
    /// Factory calibration by serial number, from calib.stereolabs.com. Default: nominal values, good for a look only.
    #[arg(long, value_name = "SN12345.conf")]
    factory: Option<PathBuf>,
    /// Address of the autopilot's IMU. Default: that of the preset, serial:///dev/ttyAMA0:921600.
    #[arg(long, value_name = "ADDRESS")]
    imu: Option<String>,
    /// Exposure, us; 0 leaves it to the camera.
    #[arg(long, value_name = "US", default_value_t = 0.0)]
    exposure_us: f64,
}

/// Sets up a camera.
///
/// # Errors
/// When it is not there, a file cannot be used, or the configuration cannot be written.
pub fn run(args: &ZedMiniArgs) -> Result<()> {
    args.options.check()?;
    let is_it = |camera: &UsbCamera| camera.vendor == VENDOR && PRODUCTS.contains(&camera.product);
    let camera = one_camera(&args.options, "ZED Mini", args.serial.as_deref(), is_it)?;
    let mut config = preset("zed-mini", args.options.mounting(FORWARD)?)?;
    let mut notes = Vec::new();
    match &args.factory {
        Some(file) => {
            config = plumbline_config::import::zed_into(config, file)?;
            notes.push(format!(
                "Intrinsics and baseline: {}. Rotation between the cameras and their place on the IMU: those of the preset.",
                file.display()
            ));
        }
        None => notes.push(
            "Calibration: nominal, of the preset. Give --factory, or calibrate: plumbline calibrate camera."
                .into(),
        ),
    }
    if let Some(address) = &args.imu {
        ImuEndpoint::parse(address).map_err(|why| anyhow::anyhow!("--imu: {why}"))?;
        config.driver.imu.connect.clone_from(address);
    }
    // The node with images is the first of its interface; the other one carries metadata.
    let Some(node) = camera.nodes.iter().find(|node| node.index == 0) else {
        bail!(
            "{} {}: the kernel shows no node with images; see `plumbline devices`",
            camera.name,
            camera.serial
        );
    };
    config.driver.v4l2.left = stable_path(&camera, &node.name)?;
    config.driver.v4l2.exposure_us = args.exposure_us;
    notes.push(format!(
        "IMU: {}. Measure its place to 5 mm: docs/rigs/zed-mini.md.",
        config.driver.imu.connect
    ));
    let device = format!("{} {}", camera.name, camera.serial);
    let settings = match args.exposure_us > 0.0 {
        true => vec![format!(
            "exposure {} us, when the camera is opened (driver.v4l2.exposure_us)",
            args.exposure_us
        )],
        false => Vec::new(),
    };
    finish(&args.options, Found { device, config, notes, settings }, || Ok(())).context("ZED Mini")
}
