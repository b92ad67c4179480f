//! Data sets in the ASL format of the EuRoC MAV data set (Burri et al., 2016): read and written.
//!
//! ```text
//! DATASET/mav0/cam0/data.csv, data/*.png           left camera (PNG or baseline JPEG)
//!              cam1/data.csv, data/*.png           right camera, may be absent (monocular)
//!              imu0/data.csv                       inertial samples
//!              state_groundtruth_estimate0/data.csv   truth, may be absent; or mocap0 (TUM-VI), vicon0
//! ```
//!
//! [`EurocDataset::open`] reads the tables, pairs the images by time and refuses, in one line, what is no
//! data set; [`EurocDataset::stereo`] and [`EurocDataset::imu`] are the sources. What can be survived is
//! counted in [`Faults`]: rows that are torn or out of order, images that are missing, cut
//! off, of the wrong size or without a partner. [`write()`] makes such a data set of any sources.

pub(crate) mod defects;
pub(crate) mod depth;
mod files;
pub(crate) mod frames;
pub(crate) mod image;
pub(crate) mod imu;
pub(crate) mod order;
pub(crate) mod pairing;
pub(crate) mod picture;
pub(crate) mod span;
mod stereo;
pub(crate) mod table;
pub(crate) mod truth;
mod writer;

#[cfg(test)]
pub(crate) mod fixture;
#[cfg(test)]
mod tests;

pub use defects::{Defect, FileDefects};
pub use image::read_gray_png;
pub use imu::EurocImu;
pub use stereo::EurocStereo;
pub use truth::{ground_truth_table, is_of_positions, read_ground_truth};
pub use writer::{WriteInputs, Written, write};

use crate::{DriverError, Faults, StereoFrame, TruthState};
use depth::Depth;
use frames::{Frames, frames_span};
use imu::{IMU_COLUMNS, parse_imu_row};
use pairing::{IMAGE_COLUMNS, ImageRow, parse_image_row};
use plumbline_config::{Config, ImuSample, Timestamp};
use span::imu_of;
use std::ops::Range;
use std::path::{Path, PathBuf};
use table::{Table, read_table};

/// Options of reading a data set: which part is handed out, and what is required of it.
#[derive(Clone, Debug, PartialEq)]
pub struct EurocOptions {
    /// Frames to hand out, counted from 0 over the paired frames; `None` for all. Clipped at the end.
    pub frames: Option<Range<usize>>,
    /// Frames to hand out by their time, seconds since the first frame of the data set; both bounds of
    /// frames and of seconds hold.
    pub seconds: Range<f64>,
    /// Largest difference of stamps within a stereo pair, s.
    pub pair_tolerance_s: f64,
    /// Expected image sizes in pixels, left and right, one a camera that is used: with one entry `cam1`
    /// is left alone. Empty: as many cameras as there are, of the size of their first image.
    pub sizes_px: Vec<(usize, usize)>,
    /// Inertial samples are required. Otherwise they are not read, and [`EurocDataset::imu`] is empty.
    pub with_imu: bool,
}

impl Default for EurocOptions {
    fn default() -> Self {
        Self {
            frames: None,
            seconds: 0.0..f64::INFINITY,
            pair_tolerance_s: 0.002,
            sizes_px: Vec::new(),
            with_imu: true,
        }
    }
}

impl EurocOptions {
    /// All frames, for the cameras of a configuration.
    pub fn for_config(config: &Config) -> Self {
        Self {
            pair_tolerance_s: config.driver.pair_tolerance_s,
            sizes_px: config.camera.iter().map(|c| (c.width_px, c.height_px)).collect(),
            ..Self::default()
        }
    }
}

/// An opened data set: tables in memory, images on disk.
#[derive(Debug)]
pub struct EurocDataset {
    root: PathBuf,
    sizes_px: Vec<(usize, usize)>,
    frames: Frames,
    depth: Depth,
    imu: EurocImu,
    defects: Vec<Defect>,
    file_defects: FileDefects,
}

