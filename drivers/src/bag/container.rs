//! The messages of a bag, file after file, in the order in which they were recorded and in bounded memory.
//!
//! Chunks are checked against their CRC before any of them is handed out. A file that breaks off, because the recorder was
//! killed, is read up to its last whole chunk.

use super::messages::Kind;
use crate::DriverError;
use mcap::McapError;
use mcap::records::{Record, op};
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};
use std::collections::{BTreeMap, VecDeque};
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

/// Longest record or chunk that is read, bytes: four images of 8192 x 8192 grey pixels.
const MAX_RECORD_BYTES: usize = 256 << 20;
/// Least that is read from a file at once, bytes.
const READ_BYTES: usize = 1 << 16;
/// Most that is read at once, bytes: what a record says of its length may be invented.
const MAX_READ_BYTES: usize = 4 << 20;
/// Records in a row that are no messages: an index has one for each topic and chunk.
const MAX_IDLE_RECORDS: u64 = 1_000_000;
/// Records may be this many times as long as the compressed bytes that hold them. Images that are not black throughout are far
/// below.
const MAX_EXPANSION: u64 = 1_000;
/// Topics and schemas that a bag may have.
const MAX_TOPICS: usize = 4096;

/// What a bag says of a topic.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Topic {
    /// Its name, such as /cam0/image_raw.
    pub(crate) name: String,
    /// The type of its messages.
    pub(crate) type_name: String,
    /// What can be flown with of it, if it can be read.
    pub(crate) kind: Option<Kind>,
}

/// The files of a bag, one after the other.
pub(crate) struct Messages {
    rest: VecDeque<PathBuf>,
    file: Option<Container<File>>,
    topics: Vec<Topic>,
    payload: Vec<u8>,
    /// Whether a file broke off.
    pub(crate) is_truncated: bool,
}

impl Messages {
    /// From the beginning of the first of `files`.
    pub(crate) fn new(files: impl IntoIterator<Item = PathBuf>) -> Self {
        let rest = files.into_iter().collect();
        Self { rest, file: None, topics: Vec::new(), payload: Vec::new(), is_truncated: false }
    }

