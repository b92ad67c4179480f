//! A source of frames around another one, that stamps them by their triggers.

use super::figures::{TriggerFigures, TriggerMonitor};
use super::matching::{Matched, Matching};
use crate::serial::TriggerEvent;
use crate::v4l2::V4l2Monitor;
use crate::{DriverError, Faults, StereoFrame, StereoSource};
use plumbline_config::Timestamp;
use rtrb::Consumer;

/// Frames are held back for so long while nothing is known of triggers, ns: a clock is learnt in one to three seconds.
const PATIENCE_NS: i64 = 5_000_000_000;
const MS: f64 = 1e-6;

/// Source of the exposure of a triggered frame.
#[derive(Clone, Debug)]
pub enum Exposure {
    /// As long as the pulse; where that has no length, what the cameras' driver says, if there is one.
    Pulse(Option<V4l2Monitor>),
    /// Exposure by the cameras' driver, if there is one.
    Camera(Option<V4l2Monitor>),
}

impl Exposure {
    fn half_ns(&self, pulse_ns: u32) -> i64 {
        match self {
            Self::Pulse(_) if pulse_ns > 0 => i64::from(pulse_ns) / 2,
            Self::Pulse(cameras) | Self::Camera(cameras) => {
                cameras.as_ref().and_then(V4l2Monitor::exposure_ns).unwrap_or(0) / 2
            }
        }
    }
}

/// Frames stamped by the trigger's edge and half of the exposure, on the clock of the inertial samples. Nothing is allocated
/// while frames come.
#[derive(Debug)]
pub struct Triggered<S> {
    source: S,
    triggers: Consumer<TriggerEvent>,
    exposure: Exposure,
    matching: Matching,
    first_stamp_ns: Option<i64>,
    last_stamp_ns: i64,
    disordered: u64,
    figures: TriggerFigures,
    monitor: TriggerMonitor,
}

impl<S: StereoSource> Triggered<S> {
    /// The frames of `source`, whose cameras are triggered `rate_hz` times a second.
    pub fn new(source: S, triggers: Consumer<TriggerEvent>, exposure: Exposure, rate_hz: f64) -> Self {
        Self {
            source,
            triggers,
            exposure,
            matching: Matching::new(1e9 / rate_hz),
            first_stamp_ns: None,
            last_stamp_ns: i64::MIN,
            disordered: 0,
            figures: TriggerFigures::default(),
            monitor: TriggerMonitor::default(),
        }
    }

    /// Monitor that shows the figures to other threads.
    #[must_use]
    pub fn monitor(&self) -> TriggerMonitor {
        self.monitor.clone()
    }

    /// The middle of the exposure of a frame, ns; `None` of one that is not to be handed out.
    fn stamp(&mut self, frame: &StereoFrame) -> Option<i64> {
        while let Ok(event) = self.triggers.pop() {
            self.matching.triggered(&event);
        }
        let own_ns = frame.stamp.as_nanos();
        let first_ns = *self.first_stamp_ns.get_or_insert(own_ns);
        let exposure = &self.exposure;
        let matched = self.matching.frame(frame.sequence, own_ns, |pulse_ns| exposure.half_ns(pulse_ns));
        let is_patient = own_ns.saturating_sub(first_ns) < PATIENCE_NS;
        let figures = &mut self.figures;
        let (count, stamp_ns) = match matched {
            Matched::Trigger(middle_ns) => (&mut figures.by_trigger, Some(middle_ns)),
            Matched::Predicted(middle_ns) => (&mut figures.predicted, Some(middle_ns)),
            Matched::Delay(middle_ns) => (&mut figures.by_delay, Some(middle_ns)),
            Matched::Doubtful => (&mut figures.doubtful, None),
            Matched::Unknown if is_patient => (&mut figures.held_back, None),
            Matched::Unknown => (&mut figures.by_driver, Some(own_ns)),
        };
        *count += 1;
        figures.without = match matched {
            Matched::Trigger(_) | Matched::Predicted(_) => 0,
            _ => figures.without + 1,
        };
        figures.found = self.matching.found();
        figures.delay_ms = self.matching.delay_ns().unwrap_or(0.0) * MS;
        self.monitor.show(figures);
        stamp_ns
    }
}

impl<S: StereoSource> StereoSource for Triggered<S> {
    fn next_frame(&mut self, frame: &mut StereoFrame) -> Result<bool, DriverError> {
        while self.source.next_frame(frame)? {
            let Some(stamp_ns) = self.stamp(frame) else { continue };
            if stamp_ns <= self.last_stamp_ns {
                self.disordered += 1;
                continue;
            }
            self.last_stamp_ns = stamp_ns;
            frame.stamp = Timestamp::from_nanos(stamp_ns);
            return Ok(true);
        }
        Ok(false)
    }

    fn skip_to(&mut self, stamp: Timestamp) -> u64 {
        self.source.skip_to(stamp)
    }

    fn expected_frames(&self) -> Option<u64> {
        self.source.expected_frames()
    }

    fn faults(&self) -> Faults {
        let faults = self.source.faults();
        Faults {
            missing: faults.missing + self.figures.doubtful,
            disordered: faults.disordered + self.disordered,
            ..faults
        }
    }
}
