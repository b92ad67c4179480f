//! An inertial sensor for `plumbline fly`, for samples that only a program of the user's own can read: a device at a
//! pseudo-terminal that speaks our serial protocol (`docs/serial-protocol.md`).

use crate::error::ClientError;
use crate::monotonic_ns;
use plumbline_config::ImuSample;
use plumbline_protocol::{Flags, Hello, Imu, MAX_FRAME, Message, Receiver, Settings, Time, VERSION, encode};
use rustix::event::{PollFd, PollFlags, poll};
use rustix::fd::OwnedFd;
use rustix::io::Errno;
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use std::io;
use std::os::unix::fs::symlink;
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{Builder, JoinHandle};

/// Description that a sensor gives of itself: rate and ranges of `[imu]` in the configuration of the flight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SensorAbout {
    /// Samples a second.
    pub rate_hz: f64,
    /// Largest angular rate, rad/s.
    pub gyro_range_rad_s: f64,
    /// Largest specific force, m/s².
    pub accel_range_m_s2: f64,
}

impl SensorAbout {
    fn rate_mhz(self) -> u32 {
        (1000.0 * self.rate_hz).round() as u32
    }
}

/// The device's end of the line. A thread answers the questions of the flight; samples are sent by the caller's.
#[derive(Debug)]
pub struct ImuLine {
    line: Arc<Line>,
    name: PathBuf,
    /// Terminal that the name stands for.
    terminal: PathBuf,
    /// Ends the thread when it closes.
    stop: Option<UnixStream>,
    thread: Option<JoinHandle<()>>,
    sequence: u32,
}

#[derive(Debug)]
struct Line {
    device: OwnedFd,
    /// Held open: the line is there while no flight reads it.
    _host: OwnedFd,
    /// Messages are written one after the other.
    writing: Mutex<()>,
}

impl ImuLine {
    /// Makes a line, and a symbolic link `name` to it: the flight's `driver.imu.connect` is `serial://NAME:921600`, its
    /// `protocol` is `plumbline`. A link of that name is replaced.
    ///
    /// # Errors
    /// When there is no pseudo-terminal, or the link cannot be made.
    pub fn open(name: impl AsRef<Path>, about: SensorAbout) -> Result<Self, ClientError> {
        let name = name.as_ref().to_owned();
        let refused = |source: io::Error| ClientError::Line { path: name.clone(), source };
        let (line, device) = Line::open().map_err(|error| refused(error.into()))?;
        let line = Arc::new(line);
        let (stop, stopped) = UnixStream::pair().map_err(refused)?;
        link(&device, &name).map_err(refused)?;
        let mut this = Self {
            line: Arc::clone(&line),
            name: name.clone(),
            terminal: device,
            stop: Some(stop),
            thread: None,
            sequence: 0,
        };
        let answers = move || line.answer(&stopped, about);
        this.thread = Some(Builder::new().name("plumbline-imu".into()).spawn(answers).map_err(refused)?);
        Ok(this)
    }

    /// Sends a sample, measured at its stamp by CLOCK_MONOTONIC. One that finds the line full, since no flight reads it, is
    /// dropped, as on a serial line.
    ///
    /// # Errors
    /// When a value is not a finite number, or the line fails.
    pub fn send(&mut self, sample: &ImuSample) -> Result<(), ClientError> {
        if !sample.is_finite() {
            return Err(ClientError::NotFinite);
        }
        let axes = |v: &[f64]| std::array::from_fn(|k| v[k] as f32);
        let message = Message::Imu(Imu {
            sequence: self.sequence,
            time_ns: sample.stamp.as_nanos() as u64,
            gyro_rad_s: axes(sample.gyro.as_slice()),
            accel_m_s2: axes(sample.accel.as_slice()),
            temperature_c: None,
            flags: Flags::default(),
        });
        self.sequence = self.sequence.wrapping_add(1);
        Ok(self.line.send(&message)?)
    }
}

