//! A serial device: opened for ourselves, never waited for without end, and looked for again when it goes away.

use super::low_latency::ask_for_low_latency;
use crate::DriverError;
use crate::clock::monotonic_ns;
use crate::inertial::LinkFigures;
use plumbline_config::options::SerialLine;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fd::OwnedFd;
use rustix::fs::{Mode, OFlags};
use rustix::io::Errno;
use rustix::termios::{ControlModes, OptionalActions, QueueSelector};
use std::path::{Path, PathBuf};

/// A device that went away is looked for this often, ns.
const REOPEN_NS: i64 = 250_000_000;

/// Opens a serial device for ourselves: raw, eight bits, no parity, no flow control, never blocking, without delay where
/// its driver can do without.
///
/// # Errors
/// Error of the system: `NOTTY` for what is no serial device, `BUSY` for one that another process has locked.
pub fn open_line(device: &Path, baud: u32) -> rustix::io::Result<OwnedFd> {
    let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::NONBLOCK | OFlags::CLOEXEC;
    let port = rustix::fs::open(device, flags, Mode::empty())?;
    rustix::termios::ioctl_tiocexcl(&port)?;
    let mut line = rustix::termios::tcgetattr(&port)?;
    line.make_raw();
    line.control_modes |= ControlModes::CREAD | ControlModes::CLOCAL | ControlModes::CS8;
    line.control_modes &= !(ControlModes::PARENB | ControlModes::CSTOPB | ControlModes::CRTSCTS);
    line.set_speed(baud)?;
    rustix::termios::tcsetattr(&port, OptionalActions::Now, &line)?;
    // Most drivers have nothing to be told.
    let _ = ask_for_low_latency(&port);
    // What waited from before we came belongs to nobody.
    rustix::termios::tcflush(&port, QueueSelector::IOFlush)?;
    Ok(port)
}

/// A serial device that may come and go.
#[derive(Debug)]
pub struct Port {
    device: PathBuf,
    baud: u32,
    port: Option<OwnedFd>,
    tried_ns: i64,
    figures: LinkFigures,
}

/// Outcome of waiting.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Waited {
    /// Something is to be read.
    Bytes,
    /// Nothing came.
    Nothing,
    /// The device is there anew: what is known of the one before is void.
    Anew,
}

impl Port {
    /// Opens the device; one that is not there yet is waited for.
    ///
    /// # Errors
    /// When what is there can never be the device: it is none, may not be opened, or another program has it.
    pub fn open(line: &SerialLine) -> Result<Self, DriverError> {
        let mut port = Self {
            device: PathBuf::from(&line.device),
            baud: line.baud,
            port: None,
            tried_ns: i64::MIN,
            figures: LinkFigures::default(),
        };
        match port.try_open() {
            Ok(()) => Ok(port),
            Err(Errno::NOENT | Errno::NODEV | Errno::NXIO | Errno::IO) => Ok(port),
            Err(error) => Err(port.refusal(error)),
        }
    }

    /// Waits for something to be read, at most `patience_ms`. While the device is away it is looked for.
    pub fn wait(&mut self, patience_ms: u32) -> Waited {
        let patience = i64::from(patience_ms) * 1_000_000;
        if self.port.is_none()
            && monotonic_ns().saturating_sub(self.tried_ns) >= REOPEN_NS
            && self.try_open().is_ok()
        {
            return Waited::Anew;
        }
        let timeout = Timespec { tv_sec: patience / 1_000_000_000, tv_nsec: patience % 1_000_000_000 };
        let Some(port) = &self.port else {
            // Nothing to wait for but time.
            let _ = poll(&mut [], Some(&timeout));
            return Waited::Nothing;
        };
        let mut polled = [PollFd::new(port, PollFlags::IN)];
        match poll(&mut polled, Some(&timeout)) {
            // A device that went away is told by reading from it.
            Ok(count) if count > 0 => Waited::Bytes,
            _ => Waited::Nothing,
        }
    }

    /// Takes what is there, as much as fits; 0 when there is nothing (more).
    pub fn read(&mut self, into: &mut [u8]) -> usize {
        let Some(port) = &self.port else { return 0 };
        match rustix::io::read(port, into) {
            Ok(count) if count > 0 => count,
            Err(Errno::AGAIN | Errno::INTR) => 0,
            outcome => {
                self.lose(outcome.err());
                0
            }
        }
    }

    /// Hands bytes to the device; how many it took.
    pub fn write(&mut self, bytes: &[u8]) -> usize {
        let Some(port) = &self.port else { return 0 };
        match rustix::io::write(port, bytes) {
            Ok(count) => count,
            Err(Errno::AGAIN | Errno::INTR) => 0,
            Err(error) => {
                self.lose(Some(error));
                0
            }
        }
    }

    /// Connections of the device.
    pub fn figures(&self) -> LinkFigures {
        self.figures
    }

    fn try_open(&mut self) -> rustix::io::Result<()> {
        self.tried_ns = monotonic_ns();
        let opened = open_line(&self.device, self.baud);
        self.figures.last_error = opened.as_ref().err().map(|error| error.raw_os_error());
        self.port = Some(opened?);
        self.figures.is_open = true;
        self.figures.opened += 1;
        Ok(())
    }

    fn lose(&mut self, error: Option<Errno>) {
        self.port = None;
        self.figures.is_open = false;
        self.figures.lost += 1;
        self.figures.last_error = error.map(Errno::raw_os_error);
    }

    fn refusal(&self, error: Errno) -> DriverError {
        let message = match error {
            Errno::NOTTY | Errno::INVAL => {
                "it is no serial device; `plumbline devices` lists those that are there"
            }
            Errno::ACCESS | Errno::PERM => {
                "this user may not open it; add the user to the group of the device (dialout) and log in again"
            }
            Errno::BUSY => {
                "another program has it open; close that program, such as ModemManager or a serial console"
            }
            _ => return DriverError::io(&self.device, error.into()),
        };
        DriverError::refused(&self.device, message)
    }
}
