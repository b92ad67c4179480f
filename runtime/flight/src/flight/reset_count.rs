//! The count of resets goes on when the program is started again: whoever flies by the odometry has to learn that its origin
//! is another.
//!
//! A small file holds the number that the next start begins with. Each start raises it by more resets than a flight has before it
//! tells its own, so that a process that is killed has told none that the next one tells again. A file that is missing, damaged
//! or not to be written keeps nobody from flying.

use crate::places::write_atomically;
use crate::schedule::ticker::Monotonic;
use plumbline_drivers::open_regular;
use std::io::{ErrorKind, Read as _};
use std::path::Path;

/// Name of the file.
const FILE: &str = "reset_counter";
/// Longest file that is read, bytes: a number and a sum have 20.
const MAX_BYTES: u64 = 64;
/// Numbers of a start. Autopilots are told the lowest eight bits: four starts in a row differ in them too.
const STEP: u32 = 64;

/// The number that a flight begins with, by the file in `folder`.
pub fn first_reset_counter(folder: &Path) -> u32 {
    let path = folder.join(FILE);
    let first = read(&path);
    let written = write_atomically(&path, line(first.wrapping_add(STEP)).as_bytes());
    written.map_or_else(
        |error| {
            tracing::warn!("{}: {error}; the reset counter begins at random", path.display());
            unlikely()
        },
        |()| first,
    )
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

    #[test]
    fn every_start_has_numbers_of_its_own() {
        let folder = tempfile::tempdir().unwrap();
        assert_eq!([0; 3].map(|_| first_reset_counter(folder.path())), [0, STEP, 2 * STEP]);
    }

    #[test]
    fn a_file_that_is_damaged_or_cannot_be_written_keeps_nobody_from_flying() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join(FILE), "17 00000000\n").unwrap();
        assert_ne!(first_reset_counter(folder.path()), 17);
        // Shortly after a start of the computer it is no small number either.
        let numbers: Vec<u32> = (0..4).map(|_| first_reset_counter(Path::new("/nowhere/at/all"))).collect();
        assert!(numbers.iter().any(|number| *number > 100_000), "{numbers:?}");
        assert!(numbers.windows(2).all(|two| two[0] != two[1]), "{numbers:?}");
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
        let _ = first_reset_counter(folder.path());
        // The next number has taken its place.
        assert!(pipe.is_file());
    }
}
