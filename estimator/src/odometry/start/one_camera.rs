//! The first state by one camera: the delay of its images first, then motion, gravity and scale.

use super::Start;
use super::first_state::{MAX_MEAN_COST, MIN_TRACKS, give_up};
use crate::exchange::believable_offset;
use crate::initial::timing::{Known, MAX_READOUT_S, Timing, TimingWorkspace};
use crate::initial::turns::Turns;
use crate::initial::{GatheredFrame, find_track, joined_motion, mono, stereo};
use crate::input::ResetKind;
use crate::odometry::estimation::Estimation;
use crate::window::state::NavState;
use crate::window::{PointTrack, Window};
use nalgebra::Vector3;
use plumbline_config::{Portable, Timestamp};
use std::fmt;

/// Scale known worse than this, relative to itself, is not known: a start waits.
const MAX_SCALE_SIGMA: f64 = 0.15;
/// Standard deviations beyond which the delay that is told contradicts the images.
const CONTRADICTS_SIGMAS: f64 = 5.0;
/// A delay known worse than this is not known, s: half of an interval of the inertial samples at 100 Hz.
const UNCERTAIN_S: f64 = 0.005;
/// Factor on standard deviations of what other frames have told: errors of tracks hang together.
const GROWTH: f64 = 3.0;
/// A start is on probation for so long, s, and refused by no less than so many frames.
const PROBATION_S: f64 = 2.0;
const REFUSING_FRAMES: f64 = 5.0;
/// Rounds of settling: the first outliers are those of a guess, and the next ones of a solution without those.
const SETTLING_ROUNDS: usize = 4;
/// Frames between attempts.
const RETRY_FRAMES: usize = 4;

/// What a start with one camera still lacks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Missing {
    /// Time gathered and needed, s.
    Time(f64, f64),
    /// Points in view, and how many are needed.
    Points(usize, usize),
    /// Parallax beside that of the turn, and how much is needed, px.
    Way(f64, f64),
    /// Uncertainty of the delay of the images, s: the camera hardly turns.
    Turn(f64),
    /// Time offset that was found, and readout beyond the configured one, s: what comes is stamped by them.
    Delay(f64, f64),
    /// Uncertainty of the scale, as a share of it: hardly any acceleration.
    Acceleration(f64),
    /// Variance of the residuals, in that of the sensors as they are told.
    Consistency(f64),
}

impl fmt::Display for Missing {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Time(s, needed_s) => write!(f, "gathered {s:.1} of {needed_s:.1} s"),
            Self::Points(count, needed) => {
                write!(f, "{count} points in view, {needed} needed: show more texture")
            }
            Self::Way(px, needed_px) => {
                write!(
                    f,
                    "moved the view by {px:.1} px beside the turn, {needed_px:.1} needed: move sideways"
                )
            }
            Self::Turn(sigma_s) => {
                write!(f, "the delay of the images is uncertain by {:.0} ms: turn the camera", 1e3 * sigma_s)
            }
            Self::Delay(offset_s, readout_s) => write!(
                f,
                "found a time offset of {:.0} ms and a readout of {:.0} ms more than configured: for `rig.time_offset_s` and \
                 `camera.0.readout_s`",
                1e3 * offset_s,
                1e3 * readout_s
            ),
            Self::Acceleration(share) => {
                write!(f, "the scale is uncertain by {:.0} %: move faster, to and fro", 100.0 * share)
            }
            Self::Consistency(ratio) => {
                write!(
                    f,
                    "images and inertial samples differ by {:.1} sigmas: check the calibration",
                    ratio.sqrt()
                )
            }
        }
    }
}

/// Memory of a start with one camera, allocated once.
#[derive(Clone, Debug)]
pub(super) struct OneCamera {
    turns: Turns,
    timing: TimingWorkspace,
    alignment: mono::AlignmentWorkspace,
    ways_px: Vec<f64>,
    wait: usize,
    /// What earlier frames have told of bias, delay and readout.
    known: Option<Known>,
    /// Standard deviations by which the delay that was told or found before contradicted the images: another one has to contradict more.
    evidence: f64,
    /// When the present estimate began by one camera, and mean costs of its frames since then.
    begun: Option<Timestamp>,
    costs: (f64, f64),
}

