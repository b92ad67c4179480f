//! The front-end: images in, tracked points and lines out.
//!
//! Feedback of the window comes by [`crate::exchange`], by rule one frame late.

mod images;

use crate::admission::{ImuDoor, StampGate, StampVerdict};
use crate::estimate::{FrameFigures, HealthBits, StageProbe};
use crate::exchange::{Feedback, KnownState, Tracked, believable_offset, max_samples};
use crate::geometry::exp_so3;
use crate::image::frozen::FrozenWatch;
use crate::inertial::buffer::IMU_MEMORY_S;
use crate::inertial::{ImuBuffer, ImuNoise, Preintegration};
use crate::input::{FrameInput, ImuAdmission, ResetKind};
use crate::lines::LineTracker;
use crate::places::images::FrameImages;
use crate::points::prediction::{KnownPoint, PredictedMotion};
use crate::points::{PointTracker, TrackerInput};
use crate::shutter::{Readout, RowTurns, readouts};
use crate::window::state::FrameTime;
use crate::work_budget::{Fork, WorkBudget};
use nalgebra::{UnitQuaternion, Vector3};
use plumbline_config::options::image_sizes;
use plumbline_config::{ImuSample, Portable, Timestamp, ValidSetup};

/// Tracks points and lines through the images of the rig. Everything is allocated at construction.
pub struct FrontEnd {
    points: PointTracker,
    lines: Option<LineTracker>,
    door: ImuDoor,
    stamps: StampGate,
    imu: ImuBuffer,
    noise: ImuNoise,
    arrived: Vec<ImuSample>,
    cameras: usize,
    readouts: [Readout; 2],
    rot_b_c: [UnitQuaternion<f64>; 2],
    sizes_px: [(usize, usize); 2],
    max_points: usize,
    last_stamp: Option<Timestamp>,
    next_sequence: u64,
    time_offset_s: f64,
    bias_gyro: Vector3<f64>,
    turn_rate_b: Vector3<f64>,
    distrusts_imu: bool,
    untracked_camera: Option<usize>,
    frozen: FrozenWatch,
    reset_counter: u32,
    asked_reset: Option<ResetKind>,
    had_lines: bool,
    /// Sequence numbers of the last two frames, and what the tracker of points calls them.
    tracked: [(u64, u64); 2],
    gravity_o: Vector3<f64>,
    known_state: Option<KnownState>,
    known_points: Vec<KnownPoint>,
    /// Motion between the last two frames, if it was measured throughout.
    last_motion: Option<Leg>,
}

/// Measured motion from one frame to the next.
#[derive(Clone, Debug)]
struct Leg {
    from: Timestamp,
    to: Timestamp,
    motion: Preintegration,
}

impl FrontEnd {
    /// Allocates everything the setup asks for.
    #[must_use]
    pub fn new(setup: &ValidSetup) -> Self {
        let models: Vec<_> = setup.camera.iter().map(|c| c.model()).collect();
        let lines = &setup.estimator.lines;
        let imu = &setup.imu;
        let mut front_end = Self {
            points: PointTracker::new(&setup.estimator.points, &models),
            lines: lines.enabled.then(|| LineTracker::new(lines, &models)),
            door: ImuDoor::of(imu),
            stamps: StampGate::of_frames(),
            imu: ImuBuffer::of(imu),
            noise: ImuNoise::of(imu),
            arrived: Vec::with_capacity(max_samples(setup)),
            cameras: models.len(),
            readouts: readouts(setup),
            rot_b_c: [UnitQuaternion::identity(); 2],
            sizes_px: image_sizes(&setup.camera),
            max_points: setup.estimator.points.max_points,
            last_stamp: None,
            next_sequence: 0,
            time_offset_s: 0.0,
            bias_gyro: Vector3::zeros(),
            turn_rate_b: Vector3::zeros(),
            distrusts_imu: false,
            untracked_camera: None,
            frozen: FrozenWatch::new(setup),
            reset_counter: 0,
            asked_reset: None,
            had_lines: false,
            tracked: [(0, 0); 2],
            gravity_o: Vector3::z() * -setup.imu.gravity_m_s2,
            known_state: None,
            known_points: Vec::with_capacity(setup.estimator.points.max_points),
            last_motion: None,
        };
        let masks = [0, 1].map(|k| setup.camera.get(k)?.mask.as_ref()?.pixels());
        front_end.points.set_masks(masks);
        if let Some(lines) = &mut front_end.lines {
            lines.set_masks(masks);
        }
        front_end.apply_feedback(&Feedback::new(setup));
        front_end
    }

