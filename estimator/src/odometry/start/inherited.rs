//! Uncertainty of the odometry frame after a restart.
//!
//! A soft reset goes on from the last pose. How well that was known against the first pose stays: the new window knows
//! where it is against its own start; the covariance that is given out is the sum. The way between the last
//! pose and the start anew was not measured at all.
//!
//! A start anew takes over position and yaw ([`crate::origin`]). The position is that of the last pose; yaw, tilt and biases are
//! carried on by the gyroscope, where it measured all the way. Of a vehicle in flight gravity alone would tell the tilt to some
//! degrees.

use crate::admission::MAX_HOLE_NS;
use crate::estimate::{BiasVariances, NavCovariance};
use crate::origin::OriginUncertainty;
use crate::window::growth::GrowingCovariance;
use crate::window::state::NavState;
use nalgebra::{Matrix4, SMatrix, UnitQuaternion, Vector3};
use plumbline_config::{Portable, Timestamp};

/// Agility assumed of a vehicle while nothing observes it: acceleration, m/s², and angular rate, rad/s.
const UNSEEN_ACCELERATION_M_S2: f64 = 2.0;
const UNSEEN_RATE_RAD_S: f64 = 0.5;
/// Factor on the standard deviations that a start anew takes over: an estimate was given up.
const DOUBT: f64 = 3.0;
/// Nothing is further off than this, m and rad: beyond it, it is unknown all the same.
const MOST_M: f64 = 1e3;
const MOST_RAD: f64 = std::f64::consts::PI;

/// The uncertainty of the last pose of all, when it was, and how fast it went.
#[derive(Clone, Debug)]
struct Last {
    /// `None` once the clock was set.
    stamp: Option<Timestamp>,
    covariance: Matrix4<f64>,
    speed_m_s: f64,
    rate_rad_s: f64,
}

/// Inheritance of estimates from those before the last reset.
#[derive(Clone, Debug, Default)]
pub(in crate::odometry) struct Inherited {
    last: Option<Last>,
    /// Uncertainty of the start anew against the first pose of all.
    pub(in crate::odometry) origin: OriginUncertainty,
}

impl Inherited {
    /// The estimate is given up at the state `nav` of `stamp`, which was known as `covariance` says, while the vehicle turned
    /// by `rate_rad_s`.
    pub(super) fn leave(
        &mut self,
        stamp: Timestamp,
        nav: &NavState,
        rate_rad_s: f64,
        covariance: &NavCovariance,
    ) {
        let mut by_state = SMatrix::<f64, 4, 9>::zeros();
        by_state.fixed_view_mut::<3, 3>(0, NavState::P).fill_with_identity();
        let up_b = nav.rot_o_b.inverse() * Vector3::z();
        by_state.fixed_view_mut::<1, 3>(3, NavState::ROT).copy_from(&up_b.transpose());
        let of_pose = by_state * covariance * by_state.transpose();
        let velocity_sigma =
            covariance.fixed_view::<3, 3>(NavState::V, NavState::V).trace().at_least(0.0).sqrt();
        let speed_m_s = nav.v_o_b.norm() + velocity_sigma;
        let is_sound = of_pose.iter().all(|x| x.is_finite()) && speed_m_s.is_finite();
        self.last = Some(match is_sound {
            true => Last { stamp: Some(stamp), covariance: of_pose, speed_m_s, rate_rad_s },
            false => Last { stamp: Some(stamp), covariance: unknown(), speed_m_s: 0.0, rate_rad_s: 0.0 },
        });
        self.origin = OriginUncertainty::default();
    }

    /// Forgets when the last pose was: the clock was set.
    pub(super) fn forget_time(&mut self) {
        if let Some(last) = &mut self.last {
            last.stamp = None;
        }
    }

    /// Takes the first frame since the clock was set: the last pose is older than its `stamp` by the longest hole that a stream may have.
    pub(super) fn resume(&mut self, stamp: Timestamp) {
        if let Some(last) = &mut self.last {
            last.stamp.get_or_insert(stamp.plus_nanos(-MAX_HOLE_NS));
        }
    }