impl OneCamera {
    /// Room for `frames` of `points` each, and for so many inertial samples.
    pub(super) fn new(frames: usize, points: usize, samples: usize) -> Self {
        Self {
            turns: Turns::new(samples),
            timing: TimingWorkspace::new(frames, points),
            alignment: mono::AlignmentWorkspace::new(frames, points),
            ways_px: Vec::with_capacity(points),
            wait: 0,
            known: None,
            evidence: CONTRADICTS_SIGMAS,
            begun: None,
            costs: (0.0, 0.0),
        }
    }

    /// The estimate has ended; after a hard reset nothing is known of delay and readout.
    pub(super) fn end(&mut self, kind: ResetKind) {
        self.begun = None;
        if kind == ResetKind::Hard {
            self.forget();
        }
    }

    /// Forgets what frames have told of delay and readout.
    fn forget(&mut self) {
        (self.known, self.evidence) = (None, CONTRADICTS_SIGMAS);
    }
}

impl Start {
    /// Tries to start from the frames gathered so far, now and then; the newest was stamped by the offset `time_offset_s`. `None` where
    /// it was not tried.
    pub(super) fn try_one_camera(
        &mut self,
        estimation: &mut Estimation,
        time_offset_s: f64,
    ) -> Option<Result<(), Missing>> {
        self.one_camera.wait = self.one_camera.wait.saturating_sub(1);
        let (span_s, needed_s) = (self.gathering.span_s(), self.options.mono_window_s);
        if span_s < needed_s {
            return Some(Err(Missing::Time(span_s, needed_s)));
        }
        if self.one_camera.wait > 0 {
            return None;
        }
        self.one_camera.wait = RETRY_FRAMES;
        while self.gathering.span_s() > 2.0 * needed_s {
            self.gathering.drop_oldest();
        }
        Some(self.start_one_camera(estimation, time_offset_s))
    }

    fn start_one_camera(&mut self, estimation: &mut Estimation, time_offset_s: f64) -> Result<(), Missing> {
        let timing = self.find_timing(estimation)?;
        let is_new = self.apply_timing(estimation, &timing);
        let offset_s = estimation.window.rig.time_offset_s;
        if is_new || offset_s != time_offset_s {
            return Err(Missing::Delay(offset_s, estimation.measurer.found_readout_s()));
        }
        let integrated = |span| estimation.preintegrate(span, &(Vector3::zeros(), Vector3::zeros())).0;
        self.gathering.retime(offset_s, integrated);
        let way_px = self.way_px(estimation, &timing.bias_gyro);
        if way_px < self.options.mono_min_parallax_px {
            return Err(Missing::Way(way_px, self.options.mono_min_parallax_px));
        }
        let rig = estimation.window.rig.clone();
        let accepted = self.accept(estimation, &timing);
        if accepted.is_err() {
            give_up(estimation, rig);
        }
        if let (Err(Missing::Consistency(_)), true) = (accepted, timing.delay_s.1 > UNCERTAIN_S) {
            return Err(Missing::Turn(timing.delay_s.1));
        }
        match accepted {
            Ok(()) => {
                let newest = self.gathering.frames().last().map(|frame| frame.time.stamp);
                (self.one_camera.begun, self.one_camera.costs) = (newest, (0.0, 0.0));
            }
            Err(Missing::Consistency(_)) => {
                // The delay is searched anew.
                if let Some(known) = &mut self.one_camera.known {
                    known.delay_s = f64::INFINITY;
                }
            }
            Err(_) => {}
        }
        accepted
    }

    /// Takes the mean robust cost of an observation in the frame of `stamp`, in squared standard deviations; returns that of all frames since
    /// a start with one camera if they refuse it.
    pub(in crate::odometry) fn refused_by(&mut self, stamp: Timestamp, cost: f64) -> Option<f64> {
        let begun = self.one_camera.begun?;
        if stamp.seconds_since(begun) > PROBATION_S {
            self.one_camera.begun = None;
        }
        let (sum, count) = &mut self.one_camera.costs;
        (*sum, *count) = (*sum + cost, *count + 1.0);
        let refused = Some(*sum / *count).filter(|mean| *count >= REFUSING_FRAMES && *mean > MAX_MEAN_COST);
        if refused.is_some() {
            self.one_camera.forget();
        }
        refused
    }