impl EurocDataset {
    /// Opens the data set at `path`: the directory that holds `mav0`, or `mav0` itself.
    ///
    /// # Errors
    /// When it is no such directory, a table is missing or of no use, no image can be read, the images
    /// are not of the expected size, or the IMU was off while the images were taken.
    pub fn open(path: &Path, options: &EurocOptions) -> Result<Self, DriverError> {
        let root = find_root(path)?;
        let cameras = count_cameras(&root, options);
        let mut image_faults = Faults::default();
        let mut sizes_px = Vec::new();
        let (mut rows, mut orders) = (Vec::new(), Vec::new());
        for camera in 0..cameras {
            let mut table = read_images(&camera_folder(&root, camera))?;
            files::find_files(&camera_folder(&root, camera).join("data"), &mut table.rows);
            image_faults.corrupt += table.corrupt;
            table.order.add_to(&mut image_faults);
            orders.push((format!("cam{camera}/data.csv"), table.order));
            sizes_px.push(check_size(&root, camera, &table.rows, options)?);
            rows.push(table.rows);
        }
        let mut defects: Vec<Defect> = defects::misnamed_camera(&root).into_iter().collect();
        if let [left, right] = &rows[..] {
            defects.extend(defects::surplus(&root, [left.len(), right.len()]));
        }
        let depth = depth_of(&root, &rows);
        let cure = "are the clocks synchronous? Take cam1 away to fly on one camera";
        let frames = Frames::new(&root, rows, options, cure, image_faults)?;
        let (imu, file_defects) = if options.with_imu {
            let (file, table) = (root.join("imu0/data.csv"), read_imu(&root)?);
            let file_defects = FileDefects::with_rows(table.corrupt, &file, table.first_bad.as_ref());
            orders.push(("imu0/data.csv".into(), table.order));
            let (imu, uncovered) = imu_of(&file, table, &frames)?;
            defects.extend(uncovered);
            (imu, file_defects)
        } else {
            (EurocImu::default(), FileDefects::default())
        };
        defects.extend(defects::of_stamps(&root, &orders, "rows", frames_span(frames.all()).0));
        Ok(Self { root, sizes_px, frames, depth, imu, defects, file_defects })
    }

    /// The directory of the tables (`mav0`).
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// Cameras in use: 1 or 2.
    pub fn cameras(&self) -> usize {
        self.sizes_px.len()
    }

    /// Image sizes in pixels; 0x0 for a camera that is not in use.
    pub fn sizes_px(&self) -> [(usize, usize); 2] {
        [0, 1].map(|camera| self.sizes_px.get(camera).copied().unwrap_or_default())
    }

    /// A frame with buffers of the right size.
    pub fn new_frame(&self) -> StereoFrame {
        StereoFrame::new(self.sizes_px())
    }

    /// Frames that will be handed out.
    pub fn frame_count(&self) -> usize {
        self.frames.rest().len()
    }

    /// Stamps of the first and the last frame that will be handed out.
    pub fn span(&self) -> (Timestamp, Timestamp) {
        frames_span(self.frames.rest())
    }

    /// Defects of the data set as a whole.
    pub fn defects(&self) -> &[Defect] {
        &self.defects
    }

    /// Rows and images that cannot be read: what is found grows while the images are read.
    pub fn file_defects(&self) -> FileDefects {
        self.file_defects.clone()
    }

    /// The image stream, from its beginning.
    pub fn stereo(&self) -> EurocStereo {
        let folders = [0, 1].map(|camera| camera_folder(&self.root, camera).join("data"));
        EurocStereo::new(self.frames.clone(), folders, self.file_defects.clone(), self.depth)
    }

    /// The inertial stream, from 1 s before the first frame to 0.1 s after the last.
    pub fn imu(&self) -> EurocImu {
        self.imu.clone()
    }

