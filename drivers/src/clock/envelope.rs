//! The lower hull of the last while: two hulls in alternation, so that what is old is forgotten and there is always one
//! that has seen enough.

use super::hull::{Hull, Line};

/// The older of the two hulls has seen between one and two of these, ns. Long enough that the slope is found to a
/// fraction of a millionth, short enough that a crystal that warms up is a straight line.
pub const SPAN_NS: i64 = 10_000_000_000;

/// Largest difference of rates that is believed: a microcontroller on its RC oscillator.
pub const MAX_SKEW: f64 = 0.02;

/// A lower envelope that forgets.
#[derive(Clone, Debug, Default)]
pub struct LowerEnvelope {
    old: Hull,
    young: Hull,
}

impl LowerEnvelope {
    /// Forgets everything.
    pub fn clear(&mut self) {
        self.old.clear();
        self.young.clear();
    }

    /// Takes a point; abscissae rise, ns. What lies before a silence of [`SPAN_NS`] is forgotten.
    pub fn push(&mut self, x: i64, y: i64) {
        if self.old.span().is_some_and(|(_, last)| x.saturating_sub(last) >= SPAN_NS) {
            self.clear();
        }
        self.old.push(x, y);
        let age_ns = self.age_ns();
        if age_ns >= SPAN_NS {
            self.young.push(x, y);
        }
        if age_ns >= 2 * SPAN_NS {
            std::mem::swap(&mut self.old, &mut self.young);
            self.young.clear();
            self.young.push(x, y);
        }
    }

    /// Span of the samples seen, ns.
    pub fn age_ns(&self) -> i64 {
        self.old.span().map_or(0, |(first, last)| last - first)
    }

    /// Points that it goes by.
    pub fn points(&self) -> u64 {
        self.old.points()
    }

    /// The line that the points lie above.
    pub fn line(&self) -> Option<Line> {
        self.old.line(MAX_SKEW)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_older_than_two_spans_is_forgotten_and_one_span_is_always_seen() {
        let mut envelope = LowerEnvelope::default();
        let step = SPAN_NS / 100;
        for k in 0..1000 {
            // A delay that was never as small again.
            let y = if k == 50 { -1_000_000 } else { 0 };
            envelope.push(k * step, y);
            assert!(envelope.age_ns() >= (k * step).min(SPAN_NS) && envelope.age_ns() <= 2 * SPAN_NS);
        }
        assert_eq!(envelope.line().unwrap().at(1000 * step), 0);
    }
}
