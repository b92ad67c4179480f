//! Rendered frames on disk, raw: rendering takes far longer than estimating.
//!
//! A file holds, for each frame in order, the pixels of all cameras. Its name is a hash of everything the images depend
//! on.

use super::FlightError;
use indicatif::{ProgressBar, ProgressStyle};
use plumbline_config::GrayImage;
use plumbline_drivers::{DriverError, StereoFrame, StereoSource};
use plumbline_simulator::{FlightPath, ImuEffects, Inertial, IntrinsicsError, Scenario, Simulator};
use sha2::{Digest as _, Sha256};
use std::fs::{File, OpenOptions};
use std::io::{BufReader, BufWriter, ErrorKind, Read, Seek, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

/// Changes when the renderer draws differently.
const RENDERER_VERSION: u32 = 3;
/// A rendering that has written nothing for so long may have been killed.
const ABANDONED_AFTER: Duration = Duration::from_secs(60);

/// The frames of `simulator` from the cache; those that are not there are rendered first.
///
/// # Errors
/// When the cache cannot be written or read.
pub(crate) fn frames(
    folder: &Path,
    simulator: &Simulator,
    scenario: &Scenario,
) -> Result<Box<dyn StereoSource>, FlightError> {
    let failed = |path: &Path| {
        let path = path.to_owned();
        |source| FlightError::Cache { path, source }
    };
    let path = folder.join(format!("{}.raw", key(simulator, scenario)?));
    let file = if is_whole(&path, simulator)? {
        File::open(&path).map_err(failed(&path))?
    } else {
        std::fs::create_dir_all(folder).map_err(failed(folder))?;
        remove_abandoned(folder);
        render(&path, simulator).map_err(failed(&path))?
    };
    Ok(Box::new(CachedFrames { simulator: simulator.clone(), file: BufReader::new(file), path, next: 0 }))
}

/// A hash of everything that the images depend on.
fn key(simulator: &Simulator, scenario: &Scenario) -> Result<String, FlightError> {
    let cameras = &simulator.config().camera;
    let mut sound = scenario.clone();
    let mut hash = Sha256::new();
    // What files hold counts, and not their names.
    let mut add = |file: &Path| {
        let bytes = std::fs::read(file);
        bytes
            .map(|bytes| hash.update(bytes))
            .map_err(|source| FlightError::Cache { path: file.into(), source })
    };
    if let FlightPath::Tum(file) = &scenario.path {
        sound.path = FlightPath::Demo;
        add(file)?;
    }
    // The path is made to agree with samples that were recorded along it; otherwise images know nothing of samples, nor of what
    // is believed of the rig.
    sound.inertial = match &scenario.inertial {
        Inertial::Recorded(file) => {
            add(file)?;
            Inertial::Recorded("".into())
        }
        Inertial::Simulated => Inertial::Simulated,
    };
    sound.imu = ImuEffects::default();
    sound.calibration_error = 0.0;
    sound.intrinsics_error = IntrinsicsError::default();
    hash.update(format!("{RENDERER_VERSION} {sound:?} {cameras:?}"));
    Ok(hash.finalize().iter().take(12).map(|b| format!("{b:02x}")).collect())
}

/// Whether there is a file at `path`, which holds all frames then.
fn is_whole(path: &Path, simulator: &Simulator) -> Result<bool, FlightError> {
    let frame_bytes: usize = simulator.image_sizes().iter().map(|(width, height)| width * height).sum();
    match std::fs::metadata(path) {
        Ok(about) if about.len() == simulator.frame_count() * frame_bytes as u64 => Ok(true),
        Ok(_) => Err(FlightError::CacheIncomplete { path: path.to_owned() }),
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(false),
        Err(source) => Err(FlightError::Cache { path: path.to_owned(), source }),
    }
}

/// Removes what renderings have left that were killed: nobody holds it locked any more.
fn remove_abandoned(folder: &Path) {
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let is_partial =
            entry.path().extension().is_some_and(|e| e.to_string_lossy().starts_with("partial-"));
        let modified = entry.metadata().and_then(|about| about.modified()).ok();
        let is_old = modified.and_then(|at| at.elapsed().ok()).is_some_and(|age| age > ABANDONED_AFTER);
        if is_partial && is_old && File::open(entry.path()).is_ok_and(|file| file.try_lock().is_ok()) {
            let _ = std::fs::remove_file(entry.path());
        }
    }
}

