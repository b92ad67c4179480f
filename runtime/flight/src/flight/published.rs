//! Published states of a flight, kept in memory: every estimate; and, where the truth judges the flight, every few samples of
//! odometry, and the uncertainty of each estimate relative to the one a second before.

use super::trajectory::{EntryStorage, Lent, MAX_RESERVED_FRAMES};
use crate::pipeline::listener::{Listener, ListenerView, Producer, Subscriber};
use nalgebra::{Isometry3, Vector3};
use plumbline_config::{Timestamp, ValidConfig};
use plumbline_estimator::HealthBits;
use plumbline_estimator::estimate::{NavCovariance, TrackingState};
use plumbline_estimator::odometry::StepCovariance;
use plumbline_record::Said;

/// Estimates of live sensors that are kept: half an hour at 20 Hz, longer than batteries last; 30 MB.
const LIVE_FRAMES: usize = 36_000;
/// Odometry is kept at about this rate, Hz. It is no fraction of 20 Hz, so that all ages of the last correction are met
/// alike.
const ODOMETRY_RATE_HZ: f64 = 28.0;

/// A state as it was published.
#[derive(Clone, Debug, Default, PartialEq)]
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
    /// Pose of the odometry frame in the map as it was known then, where it was.
    pub pose_m_o: Option<Isometry3<f64>>,
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

/// States that a flight published.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Published {
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
    /// Estimates that are kept at most.
    most: usize,
    is_judged: bool,
}

impl PublishedStates {
    /// With room for the estimates of so many frames, resident from now on: a long flight does not grow. Of a flight whose length is
    /// not known, the first [`LIVE_FRAMES`] are kept. The rest is kept `is_judged`.
    pub fn with_room_for(frames: Option<usize>, config: &ValidConfig, is_judged: bool) -> Self {
        let most = if frames.is_some() { usize::MAX } else { LIVE_FRAMES };
        let room = frames.unwrap_or(LIVE_FRAMES).min(MAX_RESERVED_FRAMES);
        let judged = if is_judged { room } else { 0 };
        let (imu_hz, camera_hz) = (config.imu.rate_hz, config.camera[0].rate_hz);
        let one_of = (imu_hz / ODOMETRY_RATE_HZ).round().max(1.0);
        // Half of the frames may be missing, and neither rate is exact.
        let odometry = (judged as f64 * imu_hz / camera_hz / one_of * 2.1).ceil() as usize;
        Self {
            estimates: EntryStorage::with_room_for(room),
            odometry: EntryStorage::with_room_for(odometry),
            steps: EntryStorage::with_room_for(judged),
            frames: EntryStorage::with_room_for(judged),
            one_of: one_of as u64,
            most,
            is_judged,
        }
    }

    /// Estimates that had a pose, one a frame, and what else is kept of a flight that is judged.
    #[must_use]
    pub fn into_kept(self) -> (Vec<PublishedState>, Option<Published>) {
        let published = Published {
            odometry: self.odometry.into_entries(),
            steps: self.steps.into_entries(),
            frames: self.frames.into_entries(),
        };
        (self.estimates.into_entries(), self.is_judged.then_some(published))
    }
}

impl Subscriber for PublishedStates {
    fn listener(&mut self, producer: Producer) -> Box<dyn Listener> {
        match producer {
            Producer::Window => Box::new(OfEstimates {
                states: self.estimates.lend(),
                most: self.most,
                pose_m_o: None,
                judged: self.is_judged.then(|| (self.steps.lend(), self.frames.lend())),
            }),
            Producer::Tick if self.is_judged => {
                Box::new(OfOdometry { states: self.odometry.lend(), one_of: self.one_of })
            }
            _ => Box::new(()),
        }
    }
}

/// Joins what one thread says of a frame: first where the odometry lies in the map, then the estimate.
struct OfEstimates {
    states: Lent<PublishedState>,
    most: usize,
    pose_m_o: Option<Isometry3<f64>>,
    judged: Option<(Lent<StepCovariance>, Lent<FrameStatus>)>,
}

impl Listener for OfEstimates {
    fn keeps_steps(&self) -> bool {
        self.judged.is_some()
    }

    fn shown(&mut self, view: ListenerView<'_>) {
        if let (ListenerView::Solved(solved), Some((steps, _))) = (view, &mut self.judged) {
            steps.entries.extend(solved.step);
        }
    }

    fn said(&mut self, said: &Said) {
        let estimate = match said {
            Said::MapEstimate(map) => return self.pose_m_o = map.pose_m_o,
            Said::Estimate(full) => &full.estimate,
            _ => return,
        };
        let (stamp, quality, health) = (estimate.stamp, estimate.quality, estimate.health);
        if let Some((_, frames)) = &mut self.judged {
            frames.entries.push(FrameStatus { stamp, quality, health });
        }
        if estimate.has_pose() && self.states.entries.len() < self.most {
            self.states.entries.push(PublishedState {
                stamp,
                pose_o_b: estimate.pose_o_b,
                v_o_b: estimate.v_o_b,
                covariance: estimate.covariance,
                reset_counter: estimate.reset_counter,
                quality,
                pose_m_o: self.pose_m_o,
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
                pose_m_o: None,
            });
        }
    }
}
