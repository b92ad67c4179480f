//! The messages of a bag, file after file, in the order in which they were recorded and in bounded memory.
//!
//! The container of a file is told by its first bytes: MCAP (`mcap_file`), SQLite (`sqlite_file`) or ROS 1 (`ros1_file`). A file
//! that breaks off, because the recorder was killed, is read up to there.

use super::container::{Input, Step, Topic, peeked};
use super::mcap_file::McapFile;
use super::messages::Format;
use super::ros1_file::Ros1File;
use super::sqlite_file::SqliteFile;
use super::wire::Encoding;
use crate::DriverError;
use std::collections::VecDeque;
use std::fs::File;
use std::path::{Path, PathBuf};

/// First bytes of a frame of Zstandard.
const ZSTD: [u8; 4] = [0x28, 0xb5, 0x2f, 0xfd];

/// A message that can be flown with.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Message<'a> {
    /// Number of its topic.
    pub(crate) topic: usize,
    /// Kind and encoding of the message.
    pub(crate) format: Format,
    /// Content.
    pub(crate) bytes: &'a [u8],
}

/// The files of a bag, one after the other.
pub(crate) struct Messages {
    rest: VecDeque<PathBuf>,
    file: Option<(PathBuf, Container)>,
    topics: Vec<Topic>,
    payload: Vec<u8>,
    /// True if a file breaks off.
    pub(crate) is_truncated: bool,
}

impl Messages {
    /// From the beginning of the first of `files`.
    pub(crate) fn new(files: &[PathBuf]) -> Self {
        let rest = files.iter().cloned().collect();
        Self { rest, file: None, topics: Vec::new(), payload: Vec::new(), is_truncated: false }
    }

    /// The next message of one of `names`; its topic is numbered as there.
    ///
    /// # Errors
    /// As [`Self::next`].
    pub(crate) fn next_of(&mut self, names: &[String]) -> Result<Option<Message<'_>>, DriverError> {
        loop {
            let Some(Message { topic, format, .. }) = self.next()? else { return Ok(None) };
            if let Some(which) = names.iter().position(|name| *name == self.topics[topic].name) {
                return Ok(Some(Message { topic: which, format, bytes: &self.payload }));
            }
        }
    }

    /// Topics that were met so far.
    pub(crate) fn topics(&self) -> &[Topic] {
        &self.topics
    }

    /// The next message of a topic that can be flown with; `None` at the end.
    ///
    /// # Errors
    /// When a file cannot be read, is no bag or a damaged one.
    pub(crate) fn next(&mut self) -> Result<Option<Message<'_>>, DriverError> {
        loop {
            if self.file.is_none() {
                let Some(path) = self.rest.pop_front() else { return Ok(None) };
                let container = Container::open(&path)?;
                self.file = Some((path, container));
            }
            let Some((path, file)) = &mut self.file else { return Ok(None) };
            match file.next(&mut self.topics, &mut self.payload)? {
                Step::Message(topic, format) => {
                    if format.encoding == Encoding::Cdr && self.payload.starts_with(&ZSTD) {
                        let message = "holds messages that are compressed one by one (Zstandard); write it anew without: `ros2 bag convert`";
                        return Err(DriverError::refused(path.as_path(), message));
                    }
                    return Ok(Some(Message { topic, format, bytes: &self.payload }));
                }
                Step::End => self.file = None,
                Step::Truncated => {
                    self.is_truncated = true;
                    self.file = None;
                }
            }
        }
    }
}

impl Container {
    /// Opens a file of whatever kind.
    fn open(path: &Path) -> Result<Self, DriverError> {
        let file = File::open(path).map_err(|e| DriverError::io(path, e))?;
        let (magic, input) = peeked(path, Box::new(file))?;
        if magic.starts_with(&ZSTD) {
            return Err(DriverError::refused(path, "is compressed by Zstandard; unpack it: `zstd -d FILE`"));
        }
        if SqliteFile::is_begun_by(&magic) {
            return SqliteFile::open(path).map(Self::Sqlite);
        }
        if magic.is_empty() {
            return Err(DriverError::refused(
                path,
                "is empty, or breaks off before its first message; copy it again",
            ));
        }
        Ok(match Ros1File::is_begun_by(&magic) {
            true => Self::Ros1(Ros1File::new(path, input)),
            false => Self::Mcap(Box::new(McapFile::new(path, input))),
        })
    }
}

/// A file of whatever kind.
enum Container {
    Mcap(Box<McapFile<Input>>),
    Ros1(Ros1File<Input>),
    Sqlite(SqliteFile),
}

impl Container {
    fn next(&mut self, topics: &mut Vec<Topic>, payload: &mut Vec<u8>) -> Result<Step, DriverError> {
        match self {
            Self::Mcap(file) => file.next(topics, payload),
            Self::Ros1(file) => file.next(topics, payload),
            Self::Sqlite(file) => file.next(topics, payload),
        }
    }
}
