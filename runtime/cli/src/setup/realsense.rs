//! RealSense D435i and D455.

use super::{Found, SetupOptions, ask, finish, one_camera, preset, stable_path};
use anyhow::{Context, Result, bail};
use clap::Args;
use nalgebra::{Isometry3, Translation3};
use plumbline_config::Config;
use plumbline_config::options::rows_from_isometry;
use plumbline_drivers::iio::devices::devices_below;
use plumbline_drivers::iio::{IioDeviceInfo, IioRoots};
use plumbline_drivers::v4l2::{cameras, set_controls};
use plumbline_drivers::video_nodes::UsbCamera;
use std::path::{Path, PathBuf};

/// Format of both infrared images in one.
const FORMAT: &str = "Y8I";
/// Interface and index of the node with the infrared images, where no device can be asked.
const INFRARED: (Option<u8>, u32) = (Some(0), 2);
/// Intel's identifier on USB, and the products with the presets of their rigs.
const VENDOR: u16 = 0x8086;
const MODELS: [(u16, &str); 2] = [(0x0b3a, "realsense-d435i"), (0x0b5c, "realsense-d455")];
/// Extension unit of the stereo module, and its controls: emitter (1 byte, 0 is off), exposure (4 bytes, us) and automatic exposure
/// (1 byte), as librealsense has them (`src/ds/ds-private.h`).
const UNIT: u8 = 3;
const EMITTER: u8 = 2;
const EXPOSURE: u8 = 3;
const AUTO_EXPOSURE: u8 = 11;
/// Speed of USB 3, Mbit/s.
const USB_3_MBIT: u32 = 5000;
/// Mounting of the IMU in a camera that looks forward, as the kernel gives its axes.
const FORWARD: &str = "-90,0,90";

/// Arguments of `plumbline setup realsense`.
#[derive(Debug, Args)]
pub struct RealsenseArgs {
    #[command(flatten)]
    options: SetupOptions,
    /// Serial number, where several cameras are plugged in.
    #[arg(long)]
    serial: Option<String>,
    /// Size of each image, px.
    #[arg(long, value_name = "WIDTHxHEIGHT", default_value = "848x480", value_parser = parse_size)]
    size: (usize, usize),
    /// Frames a second.
    #[arg(long, value_name = "HZ", default_value_t = 30.0)]
    rate: f64,
    /// Exposure, us; 0 leaves it to the camera.
    #[arg(long, value_name = "US", default_value_t = 0, value_parser = clap::value_parser!(i32).range(0..=165_000))]
    exposure_us: i32,
    /// Leave the emitter on. Its dots move with the camera: the odometry believes that it stands still.
    #[arg(long)]
    emitter: bool,
    /// Intrinsics of the rectified images, px, and baseline, m: `rs-enumerate-devices -c` prints them.
    #[arg(long, value_name = "FX,FY,CX,CY,BASELINE", value_parser = parse_intrinsics)]
    intrinsics: Option<[f64; 5]>,
}

/// Reads `WIDTHxHEIGHT`.
fn parse_size(text: &str) -> Result<(usize, usize), String> {
    let sides = text.split_once('x').and_then(|(w, h)| Some((w.parse().ok()?, h.parse().ok()?)));
    sides.ok_or_else(|| "write width and height, such as 848x480".into())
}

/// Reads four intrinsics and the baseline.
pub fn parse_intrinsics(text: &str) -> Result<[f64; 5], String> {
    let numbers: Option<Vec<f64>> = text.split(',').map(|number| number.trim().parse().ok()).collect();
    let numbers = numbers.and_then(|numbers| <[f64; 5]>::try_from(numbers).ok());
    let is_positive = |numbers: &[f64; 5]| numbers.iter().all(|number| number.is_finite() && *number > 0.0);
    numbers
        .filter(is_positive)
        .ok_or_else(|| "write five positive numbers, such as 426.0,426.0,423.5,239.5,0.050".into())
}

