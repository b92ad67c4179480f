//! The messages of a bag, file after file, in the order in which they were recorded and in bounded memory.
//!
//! The container of a file is told by its first bytes: MCAP (`mcap_file`), SQLite (`sqlite_file`) or ROS 1 (`ros1_file`), each
//! also as a whole file compressed by Zstandard (`packed`). A file that breaks off, because the recorder was killed, is read
//! up to there.

use super::container::{Input, Step, Topic, peeked};
use super::mcap_file::McapFile;
use super::messages::Format;
use super::packed::{self, Unpacked};
use super::ros1_file::Ros1File;
use super::sqlite_file::SqliteFile;
use super::wire::Encoding;
use crate::DriverError;
use std::collections::VecDeque;
use std::fs::File;
use std::path::{Path, PathBuf};

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
    rest: VecDeque<BagFile>,
    file: Option<Container>,
    topics: Vec<Topic>,
    payload: Vec<u8>,
    /// True if a file breaks off.
    pub(crate) is_truncated: bool,
}

impl Messages {
    /// From the beginning of the first of `files`.
    pub(crate) fn new(files: &[BagFile]) -> Self {
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
                let Some(file) = self.rest.pop_front() else { return Ok(None) };
                self.file = Some(file.open()?);
            }
            let Some(file) = &mut self.file else { return Ok(None) };
            match file.next(&mut self.topics, &mut self.payload)? {
                Step::Message(topic, format) => {
                    if format.encoding == Encoding::Cdr {
                        packed::unpack_message(&mut self.payload);
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

/// One file of a bag. A file that had to be unpacked is so once, for all who read it.
#[derive(Clone, Debug)]
pub(crate) struct BagFile {
    path: PathBuf,
    unpacked: Option<Unpacked>,
}

impl BagFile {
    /// The file at `path`; unpacks it if it is a compressed database.
    ///
    /// # Errors
    /// When it cannot be read or unpacked.
    pub(crate) fn new(path: &Path) -> Result<Self, DriverError> {
        let (magic, rest) = begun(path)?;
        let is_packed_database = packed::is_zstd(&magic) && {
            let (inner, _) = packed::begun_inside(path, rest)?;
            SqliteFile::is_begun_by(&inner)
        };
        let unpacked = is_packed_database.then(|| Unpacked::of(path)).transpose()?;
        Ok(Self { path: path.to_owned(), unpacked })
    }

    fn open(&self) -> Result<Container, DriverError> {
        if let Some(unpacked) = &self.unpacked {
            return SqliteFile::open(&self.path, unpacked.path()).map(Container::Sqlite);
        }
        let (magic, input) = begun(&self.path)?;
        if SqliteFile::is_begun_by(&magic) {
            return SqliteFile::open(&self.path, &self.path).map(Container::Sqlite);
        }
        let (magic, input) = match packed::is_zstd(&magic) {
            true => packed::begun_inside(&self.path, input)?,
            false => (magic, input),
        };
        if magic.is_empty() {
            return Err(DriverError::malformed(
                &self.path,
                "is empty, or breaks off before its first message; copy it again",
            ));
        }
        Ok(match Ros1File::is_begun_by(&magic) {
            true => Container::Ros1(Ros1File::new(&self.path, input)),
            false => Container::Mcap(Box::new(McapFile::new(&self.path, input))),
        })
    }
}

/// First bytes of the file at `path`, and all of it.
fn begun(path: &Path) -> Result<(Vec<u8>, Input), DriverError> {
    let file = File::open(path).map_err(|e| DriverError::io(path, e))?;
    peeked(path, Box::new(file))
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