/// Renders the file at `path`, open at its beginning.
fn render(path: &Path, simulator: &Simulator) -> std::io::Result<File> {
    // Others may be rendering the same flight: each into a file of its own.
    static RENDERINGS: AtomicU64 = AtomicU64::new(0);
    let number = RENDERINGS.fetch_add(1, Ordering::Relaxed);
    let partial = path.with_extension(format!("partial-{}-{number}", std::process::id()));
    let file = OpenOptions::new().read(true).write(true).create(true).truncate(true).open(&partial)?;
    file.lock()?;
    let mut out = BufWriter::new(file);
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
    let mut file = out.into_inner()?;
    file.sync_all()?;
    file.rewind()?;
    std::fs::rename(partial, path)?;
    Ok(file)
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
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::flight::scenario_config;
    use nalgebra::{Isometry3, UnitQuaternion, Vector3};
    use plumbline_config::Timestamp;
    use plumbline_drivers::StampedPose;
    use plumbline_drivers::tum::write_tum;
    use plumbline_simulator::Effects;

    /// A turn in a circle, written to a file.
    fn path(folder: &Path, name: &str) -> FlightPath {
        let poses: Vec<StampedPose> = (0..800)
            .map(|i| {
                let t = f64::from(i) * 0.005;
                let position = Vector3::new((0.8 * t).sin(), (0.8 * t).cos(), 1.2);
                let rotation = UnitQuaternion::from_euler_angles(0.1 * t.sin(), 0.0, -0.8 * t);
                let stamp = Timestamp::from_nanos(5_000_000_000 + i64::from(i) * 5_000_000);
                StampedPose { stamp, pose: Isometry3::from_parts(position.into(), rotation) }
            })
            .collect();
        let file = folder.join(name);
        write_tum(&file, &poses).unwrap();
        FlightPath::Tum(file)
    }

    fn scenario(path: FlightPath, duration_s: f64) -> Scenario {
        Scenario { path, duration_s, resolution_scale: 0.1, ..Scenario::default() }
    }

    fn simulator(scenario: &Scenario) -> Simulator {
        Simulator::new(&scenario_config(None, false).unwrap(), scenario).unwrap()
    }

    fn all_frames(mut source: Box<dyn StereoSource>, simulator: &Simulator) -> Vec<StereoFrame> {
        let mut frame = StereoFrame::new(simulator.image_sizes());
        let mut frames = Vec::new();
        while source.next_frame(&mut frame).unwrap() {
            frames.push(frame.clone());
        }
        frames
    }

    /// The frames by way of the cache are those that the simulator renders.
    fn assert_sound(cache: &Path, scenario: &Scenario) {
        let simulator = simulator(scenario);
        let cached = all_frames(frames(cache, &simulator, scenario).unwrap(), &simulator);
        let rendered = all_frames(Box::new(simulator.stereo()), &simulator);
        assert_eq!(cached.len() as u64, simulator.frame_count());
        for (cached, rendered) in cached.iter().zip(&rendered) {
            assert_eq!((cached.sequence, cached.stamp), (rendered.sequence, rendered.stamp));
            assert!(cached.images == rendered.images, "frame {}", cached.sequence);
        }
    }

    fn files(cache: &Path) -> Vec<(PathBuf, u64)> {
        let entries = std::fs::read_dir(cache).unwrap().map(Result::unwrap);
        entries.map(|entry| (entry.path(), entry.metadata().unwrap().len())).collect()
    }

    #[test]
    fn what_is_there_is_not_rendered_again() {
        let folder = tempfile::tempdir().unwrap();
        let cache = folder.path().join("cache");
        let along = |name: &str| scenario(path(folder.path(), name), 0.5);
        assert_sound(&cache, &along("path.tum"));
        let [(file, bytes)] = &files(&cache)[..] else { panic!("one file") };
        let written = file.metadata().unwrap().modified().unwrap();
        // The same path by another name.
        assert_sound(&cache, &along("copy.tum"));
        assert_eq!(files(&cache), [(file.clone(), *bytes)]);
        assert_eq!(file.metadata().unwrap().modified().unwrap(), written, "nothing was rendered");
    }

    #[test]
    fn what_images_depend_on_has_a_file_of_its_own() {
        let folder = tempfile::tempdir().unwrap();
        let base = scenario(path(folder.path(), "path.tum"), 0.2);
        let dark = Effects { gain: 0.5, ..Effects::default() };
        let others = [
            Scenario { seed: 2, ..base.clone() },
            Scenario { start_s: 0.5, ..base.clone() },
            Scenario { effects: dark, ..base.clone() },
            Scenario { duration_s: 0.3, ..base.clone() },
            scenario(FlightPath::Demo, 0.2),
        ];
        for other in std::iter::once(&base).chain(&others) {
            assert_sound(folder.path(), other);
        }
        let kept = files(folder.path()).into_iter().filter(|(path, _)| path.extension().unwrap() == "raw");
        assert_eq!(kept.count(), 1 + others.len());
    }

    #[test]
    fn what_a_killed_rendering_has_left_is_removed() {
        let folder = tempfile::tempdir().unwrap();
        let [killed, alive] = ["a.partial-1-0", "b.partial-1-0"].map(|name| folder.path().join(name));
        let files = [&killed, &alive].map(|path| File::create(path).unwrap());
        let long_ago = std::time::SystemTime::now() - 2 * ABANDONED_AFTER;
        files.iter().for_each(|file| file.set_modified(long_ago).unwrap());
        files[1].lock().unwrap();
        assert_sound(folder.path(), &scenario(FlightPath::Demo, 0.2));
        assert_eq!((killed.exists(), alive.exists()), (false, true));
    }

    #[test]
    fn a_file_that_ends_within_a_frame_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let scenario = scenario(FlightPath::Demo, 0.2);
        assert_sound(folder.path(), &scenario);
        let (file, bytes) = files(folder.path()).remove(0);
        OpenOptions::new().write(true).open(&file).unwrap().set_len(bytes - 1).unwrap();
        let error = frames(folder.path(), &simulator(&scenario), &scenario).err().unwrap();
        assert!(error.to_string().contains("delete it"), "{error}");
    }
}
