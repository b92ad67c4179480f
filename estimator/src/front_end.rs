//! The front-end: images in, tracked points and lines out.
//!
//! It may work on the next frame while the window still solves the last. What the window found out (wrong
//! tracks, a refined extrinsics, a bias) therefore reaches it one frame late, always, whether there was a
//! thread to spare or not: [`crate::facade`] and every executor hand over the [`Feedback`] of frame `k` before
//! frame `k + 2`.

use crate::estimate::{FrameFigures, FrameInput, HealthBits, StageProbe};
use crate::facade::{ImuAdmission, ResetKind};
use crate::inertial::{ImuBuffer, ImuNoise};
use crate::lines::{LineObservation, LineTracker};
use crate::odometry::{IMU_MEMORY_S, believable_offset};
use crate::points::{PointObservation, PointTracker, TrackerInput};
use crate::window::state::FrameTime;
use crate::work_budget::{Fork, WorkBudget};
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use plumbline_config::{Config, ImageView, ImuSample, Timestamp};

/// What the front-end makes of one frame: all that the window needs to know of it.
#[derive(Clone, Debug)]
pub struct Tracked {
    /// Sequence number of the frame.
    pub sequence: u64,
    /// When it was taken.
    pub time: FrameTime,
    /// A reset that comes before it.
    pub reset: Option<ResetKind>,
    /// Inertial samples since the frame before, in order.
    pub samples: Vec<ImuSample>,
    /// Points seen, in the order of their names.
    pub points: Vec<PointObservation>,
    /// Lines seen, in the order of their names.
    pub lines: Vec<LineObservation>,
    /// What was wrong with the images.
    pub health: HealthBits,
    /// Figures of the front-end; those of the window are still zero.
    pub figures: FrameFigures,
    /// The work that the frame gets.
    pub budget: WorkBudget,
}

impl Tracked {
    /// Room for any frame of the configuration.
    #[must_use]
    pub fn new(config: &Config) -> Self {
        Self {
            sequence: 0,
            time: FrameTime::default(),
            reset: None,
            samples: Vec::with_capacity(max_samples(config)),
            points: Vec::with_capacity(config.estimator.points.max_points),
            lines: Vec::with_capacity(2 * config.estimator.lines.max_segments),
            health: HealthBits::default(),
            figures: FrameFigures::default(),
            budget: WorkBudget::FULL,
        }
    }
}

/// What the window found out that the front-end should know.
#[derive(Clone, Debug)]
pub struct Feedback {
    /// Names of points that are none of the scene's.
    pub wrong_points: Vec<u32>,
    /// Names of lines that are none of the scene's.
    pub wrong_lines: Vec<u32>,
    /// Mounting of both cameras as refined so far.
    pub pose_b_c: [Isometry3<f64>; 2],
    /// `t_imu - t_camera` as refined so far, s.
    pub time_offset_s: f64,
    /// Bias of the gyroscope, rad/s.
    pub bias_gyro: Vector3<f64>,
    /// Resets so far.
    pub reset_counter: u32,
}

impl Feedback {
    /// What is known before the first frame, with room for what any frame may find.
    #[must_use]
    pub fn new(config: &Config) -> Self {
        let pose = |k: usize| config.camera.get(k).map_or_else(Isometry3::identity, |c| c.pose_b_c());
        Self {
            // Both cameras may name the same track.
            wrong_points: Vec::with_capacity(2 * config.estimator.window.max_landmarks),
            wrong_lines: Vec::with_capacity(2 * config.estimator.lines.max_landmarks),
            pose_b_c: [pose(0), pose(1)],
            time_offset_s: config.rig.time_offset_s,
            bias_gyro: Vector3::zeros(),
            reset_counter: 0,
        }
    }
}

/// Samples between two frames, at most: what the inertial buffer keeps.
fn max_samples(config: &Config) -> usize {
    (IMU_MEMORY_S * config.imu.rate_hz).ceil() as usize
}

/// Tracks points and lines through the images of the rig. Everything is allocated at construction.
pub struct FrontEnd {
    points: PointTracker,
    lines: Option<LineTracker>,
    imu: ImuBuffer,
    noise: ImuNoise,
    arrived: Vec<ImuSample>,
    cameras: usize,
    sizes_px: [(usize, usize); 2],
    max_points: usize,
    last_stamp: Option<Timestamp>,
    time_offset_s: f64,
    bias_gyro: Vector3<f64>,
    reset_counter: u32,
    asked_reset: Option<ResetKind>,
    had_lines: bool,
}

impl FrontEnd {
    /// Allocates everything the configuration asks for. The configuration has passed validation.
    #[must_use]
    pub fn new(config: &Config) -> Self {
        let models: Vec<_> = config.camera.iter().map(|c| c.model()).collect();
        let size = |k: usize| config.camera.get(k).map_or((0, 0), |c| (c.width_px, c.height_px));
        let lines = &config.estimator.lines;
        let imu = &config.imu;
        let mut front_end = Self {
            points: PointTracker::new(&config.estimator.points, &models),
            lines: lines.enabled.then(|| LineTracker::new(lines, &models)),
            imu: ImuBuffer::new(IMU_MEMORY_S, imu.rate_hz, imu.gyro_range_rad_s, imu.accel_range_m_s2),
            noise: ImuNoise::of(imu),
            arrived: Vec::with_capacity(max_samples(config)),
            cameras: models.len(),
            sizes_px: [size(0), size(1)],
            max_points: config.estimator.points.max_points,
            last_stamp: None,
            time_offset_s: 0.0,
            bias_gyro: Vector3::zeros(),
            reset_counter: 0,
            asked_reset: None,
            had_lines: false,
        };
        front_end.apply_feedback(&Feedback::new(config));
        front_end
    }

