//! The source of frames: reads the devices, pairs their images, goes on with what is there.

use super::camera::Camera;
use super::device::{self, OpenError, Wanted};
use super::figures::{V4l2Figures, V4l2Monitor};
use super::keeper::{Exposures, Keeper};
use super::numbering::Numbering;
use super::pairing::{Next, Pairing, Side, Waiting};
use super::stamp::{Exposure, clocks};
use crate::stop::StopFlag;
use crate::{DriverError, Faults, StereoFrame, StereoSource};
use plumbline_config::options::{PairBy, V4l2Config};
use plumbline_config::{Config, Portable, Timestamp};
use rustix::event::{PollFd, PollFlags, poll};
use rustix::time::Timespec;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering};

/// A wait is cut into pieces of this length, to look at the stop flag and for cameras that are back, ns.
const LOOK_NS: i64 = 20_000_000;
/// A camera that streams and sends nothing for this long hangs, and is opened anew, ns; some need as long for the first
/// image, and some wait for a trigger.
const SILENT_NS: i64 = 3_000_000_000;
const SILENT_AT_FIRST_NS: i64 = 10_000_000_000;
const MS: f64 = 1e-6;

/// Devices to be read, and their settings.
#[derive(Clone, Debug, PartialEq)]
pub struct V4l2Options {
    /// Section `driver.v4l2` of the configuration.
    pub v4l2: V4l2Config,
    /// Width and height of the cameras' images, px: one camera, or left and right.
    pub sizes_px: Vec<(usize, usize)>,
    /// Frames per second.
    pub rate_hz: f64,
    /// Pairs whose stamps are further from each other are counted, s.
    pub pair_tolerance_s: f64,
}

impl V4l2Options {
    /// Options of a configuration; `None` if it names no device.
    pub fn for_config(config: &Config) -> Option<Self> {
        let v4l2 = &config.driver.v4l2;
        (!v4l2.left.is_empty() && !config.camera.is_empty()).then(|| Self {
            v4l2: v4l2.clone(),
            sizes_px: config.camera.iter().map(|c| (c.width_px, c.height_px)).collect(),
            rate_hz: config.camera[0].rate_hz,
            pair_tolerance_s: config.driver.pair_tolerance_s,
        })
    }

    /// The devices, left first.
    fn devices(&self) -> Vec<Wanted> {
        let both = self.sizes_px.len() == 2 && self.v4l2.right.is_empty();
        let paths = [("driver.v4l2.left", &self.v4l2.left), ("driver.v4l2.right", &self.v4l2.right)];
        paths
            .into_iter()
            .zip(&self.sizes_px)
            .filter(|((_, path), _)| !path.is_empty())
            .map(|((key, path), size_px)| Wanted {
                path: PathBuf::from(path),
                key,
                size_px: *size_px,
                both,
                rate_hz: self.rate_hz,
                options: self.v4l2.clone(),
            })
            .collect()
    }
}

/// Frames of one camera, of two, or of a device that gives the images of both.
///
/// Stamps are the middle of the exposure by CLOCK_MONOTONIC. A camera that is missing, at the beginning or later, is
/// looked for until it is there; frames then have the other's image alone. After it was opened, nothing allocates on the
/// thread that reads.
#[derive(Debug)]
pub struct V4l2Stereo {
    // Dropped in this order: streams before the thread that might open them anew.
    cameras: Vec<Camera>,
    keeper: Keeper,
    /// True if the one device gives both images.
    both: bool,
    reopen_silent: bool,
    pairing: Pairing,
    numbering: Numbering,
    exposures: Exposures,
    readout_ns: i64,
    tolerance_ns: i64,
    last_stamp_ns: i64,
    disordered: u64,
    figures: V4l2Figures,
    monitor: V4l2Monitor,
    stop: StopFlag,
}

