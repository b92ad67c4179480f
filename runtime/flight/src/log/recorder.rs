//! The recorder: a thread at normal priority behind a bounded queue, so that nothing waits for the disk.
//!
//! Whoever has something to record holds a [`RecorderHandle`]. Entries are copied into a ring that stands
//! before the flight begins; a frame changes places with one that is free. When the ring is full a live
//! run drops the entry and counts it ([`WhenFull::Drop`]), a run in virtual time waits
//! ([`WhenFull::Wait`]). When the disk fails the recording ends there and the flight goes on. When there are no descriptors for
//! the next part, or (in a live run) no room on the disk, it waits for some, and what finds the queue full meanwhile is missing.

use super::LogError;
use super::entry::LogEntry;
use super::part_file::{OpenPart, Patience};
use super::part_header::PartHeader;
use super::sync::SyncThread;
use super::writer::{Limits, LogWriter};
use crate::pipeline::clock::CpuStopwatch;
use crate::pipeline::listener::{FrameKeeper, Listener, Producer, Subscriber};
use crate::schedule::queue::Queue;
use plumbline_config::ValidConfig;
use plumbline_config::options::image_sizes;
use plumbline_drivers::StereoFrame;
use plumbline_record::{Dropped, EntryKind, Said};
use serde::Serialize;
use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// The recorder looks into its queue this often: a ring without locks cannot wake it.
const POLL: Duration = Duration::from_millis(5);
/// A producer that may wait looks for room this often.
const WAIT: Duration = Duration::from_micros(200);
/// A chunk is completed at the latest after this time, also when no data come.
const FLUSH_PERIOD: Duration = Duration::from_millis(500);

/// Period of the check that the file still exists.
const LOOK_PERIOD: Duration = Duration::from_millis(500);
/// The end of a flight waits so long for the disk to take what is in the queue.
const LAST_WRITES: Duration = Duration::from_secs(20);

/// The queue has room for so long, s: a disk that pauses for two seconds loses nothing.
const QUEUE_S: f64 = 2.5;
/// Entries that come with an inertial sample (itself, its odometry) and with a frame (itself, order, correction, estimate, pose in
/// the map, orders of the map, now and then an event).
const ENTRIES_PER_SAMPLE: f64 = 2.0;
const ENTRIES_PER_FRAME: f64 = 8.0;
/// And some more.
const MARGIN: usize = 64;

/// Policy for an entry that finds the queue full.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WhenFull {
    /// It is dropped and counted: for live runs.
    Drop,
    /// The producer waits: for runs in virtual time.
    Wait,
}

/// State shared by producers and recorder.
struct Shared {
    entries: Queue<LogEntry>,
    /// Filled by the recorder's thread, emptied by the front-end.
    free_frames: Queue<StereoFrame>,
    dropped: [AtomicU64; EntryKind::NAMES.len()],
    is_running: AtomicBool,
    is_finishing: AtomicBool,
    when_full: WhenFull,
}

impl Shared {
    fn is_running(&self) -> bool {
        self.is_running.load(Ordering::Acquire)
    }

    /// Result of `get`, again and again where the producer may wait; an entry that finds no room is counted as dropped.
    fn await_room<R>(&self, kind: EntryKind, get: impl Fn() -> Option<R>) -> Option<R> {
        while self.is_running() {
            let room = get();
            if room.is_some() {
                return room;
            }
            if self.when_full == WhenFull::Drop {
                break;
            }
            std::thread::sleep(WAIT);
        }
        self.count_dropped(kind);
        None
    }

    fn count_dropped(&self, kind: EntryKind) {
        self.dropped[kind as usize].fetch_add(1, Ordering::Relaxed);
    }

    fn dropped(&self) -> Dropped {
        Dropped(self.dropped.each_ref().map(|count| count.load(Ordering::Relaxed)))
    }
}

/// Gives entries to the recorder, from any thread. Never allocates.
#[derive(Clone)]
pub struct RecorderHandle(Arc<Shared>);

impl RecorderHandle {
    /// Hands an entry over; `false` when it was dropped. A frame is better given by
    /// [`Self::offer_frame`], which does not free its buffers when there is no room.
    pub fn offer(&self, entry: LogEntry) -> bool {
        let place = self.0.await_room(entry.kind(), || self.0.entries.place());
        place.map(|place| place.fill(entry)).is_some()
    }

    /// Takes the content of `frame`, and leaves the buffers of a free one in its place; when none is free
    /// the frame stays as it is and `false` says that it was dropped.
    pub fn offer_frame(&self, frame: &mut StereoFrame) -> bool {
        let room = || Some((self.0.entries.place()?, self.0.free_frames.pop()?));
        let room = self.0.await_room(EntryKind::Frame, room);
        room.map(|(place, free)| place.fill(LogEntry::Frame(std::mem::replace(frame, free)))).is_some()
    }
}

