//! The source of frames: waits for a program, reads what it sends.

use super::figures::{SocketFigures, SocketMonitor, Trouble};
use crate::clock::{StampProblem, monotonic_ns};
use crate::stop::StopFlag;
use crate::unix_socket::{SocketFile, is_served};
use crate::v4l2::numbering::Numbering;
use crate::v4l2::stamp::{self, Source};
use crate::{DriverError, Faults, StereoFrame, StereoSource};
use plumbline_config::Timestamp;
use plumbline_protocol::frame_header::FrameHeader;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fd::AsFd;
use std::io::{ErrorKind, Read as _};
use std::os::unix::fs::FileTypeExt as _;
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::Path;
use std::time::Duration;

/// A wait is cut into pieces of this length, to look at the stop flag, ns.
const LOOK_NS: i64 = 20_000_000;
/// A program that says nothing within a frame for so long is sent away, looks.
const SILENT_LOOKS: u32 = 50;
/// A frame is whole so long after its first byte, or its program is sent away, ns: in a second nothing that flies needs more.
const WITHIN_NS: i64 = 2_000_000_000;
/// Pause after a program could not be accepted, for want of descriptors or memory.
const REFUSED_PAUSE: Duration = Duration::from_millis(100);
/// One that is silent between frames gives way to another that waits after so long, looks.
const GIVES_WAY_LOOKS: u32 = 150;
/// Numbers that jump further, or back, count anew.
const FURTHEST: u64 = 1_000_000;
/// The owner and its group may send.
const MODE: u32 = 0o660;

/// Frames from a program at the other end of a Unix socket. Programs may come, go and follow each other; one sends at a
/// time. After it was opened, nothing allocates on the thread that reads while frames come.
#[derive(Debug)]
pub struct SocketStereo {
    _file: SocketFile,
    listener: UnixListener,
    sender: Option<UnixStream>,
    sizes_px: [(usize, usize); 2],
    period_ns: f64,
    /// Arrival of the first byte of the frame that is being read.
    begun_ns: Option<i64>,
    /// Stream and number of the last frame.
    last: Option<(u64, u64)>,
    stream: u64,
    last_stamp_ns: i64,
    /// Newest stamp of this program that is of a clock of this computer, as it was sent.
    newest_sent_ns: i64,
    numbering: Numbering,
    figures: SocketFigures,
    monitor: SocketMonitor,
    stop: StopFlag,
}

/// Outcome of a read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Filled {
    Whole,
    Stopped,
    Gone,
    /// Another program waits, and this one is silent.
    Yields,
}

impl SocketStereo {
    /// Makes the socket at `path`, for images of these sizes, px ((0, 0) for a camera that is not there). Once `stop` is
    /// asked for, the stream ends within 20 ms.
    ///
    /// # Errors
    /// When the socket cannot be made: somebody listens on it, something else is there, or the folder is missing.
    pub fn open(
        path: &Path,
        sizes_px: [(usize, usize); 2],
        rate_hz: f64,
        stop: StopFlag,
    ) -> Result<Self, DriverError> {
        make_way(path)?;
        let refused = |error: std::io::Error| {
            let message = format!(
                "the socket of driver.frames.listen cannot be made: {error}; name a path in a folder that is there \
                 and may be written to, such as /run/plumbline"
            );
            DriverError::refused(path, message)
        };
        let (listener, file) = SocketFile::listen(path, MODE, |_| Ok(())).map_err(refused)?;
        listener.set_nonblocking(true).map_err(refused)?;
        Ok(Self {
            _file: file,
            listener,
            sender: None,
            sizes_px,
            period_ns: 1e9 / rate_hz,
            begun_ns: None,
            last: None,
            stream: 0,
            last_stamp_ns: i64::MIN,
            newest_sent_ns: i64::MIN,
            numbering: Numbering::default(),
            figures: SocketFigures::default(),
            monitor: SocketMonitor::new(path, sizes_px),
            stop,
        })
    }