    /// Adds an inertial sample: in order of time, each before the first frame that needs it. What no sensor can have
    /// measured, and stamps that do not follow those before, are refused: see [`crate::admission`].
    pub fn add_imu(&mut self, sample: &ImuSample) -> ImuAdmission {
        let admission = self.door.admit(sample);
        if !admission.is_accepted() {
            return admission;
        }
        if admission == ImuAdmission::ClockSet {
            self.arrived.retain(|earlier| earlier.stamp < sample.stamp);
        }
        self.imu.push(sample);
        if self.arrived.len() == self.arrived.capacity() {
            self.arrived.remove(0);
        }
        self.arrived.push(*sample);
        admission
    }

    /// True if a frame of `image_stamp` is worth waiting for its samples: it is later than the last, and not
    /// so far ahead that its stamp must be wrong, unless those before it were as far.
    pub fn expects(&self, image_stamp: Timestamp) -> bool {
        let stamp = self.imu_time(image_stamp);
        let latest = self.door.newest().or(self.stamps.newest());
        let is_near = latest.is_none_or(|latest| stamp.seconds_since(latest) <= IMU_MEMORY_S);
        self.stamps.is_later(image_stamp) && (is_near || self.stamps.is_running())
    }

    /// Samples up to this time must have been added before the frame of `image_stamp` is: the time of its last row.
    pub fn imu_needed_until(&self, image_stamp: Timestamp) -> Timestamp {
        let after_s = self.readouts.map(|readout| readout.after_s());
        self.imu_time(image_stamp).plus_seconds(after_s[0].at_least(after_s[1]))
    }

    /// Time of a frame on the IMU's clock.
    fn imu_time(&self, image_stamp: Timestamp) -> Timestamp {
        image_stamp.plus_seconds(self.time_offset_s)
    }

    /// Applies what the window found out, by the rule of [`crate::exchange`].
    pub fn apply_feedback(&mut self, feedback: &Feedback) {
        if feedback.reset_counter != self.reset_counter {
            self.reset_counter = feedback.reset_counter;
            self.forget();
        }
        for &track_id in &feedback.wrong_points {
            self.points.drop_track(track_id);
        }
        self.rot_b_c = feedback.pose_b_c.map(|pose| pose.rotation);
        self.points.set_extrinsics(&feedback.pose_b_c[..self.cameras]);
        if let Some(lines) = &mut self.lines {
            lines.drop_tracks(&feedback.wrong_lines);
            lines.set_extrinsics(&feedback.pose_b_c[..self.cameras]);
        }
        let time_offset_s = believable_offset(feedback.time_offset_s);
        if feedback.solved.pose_o_b.is_none() {
            // Before a start it may be another one altogether: the last frame is where it would have been by that.
            let step_s = time_offset_s - self.time_offset_s;
            self.last_stamp = self.last_stamp.map(|last| last.plus_seconds(step_s));
        }
        (self.time_offset_s, self.readouts) = (time_offset_s, feedback.readouts);
        self.bias_gyro = feedback.bias_gyro;
        self.turn_rate_b = feedback.turn_rate_b;
        self.distrusts_imu = feedback.distrusts_imu;
        self.untracked_camera = feedback.untracked_camera;
        self.points.set_state_known(feedback.solved.pose_o_b.is_some());
        self.known_state.clone_from(&feedback.known_state);
        self.known_points.clone_from(&feedback.known_points);
    }

    /// Gives away the images of frame `sequence`, for those of `images`. They are there between the tracking of the next
    /// frame and that of the one after it: when the feedback about this one has come.
    pub fn exchange_images(&mut self, sequence: u64, images: &mut FrameImages) {
        let known = self.tracked.iter().find(|(s, frame)| *s == sequence && *frame > 0);
        let frame = known.map(|(_, frame)| *frame);
        images.exchange(|pyramids| {
            frame.map_or([false; 2], |frame| self.points.exchange_images(frame, pyramids))
        });
    }

