//! Inertial samples after a hole in their stream, which may be late.

use super::SUSPICIOUS_S;
use super::angles::{MAX_TURNS, Turn};
use crate::window::trial::CONTRADICTS_SIGMAS;
use heapless::Deque;
use nalgebra::Vector3;
use plumbline_config::{Portable, Timestamp};

/// Samples after a hole of this length are on probation, ns, while it is thought of at most.
const HOLE_NS: i64 = 40_000_000;
/// It ends once the gyroscope measures what the images show so much better than what they showed when samples that are late by the hole
/// would have been taken: by this logarithm of the ratio of likelihoods, of which a frame adds as much at most.
const PROVES: f64 = 10.0;
const MOST_OF_FRAME: f64 = 4.0;

/// Samples that are not believed before turns prove them.
#[derive(Clone, Copy, Debug)]
pub(super) struct Probation {
    /// Beginning of the hole, its length, ns, and when it is over at the latest.
    since: Timestamp,
    hole_ns: i64,
    until: Timestamp,
    /// True if it has been reported.
    is_known: bool,
    /// Logarithm of the likelihood of samples that are in time over that of late ones.
    proven: f64,
}

impl Probation {
    /// Probation after a hole of `hole_ns` since `since`, which the sample of `stamp` ends; `None` if it is short.
    pub(super) fn after_hole(since: Timestamp, hole_ns: i64, stamp: Timestamp) -> Option<Self> {
        let until = stamp.plus_seconds(SUSPICIOUS_S);
        (hole_ns > HOLE_NS).then_some(Self { since, hole_ns, until, is_known: false, proven: 0.0 })
    }

    /// Since when samples are on probation, if that is news.
    pub(super) fn begin(&mut self) -> Option<Timestamp> {
        (!std::mem::replace(&mut self.is_known, true)).then_some(self.since)
    }

    /// True once it has been reported.
    pub(super) fn has_begun(&self) -> bool {
        self.is_known
    }

    /// The probation after the newest of `turns`, which differs from the gyroscope by `difference`, rad, `excess` times what may; `None` where
    /// turns prove that samples are not late, and where it has lasted long enough.
    pub(super) fn after(
        mut self,
        turns: &Deque<Turn, MAX_TURNS>,
        difference: &Vector3<f64>,
        excess: f64,
    ) -> Option<Self> {
        let turn = turns.back()?;
        // The nearest to the hole.
        let half_ns = turn.to.nanos_since(turn.from) / 2;
        let is_late_turn = |t: &&Turn| turn.to.nanos_since(t.to) + half_ns >= self.hole_ns;
        if let Some(late) = turns.iter().rev().skip(1).find(is_late_turn)
            && excess > 0.0
        {
            let sigma_rad = difference.norm() / excess / CONTRADICTS_SIGMAS;
            let measured = turn.seen - difference;
            let of_late = (measured - late.seen * (turn.dt_s() / late.dt_s())).norm_squared();
            let gained = 0.5 * (of_late - difference.norm_squared()) / sigma_rad.squared();
            self.proven += gained.clamp(-MOST_OF_FRAME, MOST_OF_FRAME);
        }
        let is_over = self.proven >= PROVES || turn.to > self.until;
        (!is_over).then_some(self)
    }
}
