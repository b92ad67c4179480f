//! ROS 2 as a listener of a run: odometry from the tick, over a ring, to a thread of its own.

use super::publisher::RosPublisher;
use crate::net::NetError;
use crate::net::rings::{LaneReader, LaneWriter, lane};
use crate::net::task_bell::TaskBell;
use crate::pipeline::listener::{Listener, Producer, Subscriber};
use nalgebra::UnitQuaternion;
use plumbline_config::options::RosConfig;
use plumbline_estimator::Odometry;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;

/// Odometry that waits for the network: a quarter of a second.
const ODOMETRY_RING: usize = 50;

/// The way out to ROS 2, for one run.
#[derive(Debug)]
pub struct RosOutput {
    shared: Arc<Shared>,
    /// Taken by the listener of the tick.
    odometry: Option<LaneWriter<Odometry>>,
    thread: Option<JoinHandle<()>>,
}

#[derive(Debug)]
struct Shared {
    bell: TaskBell,
    stop: AtomicBool,
}

impl RosOutput {
    /// Begins to look for the router; returns at once. `rot_v_b` takes coordinates from the IMU to the vehicle.
    ///
    /// # Errors
    /// When no thread can be had.
    pub fn start(options: &RosConfig, vehicle: &str, rot_v_b: UnitQuaternion<f64>) -> Result<Self, NetError> {
        let shared = Arc::new(Shared { bell: TaskBell::new()?, stop: AtomicBool::new(false) });
        let (writer, reader, _) = lane(ODOMETRY_RING);
        let publisher = RosPublisher::start(options, vehicle, rot_v_b)?;
        // Zenoh wants a runtime of several threads, and uses one.
        let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build()?;
        let theirs = Arc::clone(&shared);
        let thread = std::thread::Builder::new()
            .name("plumbline-ros2".into())
            .spawn(move || runtime.block_on(publish(publisher, reader, &theirs)))?;
        Ok(Self { shared, odometry: Some(writer), thread: Some(thread) })
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

async fn publish(mut publisher: RosPublisher, mut waiting: LaneReader<Odometry>, shared: &Shared) {
    let bell = match shared.bell.listen() {
        Ok(bell) => bell,
        Err(error) => return tracing::error!("nothing is published to ROS 2: {error}"),
    };
    loop {
        let is_last = shared.stop.load(Ordering::Relaxed);
        while let Some(odometry) = waiting.pop() {
            publisher.odometry(&odometry).await;
        }
        if is_last {
            return publisher.stop().await;
        }
        bell.rung().await;
    }
}

impl Subscriber for RosOutput {
    fn listener(&mut self, producer: Producer) -> Box<dyn Listener> {
        match self.odometry.take_if(|_| producer == Producer::Tick) {
            Some(odometry) => Box::new(TickListener { shared: Arc::clone(&self.shared), odometry }),
            None => Box::new(()),
        }
    }
}

struct TickListener {
    shared: Arc<Shared>,
    odometry: LaneWriter<Odometry>,
}

impl Listener for TickListener {
    fn odometry(&mut self, odometry: &Odometry) {
        self.odometry.push(odometry.clone());
        self.shared.bell.ring();
    }
}
