//! The network process of a flight: started with it, bounded by the system, started again when it dies. The flight never
//! waits for it.

use super::restart::Restarts;
use plumbline_config::ValidConfig;
use plumbline_flight::flight::{Flight, Outputs};
use plumbline_flight::local::{Failure, LinkDoor, LinkWord, LocalSocket, SensorBoard};
use plumbline_flight::pipeline::Control;
use plumbline_flight::pipeline::listener::{Listener, Producer, Subscriber};
use plumbline_flight::schedule::worker::Worker;
use plumbline_link::net::threads;
use plumbline_link::process::LinkOptions;
use rustix::process::{Pid, Resource, Rlimit, prlimit};
use std::io;
use std::os::fd::OwnedFd;
use std::os::unix::net::UnixStream;
use std::os::unix::process::CommandExt as _;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::time::{Duration, Instant};
use thiserror::Error;

/// Data that the process has without peers, MB (10^6 bytes): 25 for the stacks of its threads and Zenoh at rest, 40 for half an
/// hour of poses and keyframes, and what snapshots and pictures take on their way. Beside it is `network.max_memory_mb`.
const BASE_MB: u64 = 112;
const MB: u64 = 1_000_000;
/// A process that says nothing for so long after its start has failed.
const BEGIN_PATIENCE: Duration = Duration::from_secs(10);
/// A start that is patient waits so long for the first word of the process, and from then on so long for what is wrong with
/// the endpoints.
const FIRST_WORD: Duration = Duration::from_secs(1);
const BRIEFLY: Duration = Duration::from_millis(300);
/// A process without a sign of life for so long hangs.
const HUNG: Duration = Duration::from_secs(10);
/// At the end of the flight the process has so long to send what waits.
const LAST_WORDS: Duration = Duration::from_secs(3);
/// Period of the check for its end.
const GLANCE: Duration = Duration::from_millis(10);

/// Starts the local socket of a flight where one is named or `link` reads it, and the network process with these options; returns
/// where the state of the sensors is posted for both.
///
/// # Errors
/// When the socket cannot be made or the network not be used.
pub fn start_socket(
    outputs: &mut Outputs,
    flight: &Flight,
    control: &Arc<Control>,
    link: Option<LinkOptions>,
) -> anyhow::Result<Option<SensorBoard>> {
    let config = &flight.config;
    if link.is_none() && config.local.path.is_empty() {
        return Ok(None);
    }
    let socket = LocalSocket::start(config, flight.stamps, Arc::clone(control))?;
    let (door, board) = (socket.link_door(), socket.sensor_board());
    outputs.add(socket);
    if let Some(link) = link {
        outputs.add(LinkProcess::start(door, config, link)?);
    }
    Ok(Some(board))
}

/// Why a flight has no network.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum LinkProcessError {
    /// The process cannot be started.
    #[error("cannot start the network process: {0}")]
    Start(#[from] io::Error),
    /// The network cannot be used.
    #[error("{}", .0.words)]
    Refused(Failure),
    /// The process has ended before it could be reached.
    #[error("the network process ended ({0}) before others could reach it")]
    Died(String),
}

/// The network process of a flight.
#[derive(Debug)]
pub struct LinkProcess {
    /// Dropped to end the process.
    _stop: Sender<()>,
    _worker: Worker,
}

impl LinkProcess {
    /// Starts the process; returns when others can reach the vehicle, or soon where `options` are patient.
    ///
    /// # Errors
    /// When the process cannot be started, or the endpoints cannot be used.
    pub fn start(
        door: LinkDoor,
        config: &ValidConfig,
        options: LinkOptions,
    ) -> Result<Self, LinkProcessError> {
        let (stop, stopped) = channel();
        let (tell, told) = channel();
        let (is_patient, max_bytes) =
            (options.is_patient, (BASE_MB + u64::from(config.network.max_memory_mb)) * MB);
        let keeper = Keeper { door, options, max_bytes, stopped, tell: Some(tell) };
        // The process ends with the thread that has started it (PR_SET_PDEATHSIG).
        let worker = Worker::start("link-keeper", || {}, move || keeper.run())?;
        let process = Self { _stop: stop, _worker: worker };
        outcome_of_start(&told, is_patient)?;
        Ok(process)
    }
}

