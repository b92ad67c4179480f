//! From gathered frames to the first state of the window.

use super::Start;
use crate::geometry::yaw_of;
use crate::initial::gyro_bias::{self, joined_motion};
use crate::initial::{GatheredFrame, MonoWorkspace, find_track, mono, stereo};
use crate::odometry::estimation::Estimation;
use crate::odometry::judge::Judge;
use crate::odometry::plausible::implausible;
use crate::odometry::vibrating;
use crate::window::prior::{AnchorSigmas, AnchorState};
use crate::window::state::NavState;
use crate::window::{MAX_FRAMES, Window};
use nalgebra::{UnitQuaternion, Vector3};
use plumbline_config::{Portable, Timestamp};

/// Solver steps of a start: far from the solution, and only once.
const START_ITERATIONS: usize = 12;
/// Rounds of a start: image rates and outliers depend on the solution.
const START_ROUNDS: usize = 2;
/// Mean robust cost of an observation (in squared standard deviations) that a good start stays below:
/// noise alone gives about one.
const MAX_MEAN_COST: f64 = 5.0;
/// Fewest tracks seen by both cameras, or by one, that a start rests on.
const MIN_STEREO_TRACKS: usize = 12;
const MIN_MONO_TRACKS: usize = 25;
/// Linear residuals of a monocular start above this are no start, in standard deviations.
const MAX_LINEAR_RMS_SIGMAS: f64 = 6.0;
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
/// Tilt taken from the specific force, rad: a vehicle that accelerates by 5 m/s² leans by as much.
const TILT_SIGMA_RAD: f64 = 0.5;
/// Least standard deviations of what is taken over from the last estimate: of the tilt, rad, and of the biases, as a share of
/// those at switching on.
const LEAST_TILT_SIGMA_RAD: f64 = 2e-3;
const LEAST_BIAS_SHARE: f64 = 0.02;
/// Nothing is known of the velocity; vehicles are no faster than this, m/s.
const VELOCITY_SIGMA_M_S: f64 = 20.0;
/// Scale known worse than this, relative to itself, is not known: a start with one camera waits.
const MAX_SCALE_SIGMA: f64 = 0.15;
/// Frames of a start with two cameras on a vehicle that vibrates, or before texture that repeats itself, 0.55 s at 20 Hz: fewer do not
/// tell its sway, nor false matches from true ones.
const HARD_START_FRAMES: usize = 12;
/// Frames between attempts of a monocular start.
const MONO_RETRY_FRAMES: usize = 4;

impl Start {
    /// Tries to start from the frames gathered so far; whether there is a first state now.
    pub(super) fn try_start(
        &mut self,
        estimation: &mut Estimation,
        judge: &mut Judge,
        is_still: bool,
    ) -> bool {
        let Some(newest) = self.gathering.frames().last() else { return false };
        let shared = shared_tracks(newest);
        let is_stereo = shared >= MIN_STEREO_TRACKS;
        if is_stereo && judge.delays_start(newest.time.stamp, shared, newest.tracks.len()) {
            return false;
        }
        let rig = estimation.window.rig.clone();
        let started = if is_stereo {
            let Some(count) = self.stereo_span(estimation) else { return false };
            self.start_stereo(estimation, count, is_still)
        } else if self.is_mono_ready(estimation) {
            self.start_mono(estimation)
        } else {
            return false;
        };
        if !started {
            // Nor is the calibration that led nowhere one to begin with.
            estimation.window.rig = rig;
            estimation.window.clear();
        }
        started
    }

    /// Number of newest frames that a start with two cameras takes: so many that the wanted number of them, the oldest among them,
    /// have enough stereo tracks. A black frame does not count, since it says nothing of the velocity. `None` while there are
    /// too few.
    fn stereo_span(&self, estimation: &Estimation) -> Option<usize> {
        let is_hard = vibrating::is_vibrating(&estimation.vibration) || estimation.is_repeating;
        let least = if is_hard { HARD_START_FRAMES } else { 0 };
        let wanted = self.options.stereo_frames.max(least).min(MAX_FRAMES - 1);
        let newest_first = self.gathering.frames().iter().rev().enumerate();
        let (before, _) =
            newest_first.filter(|(_, frame)| shared_tracks(frame) >= MIN_STEREO_TRACKS).nth(wanted - 1)?;
        Some(before + 1).filter(|count| *count < MAX_FRAMES)
    }

