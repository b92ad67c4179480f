//! The network process: reads a flight from its local socket, publishes it, and brings commands back.

use crate::net::{CommandRelay, Endpoints, Feed, NetError, Publisher};
use crate::ros::{RosFeed, RosOutput};
use plumbline_client::{ClientError, Local};
use plumbline_config::options::{NetworkConfig, UnknownMounting};
use plumbline_config::{Config, ConfigError, ValidConfig};
use plumbline_record::local::content::LocalRecord;
use plumbline_record::local::record::{Kind, Kinds};
use plumbline_record::local::request::Failure;
use plumbline_record::local::request::Request;
use plumbline_record::messages::Configuration;
use plumbline_rings::Stamps;
use std::io;
use std::os::unix::net::UnixStream;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;
use thiserror::Error;

/// A flight that says nothing for so long after the connection is none.
const GREETING_PATIENCE: Duration = Duration::from_secs(5);
/// The stop flag is looked at this often.
const GLANCE: Duration = Duration::from_millis(50);
/// Records that the network needs: all but the main part of estimates, which are complete in others. Pictures are asked for while
/// somebody looks.
const WANTED: Kinds = Kinds::SUBSCRIBABLE.without(Kind::Estimate).without(Kind::Trail);

/// Options of the command line beside the configuration of the flight.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct LinkOptions {
    /// Endpoints to listen on besides `network.listen`.
    pub listen: Vec<String>,
    /// Endpoints to connect to besides `network.connect`.
    pub connect: Vec<String>,
    /// Open a session also without an endpoint.
    pub publish: bool,
    /// Retry a session that cannot be opened yet.
    pub is_patient: bool,
}

/// True if there is anything to publish over Zenoh.
pub fn has_network(config: &NetworkConfig, options: &LinkOptions) -> bool {
    let endpoints = Endpoints::of(config).and(&options.listen, &options.connect);
    options.publish || !endpoints.listen.is_empty() || !endpoints.connect.is_empty() || endpoints.scouting
}

/// End of a flight's service.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ended {
    /// The flight is over, and everything was sent.
    FlightOver,
    /// The flight has closed the socket without a word.
    FlightGone,
    /// It was asked to stop.
    Stopped,
}