impl Listener for RecorderHandle {
    fn said(&mut self, said: &Said) {
        self.offer(LogEntry::Said(said.clone()));
    }
}

impl FrameKeeper for RecorderHandle {
    fn keep(&mut self, frame: &mut StereoFrame) {
        self.offer_frame(frame);
    }
}

/// Summary of a recording.
#[derive(Clone, Debug, Default, Serialize)]
pub struct RecorderSummary {
    /// The first file.
    pub path: PathBuf,
    /// Files begun.
    pub parts: u32,
    /// Bytes in the files.
    pub bytes: u64,
    /// Bytes that were written and deleted again, to keep the newest.
    pub deleted_bytes: u64,
    /// Entries that were not recorded.
    pub not_recorded: u64,
    /// Entries that were not recorded, as text.
    pub not_recorded_words: String,
    /// Reason why recording ended before the flight, if it did.
    pub ended_early: Option<String>,
    /// True if that is a failure of the disk, rather than the end of the room that the configuration gives.
    pub has_failed: bool,
    /// Processor time of the recorder's thread, s.
    pub cpu_s: f64,
}

impl fmt::Display for RecorderSummary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let megabytes = self.bytes as f64 * 1e-6;
        write!(f, "{}: {megabytes:.1} MB in {} file(s)", self.path.display(), self.parts)?;
        if self.not_recorded > 0 {
            write!(f, ", without {}", self.not_recorded_words)?;
        }
        match &self.ended_early {
            Some(reason) => write!(f, "; ended before the flight: {reason}"),
            None => Ok(()),
        }
    }
}

/// A recording that is going on.
pub struct Recorder {
    shared: Arc<Shared>,
    patience: Patience,
    thread: JoinHandle<RecorderSummary>,
    path: PathBuf,
}

impl Recorder {
    /// Begins to record a flight with `config` at `path`, which goes on with the map whose file has this SHA-256, if any, and counts
    /// its resets from `first_reset_counter` on.
    ///
    /// # Errors
    /// When there is a log of that name, its file cannot be created, or the system refuses a thread.
    pub fn start(
        path: &Path,
        config: &ValidConfig,
        (known_map, first_reset_counter): (Option<String>, u32),
        when_full: WhenFull,
    ) -> Result<Self, LogError> {
        let about = PartHeader { known_map, first_reset_counter, ..PartHeader::new(config)? };
        let writer = LogWriter::create(path, about, Limits::of(&config.recorder), OpenPart::files())?;
        Self::start_writing(writer, path, config, when_full)
    }

    pub(super) fn start_writing(
        writer: LogWriter,
        path: &Path,
        config: &ValidConfig,
        when_full: WhenFull,
    ) -> Result<Self, LogError> {
        let (entries, frames) = queue_lengths(config);
        let shared = Arc::new(Shared {
            entries: Queue::new(entries),
            free_frames: Queue::new(frames),
            dropped: Default::default(),
            is_running: AtomicBool::new(true),
            is_finishing: AtomicBool::new(false),
            when_full,
        });
        for _ in 0..frames {
            let mut frame = StereoFrame::new(image_sizes(&config.camera));
            // Touched now: a first touch in flight is a fault of the page.
            frame.images.iter_mut().for_each(|image| image.pixels_mut().fill(1));
            let _ = shared.free_frames.push(frame);
        }
        let sync = SyncThread::start().map_err(LogError::Thread)?;
        let (theirs, patience) = (Arc::clone(&shared), writer.patience());
        if when_full == WhenFull::Drop {
            patience.wait_for_room();
        }
        let first = path.to_owned();
        let thread = std::thread::Builder::new()
            .name("recorder".into())
            .spawn(move || record(&theirs, writer, sync, first))
            .map_err(LogError::Thread)?;
        Ok(Self { shared, patience, thread, path: path.to_owned() })
    }

    /// A handle for a producer.
    pub fn handle(&self) -> RecorderHandle {
        RecorderHandle(Arc::clone(&self.shared))
    }

    /// Writes what is in the queue, ends the log, and says what it came to.
    #[must_use]
    pub fn finish(self) -> RecorderSummary {
        self.shared.is_finishing.store(true, Ordering::Release);
        self.patience.end();
        self.thread.thread().unpark();
        let end = Instant::now() + LAST_WRITES;
        while !self.thread.is_finished() && Instant::now() < end {
            std::thread::sleep(POLL);
        }
        let failed = |reason: String| RecorderSummary {
            path: self.path.clone(),
            ended_early: Some(reason),
            has_failed: true,
            ..RecorderSummary::default()
        };
        let mut summary = match self.thread.is_finished() {
            true => self.thread.join().unwrap_or_else(|_| {
                failed("the recorder's thread panicked; this is a defect of the program".into())
            }),
            false => failed(format!(
                "{}: the disk hangs: it has not taken the rest of the log within {} s",
                self.path.display(),
                LAST_WRITES.as_secs()
            )),
        };
        let dropped = self.shared.dropped();
        (summary.not_recorded, summary.not_recorded_words) = (dropped.total(), dropped.to_string());
        summary
    }
}

