//! A vehicle's presence on the network, seen from the run: takes what it produces, and never holds it up.

use super::now_ns;
use super::pace::Rates;
use super::proto;
use super::publishers::Publishers;
use super::rings::Rings;
use super::security;
use super::session::{Endpoints, NetError};
use super::tap::NetworkTap;
use crate::pipeline::tap::Tap;
use crate::pipeline::{Control, Sink};
use nalgebra::UnitQuaternion;
use plumbline_config::ValidConfig;
use plumbline_estimator::{Estimate, Odometry};
use std::sync::Arc;
use std::thread::JoinHandle;

/// What others may know of a vehicle, and ask of it.
#[derive(Debug)]
pub struct Vehicle {
    /// Its name in the keys.
    pub name: String,
    /// The configuration in force.
    pub configuration: proto::Configuration,
    /// Camera pictures can be had.
    pub offers_camera: bool,
    /// Takes coordinates from the IMU `B` to the vehicle `V` (x forward, y left, z up).
    pub rot_v_b: UnitQuaternion<f64>,
    /// Why commands are refused, if they are.
    pub refusal: Option<String>,
    /// Takes commands.
    pub control: Arc<Control>,
}

/// A vehicle's presence on the network. As a [`Sink`] it takes what the pipeline produces.
#[derive(Debug)]
pub struct Publisher {
    rings: Arc<Rings>,
    camera_hz: f64,
    thread: Option<JoinHandle<()>>,
}

impl Publisher {
    /// Opens the session and declares everything, for ROS 2 too where that is enabled; returns when others can
    /// see the vehicle.
    ///
    /// # Errors
    /// When the session cannot be opened.
    pub fn start(
        config: &ValidConfig,
        endpoints: &Endpoints,
        control: Arc<Control>,
    ) -> Result<Self, NetError> {
        let rates = Rates::of(endpoints.link);
        let vehicle = Arc::new(Vehicle {
            name: endpoints.vehicle.clone(),
            configuration: proto::Configuration {
                toml: config.to_toml().unwrap_or_default(),
                sha256: crate::report::config_hash(config),
            },
            offers_camera: config.network.camera,
            rot_v_b: config.vehicle.rot_v_b(),
            refusal: security::refusal(config.network.commands, endpoints),
            control,
        });
        if let Some(refusal) = &vehicle.refusal {
            tracing::info!("{refusal}");
        }
        let rings = Arc::new(Rings::new(config));
        let (ready, wait) = std::sync::mpsc::sync_channel(1);
        let (theirs, endpoints, ros) = (Arc::clone(&rings), endpoints.clone(), config.ros.clone());
        let runtime = tokio::runtime::Builder::new_multi_thread()
            .worker_threads(1)
            .thread_name("plumbline-net")
            .enable_all()
            .build()?;
        let thread = std::thread::Builder::new().name("plumbline-net".into()).spawn(move || {
            runtime.block_on(async {
                match Publishers::declare(&endpoints, vehicle, rates, &ros).await {
                    Ok(publishers) => {
                        let _ = ready.send(Ok(()));
                        publishers.run(&theirs).await;
                    }
                    Err(error) => drop(ready.send(Err(error))),
                }
            });
        })?;
        let outcome = wait.recv().unwrap_or_else(|_| {
            Err(NetError::Thread(std::io::Error::other("it ended before the session was open")))
        });
        outcome.map(|()| Self { rings, camera_hz: rates.camera_hz, thread: Some(thread) })
    }

    /// Listens to a run, for what its results do not say.
    #[must_use]
    pub fn tap(&self) -> Box<dyn Tap> {
        Box::new(NetworkTap::new(Arc::clone(&self.rings), self.camera_hz))
    }

    /// Sends what is left, and takes the vehicle off the network.
    pub fn stop(mut self) {
        self.end();
    }

    fn end(&mut self) {
        self.rings.end();
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

impl Drop for Publisher {
    fn drop(&mut self) {
        self.end();
    }
}

impl Sink for Publisher {
    fn estimate(&mut self, estimate: &Estimate, frame_ms: f64) {
        self.rings.estimates.push((estimate.clone(), frame_ms));
        self.rings.wake.notify_one();
    }

    fn odometry(&mut self, odometry: &Odometry) {
        self.rings.odometry.push((odometry.clone(), now_ns()));
        self.rings.odometry_wake.notify_one();
        if let Some(ros) = &self.rings.ros {
            ros.push(odometry.clone());
            self.rings.wake.notify_one();
        }
    }
}
