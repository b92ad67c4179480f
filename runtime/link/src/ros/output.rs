//! ROS 2 as an output of the records of a flight, over rings to a thread of its own.

use super::identity::Identity;
use super::publisher::{LOOK_PERIOD, RosPublisher};
use crate::net::{CommandRelay, NetError};
use nalgebra::UnitQuaternion;
use plumbline_config::ValidConfig;
use plumbline_record::local::content::LocalRecord;
use plumbline_rings::Stamps;
use plumbline_rings::lane::{LaneReader, LaneWriter, lane};
use plumbline_rings::worker::Worker;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use tokio::sync::Notify;

/// Records that wait for the network: a quarter of a second of odometry, with poses in the map and states at instants among it.
const RING: usize = 116;

/// The way out to ROS 2, for one run.
#[derive(Debug)]
pub struct RosOutput {
    _worker: Worker,
}

#[derive(Debug)]
struct RosOutputState {
    bell: Notify,
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
        let shared = Arc::new(RosOutputState { bell: Notify::new(), stop: AtomicBool::new(false) });
        let (lane, waiting, _) = lane(RING);
        let feed = RosFeed { shared: Arc::clone(&shared), lane };
        let identity = Identity {
            options: config.ros.clone(),
            vehicle: config.network.vehicle.clone(),
            rot_v_b,
            stamps,
        };
        let publisher = RosPublisher::start(identity, commands)?;
        // Zenoh wants a runtime of several threads, and uses one.
        let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build()?;
        let theirs = Arc::clone(&shared);
        let stop = move || {
            shared.stop.store(true, Ordering::Relaxed);
            shared.bell.notify_one();
        };
        let work = move || runtime.block_on(publish(publisher, waiting, &theirs));
        Ok((Self { _worker: Worker::start("plumbline-ros2", stop, work)? }, feed))
    }
}

async fn publish(mut publisher: RosPublisher, mut waiting: LaneReader<LocalRecord>, shared: &RosOutputState) {
    loop {
        let is_last = shared.stop.load(Ordering::Relaxed);
        publisher.look().await;
        while let Some(record) = waiting.pop() {
            match record {
                LocalRecord::Odometry(odometry, _) => publisher.odometry(&odometry).await,
                LocalRecord::Instant(answer, _) => publisher.instant(&answer).await,
                LocalRecord::MapEstimate(newest) => publisher.map = Some(newest),
                _ => {}
            }
        }
        if is_last {
            return publisher.stop().await;
        }
        let _ = tokio::time::timeout(LOOK_PERIOD, shared.bell.notified()).await;
    }
}

/// Records of a flight on their way to ROS 2.
#[derive(Debug)]
pub struct RosFeed {
    shared: Arc<RosOutputState>,
    lane: LaneWriter<LocalRecord>,
}

impl RosFeed {
    /// Takes a record, if it is one that ROS 2 receives.
    pub fn take(&mut self, record: &LocalRecord) {
        use LocalRecord::{Instant, MapEstimate, Odometry};
        if matches!(record, Odometry(..) | Instant(..) | MapEstimate(_)) {
            self.lane.push(record.clone());
            self.shared.bell.notify_one();
        }
    }
}
