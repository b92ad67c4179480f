//! Published states of a flight, kept to be judged by the truth: every estimate, every few samples of odometry, and the
//! uncertainty of each relative to the one a second before.

use super::trajectory::{EntryStorage, Lent, MAX_RESERVED_FRAMES};
use crate::pipeline::listener::{Listener, ListenerView, Producer, Subscriber};
use nalgebra::{Isometry3, Vector3};
use plumbline_config::{Timestamp, ValidConfig};
use plumbline_estimator::HealthBits;
use plumbline_estimator::estimate::{NavCovariance, TrackingState};
use plumbline_estimator::odometry::StepCovariance;
use plumbline_record::Said;
use plumbline_record::said::FullEstimate;

/// Odometry is kept at about this rate, Hz. It is no fraction of 20 Hz, so that all ages of the last correction are met
/// alike.
const ODOMETRY_RATE_HZ: f64 = 28.0;

/// A state as it was published.
#[derive(Clone, Debug, PartialEq)]
pub struct PublishedState {
    /// Time on the IMU's axis.
    pub stamp: Timestamp,
    /// Pose of the body in the odometry frame.
    pub pose_o_b: Isometry3<f64>,
    /// Velocity of the body in the odometry frame, m/s.
    pub v_o_b: Vector3<f64>,
    /// Covariance of position, attitude and velocity.
    pub covariance: NavCovariance,
    /// Number of resets so far: each begins a new odometry frame.
    pub reset_counter: u32,
    /// Quality, 0 to 100.
    pub quality: i8,
}

/// Published status of a frame, with a pose or without.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FrameStatus {
    /// Time on the IMU's axis.
    pub stamp: Timestamp,
    /// Quality, 0 to 100; -1 if the estimator failed.
    pub quality: i8,
    /// Errors and warnings.
    pub health: HealthBits,
}

impl PublishedState {
    fn blank() -> Self {
        Self {
            stamp: Timestamp::default(),
            pose_o_b: Isometry3::identity(),
            v_o_b: Vector3::zeros(),
            covariance: NavCovariance::zeros(),
            reset_counter: 0,
            quality: 0,
        }
    }
}

/// States that a flight published.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Published {
    /// Estimates that had a pose, one a frame.
    pub estimates: Vec<PublishedState>,
    /// Odometry that had a pose, every few samples.
    pub odometry: Vec<PublishedState>,
    /// Covariances of steps between estimates about a second apart.
    pub steps: Vec<StepCovariance>,
    /// Status of every frame.
    pub frames: Vec<FrameStatus>,
}

/// Keeps what a flight publishes.
#[derive(Debug)]
pub struct PublishedStates {
    estimates: EntryStorage<PublishedState>,
    odometry: EntryStorage<PublishedState>,
    steps: EntryStorage<StepCovariance>,
    frames: EntryStorage<FrameStatus>,
    /// One of so many samples of odometry is kept.
    one_of: u64,
}

impl PublishedStates {
    /// With room for a flight of so many frames.
    #[must_use]
    pub fn with_room_for(frames: usize, config: &ValidConfig) -> Self {
        let frames = frames.min(MAX_RESERVED_FRAMES);
        let (imu_hz, camera_hz) = (config.imu.rate_hz, config.camera[0].rate_hz);
        let one_of = (imu_hz / ODOMETRY_RATE_HZ).round().max(1.0);
        // Half of the frames may be missing, and neither rate is exact; nothing for a stream whose length is not known.
        let kept = (frames as f64 * imu_hz / camera_hz / one_of * 2.1).ceil() as usize;
        Self {
            estimates: EntryStorage::with_room_for(frames, PublishedState::blank()),
            odometry: EntryStorage::with_room_for(kept, PublishedState::blank()),
            steps: EntryStorage::with_room_for(frames, StepCovariance::default()),
            frames: EntryStorage::with_room_for(frames, FrameStatus::default()),
            one_of: one_of as u64,
        }
    }

    /// States kept, after the run.
    #[must_use]
    pub fn into_published(self) -> Published {
        Published {
            estimates: self.estimates.into_entries(),
            odometry: self.odometry.into_entries(),
            steps: self.steps.into_entries(),
            frames: self.frames.into_entries(),
        }
    }
}

impl Subscriber for PublishedStates {
    fn listener(&mut self, producer: Producer) -> Box<dyn Listener> {
        match producer {
            Producer::Window => Box::new(OfEstimates {
                states: self.estimates.lend(),
                steps: self.steps.lend(),
                frames: self.frames.lend(),
            }),
            Producer::Tick => Box::new(OfOdometry { states: self.odometry.lend(), one_of: self.one_of }),
            _ => Box::new(()),
        }
    }
}

struct OfEstimates {
    states: Lent<PublishedState>,
    steps: Lent<StepCovariance>,
    frames: Lent<FrameStatus>,
}

impl Listener for OfEstimates {
    fn keeps_steps(&self) -> bool {
        true
    }

    fn shown(&mut self, view: ListenerView<'_>) {
        if let ListenerView::Solved(solved) = view {
            self.steps.entries.extend(solved.step);
        }
    }

    fn said(&mut self, said: &Said) {
        let Said::Estimate(FullEstimate { estimate, .. }) = said else { return };
        let (stamp, quality, health) = (estimate.stamp, estimate.quality, estimate.health);
        self.frames.entries.push(FrameStatus { stamp, quality, health });
        if estimate.has_pose() {
            self.states.entries.push(PublishedState {
                stamp: estimate.stamp,
                pose_o_b: estimate.pose_o_b,
                v_o_b: estimate.v_o_b,
                covariance: estimate.covariance,
                reset_counter: estimate.reset_counter,
                quality,
            });
        }
    }
}

struct OfOdometry {
    states: Lent<PublishedState>,
    one_of: u64,
}

impl Listener for OfOdometry {
    fn said(&mut self, said: &Said) {
        let Said::Odometry(odometry) = said else { return };
        let has_pose = matches!(odometry.state, TrackingState::Tracking | TrackingState::Blind);
        if has_pose && odometry.sequence.is_multiple_of(self.one_of) {
            self.states.entries.push(PublishedState {
                stamp: odometry.stamp,
                pose_o_b: odometry.pose_o_b,
                v_o_b: odometry.v_o_b,
                covariance: odometry.covariance,
                reset_counter: odometry.reset_counter,
                quality: odometry.quality,
            });
        }
    }
}
