//! The topics `trigger` and `odom_at`: a stamp comes in, and the state at that instant goes out.
//!
//! `trigger` is `std_msgs/msg/Header`, whose stamp a camera or payload was triggered at, by the clock of the stamps of `odom`. The
//! request goes to the flight like any other program's; its answer comes with the records of the flight, and is published
//! with the stamp that was asked for. So are the answers to camera triggers of the autopilot.

use super::interface::InterfaceType;
use super::messages::Header;
use super::names::{Endpoint, RosTopic};
use super::system_clock::from_system_clock;
use super::topic::Declaring;
use crate::net::{CommandRelay, NetError, now_ns};
use parking_lot::Mutex;
use plumbline_record::local::request::At;
use plumbline_record::{InstantAnswer, InstantSource};
use plumbline_rings::Stamps;
use std::collections::VecDeque;
use std::sync::Arc;
use zenoh::liveliness::LivelinessToken;
use zenoh::pubsub::Subscriber;

/// Triggers whose answers are waited for.
const MAX_WAITING: usize = 64;
/// Longest wait of the flight for an instant, ms.
const PATIENCE_MS: u32 = 500;
/// Triggers that a subscriber is advised to hold.
const DEPTH: u32 = 10;
/// Representation and options of little-endian CDR.
const CDR_LE: [u8; 4] = [0, 1, 0, 0];
/// Nanoseconds of a second.
const SECOND_NS: i64 = 1_000_000_000;

/// Stamps that were asked for, by the number of the request, ns.
#[derive(Clone, Debug, Default)]
pub struct Triggers(Arc<Mutex<VecDeque<(u64, i64)>>>);

impl Triggers {
    /// Asks the flight for the state at `stamp_ns` of the system's clock.
    fn ask(&self, stamp_ns: i64, stamps: Stamps, commands: &CommandRelay) {
        let stamp = from_system_clock(stamps, stamp_ns, now_ns());
        // The answer waits for the lock until its request is noted.
        let mut waiting = self.0.lock();
        if let Some(number) = commands.ask_at(At { stamp, patience_ms: PATIENCE_MS, is_settled: false }) {
            if waiting.len() == MAX_WAITING {
                waiting.pop_front();
            }
            waiting.push_back((number, stamp_ns));
        }
    }

    /// Stamp that an answer of the flight goes out with, if it was asked for here.
    pub(super) fn asked(&self, answer: &InstantAnswer) -> Option<i64> {
        if answer.source != InstantSource::Request {
            return None;
        }
        let mut waiting = self.0.lock();
        let place = waiting.iter().position(|(number, _)| *number == answer.sequence)?;
        waiting.remove(place).map(|(_, stamp_ns)| stamp_ns)
    }
}

/// The subscription, as long as it lasts.
pub struct TriggerSubscription {
    _subscriber: Subscriber<()>,
    _token: LivelinessToken,
}

impl TriggerSubscription {
    /// Subscribes, and asks the flight at each trigger.
    ///
    /// # Errors
    /// When Zenoh refuses a key.
    pub async fn declare(
        declaring: &mut Declaring<'_>,
        triggers: Triggers,
        stamps: Stamps,
        commands: Arc<CommandRelay>,
    ) -> Result<Self, NetError> {
        let name = declaring.node().qualified("trigger");
        let topic = RosTopic { name, interface: InterfaceType::of::<Header<'_>>(), depth: DEPTH };
        let key = declaring.node().key(&topic);
        let subscriber = declaring
            .session()
            .declare_subscriber(key.clone())
            .callback(move |sample| match stamp_of(&sample.payload().to_bytes()) {
                Some(stamp_ns) => triggers.ask(stamp_ns, stamps, &commands),
                None => tracing::debug!("a trigger that is no std_msgs/msg/Header is passed over"),
            })
            .await
            .map_err(|error| NetError::Declare { key, message: error.to_string() })?;
        let (token, _) = declaring.token(Endpoint::Subscription, &topic).await?;
        Ok(Self { _subscriber: subscriber, _token: token })
    }
}

/// Stamp of a header in little-endian CDR, ns.
fn stamp_of(bytes: &[u8]) -> Option<i64> {
    let (options, rest) = bytes.split_first_chunk::<4>()?;
    let (seconds, rest) = rest.split_first_chunk()?;
    let (nanos, _) = rest.split_first_chunk()?;
    let (seconds, nanos) = (i64::from(i32::from_le_bytes(*seconds)), i64::from(u32::from_le_bytes(*nanos)));
    (options[..2] == CDR_LE[..2] && nanos < SECOND_NS).then_some(seconds * SECOND_NS + nanos)
}

#[cfg(test)]
mod tests {
    use super::super::cdr;
    use super::super::messages::Time;
    use super::*;

    #[test]
    fn the_stamp_of_a_header_is_read_as_ros_writes_it() {
        for ns in [1_403_636_579_763_555_584, 0, 999_999_999, -1, -1_000_000_001] {
            let header = Header { stamp: Time::from_nanos(ns), frame_id: "camera" };
            let bytes = cdr::encode(&header).unwrap();
            assert_eq!(stamp_of(&bytes), Some(ns));
            assert_eq!(stamp_of(&bytes[..11]), None);
        }
        assert_eq!(stamp_of(&[0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 1]), None, "big-endian");
        let beyond = [&CDR_LE[..], &1u32.to_le_bytes(), &1_000_000_000u32.to_le_bytes()].concat();
        assert_eq!(stamp_of(&beyond), None);
    }

    #[test]
    fn an_answer_goes_out_with_the_stamp_that_was_asked_for() {
        let (ours, theirs) = std::os::unix::net::UnixStream::pair().unwrap();
        let requests = plumbline_client::Local::over(ours).requests().unwrap();
        let (commands, triggers) = (CommandRelay::new(requests, false), Triggers::default());
        for ns in 1..=(MAX_WAITING as i64 + 1) {
            triggers.ask(ns, Stamps::Replayed, &commands);
        }
        let answer = |sequence, source| InstantAnswer { sequence, source, ..InstantAnswer::default() };
        assert_eq!(triggers.asked(&answer(1, InstantSource::Request)), None, "forgotten");
        assert_eq!(triggers.asked(&answer(2, InstantSource::Trigger)), None);
        assert_eq!(triggers.asked(&answer(2, InstantSource::Request)), Some(2));
        assert_eq!(triggers.asked(&answer(2, InstantSource::Request)), None);
        drop(theirs);
    }
}
