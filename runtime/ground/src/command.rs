//! Commands to a vehicle.
//!
//! Whoever says that it answers is asked, and only a reply under the vehicle's own key is believed: somebody who claims to
//! answer everything neither takes the command away nor reports it done.

use plumbline_link::net::{ROOT, plain, read};
use plumbline_record::fields::Record;
use plumbline_record::messages::{MapSaved, ResetDone};
use serde::Deserialize;
use std::fmt;
use std::time::{Duration, Instant};
use zenoh::Session;
use zenoh::qos::{CongestionControl, Priority};
use zenoh::query::{ConsolidationMode, QueryTarget, Reply};

/// Timeout of a reset, which waits for the next frame.
const PATIENCE: Duration = Duration::from_secs(4);
/// Timeout of a map that is kept, which waits for the next keyframe and for the vehicle's disk.
const SAVE_PATIENCE: Duration = Duration::from_secs(20);
/// Period of the search for a vehicle.
const SEARCH_PERIOD: Duration = Duration::from_millis(200);
/// Longest answer that is shown, bytes.
const MAX_WORDS: usize = 400;

/// Error text when there is no reply.
const SILENCE: &str = "no answer: the vehicle is out of reach, or this station may not command it (a viewer's \
                       certificate)";

/// Extent of a reset.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ResetWords {
    /// Restarts the estimator and keeps the pose.
    Soft,
    /// Restarts the estimator at the origin.
    Hard,
}

impl fmt::Display for ResetWords {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Soft => "soft",
            Self::Hard => "hard",
        })
    }
}

/// True if a vehicle is on the network; waits up to the timeout for it.
pub async fn find(session: &Session, vehicle: &str) -> bool {
    let key = format!("{ROOT}/{vehicle}/alive");
    let end = Instant::now() + PATIENCE;
    while Instant::now() < end {
        if let Ok(replies) = session.liveliness().get(&key).timeout(SEARCH_PERIOD).await
            && replies.recv_async().await.is_ok_and(|reply| reply.result().is_ok())
        {
            return true;
        }
        tokio::time::sleep(SEARCH_PERIOD).await;
    }
    false
}

/// Resets the estimate of a vehicle; returns its reply.
///
/// # Errors
/// The reason as text, when it refused or did not reply.
pub async fn reset(session: &Session, vehicle: &str, kind: ResetWords) -> Result<String, String> {
    let key = format!("{ROOT}/{vehicle}/command/reset");
    let done: ResetDone = command(session, &key, &format!("?kind={kind}"), PATIENCE).await?;
    Ok(format!("{}: the counter is now {}", plain(&done.words), done.reset_counter))
}

/// Has a vehicle keep its map; returns its reply.
///
/// # Errors
/// The reason as text, when it refused or did not reply.
pub async fn save_map(session: &Session, vehicle: &str) -> Result<String, String> {
    let key = format!("{ROOT}/{vehicle}/command/map_save");
    let saved: MapSaved = command(session, &key, "", SAVE_PATIENCE).await?;
    Ok(plain(&saved.words))
}

/// Asks for something to be done, and returns what the vehicle replies.
async fn command<T: Record>(
    session: &Session,
    key: &str,
    parameters: &str,
    patience: Duration,
) -> Result<T, String> {
    let question = session
        .get(format!("{key}{parameters}"))
        .target(QueryTarget::All)
        .consolidation(ConsolidationMode::None)
        .timeout(patience)
        .priority(Priority::InteractiveHigh)
        .congestion_control(CongestionControl::Block);
    let replies = question.await.map_err(|error| format!("the command could not be sent: {error}"))?;
    let mut refusal = None;
    while let Ok(reply) = replies.recv_async().await {
        match read_reply(&reply, key) {
            Some(Ok(done)) => return Ok(done),
            Some(Err(words)) => refusal = refusal.or(Some(words)),
            None => {}
        }
    }
    Err(refusal.unwrap_or_else(|| SILENCE.into()))
}

/// Content of a reply; `None` when it is not the vehicle's, or holds none.
fn read_reply<T: Record>(reply: &Reply, key: &str) -> Option<Result<T, String>> {
    match reply.result() {
        Ok(sample) if sample.key_expr().as_str() != key => None,
        Ok(sample) => Some(
            read::decode(&sample.payload().to_bytes())
                .ok_or_else(|| "the vehicle's answer cannot be understood".into()),
        ),
        Err(error) => {
            let bytes = error.payload().to_bytes();
            let words = plain(&String::from_utf8_lossy(&bytes[..bytes.len().min(MAX_WORDS)]));
            (words != "Timeout").then_some(Err(words))
        }
    }
}
