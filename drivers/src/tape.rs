//! A recording copied to disk, to be played forward and backward.
//!
//! Played backward, a flight `x(t)` becomes `y(s) = x(2 T - s)` with the last frame at `T`. Every sample of `y` is a sample of `x`:
//!
//! - Images are those of the same poses, in reverse order.
//! - Angular rate: from `dR/dt = R [w]x` follows `dR(2T-s)/ds = -R [w]x`, so the gyroscope reads `-w`.
//! - Specific force: the second derivative `d2p/ds2 = d2p/dt2` keeps its sign, and so does gravity. The accelerometer reads the same.
//! - Biases: that of the accelerometer stays. That of the gyroscope changes its sign with the reading. Velocity changes its sign too.
//!   One estimate that went on through the turn would see both jump. So each direction has an estimator of its own.
//! - Time offset of the cameras: `t_imu = t_camera + d` becomes `s_imu = s_camera - d`. The configuration of the flight back has the
//!   other sign ([`backward_config`]).
//! - Rolling shutter: rows would be exposed from the last to the first. The estimator has no such camera, so it is refused.

use crate::{DriverError, Faults, ImuReading, ImuSource, StereoFrame, StereoSource};
use plumbline_config::{Config, GrayImage, Timestamp};
use std::fs::{File, OpenOptions};
use std::io::{BufWriter, Write as _};
use std::os::unix::fs::FileExt as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Direction in which a tape is played.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// As recorded.
    Forward,
    /// From the last frame to the first.
    Backward,
}

/// All samples of a recording: inertial samples in memory, images in a file that the system deletes with the last reader.
#[derive(Clone, Debug)]
pub struct Tape {
    readings: Arc<[ImuReading]>,
    frames: Arc<[Entry]>,
    images: Arc<Images>,
}

/// Place of a frame in the file.
#[derive(Clone, Copy, Debug)]
struct Entry {
    sequence: u64,
    stamp: Timestamp,
    valid: [bool; 2],
    offset: u64,
}

/// File of the images, one after the other, those that are there.
#[derive(Debug)]
struct Images {
    file: File,
    /// Name that it had, for messages.
    path: PathBuf,
}

impl Tape {
    /// Copies both streams to their ends, the images of `sizes_px` into `folder`. Calls `copied` after each frame.
    ///
    /// # Errors
    /// When a stream cannot go on, or the folder has no room.
    pub fn record(
        imu: &mut dyn ImuSource,
        stereo: &mut dyn StereoSource,
        sizes_px: [(usize, usize); 2],
        folder: &Path,
        mut copied: impl FnMut(),
    ) -> Result<Self, DriverError> {
        let images = Images::create(folder)?;
        let mut out = BufWriter::new(&images.file);
        let (mut frame, mut frames, mut offset) = (StereoFrame::new(sizes_px), Vec::new(), 0);
        while stereo.next_frame(&mut frame)? {
            let StereoFrame { sequence, stamp, valid, .. } = frame;
            frames.push(Entry { sequence, stamp, valid, offset });
            for image in held(&frame) {
                out.write_all(image.pixels()).map_err(|source| images.failed(source))?;
                offset += image.pixels().len() as u64;
            }
            copied();
        }
        out.flush().map_err(|source| images.failed(source))?;
        drop(out);
        let mut readings = Vec::new();
        while let Some(reading) = imu.next_reading()? {
            readings.push(reading);
        }
        Ok(Self { readings: readings.into(), frames: frames.into(), images: Arc::new(images) })
    }

    /// Number of frames.
    #[must_use]
    pub fn frames(&self) -> usize {
        self.frames.len()
    }

    /// The time at which a flight in the other direction is at the pose of `stamp`.
    #[must_use]
    pub fn mirrored(&self, stamp: Timestamp) -> Timestamp {
        let last = self.frames.last().map_or(stamp, |frame| frame.stamp);
        last.plus_nanos(last.nanos_since(stamp))
    }

    /// Inertial samples in `direction`.
    #[must_use]
    pub fn imu(&self, direction: Direction) -> TapeImu {
        TapeImu { tape: self.clone(), direction, next: 0 }
    }

    /// Frames in `direction`.
    #[must_use]
    pub fn stereo(&self, direction: Direction) -> TapeStereo {
        TapeStereo { tape: self.clone(), direction, next: 0 }
    }
}

/// Changes `config` for the flight back.
///
/// # Errors
/// When a camera has a rolling shutter.
pub fn backward_config(config: &mut Config) -> Result<(), String> {
    if let Some(index) = config.camera.iter().position(|camera| camera.readout_s > 0.0) {
        return Err(format!(
            "camera.{index}.readout_s: a rolling shutter cannot be played backward, because its rows would be exposed from the \
             last to the first; use a recording of a global shutter"
        ));
    }
    // Zero has no sign.
    config.rig.time_offset_s = 0.0 - config.rig.time_offset_s;
    Ok(())
}

