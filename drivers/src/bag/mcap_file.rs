//! Messages of an MCAP file.
//!
//! Chunks are checked against their CRC before any of them is handed out.

use super::container::{MAX_EXPANSION, MAX_RECORD_BYTES, MAX_TOPICS, Step, Topic, number_of, unreadable};
use super::messages::Format;
use crate::DriverError;
use mcap::McapError;
use mcap::records::{Record, op};
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};
use std::collections::BTreeMap;
use std::io::Read;
use std::path::{Path, PathBuf};

/// Least that is read from a file at once, bytes.
const READ_BYTES: usize = 1 << 16;
/// Most that is read at once, bytes: what a record says of its length may be invented.
const MAX_READ_BYTES: usize = 4 << 20;
/// Records in a row that are no messages: an index has one for each topic and chunk.
const MAX_IDLE_RECORDS: u64 = 1_000_000;

/// One MCAP file, wherever its bytes come from.
pub(crate) struct McapFile<R> {
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

impl<R: Read> McapFile<R> {
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

    /// True if the data read so far are far more than the file can have been made of.
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
                        Some((topic, format)) => return Ok(Step::Message(topic, format)),
                        None if self.is_bomb() => return Err(expands(&self.path, self.read_bytes)),
                        None => continue,
                    }
                }
            };
            let room = self.reader.insert(wanted.clamp(READ_BYTES, MAX_READ_BYTES));
            let read = self.input.read(room).map_err(|e| unreadable(&self.path, e))?;
            self.reader.notify_read(read);
            self.read_bytes += read as u64;
        }
    }
}

fn expands(path: &Path, read_bytes: u64) -> DriverError {
    let message = format!(
        "the first {read_bytes} bytes expand to far more records than a recording has; record it again without compression"
    );
    DriverError::refused(path, message)
}

fn damaged(path: &Path, read_bytes: u64, error: &McapError) -> DriverError {
    let message = match error {
        McapError::BadMagic if read_bytes < READ_BYTES as u64 + 1 => {
            "is no bag: neither an MCAP file nor one of SQLite (.db3) or ROS 1 (.bag); give the file that `ros2 bag record` or \
             `rosbag record` wrote"
                .to_owned()
        }
        error => format!(
            "damaged within the first {read_bytes} bytes: {error}; copy it again, or save what can be with `mcap recover`"
        ),
    };
    DriverError::refused(path, message)
}

/// Takes from a record what is needed of it: the topic of a message, whose content goes into `payload`.
fn take(
    opcode: u8,
    data: &[u8],
    schemas: &mut BTreeMap<u16, String>,
    channels: &mut BTreeMap<u16, usize>,
    topics: &mut Vec<Topic>,
    payload: &mut Vec<u8>,
) -> Result<Option<(usize, Format)>, McapError> {
    if ![op::SCHEMA, op::CHANNEL, op::MESSAGE].contains(&opcode) {
        return Ok(None);
    }
    match mcap::parse_record(opcode, data)? {
        Record::Schema { header, .. } if schemas.len() < MAX_TOPICS => {
            schemas.insert(header.id, header.name);
        }
        Record::Channel(channel) if channels.len() < MAX_TOPICS => {
            let type_name = schemas.get(&channel.schema_id).cloned().unwrap_or_default();
            if let Some(topic) = number_of(topics, &channel.topic, &type_name, &channel.message_encoding) {
                channels.insert(channel.id, topic);
            }
        }
        Record::Message { header, data } => {
            let topic = channels.get(&header.channel_id).copied();
            if let Some((topic, format)) = topic.and_then(|topic| Some((topic, topics.get(topic)?.format?))) {
                payload.clear();
                payload.extend_from_slice(&data);
                return Ok(Some((topic, format)));
            }
        }
        _ => {}
    }
    Ok(None)
}
