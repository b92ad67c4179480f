//! One file of a log while it is written: messages into chunks.
//!
//! A chunk is complete in memory before it is written, at the latest half a second of data or a megabyte
//! after the last. Chunks are compressed with LZ4.

use super::channel::{Channel, descriptors};
use super::part_file::{OpenPart, PartFile};
use super::part_header::{METADATA_NAME, PartHeader};
use super::seal::Seal;
use mcap::records::{MessageHeader, Metadata};
use mcap::{Compression, McapError, WriteOptions};
use std::collections::BTreeMap;

/// A chunk is written when it holds this many bytes.
const CHUNK_BYTES: u64 = 1 << 20;
/// And when its first message is this much older than its last, ns.
const CHUNK_NS: u64 = 500_000_000;
/// Overhead of a message beside its payload, with its share of the chunk's index, bytes.
const MESSAGE_OVERHEAD: u64 = 64;
/// Kept free in a part for the summary at its end, bytes: schemas and statistics, and for each chunk its
/// index.
const SUMMARY_BYTES: u64 = (64 << 10) + MORE_TOPICS_BYTES;
/// Schemas of the topics beyond the first twenty, each of which lists all messages.
pub(super) const MORE_TOPICS_BYTES: u64 = (8 << 10) * (Channel::LOGGED.len() as u64 - 20);
const CHUNK_INDEX_BYTES: u64 = 512;
/// The state of the recording at the end of a chunk, bytes at most.
const RECORDING_BYTES: u64 = 128;
/// A part that is being written.
pub struct Part {
    mcap: mcap::Writer<PartFile>,
    ids: [u16; Channel::LOGGED.len()],
    counts: [u32; Channel::LOGGED.len()],
    seal: Seal,
    complete_bytes: u64,
    chunks: u64,
    chunk_bytes: u64,
    chunk_since_ns: Option<u64>,
}

impl Part {
    /// Begins a part: what it belongs to, and its channels.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn begin(
        file: PartFile,
        metadata: BTreeMap<String, String>,
        about: &PartHeader,
    ) -> Result<Self, McapError> {
        let options = WriteOptions::new()
            .library(format!("plumbline {}", about.build.version))
            .compression(Some(Compression::Lz4))
            .chunk_size(None)
            // Chunks are complete in memory before they are written.
            .disable_seeking(true);
        let mut mcap = options.create(file)?;
        mcap.write_metadata(&Metadata { name: METADATA_NAME.into(), metadata })?;
        let mut ids = [0; Channel::LOGGED.len()];
        for channel in Channel::LOGGED {
            let descriptors = descriptors(channel, about.images);
            let schema = mcap.add_schema(channel.schema(about.images), "protobuf", &descriptors)?;
            ids[channel as usize] =
                mcap.add_channel(schema, channel.channel(), "protobuf", &BTreeMap::new())?;
        }
        Ok(Self {
            mcap,
            ids,
            counts: [0; Channel::LOGGED.len()],
            seal: Seal::default(),
            complete_bytes: 0,
            chunks: 0,
            chunk_bytes: 0,
            chunk_since_ns: None,
        })
    }

    /// Bytes in the file once the last chunk was complete.
    pub fn complete_bytes(&self) -> u64 {
        self.complete_bytes
    }

    /// Size of the file with the chunk, a further message and the summary at its end, at most.
    pub fn bytes_after(&self, message_bytes: usize) -> u64 {
        let message = message_bytes as u64 + MESSAGE_OVERHEAD;
        let chunk_end = RECORDING_BYTES + MESSAGE_OVERHEAD;
        let summary = SUMMARY_BYTES + (self.chunks + 2) * CHUNK_INDEX_BYTES;
        self.complete_bytes + self.chunk_bytes + message + chunk_end + summary
    }

    /// True if it holds more than its beginning.
    pub fn has_data(&self) -> bool {
        self.chunks > 1 || self.has_chunk()
    }

    /// True if a chunk has been begun.
    pub fn has_chunk(&self) -> bool {
        self.chunk_since_ns.is_some()
    }

    /// True if the chunk must be completed after a message of `time_ns`.
    pub fn is_chunk_due(&self, time_ns: u64) -> bool {
        let age_ns = self.chunk_since_ns.map_or(0, |since| time_ns.saturating_sub(since));
        self.chunk_bytes >= CHUNK_BYTES || age_ns >= CHUNK_NS
    }

    /// The seal over its inputs and orders so far.
    pub fn seal(&self) -> Vec<u8> {
        self.seal.value()
    }

    /// Adds a message to the chunk.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn append(&mut self, channel: Channel, time_ns: u64, payload: &[u8]) -> Result<(), McapError> {
        self.seal.add(channel, payload);
        let count = &mut self.counts[channel as usize];
        let header = MessageHeader {
            channel_id: self.ids[channel as usize],
            sequence: *count,
            log_time: time_ns,
            publish_time: time_ns,
        };
        *count = count.wrapping_add(1);
        self.chunk_bytes += payload.len() as u64 + MESSAGE_OVERHEAD;
        self.chunk_since_ns.get_or_insert(time_ns);
        self.mcap.write_to_known_channel(&header, payload)
    }

    /// Completes the chunk: what was added so far is in the file, which `open` has opened.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn end_chunk(&mut self, open: &OpenPart) -> Result<(), McapError> {
        self.mcap.flush()?;
        self.complete_bytes = open.position();
        self.chunks += 1;
        self.chunk_bytes = 0;
        self.chunk_since_ns = None;
        Ok(())
    }

    /// Writes the summary at the end.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn finish(&mut self) -> Result<(), McapError> {
        self.mcap.finish().map(|_| ())
    }

    /// Closes the file.
    ///
    /// # Errors
    /// When the medium fails.
    pub fn close(self) -> std::io::Result<()> {
        self.mcap.into_inner().close()
    }

    /// Shortens the file to its complete chunks, and closes it.
    pub fn cut(self) {
        self.mcap.into_inner().cut(self.complete_bytes);
    }
}
