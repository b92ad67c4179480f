//! Writes a log: messages into chunks, chunks into parts, parts within the limits of the disk.
//!
//! Whatever ends the process or fills the disk, the files hold all chunks but the last ([`super::part`]).

use super::channel::Channel;
use super::complete_parts::CompleteParts;
use super::entry::LogEntry;
use super::narrate::Narrator;
use super::part::{MORE_TOPICS_BYTES, Part};
use super::part_file::{OpenPart, Patience, Syncer};
use super::part_header::PartHeader;
use super::parts::{existing_parts, part_path};
use super::{LogError, image, rig};
use mcap::McapError;
use plumbline_config::Timestamp;
use plumbline_config::options::{KeepPolicy, RecorderConfig};
use plumbline_drivers::StereoFrame;
use plumbline_estimator::Estimate;
use plumbline_record::fields::Parts;
use plumbline_record::parts::{End, RecordingState};
use plumbline_record::{Dropped, Event, Said, protobuf};
use plumbline_scene::{event, frame_transform, log_time, pose_in};
use prost::Message;
use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};

/// Size of a part without any message, bytes: configuration, schemas, summary.
const NEW_PART_BYTES: u64 = (128 << 10) + 2 * MORE_TOPICS_BYTES;

/// Limits of the recording.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    /// Largest size of a part, bytes.
    pub part_bytes: u64,
    /// Largest size of all parts together, bytes.
    pub total_bytes: u64,
    /// Policy at the limit.
    pub keep: KeepPolicy,
}

impl Limits {
    /// As configured.
    pub fn of(config: &RecorderConfig) -> Self {
        let bytes = |megabytes: usize| megabytes as u64 * 1_000_000;
        Self {
            part_bytes: bytes(config.max_file_mb),
            total_bytes: bytes(config.max_total_mb),
            keep: config.keep,
        }
    }
}

/// Writes the parts of one log.
pub struct LogWriter {
    path: PathBuf,
    about: PartHeader,
    limits: Limits,
    open: OpenPart,
    part: Option<Part>,
    /// The file of the part, by device and number, where it has one.
    inode: Option<(u64, u64)>,
    /// Parts that are complete.
    room: CompleteParts,
    dropped: Dropped,
    /// Entries since the last complete chunk.
    unsaved: Dropped,
    narrator: Narrator,
    newest_ns: u64,
    /// The open part does not say yet what the rig is like.
    is_rig_due: bool,
    buffer: Vec<u8>,
}

impl LogWriter {
    /// Begins a log at `path`, in files opened by `open`.
    ///
    /// # Errors
    /// When there is one, or it cannot be created.
    pub fn create(
        path: &Path,
        about: PartHeader,
        limits: Limits,
        mut open: OpenPart,
    ) -> Result<Self, LogError> {
        if let Some((_, path)) = existing_parts(path).into_iter().next() {
            return Err(LogError::Exists { path });
        }
        let room = CompleteParts::new(path, limits.keep);
        open.set_room(room.clone());
        let mut writer = Self {
            path: path.to_owned(),
            about,
            limits,
            open,
            part: None,
            inode: None,
            room,
            dropped: Dropped::default(),
            unsaved: Dropped::default(),
            narrator: Narrator::default(),
            newest_ns: 0,
            is_rig_due: true,
            buffer: Vec::new(),
        };
        writer.begin_part()?;
        Ok(writer)
    }

    /// Bytes in the files, chunks in the making left out.
    pub fn bytes(&self) -> u64 {
        self.part.as_ref().map_or(0, Part::complete_bytes) + self.room.bytes()
    }

    /// Bytes that were written and deleted again.
    pub fn deleted_bytes(&self) -> u64 {
        self.room.deleted_bytes()
    }

    /// Entries that were taken and are not in the files: lost when writing has failed.
    pub fn unsaved(&self) -> Dropped {
        self.unsaved
    }

    /// Files begun so far.
    pub fn parts(&self) -> u32 {
        self.about.part + 1
    }

    /// From now on the log says that this much was dropped.
    ///
    /// # Errors
    /// As [`Self::write`].
    pub fn set_dropped(&mut self, dropped: Dropped) -> Result<(), LogError> {
        self.dropped = dropped;
        self.put_recording(End::NotYet)
    }

    /// Writes an entry.
    ///
    /// # Errors
    /// When the files are full ([`LogError::Full`]; the log is complete up to there) or cannot be written;
    /// nothing more is written then.
    pub fn write(&mut self, entry: &LogEntry) -> Result<(), LogError> {
        let unsaved = entry.kind() as usize;
        self.unsaved.0[unsaved] += 1;
        let written = self.put_entry(entry);
        if matches!(written, Err(LogError::Full { .. })) {
            // The log was completed without it.
            self.unsaved.0[unsaved] = 1;
        }
        written
    }