/// Sets up a camera.
///
/// # Errors
/// When it is not there or does not answer, something is missing, or the configuration cannot be written.
pub fn run(args: &RealsenseArgs) -> Result<()> {
    args.options.check()?;
    let is_it = |camera: &UsbCamera| camera.vendor == VENDOR && preset_of(camera.product).is_some();
    let camera = one_camera(&args.options, "RealSense D435i or D455", args.serial.as_deref(), is_it)?;
    let rig = preset_of(camera.product).context("the model was just found")?;
    let node = infrared_node(args, &camera)?;
    let numbers = match args.intrinsics {
        Some(numbers) => numbers,
        None => asked(args.size)?,
    };
    let mounting = args.options.mounting(FORWARD)?;
    let mut config = preset(rig, mounting)?;
    put_cameras(&mut config, args.size, numbers, args.rate)?;
    let mut notes = vec![put_imu(&mut config, &args.options, &camera)];
    config.driver.v4l2.left = stable_path(&camera, &node)?;
    config.driver.v4l2.controls = controls(args);
    notes.push(
        "Place of the cameras on the IMU: the manufacturer's drawing. `plumbline calibrate rig` refines it."
            .into(),
    );
    if camera.speed_mbit.is_some_and(|speed| speed < USB_3_MBIT) {
        notes.push("The camera is connected by USB 2, which carries fewer sizes and rates: use a USB 3 port and cable.".into());
    }
    let found = Found {
        device: format!("{} {} ({}x{} px)", camera.name, camera.serial, args.size.0, args.size.1),
        settings: settings(args),
        notes,
        config,
    };
    let (path, controls) = (PathBuf::from(format!("/dev/{node}")), controls(args));
    finish(&args.options, found, || Ok(set_controls(&path, &controls)?))
}

/// Name of the node with the infrared images: the one that offers them, or the one where they are by the manufacturer's layout.
fn infrared_node(args: &RealsenseArgs, camera: &UsbCamera) -> Result<String> {
    if !args.options.is_live() {
        let node = camera.nodes.iter().find(|node| (node.interface(), node.index) == INFRARED);
        return Ok(node.context("the recorded camera has no node of infrared images")?.name.clone());
    }
    let is_of = |name: &str| camera.nodes.iter().any(|node| node.name == name);
    let named = |path: &Path| path.file_name().map(|name| name.to_string_lossy().into_owned());
    let offering = cameras().into_iter().find(|info| {
        named(&info.path).is_some_and(|name| is_of(&name))
            && info.formats.iter().any(|f| f.code.trim() == FORMAT)
    });
    let Some(info) = offering else {
        bail!(
            "{} {}: no node offers infrared images ({FORMAT}); add this user to the group `video`, or see `plumbline \
             devices` and docs/rigs/realsense.md",
            camera.name,
            camera.serial
        );
    };
    let (width, height) = args.size;
    let sizes: Vec<String> = info
        .formats
        .iter()
        .filter(|format| format.code.trim() == FORMAT)
        .flat_map(|format| &format.sizes)
        .map(|size| size.size_text())
        .collect();
    if !sizes.is_empty() && !sizes.contains(&format!("{width} x {height}")) {
        bail!("--size {width}x{height}: {} offers {}", info.path.display(), sizes.join(", "));
    }
    named(&info.path).context("a node has a name")
}

/// Preset of a product.
fn preset_of(product: u16) -> Option<&'static str> {
    MODELS.iter().find(|(number, _)| *number == product).map(|(_, preset)| *preset)
}

fn asked(size: (usize, usize)) -> Result<[f64; 5]> {
    let question = format!(
        "Intrinsics of the rectified infrared images at {}x{} px, and baseline: FX,FY,CX,CY,BASELINE (`rs-enumerate-devices -c` \
         prints them; baseline in m)",
        size.0, size.1
    );
    ask::ask("--intrinsics", &question, parse_intrinsics)
}

/// Puts the calibration into both cameras: the left one stays where the preset has it, the right one is the baseline along
/// its x axis.
fn put_cameras(
    config: &mut Config,
    size: (usize, usize),
    [fx, fy, cx, cy, baseline_m]: [f64; 5],
    rate_hz: f64,
) -> Result<()> {
    let left = config.camera.first().context("a preset of a rig has cameras")?.pose_b_c();
    let right = left * Isometry3::from(Translation3::new(baseline_m, 0.0, 0.0));
    for (camera, pose) in config.camera.iter_mut().zip([left, right]) {
        (camera.width_px, camera.height_px) = size;
        (camera.focal_px, camera.centre_px) = ([fx, fy], [cx, cy]);
        camera.rate_hz = rate_hz;
        camera.pose_b_c = rows_from_isometry(&pose);
    }
    Ok(())
}