impl V4l2Stereo {
    /// Opens what is there. Once `stop` is asked for, the stream ends within 20 ms.
    ///
    /// # Errors
    /// When a device that is there cannot do what the options ask of it; the message names the key and the cure. One that
    /// is not there is no error: [`V4l2Monitor::trouble`] tells of it.
    ///
    /// # Panics
    /// When the options name no device: [`V4l2Options::for_config`] makes none of these.
    pub fn open(options: &V4l2Options, stop: StopFlag) -> Result<Self, DriverError> {
        let wanted = options.devices();
        assert!(!wanted.is_empty(), "the options name no device");
        let (both, monitor) = (wanted[0].both, V4l2Monitor::default());
        // What was asked for stands in until the camera says what it does.
        let asked_ns = (options.v4l2.exposure_us * 1e3) as i64;
        let exposures: Exposures = Arc::new([AtomicI64::new(asked_ns), AtomicI64::new(asked_ns)]);
        let (mut cameras, mut probes) = (Vec::new(), [None, None]);
        for (index, device) in wanted.iter().enumerate() {
            let mut camera = Camera::absent();
            match device::open(device) {
                Ok(mut stream) => {
                    probes[index] = stream.probe.take();
                    if let Some(read_ns) = probes[index].as_ref().and_then(|probe| probe.read_ns()) {
                        exposures[index].store(read_ns, Ordering::Relaxed);
                    }
                    camera.start(stream, clocks().monotonic_ns);
                }
                Err(OpenError::Absent(why)) => monitor.set_trouble(index, Some(why)),
                Err(OpenError::Refused(error)) => return Err(error),
            }
            cameras.push(camera);
        }
        let keeper = Keeper::start(wanted, probes, Arc::clone(&exposures), monitor.clone())?;
        for (index, _) in cameras.iter().enumerate().filter(|(_, camera)| !camera.is_alive()) {
            keeper.find(index, None);
        }
        let by_sequence = options.v4l2.pair_by == PairBy::Sequence;
        Ok(Self {
            cameras,
            keeper,
            both,
            reopen_silent: !by_sequence,
            pairing: Pairing::new(by_sequence, 1e9 / options.rate_hz),
            numbering: Numbering::default(),
            exposures,
            readout_ns: (options.v4l2.readout_us * 1e3) as i64,
            tolerance_ns: (options.pair_tolerance_s * 1e9) as i64,
            last_stamp_ns: i64::MIN,
            disordered: 0,
            figures: V4l2Figures::default(),
            monitor,
            stop,
        })
    }

    /// Monitor that shows the figures to other threads.
    pub fn monitor(&self) -> V4l2Monitor {
        self.monitor.clone()
    }

    /// Figures of the cameras so far.
    pub fn figures(&self) -> V4l2Figures {
        let mut figures = self.figures;
        for (shown, camera) in figures.cameras.iter_mut().zip(&self.cameras) {
            *shown = camera.figures;
        }
        figures.offset_ms = self.pairing.offset_ns().unwrap_or(0) as f64 * MS;
        figures.period_ms = self.pairing.period_ns() * MS;
        figures
    }

    /// Takes cameras that are back, sends away those that are gone, and reads what has come.
    fn look(&mut self) {
        let now_ns = clocks().monotonic_ns;
        for (index, camera) in self.cameras.iter_mut().enumerate() {
            if let Some(stream) = camera.remains() {
                self.keeper.find(index, Some(stream));
            }
            if !camera.is_alive()
                && camera.side().front.is_none()
                && let Some(stream) = self.keeper.opened(index)
            {
                camera.start(stream, now_ns);
                self.pairing.restarted(index);
            }
            let exposure_ns = self.exposures[index].load(Ordering::Relaxed);
            let exposure = Exposure { exposure_ns, readout_ns: self.readout_ns };
            camera.drain(index, exposure, &mut self.pairing, clocks);
        }
        self.lose_silent(now_ns);
    }

    /// A driver may hang without a word. Cameras that wait for a trigger are silent by right, while both are.
    fn lose_silent(&mut self, now_ns: i64) {
        let newest_ns = self.cameras.iter().map(|camera| camera.last_sign_ns).max().unwrap_or(now_ns);
        let reference_ns = if self.reopen_silent { now_ns } else { newest_ns };
        for camera in &mut self.cameras {
            let limit_ns = if camera.has_sent() { SILENT_NS } else { SILENT_AT_FIRST_NS };
            // What waits in its buffers is a sign as well: then it is the reader who was away.
            if camera.side().front.is_none() && reference_ns - camera.last_sign_ns > limit_ns {
                camera.lose();
            }
        }
    }