    /// The start anew is at `p_o_b`, at `stamp`; its yaw has the variance `yaw_rad2`, rad², if the gyroscope has measured all turns since
    /// the last pose.
    pub(super) fn begin(&mut self, stamp: Timestamp, p_o_b: &Vector3<f64>, yaw_rad2: Option<f64>) {
        let Some(last) = &self.last else { return };
        let dt = last.stamp.map_or(0.0, |last| stamp.seconds_since(last).at_least(0.0));
        let way_m = (last.speed_m_s * dt + 0.5 * UNSEEN_ACCELERATION_M_S2 * dt * dt).at_most(MOST_M);
        let turn_rad = ((last.rate_rad_s + UNSEEN_RATE_RAD_S) * dt).at_most(MOST_RAD);
        let mut covariance = last.covariance;
        for k in 0..3 {
            covariance[(k, k)] += way_m * way_m;
        }
        let unseen_rad2 = covariance[(3, 3)] + turn_rad * turn_rad;
        covariance[(3, 3)] = yaw_rad2.map_or(unseen_rad2, |known| known.at_least(covariance[(3, 3)]));
        self.origin = OriginUncertainty { covariance, p_o_b: *p_o_b };
    }

    /// `covariance` of the state `nav` against the start anew, made that against the first pose of all.
    pub(in crate::odometry) fn added_to(&self, covariance: NavCovariance, nav: &NavState) -> NavCovariance {
        match self.origin.share(&nav.p_o_b, &nav.rot_o_b, &nav.v_o_b) {
            Some(share) => covariance + share,
            None => covariance,
        }
    }

    /// Covariance of position and yaw that the state `nav` has by the start anew.
    pub(in crate::odometry) fn of_pose(&self, nav: &NavState) -> Matrix4<f64> {
        let mut carried = Matrix4::identity();
        carried.fixed_view_mut::<3, 1>(0, 3).copy_from(&Vector3::z().cross(&(nav.p_o_b - self.origin.p_o_b)));
        carried * self.origin.covariance * carried.transpose()
    }
}

/// Uncertainty of a state that the inertial sensor carries on to a start anew: of the tilt and of the biases.
#[derive(Clone, Debug)]
pub(super) struct Carried(pub(super) GrowingCovariance);

impl Carried {
    /// Knowledge of a state of these covariances; `None` where that is no covariance.
    pub(super) fn of(covariance: NavCovariance, bias_variances: &BiasVariances) -> Option<Self> {
        let grown = GrowingCovariance::new(covariance, bias_variances);
        grown.is_finite().then_some(Self(grown))
    }

    /// Variance of the yaw at the attitude `rot_o_b`, rad².
    pub(super) fn yaw_rad2(&self, rot_o_b: &UnitQuaternion<f64>) -> f64 {
        let up_b = rot_o_b.inverse() * Vector3::z();
        up_b.dot(&(self.0.nav.fixed_view::<3, 3>(NavState::ROT, NavState::ROT) * up_b))
    }

    /// Standard deviations to begin with at the attitude `rot_o_b`: of the tilt, rad, of the biases, rad/s and m/s². What the
    /// last estimate knew of them counts [`DOUBT`] times.
    pub(super) fn sigmas(&self, rot_o_b: &UnitQuaternion<f64>) -> [f64; 3] {
        let all = self.0.of_all();
        let of_attitude = all.fixed_view::<3, 3>(NavState::ROT, NavState::ROT);
        let of_tilt = of_attitude.trace() - self.yaw_rad2(rot_o_b);
        let largest = |first: usize| (0..3).map(|k| all[(first + k, first + k)]).fold(0.0, f64::at_least);
        [of_tilt, largest(NavState::BIAS_GYRO), largest(NavState::BIAS_ACCEL)]
            .map(|variance| DOUBT * variance.at_least(0.0).sqrt())
    }
}

