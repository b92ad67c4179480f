//! The source of frames: waits for a program, reads what it sends.

use super::figures::{SocketFigures, SocketMonitor, Trouble};
use super::header::Header;
use crate::clock::{StampFigures, StampProblem, monotonic_ns};
use crate::stop::StopFlag;
use crate::v4l2::numbering::Numbering;
use crate::v4l2::stamp::{self, Source};
use crate::{DriverError, Faults, StereoFrame, StereoSource};
use plumbline_config::{Portable, Timestamp};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fd::AsFd;
use std::fs::Permissions;
use std::io::{ErrorKind, Read as _};
use std::os::unix::fs::{FileTypeExt as _, PermissionsExt as _};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};
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
/// The mean delay follows with this gain.
const DELAY_GAIN: f64 = 1.0 / 16.0;
const MS: f64 = 1e-6;

/// Frames from a program at the other end of a Unix socket. Programs may come, go and follow each other; one sends at a
/// time. After it was opened, nothing allocates on the thread that reads while frames come.
#[derive(Debug)]
pub struct SocketStereo {
    path: PathBuf,
    listener: UnixListener,
    sender: Option<UnixStream>,
    sizes_px: [(usize, usize); 2],
    period_ns: f64,
    /// When the first byte of the frame came that is being read.
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

/// How an attempt to read ended.
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
        let listener = UnixListener::bind(path).map_err(refused)?;
        std::fs::set_permissions(path, Permissions::from_mode(MODE)).map_err(refused)?;
        listener.set_nonblocking(true).map_err(refused)?;
        Ok(Self {
            path: path.to_owned(),
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

    /// What shows the figures to other threads.
    #[must_use]
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
        self.figures.is_connected = true;
        self.figures.connected += 1;
        self.monitor.set_trouble(None);
        true
    }

    /// The program is gone, or is sent away.
    fn lose(&mut self, why: Trouble) {
        self.sender = None;
        self.figures.is_connected = false;
        self.figures.lost += 1;
        self.figures.refused += u64::from(matches!(why, Trouble::Refused(_)));
        self.monitor.set_trouble(Some(why));
        self.monitor.show(&self.figures);
    }

    /// Reads a frame; `None` when there is none to hand out (yet).
    fn receive(&mut self, frame: &mut StereoFrame) -> Option<()> {
        self.begun_ns = None;
        let mut bytes = [0; Header::BYTES];
        self.filled(&mut bytes, true)?;
        let header = match Header::decode(&bytes, self.sizes_px) {
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

    fn hand_out(&mut self, header: &Header, frame: &mut StereoFrame) -> Option<()> {
        let now = stamp::clocks();
        let (stamp_ns, source) = stamp::on_monotonic_clock(header.stamp_ns, now);
        let found = StampProblem::of_stamp(header.stamp_ns, now.monotonic_ns, now.system_ns);
        // A frame of long ago once more, and no clock that was set: its arrival says nothing.
        let is_old = source == Source::Arrival && header.stamp_ns <= self.newest_sent_ns;
        if source != Source::Arrival {
            self.newest_sent_ns = self.newest_sent_ns.max(header.stamp_ns);
        } else if !is_old {
            self.figures.restamped += 1;
            StampFigures::note(&mut self.figures.problem, found);
        }
        if is_old || stamp_ns <= self.last_stamp_ns {
            self.figures.disordered += 1;
            let found = StampProblem::repeated(header.stamp_ns, now.monotonic_ns);
            StampFigures::note(&mut self.figures.problem, found);
            self.monitor.show(&self.figures);
            return None;
        }
        self.last_stamp_ns = stamp_ns;
        let is_next = |last: u64| (1..FURTHEST).contains(&header.sequence.saturating_sub(last));
        if self.last.is_some_and(|(stream, last)| stream == self.stream && !is_next(last)) {
            self.stream += 1;
        }
        self.last = Some((self.stream, header.sequence));
        frame.sequence = self.numbering.next(stamp_ns, [self.last, None], self.period_ns);
        frame.stamp = Timestamp::from_nanos(stamp_ns);
        self.count(frame, (now.monotonic_ns - stamp_ns) as f64 * MS);
        Some(())
    }

    fn count(&mut self, frame: &StereoFrame, delay_ms: f64) {
        let figures = &mut self.figures;
        figures.frames += 1;
        figures.pairs += u64::from(frame.valid == [true; 2]);
        let gain = if figures.frames == 1 { 1.0 } else { DELAY_GAIN };
        figures.delay_ms += gain * (delay_ms - figures.delay_ms);
        figures.max_delay_ms = figures.max_delay_ms.at_least(delay_ms);
        self.monitor.show(figures);
    }
}

/// Removes a socket that nobody listens on any more.
fn make_way(path: &Path) -> Result<(), DriverError> {
    let Ok(found) = std::fs::symlink_metadata(path) else { return Ok(()) };
    if !found.file_type().is_socket() {
        let message = "is there, and no socket; delete it, or let driver.frames.listen name another path";
        return Err(DriverError::refused(path, message));
    }
    if UnixStream::connect(path).is_ok() {
        let message =
            "another process listens on it; end that, or let driver.frames.listen name another path";
        return Err(DriverError::refused(path, message));
    }
    std::fs::remove_file(path).map_err(|error| DriverError::io(path, error))
}

/// Waits for one look; whether there is something to be read.
fn wait(fd: &impl AsFd) -> bool {
    let timeout = Timespec { tv_sec: 0, tv_nsec: LOOK_NS };
    poll(&mut [PollFd::new(fd, PollFlags::IN)], Some(&timeout)).is_ok_and(|ready| ready > 0)
}

/// Whether somebody waits.
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

    fn expected_frames(&self) -> Option<u64> {
        None
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
        }
    }
}

impl Drop for SocketStereo {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.path);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write as _;

