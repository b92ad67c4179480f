//! Forces that set in suddenly, and that no image has confirmed yet.
//!
//! An accelerometer that fails between two frames spoils the velocity at once: a force of 3 m/s² that did not act makes it wrong by 0.15 m/s
//! within a twentieth of a second, and moves the prediction by 4 mm, which is what images are uncertain by. Vehicles change their
//! forces less suddenly. A change from frame to frame that is rare in this flight therefore makes the velocity uncertain along it, until the
//! images have had time to contradict it ([`super::force_watch`]); the estimate itself believes it meanwhile.

use super::SET_RIGHT_S;
use crate::inertial::Preintegration;
use nalgebra::{Matrix3, UnitQuaternion, Vector3};
use plumbline_config::{Portable, Timestamp};

/// Time constant of the mean square of changes, s, its beginning, and its least value, m²/s⁴.
const MEMORY_S: f64 = 2.0;
const FIRST_SQUARE: f64 = 1.0;
const LEAST_SQUARE: f64 = 0.04;
/// Changes over one frame and over two are sudden from these multiples of the root of that mean square. Recorded flights exceed the first in
/// 3 frames of 1000.
const SUDDEN: [f64; 2] = [3.0, 5.0];
/// Share of the change that the velocity may be wrong by, and the longest time that it has acted for by then, s.
const SIGMA_SHARE: f64 = 0.3;
const MOST_S: f64 = 0.1;

/// A change of the force.
#[derive(Clone, Copy, Debug)]
struct Change {
    /// m/s² in `O`.
    force_o: Vector3<f64>,
    /// Frame before it, and the last frame that showed it.
    since: Timestamp,
    last: Timestamp,
}

/// Watches the mean forces of frames for sudden changes.
#[derive(Clone, Debug)]
pub(super) struct SuddenForce {
    mean_square: f64,
    /// Mean forces of the last two frames, newest first, m/s² in `O`.
    forces_o: [Option<Vector3<f64>>; 2],
    change: Option<Change>,
}

impl SuddenForce {
    pub(super) fn new() -> Self {
        Self { mean_square: FIRST_SQUARE, forces_o: [None; 2], change: None }
    }

    /// Forgets the forces, as where their motion was not measured. What is usual stays.
    pub(super) fn forget_forces(&mut self) {
        self.forces_o = [None; 2];
    }

    /// Takes the `motion` from the frame of `from` with attitude `rot_o_before` to that of `to`.
    pub(super) fn update(
        &mut self,
        [from, to]: [Timestamp; 2],
        rot_o_before: &UnitQuaternion<f64>,
        motion: &Preintegration,
    ) {
        let force_o = rot_o_before * motion.delta_v / motion.dt_s;
        if !force_o.iter().all(|x| x.is_finite()) {
            return self.forget_forces();
        }
        let root = self.mean_square.sqrt();
        let changes = self.forces_o.map(|before| before.map(|before| force_o - before));
        let gated = changes.into_iter().zip(SUDDEN);
        let sudden = gated.filter_map(|(change, gate)| change.filter(|change| change.norm() > gate * root));
        let sudden = sudden.max_by(|a, b| a.norm_squared().total_cmp(&b.norm_squared()));
        if let Some(newest) = changes[0] {
            let share = (motion.dt_s / MEMORY_S).at_most(1.0);
            let squared = newest.norm_squared().at_most(SUDDEN[0].squared() * self.mean_square);
            self.mean_square =
                (self.mean_square + share * (squared - self.mean_square)).at_least(LEAST_SQUARE);
        }
        if let Some(force_o) = sudden {
            let begun = Change { force_o, since: from, last: to };
            let held = self.change.filter(|held| to.seconds_since(held.last) < SET_RIGHT_S).unwrap_or(begun);
            let largest = if held.force_o.norm() > force_o.norm() { held.force_o } else { force_o };
            self.change = Some(Change { force_o: largest, last: to, ..held });
        }
        self.forces_o = [Some(force_o), self.forces_o[0]];
    }

    /// Distance by which a change that is not confirmed at `stamp` has moved a prediction over the `dt_s` before if it did not act, m.
    pub(super) fn moved_m(&self, stamp: Timestamp, dt_s: f64) -> Option<f64> {
        let change = self.change.filter(|held| stamp.seconds_since(held.last) < SET_RIGHT_S)?;
        let acted_s = stamp.seconds_since(change.since);
        Some(change.force_o.norm() * dt_s * (acted_s - 0.5 * dt_s).at_least(0.5 * dt_s))
    }

    /// Covariance of the velocity at `stamp` by a force that is not confirmed yet, m²/s² in `O`.
    pub(super) fn of_velocity(&self, stamp: Timestamp) -> Option<Matrix3<f64>> {
        let change = self.change.filter(|held| stamp.seconds_since(held.last) < SET_RIGHT_S)?;
        let acted_s = stamp.seconds_since(change.since).at_most(MOST_S);
        let by_force = change.force_o * (SIGMA_SHARE * acted_s);
        Some(by_force * by_force.transpose())
    }
}

#[cfg(test)]
#[path = "sudden_force_tests.rs"]
mod tests;