    /// Starts anew before the next frame.
    pub fn reset(&mut self, kind: ResetKind) {
        self.asked_reset = Some(kind);
        self.forget();
        if kind == ResetKind::Hard {
            self.imu.clear();
            self.door.clear();
            self.stamps.clear();
            self.last_stamp = None;
        }
    }

    /// Tracks a frame into `tracked`. An image of the wrong size counts as missing, and so does one
    /// that repeats the one before; a frame whose stamp does not follow those
    /// before is not tracked ([`HealthBits::BAD_STAMP`]). Points are timed by the first of `probes`, lines by the second.
    pub fn track<P: StageProbe + Send>(
        &mut self,
        frame: &FrameInput<'_>,
        budget: &WorkBudget,
        fork: &dyn Fork,
        probes: [&mut P; 2],
        tracked: &mut Tracked,
    ) {
        let stamp = self.imu_time(frame.stamp);
        tracked.sequence = frame.sequence.unwrap_or(self.next_sequence);
        self.next_sequence = tracked.sequence.wrapping_add(1);
        tracked.time = FrameTime { stamp, time_offset_s: self.time_offset_s };
        tracked.budget = *budget;
        tracked.health = HealthBits::default();
        tracked.samples.clear();
        if !self.admit(frame.stamp, tracked) {
            return;
        }
        tracked.reset = self.asked_reset.take();
        std::mem::swap(&mut tracked.samples, &mut self.arrived);
        let images = self.usable_images(frame, &mut tracked.health);
        let (rot_prev_cur, leg) = self.predicted_rotation(stamp);
        let input = TrackerInput { images, rot_prev_cur };
        let motion = leg.as_ref().and_then(|leg| self.predicted_motion(leg));
        self.last_motion = leg;
        let pose_prev_cur_b = motion.as_ref().map(|motion| &motion.pose_prev_cur_b);
        self.points.set_prediction(motion.as_ref(), &self.known_points);
        self.turn_rows(stamp);
        self.points.set_limit(budget.share_of(self.max_points));
        self.begin_lines(budget);
        let Self { points, lines, .. } = self;
        let lines = lines.as_mut().filter(|_| budget.lines);
        match lines {
            None => {
                points.track(&input, fork, probes[0]);
            }
            Some(lines) => {
                let [point_probe, line_probe] = probes;
                fork.join(
                    &mut || {
                        points.track(&input, fork, point_probe);
                    },
                    &mut || {
                        lines.track(&input.images, &input.rot_prev_cur, pose_prev_cur_b, fork, line_probe);
                    },
                );
            }
        }
        self.last_stamp = Some(stamp);
        self.tracked = [(tracked.sequence, self.points.frame()), self.tracked[0]];
        tracked.is_repeating = self.points.is_repeating();
        tracked.turn = self.points.turn();
        self.write_observations(tracked);
    }

    /// Admits the frame of `stamp`, by its own clock, or empties `tracked` and returns false. Samples of a refused frame wait
    /// for the next one.
    fn admit(&mut self, stamp: Timestamp, tracked: &mut Tracked) -> bool {
        let verdict = self.stamps.admit(stamp, self.door.newest());
        tracked.is_clock_set = verdict == StampVerdict::ClockSet;
        if tracked.is_clock_set {
            self.last_stamp = None;
            self.forget();
        }
        let is_admitted = matches!(verdict, StampVerdict::Follows | StampVerdict::ClockSet);
        if !is_admitted {
            tracked.reset = None;
            tracked.is_repeating = false;
            tracked.turn = None;
            tracked.points.clear();
            tracked.lines.clear();
            tracked.figures = FrameFigures::default();
            tracked.health.insert(HealthBits::BAD_STAMP);
        }
        is_admitted
    }

    fn forget(&mut self) {
        self.last_motion = None;
        self.known_state = None;
        self.known_points.clear();
        self.points.reset();
        if let Some(lines) = &mut self.lines {
            lines.reset();
        }
    }

    /// Sets the budget of the lines; those from before a frame without lines are forgotten.
    fn begin_lines(&mut self, budget: &WorkBudget) {
        if let Some(lines) = &mut self.lines {
            lines.set_budget(budget);
            if self.had_lines && !budget.lines {
                lines.reset();
            }
        }
        self.had_lines = budget.lines;
    }

