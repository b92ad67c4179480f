//! PLUMBLINE: TLS handshakes that have begun, a bounded number of them at a time, so that connections that never say anything do not use
//! up the descriptors of the process. Where there are too many, one of the address that has most of them ends, so that one host cannot
//! keep out the others.
//!
//! Connections that have said nothing have places of their own, whose oldest gives way. Of those that speak it is drawn: on a busy
//! host every handshake takes long, and the oldest would always be gone before it is complete.

use std::{
    collections::{hash_map::RandomState, HashMap},
    hash::BuildHasher,
    io,
    net::{IpAddr, SocketAddr},
    sync::{
        atomic::{AtomicBool, Ordering},
        Arc,
    },
    time::Duration,
};

use tokio::{
    net::TcpStream,
    task::{AbortHandle, Id, JoinSet},
};
use tokio_rustls::{server::TlsStream, TlsAcceptor};

/// Connections at a time that have said nothing.
const MAX_SILENT: usize = 64;
/// Handshakes at a time of those that have.
const MAX_SPEAKING: usize = 128;

type Outcome = (io::Result<TlsStream<TcpStream>>, SocketAddr);

/// A handshake that has begun.
struct Begun {
    ip: IpAddr,
    speaks: Arc<AtomicBool>,
    handle: AbortHandle,
}

/// Handshakes that have begun, the oldest first.
pub(crate) struct Pending {
    acceptor: TlsAcceptor,
    timeout: Duration,
    tasks: JoinSet<Outcome>,
    begun: Vec<Begun>,
    drawn: u64,
}

impl Pending {
    pub(crate) fn new(acceptor: TlsAcceptor, timeout: Duration) -> Self {
        Self { acceptor, timeout, tasks: JoinSet::new(), begun: Vec::new(), drawn: 0 }
    }

    /// Begins a handshake, and ends others where there are too many; whether one did.
    pub(crate) fn begin(&mut self, stream: TcpStream, peer: SocketAddr) -> bool {
        let has_evicted = [false, true].map(|speaks| self.evict(speaks)).contains(&true);
        let (acceptor, timeout, speaks) = (self.acceptor.clone(), self.timeout, Arc::new(AtomicBool::new(false)));
        let begins_to_speak = Arc::clone(&speaks);
        let handle = self.tasks.spawn(async move {
            let accept = async {
                stream.readable().await?;
                begins_to_speak.store(true, Ordering::Relaxed);
                acceptor.accept(stream).await
            };
            let timed_out = |_| io::Error::new(io::ErrorKind::TimedOut, "Timeout during TLS handshake");
            let outcome = tokio::time::timeout(timeout, accept).await;
            (outcome.map_err(timed_out).and_then(|outcome| outcome), peer)
        });
        self.begun.push(Begun { ip: peer.ip(), speaks, handle });
        has_evicted
    }

    /// Waits for the end of a handshake; for ever where there is none.
    pub(crate) async fn next(&mut self) -> Outcome {
        loop {
            match self.tasks.join_next_with_id().await {
                Some(Ok((id, outcome))) => {
                    self.forget(id);
                    return outcome;
                }
                Some(Err(error)) => self.forget(error.id()),
                None => std::future::pending().await,
            }
        }
    }

    fn forget(&mut self, id: Id) {
        self.begun.retain(|begun| begun.handle.id() != id);
    }

    /// Ends one of those that speak, or of those that do not, where there is no room for another; whether one did.
    fn evict(&mut self, speaks: bool) -> bool {
        let is_one = |begun: &&Begun| begun.speaks.load(Ordering::Relaxed) == speaks;
        let max = if speaks { MAX_SPEAKING } else { MAX_SILENT };
        if self.begun.iter().filter(is_one).count() < max {
            return false;
        }
        let mut counts = HashMap::new();
        for begun in self.begun.iter().filter(is_one) {
            *counts.entry(begun.ip).or_insert(0_usize) += 1;
        }
        let Some((crowded, most)) = counts.into_iter().max_by_key(|(_, count)| *count) else {
            return false;
        };
        self.drawn += 1;
        let drawn = if speaks { RandomState::new().hash_one(self.drawn) as usize % most } else { 0 };
        let mut of_address =
            self.begun.iter().enumerate().filter(|(_, begun)| is_one(begun) && begun.ip == crowded);
        let Some(at) = of_address.nth(drawn).map(|(at, _)| at) else {
            return false;
        };
        let ended = self.begun.remove(at);
        tracing::debug!("Too many TLS handshakes: one from {} ends", ended.ip);
        ended.handle.abort();
        true
    }
}
