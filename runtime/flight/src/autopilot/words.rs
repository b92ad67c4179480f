//! What people are told of the line to the autopilot, in words: made and written by a thread of normal priority, since making
//! words allocates, and a thread of high priority must not wait for who holds the allocator.

use crate::schedule::ring::{Bell, Writer, ring};
use std::net::SocketAddr;
use std::time::Duration;

/// News that wait.
const WAITING: usize = 16;
/// The thread looks for its end this often.
const PERIOD: Duration = Duration::from_secs(1);

/// What has happened.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum News {
    /// The autopilot is heard.
    Heard,
    /// It has not been heard for long.
    Silent,
    /// Its clock less ours, ns.
    Clock(i64),
    /// After a silence another sender has taken the autopilot's place.
    Replaced {
        /// Sender that is answered now.
        by: SocketAddr,
        /// Sender that was answered before.
        other: SocketAddr,
    },
    /// The device went away: by an error of the system of this number, or it hung up.
    Gone(Option<i32>),
    /// It is there again.
    Back,
}

impl News {
    fn tell(self, address: &str) {
        match self {
            Self::Heard => tracing::info!("autopilot at {address}: connected"),
            Self::Silent => {
                tracing::warn!("autopilot at {address}: no messages received; still sending odometry");
            }
            Self::Clock(ns) => {
                tracing::info!(
                    "autopilot at {address}: its clock is {}",
                    super::sender::apart(ns as f64 * 1e-6)
                );
            }
            Self::Replaced { by, other } => tracing::warn!(
                "autopilot at {address}: {by} has replaced {other}, which was silent; odometry is now sent to {by}. To accept \
                 one host only, append ?from=HOST to the address in autopilot.connect"
            ),
            Self::Gone(error) => {
                let reason = error.map(std::io::Error::from_raw_os_error);
                let reason = reason.map_or_else(|| "it hung up".into(), |error| error.to_string());
                tracing::warn!(
                    "autopilot at {address}: the device was disconnected ({reason}); waiting for it to return"
                );
            }
            Self::Back => tracing::info!("autopilot at {address}: the device is connected again"),
        }
    }
}

/// Has news of the line at `address` told for as long as the writer lives. Where the system refuses a thread they are lost.
#[must_use]
pub fn teller(address: String) -> Writer<News> {
    let bell = Bell::default();
    let (writer, mut reader) = ring::<News>(WAITING, &bell);
    let tell = move || {
        bell.listen();
        while !reader.is_closed() {
            if let Some(news) = bell.wait(PERIOD, || reader.pop()) {
                news.tell(&address);
            }
        }
    };
    let _ = std::thread::Builder::new().name("pilot-words".into()).spawn(tell);
    writer
}
