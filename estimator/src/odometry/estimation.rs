//! The running estimation: what the sensors have said, what is estimated from it, and how well that is known.
//!
//! [`super::start`] begins it, [`super::judge`] judges it, and [`super::Odometer`] carries it from frame to frame.

use super::measurements::Measurer;
use crate::estimate::{BiasVariances, NavCovariance};
use crate::geometry::{exp_so3, log_so3};
use crate::inertial::buffer::Coverage;
use crate::inertial::{ImuBuffer, Preintegration, Vibration};
use crate::origin::body_velocity_covariance;
use crate::points::prediction::WitnessedTurn;
use crate::window::Window;
use crate::window::feature::Feature;
use crate::window::landmark::{Landmark, LandmarkStore};
use crate::window::state::NavState;
use nalgebra::{SVector, UnitQuaternion, Vector3};
use plumbline_config::{Portable, Timestamp};

/// Samples whose mean is the angular rate of a frame reach back this far, s: two or three of them, against vibration.
const RATE_SPAN_S: f64 = 0.01;

/// Scale of one camera known worse than this, relative to itself, is not known: a start waits, and the quality is 0.
pub(super) const MAX_SCALE_SIGMA: f64 = 0.15;

/// Sensors, window, and what is known of the newest state.
#[derive(Clone, Debug)]
pub(super) struct Estimation {
    /// Inertial samples.
    pub(super) imu: ImuBuffer,
    /// The window.
    pub(super) window: Window,
    /// Points and lines of the newest frame.
    pub(super) measurer: Measurer,
    /// Angular rate at the newest frame, bias removed, rad/s.
    pub(super) rate_b: Vector3<f64>,
    /// Vibration at the newest frame.
    pub(super) vibration: Vibration,
    /// The texture in view repeats itself.
    pub(super) is_repeating: bool,
    /// With such texture: the turn of the newest frame since the one before by corners of their own.
    pub(super) turn: Option<WitnessedTurn>,
    /// Covariance of the newest state against the first pose of all.
    pub(super) covariance: NavCovariance,
    /// Variances of its biases.
    pub(super) bias_variances: BiasVariances,
    /// Standard deviation of the time offset, s.
    pub(super) time_offset_sigma_s: f64,
    /// Uncertainty of a scale by one camera, as a share of it, when it last moved; 0 with two.
    pub(super) scale_sigma: f64,
}

/// Rates of a state along which an error of its stamp moves it: angular rate in `B`, velocity and acceleration in `O`.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Rates {
    pub(super) rate_b: Vector3<f64>,
    pub(super) v_o: Vector3<f64>,
    accel_o: Vector3<f64>,
}

impl Rates {
    /// The state `dt_s` later.
    fn carried(&self, nav: &NavState, dt_s: f64) -> NavState {
        let rot_o_b = nav.rot_o_b * exp_so3(&(self.rate_b * dt_s));
        NavState {
            p_o_b: nav.p_o_b + self.v_o * dt_s,
            rot_o_b: UnitQuaternion::new_normalize(rot_o_b.into_inner()),
            v_o_b: nav.v_o_b + self.accel_o * dt_s,
            ..nav.clone()
        }
    }

    /// Derivative of position, attitude and velocity by time.
    pub(super) fn derivative(&self) -> SVector<f64, 9> {
        by_parts(&self.v_o, &self.rate_b, &self.accel_o)
    }
}

impl Estimation {
    /// Leaves the image of `camera` of the newest frame out, and what it told of the turn.
    pub(super) fn leave_out_image(&mut self, camera: usize) {
        self.measurer.leave_out(camera);
        self.window.forget_images(camera, self.window.frames.len().saturating_sub(1));
        self.turn = None;
    }

    /// The motion between two times, samples having these biases (gyroscope, accelerometer), and what was met on the way.
    pub(super) fn preintegrate(
        &self,
        [from, to]: [Timestamp; 2],
        (bias_gyro, bias_accel): &(Vector3<f64>, Vector3<f64>),
    ) -> (Preintegration, Coverage) {
        self.imu.preintegrate(from, to, bias_gyro, bias_accel, &self.window.imu_noise)
    }

    /// Angular rate of the body at `stamp`, bias removed, rad/s: by the newest samples, so that the image rates predicted
    /// by it, and with them the Jacobian of the time offset, are those of the frame and not of the interval before it.
    /// Where none was measured since the frame before, `last`, it is that of the turn between the last frames.
    pub(super) fn rate_at(
        &self,
        last: Timestamp,
        stamp: Timestamp,
        bias_gyro: &Vector3<f64>,
    ) -> Vector3<f64> {
        let newest = self.imu.mean_rate(stamp.plus_seconds(-RATE_SPAN_S), stamp);
        let gyro = newest.or_else(|| self.imu.mean_rate(last.plus_nanos(-1), stamp));
        gyro.map_or_else(|| self.turn_rate_b(), |gyro| gyro - bias_gyro)
    }

    /// Mean angular rate between the two newest frames, rad/s in `B`.
    pub(super) fn turn_rate_b(&self) -> Vector3<f64> {
        let [.., before, newest] = &self.window.frames[..] else { return Vector3::zeros() };
        let dt_s = newest.taken.seconds_since(before.taken);
        log_so3(&(before.nav.rot_o_b.inverse() * newest.nav.rot_o_b)) / dt_s
    }