    /// Monitor that shows the figures to other threads.
    pub fn monitor(&self) -> SocketMonitor {
        self.monitor.clone()
    }

    /// Takes whoever waits.
    fn accept(&mut self) -> bool {
        let sender = match self.listener.accept() {
            Ok((sender, _)) => sender,
            Err(error) => {
                // Whoever waits would be seen again at once.
                if error.kind() != ErrorKind::WouldBlock {
                    self.monitor.set_trouble(Some(Trouble::NotAccepted(error.raw_os_error().unwrap_or(0))));
                    std::thread::sleep(REFUSED_PAUSE);
                }
                return false;
            }
        };
        if sender.set_nonblocking(true).is_err() {
            return false;
        }
        self.sender = Some(sender);
        self.stream += 1;
        self.newest_sent_ns = i64::MIN;
        self.figures.connected += 1;
        self.monitor.set_trouble(None);
        true
    }

    /// The program is gone, or is sent away.
    fn lose(&mut self, why: Trouble) {
        self.sender = None;
        self.figures.lost += 1;
        self.figures.refused += u64::from(matches!(why, Trouble::Refused(_)));
        self.monitor.set_trouble(Some(why));
        self.monitor.show(&self.figures);
    }

    /// Reads a frame; `None` when there is none to hand out (yet).
    fn receive(&mut self, frame: &mut StereoFrame) -> Option<()> {
        self.begun_ns = None;
        let mut bytes = [0; FrameHeader::BYTES];
        self.filled(&mut bytes, true)?;
        let header = match FrameHeader::decode(&bytes, self.sizes_px) {
            Ok(header) => header,
            Err(refusal) => {
                self.lose(Trouble::Refused(refusal));
                return None;
            }
        };
        frame.valid = header.valid();
        for (image, _) in frame.images.iter_mut().zip(header.valid()).filter(|(_, is_there)| *is_there) {
            self.filled(image.pixels_mut(), false)?;
        }
        self.hand_out(&header, frame)
    }

    /// Fills a buffer from the program, or loses it; between frames it may be silent and go.
    fn filled(&mut self, buffer: &mut [u8], is_between: bool) -> Option<()> {
        match self.fill(buffer, is_between) {
            Filled::Whole => return Some(()),
            Filled::Stopped => {}
            Filled::Yields => self.lose(Trouble::Silent),
            Filled::Gone => self.lose(if is_between { Trouble::Gone } else { Trouble::GoneWithin }),
        }
        None
    }

