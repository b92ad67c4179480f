//! The messages of a bag, file after file, in the order in which they were recorded and in bounded memory.
//!
//! The container of a file is told by its first bytes: MCAP (`mcap_file`), SQLite (`sqlite_file`) or ROS 1 (`ros1_file`), each
//! also as a whole file compressed by Zstandard (`packed`). A file that breaks off, because the recorder was killed, is read
//! up to there.

use super::mcap_file::McapFile;
use super::messages::Format;
use super::packed::{self, Unpacked};
use super::ros1_file::Ros1File;
use super::sqlite_file::SqliteFile;
use super::wire::Encoding;
use crate::DriverError;
use std::collections::VecDeque;
use std::fs::File;
use std::io::{Cursor, Read};
use std::path::{Path, PathBuf};

/// Longest record, chunk or message that is read, bytes: four images of 8192 x 8192 grey pixels.
pub(crate) const MAX_RECORD_BYTES: usize = 256 << 20;
/// What is compressed may expand to this many times its length. Images that are not black throughout are far below.
pub(crate) const MAX_EXPANSION: u64 = 1_000;
/// Topics that a bag may have.
pub(crate) const MAX_TOPICS: usize = 4096;
/// Bytes that tell the container of a file.
const MAGIC_BYTES: usize = 16;

/// What a bag says of a topic.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Topic {
    /// Its name, such as /cam0/image_raw.
    pub(crate) name: String,
    /// The type of its messages.
    pub(crate) type_name: String,
    /// Format of its messages; `None` where they cannot be flown with.
    pub(crate) format: Option<Format>,
}

/// Number of a topic among `topics`, to which it is added if it is new: the same topic again in another file has another
/// number there. `None` beyond the bound.
pub(crate) fn number_of(
    topics: &mut Vec<Topic>,
    name: &str,
    type_name: &str,
    encoding: &str,
) -> Option<usize> {
    let format = Format::of(type_name, encoding);
    let known = topics.iter().position(|topic| topic.name == name && topic.format == format);
    if known.is_none() && topics.len() < MAX_TOPICS {
        topics.push(Topic { name: name.to_owned(), type_name: type_name.to_owned(), format });
        return Some(topics.len() - 1);
    }
    known
}

/// A message that can be flown with.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Message<'a> {
    /// Number of its topic.
    pub(crate) topic: usize,
    /// What it is, and how it is written.
    pub(crate) format: Format,
    /// Its content.
    pub(crate) bytes: &'a [u8],
}

/// What came next in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Step {
    /// A message of the topic of this number, in the payload.
    Message(usize, Format),
    End,
    Truncated,
}

/// The files of a bag, one after the other.
pub(crate) struct Messages {
    rest: VecDeque<BagFile>,
    file: Option<Container>,
    topics: Vec<Topic>,
    payload: Vec<u8>,
    /// Whether a file broke off.
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

/// Bytes of a file from its beginning.
pub(crate) type Input = Box<dyn Read + Send>;

/// First bytes of the file at `path`, and all of it.
fn begun(path: &Path) -> Result<(Vec<u8>, Input), DriverError> {
    let file = File::open(path).map_err(|e| DriverError::io(path, e))?;
    peeked(path, Box::new(file))
}

/// First bytes of `input`, and all of it.
pub(crate) fn peeked(path: &Path, mut input: Input) -> Result<(Vec<u8>, Input), DriverError> {
    let mut magic = Vec::new();
    let read = input.by_ref().take(MAGIC_BYTES as u64).read_to_end(&mut magic);
    read.map_err(|e| DriverError::io(path, e))?;
    Ok((magic.clone(), Box::new(Cursor::new(magic).chain(input))))
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
