//! Writes what any sources deliver as a data set in the ASL format.
//!
//! Everything goes to `mav0.partial` first, which becomes `mav0` when it is complete: a directory with
//! `mav0` in it is whole. Numbers are printed with the digits that bring back the same bits.

use crate::{DriverError, ImuReading, ImuSource, StereoFrame, StereoSource, TruthState};
use plumbline_config::camera::Distortion;
use plumbline_config::options::{CameraConfig, ImuConfig, Mounting};
use plumbline_config::{Config, GrayImage};
use png::{BitDepth, ColorType, Compression, Encoder};
use std::fmt::Write as _;
use std::fs::{self, File};
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

const IMAGE_HEADER: &str = "#timestamp [ns],filename";
const IMU_HEADER: &str = "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1],\
    a_RS_S_x [m s^-2],a_RS_S_y [m s^-2],a_RS_S_z [m s^-2]";
const TRUTH_HEADER: &str = "#timestamp, p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], \
    q_RS_y [], q_RS_z [], v_RS_R_x [m s^-1], v_RS_R_y [m s^-1], v_RS_R_z [m s^-1], b_w_RS_S_x [rad s^-1], \
    b_w_RS_S_y [rad s^-1], b_w_RS_S_z [rad s^-1], b_a_RS_S_x [m s^-2], b_a_RS_S_y [m s^-2], \
    b_a_RS_S_z [m s^-2]";
const PARTIAL: &str = "mav0.partial";

/// Sources of the data set to be written.
pub struct WriteInputs<'a> {
    /// Calibration of the sensors, for `sensor.yaml`; one folder a camera.
    pub config: &'a Config,
    /// Images, read to their end.
    pub stereo: &'a mut dyn StereoSource,
    /// Inertial samples, read to their end.
    pub imu: &'a mut dyn ImuSource,
    /// True states in order of time; none writes no ground truth.
    pub truth: &'a mut dyn Iterator<Item = TruthState>,
}

/// Counts of what was written.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Written {
    /// Frames read from the source.
    pub frames: u64,
    /// Image files of both cameras.
    pub images: u64,
    /// Inertial samples.
    pub imu_samples: u64,
    /// Rows of ground truth.
    pub truth_rows: u64,
}

/// Writes the inputs to `out/mav0`, calling `progress` after each frame with their number so far. With `overwrite` it replaces
/// the `mav0` of a directory that is not empty, whose other files are left alone. On failure nothing of it is left.
///
/// # Errors
/// When `out` is not empty and not to be overwritten, a source fails, or the disk does.
pub fn write(
    out: &Path,
    inputs: WriteInputs<'_>,
    overwrite: bool,
    progress: &mut dyn FnMut(u64),
) -> Result<Written, DriverError> {
    let partial = Partial::begin(out, overwrite)?;
    let mut written = Written::default();
    let cameras = &inputs.config.camera;
    write_images(&partial.folder, cameras, inputs.stereo, &mut written, progress)?;
    written.imu_samples = write_imu(&partial.folder, inputs.config, inputs.imu)?;
    written.truth_rows = write_truth(&partial.folder, inputs.truth)?;
    partial.complete()?;
    Ok(written)
}

/// The unfinished data set; dropped before it is complete it takes its files along.
struct Partial {
    out: PathBuf,
    folder: PathBuf,
    created_out: bool,
    done: bool,
}

impl Partial {
    fn begin(out: &Path, overwrite: bool) -> Result<Self, DriverError> {
        let created_out = !out.exists();
        if !created_out && !overwrite && holds_anything(out)? {
            let message = "exists and is not empty; choose another directory, or replace what is there with --overwrite";
            return Err(DriverError::refused(out, message));
        }
        let folder = out.join(PARTIAL);
        remove_if_there(&folder)?;
        create_dir(&folder)?;
        Ok(Self { out: out.into(), folder, created_out, done: false })
    }

    fn complete(mut self) -> Result<(), DriverError> {
        let target = self.out.join("mav0");
        remove_if_there(&target)?;
        fs::rename(&self.folder, &target).map_err(|e| DriverError::io(&target, e))?;
        self.done = true;
        Ok(())
    }
}

impl Drop for Partial {
    fn drop(&mut self) {
        if self.done {
            return;
        }
        // Already on the way out with an error; what stays behind is marked by its name.
        let _ = fs::remove_dir_all(&self.folder);
        if self.created_out {
            let _ = fs::remove_dir(&self.out);
        }
    }
}

/// True if a directory holds more than the remains of a killed run.
fn holds_anything(dir: &Path) -> Result<bool, DriverError> {
    let entries = fs::read_dir(dir).map_err(|e| DriverError::io(dir, e))?;
    Ok(entries.flatten().any(|entry| entry.file_name() != PARTIAL))
}

