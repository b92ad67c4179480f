//! The estimator as its user meets it: front-end, window and propagation, one after the other on one thread.
//!
//! An executor that has cores to spare runs [`FrontEnd`], [`Odometer`] and [`Propagator`] side by side by the same
//! rule, and gets the same bits.

use crate::estimate::{Estimate, Odometry, StageProbe};
use crate::exchange::{Feedback, Tracked};
use crate::front_end::FrontEnd;
use crate::input::{FrameInput, ImuAdmission, ResetKind};
use crate::odometry::{Odometer, ResetReason};
use crate::propagator::Propagator;
use crate::propagator::history::{Instant, NoInstant};
use crate::work_budget::{InTurn, WorkBudget};
use plumbline_config::{ImuSample, Timestamp, ValidSetup};

/// The estimator: a pure function of its setup and the ordered list of its inputs.
///
/// Order of calls: every inertial sample by [`Self::add_imu`] or [`Self::propagate`], in order of time; a frame by
/// [`Self::add_frame`] once the samples reach [`Self::imu_needed_until`] of its stamp (or never will). Nothing is
/// allocated after [`Self::new`], and no image is copied but into the pyramids of the trackers.
///
/// ```
/// use plumbline_estimator::config::camera::Distortion;
/// use plumbline_estimator::config::options::{CameraConfig, ImuConfig};
/// use plumbline_estimator::nalgebra::Vector3;
/// use plumbline_estimator::{
///     Estimator, EstimatorSetup, FrameInput, ImageView, ImuSample, Timestamp, TrackingState,
/// };
///
/// # let camera = |y: f64| CameraConfig {
/// #     width_px: 320,
/// #     height_px: 240,
/// #     rate_hz: 20.0,
/// #     readout_s: 0.0,
/// #     exposure_s: 0.0,
/// #     mask: None,
/// #     focal_px: [190.0, 190.0],
/// #     centre_px: [160.0, 120.0],
/// #     distortion: Distortion::RadialTangential { k1: 0.0, k2: 0.0, p1: 0.0, p2: 0.0 },
/// #     pose_b_c: [[0.0, 0.0, 1.0, 0.05], [-1.0, 0.0, 0.0, y], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]],
/// # };
/// # let (left_camera, right_camera) = (camera(0.05), camera(-0.05));
/// let imu = ImuConfig::with_noise(200.0, (2e-3, 2e-5), (2e-2, 3e-3));
/// let setup = EstimatorSetup::new(vec![left_camera, right_camera], imu).validate()?;
/// let mut estimator = Estimator::new(&setup);
///
/// for k in 0..=20 {
///     let (gyro, accel) = (Vector3::zeros(), Vector3::new(0.0, 0.0, 9.81));
///     estimator.add_imu(&ImuSample { stamp: Timestamp::from_nanos(5_000_000 * k), gyro, accel });
/// }
/// # let (left, right) = (vec![90u8; 320 * 240], vec![90u8; 320 * 240]);
/// let view = |pixels| ImageView::new(320, 240, 320, pixels);
/// let frame = FrameInput::stereo(Timestamp::from_nanos(50_000_000), view(&left)?, view(&right)?);
/// let estimate = estimator.add_frame(&frame);
/// match estimate.pose() {
///     Some(pose_o_b) => println!("{} {}", pose_o_b.translation, estimate.covariance),
///     None => assert_eq!(estimate.state, TrackingState::Initialising),
/// }
/// # assert!(estimate.pose().is_none());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct Estimator {
    front_end: FrontEnd,
    odometer: Odometer,
    propagator: Propagator,
    tracked: Tracked,
    feedback: Feedback,
}

impl Estimator {
    /// Allocates everything the setup asks for.
    #[must_use]
    pub fn new(setup: &ValidSetup) -> Self {
        Self {
            front_end: FrontEnd::new(setup),
            odometer: Odometer::new(setup),
            propagator: Propagator::new(setup),
            tracked: Tracked::new(setup),
            feedback: Feedback::new(setup),
        }
    }

    /// Adds an inertial sample.
    pub fn add_imu(&mut self, sample: &ImuSample) -> ImuAdmission {
        self.front_end.add_imu(sample)
    }

    /// Adds an inertial sample, and carries the newest estimate forward to its time: odometry at the rate of the
    /// IMU. `None` while there is no pose, and for a sample that is refused. Use it for every sample or for none.
    pub fn propagate(&mut self, sample: &ImuSample) -> Option<Odometry> {
        self.propagate_admitted(sample).1
    }

    /// As [`Self::propagate`], with what became of the sample.
    pub fn propagate_admitted(&mut self, sample: &ImuSample) -> (ImuAdmission, Option<Odometry>) {
        (self.add_imu(sample), self.propagator.tick(sample))
    }

    /// State at an instant of the last seconds, such as that of a trigger: by the estimates before and after it and the
    /// inertial samples between ([`crate::propagator::history`]). Needs every sample by [`Self::propagate`].
    ///
    /// # Errors
    /// When no state at `stamp` is available.
    pub fn at(&self, stamp: Timestamp) -> Result<Instant, NoInstant> {
        self.propagator.at(stamp)
    }

    /// Inertial samples up to this time must have been added before the frame of `image_stamp` is: the stamp on
    /// the IMU's clock.
    pub fn imu_needed_until(&self, image_stamp: Timestamp) -> Timestamp {
        self.front_end.imu_needed_until(image_stamp)
    }

    /// Adds a frame, and returns the estimate at its time. An image of the wrong size counts as missing; what is
    /// wrong with the frame is said by [`Estimate::health`].
    pub fn add_frame(&mut self, frame: &FrameInput<'_>) -> Estimate {
        self.add_frame_with(frame, &WorkBudget::FULL, [&mut (), &mut ()])
    }

    /// As [`Self::add_frame`], with less work than the setup allows and with probes that hear of the stages: the
    /// first of those of points and window, the second of those of lines. The estimate depends on the budget.
    pub fn add_frame_with<P: StageProbe + Send>(
        &mut self,
        frame: &FrameInput<'_>,
        budget: &WorkBudget,
        [point_probe, line_probe]: [&mut P; 2],
    ) -> Estimate {
        self.front_end.track(frame, budget, &InTurn, [point_probe, line_probe], &mut self.tracked);
        // That of the frame before: the next frame is tracked without knowing what this one brings.
        self.front_end.apply_feedback(&self.feedback);
        let estimate = self.odometer.process(&self.tracked, point_probe, &mut self.feedback);
        self.propagator.correct(&estimate);
        estimate
    }

    /// Why the newest reset was.
    pub fn reset_reason(&self) -> Option<&ResetReason> {
        self.odometer.reset_reason()
    }

    /// Starts anew before the next frame.
    pub fn reset(&mut self, kind: ResetKind) {
        self.front_end.reset(kind);
    }
}

#[cfg(test)]
#[path = "facade_tests.rs"]
mod tests;
