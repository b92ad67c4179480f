//! Datagrams for odometry, beside the stream that carries everything else.
//!
//! A stream over a link that was down has to be opened anew, in six passages of a link of which each may be lost and is
//! repeated after most of a second: seconds, where the next odometry is due after milliseconds and nobody misses the
//! last. Over `udp/` a short partition needs nothing at all, and after a long one attempts overlap: each is four
//! passages, begun a moment after the last, and the first that succeeds is taken.
//!
//! It is a session of its own, since Zenoh's subscriptions are declared over the link that opens first, once: over
//! datagrams they would be lost. A client sends without having been asked, which is all that odometry needs.

use super::endpoints::{Endpoints, Mode};
use std::time::Duration;
use tokio::sync::watch;
use tokio::task::{JoinHandle, JoinSet};
use tokio::time::Instant;
use zenoh::Session;

/// An attempt is given up after this, ms: four passages of a bad link of 100 ms, and some queueing.
const OPEN_TIMEOUT_MS: u64 = 1_000;
/// The next attempt begins after this.
const ATTEMPT_PERIOD: Duration = Duration::from_millis(250);
/// Where the stream gets through and datagrams do not, somebody stops them: attempts are rarer after this time.
const PATIENCE: Duration = Duration::from_secs(15);
/// Period of the rarer attempts.
const RARE_PERIOD: Duration = Duration::from_secs(10);
/// Period of the check for a disconnected link.
const WATCH_PERIOD: Duration = Duration::from_millis(100);

/// The way for odometry, open or not.
pub struct Datagrams {
    open: watch::Receiver<Option<Session>>,
    task: JoinHandle<()>,
}

impl Datagrams {
    /// Opens the way and keeps it open; returns at once. `stream` is the session that carries everything else.
    #[must_use]
    pub fn start(endpoints: &Endpoints, stream: &Session) -> Self {
        let endpoints =
            Endpoints { mode: Mode::Client, open_timeout_ms: OPEN_TIMEOUT_MS, ..endpoints.clone() };
        let (tell, open) = watch::channel(None);
        let task = tokio::spawn(keep_open(endpoints, stream.clone(), tell));
        Self { open, task }
    }

    /// The session to send on; `None` while the way is closed.
    #[must_use]
    pub fn session(&self) -> Option<Session> {
        self.open.borrow().clone()
    }
}

impl Drop for Datagrams {
    fn drop(&mut self) {
        // A session that nobody holds any more closes.
        self.task.abort();
    }
}

async fn keep_open(endpoints: Endpoints, stream: Session, tell: watch::Sender<Option<Session>>) {
    loop {
        let session = connected(&endpoints, &stream).await;
        tracing::debug!("odometry is sent in datagrams, via {:?}", endpoints.connect);
        tell.send_replace(Some(session.clone()));
        while is_connected(&session).await {
            tokio::time::sleep(WATCH_PERIOD).await;
        }
        tell.send_replace(None);
        // Closing waits for attempts of its own.
        tokio::spawn(async move { session.close().await });
    }
}

/// The first session of several attempts that reaches the other side.
async fn connected(endpoints: &Endpoints, stream: &Session) -> Session {
    let mut attempts = JoinSet::new();
    let (mut next, mut passed_by, mut is_told) = (Instant::now(), None, false);
    loop {
        tokio::select! {
            () = tokio::time::sleep_until(next) => {
                let theirs = endpoints.clone();
                attempts.spawn(async move { theirs.open().await });
                // Since when the stream gets through, and datagrams do not.
                passed_by = if is_connected(stream).await { passed_by.or(Some(next)) } else { None };
                let is_stopped = passed_by.is_some_and(|since| since.elapsed() > PATIENCE);
                if is_stopped && !std::mem::replace(&mut is_told, true) {
                    let to = endpoints.connect.join(", ");
                    tracing::warn!("{to}: no connection for datagrams; odometry is sent with the other messages");
                }
                next = Instant::now() + if is_stopped { RARE_PERIOD } else { ATTEMPT_PERIOD };
            }
            Some(attempt) = attempts.join_next() => if let Ok(Ok(session)) = attempt {
                tokio::spawn(close_all(attempts));
                return session;
            }
        }
    }
}

/// Closes the sessions that were not needed.
async fn close_all(mut attempts: JoinSet<Result<Session, super::NetError>>) {
    while let Some(attempt) = attempts.join_next().await {
        if let Ok(Ok(session)) = attempt {
            let _ = session.close().await;
        }
    }
}

async fn is_connected(session: &Session) -> bool {
    let info = session.info();
    info.routers_zid().await.next().is_some() || info.peers_zid().await.next().is_some()
}