fn remove_if_there(dir: &Path) -> Result<(), DriverError> {
    match fs::remove_dir_all(dir) {
        Err(e) if e.kind() != std::io::ErrorKind::NotFound => Err(DriverError::io(dir, e)),
        _ => Ok(()),
    }
}

fn create_dir(dir: &Path) -> Result<(), DriverError> {
    fs::create_dir_all(dir).map_err(|e| DriverError::io(dir, e))
}

/// Writes a table of rows under a header, and returns their number.
fn write_table(
    path: &Path,
    header: &str,
    rows: impl Iterator<Item = Result<String, DriverError>>,
) -> Result<u64, DriverError> {
    let failed = |e| DriverError::io(path, e);
    let mut file = BufWriter::new(File::create(path).map_err(failed)?);
    writeln!(file, "{header}").map_err(failed)?;
    let mut count = 0;
    for row in rows {
        writeln!(file, "{}", row?).map_err(failed)?;
        count += 1;
    }
    file.flush().map_err(failed)?;
    Ok(count)
}

fn write_images(
    root: &Path,
    cameras: &[CameraConfig],
    source: &mut dyn StereoSource,
    written: &mut Written,
    progress: &mut dyn FnMut(u64),
) -> Result<(), DriverError> {
    let mut tables = Vec::new();
    let mut sizes_px = [(0, 0); 2];
    for (camera, (calibration, size)) in cameras.iter().zip(&mut sizes_px).enumerate() {
        let folder = root.join(format!("cam{camera}"));
        create_dir(&folder.join("data"))?;
        write_text(&folder.join("sensor.yaml"), &camera_yaml(camera, calibration))?;
        tables.push((folder, Vec::new()));
        *size = (calibration.width_px, calibration.height_px);
    }
    let mut frame = StereoFrame::new(sizes_px);
    while source.next_frame(&mut frame)? {
        for (camera, (folder, table)) in tables.iter_mut().enumerate() {
            if !frame.valid[camera] {
                continue;
            }
            let mut name = format!("{}.png", frame.stamp.as_nanos());
            let folder = folder.join("data");
            if folder.join(&name).exists() {
                // The clock was set back: the stamp is that of an earlier frame.
                name = format!("{}-{}.png", frame.stamp.as_nanos(), written.frames);
            }
            write_png(&folder.join(&name), &frame.images[camera])?;
            table.push(Ok(format!("{},{name}", frame.stamp.as_nanos())));
            written.images += 1;
        }
        written.frames += 1;
        progress(written.frames);
    }
    for (folder, table) in tables {
        write_table(&folder.join("data.csv"), IMAGE_HEADER, table.into_iter())?;
    }
    Ok(())
}

/// 8-bit grey, with the compression that costs least time for its size.
fn write_png(path: &Path, image: &GrayImage) -> Result<(), DriverError> {
    let fail = |e: png::EncodingError| DriverError::io(path, std::io::Error::other(e));
    let file = File::create(path).map_err(|e| DriverError::io(path, e))?;
    let mut encoder = Encoder::new(BufWriter::new(file), image.width() as u32, image.height() as u32);
    encoder.set_color(ColorType::Grayscale);
    encoder.set_depth(BitDepth::Eight);
    encoder.set_compression(Compression::Fast);
    let mut writer = encoder.write_header().map_err(fail)?;
    writer.write_image_data(image.pixels()).map_err(fail)?;
    writer.finish().map_err(fail)
}

fn write_imu(root: &Path, config: &Config, source: &mut dyn ImuSource) -> Result<u64, DriverError> {
    let folder = root.join("imu0");
    create_dir(&folder)?;
    write_text(&folder.join("sensor.yaml"), &imu_yaml(&config.imu, config.vehicle.imu_to_vehicle_deg))?;
    let row = |reading: ImuReading| {
        let (stamp, w, a) = (reading.sample.stamp.as_nanos(), reading.sample.gyro, reading.sample.accel);
        format!("{stamp},{},{},{},{},{},{}", w.x, w.y, w.z, a.x, a.y, a.z)
    };
    let readings = std::iter::from_fn(|| source.next_reading().transpose());
    write_table(&folder.join("data.csv"), IMU_HEADER, readings.map(|reading| reading.map(row)))
}

fn write_truth(root: &Path, truth: &mut dyn Iterator<Item = TruthState>) -> Result<u64, DriverError> {
    let mut truth = truth.peekable();
    if truth.peek().is_none() {
        return Ok(0);
    }
    let folder = root.join("state_groundtruth_estimate0");
    create_dir(&folder)?;
    write_table(&folder.join("data.csv"), TRUTH_HEADER, truth.map(|state| Ok(truth_row(&state))))
}

