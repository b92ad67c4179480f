//! Places for clients, and who has to leave one: a client that gives no sign of life makes way for another.

use parking_lot::Mutex;
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::{Duration, Instant};
use tokio::sync::Notify;

/// Clients at a time.
pub const MAX_CLIENTS: usize = 16;
/// A client that has answered no ping for so long makes way.
const SILENT: Duration = Duration::from_secs(5);

/// The places that are taken.
#[derive(Debug, Default)]
pub struct Seats(Mutex<Taken>);

#[derive(Debug, Default)]
struct Taken {
    next: u64,
    clients: BTreeMap<u64, Arc<ClientSign>>,
}

/// Signs of life of a client.
#[derive(Debug)]
pub struct ClientSign {
    heard: Mutex<Instant>,
    /// It is to leave.
    pub leave: Notify,
}

/// One of the places; it is free again when this is dropped.
#[derive(Debug)]
pub struct Seat {
    places: Arc<Seats>,
    number: u64,
    /// Sign of life of its client.
    pub sign: Arc<ClientSign>,
}

impl Seat {
    /// The client has said something, or has answered a ping.
    pub fn hear(&self, now: Instant) {
        *self.sign.heard.lock() = now;
    }
}

impl Drop for Seat {
    fn drop(&mut self) {
        self.places.0.lock().clients.remove(&self.number);
    }
}

impl Seats {
    /// Takes a place. Where there is none, the client that has been silent for longest has to leave its own, if it has been for
    /// long; `None` if none has.
    pub fn take(this: &Arc<Self>, now: Instant) -> Option<Seat> {
        let mut taken = this.0.lock();
        if taken.clients.len() >= MAX_CLIENTS {
            let heard = |sign: &ClientSign| *sign.heard.lock();
            let (number, silent) = taken.clients.iter().min_by_key(|(_, sign)| heard(sign))?;
            if now.saturating_duration_since(heard(silent)) < SILENT {
                return None;
            }
            tracing::warn!(
                "Foxglove: all {MAX_CLIENTS} places are taken; a client that does not answer was disconnected"
            );
            silent.leave.notify_one();
            let number = *number;
            taken.clients.remove(&number);
        }
        let number = taken.next;
        taken.next += 1;
        let sign = Arc::new(ClientSign { heard: Mutex::new(now), leave: Notify::new() });
        taken.clients.insert(number, Arc::clone(&sign));
        Some(Seat { places: Arc::clone(this), number, sign })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_silent_client_makes_way_and_one_that_answers_does_not() {
        let (places, start) = (Arc::<Seats>::default(), Instant::now());
        let at = |s: u64| start + Duration::from_secs(s);
        let held: Vec<Seat> = (0..MAX_CLIENTS).map(|_| Seats::take(&places, start).unwrap()).collect();
        assert!(Seats::take(&places, at(4)).is_none(), "all may be alive");
        held.iter().filter(|place| place.number != 7).for_each(|place| place.hear(at(6)));
        let newer = Seats::take(&places, at(8)).unwrap();
        assert!(!places.0.lock().clients.contains_key(&7), "the silent one");
        assert!(Seats::take(&places, at(8)).is_none());
        // The end of the one that was sent away frees no place of another.
        drop(held);
        assert_eq!(places.0.lock().clients.len(), 1);
        drop(newer);
        assert!(places.0.lock().clients.is_empty());
    }
}
