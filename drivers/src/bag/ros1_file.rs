//! Messages of a ROS 1 bag, format 2.0 (<https://wiki.ros.org/Bags/Format/2.0>).
//!
//! Our own: the kept crate for it (rosbag) maps files into memory, where a file that is cut while it is read ends the
//! process, needs the index that a killed recorder has not written, and bounds nothing. Here records are read one after the
//! other, chunks are unpacked whole, and every length is bounded before memory is taken for it. A bag without an index
//! (`.bag.active`) is read up to its end.

use super::container::{MAX_EXPANSION, MAX_RECORD_BYTES, MAX_TOPICS, Step, Topic, number_of, unreadable};
use crate::DriverError;
use std::collections::BTreeMap;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

/// First line of a bag.
const MAGIC: &[u8] = b"#ROSBAG V2.0\n";
/// First bytes of a bag of any version.
const ANY_VERSION: &[u8] = b"#ROSBAG V";
/// Longest header of a record, bytes: the longest has the name of a topic.
const MAX_HEADER_BYTES: usize = 64 << 10;
/// Records in a row that are no messages: an index has one for each topic and chunk.
const MAX_IDLE_RECORDS: u64 = 1_000_000;

/// Kinds of records.
mod op {
    pub(super) const MESSAGE: u8 = 2;
    pub(super) const BAG: u8 = 3;
    pub(super) const CHUNK: u8 = 5;
    pub(super) const CONNECTION: u8 = 7;
}

/// One ROS 1 bag, wherever its bytes come from.
pub(crate) struct Ros1File<R> {
    path: PathBuf,
    input: R,
    /// Topics of the connections by their numbers.
    connections: BTreeMap<u32, usize>,
    /// The chunk that is handed out, and how far it is.
    chunk: Vec<u8>,
    chunk_at: usize,
    /// Bytes of a record outside of chunks; its header.
    data: Vec<u8>,
    header: Vec<u8>,
    read_bytes: u64,
    expanded_bytes: u64,
    idle_records: u64,
    /// Beginning of the index; `None` until the recorder is done.
    index_at: Option<u64>,
    is_begun: bool,
}

/// Reasons why the bytes cannot be read.
#[derive(Debug)]
enum Damage {
    /// The bytes end within a record.
    Truncated,
    /// The file cannot be read.
    Io(io::Error),
    /// The bytes are no bag; in words.
    Malformed(String),
}

impl Damage {
    fn malformed(what: impl Into<String>) -> Self {
        Self::Malformed(what.into())
    }
}

impl<R: Read> Ros1File<R> {
    /// `path` names it in messages.
    pub(crate) fn new(path: &Path, input: R) -> Self {
        Self {
            path: path.to_owned(),
            input,
            connections: BTreeMap::new(),
            chunk: Vec::new(),
            chunk_at: 0,
            data: Vec::new(),
            header: Vec::new(),
            read_bytes: 0,
            expanded_bytes: 0,
            idle_records: 0,
            index_at: None,
            is_begun: false,
        }
    }

    /// The next message of a topic that can be flown with, into `payload`; topics that are met are added to `topics`.
    pub(crate) fn next(
        &mut self,
        topics: &mut Vec<Topic>,
        payload: &mut Vec<u8>,
    ) -> Result<Step, DriverError> {
        match self.step(topics, payload) {
            Ok(step) => Ok(step),
            Err(Damage::Truncated) => Ok(Step::Truncated),
            Err(Damage::Io(error)) => Err(unreadable(&self.path, error)),
            Err(Damage::Malformed(what)) => Err(DriverError::refused(&self.path, self.in_words(&what))),
        }
    }

    fn in_words(&self, what: &str) -> String {
        match self.is_begun {
            true => format!(
                "damaged within the first {} bytes: {what}; copy it again, or save what can be with `rosbag reindex`",
                self.read_bytes
            ),
            false => what.to_owned(),
        }
    }

    fn step(&mut self, topics: &mut Vec<Topic>, payload: &mut Vec<u8>) -> Result<Step, Damage> {
        if !self.is_begun {
            self.begin()?;
        }
        loop {
            let Some((record, source)) = self.record()? else { return self.end() };
            let data = match source {
                Source::Chunk(start, end) => &self.chunk[start..end],
                Source::File => &self.data,
            };
            self.idle_records = if record.op == op::MESSAGE { 0 } else { self.idle_records + 1 };
            self.expanded_bytes += data.len() as u64;
            match record.op {
                op::MESSAGE => {
                    let connection =
                        record.number.ok_or_else(|| Damage::malformed("a message of no connection"))?;
                    let topic = self.connections.get(&connection).copied();
                    let known = topic.and_then(|topic| Some((topic, topics.get(topic)?.format?)));
                    if let Some((topic, format)) = known {
                        payload.clear();
                        payload.extend_from_slice(data);
                        return Ok(Step::Message(topic, format));
                    }
                }
                op::CONNECTION => connect(&mut self.connections, topics, &record, data)?,
                op::CHUNK => self.unpack(&record)?,
                op::BAG => self.describe(&record)?,
                _ => {}
            }
            if self.is_bomb() {
                return Err(Damage::malformed("it expands to far more records than a recording has"));
            }
        }
    }