/// News of a start.
enum Start {
    Begun,
    Ready,
    Failed(LinkProcessError),
}

fn outcome_of_start(told: &Receiver<Start>, is_patient: bool) -> Result<(), LinkProcessError> {
    let mut patience = if is_patient { FIRST_WORD } else { Duration::MAX };
    loop {
        match told.recv_timeout(patience) {
            Ok(Start::Begun) if is_patient => patience = BRIEFLY,
            Ok(Start::Begun) => {}
            // Its keeper goes on trying.
            Ok(Start::Ready) | Err(RecvTimeoutError::Timeout) => return Ok(()),
            Ok(Start::Failed(error)) => return Err(error),
            Err(RecvTimeoutError::Disconnected) => return Err(LinkProcessError::Died("no status".into())),
        }
    }
}

impl Subscriber for LinkProcess {
    fn listener(&mut self, _producer: Producer) -> Box<dyn Listener> {
        Box::new(())
    }
}

/// End of a process.
enum Life {
    /// The flight is over.
    Over,
    /// It cannot start.
    Refused(Failure),
    /// It died.
    Died(String),
}

/// Starts the process, and again when it dies.
struct Keeper {
    door: LinkDoor,
    options: LinkOptions,
    max_bytes: u64,
    stopped: Receiver<()>,
    /// Whoever waits for the first start.
    tell: Option<Sender<Start>>,
}

impl Keeper {
    fn run(mut self) {
        let mut restarts = Restarts::new();
        loop {
            let words = match self.live() {
                Ok(Life::Over) => return,
                Ok(Life::Refused(failure)) if self.is_final(&failure) => return self.refuse(failure),
                Ok(Life::Refused(failure)) => failure.words,
                Ok(Life::Died(words)) => words,
                Err(error) => error.to_string(),
            };
            // The first start of a flight that is not patient has to succeed.
            if let Some(tell) = self.tell.take_if(|_| !self.options.is_patient) {
                return drop(tell.send(Start::Failed(LinkProcessError::Died(words))));
            }
            tracing::warn!("the network process ended ({words}); the flight continues, starting it again");
            self.options.is_patient = true;
            let stopped = &self.stopped;
            if restarts.is_over(|pause| stopped.recv_timeout(pause) != Err(RecvTimeoutError::Timeout)) {
                return;
            }
        }
    }

    /// True if no other start is to follow: it could not succeed, or somebody waits for this one.
    fn is_final(&self, failure: &Failure) -> bool {
        failure.is_usage || (self.tell.is_some() && !self.options.is_patient)
    }

    fn refuse(&mut self, failure: Failure) {
        let words = failure.words.clone();
        let tell = self.tell.take();
        let is_told =
            tell.is_some_and(|tell| tell.send(Start::Failed(LinkProcessError::Refused(failure))).is_ok());
        if !is_told {
            tracing::error!("cannot start the network: {words}; the flight continues without it");
        }
    }

    fn tell(&self, news: Start) {
        if let Some(tell) = &self.tell {
            let _ = tell.send(news);
        }
    }

