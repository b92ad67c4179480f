//! Brings a log to the medium while it is written: after a power failure all but the last second or so is there.
//!
//! A thread of its own waits for the medium, and the recorder goes on writing meanwhile. A chunk is completed twice a second,
//! and synced within half a second after that, unless the medium itself takes longer.

use super::part_file::Syncer;
use std::io;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::time::Duration;

/// From one sync to the next.
const PERIOD: Duration = Duration::from_millis(500);
/// The end of a recording waits so long for the medium: one that hangs must not hold up the report of the flight.
const LAST_SYNC: Duration = Duration::from_secs(3);

/// The thread that waits for the medium.
#[derive(Debug)]
pub struct SyncThread {
    parts: Sender<Box<dyn Syncer>>,
    ended: Receiver<io::Result<()>>,
}

impl SyncThread {
    /// Starts it.
    ///
    /// # Errors
    /// When the system refuses a thread.
    pub fn start() -> io::Result<Self> {
        let ((parts, newer), (end, ended)) = (channel(), channel());
        std::thread::Builder::new().name("recorder-sync".into()).spawn(move || {
            let _ = end.send(sync_parts(&newer));
        })?;
        Ok(Self { parts, ended })
    }

    /// From now on this part is synced; the one before is complete, and synced once more.
    pub fn follow(&self, part: Box<dyn Syncer>) {
        let _ = self.parts.send(part);
    }

    /// Ends it after a last sync, which is not waited for longer than [`LAST_SYNC`].
    ///
    /// # Errors
    /// When the medium failed in a sync.
    pub fn finish(self) -> io::Result<()> {
        drop(self.parts);
        match self.ended.recv_timeout(LAST_SYNC) {
            Ok(synced) => synced,
            Err(RecvTimeoutError::Timeout) => {
                tracing::warn!(
                    "the log is written, but its disk has not confirmed that within {} s; it may be lost if power fails",
                    LAST_SYNC.as_secs()
                );
                Ok(())
            }
            Err(RecvTimeoutError::Disconnected) => {
                Err(io::Error::other("the thread that syncs the log panicked"))
            }
        }
    }
}

/// Syncs the newest part until there will be no more; the first failure, which the system reports only once.
fn sync_parts(newer: &Receiver<Box<dyn Syncer>>) -> io::Result<()> {
    let mut part: Option<Box<dyn Syncer>> = None;
    let mut synced = Ok(());
    loop {
        let next = newer.recv_timeout(PERIOD);
        let outcome = part.as_mut().map_or(Ok(()), |part| part.sync());
        if let Err(error) = &outcome
            && synced.is_ok()
        {
            tracing::warn!("cannot flush the log to disk: {error}");
        }
        synced = synced.and(outcome);
        match next {
            Ok(newest) => part = Some(newest),
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => return synced,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Fails in its first sync.
    struct FailsOnce(bool);

    impl Syncer for FailsOnce {
        fn sync(&mut self) -> io::Result<()> {
            if std::mem::replace(&mut self.0, true) { Ok(()) } else { Err(io::Error::other("EIO")) }
        }
    }

    #[test]
    fn reports_a_failure_that_the_system_reports_once() {
        let thread = SyncThread::start().unwrap();
        thread.follow(Box::new(FailsOnce(false)));
        thread.follow(Box::new(FailsOnce(true)));
        assert!(thread.finish().is_err());
    }
}
