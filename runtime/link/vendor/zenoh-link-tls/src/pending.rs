//! PLUMBLINE: TLS handshakes that have begun, at most [`MAX_PENDING`] at a time, so that connections that never say anything do
//! not use up the descriptors of the process.

use std::{
    collections::{HashMap, VecDeque},
    io,
    net::{IpAddr, SocketAddr},
    time::Duration,
};

use tokio::{
    net::TcpStream,
    task::{AbortHandle, Id, JoinSet},
};
use tokio_rustls::{server::TlsStream, TlsAcceptor};

/// Handshakes at a time.
pub(crate) const MAX_PENDING: usize = 64;

type Outcome = (io::Result<TlsStream<TcpStream>>, SocketAddr);

/// Handshakes that have begun, the oldest first.
pub(crate) struct Pending {
    acceptor: TlsAcceptor,
    timeout: Duration,
    tasks: JoinSet<Outcome>,
    waiting: VecDeque<(IpAddr, AbortHandle)>,
}

impl Pending {
    pub(crate) fn new(acceptor: TlsAcceptor, timeout: Duration) -> Self {
        Self { acceptor, timeout, tasks: JoinSet::new(), waiting: VecDeque::new() }
    }

    /// Begins a handshake. Where there are too many, the oldest of the address that has most of them ends, so that one host
    /// cannot keep out the others; whether one did.
    pub(crate) fn begin(&mut self, stream: TcpStream, peer: SocketAddr) -> bool {
        let is_full = self.waiting.len() >= MAX_PENDING;
        if is_full {
            self.evict();
        }
        let (accept, timeout) = (self.acceptor.accept(stream), self.timeout);
        let handle = self.tasks.spawn(async move {
            let timed_out = |_| io::Error::new(io::ErrorKind::TimedOut, "Timeout during TLS handshake");
            let outcome = tokio::time::timeout(timeout, accept).await;
            (outcome.map_err(timed_out).and_then(|outcome| outcome), peer)
        });
        self.waiting.push_back((peer.ip(), handle));
        is_full
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
        self.waiting.retain(|(_, handle)| handle.id() != id);
    }

    fn evict(&mut self) {
        let mut counts = HashMap::new();
        for (ip, _) in &self.waiting {
            *counts.entry(*ip).or_insert(0_usize) += 1;
        }
        let most = counts.values().copied().max().unwrap_or_default();
        let oldest = self.waiting.iter().position(|(ip, _)| counts[ip] == most);
        if let Some((ip, handle)) = oldest.and_then(|at| self.waiting.remove(at)) {
            tracing::debug!("Too many TLS handshakes: the oldest one from {ip} ends");
            handle.abort();
        }
    }
}