    /// Enough time and parallax since the oldest gathered frame, and not tried just before.
    fn is_mono_ready(&mut self, estimation: &Estimation) -> bool {
        self.mono_wait = self.mono_wait.saturating_sub(1);
        let frames = self.gathering.frames();
        let (Some(first), Some(newest)) = (frames.first(), frames.last()) else { return false };
        if self.mono_wait > 0
            || self.gathering.span_s() < self.options.mono_window_s
            || newest.tracks.len() < MIN_MONO_TRACKS
        {
            return false;
        }
        let middle = &frames[frames.len() / 2];
        self.mono_wait = MONO_RETRY_FRAMES;
        self.parallax_px(estimation, middle, newest).at_least(self.parallax_px(estimation, first, newest))
            >= self.options.mono_min_parallax_px
    }

    /// Mean displacement of common points in units of pixels, rotation taken out by the gyroscope.
    fn parallax_px(&self, estimation: &Estimation, from: &GatheredFrame, to: &GatheredFrame) -> f64 {
        let span = [from.time.stamp, to.time.stamp];
        let (motion, _) = estimation.preintegrate(span, &self.bias_memory);
        let rot_b_c = [0, 1].map(|camera| estimation.window.rig.pose_b_c(camera).rotation);
        let rot_from_to = rot_b_c.map(|rot_b_c| rot_b_c.inverse() * motion.delta_rot * rot_b_c);
        let (mut sum, mut count) = (0.0, 0.0);
        for track in &to.tracks {
            let Some(before) = find_track(from, track.track_id) else { continue };
            let seen = [0, 1].into_iter().find_map(|c| Some((c, before.measured[c]?, track.measured[c]?)));
            if let Some((camera, a, b)) = seen {
                let q = rot_from_to[camera] * Vector3::new(b.xy.x, b.xy.y, 1.0);
                sum += (q.xy() / q.z - a.xy).norm();
                count += 1.0;
            }
        }
        if count < MIN_MONO_TRACKS as f64 { 0.0 } else { sum / count * self.options.focal_px }
    }