    fn put_entry(&mut self, entry: &LogEntry) -> Result<(), LogError> {
        match entry {
            LogEntry::Frame(frame) => self.put_frame(frame),
            LogEntry::Said(Said::Estimate(full)) => self.put_estimate(&full.estimate),
            LogEntry::Said(Said::Event(event)) => self.put_event(event),
            LogEntry::Said(said) => match said.record() {
                Some(record) if said.topic().row().log.is_some() => {
                    self.put(said.topic(), said.stamp().unwrap_or_else(|| self.newest()), record)
                }
                _ => Ok(()),
            },
        }
    }

    /// Orders have no time of their own: that of the newest message.
    fn newest(&self) -> Timestamp {
        Timestamp::from_nanos(i64::try_from(self.newest_ns).unwrap_or(i64::MAX))
    }

    /// The images first: with the frame's own message it is complete.
    fn put_frame(&mut self, frame: &StereoFrame) -> Result<(), LogError> {
        for (camera, channel) in [Channel::Left, Channel::Right].into_iter().enumerate() {
            if frame.valid[camera] {
                self.buffer.clear();
                let name = rig::CAMERA_FRAMES[camera];
                image::encode(&frame.images[camera], frame.stamp, name, self.about.images, &mut self.buffer)
                    .map_err(|e| LogError::io(&self.path, std::io::Error::other(e)))?;
                if !self.buffer.is_empty() {
                    self.put_buffer(channel, log_time(frame.stamp))?;
                }
            }
        }
        self.put(Channel::Frame, frame.stamp, &image::frame(frame))
    }

    fn put_estimate(&mut self, estimate: &Estimate) -> Result<(), LogError> {
        self.put(Channel::Estimate, estimate.stamp, estimate)?;
        if estimate.has_pose() {
            let (names, pose) = (&self.about.config.ros, &estimate.pose_o_b);
            let transform = frame_transform(estimate.stamp, &names.odom_frame, &names.body_frame, pose);
            let pose = pose_in(estimate.stamp, &names.odom_frame, pose);
            self.draw(Channel::Transform, estimate.stamp, &transform)?;
            self.draw(Channel::Pose, estimate.stamp, &pose)?;
        }
        match self.narrator.notice(estimate) {
            Some(event) => self.put_event(&event),
            None => Ok(()),
        }
    }

    fn put_event(&mut self, of: &Event) -> Result<(), LogError> {
        self.draw(Channel::Event, of.stamp, &event(of.stamp, of.severity, "plumbline", &of.text))
    }

    fn put_recording(&mut self, end: End) -> Result<(), LogError> {
        let seal = self.part.as_ref().map_or_else(Vec::new, |part| part.seal());
        self.buffer = protobuf::encode(&RecordingState { end, seal, dropped: self.dropped });
        self.append(Channel::Recording, self.newest_ns)
    }

    fn put(&mut self, channel: Channel, stamp: Timestamp, record: &dyn Parts) -> Result<(), LogError> {
        self.buffer.clear();
        protobuf::append(record, &mut self.buffer);
        self.put_buffer(channel, log_time(stamp))
    }

    fn draw(&mut self, channel: Channel, stamp: Timestamp, message: &impl Message) -> Result<(), LogError> {
        self.buffer = message.encode_to_vec();
        self.put_buffer(channel, log_time(stamp))
    }

    /// Writes what is in the buffer where there is room for it.
    fn put_buffer(&mut self, channel: Channel, time_ns: u64) -> Result<(), LogError> {
        let Some(part) = &self.part else { return Ok(()) };
        let rig_bytes = if self.is_rig_due { rig::MAX_BYTES } else { 0 };
        let (bytes, has_data) = (part.bytes_after(self.buffer.len()) + rig_bytes, part.has_data());
        if bytes > self.limits.part_bytes && has_data {
            self.next_part(bytes)?;
        } else if self.room.bytes() + bytes > self.limits.total_bytes {
            self.make_room(bytes)?;
        }
        self.newest_ns = self.newest_ns.max(time_ns);
        self.put_rig(time_ns)?;
        self.append(channel, time_ns)?;
        let is_due = self.part.as_ref().is_some_and(|part| part.is_chunk_due(time_ns));
        if is_due { self.flush() } else { Ok(()) }
    }

    /// The rig comes before the first message that has a time, and has its time.
    fn put_rig(&mut self, time_ns: u64) -> Result<(), LogError> {
        if !self.is_rig_due || time_ns == 0 {
            return Ok(());
        }
        self.is_rig_due = false;
        let message = std::mem::take(&mut self.buffer);
        for (channel, bytes) in rig::messages(&self.about.config, self.newest()) {
            self.buffer = bytes;
            self.append(channel, time_ns)?;
        }
        self.buffer = message;
        Ok(())
    }

    /// Ends the part, which would have `bytes`, and begins the next.
    fn next_part(&mut self, bytes: u64) -> Result<(), LogError> {
        let next_bytes = self.buffer.len() as u64 + NEW_PART_BYTES;
        if self.limits.keep == KeepPolicy::Beginning
            && self.room.bytes() + bytes + next_bytes > self.limits.total_bytes
        {
            return self.end_full();
        }
        let message = std::mem::take(&mut self.buffer);
        self.end_part(End::NotYet)?;
        self.make_room(next_bytes)?;
        self.about.part += 1;
        self.begin_part()?;
        self.buffer = message;
        Ok(())
    }

