//! Keeps the map of a flight that goes on, whenever somebody asks for it.
//!
//! The task of the map copies it, which takes some milliseconds and memory for as long as it is written; a thread of its
//! own brings it to the disk. The copy is of one moment, and the flight does not wait.

use super::{MapContents, write_map};
use crate::pipeline::Control;
use crate::pipeline::listener::{Listener, ListenerView, Producer, Subscriber};
use crate::schedule::worker::Worker;
use std::io;
use std::path::Path;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};

/// Keeps the map in a file on request.
#[derive(Debug)]
pub struct MapSaver {
    control: Arc<Control>,
    to_write: Option<SyncSender<MapContents>>,
    /// Ends when nothing comes any more.
    _worker: Worker,
}

impl MapSaver {
    /// Waits for requests to `control`; `path` is where maps go.
    ///
    /// # Errors
    /// When there can be no thread.
    pub fn start(path: &Path, control: &Arc<Control>) -> io::Result<Self> {
        let (to_write, contents) = sync_channel(1);
        let (path, theirs) = (path.to_owned(), Arc::clone(control));
        let worker = Worker::start("plumbline-map", || {}, move || write_each(&contents, &path, &theirs))?;
        control.map_saves().open();
        Ok(Self { control: Arc::clone(control), to_write: Some(to_write), _worker: worker })
    }
}

fn write_each(contents: &Receiver<MapContents>, path: &Path, control: &Control) {
    for map in contents {
        let outcome = write_map(path, &map).map(|()| map.keyframes.len() as u32);
        match &outcome {
            Ok(keyframes) => tracing::info!("map saved: {keyframes} keyframes in {}", path.display()),
            Err(error) => tracing::error!("map not saved: {error}"),
        }
        control.map_saves().tell(outcome.map_err(|error| error.to_string()));
    }
}

impl Subscriber for MapSaver {
    fn listener(&mut self, producer: Producer) -> Box<dyn Listener> {
        match (producer, self.to_write.take()) {
            (Producer::Places, Some(to_write)) => {
                Box::new(Copier { control: Arc::clone(&self.control), to_write })
            }
            (_, to_write) => {
                self.to_write = to_write;
                Box::new(())
            }
        }
    }
}

/// Copies the map where it is made.
struct Copier {
    control: Arc<Control>,
    to_write: SyncSender<MapContents>,
}

impl Listener for Copier {
    fn shown(&mut self, view: ListenerView<'_>) {
        if let ListenerView::Mapped(mapped) = view
            && self.control.map_saves().take()
        {
            // Of two requests while a map is written, one is enough: the one that waits was copied a moment ago.
            let _ = self.to_write.try_send(MapContents::of(mapped.mapper.map()));
        }
    }
}