    /// The ground truth of the whole data set in order of time, where there is one: of the sensor that measured it, such as the
    /// markers of a motion capture.
    ///
    /// # Errors
    /// When there is one and it cannot be read.
    pub fn ground_truth(&self) -> Result<Option<Vec<TruthState>>, DriverError> {
        let table = ground_truth_table(&self.root).filter(|table| !is_of_positions(table));
        table.map(|table| read_ground_truth(&table)).transpose()
    }
}

fn camera_folder(root: &Path, camera: usize) -> PathBuf {
    root.join(format!("cam{camera}"))
}

fn find_root(path: &Path) -> Result<PathBuf, DriverError> {
    let nested = path.join("mav0");
    if nested.is_dir() {
        return Ok(nested);
    }
    if path.join("cam0").is_dir() || path.join("imu0").is_dir() {
        return Ok(path.into());
    }
    let message = if path.is_dir() {
        "holds no mav0/cam0; give the directory of a EuRoC data set"
    } else if path.exists() {
        "is not a directory; give the directory of a EuRoC data set (unpack it first)"
    } else {
        "does not exist; give the directory of a EuRoC data set"
    };
    Err(DriverError::refused(path, message))
}

fn count_cameras(root: &Path, options: &EurocOptions) -> usize {
    let wanted = if options.sizes_px.is_empty() { 2 } else { options.sizes_px.len() };
    if wanted > 1 && camera_folder(root, 1).is_dir() { 2 } else { 1 }
}

fn require_table(path: &Path, what: &str) -> Result<(), DriverError> {
    if path.is_file() {
        return Ok(());
    }
    Err(DriverError::refused(path, format!("is missing, so there are no {what}; copy the data set again")))
}

fn read_images(folder: &Path) -> Result<Table<ImageRow>, DriverError> {
    let path = folder.join("data.csv");
    require_table(&path, "images")?;
    read_table(&path, IMAGE_COLUMNS, parse_image_row)
}

/// All inertial samples of the data set at `path`, or of the table of inertial samples at `path`, in order of time.
///
/// # Errors
/// When it is neither, or holds none.
pub fn read_imu_samples(path: &Path) -> Result<Vec<ImuSample>, DriverError> {
    let table = if path.is_dir() { find_root(path)?.join("imu0/data.csv") } else { path.to_owned() };
    require_table(&table, "inertial samples")?;
    Ok(read_table(&table, IMU_COLUMNS, parse_imu_row)?.rows)
}

fn read_imu(root: &Path) -> Result<Table<ImuSample>, DriverError> {
    let path = root.join("imu0/data.csv");
    require_table(&path, "inertial samples")?;
    read_table(&path, IMU_COLUMNS, parse_imu_row)
}

/// The size of the camera's images by the first one that can be read, checked against the expected.
fn check_size(
    root: &Path,
    camera: usize,
    rows: &[ImageRow],
    options: &EurocOptions,
) -> Result<(usize, usize), DriverError> {
    let folder = camera_folder(root, camera).join("data");
    let Some(found) = files::size_px(&folder, rows) else {
        let message = files::unreadable(&folder, rows);
        return Err(DriverError::refused(folder, message));
    };
    match options.sizes_px.get(camera) {
        Some(&expected) if expected != found => {
            let message = format!(
                "images are {}x{}, but the configuration says {}x{} for camera {camera}; \
                 use the calibration of this data set",
                found.0, found.1, expected.0, expected.1
            );
            Err(DriverError::refused(folder, message))
        }
        _ => Ok(found),
    }
}

/// Bits of 16-bit images that are in use, the same for all cameras.
fn depth_of(root: &Path, rows: &[Vec<ImageRow>]) -> Depth {
    let looked_at = |(camera, rows): (usize, &Vec<ImageRow>)| {
        files::largest_value(&camera_folder(root, camera).join("data"), rows)
    };
    rows.iter().enumerate().filter_map(looked_at).max().map_or(Depth::FULL, Depth::of_largest)
}
