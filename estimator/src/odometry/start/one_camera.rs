//! The first state by one camera: the delay of its images first, then motion, gravity and scale.

use super::Start;
use super::first_state::{MAX_MEAN_COST, give_up, put};
use crate::exchange::believable_offset;
use crate::inertial::Preintegration;
use crate::inertial::buffer::IMU_MEMORY_S;
use crate::initial::timing::{
    ALIKE, DELAY, Known, PAIR_SPAN_S, READOUT, SEARCHED_S, Timing, TimingWorkspace, Unknowns,
};
use crate::initial::turns::Turns;
use crate::initial::{GATHERED_FRAMES, mono};
use crate::odometry::estimation::{Estimation, MAX_SCALE_SIGMA};
use crate::shutter::Readout;
use crate::window::MAX_FRAMES;
use crate::window::state::Rig;
use crate::window::tracks::MIN_WITNESSES;
use nalgebra::Vector3;
use plumbline_config::{Portable, Timestamp, ValidSetup};

/// Time of the frames that a start takes, s: over less, hardly any motion tells gravity from acceleration. Delay and readout are looked for
/// over half of it; over three times as much, what is old goes.
const SPAN_S: f64 = 1.5;
/// Standard deviations that are no noise: of a delay, readout or bias beside those that are told, and of the parallax of a pair of frames.
const CERTAIN_SIGMAS: f64 = 3.0;
/// Parallax by the way of a start, in standard deviations: depths are known to 3 % from there on.
const MIN_PARALLAX_SIGMAS: f64 = 50.0;
/// Longest readout that is looked for, s: a frame at 25 Hz.
const MAX_READOUT_S: f64 = 0.04;
/// Times of rows known worse than this are not known, s: half of an interval of the inertial samples at 100 Hz.
const UNCERTAIN_S: f64 = 0.005;
/// A start is on probation for so long, s.
const PROBATION_S: f64 = 2.0;

/// What a start with one camera still lacks.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum Missing {
    /// Time gathered, s.
    #[error("gathered {0:.1} of {SPAN_S:.1} s")]
    Time(f64),
    /// Points that are followed for [`PAIR_SPAN_S`].
    #[error("{0} points followed for a quarter of a second, too few: show more texture, or move more slowly")]
    Points(usize),
    /// Points in view whose depth is known.
    #[error(
        "{0} points in view with a known depth, {MIN_WITNESSES} are needed: move sideways, and turn more slowly"
    )]
    Depths(usize),
    /// Parallax beside that of the turn, of a pair of frames or of all, in standard deviations.
    #[error(
        "points moved by {0:.0} sigmas beside the turn, {MIN_PARALLAX_SIGMAS:.0} are needed: move sideways, and further"
    )]
    Way(f64),
    /// Time offset and readout that were found, s, with their standard deviations: what comes is stamped by them.
    #[error(
        "found `rig.time_offset_s` = {:.3} and `camera.0.readout_s` = {:.3}, one sigma {:.3} and {:.3}",
        .0[0], .0[1], .1[0], .1[1]
    )]
    Delay([f64; 2], [f64; 2]),
    /// Uncertainty of a delay or readout that differs from the one told, s: the camera hardly turns.
    #[error("the time offset is known to {:.0} ms only: turn the camera", 1e3 * .0)]
    Turn(f64),
    /// Uncertainty of the scale, as a share of it: hardly any acceleration.
    #[error("the scale is uncertain by {:.0} %: move faster, to and fro", 100.0 * .0)]
    Acceleration(f64),
    /// Variance of the residuals, in that of the sensors as they are told.
    #[error("images and inertial samples differ by {:.1} sigmas: check the calibration", .0.sqrt())]
    Consistency(f64),
}

