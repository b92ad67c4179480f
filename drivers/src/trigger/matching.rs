//! Matching of triggers and frames, and the time of a frame's exposure.
//!
//! Both are counted: triggers by the microcontroller, frames by the camera, what was lost included. So the difference of the
//! two numbers stays the same, however much the stamps of the camera's driver jitter. It is found by time: a driver's stamp
//! is late by readout and transfer, by less than three quarters of a period, and by the same to within half of one; frames in
//! a row that agree settle it. It is given up, and found again, when the camera was away, when the microcontroller was started
//! anew, and when stamps contradict it. Frames in doubt meanwhile are not stamped at all: a frame that is missing does no
//! harm, one that is stamped a period off does.

use crate::serial::TriggerEvent;
use std::collections::VecDeque;

/// Triggers that are remembered.
const REMEMBERED: usize = 64;
/// A trigger whose message is missing is told by those before it, up to so many further on.
const AHEAD: u64 = 8;
/// A jump of more than this is no loss, but a microcontroller that was started anew.
const MAX_LOST: u32 = 10_000;
/// Frames in a row that say how numbers belong together, and that no longer do.
const AGREEING: u32 = 4;
const CONTRADICTING: u32 = 3;
/// Stamps of a driver are later than the middle of the exposure by something about this, periods.
const FIRST_DELAY: f64 = 0.25;
/// And never earlier by more than this.
const EARLIEST: f64 = -0.3;
/// A frame's stamp is within this of its usual delay, periods.
const HALF: f64 = 0.5;
/// Without a frame for so long, ns and periods, the camera may have been away.
const AWAY_NS: i64 = 500_000_000;
const AWAY_PERIODS: f64 = 5.0;
/// The mean delay follows with this gain.
const GAIN: f64 = 1.0 / 16.0;

/// Time of a frame's exposure.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Matched {
    /// Middle by the trigger, ns.
    Trigger(i64),
    /// Middle predicted for a missing trigger message, ns.
    Predicted(i64),
    /// The driver's stamp less its usual delay, ns: no trigger is known.
    Delay(i64),
    /// Number and time contradict each other.
    Doubtful,
    /// Nothing is known yet.
    Unknown,
}

/// A trigger.
#[derive(Clone, Copy, Debug)]
struct Trigger {
    count: u64,
    edge_ns: i64,
    pulse_ns: u32,
}

/// Candidate for the pairing.
#[derive(Clone, Copy, Debug, Default)]
struct Candidate {
    base: i64,
    agreed: u32,
    /// Mean delay of the frames that agree, ns.
    delay_ns: f64,
}

/// Finds the triggers of frames.
#[derive(Debug)]
pub(crate) struct Matching {
    nominal_ns: f64,
    triggers: VecDeque<Trigger>,
    last_counter: u32,
    /// Number of the trigger less that of the frame.
    base: Option<i64>,
    candidate: Candidate,
    contradicted: u32,
    /// Driver's stamp less the middle of the exposure, ns; once known, for ever.
    delay_ns: Option<f64>,
    last_stamp_ns: Option<i64>,
    found: u64,
}

impl Matching {
    /// For cameras that are triggered with this period, ns.
    pub(crate) fn new(period_ns: f64) -> Self {
        Self {
            nominal_ns: period_ns,
            triggers: VecDeque::with_capacity(REMEMBERED),
            last_counter: 0,
            base: None,
            candidate: Candidate::default(),
            contradicted: 0,
            delay_ns: None,
            last_stamp_ns: None,
            found: 0,
        }
    }

    /// The driver's stamp less the middle of the exposure in the mean, ns, where it is known.
    pub(crate) fn delay_ns(&self) -> Option<f64> {
        self.delay_ns
    }

    /// Number of times the pairing of triggers and frames was established.
    pub(crate) fn found(&self) -> u64 {
        self.found
    }

    /// The cameras were triggered. To be told of each, in order.
    pub(crate) fn triggered(&mut self, event: &TriggerEvent) {
        if event.cameras & 0b11 == 0 {
            return;
        }
        let edge_ns = event.stamp.as_nanos();
        let count = match self.triggers.back() {
            None => u64::from(event.counter),
            Some(last) => {
                let step = event.counter.wrapping_sub(self.last_counter);
                if step == 0 {
                    return;
                }
                if step > MAX_LOST || edge_ns <= last.edge_ns {
                    self.triggers.clear();
                    self.forget();
                    u64::from(event.counter)
                } else {
                    last.count + u64::from(step)
                }
            }
        };
        self.last_counter = event.counter;
        if self.triggers.len() == REMEMBERED {
            self.triggers.pop_front();
        }
        self.triggers.push_back(Trigger { count, edge_ns, pulse_ns: event.pulse_ns });
    }

    /// Exposure of the frame with this number and this stamp of its driver, ns; `half_ns` is half of the exposure of a trigger
    /// with a pulse of so many ns.
    pub(crate) fn frame(&mut self, sequence: u64, stamp_ns: i64, half_ns: impl Fn(u32) -> i64) -> Matched {
        let away_ns = AWAY_NS.max((AWAY_PERIODS * self.nominal_ns) as i64);
        if self.last_stamp_ns.replace(stamp_ns).is_some_and(|last| stamp_ns.saturating_sub(last) > away_ns) {
            self.forget();
        }
        if let Some(base) = self.base {
            let by_number = sequence.checked_add_signed(base).and_then(|count| self.middle(count, &half_ns));
            match by_number {
                None => return self.by_delay(stamp_ns),
                Some(middle) => {
                    if let Some(matched) = self.checked(stamp_ns, middle) {
                        return matched;
                    }
                }
            }
        }
        self.search(sequence, stamp_ns, &half_ns);
        self.by_delay(stamp_ns)
    }