/// Makes the link `name` to `terminal`; one that is there is replaced in one step, anything else is left alone.
fn link(terminal: &Path, name: &Path) -> io::Result<()> {
    if !name.is_symlink() {
        return symlink(terminal, name);
    }
    let mut new = name.as_os_str().to_owned();
    new.push(format!(".{}.new", std::process::id()));
    let _ = std::fs::remove_file(&new);
    symlink(terminal, &new)?;
    std::fs::rename(&new, name)
}

impl Drop for ImuLine {
    fn drop(&mut self) {
        // The name goes with the device, whose number is given to another program; but a program that was started in the
        // place of this one may have taken the name.
        if std::fs::read_link(&self.name).is_ok_and(|terminal| terminal == self.terminal) {
            let _ = std::fs::remove_file(&self.name);
        }
        self.stop = None;
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

impl Line {
    /// A pseudo-terminal, and the name of the host's end.
    fn open() -> Result<(Self, PathBuf), Errno> {
        let device = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC)?;
        rustix::io::ioctl_fionbio(&device, true)?;
        grantpt(&device)?;
        unlockpt(&device)?;
        let name = ptsname(&device, Vec::new())?;
        let flags = rustix::fs::OFlags::RDWR | rustix::fs::OFlags::NOCTTY | rustix::fs::OFlags::CLOEXEC;
        let host = rustix::fs::open(&name, flags, rustix::fs::Mode::empty())?;
        let mut settings = rustix::termios::tcgetattr(&host)?;
        settings.make_raw();
        rustix::termios::tcsetattr(&host, rustix::termios::OptionalActions::Now, &settings)?;
        let name = PathBuf::from(name.to_string_lossy().into_owned());
        Ok((Self { device, _host: host, writing: Mutex::new(()) }, name))
    }

    fn send(&self, message: &Message) -> Result<(), Errno> {
        let mut frame = [0; MAX_FRAME];
        let bytes = encode(message, &mut frame);
        let _turn = self.writing.lock().unwrap_or_else(PoisonError::into_inner);
        match rustix::io::retry_on_intr(|| rustix::io::write(&self.device, bytes)) {
            // What is cut off is found by its checksum.
            Ok(_) | Err(Errno::AGAIN) => Ok(()),
            Err(error) => Err(error),
        }
    }

    /// Answers questions until the other end of `stop` closes.
    fn answer(&self, stop: &UnixStream, about: SensorAbout) {
        let mut receiver = Receiver::new();
        let mut bytes = [0; 256];
        loop {
            let mut ends = [PollFd::new(&self.device, PollFlags::IN), PollFd::new(stop, PollFlags::IN)];
            match poll(&mut ends, None) {
                Ok(_) | Err(Errno::INTR) => {}
                Err(_) => return,
            }
            if !ends[1].revents().is_empty() {
                return;
            }
            let received_ns = monotonic_ns() as u64;
            let count = match rustix::io::read(&self.device, &mut bytes) {
                Ok(count) => count,
                Err(Errno::AGAIN | Errno::INTR) => continue,
                Err(_) => return,
            };
            for message in bytes[..count].iter().filter_map(|byte| receiver.push(*byte)?.ok()) {
                let answer = answer_to(&message, received_ns, about);
                if answer.is_some_and(|answer| self.send(&answer).is_err()) {
                    return;
                }
            }
        }
    }
}

/// Answer of the device to what the flight asks.
fn answer_to(message: &Message, received_ns: u64, about: SensorAbout) -> Option<Message> {
    match *message {
        Message::AskTime { asked_ns } => {
            Some(Message::Time(Time { asked_ns, received_ns, sent_ns: monotonic_ns() as u64 }))
        }
        Message::AskHello => Some(Message::Hello(Hello {
            protocol: VERSION,
            imu_rate_mhz: about.rate_mhz(),
            gyro_range_rad_s: about.gyro_range_rad_s as f32,
            accel_range_m_s2: about.accel_range_m_s2 as f32,
            ..Hello::default()
        })),
        // The rate is the sensor's own, and there are no triggers.
        Message::Set(_) => {
            Some(Message::Settings(Settings { imu_rate_mhz: about.rate_mhz(), ..Settings::default() }))
        }
        _ => None,
    }
}
