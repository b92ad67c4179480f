//! When an estimate begins, and with what.
//!
//! Frames are gathered until they make a first state ([`first_state`]). A start anew goes on from the newest pose that can be right
//! ([`memory`]), as well known as that was ([`inherited`]), with its biases and calibration.

mod first_state;
mod inherited;
mod memory;
mod one_camera;
#[cfg(test)]
mod tests;

use super::estimation::Estimation;
use super::judge::{Judge, report_stuck};
use super::plausible::{ResetReason, implausible};
use crate::estimate::{HealthBits, NavCovariance};
use crate::initial::Gathering;
use crate::input::ResetKind;
use crate::window::state::{FrameTime, NavState};
use inherited::{Carried, Inherited};
use memory::Memory;
use nalgebra::Vector3;
pub use one_camera::Missing;
use one_camera::OneCamera;
use plumbline_config::options::{HealthConfig, ImuConfig};
use plumbline_config::{Timestamp, ValidSetup};

/// Frames before a start, and what is kept for the next one.
#[derive(Clone, Debug)]
pub(super) struct Start {
    imu: ImuConfig,
    time_offset_sigma_s: f64,
    health: HealthConfig,
    gathering: Gathering,
    one_camera: OneCamera,
    /// What an attempt with one camera lacked in the newest frame.
    pub(super) missing: Option<Missing>,
    /// Where the next start begins.
    origin: Option<NavState>,
    /// Biases of the gyroscope, rad/s, and of the accelerometer, m/s², to begin with.
    pub(super) bias_memory: (Vector3<f64>, Vector3<f64>),
    memory: Memory,
    /// Heritage of the present estimate from those before.
    pub(super) inherited: Inherited,
    /// Knowledge of the attitude of [`Self::origin`], which the gyroscope has turned on since the last pose; `None` where
    /// it has not measured all the way.
    carried: Option<Carried>,
    /// Why the estimate was last started anew.
    pub(super) reset_reason: Option<ResetReason>,
    /// Resets so far.
    pub(super) reset_counter: u32,
    /// Resets that were counted before this odometer began.
    pub(super) first_counter: u32,
}

impl Start {
    pub(super) fn new(setup: &ValidSetup) -> Self {
        let points = &setup.estimator.points;
        Self {
            imu: setup.imu.clone(),
            time_offset_sigma_s: setup.rig.time_offset_sigma_s,
            health: setup.estimator.health.clone(),
            gathering: Gathering::new(points.max_points),
            one_camera: OneCamera::new(setup),
            missing: None,
            origin: None,
            bias_memory: (Vector3::zeros(), Vector3::zeros()),
            memory: Memory::default(),
            inherited: Inherited::default(),
            carried: None,
            reset_reason: None,
            reset_counter: 0,
            first_counter: 0,
        }
    }

    /// Gathers the frame of `time`, which follows that of `last`; returns whether the window has a first state now. `is_still`: the
    /// vehicle stands still.
    pub(super) fn gather(
        &mut self,
        estimation: &mut Estimation,
        judge: &mut Judge,
        (last, time): (Option<FrameTime>, FrameTime),
        is_still: bool,
        health: &mut HealthBits,
    ) -> bool {
        let (stamp, last) = (time.stamp, last.map(|last| last.stamp));
        let none = (Vector3::zeros(), Vector3::zeros());
        if let Some((_, coverage)) = last.map(|last| estimation.preintegrate([last, stamp], &none)) {
            if coverage.has_gap {
                health.insert(HealthBits::IMU_GAP);
            }
            // A start needs gravity, and turns between its frames.
            if report_stuck(estimation.imu.stuck(), health)
                || coverage.unmeasured.is_any()
                || coverage.has_gap
            {
                self.gathering.clear();
            }
        }
        self.inherited.resume(stamp);
        self.carry_attitude(estimation, last, stamp);
        if let Some(camera) = judge.judge_gathered(estimation, health) {
            self.gathering.leave_out(camera);
        }
        let gyro_b = estimation.rate_b + self.bias_memory.0;
        self.gathering.push(time, estimation.measurer.points(), gyro_b);
        let has_begun = self.try_start(estimation, judge, is_still, time.time_offset_s);
        if has_begun {
            self.gathering.clear();
            self.inherit(estimation, stamp);
        }
        has_begun
    }

