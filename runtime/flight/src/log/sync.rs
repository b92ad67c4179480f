//! Brings a log to the medium while it is written: after a power failure all but the last second or so is there.
//!
//! A thread of its own waits for the medium, and the recorder goes on writing meanwhile. A chunk is completed twice a second,
//! and synced within half a second after that, unless the medium itself takes longer.

use super::part_file::Syncer;
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::thread::JoinHandle;
use std::time::Duration;

/// From one sync to the next.
const PERIOD: Duration = Duration::from_millis(500);

/// The thread that waits for the medium.
#[derive(Debug)]
pub struct SyncThread {
    parts: Sender<Box<dyn Syncer>>,
    thread: JoinHandle<()>,
}

impl SyncThread {
    /// Starts it.
    ///
    /// # Errors
    /// When the system refuses a thread.
    pub fn start() -> std::io::Result<Self> {
        let (parts, newer) = channel::<Box<dyn Syncer>>();
        let thread = std::thread::Builder::new().name("recorder-sync".into()).spawn(move || {
            let mut part: Option<Box<dyn Syncer>> = None;
            let mut has_warned = false;
            loop {
                match newer.recv_timeout(PERIOD) {
                    // The part before is synced by whoever closes it.
                    Ok(newest) => part = Some(newest),
                    Err(RecvTimeoutError::Timeout) => {}
                    Err(RecvTimeoutError::Disconnected) => return,
                }
                if let Some(Err(error)) = part.as_mut().map(|part| part.sync())
                    && !std::mem::replace(&mut has_warned, true)
                {
                    tracing::warn!("cannot flush the log to disk: {error}");
                }
            }
        })?;
        Ok(Self { parts, thread })
    }

    /// From now on this part is synced.
    pub fn follow(&self, part: Box<dyn Syncer>) {
        let _ = self.parts.send(part);
    }

    /// Ends it, after a sync that is under way.
    pub fn finish(self) {
        drop(self.parts);
        let _ = self.thread.join();
    }
}
