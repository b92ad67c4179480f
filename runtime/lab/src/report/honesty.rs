//! Honesty of a flight: whether the estimates that may be used were as good as they said.
//!
//! Position errors are against the truth, brought to the first pose by position and yaw, with the covariance as it is published;
//! velocity and tilt need no alignment. A reset changes nothing: what is published after it is still against the first pose.

use crate::evaluate::consistency::errors::{frame_of, tilt, velocity};
use nalgebra::{Isometry3, SMatrix, SVector};
use plumbline_estimator::HealthBits;
use plumbline_flight::flight::{FrameStatus, PublishedState, TrueState, Truth};
use plumbline_record::QUALITY_TO_USE;
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt;

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
pub struct HonestyFigures {
    /// Position.
    pub position: f64,
    /// Velocity in the body.
    pub velocity: f64,
    /// Tilt.
    pub tilt: f64,
}

impl HonestyFigures {
    fn take(&mut self, [position, velocity, tilt]: [f64; 3]) {
        self.position = self.position.max(position);
        self.velocity = self.velocity.max(velocity);
        self.tilt = self.tilt.max(tilt);
    }

    /// The largest of the three.
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
    pub worst_sigmas: HonestyFigures,
    /// Largest errors of the estimates that may be used: m, m/s, rad.
    pub worst_usable: HonestyFigures,
    /// Largest errors of all estimates: m, m/s, rad.
    pub worst: HonestyFigures,
    /// Jumps of the position that no reset counts.
    pub jumps: u64,
    /// When each health bit was up first, s after the first frame.
    pub first_s: BTreeMap<&'static str, f64>,
    /// When each health bit was up first since the first fault, s after its beginning; `None` without a fault.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub since_fault_s: Option<BTreeMap<&'static str, f64>>,
}

impl Honesty {
    /// Judges what was published by the truth, with a fault that begins `begin_s` after the first frame, if there is one; `None`
    /// without a pose whose truth is known.
    pub fn of(
        estimates: &[PublishedState],
        frames: &[FrameStatus],
        truth: &Truth,
        begin_s: Option<f64>,
    ) -> Option<Self> {
        let known = |pose: &PublishedState| truth.state_at(pose.stamp);
        let (first, first_truth) = estimates.iter().find_map(|pose| Some((pose, known(pose)?)))?;
        let pose_o_w = frame_of(&first.pose_o_b, &first_truth.pose_w_b);
        let usable = frames.iter().filter(|frame| frame.quality >= QUALITY_TO_USE).count();
        let usable = usable as f64 / frames.len().max(1) as f64;
        let since_fault_s = begin_s.map(|begin_s| first_s(frames, begin_s));
        let mut honesty = Self { usable, first_s: first_s(frames, 0.0), since_fault_s, ..Self::default() };
        for (pose, truth) in estimates.iter().filter_map(|pose| Some((pose, known(pose)?))) {
            let (errors, sigmas) = judged(pose, &truth, &(pose_o_w * truth.pose_w_b));
            honesty.worst.take(errors);
            if pose.quality >= QUALITY_TO_USE {
                honesty.worst_usable.take(errors);
                honesty.worst_sigmas.take(sigmas);
            }
        }
        let usable = |pair: &&[PublishedState]| pair[1].quality >= QUALITY_TO_USE;
        for pair in estimates.windows(2).filter(usable) {
            honesty.jumps += u64::from(jump_m(&pair[0], &pair[1]).is_some_and(|jump_m| jump_m > JUMP_M));
        }
        Some(honesty)
    }

    /// True if the estimates that may be used were as good as they said, and no jump was kept from the reader.
    pub fn is_honest(&self) -> bool {
        self.worst_sigmas.largest() <= MAX_SIGMAS && self.jumps == 0
    }
}

impl fmt::Display for Honesty {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let HonestyFigures { position, velocity, tilt } = self.worst_sigmas;
        write!(
            f,
            "{:.0} % of the frames usable, within {position:.1} sigma of position, {velocity:.1} of velocity, {tilt:.1} of tilt; \
             largest error {:.3} m, {} uncounted jumps",
            100.0 * self.usable,
            self.worst.position,
            self.jumps
        )?;
        self.since_fault_s.iter().flatten().try_for_each(|(name, s)| write!(f, "; {name} after {s:.2} s"))
    }
}

/// When each health bit was up first from `begin_s` after the first frame on, s after that.
fn first_s(frames: &[FrameStatus], begin_s: f64) -> BTreeMap<&'static str, f64> {
    let Some(first) = frames.first() else { return BTreeMap::new() };
    let time_s = |frame: &FrameStatus| frame.stamp.seconds_since(first.stamp) - begin_s;
    let since = |bit: HealthBits| {
        let frame = frames.iter().find(|frame| time_s(frame) >= 0.0 && frame.health.contains(bit))?;
        Some(time_s(frame))
    };
    HealthBits::NAMES.iter().filter_map(|(bit, name)| Some((*name, since(*bit)?))).collect()
}

