//! A vehicle's presence on the network: hands what a run produces to the network thread, and never blocks the run.

use super::endpoints::Endpoints;
use super::error::NetError;
use super::listener::{FrontEndListener, PlacesListener, TickListener, WindowListener};
use super::pace::Rates;
use super::picture::Shot;
use super::proto;
use super::publishers::{Course, End, Publishers};
use super::rings::{LaneWriter, Rings, ToSend};
use super::security;
use super::vehicle::Vehicle;
use plumbline_config::ValidConfig;
use plumbline_estimator::places::MapEstimate;
use plumbline_estimator::{Estimate, Odometry};
use plumbline_flight::flight::Output;
use plumbline_flight::pipeline::Control;
use plumbline_flight::pipeline::listener::{Listener, Producer, Subscriber};
use plumbline_flight::schedule::watchdog::Pulse;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::sync::mpsc::{RecvTimeoutError, SyncSender, sync_channel};
use std::thread::JoinHandle;
use std::time::Duration;

/// A start that is patient waits this long for what is wrong with the endpoints.
const BRIEFLY: Duration = Duration::from_millis(300);
/// A session that cannot be opened is tried again this often.
const RETRY: Duration = Duration::from_millis(500);

/// What the window's thread fills: estimates with their times, ms, and where the odometry lies in the map.
type EstimateLanes = (LaneWriter<(Estimate, f64)>, LaneWriter<MapEstimate>);

/// A vehicle's presence on the network, for one run.
#[derive(Debug)]
pub struct Publisher {
    rings: Arc<Rings>,
    /// Taken by the listeners of the run.
    odometry: Option<LaneWriter<(Odometry, i64)>>,
    estimates: Option<EstimateLanes>,
    /// At this rate, and the memory of one picture.
    pictures: Option<(f64, Shot)>,
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
        Self::begin(config, endpoints, control, false)
    }

    /// Starts publishing, and retries if the session cannot be opened yet. Returns at once when it is open, and soon in
    /// any case.
    ///
    /// # Errors
    /// When the endpoints cannot be what was meant.
    pub fn start_patiently(
        config: &ValidConfig,
        endpoints: &Endpoints,
        control: Arc<Control>,
    ) -> Result<Self, NetError> {
        Self::begin(config, endpoints, control, true)
    }

    fn begin(
        config: &ValidConfig,
        endpoints: &Endpoints,
        control: Arc<Control>,
        is_patient: bool,
    ) -> Result<Self, NetError> {
        let rates = Rates::of(endpoints.link);
        let vehicle = Arc::new(Vehicle {
            name: endpoints.vehicle.clone(),
            configuration: proto::Configuration {
                toml: config.to_toml().unwrap_or_default(),
                sha256: plumbline_flight::pipeline::digest::config_hash(config),
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
        let (ready, wait) = sync_channel(1);
        let (theirs, endpoints) = (Arc::clone(&rings), endpoints.clone());
        let start = Start { endpoints, vehicle, rates, is_patient, ready };
        let runtime = tokio::runtime::Builder::new_multi_thread()
            .worker_threads(1)
            .thread_name("plumbline-net")
            .enable_all()
            .build()?;
        let thread = std::thread::Builder::new().name("plumbline-net".into()).spawn(move || {
            let publish = start.publish(&theirs, to_send);
            if catch_unwind(AssertUnwindSafe(|| runtime.block_on(publish))).is_err() {
                theirs.pulse.die();
            }
        })?;
        let outcome = match wait.recv_timeout(if is_patient { BRIEFLY } else { Duration::MAX }) {
            Ok(outcome) => outcome,
            // It goes on trying.
            Err(RecvTimeoutError::Timeout) => Ok(()),
            Err(RecvTimeoutError::Disconnected) => {
                Err(NetError::Thread(std::io::Error::other("it ended before the session was open")))
            }
        };
        outcome.map(|()| Self {
            rings,
            odometry: Some(written.odometry),
            estimates: Some((written.estimates, written.places)),
            pictures: Some((rates.camera_hz, Shot::new(config))),
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

/// What the network's thread begins with.
struct Start {
    endpoints: Endpoints,
    vehicle: Arc<Vehicle>,
    rates: Rates,
    is_patient: bool,
    ready: SyncSender<Result<(), NetError>>,
}

impl Start {
    /// Opens the session, says what became of that, and publishes until the flight is over.
    async fn publish(self, rings: &Arc<Rings>, mut to_send: ToSend) {
        let mut course = Course::new(&self.rates);
        let opened = match self.is_patient {
            true => self.declare_patiently(rings, &course).await,
            false => self.declare(&course).await.map(Some),
        };
        let mut publishers = match opened {
            Ok(publishers) => {
                let _ = self.ready.send(Ok(()));
                publishers
            }
            Err(error) => return drop(self.ready.send(Err(error))),
        };
        while let Some(session) = publishers {
            if session.run(rings, &mut to_send, &mut course).await == End::FlightIsOver {
                return;
            }
            publishers = match self.declare_patiently(rings, &course).await {
                Ok(publishers) => publishers,
                Err(error) => {
                    return tracing::error!(
                        "cannot start the network: {error}; the flight continues without it"
                    );
                }
            };
        }
    }

    async fn declare(&self, course: &Course) -> Result<Publishers, NetError> {
        Publishers::declare(&self.endpoints, Arc::clone(&self.vehicle), self.rates, course).await
    }

    /// Opens the session as soon as that can be done; `None` when the flight is over before.
    async fn declare_patiently(
        &self,
        rings: &Rings,
        course: &Course,
    ) -> Result<Option<Publishers>, NetError> {
        let mut told = String::new();
        loop {
            let error = tokio::select! {
                () = is_over(rings) => return Ok(None),
                opened = self.declare(course) => match opened {
                    Ok(publishers) => {
                        if !told.is_empty() {
                            tracing::warn!("the network is available");
                        }
                        return Ok(Some(publishers));
                    }
                    Err(error) => error,
                },
            };
            // As a configuration that never flew: better told on the ground.
            if matches!(error, NetError::Endpoint { .. } | NetError::File { .. } | NetError::Datagrams { .. })
            {
                return Err(error);
            }
            let words = error.to_string();
            if told != words {
                tracing::warn!("{words}; the flight continues, retrying");
                told = words;
            }
            tokio::time::sleep(RETRY).await;
        }
    }
}

/// Waits until the flight is over.
async fn is_over(rings: &Rings) {
    while !rings.stop.load(Ordering::Relaxed) {
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
}

impl Drop for Publisher {
    fn drop(&mut self) {
        self.end();
    }
}

impl Output for Publisher {
    fn stop(self: Box<Self>) {
        Self::stop(*self);
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
            Producer::FrontEnd => match self.pictures.take() {
                Some((camera_hz, shot)) => Box::new(FrontEndListener::new(rings, camera_hz, shot)),
                None => Box::new(()),
            },
            Producer::Places => Box::new(PlacesListener(rings)),
            Producer::Watchdog => Box::new(()),
        }
    }

    fn pulses(&self, adopt: &mut dyn FnMut(Arc<Pulse>)) {
        adopt(Arc::clone(&self.rings.odometry_pulse));
        adopt(Arc::clone(&self.rings.pulse));
    }
}