    const SIZES: [(usize, usize); 2] = [(64, 48), (32, 24)];
    const BYTES: usize = 64 * 48 + 32 * 24;

    struct Rig {
        _folder: tempfile::TempDir,
        path: PathBuf,
        stop: StopFlag,
        source: SocketStereo,
        frame: StereoFrame,
    }

    fn rig() -> Rig {
        let folder = tempfile::tempdir().unwrap();
        let (path, stop) = (folder.path().join("frames"), StopFlag::new());
        let source = SocketStereo::open(&path, SIZES, 20.0, stop.clone()).unwrap();
        Rig { _folder: folder, path, stop, source, frame: StereoFrame::new(SIZES) }
    }

    /// A frame whose pixels are all `grey`, measured `age_ms` ago.
    fn frame(sequence: u64, grey: u8, age_ms: i64) -> Vec<u8> {
        let sizes_px = SIZES.map(|(width, height)| (width as u32, height as u32));
        let header = Header { sequence, stamp_ns: monotonic_ns() - age_ms * 1_000_000, sizes_px };
        [&header.encode()[..], &[grey; BYTES]].concat()
    }

    impl Rig {
        fn next(&mut self) -> (u64, [u8; 2], [bool; 2]) {
            assert!(self.source.next_frame(&mut self.frame).unwrap());
            let grey = |k: usize| self.frame.images[k].pixels()[7];
            (self.frame.sequence, [grey(0), grey(1)], self.frame.valid)
        }
    }

    #[test]
    fn frames_come_in_pieces_of_any_size_and_say_how_many_were_lost() {
        let mut rig = rig();
        let mut sender = UnixStream::connect(&rig.path).unwrap();
        let bytes = [frame(7, 10, 30), frame(8, 20, 20), frame(11, 30, 10)].concat();
        let writer = std::thread::spawn(move || {
            for piece in bytes.chunks(997) {
                sender.write_all(piece).unwrap();
                std::thread::sleep(Duration::from_micros(200));
            }
            sender
        });
        assert_eq!(rig.next(), (0, [10, 10], [true; 2]));
        assert_eq!(rig.next(), (1, [20, 20], [true; 2]));
        assert_eq!(rig.next(), (4, [30, 30], [true; 2]));
        assert_eq!(rig.source.faults().missing, 2);
        let age_ms = (monotonic_ns() - rig.frame.stamp.as_nanos()) / 1_000_000;
        assert!((10..5000).contains(&age_ms), "{age_ms} ms");
        let mut sender = writer.join().unwrap();
        // The left image alone.
        let header = Header { sequence: 12, stamp_ns: monotonic_ns(), sizes_px: [(64, 48), (0, 0)] };
        sender.write_all(&header.encode()).unwrap();
        sender.write_all(&[40; 64 * 48]).unwrap();
        let (number, [left, _], valid) = rig.next();
        assert_eq!((number, left, valid), (5, 40, [true, false]));
        assert_eq!((rig.source.faults().unpaired, rig.source.monitor().trouble()), (1, None));
    }

