//! Commands on their way back to the flight, over the local socket.

use parking_lot::Mutex;
use plumbline_client::Requests;
use plumbline_estimator::ResetKind;
use plumbline_record::local::request::{Answer, At, Request, RequestStatus};
use std::collections::BTreeMap;
use std::time::Duration;
use tokio::sync::{oneshot, watch};

/// Timeout of a map that is to be saved: the flight itself gives up after 15 s.
const SAVE_PATIENCE: Duration = Duration::from_secs(17);
/// Timeout of a reset, which takes effect with the next frame.
const RESET_PATIENCE: Duration = Duration::from_secs(2);
/// Answers that are waited for at a time.
const MAX_WAITING: usize = 64;

/// Way of commands to the flight. By default there is no flight at its end: a reset is accepted and never done.
#[derive(Debug, Default)]
pub struct CommandRelay(Mutex<State>);

#[derive(Debug, Default)]
struct State {
    requests: Option<Requests>,
    /// The flight refuses commands of this process.
    is_refused: bool,
    waiting: BTreeMap<u64, oneshot::Sender<Answer>>,
}

impl CommandRelay {
    /// Commands to the flight behind `requests`, which takes them or not.
    pub fn new(requests: Requests, may_command: bool) -> Self {
        let state = State { requests: Some(requests), is_refused: !may_command, ..State::default() };
        Self(Mutex::new(state))
    }

    /// Asks for a reset before the next frame.
    ///
    /// # Errors
    /// When the flight takes no commands of this process, or cannot be reached: the reason as text.
    pub fn ask_reset(&self, kind: ResetKind) -> Result<(), String> {
        let mut state = self.0.lock();
        state.check()?;
        let Some(requests) = &mut state.requests else { return Ok(()) };
        let sent = requests.send(&Request::Reset(kind));
        sent.map(drop).map_err(|error| format!("the reset could not be sent to the flight: {error}"))
    }

    /// Resets the estimator and waits until a frame shows it; `resets` has the newest count of resets, which is returned.
    ///
    /// # Errors
    /// When the flight takes no commands of this process, cannot be reached, or no frame has come since: the reason as text.
    pub async fn reset(&self, kind: ResetKind, mut resets: watch::Receiver<u32>) -> Result<u32, String> {
        let before = *resets.borrow_and_update();
        tracing::warn!("reset ({}) on command", reset_words(kind));
        self.ask_reset(kind)?;
        let is_done = tokio::time::timeout(RESET_PATIENCE, resets.wait_for(|now| *now != before)).await;
        match is_done {
            Ok(Ok(now)) => Ok(*now),
            _ => Err("the reset was requested, but no frame has arrived since".into()),
        }
    }

    /// Has the map saved; the number of its keyframes.
    ///
    /// # Errors
    /// When it was not saved: the reason as text.
    pub async fn save_map(&self) -> Result<u32, String> {
        let answered = {
            let mut state = self.0.lock();
            state.check()?;
            let number = state.send(&Request::SaveMap);
            let number = number.ok_or("this flight keeps no map: start it with --save-map FILE")?;
            state.waiting.retain(|_, waiting| !waiting.is_closed());
            if state.waiting.len() >= MAX_WAITING {
                return Err("busy: ask again later".into());
            }
            let (answer, answered) = oneshot::channel();
            state.waiting.insert(number, answer);
            answered
        };
        match tokio::time::timeout(SAVE_PATIENCE, answered).await {
            Ok(Ok(answer)) if answer.status == RequestStatus::Done => Ok(answer.value),
            Ok(Ok(answer)) => Err(answer.words),
            _ => Err("the flight does not answer".into()),
        }
    }

    /// Asks for camera pictures at this rate, Hz; zero for none any more.
    pub fn watch(&self, rate_hz: f64) {
        self.0.lock().send(&Request::Watch((rate_hz * 1e3) as u32));
    }

    /// Asks for the state at an instant; the number that its answer carries.
    pub fn ask_at(&self, at: At) -> Option<u64> {
        self.0.lock().send(&Request::At(at))
    }

    /// Reports to whoever started this process.
    pub fn report(&self, report: &Request) {
        self.0.lock().send(report);
    }

    /// Takes an answer of the flight.
    pub fn take(&self, answer: Answer) {
        if let Some(waiting) = self.0.lock().waiting.remove(&answer.number) {
            let _ = waiting.send(answer);
        }
    }

    /// Ends the connection, also for the thread that reads.
    pub fn close(&self) {
        if let Some(requests) = &self.0.lock().requests {
            requests.close();
        }
    }
}

/// Name of a kind of reset.
pub fn reset_words(kind: ResetKind) -> &'static str {
    match kind {
        ResetKind::Soft => "soft",
        ResetKind::Hard => "hard",
    }
}

impl State {
    fn check(&self) -> Result<(), String> {
        match self.is_refused {
            true => Err("the flight takes no commands of the network process: its user is neither that of the flight nor \
                         in the group of the local socket"
                .into()),
            false => Ok(()),
        }
    }

    /// Sends a request to the flight, if it is there; the number of the request.
    fn send(&mut self, request: &Request) -> Option<u64> {
        self.requests.as_mut()?.send(request).ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use plumbline_client::Local;
    use std::os::unix::net::UnixStream;

    #[test]
    fn a_reset_that_cannot_be_sent_is_refused() {
        let (ours, theirs) = UnixStream::pair().unwrap();
        let relay = CommandRelay::new(Local::over(ours).requests().unwrap(), true);
        assert_eq!(relay.ask_reset(ResetKind::Soft), Ok(()));
        drop(theirs);
        let refusal = relay.ask_reset(ResetKind::Soft).unwrap_err();
        assert!(refusal.starts_with("the reset could not be sent"), "{refusal}");
    }
}
