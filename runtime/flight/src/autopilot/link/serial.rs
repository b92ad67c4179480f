//! A serial device, which may go away and come back.

use super::super::inbox::CHUNK;
use super::super::words::News;
use super::LinkError;
use crate::schedule::ticker::Monotonic;
use plumbline_drivers::serial::open_line;
use std::fs::File;
use std::io::{ErrorKind, Read as _, Write as _};
use std::os::fd::{AsFd as _, BorrowedFd};

/// A device that went away is looked for this often, ns.
const REOPEN_NS: i64 = 1_000_000_000;

/// A serial device; one that goes away is looked for again.
#[derive(Debug)]
pub struct SerialLink {
    device: String,
    baud: u32,
    file: Option<File>,
    tried: Monotonic,
    /// The rest of a message that the device had no room for.
    rest: Vec<u8>,
    /// News of the device that was not told yet.
    news: Option<News>,
}

impl SerialLink {
    pub(super) fn open(device: &str, baud: u32) -> Result<Self, LinkError> {
        let file = open_device(device, baud).map_err(|source| {
            let reason = format!(
                "the device cannot be used ({source}); check the path, its permissions (group dialout), and that no other program has \
                 it open"
            );
            LinkError { at: device.to_owned(), reason }
        })?;
        let rest = Vec::with_capacity(CHUNK);
        let device = device.to_owned();
        Ok(Self { device, baud, file: Some(file), tried: Monotonic::now(), rest, news: None })
    }

    pub(super) fn read(&mut self, into: &mut [u8; CHUNK]) -> usize {
        let Some(file) = &mut self.file else { return 0 };
        match file.read(into) {
            Ok(count) if count > 0 => count,
            Err(error) if is_for_now(&error) => 0,
            outcome => {
                self.close(outcome.err());
                0
            }
        }
    }

    pub(super) fn descriptor(&self) -> Option<BorrowedFd<'_>> {
        self.file.as_ref().map(File::as_fd)
    }

    /// State of the device since the last time.
    pub(super) fn news(&mut self) -> Option<News> {
        self.news.take()
    }

    /// A message follows the rest of the one before, or is not sent at all.
    pub(super) fn send(&mut self, message: &[u8], now: Monotonic) -> bool {
        self.reopen(now);
        let mut rest = std::mem::take(&mut self.rest);
        while !rest.is_empty() && self.file.is_some() {
            match self.write(&rest) {
                0 => {
                    self.rest = rest;
                    return false;
                }
                count => drop(rest.drain(..count)),
            }
        }
        match self.write(message) {
            0 => false,
            count => {
                self.rest.extend_from_slice(&message[count..]);
                true
            }
        }
    }

    fn write(&mut self, bytes: &[u8]) -> usize {
        let Some(file) = &mut self.file else { return 0 };
        match file.write(bytes) {
            Ok(count) => count,
            Err(error) if is_for_now(&error) => 0,
            Err(error) => {
                self.close(Some(error));
                0
            }
        }
    }

    fn close(&mut self, error: Option<std::io::Error>) {
        self.news = Some(News::Gone(error.and_then(|error| error.raw_os_error())));
        self.file = None;
    }

    fn reopen(&mut self, now: Monotonic) {
        if self.file.is_some() || now.0.saturating_sub(self.tried.0) < REOPEN_NS {
            return;
        }
        self.tried = now;
        self.file = open_device(&self.device, self.baud).ok();
        if self.file.is_some() {
            self.rest.clear();
            self.news = Some(News::Back);
        }
    }
}

/// True if there is nothing to do but to try again.
fn is_for_now(error: &std::io::Error) -> bool {
    matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted)
}

/// Opens a serial device for ourselves.
fn open_device(device: &str, baud: u32) -> std::io::Result<File> {
    Ok(File::from(open_line(device.as_ref(), baud)?))
}
