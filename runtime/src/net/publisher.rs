//! A vehicle's presence on the network: hands what a run produces to the network thread, and never blocks the run.

use super::endpoints::Endpoints;
use super::error::NetError;
use super::listener::{FrontEndListener, PlacesListener, TickListener, WindowListener};
use super::pace::Rates;
use super::proto;
use super::publishers::Publishers;
use super::rings::{LaneWriter, Rings};
use super::security;
use super::vehicle::Vehicle;
use crate::pipeline::Control;
use crate::pipeline::listener::{Listener, Producer, Subscriber};
use plumbline_config::ValidConfig;
use plumbline_estimator::places::MapEstimate;
use plumbline_estimator::{Estimate, Odometry};
use std::sync::Arc;
use std::thread::JoinHandle;

/// What the window's thread fills: estimates with their times, ms, and where the odometry lies in the map.
type EstimateLanes = (LaneWriter<(Estimate, f64)>, LaneWriter<MapEstimate>);

/// A vehicle's presence on the network, for one run.
#[derive(Debug)]
pub struct Publisher {
    rings: Arc<Rings>,
    /// Taken by the listeners of the run.
    odometry: Option<LaneWriter<(Odometry, i64)>>,
    estimates: Option<EstimateLanes>,
    camera_hz: f64,
    thread: Option<JoinHandle<()>>,
}

impl Publisher {
    /// Opens the session and declares everything; returns when others can see the vehicle.
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
                sha256: crate::pipeline::digest::config_hash(config),
            },
            offers_camera: config.network.camera,
            rot_v_b: config.vehicle.rot_v_b(),
            refusal: security::refusal(config.network.commands, endpoints),
            control,
        });
        if let Some(refusal) = &vehicle.refusal {
            tracing::info!("{refusal}");
        } else if let Some(exposure) = security::exposure(endpoints) {
            tracing::warn!("{exposure}");
        }
        let (rings, written, to_send) = Rings::new(config, rates.path_poses)?;
        let rings = Arc::new(rings);
        let (ready, wait) = std::sync::mpsc::sync_channel(1);
        let (theirs, endpoints) = (Arc::clone(&rings), endpoints.clone());
        let runtime = tokio::runtime::Builder::new_multi_thread()
            .worker_threads(1)
            .thread_name("plumbline-net")
            .enable_all()
            .build()?;
        let thread = std::thread::Builder::new().name("plumbline-net".into()).spawn(move || {
            runtime.block_on(async {
                match Publishers::declare(&endpoints, vehicle, rates).await {
                    Ok(publishers) => {
                        let _ = ready.send(Ok(()));
                        publishers.run(&theirs, to_send).await;
                    }
                    Err(error) => drop(ready.send(Err(error))),
                }
            });
        })?;
        let outcome = wait.recv().unwrap_or_else(|_| {
            Err(NetError::Thread(std::io::Error::other("it ended before the session was open")))
        });
        outcome.map(|()| Self {
            rings,
            odometry: Some(written.odometry),
            estimates: Some((written.estimates, written.places)),
            camera_hz: rates.camera_hz,
            thread: Some(thread),
        })
    }

    /// Sends what is left in the rings and closes the session.
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

impl Subscriber for Publisher {
    fn listener(&mut self, producer: Producer) -> Box<dyn Listener> {
        let rings = Arc::clone(&self.rings);
        match producer {
            Producer::Tick => match self.odometry.take() {
                Some(odometry) => Box::new(TickListener { rings, odometry }),
                None => Box::new(()),
            },
            Producer::Window => match self.estimates.take() {
                Some((estimates, places)) => Box::new(WindowListener { rings, estimates, places }),
                None => Box::new(()),
            },
            Producer::FrontEnd => Box::new(FrontEndListener::new(rings, self.camera_hz)),
            Producer::Places => Box::new(PlacesListener(rings)),
            Producer::Watchdog => Box::new(()),
        }
    }
}