/// Norms of the errors of position, velocity and tilt, and the largest of each along an axis in standard deviations.
fn judged(pose: &PublishedState, truth: &TrueState, true_o_b: &Isometry3<f64>) -> ([f64; 3], [f64; 3]) {
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

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{UnitQuaternion, Vector3};
    use plumbline_config::Timestamp;
    use plumbline_drivers::TruthState;
    use plumbline_estimator::estimate::NavCovariance;
    use plumbline_flight::flight::FrameStatus;

    fn stamp(k: i64) -> Timestamp {
        Timestamp::from_nanos(k * 50_000_000)
    }

    /// Ten seconds at 20 Hz, at rest, 1 cm, 1 crad and 1 cm/s sure; `change` makes the estimates wrong.
    fn honesty(change: impl Fn(i64, &mut PublishedState, &mut FrameStatus)) -> Honesty {
        let truth = |k| TruthState {
            stamp: stamp(k),
            pose_w_b: Isometry3::translation(3.0, 0.0, 1.0),
            // Not zero, or the table counts as one without velocities.
            v_w_b: Vector3::new(0.0, 0.0, 1e-9),
            bias_gyro: Vector3::zeros(),
            bias_accel: Vector3::zeros(),
        };
        let (mut estimates, mut frames) = (Vec::new(), Vec::new());
        for k in 0..200 {
            let mut state = PublishedState {
                stamp: stamp(k),
                pose_o_b: Isometry3::identity(),
                v_o_b: Vector3::zeros(),
                covariance: NavCovariance::identity() * 1e-4,
                quality: 90,
                ..PublishedState::default()
            };
            let mut frame = FrameStatus { stamp: stamp(k), quality: 90, health: HealthBits::default() };
            change(k, &mut state, &mut frame);
            state.quality = frame.quality;
            estimates.push(state);
            frames.push(frame);
        }
        let truth = Truth::of_states(&(0..200).map(truth).collect::<Vec<_>>());
        Honesty::of(&estimates, &frames, &truth, Some(5.0)).unwrap()
    }

    #[test]
    fn errors_count_along_axes_in_standard_deviations() {
        let honest = honesty(|k, state, _| {
            state.pose_o_b.translation.x = 2e-4 * k as f64;
            state.v_o_b = Vector3::new(0.0, 0.02, 0.02);
            if k > 100 {
                state.pose_o_b.rotation = UnitQuaternion::from_scaled_axis(Vector3::new(0.03, 0.0, 0.5));
            }
        });
        let HonestyFigures { position, velocity, tilt } = honest.worst_sigmas;
        assert!((position - 3.98).abs() < 1e-6 && (velocity - 2.0).abs() < 0.02, "{honest:?}");
        // Yaw is no part of the tilt; the third axis is not across the vertical.
        assert!((2.8..3.05).contains(&tilt) && honest.is_honest(), "{honest:?}");
        assert!((honest.worst.velocity - 0.02 * 2.0_f64.sqrt()).abs() < 1e-6);
        assert!(!honesty(|_, state, _| state.v_o_b.x = 0.06).is_honest());
    }

    #[test]
    fn small_errors_are_forgiven_and_unusable_estimates_are_not_judged() {
        let sure = |state: &mut PublishedState| state.covariance *= 1e-6;
        assert!(
            honesty(|_, state, _| {
                sure(state);
                state.v_o_b.x = 0.029
            })
            .is_honest()
        );
        assert!(
            !honesty(|_, state, _| {
                sure(state);
                state.v_o_b.x = 0.031
            })
            .is_honest()
        );
        let unusable = honesty(|k, state, frame| {
            if k >= 150 {
                (frame.quality, state.v_o_b.x) = (19, 3.0);
            }
        });
        assert!(unusable.is_honest() && unusable.usable == 0.75, "{unusable:?}");
        assert_eq!((unusable.worst.velocity, unusable.worst_usable.velocity < 1e-6), (3.0, true));
    }

    #[test]
    fn a_jump_counts_unless_the_velocity_or_a_reset_explains_it() {
        let moved = |state: &mut PublishedState| {
            state.covariance *= 1e6;
            state.pose_o_b.translation.y = 0.3;
        };
        let jumped = honesty(|k, state, _| {
            if k >= 100 {
                moved(state)
            }
        });
        assert!(jumped.jumps == 1 && !jumped.is_honest());
        let reset = honesty(|k, state, _| {
            if k >= 100 {
                moved(state);
                state.reset_counter = 1
            }
        });
        assert!(reset.jumps == 0 && reset.is_honest(), "{reset:?}");
        let fast = honesty(|k, state, _| {
            state.covariance *= 1e6;
            (state.v_o_b.y, state.pose_o_b.translation.y) = (6.0, 0.3 * k as f64);
        });
        assert_eq!(fast.jumps, 0);
    }

    #[test]
    fn bits_count_from_the_first_frame_and_from_the_fault() {
        let named = honesty(|k, _, frame| {
            let bit = if k < 20 { HealthBits::IMU_GAP } else { HealthBits::ACCEL_STUCK };
            if (10..20).contains(&k) || k >= 110 {
                frame.health.insert(bit);
            }
        });
        assert_eq!(named.first_s, [("IMU gap", 0.5), ("accelerometer stuck", 5.5)].into());
        assert_eq!(named.since_fault_s, Some([("accelerometer stuck", 0.5)].into()));
    }
}