    /// Takes over delay and readout where the images contradict what is told of them; returns whether they do.
    fn apply_timing(&mut self, estimation: &mut Estimation, timing: &Timing) -> bool {
        let is_late = timing.contradiction > self.one_camera.evidence && self.options.time_offset_s.1 > 0.0;
        if is_late {
            self.one_camera.evidence = timing.contradiction;
            let offset_s = estimation.window.rig.time_offset_s + timing.delay_s.0;
            let sigma_s = (GROWTH * timing.delay_s.1).at_least(self.options.time_offset_s.1);
            estimation.window.expect_time_offset(believable_offset(offset_s), sigma_s);
        }
        let readout =
            estimation.measurer.rolls_by(timing.readout_s.0, CONTRADICTS_SIGMAS * timing.readout_s.1);
        if let Some(step_s) = readout {
            self.gathering.unroll(step_s, &estimation.window.rig, &timing.bias_gyro, |c, xy| {
                estimation.measurer.row(c, xy)
            });
            estimation.window.options.is_rolling = true;
        }
        if timing.delay_s.1 < UNCERTAIN_S {
            let left_s = timing.readout_s.0 - readout.unwrap_or(0.0);
            self.one_camera.known = Some(Known {
                bias_gyro: (timing.bias_gyro, GROWTH * timing.bias_sigma),
                readout_s: (left_s, GROWTH * timing.readout_s.1),
                delay_s: GROWTH * timing.delay_s.1,
            });
        }
        is_late || readout.is_some()
    }

    /// Puts the frames into the window, and judges what they settle at.
    fn accept(&mut self, estimation: &mut Estimation, timing: &Timing) -> Result<(), Missing> {
        self.put_aligned(estimation, timing);
        let Some(variance) = self.settle(estimation, SETTLING_ROUNDS) else {
            let landmarks = estimation.window.triangulated().0;
            let is_few = landmarks < MIN_TRACKS;
            return Err(if is_few {
                Missing::Points(landmarks, MIN_TRACKS)
            } else {
                Missing::Consistency(f64::INFINITY)
            });
        };
        let share = scale_sigma(&mut estimation.window) * variance.at_least(1.0).sqrt();
        if variance > MAX_MEAN_COST {
            return Err(Missing::Consistency(variance));
        }
        if share > MAX_SCALE_SIGMA {
            return Err(Missing::Acceleration(share));
        }
        Ok(())
    }

    /// Delay of the images, by what they and the gyroscope say of the turn.
    fn find_timing(&mut self, estimation: &Estimation) -> Result<Timing, Missing> {
        let frames = self.gathering.frames();
        let tracks = frames.last().map_or(0, |newest| newest.tracks.len());
        let missing = Missing::Points(tracks, MIN_TRACKS);
        let (Some(first), true) = (frames.first(), tracks >= MIN_TRACKS) else { return Err(missing) };
        let OneCamera { turns, timing, known, .. } = &mut self.one_camera;
        let rig = &estimation.window.rig;
        let rotations = [0, 1].map(|c| rig.pose_b_c(c).rotation.to_rotation_matrix().into_inner());
        turns.integrate(&estimation.imu, first.time.stamp.plus_seconds(-1.0));
        let delay_s = |frame: &GatheredFrame| rig.time_offset_s - frame.time.time_offset_s;
        timing.find_pairs(frames, &rotations, |c, xy| estimation.measurer.row(c, xy), delay_s);
        let readout_s = if estimation.measurer.is_told_to_roll() { f64::EPSILON } else { MAX_READOUT_S };
        let known = (*known).unwrap_or(Known {
            bias_gyro: (self.bias_memory.0, self.options.bias_gyro_sigma),
            readout_s: (0.0, readout_s),
            delay_s: f64::INFINITY,
        });
        let sigma_bearing = self.options.sigma_px / self.options.focal_px;
        timing.estimate(turns, &known, sigma_bearing).ok_or(missing)
    }