/// Memory of a start with one camera, allocated once.
#[derive(Clone, Debug)]
pub(super) struct OneCamera {
    turns: Turns,
    timing: TimingWorkspace,
    /// Motions from the first frame to each.
    motions: Vec<Preintegration>,
    /// Time that was gathered at the last attempt, in steps of [`PAIR_SPAN_S`].
    attempt: usize,
    /// Frames have told the delay: to within [`UNCERTAIN_S`].
    is_delay_known: bool,
    /// When the present estimate began by one camera, and mean costs of its frames since then.
    begun: Option<Timestamp>,
    costs: (f64, f64),
}

impl OneCamera {
    pub(super) fn new(setup: &ValidSetup) -> Self {
        let points = &setup.estimator.points;
        let sigma_bearing = points.sigma_px / setup.left().focal_px[0];
        Self {
            turns: Turns::new((IMU_MEMORY_S * setup.imu.rate_hz) as usize),
            timing: TimingWorkspace::new(GATHERED_FRAMES, points.max_points, sigma_bearing),
            motions: Vec::with_capacity(GATHERED_FRAMES),
            attempt: 0,
            is_delay_known: false,
            begun: None,
            costs: (0.0, 0.0),
        }
    }

    /// Forgets the estimate, and what is known of delay and readout.
    pub(super) fn forget(&mut self) {
        (self.begun, self.is_delay_known) = (None, false);
    }
}

impl Start {
    /// Tries to start from the frames gathered so far, now and then; the newest was stamped by the offset `time_offset_s`.
    /// Returns whether the window has a first state now.
    pub(super) fn try_one_camera(&mut self, estimation: &mut Estimation, time_offset_s: f64) -> bool {
        let offset_s = estimation.window.rig.time_offset_s;
        self.gathering.retime(offset_s, |stamp| estimation.rate_at(stamp, stamp, &Vector3::zeros()));
        let span_s = self.gathering.span_s();
        let attempt = (span_s / PAIR_SPAN_S) as usize;
        // Samples have come up to the newest frame once it is stamped by the offset that was found.
        let is_due = std::mem::replace(&mut self.one_camera.attempt, attempt) != attempt;
        if !is_due || (offset_s - time_offset_s).abs() > UNCERTAIN_S {
            return false;
        }
        while self.gathering.span_s() > 3.0 * SPAN_S {
            self.gathering.drop(0);
        }
        let is_long = span_s >= 0.5 * SPAN_S;
        let tried =
            if is_long { self.start_one_camera(estimation, span_s) } else { Err(Missing::Time(span_s)) };
        self.missing = tried.err();
        self.missing.is_none()
    }

    fn start_one_camera(&mut self, estimation: &mut Estimation, span_s: f64) -> Result<(), Missing> {
        let timing = self.find_timing(estimation)?;
        self.apply_timing(estimation, &timing.found)?;
        if span_s < SPAN_S {
            return Err(Missing::Time(span_s));
        }
        if timing.parallax < CERTAIN_SIGMAS {
            return Err(Missing::Way(timing.parallax));
        }
        // The window has the last word on the bias as well: that of the images, or the one before them where it fits better for certain.
        let rig = estimation.window.rig.clone();
        let by_memory = self.settle_aligned(estimation, &rig, self.bias_memory.0);
        let observations = estimation.window.observation_count();
        let mut variance = self.settle_aligned(estimation, &rig, timing.bias_gyro);
        if (variance - by_memory) * observations / ALIKE > CERTAIN_SIGMAS.squared() {
            variance = self.settle_aligned(estimation, &rig, self.bias_memory.0);
        }
        let judged = self.judge_settled(estimation, variance);
        if judged.is_err() {
            give_up(estimation, rig);
        }
        if let Err(Missing::Consistency(_)) = judged {
            // It may be the delay that does not fit: it is searched anew.
            self.one_camera.is_delay_known = false;
        }
        let newest = self.gathering.frames().last().map(|frame| frame.time.stamp);
        (self.one_camera.begun, self.one_camera.costs) = (newest.filter(|_| judged.is_ok()), (0.0, 0.0));
        judged
    }

