//! The run of a flight, from its first sample to its last.

use super::published::{Published, PublishedState, PublishedStates};
use super::{Flight, FlightError, Truth};
use crate::pipeline::listener::{Several, Subscriber};
use crate::pipeline::{self, Control, RunOptions, RunOutcome, Stamps, Streams};
use plumbline_config::ValidConfig;
use plumbline_drivers::StampedPose;
use plumbline_estimator::places::mapper::Passing;
use plumbline_simulator::InjectedFault;

/// Result of a flight.
pub struct Flown {
    /// Short name of the flight.
    pub name: String,
    /// Configuration of the estimator.
    pub config: ValidConfig,
    /// True states of the vehicle.
    pub truth: Truth,
    /// Threads of the run.
    pub threads: usize,
    /// Times, counts and digests.
    pub outcome: RunOutcome,
    /// Every pose as it was known when its frame came; of live sensors the first 36,000.
    pub poses: Vec<PublishedState>,
    /// What else was published, to be judged by the truth; of replayed and simulated flights whose truth is known.
    pub published: Option<Published>,
    /// Faults that were injected.
    pub injected: Vec<InjectedFault>,
}

impl Flown {
    /// The poses in the map as they were known when their frames came, where they were.
    pub fn poses_in_map(&self) -> Vec<StampedPose> {
        let in_map =
            |p: &PublishedState| Some(StampedPose { stamp: p.stamp, pose: p.pose_m_o? * p.pose_o_b });
        self.poses.iter().filter_map(in_map).collect()
    }

    /// The poses in the map by all that was known at the end; empty where places are switched off.
    pub fn final_poses(&self) -> Vec<StampedPose> {
        let Some(places) = &self.outcome.places else { return Vec::new() };
        let corrected = |p: &PublishedState| {
            let passing = Passing { stamp: p.stamp, pose_o_b: p.pose_o_b, reset_counter: p.reset_counter };
            Some(StampedPose { stamp: p.stamp, pose: places.mapper.corrected(&passing)? })
        };
        self.poses.iter().filter_map(corrected).collect()
    }
}

/// Runs a flight to its end, or until `control` says so. `subscribers` listen to it.
///
/// # Errors
/// When a driver cannot go on, or a thread cannot be had.
pub fn fly(
    flight: Flight,
    options: &RunOptions,
    control: &Control,
    subscribers: Vec<&mut dyn Subscriber>,
) -> Result<Flown, FlightError> {
    let Flight { config, imu, stereo, truth, name, map, stamps, first_reset_counter, injected, .. } = flight;
    let expected = stereo.expected_frames().and_then(|frames| usize::try_from(frames).ok());
    let is_judged = stamps == Stamps::Replayed && !matches!(truth, Truth::None);
    let frames = match stamps {
        Stamps::OfHost => None,
        Stamps::Replayed => Some(expected.unwrap_or(0)),
    };
    let mut published = PublishedStates::with_room_for(frames, &config, is_judged);
    let mut everyone: Vec<&mut dyn Subscriber> = vec![&mut published];
    everyone.extend(subscribers.into_iter().map(|subscriber| subscriber as &mut dyn Subscriber));
    let streams = Streams { imu, stereo, map: map.map(|known| known.map), stamps, first_reset_counter };
    let outcome = pipeline::run(&config, streams, options, control, &mut Several(everyone))?;
    let (poses, published) = published.into_kept();
    Ok(Flown { name, config, truth, threads: options.threads, outcome, poses, published, injected })
}