fn unknown() -> Matrix4<f64> {
    let m2 = MOST_M * MOST_M;
    Matrix4::from_diagonal(&nalgebra::Vector4::new(m2, m2, m2, MOST_RAD * MOST_RAD))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::exp_so3;

    fn at(nanos: i64) -> Timestamp {
        Timestamp::from_nanos(nanos)
    }

    fn state() -> NavState {
        let rot_o_b = exp_so3(&Vector3::new(0.3, -0.2, 0.9));
        NavState {
            p_o_b: Vector3::new(3.0, 1.0, 2.0),
            rot_o_b,
            v_o_b: Vector3::new(1.0, 0.0, 0.0),
            ..NavState::default()
        }
    }

    #[test]
    fn a_start_from_the_origin_inherits_nothing() {
        let covariance = NavCovariance::identity() * 1e-6;
        let mut inherited = Inherited::default();
        inherited.begin(at(0), &Vector3::zeros(), None);
        assert_eq!(inherited.added_to(covariance, &state()), covariance);
    }

    #[test]
    fn a_start_anew_is_no_better_known_than_the_pose_before_it() {
        let nav = state();
        let before = NavCovariance::identity() * 0.04;
        let mut inherited = Inherited::default();
        inherited.leave(at(0), &nav, 0.0, &before);
        inherited.begin(at(0), &nav.p_o_b, None);
        let after = inherited.added_to(NavCovariance::identity() * 1e-6, &nav);
        for k in 0..3 {
            assert!((after[(k, k)] - 0.04).abs() < 1e-4, "{k}");
        }
        let up_b = nav.rot_o_b.inverse() * Vector3::z();
        let yaw = (up_b.transpose() * after.fixed_view::<3, 3>(3, 3) * up_b)[0];
        assert!((yaw - 0.04).abs() < 1e-4);
        // Ten metres on, the yaw of the origin weighs.
        let far = NavState { p_o_b: nav.p_o_b + Vector3::new(10.0, 0.0, 0.0), ..nav.clone() };
        assert!(inherited.added_to(NavCovariance::zeros(), &far)[(1, 1)] > 4.0);
        assert!(after.cholesky().is_some());
    }

    #[test]
    fn the_way_in_between_was_not_measured() {
        let nav = state();
        let mut inherited = Inherited::default();
        inherited.leave(at(0), &nav, 1.5, &(NavCovariance::identity() * 1e-6));
        inherited.begin(at(2_000_000_000), &nav.p_o_b, None);
        let sigma_m = inherited.added_to(NavCovariance::zeros(), &nav)[(0, 0)].sqrt();
        assert!((5.9..6.2).contains(&sigma_m), "2 s at 1 m/s, and 2 m/s² on top: {sigma_m}");
        let of_turn =
            inherited.added_to(NavCovariance::zeros(), &nav).fixed_view::<3, 3>(3, 3).trace().sqrt();
        assert!((of_turn - std::f64::consts::PI).abs() < 1e-6, "two turns of 2 rad: any heading");
    }

    #[test]
    fn a_clock_that_was_set_leaves_the_longest_hole_of_a_stream_unseen() {
        for set_to_ns in [-3_600_000_000_000, 3_600_000_000_000] {
            let mut inherited = Inherited::default();
            inherited.leave(at(0), &state(), 1.0, &(NavCovariance::identity() * 1e-6));
            inherited.forget_time();
            inherited.resume(at(set_to_ns));
            inherited.resume(at(set_to_ns + 50_000_000));
            inherited.begin(at(set_to_ns + 100_000_000), &state().p_o_b, None);
            let sigma_m = inherited.added_to(NavCovariance::zeros(), &state())[(0, 0)].sqrt();
            assert!((0.9..1.0).contains(&sigma_m), "0.6 s at 1 m/s: {sigma_m}");
        }
    }

    #[test]
    fn what_was_no_covariance_is_as_good_as_unknown() {
        let mut inherited = Inherited::default();
        inherited.leave(at(0), &state(), 0.0, &NavCovariance::from_element(f64::NAN));
        inherited.begin(at(0), &Vector3::zeros(), None);
        let after = inherited.added_to(NavCovariance::zeros(), &state());
        assert!(after.iter().all(|x| x.is_finite()) && after[(0, 0)] > 1e5);
    }
}
