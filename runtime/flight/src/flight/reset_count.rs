//! The count of resets goes on when the program is started again: whoever flies by the odometry has to learn that its origin
//! is another.
//!
//! A small file holds the first number that was never told to anybody. Numbers are reserved there some at a time, by a thread
//! of normal priority, so that a process that is killed has told none that the next one may tell again. A file that is
//! missing, damaged or not to be written keeps nobody from flying.

use crate::pipeline::listener::{Listener, Producer, Subscriber};
use crate::places::write_atomically;
use crate::schedule::ticker::Monotonic;
use plumbline_drivers::open_regular;
use plumbline_record::Said;
use std::io::{ErrorKind, Read as _};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

/// Name of the file.
const FILE: &str = "reset_counter";
/// Longest file that is read, bytes: a number and a sum have 20.
const MAX_BYTES: u64 = 64;
/// Numbers are reserved so many at a time, and more when half of them are used.
const RESERVED: u32 = 8;
/// The thread looks this often, and after a failure so often.
const LOOK: Duration = Duration::from_millis(50);
const RETRY: Duration = Duration::from_millis(500);

/// The count of one flight.
#[derive(Debug)]
pub struct ResetCount {
    first: u32,
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

#[derive(Debug)]
struct Shared {
    path: PathBuf,
    newest: AtomicU32,
    /// Steps of the odometry without a reset, which autopilots are told as resets.
    jumps: AtomicU32,
    is_over: AtomicBool,
}

impl ResetCount {
    /// Goes on with the count in `folder`.
    #[must_use]
    pub fn resume(folder: &Path) -> Self {
        let path = folder.join(FILE);
        let first = read(&path);
        let shared = Shared {
            path,
            newest: AtomicU32::new(first),
            jumps: AtomicU32::new(0),
            is_over: AtomicBool::new(false),
        };
        let shared = Arc::new(shared);
        let theirs = Arc::clone(&shared);
        let spawned = std::thread::Builder::new().name("reset-count".into()).spawn(move || keep(&theirs));
        let thread =
            spawned.inspect_err(|error| tracing::warn!("the reset counter is not saved: {error}")).ok();
        Self { first, shared, thread }
    }

    /// The number to begin with.
    #[must_use]
    pub fn first(&self) -> u32 {
        self.first
    }
}

impl Drop for ResetCount {
    /// A flight that has ended leaves the very next number.
    fn drop(&mut self) {
        self.shared.is_over.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            thread.thread().unpark();
            let _ = thread.join();
        }
    }
}

impl Subscriber for ResetCount {
    fn listener(&mut self, producer: Producer) -> Box<dyn Listener> {
        match producer {
            Producer::Window | Producer::Tick => Box::new(Counters(Arc::clone(&self.shared))),
            _ => Box::new(()),
        }
    }
}

struct Counters(Arc<Shared>);

impl Listener for Counters {
    fn said(&mut self, said: &Said) {
        match said {
            Said::Estimate(full) => self.0.newest.store(full.estimate.reset_counter, Ordering::Relaxed),
            Said::Odometry(odometry) => self.0.jumps.store(odometry.jumps, Ordering::Relaxed),
            _ => {}
        }
    }
}

/// The thread that writes.
fn keep(shared: &Shared) {
    let (mut reserved, mut has_warned) = (None, false);
    loop {
        let is_over = shared.is_over.load(Ordering::Relaxed);
        let newest = shared.newest.load(Ordering::Relaxed).wrapping_add(shared.jumps.load(Ordering::Relaxed));
        let next = match is_over {
            true => newest.wrapping_add(1),
            false => newest.wrapping_add(RESERVED),
        };
        let is_due = reserved
            .is_none_or(|reserved: u32| (reserved.wrapping_sub(newest) as i32) <= RESERVED as i32 / 2);
        let mut pause = LOOK;
        if is_over || is_due {
            match write_atomically(&shared.path, line(next).as_bytes()) {
                Ok(()) => reserved = Some(next),
                Err(error) => {
                    pause = RETRY;
                    if !std::mem::replace(&mut has_warned, true) {
                        let path = shared.path.display();
                        tracing::warn!(
                            "{path}: {error}; after another start an autopilot may not learn of the new origin"
                        );
                    }
                }
            }
        }
        if is_over {
            return;
        }
        std::thread::park_timeout(pause);
    }
}

/// Content of the file: the number, and a checksum.
fn line(next: u32) -> String {
    format!("{next} {:08x}\n", crc32fast::hash(&next.to_le_bytes()))
}

