//! The local socket as an output of a flight.

use super::LocalError;
use super::door::Door;
use super::listener::{
    FrontEndListener, Handed, PlacesListener, Shared, TickListener, WindowListener, Writers,
};
use super::picture::Shot;
use super::server::Server;
use super::words::{Admission, LinkWord, LinkWords};
use crate::flight::Output;
use crate::pipeline::listener::{Listener, Producer, Subscriber};
use crate::pipeline::{Control, Stamps};
use crate::schedule::lane::LaneWriter;
use crate::schedule::watchdog::Pulse;
use crate::sensor_board::SensorBoard;
use plumbline_config::ValidConfig;
use plumbline_estimator::Odometry;
use plumbline_record::digest::config_hash;
use plumbline_record::messages::Configuration;
use plumbline_record::said::FullEstimate;
use plumbline_record::{InstantAnswer, Said};
use std::os::unix::net::UnixStream;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::sync::mpsc::{Sender, channel};
use std::thread::JoinHandle;

/// Entrance for the network process, which does not come by the socket's path.
#[derive(Clone, Debug)]
pub struct LinkDoor {
    admissions: Sender<Admission>,
    shared: Arc<Shared>,
}

impl LinkDoor {
    /// Serves `stream` with all rights; words of its reader go to `words`. Returns whether the flight still serves anybody.
    pub fn admit(&self, stream: UnixStream, words: Sender<LinkWord>) -> bool {
        let is_served = self.admissions.send(Admission { stream, words: LinkWords(words) }).is_ok();
        self.shared.bell.ring();
        is_served
    }
}

/// The local socket of a run.
#[derive(Debug)]
pub struct LocalSocket {
    shared: Arc<Shared>,
    /// Taken by the listeners of the run.
    odometry: Option<OdometryWriters>,
    estimates: Option<EstimateWriters>,
    shot: Option<Shot>,
    admissions: Sender<Admission>,
    thread: Option<JoinHandle<()>>,
}

/// Writing ends of the tick's thread.
type OdometryWriters = (LaneWriter<Handed<Odometry>>, LaneWriter<Handed<InstantAnswer>>);

/// Writing ends of the window's thread.
type EstimateWriters = (LaneWriter<Handed<FullEstimate>>, LaneWriter<Said>);

impl LocalSocket {
    /// Makes the socket of `local.path`, where one is named, and serves its readers from a thread of normal priority.
    ///
    /// # Errors
    /// When the socket cannot be made, or there can be no thread.
    pub fn start(config: &ValidConfig, stamps: Stamps, control: Arc<Control>) -> Result<Self, LocalError> {
        let door = (!config.local.path.is_empty()).then(|| Door::open(&config.local)).transpose()?;
        let (shared, writers, waiting) = Shared::new(config)?;
        let shared = Arc::new(shared);
        let (admissions, admitted) = channel();
        let configuration = Configuration {
            toml: config.to_toml().unwrap_or_default(),
            sha256: config_hash(config),
            stamps_of_host: stamps == Stamps::OfHost,
            version: env!("CARGO_PKG_VERSION").into(),
        };
        let shot = Shot::new(config);
        let server =
            Server::new((Arc::clone(&shared), waiting), door, admitted, control, &configuration, &shot)?;
        let theirs = Arc::clone(&shared);
        let thread = std::thread::Builder::new().name("local-socket".into()).spawn(move || {
            if catch_unwind(AssertUnwindSafe(|| server.run())).is_err() {
                theirs.pulse.die();
            }
        })?;
        let Writers { odometry, instants, estimates, others } = writers;
        Ok(Self {
            shared,
            odometry: Some((odometry, instants)),
            estimates: Some((estimates, others)),
            shot: Some(shot),
            admissions,
            thread: Some(thread),
        })
    }

    /// Entrance for the network process.
    #[must_use]
    pub fn link_door(&self) -> LinkDoor {
        LinkDoor { admissions: self.admissions.clone(), shared: Arc::clone(&self.shared) }
    }

    /// Where the state of live sensors is posted.
    #[must_use]
    pub fn sensor_board(&self) -> SensorBoard {
        let shared = Arc::clone(&self.shared);
        SensorBoard::new(Arc::clone(&self.shared.sensors), move || shared.bell.ring())
    }

    fn end(&mut self) {
        self.shared.stop.store(true, Ordering::Release);
        self.shared.bell.ring();
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

impl Drop for LocalSocket {
    fn drop(&mut self) {
        self.end();
    }
}

impl Output for LocalSocket {
    fn stop(mut self: Box<Self>) {
        self.end();
    }
}

impl Subscriber for LocalSocket {
    fn listener(&mut self, producer: Producer) -> Box<dyn Listener> {
        let shared = Arc::clone(&self.shared);
        match producer {
            Producer::Tick => match self.odometry.take() {
                Some((odometry, instants)) => Box::new(TickListener::new(shared, odometry, instants)),
                None => Box::new(()),
            },
            Producer::Window => match self.estimates.take() {
                Some((estimates, others)) => Box::new(WindowListener { shared, estimates, others }),
                None => Box::new(()),
            },
            Producer::FrontEnd => match self.shot.take() {
                Some(shot) => Box::new(FrontEndListener::new(shared, shot)),
                None => Box::new(()),
            },
            Producer::Places => Box::new(PlacesListener(shared)),
            Producer::Watchdog => Box::new(()),
        }
    }

    fn pulses(&self, adopt: &mut dyn FnMut(Arc<Pulse>)) {
        adopt(Arc::clone(&self.shared.pulse));
    }
}