    /// Takes the mean robust cost of an observation in the frame of `stamp`, in squared standard deviations; returns whether the frames since a
    /// start with one camera refuse it: by the mean of their costs at the end of its probation, or before by a gyroscope that they contradict.
    pub(in crate::odometry) fn is_refused(
        &mut self,
        stamp: Timestamp,
        cost: f64,
        is_contradicted: bool,
    ) -> bool {
        let Some(begun) = self.one_camera.begun else { return false };
        let (sum, count) = &mut self.one_camera.costs;
        (*sum, *count) = (*sum + cost, *count + 1.0);
        let is_over = stamp.seconds_since(begun) > PROBATION_S;
        let is_refused = is_contradicted || is_over && *sum > MAX_MEAN_COST * *count;
        if is_over || is_refused {
            self.one_camera.begun = None;
        }
        is_refused
    }

    /// Delay of the images, by what they and the gyroscope say of the turn.
    fn find_timing(&mut self, estimation: &Estimation) -> Result<Timing, Missing> {
        let frames = self.gathering.frames();
        let tracks = frames.last().map_or(0, |newest| newest.tracks.len());
        let ([first, .., newest], true) = (frames, tracks >= MIN_WITNESSES) else {
            return Err(Missing::Points(tracks));
        };
        let OneCamera { turns, timing, is_delay_known, .. } = &mut self.one_camera;
        let rotations =
            [0, 1].map(|c| estimation.window.rig.pose_b_c(c).rotation.to_rotation_matrix().into_inner());
        let span = [(first, -2.0), (newest, 2.0)].map(|(f, k)| f.time.stamp.plus_seconds(k * SEARCHED_S));
        turns.integrate(&estimation.imu, span);
        timing.find_pairs(frames, &rotations, |c, xy| estimation.measurer.row(c, xy));
        let is_global = estimation.measurer.readouts.iter().all(Readout::is_global);
        let readout_s = if is_global { MAX_READOUT_S } else { f64::EPSILON };
        let delay_s = if *is_delay_known { UNCERTAIN_S } else { SEARCHED_S };
        let (bias, sigma) = (self.bias_memory.0, self.imu.gyro_bias_sigma_rad_s);
        let known = Known {
            values: Unknowns::new(bias.x, bias.y, bias.z, 0.0, 0.0),
            sigmas: Unknowns::new(sigma, sigma, sigma, delay_s, readout_s),
        };
        let common = timing.bearings.chunk_by(|a, b| a.stamps == b.stamps).last().map_or(0, <[_]>::len);
        timing.estimate(turns, &known).ok_or(Missing::Points(common))
    }

    /// Takes over delay and readout where the images contradict what is told of them. For a readout frames are gathered anew, but if those that
    /// there are would do for a start: their rows are not right.
    fn apply_timing(&mut self, estimation: &mut Estimation, found: &Known) -> Result<(), Missing> {
        let Known { values, sigmas } = *found;
        let Estimation { measurer, window, .. } = estimation;
        let is_found = |k: usize| values[k].abs() > CERTAIN_SIGMAS * sigmas[k];
        let is_late = is_found(DELAY) && self.time_offset_sigma_s > 0.0;
        let is_known = sigmas[DELAY] < UNCERTAIN_S;
        self.one_camera.is_delay_known |= is_known;
        if is_late {
            if !is_known {
                return Err(Missing::Turn(sigmas[DELAY]));
            }
            let offset_s = believable_offset(window.rig.time_offset_s + values[DELAY]);
            window.expect_time_offset(offset_s, sigmas[DELAY].at_least(self.time_offset_sigma_s));
        }
        // The last row is later than the middle one by half a readout.
        let rolls = is_found(READOUT) && values[READOUT] > 0.0 && 0.5 * sigmas[READOUT] < UNCERTAIN_S;
        if rolls {
            let readout_s = values[READOUT].at_most(MAX_READOUT_S);
            measurer.readouts.iter_mut().for_each(|readout| readout.readout_s = readout_s);
            window.options.is_rolling = true;
        }
        if rolls && self.gathering.span_s() < SPAN_S {
            self.gathering.clear();
        }
        match is_late || rolls {
            true => Err(Missing::Delay(
                [window.rig.time_offset_s, measurer.readouts[0].readout_s],
                [sigmas[DELAY], sigmas[READOUT]],
            )),
            false => Ok(()),
        }
    }