    /// Rotation of the body from the frame before to `stamp` by the gyroscope, `R_prev_cur`; where it does not measure, or is not
    /// believed, by the rate of the frames before. With it the motion, if both sensors measured throughout.
    fn predicted_rotation(&self, stamp: Timestamp) -> (UnitQuaternion<f64>, Option<Leg>) {
        let Some(last) = self.last_stamp.filter(|last| stamp > *last) else {
            return (UnitQuaternion::identity(), None);
        };
        let bias_accel = self.known_state.as_ref().map_or_else(Vector3::zeros, |known| known.nav.bias_accel);
        let (motion, coverage) =
            self.imu.preintegrate(last, stamp, &self.bias_gyro, &bias_accel, &self.noise);
        let rot_prev_cur = match coverage.unmeasured.gyro || self.distrusts_imu {
            true => exp_so3(&(self.turn_rate_b * stamp.seconds_since(last))),
            false => motion.delta_rot,
        };
        let is_whole = !coverage.has_gap && !coverage.is_saturated && !coverage.unmeasured.is_any();
        (rot_prev_cur, is_whole.then_some(Leg { from: last, to: stamp, motion }))
    }

    /// Motion over `leg` by the newest state that the window knows, one frame before it.
    fn predicted_motion(&self, leg: &Leg) -> Option<PredictedMotion> {
        let known = self.known_state.as_ref()?;
        let before =
            self.last_motion.as_ref().filter(|before| before.from == known.stamp && before.to == leg.from)?;
        let previous = known.nav.after(&before.motion, &self.gravity_o);
        let current = previous.after(&leg.motion, &self.gravity_o);
        let pose_o_prev = previous.pose_o_b();
        let dt_s = leg.motion.dt_s;
        Some(PredictedMotion {
            pose_prev_cur_b: pose_o_prev.inverse() * current.pose_o_b(),
            pose_prev_known_b: pose_o_prev.inverse() * known.nav.pose_o_b(),
            sigma_m: known.velocity_sigma_m_s * dt_s,
        })
    }

    /// Tells points and lines how the cameras turn between the rows of the frame of `stamp`.
    fn turn_rows(&mut self, stamp: Timestamp) {
        let turn_b = |late_s: f64| self.turn_since(stamp, late_s);
        let rows = [0, 1].map(|k| RowTurns::new(self.readouts[k], &self.rot_b_c[k], turn_b));
        self.points.set_rows(&rows);
        if let Some(lines) = &mut self.lines {
            lines.set_rows(&rows);
        }
    }

    /// Rotation that takes coordinates of the body, `late_s` after `stamp`, to those at `stamp`; as
    /// [`Self::predicted_rotation`].
    fn turn_since(&self, stamp: Timestamp, late_s: f64) -> UnitQuaternion<f64> {
        let other = stamp.plus_seconds(late_s);
        let (motion, coverage) = self.imu.preintegrate(
            stamp.min(other),
            stamp.max(other),
            &self.bias_gyro,
            &Vector3::zeros(),
            &self.noise,
        );
        match coverage.unmeasured.gyro || self.distrusts_imu {
            true => exp_so3(&(self.turn_rate_b * late_s)),
            false if late_s < 0.0 => motion.delta_rot.inverse(),
            false => motion.delta_rot,
        }
    }

    /// Copies the observations and figures of the frame to `tracked`.
    fn write_observations(&self, tracked: &mut Tracked) {
        tracked.points.clear();
        tracked.points.extend_from_slice(self.points.observations());
        tracked.lines.clear();
        let points = &tracked.points;
        tracked.figures = FrameFigures {
            points_tracked: points.len() as u32,
            points_stereo: points.iter().filter(|o| o.px.iter().all(Option::is_some)).count() as u32,
            ..FrameFigures::default()
        };
        if let Some(lines) = self.lines.as_ref().filter(|_| tracked.budget.lines) {
            tracked.lines.extend_from_slice(lines.observations());
            let (of_frame, figures) = (&mut tracked.figures, lines.figures());
            of_frame.lines_raw = figures.left.raw;
            of_frame.lines_kept = figures.left.kept;
            of_frame.lines_matched = figures.matched;
            of_frame.lines_cut_short = figures.cut_short;
        }
    }
}