    /// Reads the line that a bag begins with.
    fn begin(&mut self) -> Result<(), Damage> {
        let mut magic = [0; MAGIC.len()];
        self.fill(&mut magic)?;
        if magic != MAGIC {
            return Err(Damage::malformed(match magic.starts_with(ANY_VERSION) {
                true => {
                    "is a ROS 1 bag of another version than 2.0; convert it: `rosbag fix OLD.bag NEW.bag`"
                }
                false => "is no ROS 1 bag",
            }));
        }
        self.is_begun = true;
        Ok(())
    }

    /// True if the data read so far are far more than the file can have been made of.
    fn is_bomb(&self) -> bool {
        let bound = (MAX_RECORD_BYTES as u64).saturating_add(self.read_bytes.saturating_mul(MAX_EXPANSION));
        self.idle_records > MAX_IDLE_RECORDS || self.expanded_bytes > bound
    }

    /// The end of the file: a bag whose recorder is done has an index, and ends no sooner.
    fn end(&self) -> Result<Step, Damage> {
        Ok(match self.index_at {
            Some(at) if at <= self.read_bytes => Step::End,
            _ => Step::Truncated,
        })
    }

    /// The next record: of the chunk, or behind it. `None` at the end of the file.
    fn record(&mut self) -> Result<Option<(Head, Source)>, Damage> {
        if self.chunk_at < self.chunk.len() {
            let mut rest = Fields(&self.chunk[self.chunk_at..]);
            let lost = || Damage::malformed("a record is longer than its chunk");
            let header = rest.block().ok_or_else(lost)?;
            let head = Head::parse(header)?;
            let data = rest.block().ok_or_else(lost)?;
            let end = self.chunk.len() - rest.0.len();
            self.chunk_at = end;
            return Ok(Some((head, Source::Chunk(end - data.len(), end))));
        }
        let Some(length) = self.length_or_end()? else { return Ok(None) };
        bounded(length, MAX_HEADER_BYTES)?;
        let mut header = std::mem::take(&mut self.header);
        let read = self.read_into(&mut header, length);
        self.header = header;
        read?;
        let head = Head::parse(&self.header)?;
        let mut length = [0; 4];
        self.fill(&mut length)?;
        let length = u32::from_le_bytes(length) as usize;
        bounded(length, MAX_RECORD_BYTES)?;
        let mut data = std::mem::take(&mut self.data);
        let read = self.read_into(&mut data, length);
        self.data = data;
        read?;
        Ok(Some((head, Source::File)))
    }

    /// The length of a record's header; `None` at the end of the file.
    fn length_or_end(&mut self) -> Result<Option<usize>, Damage> {
        let mut length = Vec::new();
        let count = self.read_some(&mut length, 4)?;
        match <[u8; 4]>::try_from(length.as_slice()) {
            Ok(length) => Ok(Some(u32::from_le_bytes(length) as usize)),
            Err(_) if count == 0 => Ok(None),
            Err(_) => Err(Damage::Truncated),
        }
    }

    /// Reads `length` bytes; memory is taken as they come.
    fn read_into(&mut self, buffer: &mut Vec<u8>, length: usize) -> Result<(), Damage> {
        buffer.clear();
        match self.read_some(buffer, length)? {
            count if count == length => Ok(()),
            _ => Err(Damage::Truncated),
        }
    }

    fn read_some(&mut self, buffer: &mut Vec<u8>, length: usize) -> Result<usize, Damage> {
        let count = self.input.by_ref().take(length as u64).read_to_end(buffer).map_err(Damage::Io)?;
        self.read_bytes += count as u64;
        Ok(count)
    }

    fn fill(&mut self, bytes: &mut [u8]) -> Result<(), Damage> {
        self.input.read_exact(bytes).map_err(|error| match error.kind() {
            io::ErrorKind::UnexpectedEof => Damage::Truncated,
            _ => Damage::Io(error),
        })?;
        self.read_bytes += bytes.len() as u64;
        Ok(())
    }