    /// Settles the window at what fits all frames, from this bias of the gyroscope on; mean robust cost of an observation.
    fn settle_aligned(&mut self, estimation: &mut Estimation, rig: &Rig, bias_gyro: Vector3<f64>) -> f64 {
        give_up(estimation, rig.clone());
        self.put_aligned(estimation, bias_gyro);
        self.settle(estimation).unwrap_or(f64::INFINITY)
    }

    /// Puts frames into the window where motion, gravity and scale have them that fit all at once. Where nothing fits, the window is empty.
    fn put_aligned(&mut self, estimation: &mut Estimation, bias_gyro: Vector3<f64>) {
        let (frames, biases) = (self.gathering.frames(), (bias_gyro, self.bias_memory.1));
        let OneCamera { timing, motions, .. } = &mut self.one_camera;
        motions.clear();
        for (k, frame) in frames.iter().enumerate() {
            let from = frames[k.saturating_sub(1)].time.stamp;
            let next = estimation.preintegrate([from, frame.time.stamp], &biases).0;
            motions.push(motions.last().map_or(next.clone(), |before| before.followed_by(&next)));
        }
        let rig = &estimation.window.rig;
        let poses = [rig.pose_b_c(0), rig.pose_b_c(1)];
        let gravity_o = estimation.window.options.gravity_o;
        let alignment = mono::Alignment {
            bearings: &timing.bearings,
            motions,
            pose_b_c: &poses,
            sigma_bearing: timing.sigma_bearing,
            sigma_m_s2: self.imu.accel_bias_sigma_m_s2,
            gravity_m_s2: gravity_o.norm(),
        };
        let Some(first) = alignment.solve() else { return };
        // Keyframes evenly over the whole span, the newest among them: as many as there is room for.
        let count = frames.len().min(MAX_FRAMES - 1);
        let chosen = |k: usize| k * (frames.len() - 1) / (count - 1);
        // Be it that a pair sees nothing in common: as long as this estimate lives, its scale is that of one camera.
        estimation.window.options.begin_with(1);
        for k in 0..count {
            let nav = first.after(&motions[chosen(k)], &gravity_o);
            let motion = k.checked_sub(1).map(|before| {
                let span = [chosen(before), chosen(k)].map(|k| frames[k].time.stamp);
                estimation.preintegrate(span, &nav.biases()).0
            });
            // Each carries the parallax of the start: none is dropped as merely recent.
            put(estimation, &frames[chosen(k)], nav, motion, true);
        }
    }

    /// Judges what the window has settled at, with this mean cost of an observation.
    fn judge_settled(&self, estimation: &mut Estimation, variance: f64) -> Result<(), Missing> {
        let landmarks = estimation.measurer.landmarks_in_view(&estimation.window.points);
        if landmarks < MIN_WITNESSES {
            return Err(Missing::Depths(landmarks));
        }
        if variance > MAX_MEAN_COST {
            return Err(Missing::Consistency(variance));
        }
        let (sigma, way_m) = estimation.window.scale_sigma().unwrap_or((f64::INFINITY, 0.0));
        let share = sigma * variance.at_least(1.0).sqrt();
        if share > MAX_SCALE_SIGMA {
            return Err(Missing::Acceleration(share));
        }
        let depth_m = estimation.measurer.median_depth_m(&estimation.window.points);
        let parallax = way_m / depth_m / self.one_camera.timing.sigma_bearing;
        if parallax < MIN_PARALLAX_SIGMAS { Err(Missing::Way(parallax)) } else { Ok(()) }
    }
}