    /// Decides about the images that have come.
    fn next(&self) -> Next {
        match self.cameras.as_slice() {
            [left, right] => self.pairing.next([left.side(), right.side()], clocks().monotonic_ns),
            [one] if one.side().front.is_some() => Next::Alone(0),
            _ => Next::Wait(None),
        }
    }

    /// Waits for an image until this time, or for one look.
    fn wait(&mut self, until_ns: Option<i64>) {
        let now_ns = clocks().monotonic_ns;
        let wait_ns = until_ns.map_or(LOOK_NS, |until_ns| (until_ns - now_ns).clamp(0, LOOK_NS));
        let timeout = Timespec { tv_sec: 0, tv_nsec: wait_ns };
        let mut is_error = [false; 2];
        match self.cameras.as_slice() {
            [left, right] => match (left.poll_fd(), right.poll_fd()) {
                (Some(left), Some(right)) => {
                    let mut fds = [PollFd::new(&left, PollFlags::IN), PollFd::new(&right, PollFlags::IN)];
                    let _ = poll(&mut fds, Some(&timeout));
                    is_error = fds.map(|fd| is_bad(&fd));
                }
                (Some(fd), None) => is_error[0] = wait_for_one(&fd, &timeout),
                (None, Some(fd)) => is_error[1] = wait_for_one(&fd, &timeout),
                (None, None) => drop(poll(&mut [], Some(&timeout))),
            },
            [one] => match one.poll_fd() {
                Some(fd) => is_error[0] = wait_for_one(&fd, &timeout),
                None => drop(poll(&mut [], Some(&timeout))),
            },
            _ => {}
        }
        for (camera, _) in self.cameras.iter_mut().zip(is_error).filter(|(_, is_error)| *is_error) {
            camera.suspect();
        }
    }

    /// Writes the images of these cameras into the frame; whether any of them could be read.
    fn hand_out(&mut self, frame: &mut StereoFrame, which: [bool; 2]) -> bool {
        frame.valid = [false; 2];
        let mut images = [None; 2];
        for (index, camera) in self.cameras.iter_mut().enumerate().filter(|(index, _)| which[*index]) {
            let buffers = if self.both { &mut frame.images[..] } else { &mut frame.images[index..=index] };
            let Some((image, is_whole)) = camera.hand_out(buffers) else { continue };
            images[index] = Some(image);
            frame.valid[index] = is_whole;
            frame.valid[1] |= self.both && is_whole;
        }
        if let [Some(left), Some(right)] = images {
            self.count_pair(left, right);
            self.pairing.paired(left, right);
        }
        let mark = |index: usize| Some((self.cameras.get(index)?.generation(), images[index]?.sequence));
        let marks = [mark(0), mark(1)];
        // The left image's time, where there is one that can be used.
        let stamp = images.into_iter().zip(frame.valid).find_map(|(image, valid)| image.filter(|_| valid));
        let Some(Waiting { stamp_ns, .. }) = stamp else { return false };
        if stamp_ns <= self.last_stamp_ns {
            self.disordered += 1;
            return false;
        }
        self.last_stamp_ns = stamp_ns;
        frame.stamp = Timestamp::from_nanos(stamp_ns);
        frame.sequence = self.numbering.next(stamp_ns, marks, self.pairing.period_ns());
        self.figures.frames += 1;
        self.figures.pairs += u64::from(frame.valid == [true; 2]);
        true
    }

    fn count_pair(&mut self, left: Waiting, right: Waiting) {
        let apart_ns = right.stamp_ns - left.stamp_ns;
        self.figures.apart += u64::from(apart_ns.abs() > self.tolerance_ns);
        if let Some(offset_ns) = self.pairing.offset_ns() {
            let jitter_ms = (apart_ns - offset_ns).abs() as f64 * MS;
            self.figures.max_jitter_ms = self.figures.max_jitter_ms.at_least(jitter_ms);
        }
    }
}

fn is_bad(fd: &PollFd<'_>) -> bool {
    fd.revents().intersects(PollFlags::ERR | PollFlags::HUP | PollFlags::NVAL)
}

