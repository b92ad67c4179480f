//! The estimator as its user meets it. IMU-rate odometry is beside it, in [`crate::propagator`].

use crate::estimate::{Estimate, FrameInput, HealthBits, Stage, StageProbe};
use crate::lines::{LineObservation, LineTracker};
use crate::odometry::Odometer;
use crate::points::{PointTracker, TrackerInput};
use plumbline_config::{Config, ImageView, ImuSample, Timestamp};

/// What became of an inertial sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ImuAdmission {
    /// Taken.
    Accepted,
    /// Not later than the newest sample: refused.
    NotLater,
    /// A component was not a finite number: refused.
    NotFinite,
}

/// How much a reset forgets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ResetKind {
    /// The map and the window go, the pose stays: the new start continues from it.
    Soft,
    /// Everything goes: the new start begins at the origin.
    Hard,
}

/// The frame-rate estimator: a pure function of its configuration and the ordered list of its inputs.
///
/// Order of calls: every inertial sample by [`Self::add_imu`] in order of time; a frame by
/// [`Self::add_frame`] once the samples reach [`Self::imu_needed_until`] of its stamp (or will never).
pub struct Estimator {
    points: PointTracker,
    lines: Option<LineTracker>,
    odometer: Odometer,
    cameras: usize,
    sizes_px: [(usize, usize); 2],
}

impl Estimator {
    /// Allocates everything the configuration asks for. The configuration has passed validation.
    #[must_use]
    pub fn new(config: &Config) -> Self {
        let models: Vec<_> = config.camera.iter().map(|c| c.model()).collect();
        let size = |k: usize| config.camera.get(k).map_or((0, 0), |c| (c.width_px, c.height_px));
        let mut estimator = Self {
            points: PointTracker::new(&config.estimator.points, &models),
            lines: config.estimator.lines.enabled.then(|| LineTracker::new(&config.estimator.lines, &models)),
            odometer: Odometer::new(config),
            cameras: models.len(),
            sizes_px: [size(0), size(1)],
        };
        estimator.hand_extrinsics();
        estimator
    }

    /// Takes an inertial sample.
    pub fn add_imu(&mut self, sample: &ImuSample) -> ImuAdmission {
        if !sample.is_finite() {
            ImuAdmission::NotFinite
        } else if self.odometer.imu.push(sample) {
            ImuAdmission::Accepted
        } else {
            ImuAdmission::NotLater
        }
    }

    /// Samples up to this time must have been added before the frame of `image_stamp` is.
    #[must_use]
    pub fn imu_needed_until(&self, image_stamp: Timestamp) -> Timestamp {
        self.odometer.imu_stamp(image_stamp)
    }

    /// Takes a frame, and returns the estimate after it. An image of the wrong size counts as missing.
    pub fn add_frame(&mut self, frame: &FrameInput<'_>, probe: &mut impl StageProbe) -> Estimate {
        let stamp = self.odometer.imu_stamp(frame.stamp);
        let mut health = HealthBits::default();
        let images = self.usable_images(frame, &mut health);
        let rot_prev_cur = self.odometer.predicted_rotation(stamp);
        probe.begin(Stage::Points);
        let points = self.points.track(&TrackerInput { images, rot_prev_cur });
        probe.end(Stage::Points);
        let lines: &[LineObservation] = match &mut self.lines {
            Some(tracker) => tracker.track(&images, &rot_prev_cur, probe),
            None => &[],
        };
        let resets = self.odometer.reset_counter();
        let mut estimate = self.odometer.process(frame.sequence, stamp, points, lines, probe);
        estimate.health.insert(health);
        if estimate.reset_counter != resets {
            self.reset_trackers();
        }
        self.drop_outliers();
        self.tell_line_figures(&mut estimate);
        self.hand_extrinsics();
        estimate
    }

    /// The lines seen in the last frame, for display.
    #[must_use]
    pub fn line_observations(&self) -> &[LineObservation] {
        self.lines.as_ref().map_or(&[], LineTracker::observations)
    }

    /// Starts anew before the next frame.
    pub fn reset(&mut self, kind: ResetKind) {
        self.odometer.reset(kind);
        self.reset_trackers();
    }

    fn reset_trackers(&mut self) {
        self.points.reset();
        if let Some(lines) = &mut self.lines {
            lines.reset();
        }
    }

    fn drop_outliers(&mut self) {
        let outliers = self.odometer.outliers();
        for &track_id in &outliers.points {
            self.points.drop_track(track_id);
        }
        if let Some(lines) = &mut self.lines {
            lines.drop_tracks(&outliers.lines);
        }
    }

    fn tell_line_figures(&self, estimate: &mut Estimate) {
        if let Some(lines) = &self.lines {
            let (told, figures) = (&mut estimate.figures, lines.figures());
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

    /// The trackers match left to right by the rig as refined so far.
    fn hand_extrinsics(&mut self) {
        let rig = &self.odometer.window.rig;
        let poses = [rig.pose_b_c(0), rig.pose_b_c(1)];
        self.points.set_extrinsics(&poses[..self.cameras]);
        if let Some(lines) = &mut self.lines {
            lines.set_extrinsics(&poses[..self.cameras]);
        }
    }
}
