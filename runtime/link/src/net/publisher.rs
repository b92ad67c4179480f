//! A vehicle's presence on the network: hands the records of its flight to the network thread.

use super::commands::CommandRelay;
use super::endpoints::Endpoints;
use super::error::NetError;
use super::pace::Rates;
use super::publishers::Publishers;
use super::relay::{Feed, FeedReaders, RelayState};
use super::security;
use super::vehicle::VehicleFacts;
use plumbline_config::ValidConfig;
use plumbline_record::local::request::Failure;
use plumbline_record::local::request::Request;
use plumbline_record::messages::Configuration;
use plumbline_record::topics::Topic;
use plumbline_rings::worker::Worker;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::sync::mpsc::{RecvTimeoutError, SyncSender, sync_channel};
use std::time::Duration;

/// A start that is patient waits this long for what is wrong with the endpoints.
const BRIEFLY: Duration = Duration::from_millis(300);
/// A session that cannot be opened is tried again this often.
const RETRY: Duration = Duration::from_millis(500);

/// A vehicle's presence on the network, for one flight.
#[derive(Debug)]
pub struct Publisher {
    _worker: Worker,
}

impl Publisher {
    /// Opens the session and declares everything; returns when others can see the vehicle. A start that is patient returns soon
    /// in any case, and retries while the session cannot be opened.
    ///
    /// # Errors
    /// When the session cannot be opened; of a patient start, when the endpoints cannot be what was meant.
    pub fn start(
        config: &ValidConfig,
        endpoints: &Endpoints,
        commands: Arc<CommandRelay>,
        is_patient: bool,
    ) -> Result<(Self, Feed), NetError> {
        let rates = Rates::of(endpoints.link);
        let configuration = Configuration {
            toml: config.to_toml().unwrap_or_default(),
            sha256: plumbline_record::digest::config_hash(config),
            version: env!("CARGO_PKG_VERSION").into(),
            stamps_of_host: false,
        };
        let vehicle = Arc::new(VehicleFacts {
            name: endpoints.vehicle.clone(),
            configuration,
            offers_camera: config.network.camera,
            rot_v_b: config.vehicle.rot_v_b(),
            refusal: security::refusal(config.network.commands, endpoints),
            commands,
        });
        if let Some(refusal) = &vehicle.refusal {
            tracing::info!("{refusal}");
        } else if let Some(exposure) = security::exposure(endpoints) {
            tracing::warn!("{exposure}");
        }
        let (feed, waiting, shared) = Feed::new(rates.hz(Topic::Picture));
        let (ready, wait) = sync_channel(1);
        let (theirs, endpoints) = (Arc::clone(&shared), endpoints.clone());
        let start = Start { endpoints, vehicle, rates, is_patient, ready };
        let runtime = tokio::runtime::Builder::new_multi_thread()
            .worker_threads(1)
            .thread_name("plumbline-net")
            .enable_all()
            .build()?;
        let worker = Worker::start(
            "plumbline-net",
            move || shared.end(),
            move || runtime.block_on(start.publish(&theirs, waiting)),
        )?;
        let outcome = match wait.recv_timeout(if is_patient { BRIEFLY } else { Duration::MAX }) {
            Ok(outcome) => outcome,
            // It goes on trying.
            Err(RecvTimeoutError::Timeout) => Ok(()),
            Err(RecvTimeoutError::Disconnected) => {
                Err(NetError::Thread(std::io::Error::other("it ended before the session was open")))
            }
        };
        outcome.map(|()| (Self { _worker: worker }, feed))
    }
}

/// Initial state of the network's thread.
struct Start {
    endpoints: Endpoints,
    vehicle: Arc<VehicleFacts>,
    rates: Rates,
    is_patient: bool,
    ready: SyncSender<Result<(), NetError>>,
}

impl Start {
    /// Opens the session, says what became of that, and publishes until the flight is over.
    async fn publish(self, shared: &Arc<RelayState>, waiting: FeedReaders) {
        let opened = match self.is_patient {
            true => self.declare_patiently(shared).await,
            false => self.declare().await.map(Some),
        };
        match opened {
            Ok(publishers) => {
                let _ = self.ready.send(Ok(()));
                if let Some(publishers) = publishers {
                    publishers.run(shared, waiting).await;
                }
            }
            Err(error) => {
                let failure = Failure { is_usage: error.is_usage(), words: error.to_string() };
                if self.ready.send(Err(error)).is_err() {
                    // The start did not wait for it.
                    self.vehicle.commands.report(&Request::Failed(failure));
                }
            }
        }
    }

    async fn declare(&self) -> Result<Publishers, NetError> {
        Publishers::declare(&self.endpoints, Arc::clone(&self.vehicle), self.rates).await
    }

    /// Opens the session as soon as that can be done; `None` when the flight is over before.
    async fn declare_patiently(&self, shared: &RelayState) -> Result<Option<Publishers>, NetError> {
        let mut told = String::new();
        loop {
            let error = tokio::select! {
                () = is_over(shared) => return Ok(None),
                opened = self.declare() => match opened {
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
            if error.is_usage() {
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
async fn is_over(shared: &RelayState) {
    while !shared.stop.load(Ordering::Relaxed) {
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
}
