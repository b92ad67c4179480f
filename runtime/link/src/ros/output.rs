//! ROS 2 as an output of the records of a flight: odometry, and where it lies in the map, over rings to a thread of its own.

use super::publisher::RosPublisher;
use crate::net::NetError;
use crate::net::task_bell::TaskBell;
use nalgebra::UnitQuaternion;
use plumbline_config::options::RosConfig;
use plumbline_estimator::Odometry;
use plumbline_estimator::places::MapEstimate;
use plumbline_flight::pipeline::Stamps;
use plumbline_flight::schedule::lane::{LaneReader, LaneWriter, lane};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;

/// Odometry that waits for the network: a quarter of a second.
const ODOMETRY_RING: usize = 50;
/// Words on where it lies in the map: only the newest counts.
const MAP_RING: usize = 4;

/// The way out to ROS 2, for one run.
#[derive(Debug)]
pub struct RosOutput {
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

#[derive(Debug)]
struct Shared {
    bell: TaskBell,
    stop: AtomicBool,
}

impl RosOutput {
    /// Begins to look for the router; returns at once. `rot_v_b` takes coordinates from the IMU to the vehicle,
    /// `stamps` says whose those of the odometry are.
    ///
    /// # Errors
    /// When no thread can be had.
    pub fn start(
        options: &RosConfig,
        vehicle: &str,
        rot_v_b: UnitQuaternion<f64>,
        stamps: Stamps,
    ) -> Result<(Self, RosFeed), NetError> {
        let shared = Arc::new(Shared { bell: TaskBell::new()?, stop: AtomicBool::new(false) });
        let (writer, reader, _) = lane(ODOMETRY_RING);
        let (map_writer, map_reader, _) = lane(MAP_RING);
        let publisher = RosPublisher::start(options, vehicle, rot_v_b, stamps)?;
        // Zenoh wants a runtime of several threads, and uses one.
        let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build()?;
        let theirs = Arc::clone(&shared);
        let thread = std::thread::Builder::new()
            .name("plumbline-ros2".into())
            .spawn(move || runtime.block_on(publish(publisher, reader, map_reader, &theirs)))?;
        let feed = RosFeed { shared: Arc::clone(&shared), odometry: writer, map: map_writer };
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

async fn publish(
    mut publisher: RosPublisher,
    mut waiting: LaneReader<Odometry>,
    mut map: LaneReader<MapEstimate>,
    shared: &Shared,
) {
    let bell = match shared.bell.listen() {
        Ok(bell) => bell,
        Err(error) => return tracing::error!("cannot publish to ROS 2: {error}"),
    };
    loop {
        let is_last = shared.stop.load(Ordering::Relaxed);
        while let Some(newest) = map.pop() {
            publisher.follow(newest);
        }
        while let Some(odometry) = waiting.pop() {
            publisher.odometry(&odometry).await;
        }
        if is_last {
            return publisher.stop().await;
        }
        bell.rung().await;
    }
}

/// Records of a flight on their way to ROS 2.
#[derive(Debug)]
pub struct RosFeed {
    shared: Arc<Shared>,
    odometry: LaneWriter<Odometry>,
    map: LaneWriter<MapEstimate>,
}

impl RosFeed {
    /// Takes odometry.
    pub fn odometry(&mut self, odometry: &Odometry) {
        self.odometry.push(odometry.clone());
        self.shared.bell.ring();
    }

    /// Takes the pose of the odometry frame in the map.
    pub fn map_estimate(&mut self, estimate: &MapEstimate) {
        self.map.push(estimate.clone());
    }
}
