//! Reports of the network process, and its admission to the socket.

use super::request::Failure;
use std::os::unix::net::UnixStream;
use std::sync::mpsc::Sender;

/// Word of the network process.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum LinkWord {
    /// It has begun to read.
    Begun,
    /// Others can reach the vehicle.
    Ready,
    /// It cannot start.
    Failed(Failure),
    /// Sign of life.
    Alive,
}

/// Where words of the network process go.
#[derive(Clone, Debug)]
pub struct LinkWords(pub Sender<LinkWord>);

impl LinkWords {
    pub(super) fn tell(&self, word: LinkWord) {
        // Its supervisor may be over.
        let _ = self.0.send(word);
    }
}

/// A connected stream that is to be served with all rights.
#[derive(Debug)]
pub struct Admission {
    pub stream: UnixStream,
    pub words: LinkWords,
}