fn truth_row(state: &TruthState) -> String {
    let (p, q) = (state.pose_w_b.translation.vector, state.pose_w_b.rotation.coords);
    let mut row =
        format!("{},{},{},{},{},{},{},{}", state.stamp.as_nanos(), p.x, p.y, p.z, q.w, q.x, q.y, q.z);
    for v in [state.v_w_b, state.bias_gyro, state.bias_accel] {
        // Writing to a string cannot fail.
        let _ = write!(row, ",{},{},{}", v.x, v.y, v.z);
    }
    row
}

fn write_text(path: &Path, text: &str) -> Result<(), DriverError> {
    fs::write(path, text).map_err(|e| DriverError::io(path, e))
}

/// Lenses as Kalibr names them; the rational one, which it lacks, as ROS does.
fn camera_yaml(index: usize, camera: &CameraConfig) -> String {
    let (model, first, lens, rest) = match camera.distortion {
        Distortion::RadialTangential { .. } => ("pinhole", 0, "radial-tangential", "fu, fv, cu, cv"),
        Distortion::Equidistant { .. } => ("pinhole", 0, "equidistant", "fu, fv, cu, cv"),
        Distortion::Rational { .. } => ("pinhole", 0, "rational_polynomial", "fu, fv, cu, cv"),
        Distortion::Omni { .. } => ("omni", 1, "radial-tangential", "xi, fu, fv, cu, cv"),
        Distortion::Eucm { .. } => ("eucm", 2, "none", "alpha, beta, fu, fv, cu, cv"),
        Distortion::DoubleSphere { .. } => ("ds", 2, "none", "xi, alpha, fu, fv, cu, cv"),
    };
    let numbers = |values: &[f64]| values.iter().map(f64::to_string).collect::<Vec<_>>().join(", ");
    let coefficients: Vec<f64> = camera.distortion.coefficients().iter().map(|(_, k)| *k).collect();
    let (of_projection, of_distortion) = coefficients.split_at(first);
    let intrinsics = [of_projection, &camera.focal_px, &camera.centre_px].concat();
    format!(
        "# General sensor definitions.\nsensor_type: camera\ncomment: cam{index}\n\n\
         # Sensor extrinsics wrt. the body-frame.\n{}\n\
         # Camera specific definitions.\nrate_hz: {}\nresolution: [{}, {}]\ncamera_model: {model}\n\
         intrinsics: [{}] #{rest}\ndistortion_model: {lens}\n\
         distortion_coefficients: [{}]\n",
        extrinsics_yaml(&camera.pose_b_c),
        camera.rate_hz,
        camera.width_px,
        camera.height_px,
        numbers(&intrinsics),
        numbers(of_distortion),
    )
}

fn imu_yaml(imu: &ImuConfig, mounting: Mounting) -> String {
    let mounting = match mounting {
        Mounting::Known(degrees) => format!("{degrees:?}"),
        Mounting::Unknown => Mounting::UNKNOWN.to_owned(),
    };
    let identity = std::array::from_fn(|i| std::array::from_fn(|j| f64::from(u8::from(i == j))));
    format!(
        "# General sensor definitions.\nsensor_type: imu\ncomment: imu0\n\n\
         # Sensor extrinsics wrt. the body-frame.\n{}\n\
         # Inertial sensor noise model parameters.\nrate_hz: {}\n\
         gyroscope_noise_density: {} # [ rad / s / sqrt(Hz) ]\n\
         gyroscope_random_walk: {} # [ rad / s^2 / sqrt(Hz) ]\n\
         accelerometer_noise_density: {} # [ m / s^2 / sqrt(Hz) ]\n\
         accelerometer_random_walk: {} # [ m / s^3 / sqrt(Hz) ]\n\n\
         # Mounting in the vehicle: roll, pitch, yaw in degrees (vehicle.imu_to_vehicle_deg of Plumbline).\n\
         imu_to_vehicle_deg: {mounting}\n",
        extrinsics_yaml(&identity),
        imu.rate_hz,
        imu.gyro_noise_density,
        imu.gyro_bias_walk,
        imu.accel_noise_density,
        imu.accel_bias_walk,
    )
}

fn extrinsics_yaml(rows: &[[f64; 4]; 4]) -> String {
    let rows = rows.map(|row| row.map(|x| format!("{x:?}")).join(", ")).join(",\n         ");
    format!("T_BS:\n  cols: 4\n  rows: 4\n  data: [{rows}]\n")
}