    /// One life of the process.
    fn live(&mut self) -> io::Result<Life> {
        let (ours, theirs) = UnixStream::pair()?;
        let child = self.command()?.stdin(OwnedFd::from(theirs)).spawn()?;
        let mut child = Ended(child);
        let limit = Rlimit { current: Some(self.max_bytes), maximum: Some(self.max_bytes) };
        prlimit(Some(Pid::from_child(&child.0)), Resource::Data, limit)?;
        let (words, said) = channel();
        if !self.door.admit(ours, words) {
            return Ok(Life::Over);
        }
        let mut patience = BEGIN_PATIENCE;
        loop {
            match said.recv_timeout(patience) {
                Ok(LinkWord::Begun) => {
                    self.tell(Start::Begun);
                    // A session may be waited for as long as it takes.
                    patience = Duration::MAX;
                }
                Ok(LinkWord::Ready) => {
                    self.tell(Start::Ready);
                    self.tell = None;
                }
                Ok(LinkWord::Alive) => patience = HUNG,
                Ok(LinkWord::Failed(failure)) => return Ok(Life::Refused(failure)),
                Err(RecvTimeoutError::Timeout) => {
                    return Ok(Life::Died(format!("no sign of life for {} s", patience.as_secs())));
                }
                // It has ended, or the flight has.
                Err(RecvTimeoutError::Disconnected) => break,
            }
        }
        Ok(match child.wait(LAST_WORDS)? {
            Some(status) if status.success() => Life::Over,
            Some(status) => Life::Died(status.to_string()),
            None => Life::Died("it does not end".into()),
        })
    }

    fn command(&self) -> io::Result<Command> {
        let mut command = Command::new(std::env::current_exe()?);
        command.args(std::env::args_os().skip(1).filter(|argument| is_verbosity(argument)));
        command.args(["link", "--started"]);
        command.args(self.options.listen.iter().flat_map(|endpoint| ["--listen", endpoint]));
        command.args(self.options.connect.iter().flat_map(|endpoint| ["--connect", endpoint]));
        if self.options.publish {
            command.arg("--publish");
        }
        if self.options.is_patient {
            command.arg("--patient");
        }
        if std::env::var_os(threads::VARIABLE).is_none() {
            command.env(threads::VARIABLE, threads::LAYOUT);
        }
        // systemd supervises the flight: its network process neither speaks for it nor is watched.
        command.env_remove("NOTIFY_SOCKET").env_remove("WATCHDOG_USEC").env_remove("WATCHDOG_PID");
        // Ctrl-C in a terminal is for the flight, which then ends this process in its own time.
        command.process_group(0).stdout(Stdio::null());
        Ok(command)
    }
}

/// True if an argument raises the verbosity: `-v`, `-vv` or `--verbose`.
fn is_verbosity(argument: &std::ffi::OsStr) -> bool {
    let is_short = |text: &str| {
        text.strip_prefix('-').is_some_and(|v| !v.is_empty() && v.bytes().all(|letter| letter == b'v'))
    };
    argument.to_str().is_some_and(|text| text == "--verbose" || is_short(text))
}

/// Process that ends at the latest when this goes.
struct Ended(Child);

impl Ended {
    /// Waits for its end, but not for longer than `patience`.
    fn wait(&mut self, patience: Duration) -> io::Result<Option<ExitStatus>> {
        let end = Instant::now() + patience;
        loop {
            let status = self.0.try_wait()?;
            if status.is_some() || Instant::now() >= end {
                return Ok(status);
            }
            std::thread::sleep(GLANCE);
        }
    }
}

impl Drop for Ended {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use plumbline_flight::pipeline::Stamps;

    #[test]
    fn verbosity_is_handed_on_and_nothing_else() {
        let is_handed_on = |text: &str| is_verbosity(text.as_ref());
        assert!(is_handed_on("-v") && is_handed_on("-vvv") && is_handed_on("--verbose"));
        assert!(!is_handed_on("-") && !is_handed_on("--publish") && !is_handed_on("-V"));
    }

    #[test]
    fn a_failure_of_the_moment_ends_only_a_start_that_somebody_waits_for() {
        let config = plumbline_config::Config::preset("sim").unwrap();
        let socket = LocalSocket::start(&config, Stamps::Replayed, Arc::default()).unwrap();
        let (door, options) = (socket.link_door(), LinkOptions::default());
        let ((_stop, stopped), (tell, _told)) = (channel(), channel());
        let mut keeper = Keeper { door, options, max_bytes: 0, stopped, tell: Some(tell) };
        let failure = |is_usage| Failure { is_usage, words: "no more descriptors".into() };
        assert!(keeper.is_final(&failure(false)));
        keeper.tell = None;
        assert!(!keeper.is_final(&failure(false)) && keeper.is_final(&failure(true)));
    }
}
