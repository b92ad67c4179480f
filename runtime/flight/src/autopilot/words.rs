//! News of the line to the autopilot for people, in words: made and written by a thread of normal priority, since making
//! words allocates, and a thread of high priority must not wait for who holds the allocator.

use crate::schedule::ring::{Bell, Writer, ring};
use std::net::SocketAddr;
use std::time::Duration;

/// News that wait.
const WAITING: usize = 16;
/// The thread looks for its end this often.
const PERIOD: Duration = Duration::from_secs(1);

/// Event of the line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum News {
    /// The autopilot is heard.
    Heard,
    /// It has not been heard for long.
    Silent,
    /// Its clock less ours, ns.
    Clock(i64),
    /// Its clock less ours, ns, which was another before.
    ClockJumped {
        /// As it was told before.
        from_ns: i64,
        /// As it is now.
        to_ns: i64,
    },
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
    /// News of a clock that is so far ahead of ours, ns, after it was told as `before`.
    pub fn of_clock(ahead_ns: i64, before: Option<i64>) -> Self {
        /// Two crystals drift apart by less than this while nothing is told, ns.
        const DRIFT_NS: u64 = 1_000_000_000;
        match before.filter(|before| before.abs_diff(ahead_ns) > DRIFT_NS) {
            Some(from_ns) => Self::ClockJumped { from_ns, to_ns: ahead_ns },
            None => Self::Clock(ahead_ns),
        }
    }

    fn tell(self, address: &str) {
        match self {
            Self::Heard => tracing::info!("autopilot at {address}: connected"),
            Self::Silent => {
                tracing::warn!("autopilot at {address}: no messages received; still sending odometry");
            }
            Self::Clock(ns) => {
                tracing::info!("autopilot at {address}: its clock is {}", apart(ns as f64 * 1e-6));
            }
            Self::ClockJumped { from_ns, to_ns } => {
                let [from, to] = [from_ns, to_ns].map(|ns| apart(ns as f64 * 1e-6));
                tracing::warn!(
                    "autopilot at {address}: its clock jumped from {from} to {to}: it was restarted or set, or another program answers \
                     TIMESYNC in its name; with autopilot.clock = \"autopilot\" the stamps of the odometry follow. To accept one host \
                     only, append ?from=HOST to the address in autopilot.connect"
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

/// Distance of a clock from ours, by its lead in ms: "1908.4 s behind".
pub(super) fn apart(ahead_ms: f64) -> String {
    let (size, side) = (ahead_ms.abs(), if ahead_ms < 0.0 { "behind" } else { "ahead" });
    if size >= 1000.0 { format!("{:.1} s {side}", size * 1e-3) } else { format!("{size:.3} ms {side}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_clock_that_jumps_is_told_apart_from_one_that_drifts() {
        let second = 1_000_000_000;
        assert_eq!(News::of_clock(5 * second, None), News::Clock(5 * second));
        assert_eq!(News::of_clock(5 * second + 900_000, Some(5 * second)), News::Clock(5 * second + 900_000));
        for to_ns in [1_005 * second, -3 * second, i64::MAX] {
            let from_ns = 5 * second;
            assert_eq!(News::of_clock(to_ns, Some(from_ns)), News::ClockJumped { from_ns, to_ns });
        }
    }
}
