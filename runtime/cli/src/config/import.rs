//! `plumbline config import`: a configuration made of calibration files.

use super::super::{Usage, check_new, load_config, say, write_config};
use super::{parse_mounting, summary, warn_of_doubts};
use anyhow::{Context, Result};
use clap::Args;
use plumbline_config::ValidConfig;
use plumbline_config::import::{self, Import, Source};
use plumbline_config::options::{Mounting, VehicleConfig};
use std::fmt::Write as _;
use std::path::PathBuf;

const EXAMPLES: &str = "Examples:
  plumbline config import --camchain camchain-imucam.yaml --imu imu.yaml --inflate 10 --imu-to-vehicle 180,0,0 --out my.toml
  plumbline config import --euroc V1_01_easy --inflate 10 --imu-to-vehicle 180,-70.3,0 --out my.toml
  plumbline config import --euroc V1_01_easy --inflate 10 --imu-to-vehicle unknown --out my.toml
  plumbline config import --rig calibration.json --imu-to-vehicle unknown --out my.toml
  plumbline replay V1_01_easy --config my.toml

Calibration files do not contain the mounting of the IMU in the vehicle. 0,0,0 is x forward, y left, z up; 180,0,0 is x forward, \
y right, z down. With `unknown` neither autopilot nor ROS 2 is served; `plumbline doctor --live` measures the mounting.

Noise densities from a data sheet or an Allan plot hold for a sensor at rest, and are too small in flight. If your files contain \
such values, use --inflate 10 (as Kalibr recommends; the preset euroc has 10 and 8). VINS-Fusion, ORB-SLAM3 and Basalt have densities \
that were tuned for them: use --noise base where they are refused or do not fit.";

/// Arguments of `plumbline config import`.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct ImportArgs {
    /// Kalibr's cameras, extrinsics and time offset: camchain-imucam.yaml.
    #[arg(long, value_name = "CAMCHAIN.yaml", requires = "imu")]
    camchain: Option<PathBuf>,
    /// Kalibr's rate and noise of the IMU: imu.yaml.
    #[arg(long, value_name = "IMU.yaml", requires = "camchain")]
    imu: Option<PathBuf>,
    /// A EuRoC data set, or a folder with its sensor.yaml files.
    #[arg(long, value_name = "FOLDER", conflicts_with_all = ["camchain", "imu"])]
    euroc: Option<PathBuf>,
    /// Calibration of another program: Basalt's calibration.json, a configuration of VINS-Fusion, VINS-Mono or OpenVINS
    /// (estimator_config.yaml), settings of ORB-SLAM3, or a folder of TUM-VI.
    #[arg(long, value_name = "FILE|FOLDER", conflicts_with_all = ["camchain", "imu", "euroc"])]
    rig: Option<PathBuf>,
    /// Configuration to write.
    #[arg(long, value_name = "OUT.toml")]
    out: PathBuf,
    /// Configuration file or preset for all other values.
    #[arg(long, default_value = "euroc", value_name = "FILE|PRESET")]
    base: PathBuf,
    /// Source of the IMU noise densities.
    #[arg(long, value_enum, default_value_t = Noise::Files)]
    noise: Noise,
    /// Factor for the white noise densities of the files.
    #[arg(long, default_value_t = 1.0, value_name = "FACTOR")]
    inflate: f64,
    /// Frame rate of the cameras, Hz, instead of that of the files. Files of Kalibr, Basalt and VINS do not contain it. Default: the
    /// rate in the files, or in --base.
    #[arg(long, value_name = "HZ", conflicts_with = "euroc")]
    camera_rate: Option<f64>,
    /// Mounting of the IMU in the vehicle: rotation from its axes to forward, left, up, degrees
    /// (vehicle.imu_to_vehicle_deg). Required, unless the data set states it.
    #[arg(long, value_name = "ROLL,PITCH,YAW|unknown", value_parser = parse_mounting, allow_hyphen_values = true)]
    imu_to_vehicle: Option<Mounting>,
    /// Replace an existing file.
    #[arg(long)]
    overwrite: bool,
}

/// Source of the IMU noise model.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Noise {
    /// Calibration files.
    Files,
    /// Base configuration.
    Base,
}

/// Error where no files are named.
const NOTHING_TO_IMPORT: &str = "config import: give --camchain and --imu, --euroc, or --rig";

/// Runs the command.
///
/// # Errors
/// When a file cannot be used, or the configuration cannot be written.
pub fn run(args: &ImportArgs) -> Result<()> {
    check_new(&args.out, args.overwrite)?;
    if !(args.inflate.is_finite() && args.inflate > 0.0) {
        return Err(Usage("--inflate: give a positive number, such as 10".into()).into());
    }
    let (config, is_stated) = imported(args)?;
    let text = format!("{}{}", header(args), config.to_toml()?);
    let back = write_config(&args.out, &text)?;
    say(summary(&back, &args.out));
    // A simulated data set states its mounting, and its noise is the true one.
    if args.noise == Noise::Files && !is_stated {
        say(noise_in_words(args));
    }
    if args.euroc.is_none() && args.camera_rate.is_none() {
        say("rates       of --base where the files state none: check them, or give --camera-rate");
    }
    warn_of_doubts(&back);
    Ok(())
}