/// The number in the file. 0 where there is none yet; where it is damaged, one that the last flight hardly had.
fn read(path: &Path) -> u32 {
    let text = match open_regular(path).and_then(|file| std::io::read_to_string(file.take(MAX_BYTES))) {
        Ok(text) => text,
        Err(error) if error.kind() == ErrorKind::NotFound => return 0,
        Err(error) => error.to_string(),
    };
    let number = text.split_whitespace().next().and_then(|word| word.parse().ok());
    number.filter(|next| line(*next) == text).unwrap_or_else(|| {
        tracing::warn!("{}: damaged; reset counter reinitialized (state file unreadable)", path.display());
        unlikely()
    })
}

/// A number that the last flight hardly had, after a start of the computer too: one of this start and of this moment.
fn unlikely() -> u32 {
    let start = std::fs::read("/proc/sys/kernel/random/boot_id").unwrap_or_default();
    crc32fast::hash(&[&start[..], &Monotonic::now().0.to_le_bytes()].concat())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn told(count: &mut ResetCount, reset_counter: u32) {
        count.shared.newest.store(reset_counter, Ordering::Relaxed);
    }

    fn eventually(mut ready: impl FnMut() -> bool) {
        let end = Monotonic::now().plus_nanos(10_000_000_000);
        while !ready() {
            assert!(Monotonic::now() < end, "it never came");
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    #[test]
    fn after_a_flight_the_count_goes_on_with_the_next_number() {
        let folder = tempfile::tempdir().unwrap();
        let mut first = ResetCount::resume(folder.path());
        assert_eq!(first.first(), 0);
        told(&mut first, 2);
        drop(first);
        let second = ResetCount::resume(folder.path());
        assert_eq!(second.first(), 3);
        drop(second);
        assert_eq!(ResetCount::resume(folder.path()).first(), 4);
    }

    #[test]
    fn steps_without_a_reset_count_as_well() {
        let folder = tempfile::tempdir().unwrap();
        let mut first = ResetCount::resume(folder.path());
        told(&mut first, 2);
        first.shared.jumps.store(3, Ordering::Relaxed);
        drop(first);
        assert_eq!(ResetCount::resume(folder.path()).first(), 6);
    }

    #[test]
    fn a_process_that_was_killed_has_told_no_number_that_is_told_again() {
        let folder = tempfile::tempdir().unwrap();
        let mut killed = ResetCount::resume(folder.path());
        let path = folder.path().join(FILE);
        for newest in [0, 3, 5, 9, 40] {
            told(&mut killed, newest);
            eventually(|| path.exists() && read(&path) > newest);
        }
        let copy = tempfile::tempdir().unwrap();
        std::fs::copy(&path, copy.path().join(FILE)).unwrap();
        assert!(ResetCount::resume(copy.path()).first() > 40);
    }

    #[test]
    fn numbers_are_reserved_as_soon_as_there_is_room() {
        let folder = tempfile::tempdir().unwrap();
        let full = folder.path().join("full");
        let _count = ResetCount::resume(&full);
        std::thread::sleep(2 * LOOK);
        std::fs::create_dir(&full).unwrap();
        eventually(|| full.join(FILE).exists());
    }

    #[test]
    fn a_file_that_is_damaged_or_cannot_be_written_keeps_nobody_from_flying() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join(FILE), "17 00000000\n").unwrap();
        assert_ne!(ResetCount::resume(folder.path()).first(), 17);
        // Shortly after a start of the computer it is no small number either.
        let numbers: Vec<u32> = (0..4).map(|_| unlikely()).collect();
        assert!(numbers.iter().any(|number| *number > 100_000), "{numbers:?}");
        assert!(numbers.windows(2).all(|two| two[0] != two[1]), "{numbers:?}");
        assert_eq!(ResetCount::resume(Path::new("/nowhere/at/all")).first(), 0);
        assert_eq!(read(&folder.path().join("none")), 0);
    }

    #[test]
    fn a_pipe_in_place_of_the_file_does_not_hold_up_the_start() {
        let folder = tempfile::tempdir().unwrap();
        let pipe = folder.path().join(FILE);
        rustix::fs::mknodat(
            rustix::fs::CWD,
            &pipe,
            rustix::fs::FileType::Fifo,
            rustix::fs::Mode::RUSR | rustix::fs::Mode::WUSR,
            0,
        )
        .unwrap();
        let first = ResetCount::resume(folder.path());
        drop(first);
        // The next number has taken its place.
        assert!(pipe.is_file());
    }
}
