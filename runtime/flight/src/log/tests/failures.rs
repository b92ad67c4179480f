use super::super::inventory;
use super::super::part_file::{Medium, Syncer};
use super::super::reader::Ending;
use super::*;
use crate::log::LogEntry;
use plumbline_config::{Config, Timestamp};
use plumbline_drivers::StereoFrame;
use plumbline_record::{Event, Said, Severity};
use std::io::{self, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::time::{Duration, Instant};

/// A file on a disk that misbehaves.
struct Trouble {
    file: File,
    room: usize,
    is_stuck: Arc<AtomicBool>,
    panics: bool,
    hangs: Arc<AtomicBool>,
}

impl Write for Trouble {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        while self.is_stuck.load(Ordering::SeqCst) {
            std::thread::sleep(Duration::from_millis(1));
        }
        assert!(!self.panics || self.room > 0, "the disk is on fire");
        if self.room == 0 {
            return Err(io::ErrorKind::StorageFull.into());
        }
        let written = self.file.write(&bytes[..bytes.len().min(self.room)])?;
        self.room -= written;
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

impl Medium for Trouble {
    fn cut(&mut self, bytes: u64) -> io::Result<()> {
        self.file.set_len(bytes)
    }

    fn syncer(&self) -> io::Result<Box<dyn Syncer>> {
        Ok(Box::new(Hanging(Arc::clone(&self.hangs))))
    }
}

/// Syncs that do not return while it is so.
struct Hanging(Arc<AtomicBool>);

impl Syncer for Hanging {
    fn sync(&mut self) -> io::Result<()> {
        while self.0.load(Ordering::SeqCst) {
            std::thread::sleep(Duration::from_millis(5));
        }
        Ok(())
    }
}

/// A file that misbehaves in nothing.
fn sound(path: &Path) -> io::Result<Trouble> {
    let [is_stuck, hangs] = Default::default();
    Ok(Trouble { file: File::create_new(path)?, room: usize::MAX, is_stuck, panics: false, hangs })
}

fn troubled(room: usize, is_stuck: &Arc<AtomicBool>, panics: bool) -> OpenPart {
    let is_stuck = Arc::clone(is_stuck);
    OpenPart::with(move |path| {
        Ok(Box::new(Trouble { room, is_stuck: Arc::clone(&is_stuck), panics, ..sound(path)? }))
    })
}

#[test]
fn a_full_disk_ends_the_recording_and_not_the_flight() {
    let (_folder, path) = place();
    let open = troubled(1_000_000, &Arc::default(), false);
    let (report, summary) = record_on(open, NO_LIMITS, &path, ImageRecording::Raw);
    assert_eq!(report.figures.frames, 20);
    assert!(summary.ended_early.unwrap().contains("flight.mcap: "));
    assert!(summary.not_recorded > 0);
    assert_eq!(summary.bytes, path.metadata().unwrap().len(), "cut back to the last complete chunk");
    let inventory = inventory::take(&mut LogReader::open(&path).unwrap()).unwrap();
    assert_eq!(inventory.ending, Ending::Truncated);
    let v = verified(&path).unwrap();
    assert!(v.identical && v.truncated && v.estimates_identical > 3, "{v:?}");
}

/// Files that cannot be opened for want of descriptors while `is_short`, but for the first.
fn short_of_descriptors(is_short: &Arc<AtomicBool>, tries: &Arc<AtomicUsize>) -> OpenPart {
    let (is_short, tries) = (Arc::clone(is_short), Arc::clone(tries));
    OpenPart::with(move |path| {
        if tries.fetch_add(1, Ordering::SeqCst) > 0 && is_short.load(Ordering::SeqCst) {
            return Err(io::Error::from_raw_os_error(24));
        }
        Ok(Box::new(sound(path)?))
    })
}

#[test]
fn a_lack_of_descriptors_interrupts_the_recording_and_does_not_end_it() {
    let (_folder, path) = place();
    let (is_short, tries) = (Arc::new(AtomicBool::new(true)), Arc::new(AtomicUsize::new(0)));
    let open = short_of_descriptors(&is_short, &tries);
    let relief = std::thread::spawn(move || {
        while tries.load(Ordering::SeqCst) < 4 {
            std::thread::sleep(Duration::from_millis(1));
        }
        is_short.store(false, Ordering::SeqCst);
    });
    let limits = Limits { part_bytes: 600_000, ..NO_LIMITS };
    // Little room: the flight is still going on when the recording comes back, however fast it is.
    let small = |c: &mut Config| {
        c.recorder.images = ImageRecording::Raw;
        (c.recorder.queue_entries, c.recorder.queue_frames) = (64, 2);
    };
    let mut flight = flight();
    flight.config = flight.config.with("test", small).unwrap();
    let mut recorder = Recorder::start_on(open, limits, &path, &flight.config, WhenFull::Wait).unwrap();
    fly(flight, &Control::default(), &mut recorder);
    let summary = recorder.finish();
    relief.join().unwrap();
    assert!(summary.ended_early.is_none() && summary.parts > 2 && summary.not_recorded == 0, "{summary:?}");
    let v = verified(&path).unwrap();
    assert!(v.identical && v.complete, "{v:?}");
}

#[test]
fn the_end_of_a_flight_does_not_wait_for_descriptors() {
    let (_folder, path) = place();
    let (is_short, tries) = (Arc::new(AtomicBool::new(true)), Arc::new(AtomicUsize::new(0)));
    let open = short_of_descriptors(&is_short, &tries);
    let config = config();
    let limits = Limits { part_bytes: 200_000, ..NO_LIMITS };
    let recorder = Recorder::start_on(open, limits, &path, &config, WhenFull::Drop).unwrap();
    let handle = recorder.handle();
    while tries.load(Ordering::SeqCst) < 3 {
        handle.offer(event());
    }
    assert!(recorder.finish().ended_early.unwrap().contains("os error 24"));
}

#[test]
fn a_panic_of_the_recorder_does_not_reach_the_flight() {
    let (_folder, path) = place();
    let open = troubled(1_000_000, &Arc::default(), true);
    let (report, summary) = record_on(open, NO_LIMITS, &path, ImageRecording::Raw);
    assert_eq!(report.figures.frames, 20);
    assert!(summary.ended_early.unwrap().contains("panicked"));
    assert!(verified(&path).unwrap().identical);
}

#[test]
fn what_finds_the_queue_full_is_counted_and_the_log_says_so() {
    let (_folder, path) = place();
    let is_stuck = Arc::new(AtomicBool::new(false));
    let small = |c: &mut Config| (c.recorder.queue_entries, c.recorder.queue_frames) = (64, 2);
    let config = config().with("test", small).unwrap();
    let open = troubled(usize::MAX, &is_stuck, false);
    let recorder = Recorder::start_on(open, NO_LIMITS, &path, &config, WhenFull::Drop).unwrap();
    let handle = recorder.handle();
    is_stuck.store(true, Ordering::SeqCst);
    let mut frame = StereoFrame::new([(64, 48), (0, 0)]);
    frame.valid = [true, false];
    let mut refused = 0;
    for _ in 0..50 {
        refused += u64::from(!handle.offer_frame(&mut frame));
    }
    assert!(refused > 40, "the disk is stuck, and two frames fit: {refused}");
    is_stuck.store(false, Ordering::SeqCst);
    while !handle.offer(event()) {}
    let summary = recorder.finish();
    assert!(summary.not_recorded >= refused, "{summary:?}");
    let inventory = inventory::take(&mut LogReader::open(&path).unwrap()).unwrap();
    assert_eq!(inventory.dropped.inputs(), refused);
    let v = verified(&path).unwrap();
    let damage = v.damage.unwrap();
    assert!(!v.complete && damage.contains(&format!("dropped {refused} frames")), "{damage}");
}

#[test]
fn a_disk_that_pauses_for_two_seconds_loses_nothing() {
    let (_folder, path) = place();
    let is_stuck = Arc::new(AtomicBool::new(false));
    let config = config();
    let open = troubled(usize::MAX, &is_stuck, false);
    let recorder = Recorder::start_on(open, NO_LIMITS, &path, &config, WhenFull::Drop).unwrap();
    let handle = recorder.handle();
    is_stuck.store(true, Ordering::SeqCst);
    let of_two_seconds = |rate_hz: f64| (2.0 * rate_hz) as usize;
    let mut frame = StereoFrame::new([(64, 48), (0, 0)]);
    for _ in 0..of_two_seconds(config.camera[0].rate_hz) {
        assert!(handle.offer_frame(&mut frame));
        // Orders, estimate and the like.
        (0..7).for_each(|_| assert!(handle.offer(event())));
    }
    // Each with its odometry.
    (0..2 * of_two_seconds(config.imu.rate_hz)).for_each(|_| assert!(handle.offer(event())));
    is_stuck.store(false, Ordering::SeqCst);
    assert_eq!(recorder.finish().not_recorded, 0);
}

#[test]
fn frames_that_find_no_room_keep_their_buffers_and_are_recorded_again_when_there_is_some() {
    let folder = tempfile::tempdir().unwrap();
    let is_stuck = Arc::new(AtomicBool::new(false));
    let small = |c: &mut Config| (c.recorder.queue_entries, c.recorder.queue_frames) = (64, 4);
    let config = config().with("test", small).unwrap();
    let open = troubled(usize::MAX, &is_stuck, false);
    let path = folder.path().join("flight.mcap");
    let recorder = Recorder::start_on(open, NO_LIMITS, &path, &config, WhenFull::Drop).unwrap();
    let handle = recorder.handle();
    is_stuck.store(true, Ordering::SeqCst);
    // Some of it the recorder takes before it meets the disk.
    let mut full_since = Instant::now();
    while full_since.elapsed() < Duration::from_millis(200) {
        if handle.offer(event()) {
            full_since = Instant::now();
        }
        std::thread::sleep(Duration::from_millis(1));
    }
    let mut frame = StereoFrame::new([(64, 48), (0, 0)]);
    let size = frame.images[0].pixels().len();
    for _ in 0..20 {
        assert!(!handle.offer_frame(&mut frame));
        assert_eq!(frame.images[0].pixels().len(), size, "the buffers are those of the frame");
    }
    is_stuck.store(false, Ordering::SeqCst);
    let taken = (0..1000).filter(|_| {
        std::thread::sleep(Duration::from_millis(5));
        handle.offer_frame(&mut frame)
    });
    assert_eq!(taken.take(20).count(), 20, "buffers were lost");
    let _ = recorder.finish();
}

/// A disk of so many bytes: what the files of its folder hold counts.
fn small_disk(capacity: &Arc<AtomicUsize>) -> OpenPart {
    let capacity = Arc::clone(capacity);
    OpenPart::with(move |path| {
        let file = File::create_new(path)?;
        let folder = path.parent().unwrap().to_owned();
        Ok(Box::new(SmallDisk { file, folder, capacity: Arc::clone(&capacity) }))
    })
}

struct SmallDisk {
    file: File,
    folder: PathBuf,
    capacity: Arc<AtomicUsize>,
}

fn bytes_in(folder: &Path) -> usize {
    let files = std::fs::read_dir(folder).into_iter().flatten().flatten();
    files.map(|file| file.metadata().map_or(0, |metadata| metadata.len() as usize)).sum()
}

impl Write for SmallDisk {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let room = self.capacity.load(Ordering::SeqCst).saturating_sub(bytes_in(&self.folder));
        if room == 0 {
            return Err(io::Error::from_raw_os_error(28));
        }
        // As a disk does, it takes what fits.
        self.file.write(&bytes[..bytes.len().min(room)])
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

impl Medium for SmallDisk {
    fn cut(&mut self, bytes: u64) -> io::Result<()> {
        self.file.set_len(bytes)
    }

    fn syncer(&self) -> io::Result<Box<dyn Syncer>> {
        Ok(Box::new(Hanging(Arc::default())))
    }
}

#[test]
fn the_newest_parts_are_kept_on_a_disk_that_is_too_small() {
    let (folder, path) = place();
    let limits = Limits { part_bytes: 600_000, keep: KeepPolicy::Newest, ..NO_LIMITS };
    let open = small_disk(&Arc::new(AtomicUsize::new(1_500_000)));
    let (report, summary) = record_on(open, limits, &path, ImageRecording::Raw);
    assert_eq!(report.figures.frames, 20);
    assert!(summary.ended_early.is_none() && summary.not_recorded == 0, "{summary:?}");
    assert!(summary.deleted_bytes > 0 && !path.exists(), "{summary:?}");
    assert_eq!(summary.bytes as usize, bytes_in(folder.path()));
}

#[test]
fn a_part_that_somebody_deleted_or_moved_is_no_failure() {
    for is_moved in [false, true] {
        let (_folder, path) = place();
        let limits = Limits { part_bytes: 400_000, total_bytes: 1_300_000, keep: KeepPolicy::Newest };
        // The third part comes before the first has to go.
        let (theirs, mut opened) = (path.clone(), 0);
        let open = OpenPart::with(move |path| {
            opened += 1;
            if opened == 3 && is_moved {
                std::fs::rename(&theirs, theirs.with_extension("kept"))?;
            } else if opened == 3 {
                std::fs::remove_file(&theirs)?;
            }
            Ok(Box::new(sound(path)?))
        });
        let (_, summary) = record_on(open, limits, &path, ImageRecording::Raw);
        assert!(summary.ended_early.is_none() && summary.not_recorded == 0, "{summary:?}");
        assert!(summary.parts > 4, "{summary:?}");
    }
}

fn event() -> LogEntry {
    LogEntry::Said(Said::Event(Event::new(Timestamp::default(), Severity::Info, format_args!("on"))))
}

/// An entry of some hundred bytes that do not compress.
fn word() -> LogEntry {
    static NEXT: AtomicU64 = AtomicU64::new(1);
    let draw = || NEXT.fetch_add(1, Ordering::Relaxed).wrapping_mul(0x9e37_79b9_7f4a_7c15).rotate_left(29);
    let words: [u64; 6] = std::array::from_fn(|_| draw().wrapping_mul(0xbf58_476d_1ce4_e5b9));
    let [a, b, c, d, e, f] = words;
    let text = format_args!("{a:016x}{b:016x}{c:016x}{d:016x}{e:016x}{f:016x}");
    LogEntry::Said(Said::Event(Event::new(Timestamp::default(), Severity::Info, text)))
}

/// Offers entries until `is_done`, or for ten seconds; whether it came to that.
fn offer_until(handle: &super::super::recorder::RecorderHandle, mut is_done: impl FnMut() -> bool) -> bool {
    let end = Instant::now() + Duration::from_secs(10);
    while Instant::now() < end {
        for _ in 0..20 {
            handle.offer(word());
        }
        if is_done() {
            return true;
        }
        std::thread::sleep(Duration::from_millis(1));
    }
    false
}

#[test]
fn a_live_recording_resumes_when_the_full_disk_has_room_again() {
    for keep in [KeepPolicy::Beginning, KeepPolicy::Newest] {
        let (folder, path) = place();
        let capacity = Arc::new(AtomicUsize::new(300_000));
        let limits = Limits { keep, ..NO_LIMITS };
        let recorder =
            Recorder::start_on(small_disk(&capacity), limits, &path, &config(), WhenFull::Drop).unwrap();
        let handle = recorder.handle();
        assert!(
            offer_until(&handle, || bytes_in(folder.path()) > 200_000 && !handle.offer(word())),
            "it is full"
        );
        capacity.store(usize::MAX, Ordering::SeqCst);
        assert!(offer_until(&handle, || bytes_in(folder.path()) > 600_000), "{keep:?}: it resumes");
        let summary = recorder.finish();
        assert!(summary.ended_early.is_none() && summary.not_recorded > 0, "{summary:?}");
        let inventory = inventory::take(&mut LogReader::open(&path).unwrap()).unwrap();
        assert_ne!(inventory.ending, Ending::Truncated);
    }
}

#[test]
fn a_flight_does_not_wait_for_room_at_its_end() {
    let (_folder, path) = place();
    let capacity = Arc::new(AtomicUsize::new(200_000));
    let recorder =
        Recorder::start_on(small_disk(&capacity), NO_LIMITS, &path, &config(), WhenFull::Drop).unwrap();
    let handle = recorder.handle();
    assert!(offer_until(&handle, || !handle.offer(word())));
    let begun = Instant::now();
    assert!(recorder.finish().ended_early.unwrap().contains("os error 28"));
    assert!(begun.elapsed() < Duration::from_secs(2), "{:?}", begun.elapsed());
}

#[test]
fn a_folder_that_is_removed_or_moved_is_noticed_within_a_second() {
    for is_moved in [false, true] {
        let parent = tempfile::tempdir().unwrap();
        let folder = parent.path().join("logs");
        std::fs::create_dir(&folder).unwrap();
        let path = folder.join("flight.mcap");
        let recorder = Recorder::start(&path, &config(), (None, 0), WhenFull::Drop).unwrap();
        let handle = recorder.handle();
        assert!(offer_until(&handle, || bytes_in(&folder) > 100_000));
        match is_moved {
            true => std::fs::rename(&folder, parent.path().join("elsewhere")).unwrap(),
            false => std::fs::remove_dir_all(&folder).unwrap(),
        }
        let begun = Instant::now();
        assert!(offer_until(&handle, || folder.join("flight.1.mcap").exists()), "another file is begun");
        assert!(begun.elapsed() < Duration::from_secs(1), "{:?}", begun.elapsed());
        let summary = recorder.finish();
        assert!(summary.ended_early.is_none() && summary.deleted_bytes > 0, "{summary:?}");
        let second = folder.join("flight.1.mcap");
        let inventory = inventory::take(&mut LogReader::open(&second).unwrap()).unwrap();
        assert_ne!(inventory.ending, Ending::Truncated);
    }
}

#[test]
fn a_medium_that_hangs_in_a_sync_holds_up_neither_recording_nor_report() {
    let (_folder, path) = place();
    let hangs = Arc::new(AtomicBool::new(true));
    let theirs = Arc::clone(&hangs);
    let open =
        OpenPart::with(move |path| Ok(Box::new(Trouble { hangs: Arc::clone(&theirs), ..sound(path)? })));
    let limits = Limits { part_bytes: 600_000, ..NO_LIMITS };
    let mut flight = flight();
    flight.config = flight.config.with("test", |c| c.recorder.images = ImageRecording::Raw).unwrap();
    let mut recorder = Recorder::start_on(open, limits, &path, &flight.config, WhenFull::Wait).unwrap();
    fly(flight, &Control::default(), &mut recorder);
    let begun = Instant::now();
    let summary = recorder.finish();
    assert!(begun.elapsed() < Duration::from_secs(5), "{:?}", begun.elapsed());
    hangs.store(false, Ordering::SeqCst);
    assert!(summary.ended_early.is_none() && summary.parts > 2 && summary.not_recorded == 0, "{summary:?}");
    assert!(verified(&path).unwrap().complete);
}
