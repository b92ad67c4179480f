//! The orders of a log, for the machine that executes its flight again.
//!
//! The odometry is given one reading after the other and the corrections in between, the estimator each frame after as many
//! readings as it had then. They meet where an estimate takes effect. Nothing of the recorded outputs enters: they are
//! only handed to the comparison.
//!
//! The threads of a run wrote the log side by side. What is read before frame `k` is tracked reaches two frames further
//! (whether the frame was lost stands there), and so holds all that the map had to do with the frames before it.

use super::LogError;
use super::channel::Channel;
use super::comparison::Comparison;
use super::cursor::Cursor;
use super::frames::FramePlayback;
use crate::pipeline::machine::{Machine, Order, Orders};
use crate::schedule::ladder::Rung;
use plumbline_config::Timestamp;
use plumbline_drivers::{ImuReading, StereoSource};
use plumbline_record::{CorrectionOrder, FrameOrder, InstantOrder, MapOrder, ResetOrder, Verdict};
use std::collections::VecDeque;

/// Next step of the execution.
#[derive(Clone, Copy)]
enum Step {
    /// Another reading for the odometry, with all that it brings.
    Reading,
    /// The corrections before it.
    Corrections(ImuReading),
    /// The frames after it.
    Frames,
    /// The frames after the last reading.
    Rest,
    /// Nothing.
    Over,
}

/// Outcome of following a frame.
enum Followed {
    /// Something before it.
    Before(Order<'static>),
    /// The frame, at this level of work.
    Frame(Rung),
    /// Nothing: it was not estimated, or the log ends before it.
    Nothing,
}

/// Orders of a log, as they were given in flight.
pub struct LogOrders<'a> {
    log: Cursor,
    frames: FramePlayback,
    comparison: Comparison,
    /// Told the part that is done, from 0 to 1.
    progress: &'a mut dyn FnMut(f64),
    step: Step,
    readings: Readings,
    /// Readings that the odometry was given.
    ticked: u64,
    /// Readings that the estimator was given.
    fed: u64,
    /// The frame that is being followed.
    following: Option<FrameOrder>,
    /// The log ends before a frame that was taken.
    has_ended: bool,
    correction: Option<CorrectionOrder>,
    reset: Option<ResetOrder>,
    instant: Option<InstantOrder>,
    /// First and last reading.
    span: Option<(Timestamp, Timestamp)>,
    /// Gap that the recorder reports.
    gap: Option<String>,
    /// Frames that were refused in flight.
    pub refused: u64,
}

/// Readings that one of estimator and odometry has still to be given.
#[derive(Default)]
struct Readings {
    held: VecDeque<ImuReading>,
    first: u64,
}

impl Readings {
    /// Reading `index` of the run, read from the log if need be; `None` after the last.
    fn get(&mut self, index: u64, log: &mut Cursor) -> Result<Option<ImuReading>, LogError> {
        while self.first + self.held.len() as u64 <= index {
            match log.next(Channel::Imu)? {
                Some(reading) => self.held.push_back(reading),
                None => return Ok(None),
            }
        }
        let place = usize::try_from(index.saturating_sub(self.first)).unwrap_or(usize::MAX);
        Ok(self.held.get(place).copied())
    }

    fn forget_before(&mut self, index: u64) {
        while self.first < index && self.held.pop_front().is_some() {
            self.first += 1;
        }
    }
}

impl<'a> LogOrders<'a> {
    /// Orders from the beginning of `log`, with the images of a data set or its own.
    pub fn new(
        log: Cursor,
        images: Option<Box<dyn StereoSource>>,
        comparison: Comparison,
        progress: &'a mut dyn FnMut(f64),
    ) -> Self {
        let frames = FramePlayback::new(&log.reader().about().config, images);
        Self {
            log,
            frames,
            comparison,
            progress,
            step: Step::Reading,
            readings: Readings::default(),
            ticked: 0,
            fed: 0,
            following: None,
            has_ended: false,
            correction: None,
            reset: None,
            instant: None,
            span: None,
            gap: None,
            refused: 0,
        }
    }

