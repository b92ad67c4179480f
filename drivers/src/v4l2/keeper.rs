//! A thread that opens devices, and takes away those that are gone: both may wait for the hardware, and the thread that
//! reads the other camera must not.

use super::controls::ExposureProbe;
use super::device::{self, OpenError, Stream, Wanted};
use super::figures::V4l2Monitor;
use crate::DriverError;
use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::thread::{Builder, JoinHandle};
use std::time::{Duration, Instant};

/// A camera that is missing is tried again after this.
const RETRY: Duration = Duration::from_millis(200);
/// An exposure that the camera chooses is asked for this often.
const EXPOSURE_EVERY: Duration = Duration::from_millis(500);
/// At the end the thread is waited for so long: a driver that never returns keeps it.
const END_WITHIN: Duration = Duration::from_secs(2);

/// Exposures of both cameras, ns; 0 where they are not known.
pub(crate) type Exposures = Arc<[AtomicI64; 2]>;

/// The thread's other end.
#[derive(Debug)]
pub(crate) struct Keeper {
    gone: Option<SyncSender<(usize, Option<Stream>)>>,
    opened: [Receiver<Stream>; 2],
    thread: Option<JoinHandle<()>>,
}

/// State of the keeper's thread.
struct Work {
    wanted: Vec<Wanted>,
    probes: [Option<ExposureProbe>; 2],
    is_missing: [bool; 2],
    exposures: Exposures,
    monitor: V4l2Monitor,
    gone: Receiver<(usize, Option<Stream>)>,
    opened: [SyncSender<Stream>; 2],
}

impl Keeper {
    /// Starts the thread for these devices; `probes` are of those that stream already.
    pub(crate) fn start(
        wanted: Vec<Wanted>,
        probes: [Option<ExposureProbe>; 2],
        exposures: Exposures,
        monitor: V4l2Monitor,
    ) -> Result<Self, DriverError> {
        // A stream is gone once for each time that it was opened: sends into these never wait.
        let (gone, gone_of) = sync_channel(4);
        let [(to_left, left), (to_right, right)] = [sync_channel(2), sync_channel(2)];
        let work = Work {
            wanted,
            probes,
            is_missing: [false; 2],
            exposures,
            monitor,
            gone: gone_of,
            opened: [to_left, to_right],
        };
        let thread =
            Builder::new().name("cameras".into()).spawn(|| work.run()).map_err(DriverError::Thread)?;
        Ok(Self { gone: Some(gone), opened: [left, right], thread: Some(thread) })
    }

    /// Has this camera opened as soon as it is there; `stream` is what is left of it.
    pub(crate) fn find(&self, camera: usize, stream: Option<Stream>) {
        if let Some(gone) = &self.gone {
            let _ = gone.try_send((camera, stream));
        }
    }

    /// The camera's stream, when it has been opened.
    pub(crate) fn opened(&self, camera: usize) -> Option<Stream> {
        self.opened[camera].try_recv().ok()
    }
}

impl Drop for Keeper {
    fn drop(&mut self) {
        self.gone = None;
        let Some(thread) = self.thread.take() else { return };
        let end = Instant::now() + END_WITHIN;
        while !thread.is_finished() && Instant::now() < end {
            std::thread::sleep(Duration::from_millis(1));
        }
        if thread.is_finished() {
            // A panic was printed by its thread.
            let _ = thread.join();
        }
    }
}

impl Work {
    fn run(mut self) {
        let mut exposure_due = Instant::now() + EXPOSURE_EVERY;
        loop {
            match self.gone.recv_timeout(RETRY) {
                Ok((camera, stream)) => {
                    // The node may not be used again while anybody holds it open.
                    self.probes[camera] = None;
                    drop(stream);
                    self.is_missing[camera] = true;
                }
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => return,
            }
            for camera in 0..self.wanted.len() {
                if self.is_missing[camera] && !self.open(camera) {
                    return;
                }
            }
            if Instant::now() >= exposure_due {
                exposure_due = Instant::now() + EXPOSURE_EVERY;
                self.read_exposures();
            }
        }
    }

    /// Tries to open a camera; whether anybody is left who wants it.
    fn open(&mut self, camera: usize) -> bool {
        let mut stream = match device::open(&self.wanted[camera]) {
            Ok(stream) => stream,
            Err(OpenError::Absent(why)) => {
                self.monitor.set_trouble(camera, Some(why));
                return true;
            }
            Err(OpenError::Refused(why)) => {
                self.monitor.set_trouble(camera, Some(why.to_string()));
                return true;
            }
        };
        self.probes[camera] = stream.probe.take();
        self.is_missing[camera] = false;
        self.monitor.set_trouble(camera, None);
        self.read_exposures();
        self.opened[camera].try_send(stream).is_ok()
    }

    fn read_exposures(&self) {
        for (probe, exposure) in self.probes.iter().zip(self.exposures.iter()) {
            if let Some(read_ns) = probe.as_ref().and_then(ExposureProbe::read_ns) {
                exposure.store(read_ns, Ordering::Relaxed);
            }
        }
    }
}
