//! Keeps what a run produces: the causal trajectory, its covariances, and the odometry if asked.

use crate::pipeline::Sink;
use nalgebra::{Isometry3, Matrix6};
use plumbline_config::Timestamp;
use plumbline_drivers::StampedPose;
use plumbline_estimator::{Estimate, Odometry};

/// One pose as it was known when its frame came.
#[derive(Clone, Debug)]
pub struct CausalPose {
    /// Time on the IMU's axis.
    pub stamp: Timestamp,
    /// Pose of the body in the odometry frame.
    pub pose_o_b: Isometry3<f64>,
    /// Covariance of position and attitude.
    pub covariance: Matrix6<f64>,
    /// Resets so far: a jump is no error of the estimate.
    pub reset_counter: u32,
}

/// A sink that remembers, and passes everything on to others.
#[derive(Default)]
pub struct Recorder<'a> {
    /// Poses of frames, in order.
    pub poses: Vec<CausalPose>,
    /// Poses of odometry, in order; only kept when `keep_odometry`.
    pub odometry: Vec<StampedPose>,
    /// Whether to keep odometry.
    pub keep_odometry: bool,
    /// Others who want to know.
    pub listeners: Vec<&'a mut dyn Sink>,
}

impl Sink for Recorder<'_> {
    fn estimate(&mut self, estimate: &Estimate, frame_ms: f64) {
        if estimate.has_pose() {
            self.poses.push(CausalPose {
                stamp: estimate.stamp,
                pose_o_b: estimate.pose_o_b,
                covariance: estimate.covariance.fixed_view::<6, 6>(0, 0).into_owned(),
                reset_counter: estimate.reset_counter,
            });
        }
        for listener in &mut self.listeners {
            listener.estimate(estimate, frame_ms);
        }
    }

    fn odometry(&mut self, odometry: &Odometry) {
        if self.keep_odometry {
            self.odometry.push(StampedPose { stamp: odometry.stamp, pose: odometry.pose_o_b });
        }
        for listener in &mut self.listeners {
            listener.odometry(odometry);
        }
    }
}

impl Recorder<'_> {
    /// Makes room for the poses of so many frames, resident from now on: a long flight does not grow.
    pub fn reserve(&mut self, frames: usize) {
        let blank = CausalPose {
            stamp: Timestamp::default(),
            pose_o_b: Isometry3::identity(),
            covariance: Matrix6::zeros(),
            reset_counter: 0,
        };
        self.poses.resize(frames, blank);
        self.poses.clear();
    }

    /// The trajectory of the frames.
    #[must_use]
    pub fn trajectory(&self) -> Vec<StampedPose> {
        self.poses.iter().map(|p| StampedPose { stamp: p.stamp, pose: p.pose_o_b }).collect()
    }
}