    /// Takes an inertial sample.
    pub fn add_imu(&mut self, sample: &ImuSample) -> ImuAdmission {
        if !sample.is_finite() {
            return ImuAdmission::NotFinite;
        }
        if !self.imu.push(sample) {
            return ImuAdmission::NotLater;
        }
        if self.arrived.len() == self.arrived.capacity() {
            self.arrived.remove(0);
        }
        self.arrived.push(*sample);
        ImuAdmission::Accepted
    }

    /// Samples up to this time must have been added before the frame of `image_stamp` is.
    #[must_use]
    pub fn imu_needed_until(&self, image_stamp: Timestamp) -> Timestamp {
        image_stamp.plus_seconds(self.time_offset_s)
    }

    /// Takes what the window found out, by the rule above.
    pub fn apply_feedback(&mut self, feedback: &Feedback) {
        if feedback.reset_counter != self.reset_counter {
            self.reset_counter = feedback.reset_counter;
            self.forget();
        }
        for &track_id in &feedback.wrong_points {
            self.points.drop_track(track_id);
        }
        self.points.set_extrinsics(&feedback.pose_b_c[..self.cameras]);
        if let Some(lines) = &mut self.lines {
            lines.drop_tracks(&feedback.wrong_lines);
            lines.set_extrinsics(&feedback.pose_b_c[..self.cameras]);
        }
        self.time_offset_s = believable_offset(feedback.time_offset_s);
        self.bias_gyro = feedback.bias_gyro;
    }

    /// Starts anew before the next frame.
    pub fn reset(&mut self, kind: ResetKind) {
        self.asked_reset = Some(kind);
        self.forget();
    }

    /// Tracks a frame into `tracked`. An image of the wrong size counts as missing. Points are timed by the
    /// first of `probes`, lines by the second.
    pub fn track<P: StageProbe + Send>(
        &mut self,
        frame: &FrameInput<'_>,
        budget: &WorkBudget,
        fork: &dyn Fork,
        probes: [&mut P; 2],
        tracked: &mut Tracked,
    ) {
        let stamp = self.imu_needed_until(frame.stamp);
        tracked.sequence = frame.sequence;
        tracked.time = FrameTime { stamp, time_offset_s: self.time_offset_s };
        tracked.reset = self.asked_reset.take();
        tracked.budget = *budget;
        tracked.health = HealthBits::default();
        tracked.samples.clear();
        std::mem::swap(&mut tracked.samples, &mut self.arrived);
        let images = self.usable_images(frame, &mut tracked.health);
        let input = TrackerInput { images, rot_prev_cur: self.predicted_rotation(stamp) };
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
                        lines.track(&input.images, &input.rot_prev_cur, fork, line_probe);
                    },
                );
            }
        }
        self.last_stamp = Some(stamp);
        self.tell(tracked);
    }

    /// The lines seen in the last frame, for display.
    #[must_use]
    pub fn line_observations(&self) -> &[LineObservation] {
        self.lines.as_ref().map_or(&[], LineTracker::observations)
    }

    fn forget(&mut self) {
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

    /// Rotation of the body from the frame before to `stamp` by the gyroscope, `R_prev_cur`.
    fn predicted_rotation(&self, stamp: Timestamp) -> UnitQuaternion<f64> {
        let Some(last) = self.last_stamp.filter(|last| stamp > *last) else {
            return UnitQuaternion::identity();
        };
        self.imu.preintegrate(last, stamp, &self.bias_gyro, &Vector3::zeros(), &self.noise).0.delta_rot
    }

    /// Writes down what was seen.
    fn tell(&self, tracked: &mut Tracked) {
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
            let (told, figures) = (&mut tracked.figures, lines.figures());
            told.lines_raw = figures.left.raw;
            told.lines_kept = figures.left.kept;
            told.lines_merged = figures.left.merged;
            told.lines_matched = figures.matched;
            told.lines_cut_short = figures.cut_short;
        }
    }

    fn usable_images<'a>(
        &self,
        frame: &FrameInput<'a>,
        health: &mut HealthBits,
    ) -> [Option<ImageView<'a>>; 2] {
        let mut images = [None, None];
        let missing = [HealthBits::LEFT_MISSING, HealthBits::RIGHT_MISSING];
        for camera in 0..self.cameras {
            match frame.images[camera] {
                Some(image) if (image.width(), image.height()) == self.sizes_px[camera] => {
                    images[camera] = Some(image)
                }
                Some(_) => health.insert(HealthBits::BAD_IMAGE_SIZE),
                None => health.insert(missing[camera]),
            }
        }
        images
    }
}
