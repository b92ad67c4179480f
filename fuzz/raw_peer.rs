//! A peer of Zenoh that says what no session would: its handshake is that of Zenoh 1, and what follows is anything. Included by
//! path where it is wanted.

use std::io::{Error, ErrorKind, Read, Result, Write};

/// Version of the protocol.
const VERSION: u8 = 9;
/// Identifiers of messages and their flags, as in zenoh-protocol.
const INIT: u8 = 0x01;
const OPEN: u8 = 0x02;
const FRAME: u8 = 0x05;
const DECLARE: u8 = 0x1e;
const ACK: u8 = 0x20;
const SIZED: u8 = 0x40;
const SECONDS: u8 = 0x40;
const RELIABLE: u8 = 0x20;
const NAMED: u8 = 0x20;
/// The other side may be silent this long, s.
const LEASE_S: u64 = 60;

/// Role that a peer declares.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Talks to those it is connected to.
    Peer = 0b01,
    /// Talks to the one it is connected to.
    Client = 0b10,
    /// Passes messages on.
    Router = 0b00,
}

/// A peer whose transport is open.
pub struct RawPeer<S> {
    /// Below the transport.
    pub stream: S,
    next: u64,
}

impl<S: Read + Write> RawPeer<S> {
    /// Opens a transport as one of this kind and identifier.
    ///
    /// # Errors
    /// When the other side does not let it in, or says what is not understood.
    pub fn open(stream: S, kind: Kind, zid: [u8; 16]) -> Result<Self> {
        let mut peer = Self { stream, next: 0 };
        peer.send(&[&[INIT, VERSION, 0xf0 | kind as u8], &zid[..]].concat())?;
        let answer = peer.receive()?;
        let cookie = cookie(&answer).ok_or(Error::from(ErrorKind::InvalidData))?;
        let mut open = vec![OPEN | SECONDS];
        put_number(&mut open, LEASE_S);
        put_number(&mut open, 0);
        put_number(&mut open, cookie.len() as u64);
        open.extend(cookie);
        peer.send(&open)?;
        match peer.receive()?.first() {
            Some(header) if header & 0x3f == OPEN | ACK => Ok(peer),
            _ => Err(ErrorKind::ConnectionRefused.into()),
        }
    }

    /// Sends a batch, whatever it is.
    ///
    /// # Errors
    /// When the stream is closed.
    pub fn send(&mut self, batch: &[u8]) -> Result<()> {
        let length = u16::try_from(batch.len()).map_err(|_| ErrorKind::InvalidInput)?;
        self.stream.write_all(&[&length.to_le_bytes(), batch].concat())?;
        self.stream.flush()
    }

    /// Sends these messages of the network in a frame.
    ///
    /// # Errors
    /// As [`Self::send`].
    pub fn send_frame(&mut self, messages: &[u8]) -> Result<()> {
        let mut batch = vec![FRAME | RELIABLE];
        put_number(&mut batch, self.next);
        self.next += 1;
        batch.extend(messages);
        self.send(&batch)
    }

    /// Reads a batch.
    ///
    /// # Errors
    /// When the stream ends.
    pub fn receive(&mut self) -> Result<Vec<u8>> {
        let mut length = [0; 2];
        self.stream.read_exact(&mut length)?;
        let mut batch = vec![0; usize::from(u16::from_le_bytes(length))];
        self.stream.read_exact(&mut batch)?;
        Ok(batch)
    }
}

/// The cookie of the answer to INIT.
fn cookie(batch: &[u8]) -> Option<&[u8]> {
    let (header, rest) = batch.split_first()?;
    if header & 0x3f != INIT | ACK {
        return None;
    }
    let sizes = if header & SIZED != 0 { 3 } else { 0 };
    let zid = usize::from(rest.get(1)? >> 4) + 1;
    let (length, rest) = take_number(rest.get(2 + zid + sizes..)?)?;
    rest.get(..usize::try_from(length).ok()?)
}

/// A declaration of a key expression under a number, behind the one that `scope` stands for (0: none).
pub fn declare_key(id: u64, scope: u64, suffix: &str) -> Vec<u8> {
    let mut message = vec![DECLARE, NAMED];
    put_number(&mut message, id);
    put_number(&mut message, scope);
    put_number(&mut message, suffix.len() as u64);
    message.extend(suffix.as_bytes());
    message
}

fn put_number(bytes: &mut Vec<u8>, mut number: u64) {
    while number > 0x7f {
        bytes.push(number as u8 | 0x80);
        number >>= 7;
    }
    bytes.push(number as u8);
}

fn take_number(bytes: &[u8]) -> Option<(u64, &[u8])> {
    let end = bytes.iter().take(9).position(|byte| byte & 0x80 == 0)?;
    let number = bytes[..=end].iter().rev().fold(0, |number, byte| number << 7 | u64::from(byte & 0x7f));
    Some((number, &bytes[end + 1..]))
}
