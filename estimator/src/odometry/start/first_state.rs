//! From gathered frames to the first state of the window.

use super::Start;
use crate::geometry::{attitude_from_gravity, yaw_of};
use crate::inertial::Preintegration;
use crate::initial::{GatheredFrame, TILT_SIGMA_RAD, VELOCITY_SIGMA_M_S};
use crate::odometry::estimation::Estimation;
use crate::odometry::judge::Judge;
use crate::odometry::plausible::implausible;
use crate::odometry::vibrating;
use crate::window::prior::{AnchorSigmas, AnchorState};
use crate::window::state::{NavState, Rig};
use crate::window::tracks::MIN_WITNESSES;
use crate::window::{MAX_FRAMES, Window};
use nalgebra::{UnitQuaternion, Vector3};
use plumbline_config::{Portable, Timestamp};

/// Solver steps of a start: far from the solution, and only once.
const START_ITERATIONS: usize = 12;
/// Rounds of a start: image rates and outliers depend on the solution.
const START_ROUNDS: usize = 2;
/// Mean robust cost of an observation (in squared standard deviations) that a good start stays below:
/// noise alone gives about one.
pub(super) const MAX_MEAN_COST: f64 = 5.0;
/// The tilt of a start with two cameras is taken from samples that begin this long before the first frame, s: some
/// twenty of them, over which vibration averages out.
const LEVELLING_BEFORE_S: f64 = 0.1;
/// Prior of the odometry frame at a start: the newest frame is its origin. Position and yaw are free to choose, so that any
/// value will do which is small beside the motion; while the tilt still moves by degrees, a tight yaw would resist it through
/// the curvature of rotations.
const LOOSE_ORIGIN_M_RAD: f64 = 0.02;
/// Tight sigma of the origin once the solution is found, m and rad. Position and yaw of the first pose define `O` and have
/// no error: this is far below anything measured against them.
const TIGHT_ORIGIN_M_RAD: f64 = 1e-5;
/// Least standard deviations of what is taken over from the last estimate: of the tilt, rad, and of the biases, as a share of
/// those at switching on.
const LEAST_TILT_SIGMA_RAD: f64 = 2e-3;
const LEAST_BIAS_SHARE: f64 = 0.02;
/// Frames of a start with two cameras on a vehicle that vibrates, or before texture that repeats itself, 0.55 s at 20 Hz: fewer do not
/// tell its sway, nor false matches from true ones.
const HARD_START_FRAMES: usize = 12;
/// Frames of any other start with two cameras: more than two, so that outliers of one are found.
const STEREO_FRAMES: usize = 4;

impl Start {
    /// Tries to start from the frames gathered so far; whether there is a first state now.
    pub(super) fn try_start(
        &mut self,
        estimation: &mut Estimation,
        judge: &mut Judge,
        is_still: bool,
        time_offset_s: f64,
    ) -> bool {
        self.missing = None;
        let Some(newest) = self.gathering.frames().last() else { return false };
        let shared = shared_tracks(newest);
        let is_stereo = shared >= MIN_WITNESSES;
        if is_stereo && judge.delays_start(newest.time.stamp, shared, newest.tracks.len()) {
            return false;
        }
        if !is_stereo {
            return self.try_one_camera(estimation, time_offset_s);
        }
        let Some(count) = self.stereo_span(estimation) else { return false };
        let rig = estimation.window.rig.clone();
        let has_begun = self.start_stereo(estimation, count, is_still);
        if !has_begun {
            give_up(estimation, rig);
        }
        has_begun
    }

    /// Number of newest frames that a start with two cameras takes: so many that the wanted number of them, the oldest among them,
    /// have enough stereo tracks. A black frame does not count, since it says nothing of the velocity. `None` while there are
    /// too few.
    fn stereo_span(&self, estimation: &Estimation) -> Option<usize> {
        let is_hard = vibrating::is_vibrating(&estimation.vibration) || estimation.is_repeating;
        let wanted = if is_hard { HARD_START_FRAMES } else { STEREO_FRAMES };
        let newest_first = self.gathering.frames().iter().rev().enumerate();
        let (before, _) =
            newest_first.filter(|(_, frame)| shared_tracks(frame) >= MIN_WITNESSES).nth(wanted - 1)?;
        Some(before + 1).filter(|count| *count < MAX_FRAMES)
    }

    fn start_stereo(&mut self, estimation: &mut Estimation, count: usize, is_still: bool) -> bool {
        while self.gathering.frames().len() > count {
            self.gathering.drop(0);
        }
        let stamp = |k: usize| self.gathering.frames()[k].time.stamp;
        let (first, newest) = (stamp(0), stamp(count - 1));
        let Some((gyro, accel)) = estimation.imu.mean(first.plus_seconds(-LEVELLING_BEFORE_S), newest) else {
            return false;
        };
        let bias_gyro = if is_still { gyro } else { self.bias_memory.0 };
        let rot_o_b = self
            .carried_back_to(estimation, first, newest)
            .unwrap_or_else(|| attitude_from_gravity(&(accel - self.bias_memory.1)));
        let none = (Vector3::zeros(), Vector3::zeros());
        let mut nav = NavState { rot_o_b, bias_gyro, bias_accel: self.bias_memory.1, ..NavState::default() };
        estimation.window.clear();
        estimation.window.options.begin_with(estimation.window.options.cameras);
        for k in 0..count {
            let frame = &self.gathering.frames()[k];
            let motion = (k > 0).then(|| estimation.preintegrate([stamp(k - 1), stamp(k)], &none).0);
            if let Some(motion) = &motion {
                nav = nav.after(motion, &estimation.window.options.gravity_o);
            }
            put(estimation, frame, nav.clone(), motion, k == 0 || k + 1 == count);
            if k == 0 {
                // By the baseline alone: the poses of the other frames are only guessed as yet.
                estimation.window.triangulate(true);
            }
        }
        self.settle(estimation).is_some_and(|variance| variance < MAX_MEAN_COST)
    }