/// Errors of the service of a flight.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum NetworkProcessError {
    /// The network cannot be used.
    #[error(transparent)]
    Net(#[from] NetError),
    /// The flight's records cannot be read.
    #[error(transparent)]
    Client(#[from] ClientError),
    /// The flight's configuration is none of this version.
    #[error("the configuration of the flight cannot be used: {0}")]
    Config(#[from] ConfigError),
    /// There is nowhere to publish.
    #[error("no endpoint to publish on: give --listen or --connect, or set network.listen or ros.enabled")]
    NoEndpoint,
    /// The mounting of the IMU is not known, and with it the attitude that ROS 2 would receive.
    #[error(transparent)]
    Mounting(#[from] UnknownMounting),
    /// The socket cannot be used.
    #[error("the local socket cannot be used: {0}")]
    Io(#[from] io::Error),
}

impl NetworkProcessError {
    /// True if another attempt with the same configuration cannot succeed.
    pub fn is_usage(&self) -> bool {
        match self {
            Self::Net(error) => error.is_usage(),
            Self::Config(_) | Self::NoEndpoint | Self::Mounting(_) => true,
            Self::Client(_) | Self::Io(_) => false,
        }
    }
}

/// Serves the flight behind `stream` until it is over or gone, or `stop` is set. What becomes of the start is reported to
/// the flight.
///
/// # Errors
/// When the flight cannot be understood, or the network not be used.
pub fn serve(
    stream: UnixStream,
    options: &LinkOptions,
    stop: &AtomicBool,
) -> Result<Ended, NetworkProcessError> {
    stream.set_read_timeout(Some(GREETING_PATIENCE))?;
    let mut client = Local::over(stream.try_clone()?);
    let mut requests = client.requests()?;
    requests.send(&Request::Subscribe(WANTED))?;
    let (configuration, may_command) = greeted(&mut client)?;
    stream.set_read_timeout(None)?;
    let commands = Arc::new(CommandRelay::new(requests, may_command));
    let outputs = match Outputs::start(&configuration, options, &commands) {
        Ok(outputs) => outputs,
        Err(error) => {
            let failure = Failure { is_usage: error.is_usage(), words: error.to_string() };
            commands.report(&Request::Failed(failure));
            return Err(error);
        }
    };
    commands.report(&Request::Ready);
    Ok(until_the_end(&mut client, outputs, &commands, stop))
}

/// Reads up to the configuration; also whether the flight takes commands of this process.
fn greeted(client: &mut Local) -> Result<(Configuration, bool), ClientError> {
    let mut may_command = false;
    loop {
        match client.next_record()? {
            LocalRecord::Hello(rights) => may_command = rights,
            LocalRecord::Configuration(configuration) => return Ok((configuration, may_command)),
            _ => {}
        }
    }
}

/// Hands out records until the flight or `stop` ends it; then what waits is sent.
fn until_the_end(
    client: &mut Local,
    mut outputs: Outputs,
    commands: &CommandRelay,
    stop: &AtomicBool,
) -> Ended {
    let is_over = AtomicBool::new(false);
    let ended = std::thread::scope(|scope| {
        scope.spawn(|| {
            while !is_over.load(Ordering::Relaxed) && !stop.load(Ordering::Relaxed) {
                std::thread::sleep(GLANCE);
            }
            // The reader below finds the end of the stream.
            commands.close();
        });
        let ended = loop {
            match client.next_record() {
                Ok(LocalRecord::End) => break Ended::FlightOver,
                Ok(record) => outputs.take(record, client.content(), commands),
                Err(error) => {
                    if !matches!(error, ClientError::Closed) && !stop.load(Ordering::Relaxed) {
                        tracing::warn!("{error}");
                    }
                    break Ended::FlightGone;
                }
            }
        };
        is_over.store(true, Ordering::Relaxed);
        ended
    });
    // What waits is sent, and the sessions are closed.
    drop(outputs);
    if stop.load(Ordering::Relaxed) { Ended::Stopped } else { ended }
}

/// Ways out of the process.
struct Outputs {
    net: Option<(Publisher, Feed)>,
    ros: Option<(RosOutput, RosFeed)>,
}

impl Outputs {
    fn start(
        configuration: &Configuration,
        options: &LinkOptions,
        commands: &Arc<CommandRelay>,
    ) -> Result<Self, NetworkProcessError> {
        let config = Config::from_toml_str(&configuration.toml, "flight")?;
        let ros = config.ros_rot_v_b()?;
        let net = Self::start_net(&config, options, commands)?;
        let stamps = if configuration.stamps_of_host { Stamps::OfHost } else { Stamps::Replayed };
        let ros = ros
            .map(|rot_v_b| RosOutput::start(&config, rot_v_b, stamps, Arc::clone(commands)))
            .transpose()?;
        if net.is_none() && ros.is_none() {
            return Err(NetworkProcessError::NoEndpoint);
        }
        Ok(Self { net, ros })
    }

    fn start_net(
        config: &ValidConfig,
        options: &LinkOptions,
        commands: &Arc<CommandRelay>,
    ) -> Result<Option<(Publisher, Feed)>, NetError> {
        if !has_network(&config.network, options) {
            return Ok(None);
        }
        let endpoints = Endpoints::of(&config.network).and(&options.listen, &options.connect);
        Publisher::start(config, &endpoints, Arc::clone(commands), options.is_patient).map(Some)
    }

    fn take(&mut self, record: LocalRecord, message: &[u8], commands: &CommandRelay) {
        if let Some((_, ros)) = &mut self.ros {
            ros.take(&record);
        }
        if let LocalRecord::Answer(answer) = record {
            return commands.take(answer);
        }
        if let Some((_, feed)) = &mut self.net {
            feed.take(record, message);
        }
    }
}
