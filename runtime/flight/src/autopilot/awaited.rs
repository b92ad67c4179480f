//! Something that is not to be had yet, and is looked for by a thread of normal priority: names and devices may take their time.

use std::sync::Arc;
use std::sync::mpsc::{Receiver, sync_channel};
use std::time::Duration;

/// It is looked for this often.
const RETRY: Duration = Duration::from_millis(500);

/// Search for something that is not there yet.
#[derive(Debug)]
pub struct Awaited<T> {
    found: Receiver<T>,
    /// The thread ends when it is gone.
    _wanted: Arc<()>,
}

impl<T: Send + 'static> Awaited<T> {
    /// Asks `look` for it until there is one.
    pub fn search(mut look: impl FnMut() -> Option<T> + Send + 'static) -> Self {
        let (finder, found) = sync_channel(1);
        let wanted = Arc::new(());
        let is_wanted = Arc::downgrade(&wanted);
        let search = move || {
            while is_wanted.strong_count() > 0 {
                std::thread::sleep(RETRY);
                if let Some(found) = look() {
                    let _ = finder.send(found);
                    return;
                }
            }
        };
        let spawned = std::thread::Builder::new().name("autopilot-link".into()).spawn(search);
        if let Err(error) = spawned {
            tracing::error!("cannot watch for the autopilot's serial device: {error}");
        }
        Self { found, _wanted: wanted }
    }

    /// Takes the find, once; never waits.
    pub fn take(&self) -> Option<T> {
        self.found.try_recv().ok()
    }
}
