//! ROS 2 as an output of the records of a flight, over rings to a thread of its own.

use super::identity::Identity;
use super::publisher::{LOOK_PERIOD, RosPublisher};
use super::scene::RosScene;
use crate::net::pace::Rates;
use crate::net::relay::Relayed;
use crate::net::task_bell::TaskBell;
use crate::net::{CommandRelay, Endpoints, NetError, security};
use nalgebra::UnitQuaternion;
use plumbline_config::ValidConfig;
use plumbline_estimator::Odometry;
use plumbline_record::InstantAnswer;
use plumbline_record::local::content::LocalRecord;
use plumbline_record::local::picture::Shot;
use plumbline_rings::Stamps;
use plumbline_rings::lane::{LaneReader, LaneWriter, lane};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;

/// Odometry that waits for the network: a quarter of a second.
const ODOMETRY_RING: usize = 50;
/// Records of the scene that wait: one with each frame, and a few with each keyframe.
const SCENE_RING: usize = 32;
/// Pictures that wait: only the newest counts.
const PICTURE_RING: usize = 2;
/// States at instants that wait.
const INSTANT_RING: usize = 64;

/// The way out to ROS 2, for one run.
#[derive(Debug)]
pub struct RosOutput {
    shared: Arc<RosOutputState>,
    thread: Option<JoinHandle<()>>,
}

#[derive(Debug)]
struct RosOutputState {
    bell: TaskBell,
    stop: AtomicBool,
}

impl RosOutput {
    /// Starts to look for the router; returns at once. `rot_v_b` takes coordinates from the IMU to the vehicle,
    /// `stamps` is the clock domain of the odometry.
    ///
    /// # Errors
    /// When no thread can be had.
    pub fn start(
        config: &ValidConfig,
        rot_v_b: UnitQuaternion<f64>,
        stamps: Stamps,
        commands: Arc<CommandRelay>,
    ) -> Result<(Self, RosFeed), NetError> {
        let shared = Arc::new(RosOutputState { bell: TaskBell::new()?, stop: AtomicBool::new(false) });
        let (feed, waiting) = rings(&shared);
        let identity = Identity {
            options: config.ros.clone(),
            vehicle: config.network.vehicle.clone(),
            rot_v_b,
            stamps,
            has_map: config.estimator.places.enabled,
        };
        let scene = RosScene::new(&Rates::of(config.ros.link));
        // Commands come over the router, which shows no certificate of theirs.
        let router = Endpoints { connect: vec![config.ros.router.clone()], ..Endpoints::default() };
        let refusal = security::refusal(config.network.commands, &router);
        let publisher = RosPublisher::start(identity, scene, commands, refusal)?;
        // Zenoh wants a runtime of several threads, and uses one.
        let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build()?;
        let theirs = Arc::clone(&shared);
        let thread = std::thread::Builder::new()
            .name("plumbline-ros2".into())
            .spawn(move || runtime.block_on(publish(publisher, waiting, &theirs)))?;
        Ok((Self { shared, thread: Some(thread) }, feed))
    }

    /// Sends what is left, and takes the node off the network.
    pub fn stop(mut self) {
        self.end();
    }

    fn end(&mut self) {
        self.shared.stop.store(true, Ordering::Relaxed);
        self.shared.bell.ring();
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

impl Drop for RosOutput {
    fn drop(&mut self) {
        self.end();
    }
}

/// Reading ends of the rings of a [`RosFeed`].
struct Waiting {
    odometry: LaneReader<Odometry>,
    scene: LaneReader<Relayed>,
    shots: LaneReader<Shot>,
    instants: LaneReader<InstantAnswer>,
}

fn rings(shared: &Arc<RosOutputState>) -> (RosFeed, Waiting) {
    let (odometry_in, odometry, _) = lane(ODOMETRY_RING);
    let (scene_in, scene, _) = lane(SCENE_RING);
    let (shots_in, shots, _) = lane(PICTURE_RING);
    let (instants_in, instants, _) = lane(INSTANT_RING);
    let feed = RosFeed {
        shared: Arc::clone(shared),
        odometry: odometry_in,
        scene: scene_in,
        shots: shots_in,
        instants: instants_in,
    };
    (feed, Waiting { odometry, scene, shots, instants })
}

async fn publish(mut publisher: RosPublisher, mut waiting: Waiting, shared: &RosOutputState) {
    let bell = match shared.bell.listen() {
        Ok(bell) => bell,
        Err(error) => return tracing::error!("cannot publish to ROS 2: {error}"),
    };
    loop {
        let is_last = shared.stop.load(Ordering::Relaxed);
        publisher.look().await;
        while let Some(record) = waiting.scene.pop() {
            publisher.scene.take(record);
        }
        while let Some(odometry) = waiting.odometry.pop() {
            publisher.odometry(&odometry).await;
        }
        while let Some(answer) = waiting.instants.pop() {
            publisher.instant(&answer).await;
        }
        while let Some(shot) = waiting.shots.pop() {
            publisher.picture(&shot).await;
        }
        if is_last {
            return publisher.stop().await;
        }
        let _ = tokio::time::timeout(LOOK_PERIOD, bell.rung()).await;
    }
}

/// Records of a flight on their way to ROS 2.
#[derive(Debug)]
pub struct RosFeed {
    shared: Arc<RosOutputState>,
    odometry: LaneWriter<Odometry>,
    scene: LaneWriter<Relayed>,
    shots: LaneWriter<Shot>,
    instants: LaneWriter<InstantAnswer>,
}

impl RosFeed {
    /// Takes a record with its message, if it is one that ROS 2 is shown.
    pub fn take(&mut self, record: &LocalRecord, message: &[u8]) {
        match record {
            LocalRecord::Odometry(odometry, _) => {
                self.odometry.push((**odometry).clone());
                self.shared.bell.ring();
            }
            LocalRecord::Instant(answer, _) => {
                self.instants.push((**answer).clone());
                self.shared.bell.ring();
            }
            LocalRecord::Picture(shot) => {
                self.shots.push(shot.clone());
                self.shared.bell.ring();
            }
            record if RosScene::draws(record) => {
                // Only what is kept as it came needs its message.
                let message =
                    if matches!(record, LocalRecord::Other(_)) { message.to_vec() } else { Vec::new() };
                self.scene.push(Relayed { record: record.clone(), message });
            }
            _ => {}
        }
    }
}
