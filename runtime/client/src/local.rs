//! The local socket of a flight: its records, and commands to it.

use crate::error::ClientError;
use crate::socket::{Deadline, connect, receive, send_all};
use plumbline_record::layout::INSTANT_BYTES;
use plumbline_record::local::content::LocalRecord;
use plumbline_record::local::incoming::Incoming;
use plumbline_record::local::record::{Header, Kind, Kinds, MAGIC};
use plumbline_record::local::request::{Answer, At, Request};
use std::net::Shutdown;
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Time within which a flight takes a request.
const SEND_LIMIT: Duration = Duration::from_secs(2);
/// Time within which a flight answers for an instant that it does not wait for.
const INSTANT_LIMIT: Duration = Duration::from_secs(2);
/// Time within which a flight greets.
const GREETING_LIMIT: Duration = Duration::from_secs(5);

/// Connection to a flight's local socket. Odometry and the main parts of estimates come until another subscription.
#[derive(Debug)]
pub struct Local {
    path: PathBuf,
    requests: Requests,
    incoming: Incoming,
    may_command: bool,
    /// Connection that asks for states at instants, once one was asked for.
    asking: Option<Box<Self>>,
}

impl Local {
    /// Connects to the socket at `path` (`local.path` of the flight), which may come into being within `patience`.
    ///
    /// # Errors
    /// When no flight of this version listens there.
    pub fn connect(path: impl AsRef<Path>, patience: Duration) -> Result<Self, ClientError> {
        let path = path.as_ref().to_owned();
        let stream = connect(&path, patience)?;
        let mut local = Self { path, ..Self::over(stream) };
        match local.next_header(Some(GREETING_LIMIT))? {
            Some(Header { kind, .. }) if kind == Kind::Hello.kind() => {}
            Some(_) => return Err(ClientError::Foreign("no greeting came")),
            None => return Err(ClientError::Silent(GREETING_LIMIT.as_secs_f64())),
        }
        match local.content().split_first_chunk::<8>() {
            Some((magic, [rights, ..])) if *magic == MAGIC => local.may_command = rights & 1 != 0,
            _ => return Err(ClientError::Foreign("another greeting came")),
        }
        Ok(local)
    }

    /// Connection over a stream that is connected. Its first record is the greeting of the flight.
    #[must_use]
    pub fn over(stream: UnixStream) -> Self {
        let requests = Requests { stream, number: 0 };
        let incoming = Incoming::default();
        Self { path: PathBuf::new(), requests, incoming, may_command: false, asking: None }
    }

    /// True if the flight takes commands of this program's user.
    #[must_use]
    pub fn may_command(&self) -> bool {
        self.may_command
    }

    /// Asks for these kinds of records from now on.
    ///
    /// # Errors
    /// When the flight has gone.
    pub fn subscribe(&mut self, kinds: Kinds) -> Result<(), ClientError> {
        self.requests.send(&Request::Subscribe(kinds)).map(|_| ())
    }

    /// Waits for the next record of any kind, without a limit where there is no `timeout`; `None` when none came in time.
    /// Its content is that of [`Self::content`].
    ///
    /// # Errors
    /// When the flight has gone, or sends what is no record.
    pub fn next_header(&mut self, timeout: Option<Duration>) -> Result<Option<Header>, ClientError> {
        let deadline = Deadline::after(timeout);
        loop {
            let next = self.incoming.next_header();
            if let Some(header) = next.map_err(|_| ClientError::Foreign("a record is too long"))? {
                return Ok(Some(header));
            }
            match receive(&self.requests.stream, self.incoming.room(), deadline)? {
                Some(count) => self.incoming.add(count),
                None => return Ok(None),
            }
        }
    }

    /// Waits for the next record, for as long as the read timeout of the stream. Its content is that of [`Self::content`].
    ///
    /// # Errors
    /// When the flight has gone, is silent, or sends what is no record.
    pub fn next_record(&mut self) -> Result<LocalRecord, ClientError> {
        let limit = self.requests.stream.read_timeout()?;
        let silent = ClientError::Silent(limit.unwrap_or_default().as_secs_f64());
        let header = self.next_header(limit)?.ok_or(silent)?;
        LocalRecord::decode(&header, self.content()).map_err(ClientError::Foreign)
    }

    /// Writing end, for another thread, which numbers its requests by itself.
    ///
    /// # Errors
    /// When the system has no more file descriptors.
    pub fn requests(&self) -> Result<Requests, ClientError> {
        Ok(Requests { stream: self.requests.stream.try_clone()?, number: 0 })
    }

    /// Content of the record whose header came last, until the next call that waits.
    #[must_use]
    pub fn content(&self) -> &[u8] {
        self.incoming.content()
    }

    /// Gives a command, and waits for its answer until `timeout`. It goes over a connection of its own: the records of this
    /// one are left alone.
    ///
    /// # Errors
    /// When the flight has gone, or does not answer.
    pub fn command(&self, command: &Request, timeout: Duration) -> Result<Answer, ClientError> {
        let deadline = Deadline::after(Some(timeout));
        let mut other = Self::connect(&self.path, Duration::ZERO)?;
        other.subscribe(Kinds::default())?;
        let number = other.requests.send(command)?;
        while let Some(header) = other.next_header(deadline.left())? {
            if header.kind == Kind::Result.kind() && header.sequence == number {
                return Answer::decode(number, other.content()).map_err(ClientError::Foreign);
            }
        }
        Err(ClientError::Silent(timeout.as_secs_f64()))
    }

    /// State at an instant, as the bytes of its record; or the answer of a flight that takes no more requests at present. The
    /// first call makes a connection of its own for this and those that follow: the records of this one are left alone.
    ///
    /// # Errors
    /// When the flight has gone, or does not answer.
    pub fn at(&mut self, at: At) -> Result<Result<[u8; INSTANT_BYTES], Answer>, ClientError> {
        let mut other = match self.asking.take() {
            Some(other) => other,
            None => {
                let mut other = Box::new(Self::connect(&self.path, Duration::ZERO)?);
                other.subscribe(Kinds::default())?;
                other
            }
        };
        let limit = Duration::from_millis(at.patience_ms.into()) + INSTANT_LIMIT;
        let deadline = Deadline::after(Some(limit));
        let number = other.requests.send(&Request::At(at))?;
        while let Some(header) = other.next_header(deadline.left())? {
            if header.sequence != number {
                continue;
            }
            let told = if header.kind == Kind::Instant.kind() {
                let short = ClientError::Foreign("a state at an instant is too short");
                Ok(*other.content().first_chunk().ok_or(short)?)
            } else if header.kind == Kind::Result.kind() {
                Err(Answer::decode(number, other.content()).map_err(ClientError::Foreign)?)
            } else {
                continue;
            };
            self.asking = Some(other);
            return Ok(told);
        }
        Err(ClientError::Silent(limit.as_secs_f64()))
    }
}

/// Writing end of a connection.
#[derive(Debug)]
pub struct Requests {
    stream: UnixStream,
    number: u64,
}

impl Requests {
    /// Sends a request; its answer carries the number that is returned.
    ///
    /// # Errors
    /// When the flight has gone, or takes nothing.
    pub fn send(&mut self, request: &Request) -> Result<u64, ClientError> {
        self.number += 1;
        send_all(&self.stream, &request.encode(self.number), SEND_LIMIT)?;
        Ok(self.number)
    }

    /// Ends the connection, also for the thread that reads.
    pub fn close(&self) {
        let _ = self.stream.shutdown(Shutdown::Both);
    }
}