impl Subscriber for Recorder {
    fn listener(&mut self, _producer: Producer) -> Box<dyn Listener> {
        Box::new(self.handle())
    }

    fn frame_keeper(&mut self) -> Option<Box<dyn FrameKeeper>> {
        Some(Box::new(self.handle()))
    }
}

/// Tells the producers that nobody listens any more, also when the thread panics.
struct Running<'a>(&'a Shared);

impl Drop for Running<'_> {
    fn drop(&mut self) {
        self.0.is_running.store(false, Ordering::Release);
    }
}

/// Entries and frames that may wait.
fn queue_lengths(config: &ValidConfig) -> (usize, usize) {
    let (samples_hz, frames_hz) = (config.imu.rate_hz, config.camera[0].rate_hz);
    let of_rate = |rate_hz: f64| (QUEUE_S * rate_hz).ceil() as usize;
    let or = |configured: usize, of_rate: usize| if configured == 0 { of_rate } else { configured };
    let entries = of_rate(ENTRIES_PER_SAMPLE * samples_hz + ENTRIES_PER_FRAME * frames_hz) + MARGIN;
    (or(config.recorder.queue_entries, entries), or(config.recorder.queue_frames, of_rate(frames_hz)))
}

/// The recorder's thread.
fn record(shared: &Shared, mut writer: LogWriter, sync: SyncThread, path: PathBuf) -> RecorderSummary {
    let watch = CpuStopwatch::start();
    let running = Running(shared);
    let failure = take_entries(shared, &mut writer, &sync).err();
    drop(running);
    let synced = sync.finish();
    let failure = failure.or_else(|| synced.err().map(|error| LogError::io(&path, error)));
    if let Some(error) = &failure {
        tracing::warn!("{error}: recording stopped, the flight continues");
        for (count, lost) in shared.dropped.iter().zip(writer.unsaved().0) {
            count.fetch_add(lost, Ordering::Relaxed);
        }
    }
    // What came in the meantime has found nobody.
    while let Some(entry) = shared.entries.pop() {
        shared.count_dropped(entry.kind());
    }
    RecorderSummary {
        path,
        parts: writer.parts(),
        bytes: writer.bytes(),
        deleted_bytes: writer.deleted_bytes(),
        has_failed: failure.as_ref().is_some_and(|error| !matches!(error, LogError::Full { .. })),
        ended_early: failure.map(|error| error.to_string()),
        cpu_s: watch.elapsed_ms() * 1e-3,
        ..RecorderSummary::default()
    }
}

/// Writes entries until the flight ends or the disk does.
fn take_entries(shared: &Shared, writer: &mut LogWriter, sync: &SyncThread) -> Result<(), LogError> {
    let mut told = Dropped::default();
    let (mut flushed, mut looked) = (Instant::now(), Instant::now());
    if let Some(part) = writer.take_syncer() {
        sync.follow(part);
    }
    loop {
        // Looked at first: what was offered before it was set is in the queue.
        let is_finishing = shared.is_finishing.load(Ordering::Acquire);
        while let Some(entry) = shared.entries.pop() {
            tell_dropped(shared, writer, &mut told)?;
            let written = writer.write(&entry);
            if let LogEntry::Frame(frame) = entry {
                let _ = shared.free_frames.push(frame);
            }
            written?;
            if let Some(part) = writer.take_syncer() {
                sync.follow(part);
            }
        }
        if is_finishing {
            tell_dropped(shared, writer, &mut told)?;
            return writer.finish();
        }
        if flushed.elapsed() >= FLUSH_PERIOD {
            writer.flush()?;
            flushed = Instant::now();
        }
        if looked.elapsed() >= LOOK_PERIOD {
            looked = Instant::now();
            if writer.replace_missing()?
                && let Some(part) = writer.take_syncer()
            {
                sync.follow(part);
            }
        }
        std::thread::park_timeout(POLL);
    }
}

/// A log that lacks something says so before it goes on.
fn tell_dropped(shared: &Shared, writer: &mut LogWriter, told: &mut Dropped) -> Result<(), LogError> {
    let dropped = shared.dropped();
    if dropped != *told {
        *told = dropped;
        writer.set_dropped(dropped)?;
    }
    Ok(())
}