    #[test]
    fn nothing_is_allocated_for_a_frame() {
        let mut rig = rig();
        let mut sender = UnixStream::connect(&rig.path).unwrap();
        sender.write_all(&[frame(1, 1, 30), frame(2, 2, 20), frame(3, 3, 10)].concat()).unwrap();
        rig.next();
        let counted = allocation_counter::measure(|| {
            rig.source.next_frame(&mut rig.frame).unwrap();
            rig.source.next_frame(&mut rig.frame).unwrap();
        });
        assert_eq!((counted.count_total, rig.frame.sequence), (0, 2));
    }

    #[test]
    fn a_program_may_go_within_a_frame_and_another_goes_on() {
        let mut rig = rig();
        let path = rig.path.clone();
        let programs = std::thread::spawn(move || {
            let mut first = UnixStream::connect(&path).unwrap();
            first.write_all(&frame(90, 1, 200)).unwrap();
            first.write_all(&frame(91, 2, 150)[..BYTES / 2]).unwrap();
            drop(first);
            let mut second = UnixStream::connect(&path).unwrap();
            // Its numbers begin anew: time says how many are missing.
            second.write_all(&frame(0, 3, 0)).unwrap();
            second
        });
        assert_eq!(rig.next(), (0, [1, 1], [true; 2]));
        let (number, grey, _) = rig.next();
        assert_eq!((number >= 4, grey), (true, [3, 3]), "{number}");
        let figures = rig.source.monitor().figures();
        assert_eq!((figures.connected, figures.lost, figures.refused), (2, 1, 0));
        drop(programs.join().unwrap());
    }

    #[test]
    fn a_program_that_drips_its_bytes_gives_way() {
        let mut rig = rig();
        let mut slow = UnixStream::connect(&rig.path).unwrap();
        slow.write_all(&frame(1, 1, 0)[..100]).unwrap();
        let path = rig.path.clone();
        let programs = std::thread::spawn(move || {
            let mut drops = 0;
            while slow.write_all(&[0]).is_ok() {
                drops += 1;
                std::thread::sleep(Duration::from_millis(200));
            }
            let mut next = UnixStream::connect(&path).unwrap();
            next.write_all(&frame(0, 3, 0)).unwrap();
            (drops, next)
        });
        assert_eq!(rig.next().1, [3, 3]);
        let (drops, _next) = programs.join().unwrap();
        assert!(drops > 1, "it was sent away for its bytes, not for silence");
        assert_eq!(rig.source.monitor().figures().lost, 1);
    }

    #[test]
    fn a_program_that_cannot_be_accepted_is_reported_and_taken_later() {
        use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
        let mut rig = rig();
        let mut sender = UnixStream::connect(&rig.path).unwrap();
        sender.write_all(&frame(1, 7, 0)).unwrap();
        let limit = getrlimit(Resource::Nofile);
        // No descriptor is free below the highest in use.
        setrlimit(Resource::Nofile, Rlimit { current: Some(3), ..limit }).unwrap();
        let (monitor, stop) = (rig.source.monitor(), rig.stop.clone());
        let watcher = std::thread::spawn(move || {
            loop {
                let trouble = monitor.trouble().unwrap_or_default();
                if trouble.contains("cannot be accepted") || stop.is_stopped() {
                    setrlimit(Resource::Nofile, limit).unwrap();
                    return trouble;
                }
                std::thread::sleep(Duration::from_millis(5));
            }
        });
        assert_eq!(rig.next().1, [7, 7]);
        assert!(watcher.join().unwrap().contains("os error 24"));
        assert_eq!(rig.source.monitor().trouble(), None);
    }