    /// Fills a buffer from the program.
    fn fill(&mut self, mut buffer: &mut [u8], is_between: bool) -> Filled {
        let Some(sender) = &mut self.sender else { return Filled::Gone };
        let (whole, mut silent) = (buffer.len(), 0);
        while !buffer.is_empty() {
            match sender.read(buffer) {
                Ok(0) => return Filled::Gone,
                Ok(count) => {
                    self.begun_ns.get_or_insert_with(monotonic_ns);
                    buffer = &mut buffer[count..];
                    silent = 0;
                }
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) if error.kind() == ErrorKind::WouldBlock => {
                    if self.stop.is_stopped() {
                        return Filled::Stopped;
                    }
                    silent += u32::from(!wait(&*sender));
                    let may_be_silent = is_between && buffer.len() == whole;
                    let is_late = self.begun_ns.is_some_and(|begun| monotonic_ns() - begun > WITHIN_NS);
                    if !may_be_silent && (silent > SILENT_LOOKS || is_late) {
                        return Filled::Gone;
                    }
                    if may_be_silent && silent > GIVES_WAY_LOOKS && is_ready(&self.listener) {
                        return Filled::Yields;
                    }
                }
                Err(_) => return Filled::Gone,
            }
        }
        Filled::Whole
    }

    fn hand_out(&mut self, header: &FrameHeader, frame: &mut StereoFrame) -> Option<()> {
        let now = stamp::clocks();
        let (stamp_ns, source) = stamp::on_monotonic_clock(header.stamp_ns, now);
        let found = StampProblem::of_stamp(header.stamp_ns, now.monotonic_ns, now.system_ns);
        // A frame of long ago once more, and no clock that was set: its arrival says nothing.
        let is_old = source == Source::Arrival && header.stamp_ns <= self.newest_sent_ns;
        if source != Source::Arrival {
            self.newest_sent_ns = self.newest_sent_ns.max(header.stamp_ns);
        } else if !is_old {
            self.figures.restamped += 1;
            StampProblem::note(&mut self.figures.problem, found);
        }
        if is_old || stamp_ns <= self.last_stamp_ns {
            self.figures.disordered += 1;
            let found = StampProblem::repeated(header.stamp_ns, now.monotonic_ns);
            StampProblem::note(&mut self.figures.problem, found);
            self.monitor.show(&self.figures);
            return None;
        }
        self.last_stamp_ns = stamp_ns;
        // Numbers wrap; one that goes back is of a program that counts anew.
        let is_next = |last: u64| (1..FURTHEST).contains(&header.sequence.wrapping_sub(last));
        if self.last.is_some_and(|(stream, last)| stream == self.stream && !is_next(last)) {
            self.stream += 1;
        }
        self.last = Some((self.stream, header.sequence));
        frame.sequence = self.numbering.next(stamp_ns, [self.last, None], self.period_ns);
        frame.stamp = Timestamp::from_nanos(stamp_ns);
        self.figures.frames += 1;
        self.figures.pairs += u64::from(frame.valid == [true; 2]);
        self.monitor.show(&self.figures);
        Some(())
    }
}

/// Refuses a path where something else is; a socket that nobody listens on any more is replaced.
fn make_way(path: &Path) -> Result<(), DriverError> {
    let Ok(found) = std::fs::symlink_metadata(path) else { return Ok(()) };
    if !found.file_type().is_socket() {
        let message = "exists and is not a socket; delete it, or set driver.frames.listen to another path";
        return Err(DriverError::refused(path, message));
    }
    if is_served(path) {
        let message = "another process listens on it; stop it, or set driver.frames.listen to another path";
        return Err(DriverError::refused(path, message));
    }
    Ok(())
}

/// Waits for one look; whether there is something to be read.
fn wait(fd: &impl AsFd) -> bool {
    let timeout = Timespec { tv_sec: 0, tv_nsec: LOOK_NS };
    poll(&mut [PollFd::new(fd, PollFlags::IN)], Some(&timeout)).is_ok_and(|ready| ready > 0)
}

/// True if a connection is waiting to be accepted.
fn is_ready(fd: &impl AsFd) -> bool {
    let at_once = Timespec { tv_sec: 0, tv_nsec: 0 };
    poll(&mut [PollFd::new(fd, PollFlags::IN)], Some(&at_once)).is_ok_and(|ready| ready > 0)
}

impl StereoSource for SocketStereo {
    fn next_frame(&mut self, frame: &mut StereoFrame) -> Result<bool, DriverError> {
        while !self.stop.is_stopped() {
            if self.sender.is_some() {
                if self.receive(frame).is_some() {
                    return Ok(true);
                }
            } else if !self.accept() {
                wait(&self.listener);
            }
        }
        self.monitor.show(&self.figures);
        Ok(false)
    }

    fn faults(&self) -> Faults {
        Faults {
            missing: self.numbering.missing(),
            corrupt: self.figures.refused,
            disordered: self.figures.disordered,
            unpaired: match self.sizes_px[1] {
                (0, 0) => 0,
                _ => self.figures.frames - self.figures.pairs,
            },
            ..Faults::default()
        }
    }
}

#[cfg(test)]
#[path = "source_tests.rs"]
mod tests;