    /// Stamp of the frame before the newest that was gathered.
    pub(super) fn stamp_before_last(&self) -> Option<Timestamp> {
        let [.., before, _] = self.gathering.frames() else { return None };
        Some(before.time.stamp)
    }

    /// A start anew is no better known than the pose that it goes on from.
    fn inherit(&mut self, estimation: &Estimation, stamp: Timestamp) {
        let yaw_rad2 = self.carried.as_ref().zip(self.origin.as_ref()).map(|(c, o)| c.yaw_rad2(&o.rot_o_b));
        if let Some(frame) = estimation.window.frames.last() {
            self.inherited.begin(stamp, &frame.nav.p_o_b, yaw_rad2);
        }
    }

    /// Turns the pose that the next start goes on from by what the gyroscope measured from `last` to `stamp`, where nothing is missing
    /// of the way.
    fn carry_attitude(&mut self, estimation: &Estimation, last: Option<Timestamp>, stamp: Timestamp) {
        let (Some(last), Some(carried), Some(origin)) = (last, &mut self.carried, &mut self.origin) else {
            return;
        };
        let (motion, coverage) = estimation.preintegrate([last, stamp], &self.bias_memory);
        if coverage.has_gap || coverage.is_saturated || coverage.unmeasured.gyro {
            self.carried = None;
        } else {
            carried.0.grow(origin, &motion, &estimation.window.imu_noise);
            origin.rot_o_b *= motion.delta_rot;
        }
    }

    /// The newest state is believed: a start after a divergence may go on from it.
    pub(super) fn remember(&mut self, estimation: &Estimation, stamp: Timestamp) {
        if let Some(newest) = estimation.window.frames.last() {
            self.memory.remember(stamp, &newest.nav, &estimation.window.rig);
        }
    }

    /// The estimate is given up, its newest state known as the covariance `stated` says: keeps what the next start goes by.
    pub(super) fn prepare(&mut self, estimation: &mut Estimation, stated: NavCovariance, kind: ResetKind) {
        match (kind, estimation.window.frames.last()) {
            (ResetKind::Hard, _) => self.inherited = Inherited::default(),
            (ResetKind::Soft, Some(frame)) => {
                let turn_rad_s = estimation.rate_b.norm();
                self.inherited.leave(frame.stamp, &frame.nav, turn_rad_s, &stated)
            }
            (ResetKind::Soft, None) => {}
        }
        self.choose_origin(estimation, stated, kind);
        self.gathering.clear();
        self.one_camera.forget();
        self.reset_counter += 1;
    }

    /// Sets pose, biases and calibration of the start after a reset. Softly they are those of the newest state; of the last one that had
    /// proved itself where the newest cannot be right; of the last start where there is none. A hard reset forgets them.
    fn choose_origin(&mut self, estimation: &mut Estimation, stated: NavCovariance, kind: ResetKind) {
        let proven = self.memory.take();
        let window = &mut estimation.window;
        if kind == ResetKind::Hard {
            (self.origin, self.carried) = (None, None);
            self.bias_memory = (Vector3::zeros(), Vector3::zeros());
            window.restore_rig();
            return;
        }
        let Some(newest) = window.frames.last().map(|frame| frame.nav.clone()) else { return };
        let is_plausible = implausible(window, &self.health).is_none();
        self.carried = if is_plausible { Carried::of(stated, &estimation.bias_variances) } else { None };
        let nav = if is_plausible {
            window.keep_rig();
            newest
        } else if let Some(believed) = proven {
            window.rig = believed.rig;
            believed.nav
        } else {
            window.restore_rig();
            return;
        };
        self.go_on_from(Some(nav));
    }

    /// The next start goes on from this state, if there is one.
    pub(super) fn go_on_from(&mut self, origin: Option<NavState>) {
        if let Some(nav) = &origin {
            self.bias_memory = nav.biases();
        }
        self.origin = origin;
    }

    /// The attitude of the last pose tells nothing.
    pub(super) fn forget_attitude(&mut self) {
        self.carried = None;
    }

    /// Forgets all stamps: the gyroscope has not measured from the last pose on.
    pub(super) fn forget_time(&mut self) {
        self.carried = None;
        self.inherited.forget_time();
    }
}
