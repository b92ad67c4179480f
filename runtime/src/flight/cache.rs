//! Rendered frames on disk, raw: rendering takes far longer than estimating.
//!
//! A file holds, for each frame in order, the pixels of all cameras. Its name is a hash of everything the images depend
//! on; what goes wrong with finished frames is done anew each time.

use super::FlightError;
use indicatif::{ProgressBar, ProgressStyle};
use plumbline_config::GrayImage;
use plumbline_drivers::simulator::{Scenario, Simulator};
use plumbline_drivers::{DriverError, Faults, FaultySource, FrameFaults, StereoFrame, StereoSource};
use sha2::{Digest as _, Sha256};
use std::fs::File;
use std::io::{BufReader, BufWriter, Read, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

/// Changes when the renderer draws differently.
const RENDERER_VERSION: u32 = 2;

/// The frames of `simulator` from the cache, rendered first if they are not there.
///
/// # Errors
/// When the cache cannot be written or read.
pub(super) fn frames(
    folder: &Path,
    simulator: &Simulator,
    scenario: &Scenario,
) -> Result<Box<dyn StereoSource>, FlightError> {
    let failed = |path: &Path| {
        let path = path.to_owned();
        |source| FlightError::Cache { path, source }
    };
    let path = folder.join(format!("{}.raw", key(simulator, scenario)));
    if !path.exists() {
        std::fs::create_dir_all(folder).map_err(failed(folder))?;
        render(&path, simulator).map_err(failed(&path))?;
    }
    let file = File::open(&path).map_err(failed(&path))?;
    let length = file.metadata().map_err(failed(&path))?.len();
    let pixels: u64 = simulator.image_sizes().iter().map(|(w, h)| (w * h) as u64).sum();
    if length != simulator.frame_count() * pixels {
        return Err(FlightError::CacheIncomplete { path });
    }
    let source = CachedFrames { simulator: simulator.clone(), file: BufReader::new(file), path, next: 0 };
    Ok(Box::new(FaultySource::new(source, scenario.effects.frames.clone(), scenario.seed)))
}

fn key(simulator: &Simulator, scenario: &Scenario) -> String {
    let cameras = &simulator.config().camera;
    let mut sound = scenario.clone();
    sound.effects.frames = FrameFaults::default();
    let text = format!("{RENDERER_VERSION} {sound:?} {cameras:?}");
    Sha256::digest(text.as_bytes()).iter().take(12).map(|b| format!("{b:02x}")).collect()
}

fn render(path: &Path, simulator: &Simulator) -> std::io::Result<()> {
    // Others may be rendering the same flight: each into a file of its own.
    static RENDERINGS: AtomicU64 = AtomicU64::new(0);
    let number = RENDERINGS.fetch_add(1, Ordering::Relaxed);
    let partial = path.with_extension(format!("partial-{}-{number}", std::process::id()));
    let mut out = BufWriter::new(File::create(&partial)?);
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let mut painters: Vec<_> =
        (0..threads).map(|_| (simulator.scratch(), StereoFrame::new(simulator.image_sizes()))).collect();
    let progress = progress(simulator.frame_count());
    let mut first = 0;
    while first < simulator.frame_count() {
        let count = (simulator.frame_count() - first).min(threads as u64) as usize;
        std::thread::scope(|scope| {
            for (index, (scratch, frame)) in (first..).zip(&mut painters[..count]) {
                scope.spawn(move || simulator.render_frame(index, scratch, frame));
            }
        });
        for (_, frame) in &painters[..count] {
            for image in &frame.images {
                out.write_all(image.pixels())?;
            }
        }
        progress.inc(count as u64);
        first += count as u64;
    }
    progress.finish_and_clear();
    out.into_inner()?.sync_all()?;
    std::fs::rename(partial, path)
}

fn progress(frames: u64) -> ProgressBar {
    let style = ProgressStyle::with_template("rendering {bar:32} {pos}/{len} frames  {elapsed} (eta {eta})");
    ProgressBar::new(frames).with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()))
}

/// Frames read back from a file.
struct CachedFrames {
    simulator: Simulator,
    file: BufReader<File>,
    path: PathBuf,
    next: u64,
}

impl CachedFrames {
    fn read(&mut self, frame: &mut StereoFrame) -> std::io::Result<()> {
        for (image, (width, height)) in frame.images.iter_mut().zip(self.simulator.image_sizes()) {
            if (image.width(), image.height()) != (width, height) {
                *image = GrayImage::new(width, height);
            }
            self.file.read_exact(image.pixels_mut())?;
        }
        frame.sequence = self.next;
        frame.stamp = self.simulator.frame_stamp(self.next);
        frame.valid = [true, self.simulator.camera_count() == 2];
        self.next += 1;
        Ok(())
    }
}

impl StereoSource for CachedFrames {
    fn next_frame(&mut self, frame: &mut StereoFrame) -> Result<bool, DriverError> {
        if self.next >= self.simulator.frame_count() {
            return Ok(false);
        }
        self.read(frame).map_err(|source| DriverError::Io { path: self.path.clone(), source })?;
        Ok(true)
    }

    fn expected_frames(&self) -> Option<u64> {
        Some(self.simulator.frame_count())
    }

    fn faults(&self) -> Faults {
        Faults::default()
    }
}