    /// Rates of the newest frame in the state `nav`.
    pub(super) fn rates_of(&self, nav: &NavState) -> Rates {
        let Some(newest) = self.window.frames.last() else { return Rates::default() };
        let taken = newest.taken;
        let mean = self.imu.mean(taken.plus_seconds(-RATE_SPAN_S), taken.plus_seconds(RATE_SPAN_S));
        let gyro = mean.map_or(self.rate_b + nav.bias_gyro, |(gyro, _)| gyro);
        let accel_o = mean.map_or_else(Vector3::zeros, |(_, accel)| {
            nav.rot_o_b * (accel - nav.bias_accel) + self.window.options.gravity_o
        });
        Rates { rate_b: gyro - nav.bias_gyro, v_o: nav.v_o_b, accel_o }
    }

    /// The newest state at the stamp of its frame.
    pub(super) fn nav_at_stamp(&self) -> NavState {
        let Some(newest) = self.window.frames.last() else { return NavState::default() };
        if newest.taken == newest.stamp {
            return newest.nav.clone();
        }
        self.rates_of(&newest.nav).carried(&newest.nav, newest.stamp.seconds_since(newest.taken))
    }

    /// The motion from `from` at the angular rate `rate_b`, rad/s, whose ends are at times that are uncertain by `variance`, s², together: an
    /// error moves the vehicle along.
    pub(super) fn with_uncertain_ends(
        &self,
        mut motion: Preintegration,
        from: &NavState,
        rate_b: &Vector3<f64>,
        variance: f64,
    ) -> Preintegration {
        if variance > 0.0 {
            let v_b = from.rot_o_b.inverse_transform_vector(&from.v_o_b);
            let gain = motion.delta_v / motion.dt_s
                + from.rot_o_b.inverse_transform_vector(&self.window.options.gravity_o);
            let by_stamp = by_parts(&v_b, rate_b, &gain);
            motion.covariance += by_stamp * by_stamp.transpose() * variance;
            motion.ends_variance_s2 += variance;
        }
        motion
    }

    /// Integrates the motions of the window that end after `since` anew, as far as their samples are kept. Their ends are as uncertain as
    /// before, and at least by `variance`, s².
    pub(super) fn integrate_anew(&mut self, since: Timestamp, variance: f64) {
        for k in 1..self.window.frames.len() {
            let (before, frame) = (&self.window.frames[k - 1], &self.window.frames[k]);
            let Some(inertial) = &frame.inertial else { continue };
            if frame.stamp <= since || !self.imu.reaches_back_to(before.taken) {
                continue;
            }
            let variance = inertial.motion.ends_variance_s2.at_least(variance);
            let (motion, _) = self.preintegrate([before.taken, frame.taken], &before.nav.biases());
            let rate_b = log_so3(&motion.delta_rot) / motion.dt_s;
            let motion = self.with_uncertain_ends(motion, &before.nav, &rate_b, variance);
            self.window.replace_motion(k, motion);
        }
    }

    /// Standard deviation of roll and pitch of the newest state, rad: the larger variance is at most twice the mean that is
    /// taken. No yaw is in it.
    pub(super) fn tilt_sigma_rad(&self) -> f64 {
        let Some(frame) = self.window.frames.last() else { return f64::INFINITY };
        let up_b = frame.nav.rot_o_b.inverse() * Vector3::z();
        let of_attitude = self.covariance.fixed_view::<3, 3>(NavState::ROT, NavState::ROT);
        let of_tilt = of_attitude.trace() - up_b.dot(&(of_attitude * up_b));
        (0.5 * of_tilt).at_least(0.0).sqrt()
    }

    /// Largest standard deviation of the velocity along the axes of the body, m/s.
    pub(super) fn velocity_sigma_m_s(&self) -> f64 {
        let Some(nav) = self.window.frames.last().map(|frame| &frame.nav) else { return 0.0 };
        let covariance = body_velocity_covariance(&self.covariance, &nav.rot_o_b, &nav.v_o_b);
        (0..3).map(|k| covariance[(k, k)]).fold(0.0, |most, x: f64| x.at_least(most)).sqrt()
    }

    /// Largest standard deviations of the biases, rad/s and m/s².
    pub(super) fn bias_sigmas(&self) -> [f64; 2] {
        let largest = |first: usize| {
            (first..first + 3).map(|k| self.bias_variances[k]).fold(0.0, |most, x: f64| x.at_least(most))
        };
        [largest(0).sqrt(), largest(3).sqrt()]
    }

    /// Landmarks seen in the newest frame.
    pub(super) fn landmarks_in_view(&self) -> usize {
        let Some(newest) = self.window.frames.len().checked_sub(1) else { return 0 };
        in_view(&self.window.points, newest) + in_view(&self.window.lines, newest)
    }
}

/// A step of position, attitude and velocity, in the order of the error state.
fn by_parts(p: &Vector3<f64>, rot: &Vector3<f64>, v: &Vector3<f64>) -> SVector<f64, 9> {
    let mut step = SVector::<f64, 9>::zeros();
    for (at, part) in [(NavState::P, p), (NavState::ROT, rot), (NavState::V, v)] {
        step.fixed_rows_mut::<3>(at).copy_from(part);
    }
    step
}

/// Landmarks with a depth that a frame sees.
fn in_view<F: Feature>(store: &LandmarkStore<F>, frame: usize) -> usize {
    let is_seen =
        |l: &&Landmark<F>| l.is_triangulated && l.observations.iter().any(|o| usize::from(o.frame) == frame);
    store.all().iter().filter(is_seen).count()
}