    /// The next message of one of `names`; its topic is numbered as there.
    ///
    /// # Errors
    /// As [`Self::next`].
    pub(crate) fn next_of(&mut self, names: &[String]) -> Result<Option<Message<'_>>, DriverError> {
        loop {
            let Some(Message { topic, kind, .. }) = self.next()? else { return Ok(None) };
            if let Some(which) = names.iter().position(|name| *name == self.topics[topic].name) {
                return Ok(Some(Message { topic: which, kind, bytes: &self.payload }));
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
    /// When a file cannot be read, is no MCAP or a damaged one.
    pub(crate) fn next(&mut self) -> Result<Option<Message<'_>>, DriverError> {
        loop {
            if self.file.is_none() {
                let Some(path) = self.rest.pop_front() else { return Ok(None) };
                let file = File::open(&path).map_err(|e| DriverError::io(&path, e))?;
                self.file = Some(Container::new(&path, file));
            }
            let Some(file) = &mut self.file else { return Ok(None) };
            match file.next(&mut self.topics, &mut self.payload)? {
                Step::Message(topic, kind) => {
                    return Ok(Some(Message { topic, kind, bytes: &self.payload }));
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

/// A message that can be flown with.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Message<'a> {
    /// Number of its topic.
    pub(crate) topic: usize,
    /// What it is.
    pub(crate) kind: Kind,
    /// Its content.
    pub(crate) bytes: &'a [u8],
}

/// What came next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Step {
    /// A message of the topic of this number, in the payload.
    Message(usize, Kind),
    End,
    Truncated,
}

/// One MCAP file, wherever its bytes come from.
pub(crate) struct Container<R> {
    path: PathBuf,
    input: R,
    reader: LinearReader,
    schemas: BTreeMap<u16, String>,
    /// Channels by their numbers, and the topics that they are.
    channels: BTreeMap<u16, usize>,
    read_bytes: u64,
    /// Bytes of the records so far.
    expanded_bytes: u64,
    /// Records since the last message.
    idle_records: u64,
}

impl<R: Read> Container<R> {
    /// `path` names it in messages.
    pub(crate) fn new(path: &Path, input: R) -> Self {
        let options = LinearReaderOptions::default()
            .with_prevalidate_chunk_crcs(true)
            .with_record_length_limit(MAX_RECORD_BYTES);
        Self {
            path: path.to_owned(),
            input,
            reader: LinearReader::new_with_options(options),
            schemas: BTreeMap::new(),
            channels: BTreeMap::new(),
            read_bytes: 0,
            expanded_bytes: 0,
            idle_records: 0,
        }
    }

    /// Whether what is read is far more than the file can have been made of.
    fn is_bomb(&self) -> bool {
        let bound = (MAX_RECORD_BYTES as u64).saturating_add(self.read_bytes.saturating_mul(MAX_EXPANSION));
        self.idle_records > MAX_IDLE_RECORDS || self.expanded_bytes > bound
    }

    /// The next message of a topic that can be flown with, into `payload`; topics that are met are added to `topics`.
    pub(crate) fn next(
        &mut self,
        topics: &mut Vec<Topic>,
        payload: &mut Vec<u8>,
    ) -> Result<Step, DriverError> {
        loop {
            let wanted = match self.reader.next_event() {
                None => return Ok(Step::End),
                Some(Err(McapError::UnexpectedEof)) => return Ok(Step::Truncated),
                Some(Err(error)) => return Err(damaged(&self.path, self.read_bytes, &error)),
                Some(Ok(LinearReadEvent::ReadRequest(bytes))) => bytes,
                Some(Ok(LinearReadEvent::Record { opcode, data })) => {
                    self.expanded_bytes += data.len() as u64;
                    self.idle_records = if opcode == op::MESSAGE { 0 } else { self.idle_records + 1 };
                    let (schemas, channels) = (&mut self.schemas, &mut self.channels);
                    let taken = take(opcode, data, schemas, channels, topics, payload);
                    match taken.map_err(|error| damaged(&self.path, self.read_bytes, &error))? {
                        Some((topic, kind)) => return Ok(Step::Message(topic, kind)),
                        None if self.is_bomb() => return Err(expands(&self.path, self.read_bytes)),
                        None => continue,
                    }
                }
            };
            let room = self.reader.insert(wanted.clamp(READ_BYTES, MAX_READ_BYTES));
            let read = self.input.read(room).map_err(|e| DriverError::io(&self.path, e))?;
            self.reader.notify_read(read);
            self.read_bytes += read as u64;
        }
    }
}

fn expands(path: &Path, read_bytes: u64) -> DriverError {
    let message = format!(
        "the first {read_bytes} bytes expand to far more records than a recording has; record it again without compression"
    );
    DriverError::malformed(path, message)
}

fn damaged(path: &Path, read_bytes: u64, error: &McapError) -> DriverError {
    let message = match error {
        McapError::BadMagic if read_bytes < READ_BYTES as u64 + 1 => {
            "is no MCAP file; give a bag recorded with `ros2 bag record -s mcap`, or convert it".to_owned()
        }
        error => format!(
            "damaged within the first {read_bytes} bytes: {error}; copy it again, or save what can be with `mcap recover`"
        ),
    };
    DriverError::malformed(path, message)
}

/// Takes from a record what is needed of it: the topic of a message, whose content goes into `payload`.
fn take(
    opcode: u8,
    data: &[u8],
    schemas: &mut BTreeMap<u16, String>,
    channels: &mut BTreeMap<u16, usize>,
    topics: &mut Vec<Topic>,
    payload: &mut Vec<u8>,
) -> Result<Option<(usize, Kind)>, McapError> {
    if ![op::SCHEMA, op::CHANNEL, op::MESSAGE].contains(&opcode) {
        return Ok(None);
    }
    match mcap::parse_record(opcode, data)? {
        Record::Schema { header, .. } if schemas.len() < MAX_TOPICS => {
            schemas.insert(header.id, header.name);
        }
        Record::Channel(channel) if channels.len() < MAX_TOPICS && topics.len() < MAX_TOPICS => {
            let type_name = schemas.get(&channel.schema_id).cloned().unwrap_or_default();
            let kind = Kind::of(&type_name).filter(|_| channel.message_encoding == "cdr");
            // The same topic again in another file has another number there.
            let known = topics.iter().position(|topic| topic.name == channel.topic && topic.kind == kind);
            let topic = known.unwrap_or_else(|| {
                topics.push(Topic { name: channel.topic, type_name, kind });
                topics.len() - 1
            });
            channels.insert(channel.id, topic);
        }
        Record::Message { header, data } => {
            let topic = channels.get(&header.channel_id).copied();
            if let Some((topic, kind)) = topic.and_then(|topic| Some((topic, topics.get(topic)?.kind?))) {
                payload.clear();
                payload.extend_from_slice(&data);
                return Ok(Some((topic, kind)));
            }
        }
        _ => {}
    }
    Ok(None)
}