/// Images of the frame that arrived.
fn held(frame: &StereoFrame) -> impl Iterator<Item = &GrayImage> {
    frame.images.iter().zip(frame.valid).filter_map(|(image, is_valid)| is_valid.then_some(image))
}

/// Place `k` of `count` in `direction`.
fn place(k: usize, count: usize, direction: Direction) -> Option<usize> {
    match direction {
        Direction::Forward => (k < count).then_some(k),
        Direction::Backward => count.checked_sub(k + 1),
    }
}

/// Sequence number in `direction`; `last` is the highest forward. Gaps remain.
fn numbered(sequence: u64, last: u64, direction: Direction) -> u64 {
    match direction {
        Direction::Forward => sequence,
        Direction::Backward => last.saturating_sub(sequence),
    }
}

impl Images {
    /// A file without a name: nothing is left in `folder` however the program ends.
    fn create(folder: &Path) -> Result<Self, DriverError> {
        static TAPES: AtomicU64 = AtomicU64::new(0);
        std::fs::create_dir_all(folder).map_err(|source| DriverError::io(folder, source))?;
        let number = TAPES.fetch_add(1, Ordering::Relaxed);
        let path = folder.join(format!("tape-{}-{number}.raw", std::process::id()));
        let opened = OpenOptions::new().read(true).write(true).create_new(true).open(&path);
        let file = opened.map_err(|source| DriverError::io(&path, source))?;
        std::fs::remove_file(&path).map_err(|source| DriverError::io(&path, source))?;
        Ok(Self { file, path })
    }

    fn failed(&self, source: std::io::Error) -> DriverError {
        DriverError::io(&self.path, source)
    }
}

/// Inertial samples of a [`Tape`].
#[derive(Debug)]
pub struct TapeImu {
    tape: Tape,
    direction: Direction,
    next: usize,
}

impl ImuSource for TapeImu {
    fn next_reading(&mut self) -> Result<Option<ImuReading>, DriverError> {
        let readings = &self.tape.readings;
        let Some(at) = place(self.next, readings.len(), self.direction) else { return Ok(None) };
        self.next += 1;
        let mut reading = readings[at];
        if self.direction == Direction::Backward {
            let last = readings.last().map_or(0, |reading| reading.sequence);
            reading.sequence = numbered(reading.sequence, last, self.direction);
            reading.sample.stamp = self.tape.mirrored(reading.sample.stamp);
            // The angular rate changes its sign, the specific force does not: see the top of this file.
            reading.sample.gyro = -reading.sample.gyro;
        }
        Ok(Some(reading))
    }

    fn faults(&self) -> Faults {
        Faults::default()
    }
}

/// Frames of a [`Tape`].
#[derive(Debug)]
pub struct TapeStereo {
    tape: Tape,
    direction: Direction,
    next: usize,
}

impl StereoSource for TapeStereo {
    fn next_frame(&mut self, frame: &mut StereoFrame) -> Result<bool, DriverError> {
        let Tape { frames, images, .. } = &self.tape;
        let Some(at) = place(self.next, frames.len(), self.direction) else { return Ok(false) };
        self.next += 1;
        let entry = frames[at];
        let last = frames.last().map_or(0, |frame| frame.sequence);
        frame.sequence = numbered(entry.sequence, last, self.direction);
        frame.stamp = match self.direction {
            Direction::Forward => entry.stamp,
            Direction::Backward => self.tape.mirrored(entry.stamp),
        };
        frame.valid = entry.valid;
        let mut offset = entry.offset;
        for (image, is_valid) in frame.images.iter_mut().zip(entry.valid) {
            if is_valid {
                let read = images.file.read_exact_at(image.pixels_mut(), offset);
                read.map_err(|source| images.failed(source))?;
                offset += image.pixels().len() as u64;
            }
        }
        Ok(true)
    }

    fn expected_frames(&self) -> Option<u64> {
        Some(self.tape.frames.len() as u64)
    }

    fn faults(&self) -> Faults {
        Faults::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_way_back_has_the_other_time_offset_and_no_rolling_shutter() {
        let mut config: Config = Config::preset("sim").unwrap().into();
        config.rig.time_offset_s = 0.004;
        backward_config(&mut config).unwrap();
        assert_eq!(config.rig.time_offset_s, -0.004);
        config.camera[1].readout_s = 0.01;
        assert!(backward_config(&mut config).unwrap_err().starts_with("camera.1.readout_s"));
    }
}
