//! Consistency of a whole flight: the five figures of the estimates, and those of the odometry at the rate of the IMU.

use super::Consistency;
use super::errors::{Claim, since_start, step, tilt, velocity};
use plumbline_config::Timestamp;
use plumbline_estimator::odometry::StepCovariance;
use plumbline_flight::flight::{Published, PublishedState, TrueState, Truth};
use serde::Serialize;

/// Position and yaw are judged from this long after the start of their frame, s: at the start the error is zero by
/// definition, and the first poses differ from it by little more than rounding.
const SETTLED_S: f64 = 1.0;
/// Odometry belongs to the frame of a step if it is at most this far from it, s.
const NEAR_S: f64 = 0.02;

/// Consistency of a flight's outputs.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct FlightConsistency {
    /// Estimates, one a frame.
    pub estimates: Nees,
    /// Odometry at the rate of the IMU, of which every few samples are judged.
    pub odometry: Nees,
}

/// Figures of one output; `None` where the truth is unknown or nothing could be judged. [`super::errors`] has the
/// definitions.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Nees {
    /// Position since the start of the odometry frame.
    pub position: Option<Consistency>,
    /// Tilt.
    pub tilt: Option<Consistency>,
    /// Yaw since the start of the odometry frame.
    pub yaw: Option<Consistency>,
    /// Velocity in the body.
    pub velocity: Option<Consistency>,
    /// Way and turn about the vertical over about one second.
    pub steps: Option<Consistency>,
}

impl Nees {
    /// Names of the five figures of [`Self::ratios`].
    pub const NAMES: [&str; 5] = ["position", "tilt", "yaw", "velocity", "steps"];

    /// The five mean ratios, in the order of [`Self::NAMES`].
    pub fn ratios(&self) -> [Option<f64>; 5] {
        [self.position, self.tilt, self.yaw, self.velocity, self.steps]
            .map(|figure| figure.map(|figure| figure.mean_ratio))
    }
}

impl FlightConsistency {
    /// Judges estimates, and what else was published, by the truth; `None` where no truth is known.
    pub fn of(estimates: &[PublishedState], published: &Published, truth: &Truth) -> Option<Self> {
        let (estimates, odometry) = (known(estimates, truth), known(&published.odometry, truth));
        (!estimates.is_empty()).then(|| Self {
            estimates: judged(&estimates, &published.steps, 0.0),
            odometry: judged(&odometry, &published.steps, NEAR_S),
        })
    }
}

/// The poses whose truth is known, with it.
fn known(poses: &[PublishedState], truth: &Truth) -> Vec<(PublishedState, TrueState)> {
    poses.iter().filter_map(|pose| Some((pose.clone(), truth.state_at(pose.stamp)?))).collect()
}

fn judged(poses: &[(PublishedState, TrueState)], steps: &[StepCovariance], near_s: f64) -> Nees {
    let (mut position, mut yaw) = (Sum::<3>::default(), Sum::<1>::default());
    let (mut tilts, mut speeds) = (Sum::<2>::default(), Sum::<3>::default());
    // Each reset begins a new odometry frame.
    for frame in poses.chunk_by(|(a, _), (b, _)| a.reset_counter == b.reset_counter) {
        let Some((first, true_first)) = frame.first() else { continue };
        for (pose, truth) in frame {
            tilts.add(&tilt(pose, truth));
            velocity(pose, truth).iter().for_each(|claim| speeds.add(claim));
            if pose.stamp.seconds_since(first.stamp) >= SETTLED_S {
                let claim = since_start((first, true_first), (pose, truth));
                position.add(&part::<3>(&claim, 0));
                yaw.add(&part::<1>(&claim, 3));
            }
        }
    }
    Nees {
        position: position.figure(),
        tilt: tilts.figure(),
        yaw: yaw.figure(),
        velocity: speeds.figure(),
        steps: judged_steps(poses, steps, near_s).figure(),
    }
}

fn judged_steps(poses: &[(PublishedState, TrueState)], steps: &[StepCovariance], near_s: f64) -> Sum<4> {
    let mut sum = Sum::<4>::default();
    for known in steps {
        let ends = nearest(poses, known.from, near_s).zip(nearest(poses, known.to, near_s));
        let Some(((from, true_from), (to, true_to))) = ends else { continue };
        if from.reset_counter == to.reset_counter {
            sum.add(&step((from, true_from), (to, true_to), known));
        }
    }
    sum
}

/// The pose nearest to `stamp`, at most `within_s` from it.
fn nearest(
    poses: &[(PublishedState, TrueState)],
    stamp: Timestamp,
    within_s: f64,
) -> Option<&(PublishedState, TrueState)> {
    let after = poses.partition_point(|(pose, _)| pose.stamp < stamp);
    let near = [after.checked_sub(1), Some(after)].into_iter().flatten().filter_map(|k| poses.get(k));
    near.min_by_key(|(pose, _)| pose.stamp.nanos_since(stamp).abs())
        .filter(|(pose, _)| pose.stamp.seconds_since(stamp).abs() <= within_s)
}

/// The `N` components of a claim from `first` on.
fn part<const N: usize>(claim: &Claim<4>, first: usize) -> Claim<N> {
    Claim {
        error: claim.error.fixed_rows::<N>(first).into_owned(),
        covariance: claim.covariance.fixed_view::<N, N>(first, first).into_owned(),
    }
}

/// Sum of the NEES of errors of `N` components; those without a positive definite covariance are not in it.
#[derive(Default)]
struct Sum<const N: usize> {
    nees: f64,
    count: usize,
}

impl<const N: usize> Sum<N> {
    fn add(&mut self, claim: &Claim<N>) {
        if let Some(value) = claim.nees() {
            self.nees += value;
            self.count += 1;
        }
    }

    fn figure(&self) -> Option<Consistency> {
        let Self { nees, count } = *self;
        (count > 0).then(|| Consistency { mean_ratio: nees / (count * N) as f64, count })
    }
}
