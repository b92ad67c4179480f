//! Ground truth: positions and velocities of the vehicle.

use super::FlightError;
use nalgebra::{Isometry3, Vector3};
use plumbline_config::Timestamp;
use plumbline_config::import::euroc_pose;
use plumbline_drivers::euroc::read_ground_truth;
use plumbline_drivers::{StampedPose, TruthState};
use plumbline_simulator::Simulator;
use std::path::Path;

/// Ground truth further from a stamp than this is none, ns.
const TOLERANCE_NS: i64 = 5_000_000;
/// Folder of the batch estimate in a data set of EuRoC.
const BATCH: &str = "state_groundtruth_estimate0";
/// Between states further apart than this nothing is interpolated, ns.
const MAX_GAP_NS: i64 = 20_000_000;
/// Rotations further apart than half a turn less this cannot be interpolated, rad.
const HALF_TURN_SLACK: f64 = 1e-6;

/// True state of the vehicle in the world `W`, whose z axis is vertical.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrueState {
    /// Time of the state.
    pub stamp: Timestamp,
    /// Pose of the body.
    pub pose_w_b: Isometry3<f64>,
    /// Velocity of the body, m/s; `None` where it was not measured.
    pub v_w_b: Option<Vector3<f64>>,
}

impl From<StampedPose> for TrueState {
    fn from(pose: StampedPose) -> Self {
        Self { stamp: pose.stamp, pose_w_b: pose.pose, v_w_b: None }
    }
}

/// Reads a table of the truth of a data set, as states of its body: the file `sensor.yaml` beside it says where on the body the
/// markers of a motion capture are.
///
/// # Errors
/// When either cannot be read.
pub fn read_truth(table: &Path) -> Result<Vec<TruthState>, FlightError> {
    let mut states = read_ground_truth(table)?;
    let sensor = table.with_file_name("sensor.yaml");
    // The batch estimate is one of the body.
    if !table.parent().is_some_and(|folder| folder.ends_with(BATCH))
        && sensor.is_file()
        && let Some(pose_b_s) = euroc_pose(&sensor)?
        && pose_b_s != Isometry3::identity()
    {
        let pose_s_b = pose_b_s.inverse();
        states.iter_mut().for_each(|state| state.pose_w_b *= pose_s_b);
    }
    Ok(states)
}

/// Ground truth of the vehicle's states.
pub enum Truth {
    /// Unknown.
    None,
    /// Measured.
    Recorded(Vec<TrueState>),
    /// Simulated: known at any time.
    Simulated(Simulator),
}

impl Truth {
    /// Measured poses without velocities, in any order.
    pub fn of_poses(poses: &[StampedPose]) -> Self {
        let mut states: Vec<TrueState> = poses.iter().copied().map(TrueState::from).collect();
        states.sort_by_key(|state| state.stamp);
        Self::Recorded(states)
    }

    /// Measured states; a table of nothing but zero velocities has none.
    pub fn of_states(states: &[TruthState]) -> Self {
        let has_velocity = states.iter().any(|state| state.v_w_b != Vector3::zeros());
        let state = |state: &TruthState| TrueState {
            stamp: state.stamp,
            pose_w_b: state.pose_w_b,
            v_w_b: has_velocity.then_some(state.v_w_b),
        };
        Self::Recorded(states.iter().map(state).collect())
    }

    /// The true pose measured nearest to `stamp`, if known.
    pub fn pose_at(&self, stamp: Timestamp) -> Option<Isometry3<f64>> {
        match self {
            Self::None => None,
            Self::Simulated(simulator) => Some(simulator.ground_truth(stamp).pose_w_b),
            Self::Recorded(states) => {
                let (before, after) = around(states, stamp);
                let near = [before, after].into_iter().flatten();
                near.min_by_key(|s| s.stamp.nanos_since(stamp).abs())
                    .filter(|s| s.stamp.nanos_since(stamp).abs() <= TOLERANCE_NS)
                    .map(|s| s.pose_w_b)
            }
        }
    }

