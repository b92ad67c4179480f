//! One reader of the socket: what it wants, what waits for it, and what it asks for.

use super::outbox::Outbox;
use super::record::{Kind, Kinds, MAGIC, encoded};
use super::request::{Inbox, Numbered, Request, TooLong};
use super::words::{LinkWord, LinkWords};
use rustix::event::epoll::EventFlags;
use std::io::{self, ErrorKind, Read as _};
use std::os::unix::net::UnixStream;
use std::sync::Arc;

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
    /// Whether the reader may give commands.
    pub fn may_command(&self) -> bool {
        !matches!(self, Self::Read)
    }
}

/// One reader.
#[derive(Debug)]
pub struct Reader {
    pub stream: UnixStream,
    pub outbox: Outbox,
    pub kinds: Kinds,
    /// Rate of the pictures that it wants, mHz.
    pub pictures_mhz: u32,
    pub rights: Rights,
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

impl Reader {
    /// Reader that has the greeting before it; its outbox holds `max_bytes`.
    pub fn new(stream: UnixStream, rights: Rights, max_bytes: usize, upstream: u64) -> Self {
        let mut outbox = Outbox::new(max_bytes);
        outbox.push_kept(encoded(Kind::Hello as u16, 0, |to| {
            to.extend(MAGIC);
            to.extend(u32::from(rights.may_command()).to_le_bytes());
            to.extend([0; 4]);
        }));
        Self {
            stream,
            outbox,
            kinds: Kinds::DEFAULT,
            pictures_mhz: 0,
            rights,
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

    /// Whether it wants records of this kind.
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
    }

    /// Writes what it takes; nothing while it is full.
    ///
    /// # Errors
    /// When it has gone.
    pub fn flush(&mut self, upstream: u64) -> io::Result<()> {
        if !self.is_full && !self.outbox.is_empty() {
            let upstream = upstream.saturating_sub(self.upstream_before);
            self.is_full = !self.outbox.flush(&mut self.stream, upstream)?;
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
                Ok(count) => self.inbox.add(count),
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