/// Puts in the camera's own inertial sensors; the note says which, or what is missing.
fn put_imu(config: &mut Config, options: &SetupOptions, camera: &UsbCamera) -> String {
    let root = &options.tree().root;
    let roots = IioRoots { sys: root.join("sys/bus/iio/devices"), dev: root.join("dev") };
    let own: Vec<IioDeviceInfo> = devices_below(&roots)
        .into_iter()
        .filter(|device| std::fs::canonicalize(&device.folder).is_ok_and(|f| f.starts_with(&camera.folder)))
        .collect();
    let gyro = own.iter().find(|device| device.has_gyro);
    let accel = own.iter().find(|device| device.has_accel);
    let (Some(gyro), Some(accel)) = (gyro, accel) else {
        return "IMU: the kernel shows none of this camera (HID_SENSOR_GYRO_3D and HID_SENSOR_ACCEL_3D missing?); the \
                addresses are those of the preset. See docs/rigs/realsense.md."
            .into();
    };
    config.driver.imu.connect = format!("iio://{},{}", gyro.name, accel.name);
    // The slowest rate that is not below that of the preset.
    let wanted_hz = config.imu.rate_hz;
    let fit = gyro.rates_hz.iter().copied().filter(|rate| *rate >= wanted_hz);
    if let Some(rate_hz) = fit.min_by(f64::total_cmp) {
        config.imu.rate_hz = rate_hz;
    }
    format!(
        "IMU: {} at {} Hz. Noise is that of its data sheet, inflated for flight.",
        config.driver.imu.connect, config.imu.rate_hz
    )
}

/// Controls of the extension unit, as the configuration has them: they are set whenever the camera is opened.
fn controls(args: &RealsenseArgs) -> Vec<String> {
    let automatic = i32::from(args.exposure_us == 0);
    let mut controls = vec![
        format!("xu:{UNIT}:{EMITTER}:1={}", i32::from(args.emitter)),
        format!("xu:{UNIT}:{AUTO_EXPOSURE}:1={automatic}"),
    ];
    if args.exposure_us > 0 {
        controls.push(format!("xu:{UNIT}:{EXPOSURE}:4={}", args.exposure_us));
    }
    controls
}

fn settings(args: &RealsenseArgs) -> Vec<String> {
    let emitter = if args.emitter { "on" } else { "off" };
    let exposure = match args.exposure_us {
        0 => "automatic".to_owned(),
        us => format!("{us} us"),
    };
    let controls = controls(args).join(", ");
    vec![format!("emitter {emitter}, exposure {exposure} (driver.v4l2.controls: {controls})")]
}

#[cfg(test)]
mod tests {
    use super::*;
    use plumbline_config::options::Mounting;

    #[test]
    fn the_right_camera_is_the_baseline_to_the_right_of_the_left() {
        let mut config = preset("realsense-d435i", Mounting::Unknown).unwrap();
        put_cameras(&mut config, (640, 480), [380.0, 381.0, 320.5, 240.5, 0.0503], 60.0).unwrap();
        let [left, right] = &config.camera[..] else { panic!("two cameras") };
        let between = left.pose_b_c().inverse() * right.pose_b_c();
        assert!((between.translation.vector - nalgebra::Vector3::new(0.0503, 0.0, 0.0)).norm() < 1e-12);
        assert!(between.rotation.angle() < 1e-12);
        assert_eq!((left.focal_px, right.centre_px, left.rate_hz), ([380.0, 381.0], [320.5, 240.5], 60.0));
    }

    #[test]
    fn sizes_and_intrinsics_are_read_or_refused() {
        assert_eq!(parse_size("848x480"), Ok((848, 480)));
        assert!(["848", "848x", "x480", "848x480x3", ""].iter().all(|text| parse_size(text).is_err()));
        assert_eq!(parse_intrinsics("1, 2,3,4,0.05"), Ok([1.0, 2.0, 3.0, 4.0, 0.05]));
        assert!(
            ["1,2,3,4", "1,2,3,4,x", "1,2,3,4,-0.05", "1,2,3,4,NaN"]
                .iter()
                .all(|t| parse_intrinsics(t).is_err())
        );
    }
}