    /// The true state at `stamp`, if known; between measured states that follow each other closely it is interpolated.
    pub fn state_at(&self, stamp: Timestamp) -> Option<TrueState> {
        match self {
            Self::None => None,
            Self::Simulated(simulator) => {
                let state = simulator.ground_truth(stamp);
                Some(TrueState { stamp, pose_w_b: state.pose_w_b, v_w_b: Some(state.v_w_b) })
            }
            Self::Recorded(states) => match around(states, stamp) {
                (_, Some(at)) if at.stamp == stamp => Some(*at),
                (Some(before), Some(after)) => interpolated(before, after, stamp),
                _ => None,
            },
        }
    }

    /// The true poses as they were measured, or at the `stamps` where they are known at any time; empty if unknown.
    pub fn poses(&self, stamps: impl IntoIterator<Item = Timestamp>) -> Vec<StampedPose> {
        match self {
            Self::None => Vec::new(),
            Self::Recorded(states) => {
                states.iter().map(|s| StampedPose { stamp: s.stamp, pose: s.pose_w_b }).collect()
            }
            Self::Simulated(_) => {
                let at = |stamp| Some(StampedPose { stamp, pose: self.pose_at(stamp)? });
                stamps.into_iter().filter_map(at).collect()
            }
        }
    }
}

/// The last state before `stamp`, and the first at it or after it.
fn around(states: &[TrueState], stamp: Timestamp) -> (Option<&TrueState>, Option<&TrueState>) {
    let after = states.partition_point(|s| s.stamp < stamp);
    (after.checked_sub(1).and_then(|k| states.get(k)), states.get(after))
}

fn interpolated(before: &TrueState, after: &TrueState, stamp: Timestamp) -> Option<TrueState> {
    let gap_ns = after.stamp.nanos_since(before.stamp);
    if gap_ns > MAX_GAP_NS {
        return None;
    }
    let share = stamp.nanos_since(before.stamp) as f64 / gap_ns as f64;
    let pose_w_b = before.pose_w_b.try_lerp_slerp(&after.pose_w_b, share, HALF_TURN_SLACK)?;
    let v_w_b = before.v_w_b.zip(after.v_w_b).map(|(a, b)| a + (b - a) * share);
    Some(TrueState { stamp, pose_w_b, v_w_b })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn state(ms: i64, x: f64, v: f64) -> TruthState {
        TruthState {
            stamp: Timestamp::from_nanos(ms * 1_000_000),
            pose_w_b: Isometry3::translation(x, 0.0, 0.0),
            v_w_b: Vector3::new(v, 0.0, 0.0),
            bias_gyro: Vector3::zeros(),
            bias_accel: Vector3::zeros(),
        }
    }

    #[test]
    fn states_are_interpolated_where_they_are_close() {
        let truth = Truth::of_states(&[state(0, 0.0, 1.0), state(10, 1.0, 2.0), state(100, 9.0, 2.0)]);
        let at = |us: i64| truth.state_at(Timestamp::from_nanos(us * 1000));
        let middle = at(2500).unwrap();
        assert!((middle.pose_w_b.translation.x - 0.25).abs() < 1e-12);
        assert!((middle.v_w_b.unwrap().x - 1.25).abs() < 1e-12);
        assert_eq!(at(10_000).unwrap().pose_w_b.translation.x, 1.0);
        assert!(at(50_000).is_none() && at(100_001).is_none() && at(-1).is_none());
    }

    #[test]
    fn poses_in_any_order_are_found() {
        let pose = |ms: i64| StampedPose {
            stamp: Timestamp::from_nanos(ms * 1_000_000),
            pose: Isometry3::translation(ms as f64, 0.0, 0.0),
        };
        let truth = Truth::of_poses(&[90, 30, 60, 0].map(pose));
        let found = [0, 30, 60, 90].map(|ms| truth.pose_at(pose(ms).stamp).map(|p| p.translation.x));
        assert_eq!(found, [0.0, 30.0, 60.0, 90.0].map(Some));
    }

    #[test]
    fn a_table_without_velocities_claims_none() {
        let truth = Truth::of_states(&[state(0, 0.0, 0.0), state(10, 1.0, 0.0)]);
        assert_eq!(truth.state_at(Timestamp::from_nanos(5_000_000)).unwrap().v_w_b, None);
    }
}