    /// The log.
    pub fn log(&self) -> &Cursor {
        &self.log
    }

    /// Readings executed so far.
    pub fn readings(&self) -> u64 {
        self.ticked
    }

    /// Time of data that was executed, s.
    pub fn span_s(&self) -> f64 {
        self.span.map_or(0.0, |(first, last)| last.seconds_since(first))
    }

    /// Reason why the execution ended before the log, if it did.
    pub fn break_off(&self) -> Option<&str> {
        self.gap.as_deref().or(self.log.damage())
    }

    /// Reads the rest of the log, for how it ends.
    ///
    /// # Errors
    /// When it cannot be read.
    pub fn read_to_end(&mut self) -> Result<(), LogError> {
        self.log.read_to_end()
    }

    /// The next reading for the odometry; the frames that are left after the last.
    fn next_reading(&mut self) -> Result<Step, LogError> {
        let reading = self.readings.get(self.ticked, &mut self.log)?;
        self.readings.forget_before(self.ticked.min(self.fed));
        let is_same = self.comparison.outputs().difference().is_none();
        if self.lacks_input() || !is_same {
            return Ok(Step::Over);
        }
        self.comparison.outputs().take_recorded(&mut self.log)?;
        if self.ticked.is_multiple_of(100) {
            let log = self.log.reader();
            (self.progress)(log.read_bytes() as f64 / log.total_bytes().max(1) as f64);
        }
        let Some(reading) = reading else { return Ok(Step::Rest) };
        let stamp = reading.sample.stamp;
        self.span = Some(self.span.map_or((stamp, stamp), |(first, _)| (first, stamp)));
        Ok(Step::Corrections(reading))
    }

    /// A log that lacks an input ends the execution: what comes after it cannot be made again.
    fn lacks_input(&mut self) -> bool {
        let dropped = self.log.reader().dropped();
        if dropped.inputs() > 0 && self.gap.is_none() {
            self.gap = Some(format!(
                "the recorder dropped {dropped} there, so the rest cannot be executed again; record with longer queues \
                 (recorder.queue_entries, recorder.queue_frames) or smaller images"
            ));
        }
        self.gap.is_some()
    }

