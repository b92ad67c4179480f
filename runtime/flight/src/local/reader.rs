//! One reader of the socket: what it wants, what waits for it, and what it asks for.

use super::allowance::Allowance;
use super::outbox::Outbox;
use super::record::{Kind, Kinds, MAGIC, TooLong, encoded};
use super::request::{Inbox, Numbered, Request};
use super::words::{LinkWord, LinkWords};
use rustix::event::epoll::EventFlags;
use std::io::{self, ErrorKind, Read as _};
use std::os::unix::net::UnixStream;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Requests of a reader that are read at a time: others wait for their turn.
const READS_AT_A_TIME: usize = 4;

/// Rights of a reader.
#[derive(Clone, Debug)]
pub enum Rights {
    /// Records only.
    Read,
    /// Commands too; the user of the reader, for the log.
    Command(u32),
    /// Commands and reports: the network process of this flight.
    Link(LinkWords),
}

impl Rights {
    /// True if the reader may give commands.
    pub fn may_command(&self) -> bool {
        !matches!(self, Self::Read)
    }
}

/// A reader that has taken nothing for so long does not read.
const UNREAD: Duration = Duration::from_secs(2);

/// A reader that has taken so many bytes reads: the system holds less for it.
const MORE_THAN_A_SOCKET: u64 = 1 << 20;

/// Silence of a reader, in order: one that does not read comes after all others, then one that has never asked anything.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Silence {
    is_unread: bool,
    is_without_request: bool,
    length: Duration,
}

impl Silence {
    /// True if the reader leaves unread what is sent to it.
    pub fn is_unread(self) -> bool {
        self.is_unread
    }
}

/// One reader.
#[derive(Debug)]
pub struct LocalReader {
    pub stream: UnixStream,
    /// Subject of its events.
    pub subject: u64,
    pub outbox: Outbox,
    pub kinds: Kinds,
    /// Rate of the pictures that it wants, mHz.
    pub pictures_mhz: u32,
    pub rights: Rights,
    /// States at instants that it may ask for.
    pub allowance: Allowance,
    /// User of its process, where that is known.
    pub user: Option<u32>,
    /// When it came, or sent its last request.
    heard: Instant,
    has_asked: bool,
    /// Since when it has taken nothing of what waits for it.
    full_since: Option<Instant>,
    /// Flags that epoll waits for.
    pub interest: EventFlags,
    inbox: Inbox,
    /// It has closed its writing side.
    is_mute: bool,
    /// It did not take everything at the last attempt.
    is_full: bool,
    /// Losses upstream before it came.
    upstream_before: u64,
}

impl LocalReader {
    /// Reader that has the greeting before it; its outbox holds `max_bytes`.
    pub fn new(
        stream: UnixStream,
        subject: u64,
        (rights, user): (Rights, Option<u32>),
        max_bytes: usize,
        upstream: u64,
    ) -> Self {
        let mut outbox = Outbox::new(max_bytes);
        outbox.push_kept(encoded(Kind::Hello.kind(), 0, |to| {
            to.extend(MAGIC);
            to.extend(u32::from(rights.may_command()).to_le_bytes());
            to.extend([0; 4]);
        }));
        Self {
            stream,
            subject,
            outbox,
            kinds: Kinds::DEFAULT,
            pictures_mhz: 0,
            rights,
            allowance: Allowance::of_a_reader(),
            user,
            heard: Instant::now(),
            has_asked: false,
            full_since: None,
            interest: EventFlags::IN,
            inbox: Inbox::default(),
            is_mute: false,
            is_full: false,
            upstream_before: upstream,
        }
    }

    /// Flags that epoll should wait for now.
    pub fn wanted_interest(&self) -> EventFlags {
        let mut interest = EventFlags::empty();
        interest.set(EventFlags::IN, !self.is_mute && !self.outbox.is_unread());
        interest.set(EventFlags::OUT, self.is_full);
        interest
    }

    /// True if it wants records of this kind.
    pub fn wants(&self, kind: Kind) -> bool {
        if kind == Kind::Picture { self.pictures_mhz > 0 } else { self.kinds.has(kind) }
    }

    /// Adds a record, if it wants the kind.
    pub fn offer(&mut self, kind: Kind, record: &Arc<[u8]>) {
        if self.wants(kind) {
            self.outbox.push(record);
        }
    }

    /// The system has room for it again.
    pub fn has_room(&mut self) {
        self.is_full = false;
        self.full_since = None;
    }

    /// Silence of the reader. `None` for the network process of this flight, and for one that is known to read: it has
    /// taken more than its socket holds.
    pub fn silence(&self, now: Instant) -> Option<Silence> {
        let unread = self.full_since.map(|since| now.saturating_duration_since(since)).unwrap_or_default();
        let is_unread = unread >= UNREAD;
        let is_known = !is_unread && self.outbox.taken() > MORE_THAN_A_SOCKET;
        if is_known || matches!(self.rights, Rights::Link(_)) {
            return None;
        }
        let length = if is_unread { unread } else { now.saturating_duration_since(self.heard) };
        Some(Silence { is_unread, is_without_request: !self.has_asked, length })
    }

    /// Writes what it takes; nothing while it is full.
    ///
    /// # Errors
    /// When it has gone.
    pub fn flush(&mut self, upstream: u64) -> io::Result<()> {
        if !self.is_full && !self.outbox.is_empty() {
            let upstream = upstream.saturating_sub(self.upstream_before);
            self.is_full = !self.outbox.flush(&mut self.stream, upstream)?;
            self.full_since = self.is_full.then(|| self.full_since.unwrap_or_else(Instant::now));
        }
        Ok(())
    }

    /// Reads requests, and has each of them carried out by `obey`.
    ///
    /// # Errors
    /// When it has gone, or sends what is no request.
    pub fn read(&mut self, mut obey: impl FnMut(&mut Self, Numbered)) -> io::Result<()> {
        for _ in 0..READS_AT_A_TIME {
            if self.is_mute || self.outbox.is_unread() {
                return Ok(());
            }
            match self.stream.read(self.inbox.room()) {
                // It may go on reading.
                Ok(0) => self.is_mute = true,
                Ok(count) => {
                    (self.heard, self.has_asked) = (Instant::now(), true);
                    self.inbox.add(count);
                }
                Err(error) if error.kind() == ErrorKind::WouldBlock => return Ok(()),
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
            while let Some(request) = self.inbox.next_request().map_err(|TooLong| ErrorKind::InvalidData)? {
                if let (Rights::Link(words), Some(word)) = (&self.rights, report(&request)) {
                    words.tell(word);
                } else {
                    obey(self, request);
                }
            }
        }
        Ok(())
    }
}

/// Report of the network process; `None` for a request.
fn report(request: &Numbered) -> Option<LinkWord> {
    match request.request.as_ref()? {
        Request::Ready => Some(LinkWord::Ready),
        Request::Failed(failure) => Some(LinkWord::Failed(failure.clone())),
        Request::Alive => Some(LinkWord::Alive),
        _ => None,
    }
}
