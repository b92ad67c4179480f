//! Makes events of estimates: what a person looks for first in a log.

use plumbline_estimator::{Estimate, TrackingState};
use plumbline_record::event::{Event, Severity};

/// Notices changes from one estimate to the next.
#[derive(Clone, Debug, Default)]
pub struct Narrator {
    state: Option<TrackingState>,
    reset_counter: u32,
}

impl Narrator {
    /// Event of a changed state or a reset in `estimate`, if any.
    pub fn notice(&mut self, estimate: &Estimate) -> Option<Event> {
        let is_reset = estimate.reset_counter != self.reset_counter;
        let is_changed = self.state != Some(estimate.state);
        (self.state, self.reset_counter) = (Some(estimate.state), estimate.reset_counter);
        let frame = estimate.frame_sequence;
        let (severity, words) = match estimate.state {
            TrackingState::Initialising => (Severity::Info, "initialising"),
            TrackingState::Tracking => (Severity::Info, "tracking"),
            TrackingState::Blind => (Severity::Warning, "blind, on the IMU alone"),
            TrackingState::Failed => (Severity::Error, "failed"),
        };
        if is_reset {
            let text = format_args!("frame {frame}: reset {}, {words}", estimate.reset_counter);
            return Some(Event::new(estimate.stamp, Severity::Warning, text));
        }
        is_changed.then(|| Event::new(estimate.stamp, severity, format_args!("frame {frame}: {words}")))
    }
}
