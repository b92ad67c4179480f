//! The tasks that read the drivers. A replayed or simulated stream is held back until its time has come.

use super::super::RunError;
use super::{NAP, Shared};
use crate::schedule::ring::{Bell, Reader, Writer};
use crate::schedule::tasks::TaskId;
use crate::schedule::ticker::Monotonic;
use plumbline_drivers::{Faults, ImuReading, ImuSource, StereoFrame, StereoSource};

/// A frame that arrives later than this after its time was late at its source, ms.
const LATE_AT_SOURCE_MS: f64 = 5.0;

/// A frame and when it was there.
pub struct Arrival {
    pub frame: StereoFrame,
    pub at: Monotonic,
}

/// Reads inertial samples.
pub struct ImuTask {
    pub source: Box<dyn ImuSource>,
    pub first: Option<ImuReading>,
}

impl ImuTask {
    /// Reads the stream to its end. A recorded one is read ahead: the tick takes what is due.
    pub fn run(mut self, shared: &Shared<'_>, mut readings: Writer<ImuReading>) -> Faults {
        let mut next = self.first;
        while let Some(reading) = next {
            while !readings.has_room() && !shared.is_stopped() {
                std::thread::sleep(shared.table.row(TaskId::Imu).period);
            }
            if shared.is_stopped() || readings.push(reading).is_err() {
                break;
            }
            next = self.source.next_reading().unwrap_or_else(|error| {
                shared.fail(RunError::Driver(error));
                None
            });
        }
        self.source.faults()
    }
}

/// Reads frames.
pub struct CameraTask {
    pub source: Box<dyn StereoSource>,
    pub empty: Reader<StereoFrame>,
    pub arrivals: Writer<Arrival>,
    pub bell: Bell,
    /// Frames that the source itself brought late.
    pub late: u64,
}

impl CameraTask {
    /// Reads the stream to its end.
    pub fn run(mut self, shared: &Shared<'_>) -> (Faults, u64) {
        self.bell.listen();
        while let Some(mut frame) = self.empty_frame(shared) {
            match self.source.next_frame(&mut frame) {
                Ok(true) => {}
                Ok(false) => break,
                Err(error) => {
                    shared.fail(RunError::Driver(error));
                    break;
                }
            }
            let due = shared.due(frame.stamp);
            due.sleep_until();
            let at = Monotonic::now();
            self.late += u64::from(at.ms_since(due) > LATE_AT_SOURCE_MS);
            shared.heartbeats.give(TaskId::FrontEnd);
            if self.arrivals.push(Arrival { frame, at }).is_err() {
                break;
            }
        }
        (self.source.faults(), self.late)
    }

    fn empty_frame(&mut self, shared: &Shared<'_>) -> Option<StereoFrame> {
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