    #[test]
    fn what_is_no_frame_of_this_rig_is_sent_away_with_the_reason() {
        for (bytes, says) in [
            (vec![b'x'; 64], "docs/frame-socket.md"),
            (
                Header { sequence: 1, stamp_ns: 1, sizes_px: [(640, 480), (0, 0)] }.encode().to_vec(),
                "640 x 480 px was sent, and camera[0] has 64 x 48",
            ),
        ] {
            let mut rig = rig();
            let (path, stop, monitor) = (rig.path.clone(), rig.stop.clone(), rig.source.monitor());
            let sender = std::thread::spawn(move || {
                let mut sender = UnixStream::connect(&path).unwrap();
                sender.write_all(&bytes).unwrap();
                // It is told by the end of its connection.
                let _ = sender.read(&mut [0; 1]);
                stop.stop();
            });
            assert!(!rig.source.next_frame(&mut rig.frame).unwrap());
            sender.join().unwrap();
            assert_eq!(monitor.figures().refused, 1);
            let trouble = monitor.trouble().unwrap();
            assert!(trouble.contains(says) && trouble.contains("driver.frames.listen"), "{trouble}");
        }
    }

    #[test]
    fn stamps_that_make_no_sense_are_replaced_and_those_that_go_back_refused() {
        let mut rig = rig();
        let mut sender = UnixStream::connect(&rig.path).unwrap();
        let mut nonsense = frame(1, 1, 0);
        nonsense[16..24].copy_from_slice(&5_i64.to_le_bytes());
        sender.write_all(&nonsense).unwrap();
        assert_eq!(rig.next().1, [1, 1]);
        sender.write_all(&[frame(2, 2, 5000), frame(3, 3, 0)].concat()).unwrap();
        assert_eq!(rig.next(), (2, [3, 3], [true; 2]));
        let figures = rig.source.monitor().figures();
        assert_eq!((figures.restamped, figures.disordered, rig.source.faults().missing), (1, 1, 1));
    }

    #[test]
    fn frames_that_are_sent_again_long_after_do_not_set_the_clock() {
        let mut rig = rig();
        let mut sender = UnixStream::connect(&rig.path).unwrap();
        sender.write_all(&frame(1, 1, 15)).unwrap();
        assert_eq!(rig.next().1, [1, 1]);
        // A second of frames that are older than any on their way, over and over.
        for k in 0..20 {
            sender.write_all(&frame(k, 9, 11_000 - 50 * k as i64)).unwrap();
        }
        sender.write_all(&frame(2, 3, 0)).unwrap();
        assert_eq!(rig.next().1, [3, 3]);
        let figures = rig.source.monitor().figures();
        assert_eq!((figures.restamped, figures.disordered), (0, 20));
    }

    #[test]
    fn a_socket_that_was_left_behind_is_taken_and_one_in_use_is_not() {
        let rig = rig();
        let again = SocketStereo::open(&rig.path, SIZES, 20.0, StopFlag::new()).unwrap_err().to_string();
        assert!(again.contains("another process listens"), "{again}");
        let left = rig.path.with_file_name("left");
        drop(UnixListener::bind(&left).unwrap());
        drop(SocketStereo::open(&left, SIZES, 20.0, StopFlag::new()).unwrap());
        assert!(!left.exists());
        std::fs::write(&left, "text").unwrap();
        let other = SocketStereo::open(&left, SIZES, 20.0, StopFlag::new()).unwrap_err().to_string();
        assert!(other.contains("no socket"), "{other}");
        let nowhere = SocketStereo::open(Path::new("/nowhere/at/all"), SIZES, 20.0, StopFlag::new());
        assert!(nowhere.unwrap_err().to_string().contains("driver.frames.listen"));
    }
}
