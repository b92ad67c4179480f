//! Reads a log from beginning to end, part after part, in bounded memory.
//!
//! Every chunk is checked against its CRC before any of it is handed out. A file that breaks off (the
//! process was killed, the disk was full) is read up to its last complete chunk and counts as truncated.

use super::LogError;
use super::channel::Channel;
use super::part_header::{METADATA_NAME, PartHeader};
use super::parts::existing_parts;
use super::seal::Seal;
use mcap::McapError;
use mcap::records::{Record, op};
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};
use plumbline_record::Dropped;
use plumbline_record::parts::{End, RecordingState};
use plumbline_record::protobuf::decode;
use std::collections::{BTreeMap, VecDeque};
use std::fs::File;
use std::io::Read as _;
use std::path::{Path, PathBuf};

/// Longest record or chunk that is read, bytes: twice what the largest image takes.
const MAX_RECORD_BYTES: usize = 64 << 20;
/// Least that is read from the file at once, bytes.
const READ_BYTES: usize = 1 << 16;
/// Channels that a file may have, ours and others'.
const MAX_CHANNELS: usize = 1024;

/// A message as it stands in the log.
#[derive(Clone, Copy, Debug)]
pub struct RawMessage<'a> {
    /// Channel.
    pub channel: Channel,
    /// Time, ns.
    pub time_ns: u64,
    /// Encoded content.
    pub payload: &'a [u8],
}

/// End of a log.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ending {
    /// Not read that far yet.
    Unknown,
    /// With the flight.
    Flight,
    /// With the room that it was given.
    Room,
    /// In the middle: the recorder was killed, or could not write.
    Truncated,
}

/// A log that is being read.
pub struct LogReader {
    about: PartHeader,
    part: Part,
    rest: VecDeque<(u32, PathBuf)>,
    parts: usize,
    payload: Vec<u8>,
    total_bytes: u64,
    read_bytes: u64,
    ending: Ending,
    dropped: Dropped,
    is_seal_broken: bool,
}

impl LogReader {
    /// Opens the log whose first file is at `path`, with all its parts.
    ///
    /// # Errors
    /// When it cannot be read or is no flight log.
    pub fn open(path: &Path) -> Result<Self, LogError> {
        let mut rest: VecDeque<_> = existing_parts(path).into();
        let (_, first) = rest.pop_front().unwrap_or_else(|| (0, path.to_owned()));
        let (part, about) = Part::open(&first)?;
        // Parts of an older flight may lie beside it.
        rest.retain(|(_, path)| Part::open(path).is_ok_and(|(_, other)| other.flight == about.flight));
        let size = |path: &Path| path.metadata().map_or(0, |m| m.len());
        let total_bytes = size(&first) + rest.iter().map(|(_, path)| size(path)).sum::<u64>();
        Ok(Self {
            about,
            part,
            parts: 1 + rest.len(),
            rest,
            payload: Vec::new(),
            total_bytes,
            read_bytes: 0,
            ending: Ending::Unknown,
            dropped: Dropped::default(),
            is_seal_broken: false,
        })
    }

    /// Beginning of the log: flight, configuration, build.
    pub fn about(&self) -> &PartHeader {
        &self.about
    }

    /// Files of the log.
    pub fn parts(&self) -> usize {
        self.parts
    }

    /// The file that is being read.
    pub fn path(&self) -> &Path {
        &self.part.path
    }

    /// Bytes of all files.
    pub fn total_bytes(&self) -> u64 {
        self.total_bytes
    }

    /// Bytes read so far.
    pub fn read_bytes(&self) -> u64 {
        self.read_bytes + self.part.read_bytes
    }

    /// End of the log; known once [`Self::next_message`] has returned `None`.
    pub fn ending(&self) -> Ending {
        self.ending
    }

    /// Entries dropped, by the part read so far.
    pub fn dropped(&self) -> Dropped {
        self.dropped
    }

    /// True if an input differs from the recorded one, by the part read so far.
    pub fn is_seal_broken(&self) -> bool {
        self.is_seal_broken
    }

    /// The next message, or `None` at the end of the last part.
    ///
    /// # Errors
    /// When the file cannot be read or is damaged.
    pub fn next_message(&mut self) -> Result<Option<RawMessage<'_>>, LogError> {
        loop {
            match self.part.next_record(&mut self.payload)? {
                Step::Message { channel, time_ns } => {
                    self.notice(channel);
                    return Ok(Some(RawMessage { channel, time_ns, payload: &self.payload }));
                }
                Step::Other => {}
                Step::End | Step::Truncated
                    if self.ending == Ending::Flight || self.ending == Ending::Room =>
                {
                    return Ok(None);
                }
                Step::Truncated => return self.end_truncated(),
                Step::End => {
                    let Some((number, path)) = self.rest.pop_front() else { return self.end_truncated() };
                    self.follow(number, &path)?;
                }
            }
        }
    }

    fn end_truncated(&mut self) -> Result<Option<RawMessage<'_>>, LogError> {
        if let Some((_, next)) = self.rest.front() {
            let reason = format!("it breaks off, but {} goes on", next.display());
            return Err(self.part.damaged(&reason));
        }
        self.ending = Ending::Truncated;
        Ok(None)
    }

    /// Goes on with the next part.
    fn follow(&mut self, number: u32, path: &Path) -> Result<(), LogError> {
        if number != self.about.part + 1 {
            let reason =
                format!("part {} is missing; put all files of the log together", self.about.part + 1);
            return Err(LogError::unusable(path, reason));
        }
        let (part, about) = Part::open(path)?;
        self.read_bytes += self.part.read_bytes;
        (self.part, self.about) = (part, about);
        Ok(())
    }

    /// Looks at a message on its way: the seal, and what the recorder says of itself.
    fn notice(&mut self, channel: Channel) {
        self.part.seal.add(channel, &self.payload);
        if channel != Channel::Recording {
            return;
        }
        let Ok(recording) = decode::<RecordingState>(&self.payload) else { return };
        self.is_seal_broken |= recording.seal != self.part.seal.value();
        self.dropped = recording.dropped;
        match recording.end {
            End::NotYet => {}
            End::OfFlight => self.ending = Ending::Flight,
            End::OfRoom => self.ending = Ending::Room,
        }
    }
}