    /// Unpacks the chunk in `data`.
    fn unpack(&mut self, record: &Head) -> Result<(), Damage> {
        let size = record.size.ok_or_else(|| Damage::malformed("a chunk without a size"))? as usize;
        bounded(size, MAX_RECORD_BYTES)?;
        // The recorder writes sizes when it is done with the chunk: what follows are the records of an unfinished one.
        if self.data.is_empty() {
            self.chunk.clear();
            self.chunk_at = 0;
            return Ok(());
        }
        let packed = self.data.as_slice();
        let limit = size as u64 + 1;
        self.chunk.clear();
        self.chunk_at = 0;
        let unpacked = match record.compression.as_deref() {
            Some(b"none") | None => {
                std::mem::swap(&mut self.chunk, &mut self.data);
                Ok(self.chunk.len())
            }
            Some(b"bz2") => bzip2::read::BzDecoder::new(packed).take(limit).read_to_end(&mut self.chunk),
            Some(b"lz4") => {
                lz4::Decoder::new(packed).and_then(|decoder| decoder.take(limit).read_to_end(&mut self.chunk))
            }
            Some(_) => return Err(Damage::malformed("a chunk is compressed in another way than bz2 or lz4")),
        };
        match unpacked {
            Ok(count) if count == size => Ok(()),
            Ok(_) => Err(Damage::malformed("a chunk has not the size that it says")),
            Err(error) => Err(Damage::malformed(format!("a chunk cannot be unpacked: {error}"))),
        }
    }

    fn describe(&mut self, record: &Head) -> Result<(), Damage> {
        if record.is_encrypted {
            return Err(Damage::malformed("it is encrypted"));
        }
        self.index_at = record.index_at.filter(|at| *at > 0);
        Ok(())
    }
}

impl Ros1File<&[u8]> {
    /// True if a file with this beginning is a ROS 1 bag, of any version.
    pub(crate) fn is_begun_by(magic: &[u8]) -> bool {
        magic.starts_with(ANY_VERSION)
    }
}

/// Place of a record's data.
enum Source {
    Chunk(usize, usize),
    File,
}

/// Fields of the header of a record.
#[derive(Debug, Default)]
struct Head {
    op: u8,
    /// Number of the connection.
    number: Option<u32>,
    topic: Option<String>,
    compression: Option<Vec<u8>>,
    /// Length of a chunk when it is unpacked, bytes.
    size: Option<u32>,
    index_at: Option<u64>,
    is_encrypted: bool,
}

impl Head {
    fn parse(header: &[u8]) -> Result<Self, Damage> {
        let mut head = Self::default();
        let mut op = None;
        each_field(header, |name, value| match name {
            b"op" => op = value.first().copied(),
            b"conn" => head.number = number(value),
            b"topic" => head.topic = Some(String::from_utf8_lossy(value).into_owned()),
            b"compression" => head.compression = Some(value.to_vec()),
            b"size" => head.size = number(value),
            b"index_pos" => head.index_at = value.try_into().ok().map(u64::from_le_bytes),
            b"encryptor" => head.is_encrypted = !value.is_empty(),
            _ => {}
        })?;
        head.op = op.ok_or_else(|| Damage::malformed("a record of no kind"))?;
        Ok(head)
    }
}

/// Takes the topic of a connection, whose type is in its data.
fn connect(
    connections: &mut BTreeMap<u32, usize>,
    topics: &mut Vec<Topic>,
    record: &Head,
    data: &[u8],
) -> Result<(), Damage> {
    let mut type_name = String::new();
    each_field(data, |name, value| {
        if name == b"type" {
            type_name = String::from_utf8_lossy(value).into_owned();
        }
    })?;
    let (Some(number), Some(topic)) = (record.number, &record.topic) else {
        return Err(Damage::malformed("a connection without number or topic"));
    };
    if connections.len() < MAX_TOPICS
        && let Some(topic) = number_of(topics, topic, &type_name, "ros1")
    {
        connections.insert(number, topic);
    }
    Ok(())
}

/// Calls `take` with the name and value of each field of a header.
fn each_field(header: &[u8], mut take: impl FnMut(&[u8], &[u8])) -> Result<(), Damage> {
    let mut rest = Fields(header);
    while !rest.0.is_empty() {
        let field = rest.block().ok_or_else(|| Damage::malformed("a field is longer than its header"))?;
        let equals = field.iter().position(|byte| *byte == b'=');
        let equals = equals.ok_or_else(|| Damage::malformed("a field without a value"))?;
        take(&field[..equals], &field[equals + 1..]);
    }
    Ok(())
}

fn number(value: &[u8]) -> Option<u32> {
    value.try_into().ok().map(u32::from_le_bytes)
}

fn bounded(length: usize, most: usize) -> Result<(), Damage> {
    match length <= most {
        true => Ok(()),
        false => Err(Damage::malformed(format!("a length of {length} bytes, beyond {most}"))),
    }
}

/// Blocks of bytes that each begin with their length.
struct Fields<'a>(&'a [u8]);

impl<'a> Fields<'a> {
    fn block(&mut self) -> Option<&'a [u8]> {
        let (length, rest) = self.0.split_first_chunk()?;
        let (block, rest) = rest.split_at_checked(u32::from_le_bytes(*length) as usize)?;
        self.0 = rest;
        Some(block)
    }
}
