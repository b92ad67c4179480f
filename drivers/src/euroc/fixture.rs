//! Fixtures of this crate's tests: a small data set made on the spot, and the paths of the real clips.

use super::{EurocDataset, EurocOptions};
use crate::{DriverError, ImuReading, ImuSource, StereoFrame, StereoSource};
use png::{BitDepth, ColorType, Encoder};
use std::fmt::Write as _;
use std::path::PathBuf;

/// First stamp of the small data set, ns.
pub(crate) const START_NS: i64 = 1_403_715_273_262_142_976;
/// Size of its images, px.
pub(crate) const SIZE: (usize, usize) = (16, 12);
/// Its frames; 20 Hz, with IMU at 200 Hz from the first to 50 ms after the last.
pub(crate) const FRAMES: i64 = 12;

/// Stamp of frame `i`, ns.
pub(crate) fn frame_ns(i: i64) -> i64 {
    START_NS + i * 50_000_000
}

/// A grey PNG of a plain colour.
pub(crate) fn plain_png((width, height): (usize, usize), grey: u8) -> Vec<u8> {
    let mut file = Vec::new();
    let mut encoder = Encoder::new(&mut file, width as u32, height as u32);
    encoder.set_color(ColorType::Grayscale);
    encoder.set_depth(BitDepth::Eight);
    encoder.write_header().unwrap().write_image_data(&vec![grey; width * height]).unwrap();
    file
}

/// A data set in a temporary directory, to be damaged by a test.
pub(crate) struct Sample {
    pub(crate) dir: tempfile::TempDir,
}

impl Sample {
    /// A sound stereo data set; frame `i` is of grey `i` left and `100 + i` right.
    pub(crate) fn new() -> Self {
        let sample = Self { dir: tempfile::tempdir().unwrap() };
        for camera in 0..2_i64 {
            let folder = sample.path(&format!("cam{camera}/data"));
            std::fs::create_dir_all(&folder).unwrap();
            let mut table = String::from("#timestamp [ns],filename\r\n");
            for i in 0..FRAMES {
                let t = frame_ns(i);
                writeln!(table, "{t},{t}.png\r").unwrap();
                std::fs::write(folder.join(format!("{t}.png")), plain_png(SIZE, (100 * camera + i) as u8))
                    .unwrap();
            }
            sample.put(&format!("cam{camera}/data.csv"), &table);
        }
        std::fs::create_dir_all(sample.path("imu0")).unwrap();
        let rows: Vec<String> = (0..FRAMES * 10).map(Self::imu_row).collect();
        sample.put("imu0/data.csv", rows.join("\n"));
        sample
    }

    /// Row `i` of the inertial table.
    pub(crate) fn imu_row(i: i64) -> String {
        format!("{},0.{i:03},-0.02,0.07,9.08,0.13,-3.69", START_NS + i * 5_000_000)
    }

    /// A path within `mav0`.
    pub(crate) fn path(&self, inside: &str) -> PathBuf {
        self.dir.path().join("mav0").join(inside)
    }

    /// The image file of frame `i`.
    pub(crate) fn image(&self, camera: usize, i: i64) -> PathBuf {
        self.path(&format!("cam{camera}/data/{}.png", frame_ns(i)))
    }

    /// Replaces a file.
    pub(crate) fn put(&self, inside: &str, content: impl AsRef<[u8]>) {
        std::fs::write(self.path(inside), content).unwrap();
    }

    /// Changes the lines of a table.
    pub(crate) fn edit(&self, inside: &str, change: impl FnOnce(&mut Vec<String>)) {
        let text = std::fs::read_to_string(self.path(inside)).unwrap();
        let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
        change(&mut lines);
        self.put(inside, lines.join("\n"));
    }

    pub(crate) fn open(&self) -> Result<EurocDataset, DriverError> {
        EurocDataset::open(self.dir.path(), &EurocOptions::default())
    }

    /// The one line that says why the data set does not open.
    pub(crate) fn refusal(&self) -> String {
        let message = self.open().expect_err("must be refused").to_string();
        assert!(!message.contains('\n'), "{message}");
        message
    }
}

/// All frames of a source.
pub(crate) fn all_frames(source: &mut dyn StereoSource, sizes_px: [(usize, usize); 2]) -> Vec<StereoFrame> {
    let mut frame = StereoFrame::new(sizes_px);
    let mut frames = Vec::new();
    while source.next_frame(&mut frame).unwrap() {
        frames.push(frame.clone());
    }
    frames
}

/// All readings of a source.
pub(crate) fn all_readings(source: &mut dyn ImuSource) -> Vec<ImuReading> {
    std::iter::from_fn(|| source.next_reading().unwrap()).collect()
}