    /// Match by the numbers, unless the time contradicts them for good.
    fn checked(&mut self, stamp_ns: i64, middle: Matched) -> Option<Matched> {
        let (Matched::Trigger(middle_ns) | Matched::Predicted(middle_ns)) = middle else { return None };
        let found_ns = stamp_ns.saturating_sub(middle_ns) as f64;
        let delay_ns = self.delay_ns.unwrap_or(found_ns);
        let apart = (found_ns - delay_ns) / self.period_ns();
        if apart.abs() < HALF {
            self.contradicted = 0;
            let delay_ns = delay_ns + GAIN * (found_ns - delay_ns);
            self.delay_ns = Some(delay_ns);
            if delay_ns / self.period_ns() < EARLIEST {
                // No image is stamped before it was taken: these are the triggers of other frames.
                self.delay_ns = None;
                self.forget();
                return Some(Matched::Doubtful);
            }
            return Some(middle);
        }
        self.contradicted += 1;
        // A stamp may be late; earlier than ever it cannot be.
        if apart > 0.0 && self.contradicted < CONTRADICTING {
            return Some(Matched::Doubtful);
        }
        self.forget();
        None
    }

    /// Takes the trigger that is nearest in time for that of this frame.
    fn search(&mut self, sequence: u64, stamp_ns: i64, half_ns: &impl Fn(u32) -> i64) {
        let Some(newest) = self.triggers.back() else { return };
        let period_ns = self.period_ns();
        let usual_ns = match (self.delay_ns, self.candidate.agreed) {
            (Some(delay_ns), _) => delay_ns,
            (None, 0) => FIRST_DELAY * period_ns,
            (None, _) => self.candidate.delay_ns,
        };
        let newest_ns = newest.edge_ns.saturating_add(half_ns(newest.pulse_ns));
        let behind = ((stamp_ns.saturating_sub(newest_ns) as f64 - usual_ns) / period_ns).round() as i64;
        let nearest = newest.count.checked_add_signed(behind);
        let found = nearest.and_then(|count| Some((count, self.middle(count, half_ns)?)));
        let Some((count, Matched::Trigger(middle_ns) | Matched::Predicted(middle_ns))) = found else {
            return;
        };
        let (base, found_ns) = (count as i64 - sequence as i64, (stamp_ns - middle_ns) as f64);
        let candidate = &mut self.candidate;
        if candidate.agreed == 0 || candidate.base != base {
            *candidate = Candidate { base, agreed: 0, delay_ns: 0.0 };
        }
        candidate.agreed += 1;
        candidate.delay_ns += (found_ns - candidate.delay_ns) / f64::from(candidate.agreed);
        if candidate.agreed >= AGREEING {
            self.base = Some(base);
            self.delay_ns = self.delay_ns.or(Some(candidate.delay_ns));
            (self.contradicted, self.found) = (0, self.found + 1);
        }
    }

    fn by_delay(&self, stamp_ns: i64) -> Matched {
        let shifted = |delay_ns: f64| Matched::Delay(stamp_ns.saturating_sub(delay_ns.round() as i64));
        self.delay_ns.map_or(Matched::Unknown, shifted)
    }

    /// Discards the pairing of triggers and frames, to establish it again.
    fn forget(&mut self) {
        (self.base, self.contradicted, self.candidate) = (None, 0, Candidate::default());
    }

    /// The middle of the exposure of this trigger: its own message's, or by those around it or before it.
    fn middle(&self, count: u64, half_ns: &impl Fn(u32) -> i64) -> Option<Matched> {
        let after = self.triggers.partition_point(|trigger| trigger.count < count);
        let (earlier, later) = (after.checked_sub(1).map(|k| self.triggers[k]), self.triggers.get(after));
        let shifted = |edge_ns: i64, pulse_ns| edge_ns.saturating_add(half_ns(pulse_ns));
        match (earlier, later) {
            (_, Some(own)) if own.count == count => {
                Some(Matched::Trigger(shifted(own.edge_ns, own.pulse_ns)))
            }
            (Some(a), Some(b)) => {
                let share = (count - a.count) as f64 / (b.count - a.count) as f64;
                let since_ns = (share * (b.edge_ns - a.edge_ns) as f64).round() as i64;
                Some(Matched::Predicted(shifted(a.edge_ns + since_ns, a.pulse_ns)))
            }
            (Some(a), None) if count - a.count <= AHEAD => {
                let since_ns = ((count - a.count) as f64 * self.period_ns()).round() as i64;
                Some(Matched::Predicted(shifted(a.edge_ns + since_ns, a.pulse_ns)))
            }
            _ => None,
        }
    }

    /// The period of the triggers as they came, ns.
    fn period_ns(&self) -> f64 {
        match (self.triggers.front(), self.triggers.back()) {
            (Some(first), Some(last)) if last.count > first.count => {
                (last.edge_ns - first.edge_ns) as f64 / (last.count - first.count) as f64
            }
            _ => self.nominal_ns,
        }
    }
}

#[cfg(test)]
mod tests;