/// Waits for this device alone; whether it has an error.
fn wait_for_one(fd: &rustix::fd::BorrowedFd<'_>, timeout: &Timespec) -> bool {
    let mut fds = [PollFd::new(fd, PollFlags::IN)];
    let _ = poll(&mut fds, Some(timeout));
    is_bad(&fds[0])
}

impl StereoSource for V4l2Stereo {
    fn next_frame(&mut self, frame: &mut StereoFrame) -> Result<bool, DriverError> {
        while !self.stop.is_stopped() {
            self.look();
            let is_handed_out = match self.next() {
                Next::Wait(until_ns) => {
                    self.wait(until_ns);
                    false
                }
                Next::Pair => self.hand_out(frame, [true; 2]),
                Next::Alone(index) => {
                    if self.cameras.len() == 2 {
                        let other: Side = self.cameras[1 - index].side();
                        self.pairing.alone(index, other.front.is_none() && other.is_alive);
                        self.cameras[index].figures.alone += 1;
                    }
                    self.hand_out(frame, [index == 0, index == 1])
                }
            };
            if is_handed_out {
                let figures = self.figures();
                self.monitor.show(&figures);
                return Ok(true);
            }
        }
        self.monitor.show(&self.figures());
        Ok(false)
    }

    fn faults(&self) -> Faults {
        let sum = |of: fn(&Camera) -> u64| self.cameras.iter().map(of).sum::<u64>();
        Faults {
            missing: self.numbering.missing(),
            corrupt: sum(|camera| camera.figures.corrupt),
            disordered: self.disordered + sum(|camera| camera.figures.disordered),
            unpaired: sum(|camera| camera.figures.alone),
            ..Faults::default()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::{Duration, Instant};

    fn options(left: &str, right: &str) -> V4l2Options {
        let v4l2 = V4l2Config { left: left.into(), right: right.into(), ..V4l2Config::default() };
        V4l2Options { v4l2, sizes_px: vec![(640, 480); 2], rate_hz: 30.0, pair_tolerance_s: 0.002 }
    }

    #[test]
    fn cameras_that_are_missing_are_waited_for_until_the_stop() {
        let stop = StopFlag::new();
        let options = options("/dev/v4l/by-path/not-there-0", "/dev/v4l/by-path/not-there-1");
        let mut source = V4l2Stereo::open(&options, stop.clone()).unwrap();
        let monitor = source.monitor();
        let reader = std::thread::spawn(move || {
            let mut frame = StereoFrame::new([(640, 480); 2]);
            (source.next_frame(&mut frame).unwrap(), source.faults())
        });
        std::thread::sleep(Duration::from_millis(300));
        assert!(!reader.is_finished());
        for (trouble, key) in monitor.trouble().into_iter().zip(["driver.v4l2.left", "driver.v4l2.right"]) {
            let trouble = trouble.expect("it is missing");
            assert!(trouble.contains(key), "{trouble}");
        }
        let begin = Instant::now();
        stop.stop();
        assert_eq!(reader.join().unwrap(), (false, Faults::default()));
        assert!(begin.elapsed() < Duration::from_secs(2), "{:?}", begin.elapsed());
    }

    #[test]
    fn what_is_no_camera_is_refused_when_it_is_opened() {
        let options = options("/dev/null", "");
        let error = V4l2Stereo::open(&options, StopFlag::new()).unwrap_err();
        assert!(error.to_string().starts_with("/dev/null: is no video device"), "{error}");
    }

    #[test]
    fn a_configuration_names_devices_or_none() {
        let config = |change: fn(&mut V4l2Config)| {
            let mut options = options("", "");
            change(&mut options.v4l2);
            options.devices().into_iter().map(|d| (d.key, d.both)).collect::<Vec<_>>()
        };
        assert_eq!(config(|_| {}), []);
        assert_eq!(config(|c| c.left = "/dev/video0".into()), [("driver.v4l2.left", true)]);
        let two = config(|c| (c.left, c.right) = ("/dev/video0".into(), "/dev/video2".into()));
        assert_eq!(two, [("driver.v4l2.left", false), ("driver.v4l2.right", false)]);
    }
}
