//! Figures of frames and their triggers, for other threads.

use crate::board::Board;
use serde::Serialize;

/// Counts of frames by the origin of their stamp.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct TriggerFigures {
    /// Frames stamped by their trigger.
    pub by_trigger: u64,
    /// Frames stamped by the triggers around theirs, whose message did not come.
    pub predicted: u64,
    /// Frames stamped by their driver less its usual delay, since no trigger was known.
    pub by_delay: u64,
    /// Frames stamped by their driver, since no trigger has ever been known.
    pub by_driver: u64,
    /// Frames that were not handed out, since it was not known yet which triggers are theirs.
    pub held_back: u64,
    /// Frames that were not handed out, since number and time of their trigger contradicted each other.
    pub doubtful: u64,
    /// Number of times the pairing of triggers and frames was established.
    pub found: u64,
    /// The driver's stamp less the middle of the exposure in the mean, ms.
    pub delay_ms: f64,
    /// Frames in a row without a trigger, up to now.
    #[serde(skip)]
    pub without: u64,
}

/// Number of frames in a row without a trigger from which on it is reported.
const TROUBLE: u64 = 20;

/// Shows the figures of a [`Triggered`](super::Triggered) to other threads. Copies show the same.
#[derive(Clone, Debug, Default)]
pub struct TriggerMonitor(Board<TriggerFigures>);

impl TriggerMonitor {
    /// The figures up to the last frame.
    #[must_use]
    pub fn figures(&self) -> TriggerFigures {
        self.0.read()
    }

    /// Reason why frames are not stamped by triggers; `None` while they are.
    #[must_use]
    pub fn trouble(&self) -> Option<String> {
        let figures = self.figures();
        (figures.without >= TROUBLE).then(|| {
            let instead = match figures.by_driver {
                0 => "by their driver less its usual delay",
                _ => "by their driver",
            };
            format!(
                "no triggers of the frames are known, which are stamped {instead}: does the microcontroller tell its triggers? \
                 (driver.imu.trigger_cameras)"
            )
        })
    }

    /// Shows these from now on; where somebody is reading at the moment, the next ones.
    pub(super) fn show(&self, figures: &TriggerFigures) {
        self.0.show(|| *figures);
    }
}