    /// Displacement that [`MIN_TRACKS`] of the points of the newest frame exceed since each was first seen, rotation taken out by the
    /// gyroscope, px.
    fn way_px(&mut self, estimation: &Estimation, bias_gyro: &Vector3<f64>) -> f64 {
        let frames = self.gathering.frames();
        let Some(newest) = frames.last() else { return 0.0 };
        let rot_b_c = [0, 1].map(|camera| estimation.window.rig.pose_b_c(camera).rotation);
        let OneCamera { turns, ways_px, .. } = &mut self.one_camera;
        let way_px = |track: &PointTrack| {
            let (from, earlier) = frames.iter().find_map(|f| Some((f, find_track(f, track.track_id)?)))?;
            let (c, a, b) = (0..2).find_map(|c| Some((c, earlier.measured[c]?, track.measured[c]?)))?;
            let rot = turns.between([newest, from].map(|f| f.time.stamp), bias_gyro)?;
            let f_b = rot * (rot_b_c[c] * Vector3::new(a.xy.x, a.xy.y, 1.0));
            let q = rot_b_c[c].inverse_transform_vector(&f_b);
            Some((q.xy() / q.z - b.xy).norm() * self.options.focal_px)
        };
        ways_px.clear();
        ways_px.extend(newest.tracks.iter().filter_map(way_px));
        ways_px.sort_unstable_by(|a, b| b.total_cmp(a));
        ways_px.get(MIN_TRACKS - 1).copied().unwrap_or(0.0)
    }

    /// Puts frames into the window where motion, gravity and scale have them that fit all at once. Where nothing fits, the window is empty.
    fn put_aligned(&mut self, estimation: &mut Estimation, timing: &Timing) {
        estimation.window.clear();
        let rig = &estimation.window.rig;
        let poses = [rig.pose_b_c(0), rig.pose_b_c(1)];
        let frames = self.gathering.frames();
        let biases = (timing.bias_gyro, self.bias_memory.1);
        let gravity_o = estimation.window.options.gravity_o;
        let alignment = &mut self.one_camera.alignment;
        let sigma_m_s2 = self.options.bias_accel_sigma;
        let Some(aligned) = mono::align(frames, &poses, &biases, sigma_m_s2, gravity_o.norm(), alignment)
        else {
            return;
        };
        let rot_o_b0 = stereo::attitude_from_gravity(&-aligned.gravity_b0);
        let first = NavState {
            rot_o_b: rot_o_b0,
            v_o_b: rot_o_b0 * aligned.v_b0,
            bias_gyro: timing.bias_gyro,
            bias_accel: aligned.bias_accel,
            ..NavState::default()
        };
        // Keyframes evenly over the whole span, the newest among them.
        let options = &estimation.window.options;
        let count = (options.keyframes + options.recent_frames).min(frames.len());
        let last = frames.len() - 1;
        let chosen = move |k: usize| k * last / (count - 1);
        // Be it that a pair sees nothing in common: as long as this estimate lives, its scale is that of one camera.
        estimation.window.options.begin_with(1);
        for k in 0..count {
            let index = chosen(k);
            let frame = &frames[index];
            let nav = first.after(&self.one_camera.alignment.motions()[index], &gravity_o);
            let motion = if k == 0 { None } else { joined_motion(frames, chosen(k - 1), index) };
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
    }
}

/// Uncertainty of the scale of the settled window, as a share of it: of the longest way to its newest frame, along that. One camera has the
/// scale from changes of the velocity alone: at constant velocity any fits, with a bias to match, and the covariance shows that.
fn scale_sigma(window: &mut Window) -> f64 {
    let Some(newest) = window.frames.len().checked_sub(1) else { return f64::INFINITY };
    let way_o = |window: &Window, k: usize| window.frames[newest].nav.p_o_b - window.frames[k].nav.p_o_b;
    let farthest = (0..newest).max_by(|a, b| way_o(window, *a).norm().total_cmp(&way_o(window, *b).norm()));
    let Some(from) = farthest else { return f64::INFINITY };
    let Some(covariance) = window.relative_covariance(from, newest) else { return f64::INFINITY };
    let way_o = way_o(window, from);
    let along = way_o.dot(&(covariance.fixed_view::<3, 3>(0, 0) * way_o)).at_least(0.0).sqrt();
    along / way_o.norm_squared()
}