    fn start_stereo(&mut self, estimation: &mut Estimation, count: usize, is_still: bool) -> bool {
        while self.gathering.frames().len() > count {
            self.gathering.drop_oldest();
        }
        let stamp = |k: usize| self.gathering.frames()[k].time.stamp;
        let (first, newest) = (stamp(0), stamp(count - 1));
        let Some((gyro, accel)) = estimation.imu.mean(first.plus_seconds(-LEVELLING_BEFORE_S), newest) else {
            return false;
        };
        let bias_gyro = if is_still { gyro } else { self.bias_memory.0 };
        let rot_o_b = self
            .carried_back_to(estimation, first, newest)
            .unwrap_or_else(|| stereo::attitude_from_gravity(&(accel - self.bias_memory.1)));
        let mut nav = NavState { rot_o_b, bias_gyro, bias_accel: self.bias_memory.1, ..NavState::default() };
        estimation.window.clear();
        estimation.window.options.begin_with(estimation.window.options.cameras);
        for k in 0..count {
            let frame = &self.gathering.frames()[k];
            if let Some(motion) = &frame.motion {
                nav = nav.after(motion, &estimation.window.options.gravity_o);
            }
            estimation.window.push_frame(frame.time, nav.clone(), frame.motion.clone(), false);
            estimation.window.set_gyro_of_newest(frame.gyro_b);
            estimation.window.observe(&frame.tracks, &[]);
            if k == 0 || k + 1 == count {
                estimation.window.make_keyframe(&frame.tracks, &[]);
            }
            if k == 0 {
                // By the baseline alone: the poses of the other frames are only guessed as yet.
                estimation.window.triangulate(true);
            }
        }
        self.settle(estimation)
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
            bias_gyro_rad_s: self.options.bias_gyro_sigma,
            bias_accel_m_s2: self.options.bias_accel_sigma,
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

    fn start_mono(&mut self, estimation: &mut Estimation) -> bool {
        let rig = &estimation.window.rig;
        let poses = [rig.pose_b_c(0), rig.pose_b_c(1)];
        let rotations = poses.map(|p| p.rotation.to_rotation_matrix().into_inner());
        let frames = self.gathering.frames();
        let sigma_bearing = self.options.sigma_px / self.options.focal_px;
        let MonoWorkspace { gyro_bias: of_bias, alignment: of_alignment } = &mut self.mono_workspace;
        let known = (&self.bias_memory.0, self.options.bias_gyro_sigma);
        let Some(bias_gyro) = gyro_bias::estimate(frames, &rotations, known, sigma_bearing, of_bias) else {
            return false;
        };
        let biases = (bias_gyro, self.bias_memory.1);
        let gravity_m_s2 = estimation.window.options.gravity_o.norm();
        let Some(alignment) = mono::align(frames, &poses, &biases, gravity_m_s2, of_alignment) else {
            return false;
        };
        if alignment.rms_sigmas > MAX_LINEAR_RMS_SIGMAS {
            return false;
        }
        let rot_o_b0 = stereo::attitude_from_gravity(&-alignment.gravity_b0);
        let first = NavState {
            rot_o_b: rot_o_b0,
            v_o_b: rot_o_b0 * alignment.v_b0,
            bias_gyro,
            bias_accel: biases.1,
            ..NavState::default()
        };

        // Keyframes evenly over the whole span, the newest among them.
        let count =
            (estimation.window.options.keyframes + estimation.window.options.recent_frames).min(frames.len());
        let last = frames.len() - 1;
        let chosen = move |k: usize| k * last / (count - 1);
        estimation.window.clear();
        // Be it that a pair sees nothing in common: as long as this estimate lives, its scale is that of one camera.
        estimation.window.options.begin_with(1);
        for k in 0..count {
            let index = chosen(k);
            let frame = &self.gathering.frames()[index];
            let nav = first
                .after(&self.mono_workspace.alignment.motions()[index], &estimation.window.options.gravity_o);
            let motion =
                if k == 0 { None } else { joined_motion(self.gathering.frames(), chosen(k - 1), index) };
            estimation.window.push_frame(frame.time, nav, motion, false);
            estimation.window.set_gyro_of_newest(frame.gyro_b);
            estimation.window.observe(&frame.tracks, &[]);
            if k % 2 == 0 || k + 1 == count {
                estimation.window.make_keyframe(&frame.tracks, &[]);
            }
        }
        // Every chosen frame carries the parallax of the start: none is dropped as merely recent.
        for frame in &mut estimation.window.frames {
            frame.is_keyframe = true;
        }
        self.settle(estimation) && is_scale_known(&mut estimation.window)
    }

    /// Solves the window from scratch, puts the odometry frame at the newest frame, and judges.
    fn settle(&self, estimation: &mut Estimation) -> bool {
        let (known, loose) = self.known_at_start();
        let tight = AnchorSigmas { position_m: TIGHT_ORIGIN_M_RAD, yaw_rad: TIGHT_ORIGIN_M_RAD, ..loose };
        for _ in 0..START_ROUNDS {
            self.move_to_origin(&mut estimation.window);
            estimation.window.anchor_newest(&known, &loose);
            estimation.window.triangulate(true);
            let _ = estimation.window.optimize(START_ITERATIONS);
            estimation.window.remove_outliers();
            estimation.window.predict_all_rates();
        }
        self.move_to_origin(&mut estimation.window);
        estimation.window.anchor_newest(&known, &tight);
        let outcome = estimation.window.optimize(START_ITERATIONS);
        let observations = estimation.window.observation_count();
        !outcome.is_not_positive_definite
            && estimation.window.triangulated().0 >= MIN_STEREO_TRACKS
            && outcome.cost < MAX_MEAN_COST * observations as f64
            && implausible(&estimation.window, &self.options.health).is_none()
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

/// True if the settled window knows its scale. One camera has it from changes of the velocity alone: at constant velocity
/// any scale fits, with a bias to match, and the covariance shows that.
fn is_scale_known(window: &mut Window) -> bool {
    let Some(v_o_b) = window.frames.last().map(|frame| frame.nav.v_o_b) else { return false };
    let Some((covariance, _)) = window.newest_covariance() else { return false };
    let of_velocity = covariance.fixed_view::<3, 3>(NavState::V, NavState::V);
    let speed_m_s = v_o_b.norm();
    let along = v_o_b.dot(&(of_velocity * v_o_b)).at_least(0.0).sqrt();
    // `along` is the speed times its standard deviation.
    along <= MAX_SCALE_SIGMA * speed_m_s * speed_m_s
}

/// Number of tracks of a frame that both cameras see.
fn shared_tracks(frame: &GatheredFrame) -> usize {
    frame.tracks.iter().filter(|t| t.measured.iter().all(Option::is_some)).count()
}
