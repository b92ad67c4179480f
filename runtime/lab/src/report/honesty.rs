//! Honesty of a flight: whether the estimates that may be used were as good as they said.
//!
//! Position errors are against the truth, brought to the first pose by position and yaw, with the covariance as it is published;
//! velocity and tilt need no alignment. A reset changes nothing: what is published after it is still against the first pose.

use crate::evaluate::consistency::errors::{frame_of, tilt, velocity};
use nalgebra::{SMatrix, SVector};
use plumbline_estimator::HealthBits;
use plumbline_flight::flight::{Published, PublishedState, TrueState, Truth};
use serde::Serialize;
use std::collections::BTreeMap;

/// Estimates of this quality and better may be used.
pub const QUALITY_TO_USE: i8 = 20;
/// Largest error of an estimate that may be used, in standard deviations.
pub const MAX_SIGMAS: f64 = 5.0;
/// Errors that nobody minds, whatever the covariance says: position, m, velocity, m/s, and tilt, rad.
pub const FLOORS: [f64; 3] = [0.02, 0.03, 0.006];
/// A position that moves by this much more than the velocity explains has jumped, m.
const JUMP_M: f64 = 0.1;
/// Frames further apart than this do not follow each other, s.
const FRAME_GAP_S: f64 = 0.15;

/// Figures of position, velocity in the body, and tilt.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Figures {
    /// Position.
    pub position: f64,
    /// Velocity in the body.
    pub velocity: f64,
    /// Tilt.
    pub tilt: f64,
}

impl Figures {
    fn take(&mut self, [position, velocity, tilt]: [f64; 3]) {
        self.position = self.position.max(position);
        self.velocity = self.velocity.max(velocity);
        self.tilt = self.tilt.max(tilt);
    }

    /// The largest of the three.
    #[must_use]
    pub fn largest(&self) -> f64 {
        self.position.max(self.velocity).max(self.tilt)
    }
}

/// Honesty of a flight.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Honesty {
    /// Share of the frames whose estimate may be used.
    pub usable: f64,
    /// Largest errors along an axis of the estimates that may be used, in standard deviations; an error of a fifth of its floor
    /// (2 cm, 3 cm/s, 6 mrad) counts as one at least.
    pub worst_sigmas: Figures,
    /// Largest errors of the estimates that may be used: m, m/s, rad.
    pub worst_usable: Figures,
    /// Largest errors of all estimates: m, m/s, rad.
    pub worst: Figures,
    /// Jumps of the position that no reset counts.
    pub jumps: u64,
    /// The largest of them, m.
    pub largest_jump_m: f64,
    /// When each health bit was up first, s after the first frame.
    pub first_s: BTreeMap<&'static str, f64>,
}

impl Honesty {
    /// Judges what was published by the truth; `None` without a pose whose truth is known.
    #[must_use]
    pub fn of(published: &Published, truth: &Truth) -> Option<Self> {
        let known = |pose: &PublishedState| truth.state_at(pose.stamp);
        let (first, first_truth) = published.estimates.iter().find_map(|pose| Some((pose, known(pose)?)))?;
        let pose_o_w = frame_of(&first.pose_o_b, &first_truth.pose_w_b);
        let usable = published.frames.iter().filter(|frame| frame.quality >= QUALITY_TO_USE).count();
        let usable = usable as f64 / published.frames.len().max(1) as f64;
        let mut honesty = Self { usable, first_s: first_s(published), ..Self::default() };
        for (pose, truth) in published.estimates.iter().filter_map(|pose| Some((pose, known(pose)?))) {
            let (errors, sigmas) = judged(pose, &truth, &(pose_o_w * truth.pose_w_b));
            honesty.worst.take(errors);
            if pose.quality >= QUALITY_TO_USE {
                honesty.worst_usable.take(errors);
                honesty.worst_sigmas.take(sigmas);
            }
        }
        for pair in published.estimates.windows(2) {
            if let Some(jump_m) = jump_m(&pair[0], &pair[1]).filter(|jump_m| *jump_m > JUMP_M) {
                honesty.jumps += 1;
                honesty.largest_jump_m = honesty.largest_jump_m.max(jump_m);
            }
        }
        Some(honesty)
    }

    /// Whether the estimates that may be used were as good as they said, and no jump was kept from the reader.
    #[must_use]
    pub fn is_honest(&self) -> bool {
        self.worst_sigmas.largest() <= MAX_SIGMAS && self.jumps == 0
    }
}

/// When each health bit was up first, s after the first frame.
fn first_s(published: &Published) -> BTreeMap<&'static str, f64> {
    let Some(first) = published.frames.first() else { return BTreeMap::new() };
    let since = |bit: HealthBits| {
        let frame = published.frames.iter().find(|frame| frame.health.contains(bit))?;
        Some(frame.stamp.seconds_since(first.stamp))
    };
    HealthBits::NAMES.iter().filter_map(|(bit, name)| Some((*name, since(*bit)?))).collect()
}

/// Norms of the errors of position, velocity and tilt, and the largest of each along an axis in standard deviations.
fn judged(
    pose: &PublishedState,
    truth: &TrueState,
    true_o_b: &nalgebra::Isometry3<f64>,
) -> ([f64; 3], [f64; 3]) {
    let position = true_o_b.translation.vector - pose.pose_o_b.translation.vector;
    let covariance = pose.covariance.fixed_view::<3, 3>(0, 0).into_owned();
    let (tilt, velocity) = (tilt(pose, truth), velocity(pose, truth));
    let of_velocity =
        velocity.map_or((0.0, 0.0), |v| (v.error.norm(), sigmas(&v.error, &v.covariance, FLOORS[1])));
    let errors = [position.norm(), of_velocity.0, tilt.error.norm()];
    let of_tilt = sigmas(&tilt.error, &tilt.covariance, FLOORS[2]);
    (errors, [sigmas(&position, &covariance, FLOORS[0]), of_velocity.1, of_tilt])
}

/// Largest component of `error` in standard deviations, each at least a fifth of `floor`.
fn sigmas<const N: usize>(error: &SVector<f64, N>, covariance: &SMatrix<f64, N, N>, floor: f64) -> f64 {
    let sigma = |k: usize| covariance[(k, k)].max(0.0).sqrt().max(floor / MAX_SIGMAS);
    (0..N).map(|k| error[k].abs() / sigma(k)).fold(0.0, f64::max)
}

/// By how much the position moved that the velocity does not explain, between frames that follow each other without a reset.
fn jump_m(from: &PublishedState, to: &PublishedState) -> Option<f64> {
    let step_s = to.stamp.seconds_since(from.stamp);
    if from.reset_counter != to.reset_counter || step_s > FRAME_GAP_S {
        return None;
    }
    let moved = to.pose_o_b.translation.vector - from.pose_o_b.translation.vector;
    Some((moved - (from.v_o_b + to.v_o_b) * (0.5 * step_s)).norm())
}
