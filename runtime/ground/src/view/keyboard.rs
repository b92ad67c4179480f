//! The keys of the terminal that a station is watched from.
//!
//! At the end of its input Crossterm reads on for ever, with all of a processor: so it is asked only while the terminal is
//! there.

use rustix::event::{PollFd, PollFlags, poll};
use rustix::time::Timespec;
use std::fs::File;
use std::io::{self, IsTerminal};
use std::os::fd::AsFd as _;
use std::time::Duration;

/// Source of keys: standard input, or the terminal of the process where that is none.
pub struct Keyboard(Option<File>);

impl Keyboard {
    /// Finds it.
    ///
    /// # Errors
    /// When there is no terminal.
    pub fn open() -> io::Result<Self> {
        match io::stdin().is_terminal() {
            true => Ok(Self(None)),
            false => File::options().read(true).write(true).open("/dev/tty").map(|file| Self(Some(file))),
        }
    }

    /// Waits for a key, up to this time; whether the terminal is still there.
    #[must_use]
    pub fn wait(&self, time: Duration) -> bool {
        let (stdin, stdout) = (io::stdin(), io::stdout());
        let keys = self.0.as_ref().map_or_else(|| stdin.as_fd(), |file| file.as_fd());
        let mut ends =
            [PollFd::from_borrowed_fd(keys, PollFlags::IN), PollFd::new(&stdout, PollFlags::empty())];
        let time = Timespec { tv_sec: time.as_secs() as i64, tv_nsec: i64::from(time.subsec_nanos()) };
        // An interrupted wait is one that found nothing.
        if poll(&mut ends, Some(&time)).is_err() {
            return true;
        }
        let is_over = PollFlags::HUP | PollFlags::ERR | PollFlags::NVAL;
        !ends.iter().any(|end| end.revents().intersects(is_over))
    }
}