    /// Begins another part if the file of this one was deleted or moved away; whether it was.
    ///
    /// # Errors
    /// As [`Self::write`].
    pub fn replace_missing(&mut self) -> Result<bool, LogError> {
        let path = part_path(&self.path, self.about.part);
        if self.part.is_none() || self.inode.is_none() || inode(&path) == self.inode {
            return Ok(false);
        }
        tracing::warn!(
            "{}: was deleted or moved away while it was written; recording goes on in another file",
            path.display()
        );
        let message = std::mem::take(&mut self.buffer);
        self.end_part(End::NotYet)?;
        self.room.forget_newest();
        self.about.part += 1;
        if let Some(folder) = path.parent().filter(|folder| !folder.as_os_str().is_empty()) {
            std::fs::create_dir_all(folder).map_err(|e| LogError::io(folder, e))?;
        }
        self.begin_part()?;
        self.buffer = message;
        Ok(true)
    }

    /// Deletes the oldest parts until `bytes` fit beside the others, or ends the log.
    fn make_room(&mut self, bytes: u64) -> Result<(), LogError> {
        while self.room.bytes() + bytes > self.limits.total_bytes {
            let has_made_room = self.room.delete_oldest();
            if !has_made_room.map_err(|(path, error)| LogError::io(&path, error))? {
                return self.end_full();
            }
        }
        Ok(())
    }

    fn end_full(&mut self) -> Result<(), LogError> {
        self.end_part(End::OfRoom)?;
        let limit_mb = self.limits.total_bytes / 1_000_000;
        Err(LogError::Full { path: self.path.clone(), limit_mb })
    }

    /// Adds the buffer to the chunk.
    fn append(&mut self, channel: Channel, time_ns: u64) -> Result<(), LogError> {
        let Some(part) = &mut self.part else { return Ok(()) };
        let written = part.append(channel, time_ns, &self.buffer);
        self.sound(written)
    }

    /// Completes the chunk: what was written so far is in the file.
    ///
    /// # Errors
    /// As [`Self::write`].
    pub fn flush(&mut self) -> Result<(), LogError> {
        if self.part.as_ref().is_some_and(Part::has_chunk) {
            self.put_recording(End::NotYet)?;
            self.end_chunk()?;
        }
        Ok(())
    }

    fn end_chunk(&mut self) -> Result<(), LogError> {
        let Some(part) = &mut self.part else { return Ok(()) };
        let flushed = part.end_chunk(&self.open);
        if flushed.is_ok() {
            self.unsaved = Dropped::default();
        }
        self.sound(flushed)
    }

    /// Syncer of the part under way; once for each part.
    pub fn take_syncer(&mut self) -> Option<Box<dyn Syncer>> {
        self.open.take_syncer()
    }

    /// Patience of the writer in waiting for descriptors and room; ending it ends the wait.
    pub fn patience(&self) -> Patience {
        self.open.patience()
    }

    /// Ends the log.
    ///
    /// # Errors
    /// As [`Self::write`].
    pub fn finish(&mut self) -> Result<(), LogError> {
        if self.part.is_none() {
            return Ok(());
        }
        self.end_part(End::OfFlight)
    }

    fn begin_part(&mut self) -> Result<(), LogError> {
        let path = part_path(&self.path, self.about.part);
        let file = self.open.open(&path).map_err(|e| LogError::io(&path, e))?;
        self.inode = inode(&path);
        let metadata = self.about.to_metadata()?;
        let begun = Part::begin(file, metadata, &self.about);
        self.part = Some(self.sound(begun)?);
        self.is_rig_due = true;
        self.end_chunk()
    }

    fn end_part(&mut self, end: End) -> Result<(), LogError> {
        self.put_recording(end)?;
        self.end_chunk()?;
        let Some(part) = &mut self.part else { return Ok(()) };
        let finished = part.finish();
        self.sound(finished)?;
        if let Some(part) = self.part.take() {
            self.room.add(self.about.part, self.open.position());
            part.close().map_err(|e| self.io(e))?;
        }
        Ok(())
    }

    /// After a failure nothing more is written, and the file ends with its last complete chunk.
    fn sound<T>(&mut self, result: Result<T, McapError>) -> Result<T, LogError> {
        result.map_err(|error| {
            if let Some(part) = self.part.take() {
                self.room.add(self.about.part, part.complete_bytes());
                part.cut();
            }
            self.io(match error {
                McapError::Io(error) => error,
                other => std::io::Error::other(other),
            })
        })
    }

    fn io(&self, error: std::io::Error) -> LogError {
        LogError::io(&part_path(&self.path, self.about.part), error)
    }
}

/// Device and number of the file at `path`; `None` where there is none.
fn inode(path: &Path) -> Option<(u64, u64)> {
    std::fs::metadata(path).ok().map(|metadata| (metadata.dev(), metadata.ino()))
}
