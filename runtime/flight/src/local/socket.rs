//! The local socket as an output of a flight.

use super::LocalError;
use super::door::Door;
use super::listener::{Lanes, RelayListener, SocketState};
use super::picture::Shot;
use super::server::Server;
use super::words::{Admission, LinkWord, LinkWords};
use crate::pipeline::listener::{Listener, Producer, Subscriber};
use crate::pipeline::{Control, Stamps};
use crate::schedule::watchdog::Pulse;
use crate::schedule::worker::Worker;
use crate::sensor_board::SensorBoard;
use plumbline_config::ValidConfig;
use plumbline_record::digest::config_hash;
use plumbline_record::messages::Configuration;
use std::os::unix::net::UnixStream;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::sync::mpsc::{Sender, channel};

/// Entrance for the network process, which does not come by the socket's path.
#[derive(Clone, Debug)]
pub struct LinkDoor {
    admissions: Sender<Admission>,
    shared: Arc<SocketState>,
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
    shared: Arc<SocketState>,
    /// Taken by the listeners of the run.
    writers: Lanes,
    shot: Option<Shot>,
    admissions: Sender<Admission>,
    _worker: Worker,
}

impl LocalSocket {
    /// Makes the socket of `local.path`, where one is named, and serves its readers from a thread of normal priority.
    ///
    /// # Errors
    /// When the socket cannot be made, or there can be no thread.
    pub fn start(config: &ValidConfig, stamps: Stamps, control: Arc<Control>) -> Result<Self, LocalError> {
        let door = (!config.local.path.is_empty()).then(|| Door::open(&config.local)).transpose()?;
        let (shared, writers, waiting) = SocketState::new(config)?;
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
        let (theirs, ours) = (Arc::clone(&shared), Arc::clone(&shared));
        let stop = move || {
            ours.stop.store(true, Ordering::Release);
            ours.bell.ring();
        };
        let worker = Worker::start("local-socket", stop, move || {
            if catch_unwind(AssertUnwindSafe(|| server.run())).is_err() {
                theirs.pulse.die();
            }
        })?;
        Ok(Self { shared, writers, shot: Some(shot), admissions, _worker: worker })
    }

    /// Entrance for the network process.
    pub fn link_door(&self) -> LinkDoor {
        LinkDoor { admissions: self.admissions.clone(), shared: Arc::clone(&self.shared) }
    }

    /// Where the state of live sensors is posted.
    pub fn sensor_board(&self) -> SensorBoard {
        let shared = Arc::clone(&self.shared);
        SensorBoard::new(Arc::clone(&self.shared.sensors), move || shared.bell.ring())
    }
}

impl Subscriber for LocalSocket {
    fn listener(&mut self, producer: Producer) -> Box<dyn Listener> {
        let Some(lane) = self.writers.get_mut(producer as usize).and_then(Option::take) else {
            return Box::new(());
        };
        let shot = self.shot.take_if(|_| producer == Producer::FrontEnd);
        Box::new(RelayListener::new(Arc::clone(&self.shared), lane, shot))
    }

    fn pulses(&self, adopt: &mut dyn FnMut(Arc<Pulse>)) {
        adopt(Arc::clone(&self.shared.pulse));
    }
}