    /// The attitude at `first` that has been carried on to `newest` since the last pose.
    fn carried_back_to(
        &self,
        estimation: &Estimation,
        first: Timestamp,
        newest: Timestamp,
    ) -> Option<UnitQuaternion<f64>> {
        let origin = self.origin.as_ref().filter(|_| self.carried.is_some())?;
        let (motion, _) = estimation.preintegrate([first, newest], &self.bias_memory);
        Some(origin.rot_o_b * motion.delta_rot.inverse())
    }

    /// State of the newest gathered frame beside its position and yaw, with its standard deviations.
    fn known_at_start(&self) -> (AnchorState, AnchorSigmas) {
        let (bias_gyro, bias_accel) = self.bias_memory;
        let known = AnchorState { bias_gyro, bias_accel, up_b: None };
        let sigmas = AnchorSigmas {
            position_m: LOOSE_ORIGIN_M_RAD,
            yaw_rad: LOOSE_ORIGIN_M_RAD,
            tilt_rad: TILT_SIGMA_RAD,
            velocity_m_s: VELOCITY_SIGMA_M_S,
            bias_gyro_rad_s: self.imu.gyro_bias_sigma_rad_s,
            bias_accel_m_s2: self.imu.accel_bias_sigma_m_s2,
        };
        let (Some(carried), Some(origin)) = (&self.carried, &self.origin) else { return (known, sigmas) };
        let [tilt, gyro, accel] = carried.sigmas(&origin.rot_o_b);
        let known = AnchorState { up_b: Some(origin.rot_o_b.inverse() * Vector3::z()), ..known };
        let sigmas = AnchorSigmas {
            tilt_rad: tilt.at_least(LEAST_TILT_SIGMA_RAD).at_most(sigmas.tilt_rad),
            bias_gyro_rad_s: gyro
                .at_least(LEAST_BIAS_SHARE * sigmas.bias_gyro_rad_s)
                .at_most(sigmas.bias_gyro_rad_s),
            bias_accel_m_s2: accel
                .at_least(LEAST_BIAS_SHARE * sigmas.bias_accel_m_s2)
                .at_most(sigmas.bias_accel_m_s2),
            ..sigmas
        };
        (known, sigmas)
    }

    /// Solves the window from scratch, and puts the odometry frame at the newest frame. Returns the mean robust cost of an observation, in
    /// squared standard deviations; `None` where that is no state of a vehicle.
    pub(super) fn settle(&self, estimation: &mut Estimation) -> Option<f64> {
        if estimation.window.frames.is_empty() {
            return None;
        }
        let (known, loose) = self.known_at_start();
        let tight = AnchorSigmas { position_m: TIGHT_ORIGIN_M_RAD, yaw_rad: TIGHT_ORIGIN_M_RAD, ..loose };
        for _ in 0..START_ROUNDS {
            self.move_to_origin(&mut estimation.window);
            estimation.window.anchor_newest(&known, &loose);
            estimation.window.triangulate(true);
            let _ = estimation.window.optimize(START_ITERATIONS);
            estimation.window.remove_outliers();
            estimation.window.predict_rates_from(0);
        }
        self.move_to_origin(&mut estimation.window);
        estimation.window.anchor_newest(&known, &tight);
        let outcome = estimation.window.optimize(START_ITERATIONS);
        let is_state = !outcome.is_not_positive_definite
            && estimation.window.triangulated().0 >= MIN_WITNESSES
            && implausible(&estimation.window, &self.health).is_none();
        is_state.then(|| outcome.cost / estimation.window.observation_count())
    }

    /// Moves the window so that the newest frame has the position and the heading of the pose that the start goes on from;
    /// the origin and a yaw of zero, where there is none.
    fn move_to_origin(&self, window: &mut Window) {
        let Some(newest) = window.frames.last() else { return };
        match &self.origin {
            Some(origin) => {
                // The twist between the two attitudes: their tilts may differ, and do not count.
                let turn_rad = yaw_of(&(origin.rot_o_b * newest.nav.rot_o_b.inverse()));
                let p_o_b = origin.p_o_b;
                let yaw_rad = yaw_of(&newest.nav.rot_o_b) + turn_rad;
                window.move_newest_to(&p_o_b, yaw_rad);
            }
            None => window.move_newest_to(&Vector3::zeros(), 0.0),
        }
    }
}

/// Puts a gathered frame into the window at `nav`, where `motion` has led to from the one before.
pub(super) fn put(
    estimation: &mut Estimation,
    frame: &GatheredFrame,
    nav: NavState,
    motion: Option<Preintegration>,
    is_keyframe: bool,
) {
    let window = &mut estimation.window;
    window.push_frame(frame.time, nav, motion, false);
    window.set_gyro_of_newest(frame.gyro_b);
    window.observe(&frame.tracks, &[]);
    if is_keyframe {
        window.make_keyframe(&frame.tracks, &[]);
    }
}

/// Empties the window after a start that failed: nor is the calibration that led nowhere one to begin with.
pub(super) fn give_up(estimation: &mut Estimation, rig: Rig) {
    estimation.window.rig = rig;
    estimation.window.clear();
}

/// Number of tracks of a frame that both cameras see.
fn shared_tracks(frame: &GatheredFrame) -> usize {
    frame.tracks.iter().filter(|t| t.measured.iter().all(Option::is_some)).count()
}
