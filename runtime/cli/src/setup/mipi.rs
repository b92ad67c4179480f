//! Two MIPI cameras behind the kernel's receivers, and the autopilot's IMU.

use super::super::Usage;
use super::{Found, SetupOptions, finish, preset};
use anyhow::Result;
use clap::Args;
use plumbline_config::options::ImuEndpoint;
use plumbline_drivers::video_nodes::{VideoNode, video_nodes};

/// Name of the raw node of a Raspberry Pi 5's receiver.
const RECEIVER: &str = "rp1-cfe-csi2_ch0";
/// Mounting of a Pixhawk: forward, right, down.
const FORWARD: &str = "180,0,0";

/// Arguments of `plumbline setup mipi`.
#[derive(Debug, Args)]
pub struct MipiArgs {
    #[command(flatten)]
    options: SetupOptions,
    /// Device of the left camera. Default: the first of the Raspberry Pi's two receivers.
    #[arg(long, value_name = "PATH", requires = "right")]
    left: Option<String>,
    /// Device of the right camera.
    #[arg(long, value_name = "PATH", requires = "left")]
    right: Option<String>,
    /// Exchange the two receivers.
    #[arg(long, conflicts_with_all = ["left", "right"])]
    swap: bool,
    /// Address of the autopilot's IMU. Default: that of the preset, serial:///dev/ttyAMA0:921600.
    #[arg(long, value_name = "ADDRESS")]
    imu: Option<String>,
}

/// Sets up two cameras.
///
/// # Errors
/// When they are not there, or the configuration cannot be written.
pub fn run(args: &MipiArgs) -> Result<()> {
    args.options.check()?;
    let [left, right] = devices(args)?;
    let mut config = preset("mipi-stereo", args.options.mounting(FORWARD)?)?;
    if let Some(address) = &args.imu {
        ImuEndpoint::parse(address).map_err(|why| anyhow::anyhow!("--imu: {why}"))?;
        config.driver.imu.connect.clone_from(address);
    }
    let device = format!("two MIPI cameras, {left} and {right}");
    (config.driver.v4l2.left, config.driver.v4l2.right) = (left, right);
    let notes = vec![
        "Calibration: of a drawing, of the preset. Calibrate: plumbline calibrate camera, then rig."
            .to_owned(),
        "Left is left if a hand before the left lens darkens the left image; else give --swap.".to_owned(),
        "The media pipeline is set up by media-ctl after each start: docs/rigs/mipi.md.".to_owned(),
    ];
    finish(&args.options, Found { device, config, notes, settings: Vec::new() }, || Ok(()))
}

/// Devices that were named, or the two receivers.
fn devices(args: &MipiArgs) -> Result<[String; 2]> {
    if let (Some(left), Some(right)) = (&args.left, &args.right) {
        return Ok([left.clone(), right.clone()]);
    }
    let there: Vec<VideoNode> =
        video_nodes(&args.options.tree()).into_iter().filter(|node| node.label == RECEIVER).collect();
    let paths: Vec<String> =
        there.iter().filter_map(|node| Some(node.stable_path.as_ref()?.display().to_string())).collect();
    let Ok([first, second]) = <[String; 2]>::try_from(paths.clone()) else {
        let found = if paths.is_empty() { "none".to_owned() } else { paths.join(", ") };
        let message = format!(
            "two nodes `{RECEIVER}` are wanted, and {found} found; name the devices by --left and --right, as `plumbline devices` \
             lists them"
        );
        return Err(Usage(message).into());
    };
    Ok(if args.swap { [second, first] } else { [first, second] })
}