/// The base with the calibration of the files, and whether they state the mounting.
fn imported(args: &ImportArgs) -> Result<(ValidConfig, bool)> {
    let mut base = load_config(Some(&args.base))?.context("a base was named")?.into_inner();
    if let Some(rate_hz) = args.camera_rate {
        base.camera.iter_mut().for_each(|camera| camera.rate_hz = rate_hz);
    }
    let source = match (&args.camchain, &args.imu, &args.euroc, &args.rig) {
        (Some(camchain), Some(imu), ..) => Source::Kalibr { camchain, imu },
        (_, _, Some(folder), _) => Source::Euroc(folder),
        (.., Some(rig)) => Source::Rig(rig),
        _ => return Err(Usage(NOTHING_TO_IMPORT.into()).into()),
    };
    let Import { config, noise, mounting } = import::read_into(base, source)?;
    let mut config = config.into_inner();
    // Files that tell a rate are overruled too.
    if let Some(rate_hz) = args.camera_rate {
        config.camera.iter_mut().for_each(|camera| camera.rate_hz = rate_hz);
    }
    let imu_to_vehicle_deg = args.imu_to_vehicle.or(mounting).ok_or_else(|| {
        let message = "--imu-to-vehicle: the files do not tell how the IMU is mounted in the vehicle; give roll,pitch,yaw in \
                       degrees (0,0,0 is x forward, y left, z up; the vehicle of the EuRoC data sets has 180,-70.3,0), or \
                       unknown";
        Usage(message.into())
    })?;
    config.vehicle = VehicleConfig { imu_to_vehicle_deg };
    if args.noise == Noise::Files {
        let imu = &mut config.imu;
        let [gyro_noise, gyro_walk, accel_noise, accel_walk] = noise;
        imu.gyro_noise_density = rounded(gyro_noise * args.inflate);
        imu.accel_noise_density = rounded(accel_noise * args.inflate);
        imu.gyro_bias_walk = gyro_walk;
        imu.accel_bias_walk = accel_walk;
    }
    Ok((config.validated(&args.out.display().to_string())?, mounting.is_some()))
}

/// Validity of the noise densities.
fn noise_in_words(args: &ImportArgs) -> String {
    let how = match (args.inflate > 1.0, &args.rig) {
        (true, _) => return format!("noise       white noise of the files times {}", args.inflate),
        (false, Some(_)) => "as in the file, tuned for another program; for flight, give --noise base",
        (false, None) => "as in the files, which holds for a sensor at rest; for flight, give --inflate 10",
    };
    format!("noise       {how}")
}

/// Says in the file where it comes from.
fn header(args: &ImportArgs) -> String {
    let files = [&args.camchain, &args.imu, &args.euroc, &args.rig].into_iter().flatten();
    let mut text = String::from("# Made by `plumbline config import` of:\n");
    for file in files {
        let _ = writeln!(text, "#   {}", file.display());
    }
    let noise = match args.noise {
        Noise::Base => "of the base".to_owned(),
        Noise::Files => format!("of the files, white noise times {}", args.inflate),
    };
    let _ = writeln!(text, "# All else is of {}; noise densities {noise}.\n", args.base.display());
    text
}

/// `value` to twelve digits: a product with a factor has more that mean nothing.
fn rounded(value: f64) -> f64 {
    format!("{value:.11e}").parse().unwrap_or(value)
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    #[derive(Parser)]
    struct Line {
        #[command(flatten)]
        args: ImportArgs,
    }

    const ORB_SLAM: &str = "%YAML:1.0
File.version: \"1.0\"
Camera.type: \"PinHole\"
Camera1.fx: 382.6
Camera1.fy: 382.6
Camera1.cx: 320.1
Camera1.cy: 236.4
Camera.width: 640
Camera.height: 480
Camera.fps: 20
IMU.T_b_c1: !!opencv-matrix
   rows: 4
   cols: 4
   dt: f
   data: [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0]
IMU.NoiseGyro: 0.001
IMU.NoiseAcc: 0.01
IMU.GyroWalk: 0.000001
IMU.AccWalk: 0.0001
IMU.Frequency: 200
";

    #[test]
    fn a_camera_rate_that_is_given_overrules_the_file() {
        let folder = tempfile::tempdir().unwrap();
        let rig = folder.path().join("orb.yaml");
        std::fs::write(&rig, ORB_SLAM).unwrap();
        let rig = rig.to_str().unwrap();
        let rate_hz = |more: &[&str]| {
            let line = ["import", "--rig", rig, "--out", "out.toml", "--imu-to-vehicle", "unknown"];
            let (config, _) = imported(&Line::parse_from([&line, more].concat()).args).unwrap();
            config.camera[0].rate_hz
        };
        assert_eq!((rate_hz(&[]), rate_hz(&["--camera-rate", "30"])), (20.0, 30.0));
    }
}
