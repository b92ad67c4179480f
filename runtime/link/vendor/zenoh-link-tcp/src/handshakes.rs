//! PLUMBLINE: links whose handshake is not complete, a bounded number of them at a time. Where there are too many, one of the address
//! that has most of them ends, so that those who begin handshakes and do not complete them keep nobody out. It is drawn: in a flood the
//! oldest would always be gone before a slow link has completed its own.

use std::{
    collections::{hash_map::RandomState, HashMap, VecDeque},
    future::Future,
    hash::BuildHasher,
    net::IpAddr,
    sync::{
        atomic::{AtomicUsize, Ordering},
        Arc, Mutex, MutexGuard, PoisonError,
    },
};

use tokio_util::sync::CancellationToken;
use zenoh_result::{bail, ZResult};

/// A handshake that has begun.
struct Begun {
    id: u64,
    ip: IpAddr,
    evicted: CancellationToken,
}

/// Handshakes that have begun, the oldest first.
#[derive(Default)]
struct List {
    next: u64,
    begun: VecDeque<Begun>,
}

impl List {
    fn evict(&mut self) {
        let mut counts = HashMap::new();
        for begun in &self.begun {
            *counts.entry(begun.ip).or_insert(0_usize) += 1;
        }
        let Some((crowded, most)) = counts.into_iter().max_by_key(|(_, count)| *count) else {
            return;
        };
        let drawn = RandomState::new().hash_one(self.next) as usize % most;
        let mut of_address = self.begun.iter().enumerate().filter(|(_, begun)| begun.ip == crowded);
        let at = of_address.nth(drawn).map(|(at, _)| at);
        if let Some(begun) = at.and_then(|at| self.begun.remove(at)) {
            tracing::debug!("Too many handshakes: one from {} ends", begun.ip);
            begun.evicted.cancel();
        }
    }
}

/// Handshakes of a listener.
#[derive(Clone, Default)]
pub(crate) struct Handshakes(Arc<Mutex<List>>);

impl Handshakes {
    fn lock(&self) -> MutexGuard<'_, List> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Begins a handshake that is complete after so many reads, in place of another one where there are `max`.
    pub(crate) fn begin(&self, ip: IpAddr, reads: usize, max: usize) -> Handshake {
        let mut list = self.lock();
        if list.begun.len() >= max {
            list.evict();
        }
        let (id, evicted) = (list.next, CancellationToken::new());
        list.next += 1;
        list.begun.push_back(Begun { id, ip, evicted: evicted.clone() });
        Handshake { list: self.clone(), id, evicted, missing: AtomicUsize::new(reads) }
    }

    fn forget(&self, id: u64) {
        self.lock().begun.retain(|begun| begun.id != id);
    }
}

/// Handshake of a link.
pub(crate) struct Handshake {
    list: Handshakes,
    id: u64,
    evicted: CancellationToken,
    missing: AtomicUsize,
}

impl Handshake {
    /// Returns what is read, or an error where the handshake had to end.
    pub(crate) async fn read<T>(&self, read: impl Future<Output = ZResult<T>>) -> ZResult<T> {
        if self.missing.load(Ordering::Relaxed) == 0 {
            return read.await;
        }
        let outcome = tokio::select! {
            biased;
            () = self.evicted.cancelled() => bail!("too many handshakes: this one ends"),
            outcome = read => outcome?,
        };
        if self.missing.fetch_sub(1, Ordering::Relaxed) == 1 {
            self.list.forget(self.id);
        }
        Ok(outcome)
    }
}

impl Drop for Handshake {
    fn drop(&mut self) {
        self.list.forget(self.id);
    }
}