    /// A request that was answered after the last reading, before the corrections that came with the next.
    fn next_instant(&mut self) -> Result<Option<Order<'static>>, LogError> {
        if self.instant.is_none() {
            self.instant = self.log.next_waiting(Channel::InstantOrder)?;
        }
        Ok(self.instant.take_if(|order| order.readings_before <= self.ticked).map(Order::Instant))
    }

    /// A correction that comes before the next reading: it takes effect once its frame is estimated.
    fn correct(&mut self, machine: &Machine<'_>) -> Result<Option<Order<'static>>, LogError> {
        loop {
            if self.correction.is_none() {
                self.correction = self.log.next_waiting(Channel::CorrectionOrder)?;
            }
            let Some(CorrectionOrder { frame, readings_before }) =
                self.correction.filter(|order| order.readings_before <= self.ticked)
            else {
                return Ok(None);
            };
            if readings_before < self.ticked {
                return Err(self.unusable(format!("the correction by frame {frame} comes too late")));
            }
            match machine.tick().waiting_from(frame) {
                Some(waiting) if waiting == frame => {
                    self.correction = None;
                    return Ok(Some(Order::Correct(frame)));
                }
                Some(_) => {
                    let reason = format!("frame {frame} corrects the odometry, but was not estimated");
                    return Err(self.unusable(reason));
                }
                None if machine.unsolved().is_some() => return Ok(Some(Order::Solve)),
                None if self.begin_frame()? => return Ok(None),
                // The log ends before it.
                None => self.correction = None,
            }
        }
    }

    /// Begins to follow the next order of a frame; `false` when the log ends before it.
    fn begin_frame(&mut self) -> Result<bool, LogError> {
        self.following = match self.has_ended {
            true => None,
            false => self.log.next(Channel::FrameOrder)?,
        };
        Ok(self.following.is_some())
    }

    /// Follows an order of a frame: resets and readings before it, then the frame.
    fn follow(&mut self, order: FrameOrder) -> Result<Followed, LogError> {
        // A fresh start before the samples since the last frame are given, one that was asked for when they have been.
        if let Some(reset) = self.reset_before(order.frame, true)? {
            return Ok(Followed::Before(Order::Reset(reset)));
        }
        if order.readings_before < self.fed {
            return Err(self.unusable(format!("the order of frame {} comes too late", order.frame)));
        }
        if self.fed < order.readings_before {
            let Some(reading) = self.readings.get(self.fed, &mut self.log)? else {
                (self.has_ended, self.following) = (true, None);
                return Ok(Followed::Nothing);
            };
            self.fed += 1;
            return Ok(Followed::Before(Order::Feed(reading)));
        }
        if let Some(reset) = self.reset_before(order.frame, false)? {
            return Ok(Followed::Before(Order::Reset(reset)));
        }
        self.following = None;
        let Verdict::Taken { level } = order.verdict else {
            self.refused += 1;
            return Ok(Followed::Nothing);
        };
        if self.log.is_lost(order.frame)? {
            return Ok(Followed::Nothing);
        }
        let Some(rung) = Rung::of_level(level) else {
            return Err(self.unusable(format!(
                "frame {} was estimated at level {level}, which this build does not have; verify with the build \
                 that recorded it",
                order.frame
            )));
        };
        self.has_ended = !self.frames.find(order.frame, &mut self.log)?;
        Ok(if self.has_ended { Followed::Nothing } else { Followed::Frame(rung) })
    }

    /// The next reset before a frame.
    fn reset_before(&mut self, frame: u64, is_renewal: bool) -> Result<Option<ResetOrder>, LogError> {
        if self.reset.is_none() {
            self.reset = self.log.next_waiting(Channel::ResetOrder)?;
        }
        Ok(self.reset.take_if(|order| order.before_frame <= frame && order.is_renewal == is_renewal))
    }

    fn unusable(&self, reason: String) -> LogError {
        LogError::unusable(self.log.reader().path(), reason)
    }
}

impl Orders for LogOrders<'_> {
    type Error = LogError;

    fn next<'f>(&'f mut self, machine: &Machine<'_>) -> Result<Option<Order<'f>>, LogError> {
        loop {
            if let Some(frame) = machine.window().map().and_then(|map| map.missing()) {
                let reason = format!("frame {frame} took effect in the map, but was not given to it");
                return Err(self.unusable(reason));
            }
            if let Some(order) = self.log.next_waiting::<MapOrder>(Channel::MapOrder)? {
                return Ok(Some(Order::Map(order)));
            }
            if let Some(order) = self.following {
                match self.follow(order)? {
                    Followed::Before(order) => return Ok(Some(order)),
                    Followed::Frame(rung) => return Ok(Some(Order::Track(self.frames.found(), rung))),
                    Followed::Nothing => continue,
                }
            }
            if matches!(self.step, Step::Corrections(_) | Step::Rest)
                && let Some(order) = self.next_instant()?
            {
                return Ok(Some(order));
            }
            match self.step {
                Step::Reading => self.step = self.next_reading()?,
                Step::Corrections(reading) => match self.correct(machine)? {
                    Some(order) => return Ok(Some(order)),
                    None if self.following.is_some() => {}
                    None => {
                        (self.step, self.ticked) = (Step::Frames, self.ticked + 1);
                        return Ok(Some(Order::Tick(reading)));
                    }
                },
                Step::Frames => {
                    let is_due = |order: FrameOrder| order.readings_before <= self.ticked;
                    // Frames that came in masses wait for the corrections between them.
                    let is_next = machine.tick().has_room() && self.log.peek_order()?.is_some_and(is_due);
                    if !is_next || !self.begin_frame()? {
                        self.step = Step::Reading;
                    }
                }
                Step::Rest => {
                    if !self.begin_frame()? {
                        self.step = Step::Over;
                        self.comparison.outputs().take_recorded(&mut self.log)?;
                        return Ok(Some(Order::Solve));
                    }
                }
                Step::Over => return Ok(None),
            }
        }
    }
}
