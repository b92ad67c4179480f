//! The tasks that read the drivers. A replayed or simulated stream is held back until its time has come.

use super::super::RunError;
use super::NAP;
use super::shared::RunState;
use crate::schedule::ring::{Bell, Reader, Writer};
use crate::schedule::tasks::TaskId;
use crate::schedule::ticker::Monotonic;
use plumbline_config::Portable;
use plumbline_drivers::{Faults, ImuReading, ImuSource, StereoFrame, StereoSource};
use plumbline_estimator::admission::{StampGate, StampVerdict};
use serde::Serialize;

/// A recorded frame that arrives later than this after its time was late at its source, ms; one of a camera after a period.
const LATE_AT_SOURCE_MS: f64 = 5.0;

/// A source that is further behind than this passes over the frames that are overdue, periods.
const OVERDUE_PERIODS: f64 = 2.0;

/// A frame and when it was there.
pub struct Arrival {
    pub frame: StereoFrame,
    pub at: Monotonic,
}

/// Reads inertial samples.
pub struct ImuTask {
    pub source: Box<dyn ImuSource>,
    pub first: Option<ImuReading>,
    pub readings: Writer<ImuReading>,
}

impl ImuTask {
    /// Reads the stream to its end. A recorded one is read ahead: the tick takes what is due.
    pub fn run(mut self, shared: &RunState<'_>) -> Faults {
        let mut next = match self.first.take() {
            Some(first) => Some(first),
            None => self.next(shared),
        };
        while let Some(reading) = next {
            while !self.readings.has_room() && !self.readings.is_closed() && !shared.is_stopped() {
                shared.heartbeats.busy(TaskId::Imu);
                std::thread::sleep(shared.table.row(TaskId::Imu).period);
            }
            if shared.is_stopped() || self.readings.push(reading).is_err() {
                break;
            }
            next = self.next(shared);
        }
        self.source.faults()
    }

    fn next(&mut self, shared: &RunState<'_>) -> Option<ImuReading> {
        // A device may take its time.
        shared.heartbeats.idle(TaskId::Imu);
        let reading = self.source.next_reading().unwrap_or_else(|error| {
            shared.fail(RunError::Driver(error));
            None
        });
        shared.heartbeats.busy(TaskId::Imu);
        reading
    }
}

/// Result of the camera's task.
pub struct CameraEnd {
    pub faults: Faults,
    pub figures: CameraFigures,
}

/// Reads frames.
pub struct CameraTask {
    pub source: Box<dyn StereoSource>,
    pub empty: Reader<StereoFrame>,
    pub arrivals: Writer<Arrival>,
    pub bell: Bell,
    /// Timing of the source.
    pub kept: CameraFigures,
    /// The stamps of the frames: one that does not follow is not waited for.
    pub stamps: StampGate,
}

/// Timing of a source of frames.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct CameraFigures {
    /// Frames that it brought late.
    pub frames_late_at_source: u64,
    /// Lateness of the latest frame, ms.
    pub frame_latest_at_source_ms: f64,
    /// Frames that it passed over to be in time again.
    pub frames_overdue_at_source: u64,
}

impl CameraTask {
    /// Reads the stream to its end.
    pub fn run(mut self, shared: &RunState<'_>) -> CameraEnd {
        self.bell.listen();
        let period_ms = shared.table.row(TaskId::Camera).period.as_secs_f64() * 1e3;
        let overdue_ms = OVERDUE_PERIODS * period_ms;
        // Exposure, readout and the way here take their time.
        let late_at_source_ms = if shared.is_of_sensors() { period_ms } else { LATE_AT_SOURCE_MS };
        while let Some(mut frame) = self.empty_frame(shared) {
            match self.source.next_frame(&mut frame) {
                Ok(true) => shared.heartbeats.busy(TaskId::Camera),
                Ok(false) => break,
                Err(error) => {
                    shared.fail(RunError::Driver(error));
                    break;
                }
            }
            let due = shared.due(frame.stamp);
            let follows = matches!(
                self.stamps.admit(frame.stamp, None),
                StampVerdict::Follows | StampVerdict::ClockSet
            );
            if follows && !shared.is_of_sensors() {
                shared.heartbeats.idle(TaskId::Camera);
                due.sleep_until();
            }
            let at = Monotonic::now();
            let late_ms = at.ms_since(due);
            self.kept.frames_late_at_source += u64::from(late_ms > late_at_source_ms);
            self.kept.frame_latest_at_source_ms = self.kept.frame_latest_at_source_ms.at_least(late_ms);
            if follows && late_ms > overdue_ms {
                self.kept.frames_overdue_at_source += self.source.skip_to(shared.data_time(at));
            }
            shared.heartbeats.give(TaskId::FrontEnd);
            if self.arrivals.push(Arrival { frame, at }).is_err() {
                break;
            }
        }
        CameraEnd { faults: self.source.faults(), figures: self.kept }
    }

    /// Waits for room. Where there is none the front-end has all frames, and waits for samples: that is no stall of the camera.
    fn empty_frame(&mut self, shared: &RunState<'_>) -> Option<StereoFrame> {
        shared.heartbeats.idle(TaskId::Camera);
        loop {
            if shared.is_stopped() || self.empty.is_closed() {
                return None;
            }
            let Self { empty, bell, .. } = self;
            if let Some(frame) = bell.wait(NAP, || empty.pop()) {
                return Some(frame);
            }
        }
    }
}
