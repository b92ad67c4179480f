//! Unix stream sockets with time limits. Nothing raises SIGPIPE: a program in C would end by it.

use crate::error::ClientError;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fd::AsFd;
use rustix::io::Errno;
use rustix::net::{RecvFlags, SendFlags, recv, send};
use std::io::ErrorKind;
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::thread;
use std::time::{Duration, Instant};

/// Pause between attempts to connect.
const PAUSE: Duration = Duration::from_millis(20);

/// Connects to the socket at `path`, which may come into being within `patience`.
pub(crate) fn connect(path: &Path, patience: Duration) -> Result<UnixStream, ClientError> {
    let deadline = Deadline::after(Some(patience));
    loop {
        match UnixStream::connect(path) {
            Ok(stream) => return Ok(stream),
            Err(error)
                if !deadline.is_over()
                    && matches!(error.kind(), ErrorKind::NotFound | ErrorKind::ConnectionRefused) =>
            {
                thread::sleep(PAUSE.min(deadline.left().unwrap_or(PAUSE)));
            }
            Err(source) => return Err(ClientError::Connect { path: path.to_owned(), source }),
        }
    }
}

/// Time by which a call returns.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Deadline(Option<Instant>);

impl Deadline {
    /// Deadline after `limit`; none where there is no limit, or it is beyond the clock's range.
    pub(crate) fn after(limit: Option<Duration>) -> Self {
        Self(limit.and_then(|limit| Instant::now().checked_add(limit)))
    }

    /// Time that is left; none where there is no limit.
    pub(crate) fn left(self) -> Option<Duration> {
        self.0.map(|end| end.saturating_duration_since(Instant::now()))
    }

    /// True if the deadline has passed.
    pub(crate) fn is_over(self) -> bool {
        self.left() == Some(Duration::ZERO)
    }

    /// Waits until one of `flags` holds; whether it does.
    pub(crate) fn wait(self, file: &impl AsFd, flags: PollFlags) -> Result<bool, ClientError> {
        let left = self.left().and_then(|left| Timespec::try_from(left).ok());
        match poll(&mut [PollFd::new(file, flags)], left.as_ref()) {
            Ok(count) => Ok(count > 0),
            Err(Errno::INTR) => Ok(!self.is_over()),
            Err(error) => Err(error.into()),
        }
    }
}

/// Reads what is there, waiting for it until the deadline; `None` when nothing came.
pub(crate) fn receive(
    stream: &UnixStream,
    room: &mut [u8],
    deadline: Deadline,
) -> Result<Option<usize>, ClientError> {
    loop {
        match recv(stream, &mut *room, RecvFlags::DONTWAIT) {
            Ok((0, _)) => return Err(ClientError::Closed),
            Ok((count, _)) => return Ok(Some(count)),
            Err(Errno::INTR) => {}
            Err(Errno::AGAIN) => {
                if !deadline.wait(stream, PollFlags::IN)? {
                    return Ok(None);
                }
            }
            Err(error) => return Err(error.into()),
        }
    }
}

/// Sends all of `bytes` within `limit`.
pub(crate) fn send_all(stream: &UnixStream, mut bytes: &[u8], limit: Duration) -> Result<(), ClientError> {
    let deadline = Deadline::after(Some(limit));
    while !bytes.is_empty() {
        match send(stream, bytes, SendFlags::NOSIGNAL | SendFlags::DONTWAIT) {
            Ok(count) => bytes = &bytes[count..],
            Err(Errno::INTR) => {}
            Err(Errno::AGAIN) => {
                if !deadline.wait(stream, PollFlags::OUT)? {
                    return Err(ClientError::Silent(limit.as_secs_f64()));
                }
            }
            Err(error) => return Err(error.into()),
        }
    }
    Ok(())
}
