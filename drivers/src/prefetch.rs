//! Frames ahead of need: a decorator that runs any stereo source on a thread of its own.
//!
//! A fixed pool of frames goes round: empty ones to the worker, full ones back, and
//! [`next_frame`](StereoSource::next_frame) swaps the caller's buffers for full ones, so nothing is
//! copied and nothing is allocated once the pool stands. With all frames full the worker waits.

use crate::{DriverError, Faults, StereoFrame, StereoSource};
use std::panic::resume_unwind;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::{Builder, JoinHandle};

/// Message of the worker: the next frame, the end or the failure of the source, and its faults up to then.
type Delivery = (Result<Option<StereoFrame>, DriverError>, Faults);

/// A [`StereoSource`] that is ahead of its reader by up to a fixed number of frames.
///
/// Frames, order and faults are those of the source. A panic of the source is passed on to the caller of
/// `next_frame`. Dropping it ends the worker, after the frame that the source is busy with.
pub struct Prefetch {
    channels: Option<Channels>,
    worker: Option<JoinHandle<()>>,
    sizes_px: [(usize, usize); 2],
    expected: Option<u64>,
    faults: Faults,
}

struct Channels {
    full: Receiver<Delivery>,
    empty: SyncSender<StereoFrame>,
}

impl Prefetch {
    /// Runs `source` up to `depth` frames ahead (at least one), in buffers of `sizes_px`.
    ///
    /// # Errors
    /// When the system refuses a thread.
    pub fn new<S: StereoSource + 'static>(
        source: S,
        sizes_px: [(usize, usize); 2],
        depth: usize,
    ) -> Result<Self, DriverError> {
        let depth = depth.max(1);
        // Every frame of the pool, and the last report: no send into these can ever wait.
        let (to_reader, full) = sync_channel(depth + 1);
        let (empty, from_reader) = sync_channel(depth + 1);
        for _ in 0..depth {
            // The receiver is alive and there is room: this cannot fail.
            let _ = empty.send(StereoFrame::new(sizes_px));
        }
        let (expected, faults) = (source.expected_frames(), source.faults());
        let worker = Builder::new()
            .name("prefetch".into())
            .spawn(move || run(source, &from_reader, &to_reader))
            .map_err(DriverError::Thread)?;
        let channels = Some(Channels { full, empty });
        Ok(Self { channels, worker: Some(worker), sizes_px, expected, faults })
    }

    /// Ends the worker and passes its panic on, if it had one.
    fn finish(&mut self) {
        self.channels = None;
        if let Some(Err(panic)) = self.worker.take().map(JoinHandle::join) {
            resume_unwind(panic);
        }
    }
}

/// The worker: fills empty frames until the stream ends, fails, or nobody reads any more.
fn run(mut source: impl StereoSource, empty: &Receiver<StereoFrame>, full: &SyncSender<Delivery>) {
    while let Ok(mut frame) = empty.recv() {
        let next = source.next_frame(&mut frame).map(|is_there| is_there.then_some(frame));
        let is_last = !matches!(next, Ok(Some(_)));
        if full.send((next, source.faults())).is_err() || is_last {
            return;
        }
    }
}

impl StereoSource for Prefetch {
    fn next_frame(&mut self, frame: &mut StereoFrame) -> Result<bool, DriverError> {
        let Some(channels) = &self.channels else { return Ok(false) };
        let delivered = channels.full.recv().map(|(next, faults)| {
            self.faults = faults;
            next
        });
        match delivered {
            Ok(Ok(Some(mut next))) => {
                std::mem::swap(frame, &mut next);
                if next.images.each_ref().map(|i| (i.width(), i.height())) != self.sizes_px {
                    next = StereoFrame::new(self.sizes_px);
                }
                // Fails only when the worker has gone, and then its last report says why.
                let _ = channels.empty.send(next);
                Ok(true)
            }
            end => {
                self.finish();
                end.unwrap_or(Ok(None)).map(|_| false)
            }
        }
    }

    fn expected_frames(&self) -> Option<u64> {
        self.expected
    }

    fn faults(&self) -> Faults {
        self.faults
    }
}

impl Drop for Prefetch {
    fn drop(&mut self) {
        self.channels = None;
        if let Some(worker) = self.worker.take() {
            // A panic nobody asked about any more was printed by its thread.
            let _ = worker.join();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use plumbline_config::Timestamp;
    use std::sync::Arc;
    use std::sync::atomic::{AtomicU64, Ordering};

    /// Counts up to `end`, then does as `then` says.
    struct Counter {
        produced: Arc<AtomicU64>,
        end: u64,
        then: fn() -> Result<bool, DriverError>,
    }

    impl StereoSource for Counter {
        fn next_frame(&mut self, frame: &mut StereoFrame) -> Result<bool, DriverError> {
            let n = self.produced.load(Ordering::SeqCst);
            if n == self.end {
                return (self.then)();
            }
            frame.sequence = n;
            frame.stamp = Timestamp::from_nanos(n as i64);
            frame.images[0].pixels_mut().fill(n as u8);
            frame.valid = [true, false];
            self.produced.store(n + 1, Ordering::SeqCst);
            Ok(true)
        }

        fn expected_frames(&self) -> Option<u64> {
            Some(self.end)
        }

        fn faults(&self) -> Faults {
            Faults { corrupt: self.produced.load(Ordering::SeqCst), ..Faults::default() }
        }
    }

    const SIZES: [(usize, usize); 2] = [(4, 3), (0, 0)];

    fn counter(end: u64, then: fn() -> Result<bool, DriverError>) -> (Prefetch, Arc<AtomicU64>) {
        let produced = Arc::new(AtomicU64::new(0));
        let source = Counter { produced: Arc::clone(&produced), end, then };
        (Prefetch::new(source, SIZES, 3).unwrap(), produced)
    }

    #[test]
    fn frames_and_faults_arrive_in_order() {
        let (mut prefetch, _) = counter(100, || Ok(false));
        let mut frame = StereoFrame::new(SIZES);
        for n in 0..100 {
            assert!(prefetch.next_frame(&mut frame).unwrap());
            assert_eq!((frame.sequence, frame.images[0].pixels()[11]), (n, n as u8));
            assert_eq!(prefetch.faults().corrupt, n + 1);
        }
        assert!(!prefetch.next_frame(&mut frame).unwrap());
        assert!(!prefetch.next_frame(&mut frame).unwrap());
        assert_eq!(prefetch.expected_frames(), Some(100));
    }

    #[test]
    fn the_worker_waits_for_the_reader_and_ends_with_it() {
        let (prefetch, produced) = counter(u64::MAX, || Ok(false));
        while produced.load(Ordering::SeqCst) < 3 {
            std::thread::yield_now();
        }
        std::thread::sleep(std::time::Duration::from_millis(20));
        assert_eq!(produced.load(Ordering::SeqCst), 3);
        drop(prefetch);
        assert_eq!(Arc::strong_count(&produced), 1, "the source was dropped with its thread");
    }

    #[test]
    #[should_panic(expected = "source gave up")]
    fn a_panic_of_the_source_is_passed_on() {
        let (mut prefetch, _) = counter(1, || panic!("source gave up"));
        let mut frame = StereoFrame::new(SIZES);
        while prefetch.next_frame(&mut frame).unwrap() {}
    }
}