/// Record that was read.
enum Step {
    Message { channel: Channel, time_ns: u64 },
    Other,
    End,
    Truncated,
}

/// One file.
struct Part {
    path: PathBuf,
    file: File,
    reader: LinearReader,
    channels: BTreeMap<u16, Channel>,
    metadata: Option<BTreeMap<String, String>>,
    seal: Seal,
    read_bytes: u64,
}

impl Part {
    /// Opens a file and reads what it says of itself.
    fn open(path: &Path) -> Result<(Self, PartHeader), LogError> {
        let file = File::open(path).map_err(|e| LogError::io(path, e))?;
        let options = LinearReaderOptions::default()
            .with_prevalidate_chunk_crcs(true)
            .with_check_finishes_after_end_magic(true)
            .with_record_length_limit(MAX_RECORD_BYTES);
        let mut part = Self {
            path: path.to_owned(),
            file,
            reader: LinearReader::new_with_options(options),
            channels: BTreeMap::new(),
            metadata: None,
            seal: Seal::default(),
            read_bytes: 0,
        };
        let not_a_log = |reason: &str| LogError::NotALog { path: path.to_owned(), reason: reason.into() };
        let mut payload = Vec::new();
        while part.metadata.is_none() {
            match part.next_record(&mut payload) {
                Ok(Step::Other) => {}
                Err(LogError::Io { path, source }) => return Err(LogError::Io { path, source }),
                Ok(Step::Message { .. } | Step::End | Step::Truncated) | Err(_) => {
                    return Err(not_a_log(
                        "is not a flight log of plumbline; name a file that --record wrote",
                    ));
                }
            }
        }
        let metadata = part.metadata.take().unwrap_or_default();
        let about = PartHeader::from_metadata(&metadata).map_err(|reason| not_a_log(&reason))?;
        Ok((part, about))
    }

    fn damaged(&self, reason: &str) -> LogError {
        LogError::Damaged { path: self.path.clone(), offset: self.read_bytes, reason: reason.into() }
    }

    /// The next record; the content of a message goes into `payload`.
    fn next_record(&mut self, payload: &mut Vec<u8>) -> Result<Step, LogError> {
        loop {
            let wanted = match self.reader.next_event() {
                None => return Ok(Step::End),
                Some(Err(McapError::UnexpectedEof)) => return Ok(Step::Truncated),
                Some(Err(error)) => {
                    return Err(self.damaged(&error.to_string()));
                }
                Some(Ok(LinearReadEvent::ReadRequest(bytes))) => bytes,
                Some(Ok(LinearReadEvent::Record { opcode, data })) => {
                    let taken = take_record(opcode, data, &mut self.channels, &mut self.metadata, payload);
                    return taken.map_err(|reason| self.damaged(&reason));
                }
            };
            let read = self
                .file
                .read(self.reader.insert(wanted.max(READ_BYTES)))
                .map_err(|e| LogError::io(&self.path, e))?;
            self.reader.notify_read(read);
            self.read_bytes += read as u64;
        }
    }
}

/// Takes from a record what is needed of it.
fn take_record(
    opcode: u8,
    data: &[u8],
    channels: &mut BTreeMap<u16, Channel>,
    metadata: &mut Option<BTreeMap<String, String>>,
    payload: &mut Vec<u8>,
) -> Result<Step, String> {
    if ![op::CHANNEL, op::MESSAGE, op::METADATA].contains(&opcode) {
        return Ok(Step::Other);
    }
    match mcap::parse_record(opcode, data).map_err(|e| e.to_string())? {
        Record::Channel(channel) => {
            if let Some(known) = Channel::of_channel(&channel.topic) {
                channels.insert(channel.id, known);
            }
            if channels.len() > MAX_CHANNELS {
                return Err("it has far too many channels".into());
            }
        }
        Record::Metadata(record) if record.name == METADATA_NAME => *metadata = Some(record.metadata),
        Record::Message { header, data } => {
            if let Some(channel) = channels.get(&header.channel_id) {
                payload.clear();
                payload.extend_from_slice(&data);
                return Ok(Step::Message { channel: *channel, time_ns: header.log_time });
            }
        }
        _ => {}
    }
    Ok(Step::Other)
}
