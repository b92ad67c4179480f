//! One device while it streams: its full buffers until they have found their partners, and what became of the others.

use super::device::Stream;
use super::figures::V4l2CameraFigures;
use super::pairing::{Pairing, Side, Waiting};
use super::sequence::Sequence;
use super::stamp::{self, Arrival, Exposure, Source};
use super::sys::queue::Filled;
use crate::clock::StampProblem;
use plumbline_config::{GrayImage, Portable};
use rustix::fd::AsFd as _;
use rustix::fd::BorrowedFd;
use std::collections::VecDeque;

/// Buffers that the driver is left with, at least: one that it fills and one that waits.
const LEFT_TO_DRIVER: usize = 2;
/// Largest number of buffers of a device.
const MAX_BUFFERS: usize = 32;
/// The mean delay follows with this gain.
const DELAY_GAIN: f64 = 1.0 / 16.0;
const MS: f64 = 1e-6;

/// A full buffer.
#[derive(Debug)]
struct Held {
    filled: Filled,
    image: Waiting,
}

/// A device, there or not.
#[derive(Debug)]
pub(crate) struct Camera {
    stream: Option<Stream>,
    is_alive: bool,
    /// The poll said that something is wrong.
    is_suspect: bool,
    held: VecDeque<Held>,
    sequence: Sequence,
    last_stamp_ns: i64,
    /// Beginning of the stream, or arrival of the last image, ns.
    pub(crate) last_sign_ns: i64,
    has_sent: bool,
    pub(crate) figures: V4l2CameraFigures,
}

impl Camera {
    /// Not there yet.
    pub(crate) fn absent() -> Self {
        Self {
            stream: None,
            is_alive: false,
            is_suspect: false,
            held: VecDeque::with_capacity(MAX_BUFFERS),
            sequence: Sequence::default(),
            last_stamp_ns: i64::MIN,
            last_sign_ns: 0,
            has_sent: false,
            figures: V4l2CameraFigures::default(),
        }
    }

    /// Goes on with this stream.
    pub(crate) fn start(&mut self, stream: Stream, now_ns: i64) {
        self.stream = Some(stream);
        (self.is_alive, self.is_suspect) = (true, false);
        self.sequence = Sequence::default();
        (self.last_sign_ns, self.has_sent) = (now_ns, false);
        self.figures.started += 1;
    }

    /// Number of times the stream was started: image numbers count within one stream.
    pub(crate) fn generation(&self) -> u64 {
        self.figures.started
    }

    /// True if an image has come since the stream was started.
    pub(crate) fn has_sent(&self) -> bool {
        self.has_sent
    }

    pub(crate) fn is_alive(&self) -> bool {
        self.is_alive
    }

    /// Descriptor to `poll`; `None` while nothing can come.
    pub(crate) fn poll_fd(&self) -> Option<BorrowedFd<'_>> {
        let stream = self.stream.as_ref().filter(|_| self.is_alive && !self.is_full())?;
        Some(stream.queue.as_fd())
    }

    /// To be told when `poll` saw an error.
    pub(crate) fn suspect(&mut self) {
        self.is_suspect = true;
    }

    /// It is gone, or as good as gone.
    pub(crate) fn lose(&mut self) {
        if std::mem::take(&mut self.is_alive) {
            self.figures.lost += 1;
        }
    }

    /// Remains of a stream that has ended, once the last of its images has been handed out.
    pub(crate) fn remains(&mut self) -> Option<Stream> {
        if self.is_alive || !self.held.is_empty() {
            return None;
        }
        self.stream.take()
    }

    pub(crate) fn side(&self) -> Side {
        let front = self.held.front().map(|held| held.image);
        Side { front, is_alive: self.is_alive, is_full: self.is_full() }
    }

    fn is_full(&self) -> bool {
        let buffers = self.stream.as_ref().map_or(0, |stream| stream.queue.len());
        self.held.len() >= buffers.saturating_sub(LEFT_TO_DRIVER).max(1)
    }

    /// Takes what the driver has, and tells `pairing` of it as that of camera `index`.
    pub(crate) fn drain(
        &mut self,
        index: usize,
        exposure: Exposure,
        pairing: &mut Pairing,
        clocks: impl Fn() -> Arrival,
    ) {
        while self.is_alive && !self.is_full() {
            let Some(stream) = &mut self.stream else { return };
            match stream.queue.dequeue() {
                Ok(Some(filled)) => {
                    let at = clocks();
                    (self.last_sign_ns, self.has_sent) = (at.monotonic_ns, true);
                    self.is_suspect = false;
                    self.take(filled, index, exposure, pairing, at);
                }
                // An error that brings neither image nor error code would be seen again at once, for ever.
                Ok(None) if !self.is_suspect => return,
                Ok(None) | Err(_) => self.lose(),
            }
        }
    }

    fn take(&mut self, filled: Filled, index: usize, exposure: Exposure, pairing: &mut Pairing, at: Arrival) {
        let (sequence, lost) = self.sequence.next(filled.sequence);
        self.figures.missing += lost;
        if filled.is_damaged() {
            self.figures.corrupt += 1;
            self.give_back(filled);
            return;
        }
        let given_ns = filled.stamp_ns;
        let (stamp_ns, source) = stamp::on_monotonic_clock(given_ns, at);
        if source == Source::Arrival {
            let found = StampProblem::of_stamp(given_ns, at.monotonic_ns, at.system_ns);
            StampProblem::note(&mut self.figures.problem, found);
        }
        let stamp_ns = stamp::mid_exposure(stamp_ns, source, filled.flags, exposure);
        if stamp_ns <= self.last_stamp_ns {
            self.figures.disordered += 1;
            let found = StampProblem::repeated(given_ns, at.monotonic_ns);
            StampProblem::note(&mut self.figures.problem, found);
            self.give_back(filled);
            return;
        }
        self.last_stamp_ns = stamp_ns;
        self.count(at.monotonic_ns - stamp_ns, source, exposure);
        let image = Waiting { stamp_ns, sequence, arrival_ns: at.monotonic_ns };
        pairing.arrived(index, image);
        self.held.push_back(Held { filled, image });
    }

    fn count(&mut self, delay_ns: i64, source: Source, exposure: Exposure) {
        let figures = &mut self.figures;
        figures.images += 1;
        figures.restamped += u64::from(source == Source::Arrival);
        figures.exposure_ms = exposure.exposure_ns as f64 * MS;
        let delay_ms = delay_ns as f64 * MS;
        let gain = if figures.images == 1 { 1.0 } else { DELAY_GAIN };
        figures.delay_ms += gain * (delay_ms - figures.delay_ms);
        figures.max_delay_ms = figures.max_delay_ms.at_least(delay_ms);
    }

    fn give_back(&mut self, filled: Filled) {
        let Some(stream) = &mut self.stream else { return };
        if stream.queue.requeue(filled).is_err() {
            self.lose();
        }
    }

    /// Writes the oldest image (or both of them) and gives its buffer back; what it was, and whether it could be read.
    pub(crate) fn hand_out(&mut self, images: &mut [GrayImage]) -> Option<(Waiting, bool)> {
        let Held { filled, image } = self.held.pop_front()?;
        let Stream { queue, converter, .. } = self.stream.as_mut()?;
        let is_whole = converter.convert(queue.bytes(&filled), images).is_some();
        self.figures.corrupt += u64::from(!is_whole);
        self.give_back(filled);
        Some((image, is_whole))
    }
}
