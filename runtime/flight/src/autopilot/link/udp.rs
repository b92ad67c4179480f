//! Datagrams: to an address, or back to whoever sends good messages.

use super::super::inbox::CHUNK;
use super::super::words::News;
use super::LinkError;
use crate::schedule::ticker::Monotonic;
use std::net::{IpAddr, SocketAddr, ToSocketAddrs, UdpSocket};
use std::os::fd::{AsFd as _, BorrowedFd};

/// Another autopilot may take the place of one that was silent for this long, ns.
pub(super) const SILENCE_NS: i64 = 5_000_000_000;

/// Datagrams to and from one autopilot.
#[derive(Debug)]
pub struct UdpLink {
    socket: UdpSocket,
    /// Where datagrams go, where it is not fixed: who sent the last good message, and when.
    learned: Option<Learned>,
}

#[derive(Debug, Default)]
struct Learned {
    /// The only host that is listened to, where one is configured.
    from: Option<IpAddr>,
    peer: Option<(SocketAddr, Monotonic)>,
    candidate: Option<SocketAddr>,
    /// Replacement of one sender by another that is still to be reported.
    news: Option<News>,
}

impl UdpLink {
    pub(super) fn to(address: &str) -> Result<Self, LinkError> {
        let peer = resolve(address)?;
        let any: SocketAddr = if peer.is_ipv4() { ([0; 4], 0).into() } else { ([0_u16; 8], 0).into() };
        let socket = UdpSocket::bind(any).and_then(|socket| socket.connect(peer).map(|()| socket));
        Self::new(socket, address, None)
    }

    pub(super) fn at(address: &str, from: Option<IpAddr>) -> Result<Self, LinkError> {
        let learned = Learned { from, ..Learned::default() };
        Self::new(UdpSocket::bind(resolve(address)?), address, Some(learned))
    }

    fn new(
        socket: std::io::Result<UdpSocket>,
        address: &str,
        learned: Option<Learned>,
    ) -> Result<Self, LinkError> {
        socket.and_then(|socket| socket.set_nonblocking(true).map(|()| Self { socket, learned })).map_err(
            |source| {
                let reason =
                    format!("no UDP socket ({source}); check that the port is free and the network up");
                LinkError { at: address.to_owned(), reason }
            },
        )
    }

    pub(super) fn read(&mut self, into: &mut [u8; CHUNK], now: Monotonic) -> usize {
        let Some(learned) = &mut self.learned else {
            // A refusal of what was sent before (nobody listens) is told here: it is no datagram.
            return self.socket.recv(into).unwrap_or(0);
        };
        let Ok((count, from)) = self.socket.recv_from(into) else { return 0 };
        if learned.from.is_some_and(|host| from.ip().to_canonical() != host.to_canonical()) {
            return 0;
        }
        let is_heard = |(_, at): &(SocketAddr, Monotonic)| now.0.saturating_sub(at.0) < SILENCE_NS;
        if learned.peer.as_ref().filter(|peer| is_heard(peer)).is_some_and(|(peer, _)| *peer != from) {
            return 0;
        }
        learned.candidate = Some(from);
        count
    }

    pub(super) fn confirm(&mut self, now: Monotonic) {
        if let Some(learned) = &mut self.learned
            && let Some(from) = learned.candidate
        {
            if let Some((other, _)) = learned.peer.filter(|(peer, _)| *peer != from) {
                learned.news = Some(News::Replaced { by: from, other });
            }
            learned.peer = Some((from, now));
        }
    }

    pub(super) fn descriptor(&self) -> BorrowedFd<'_> {
        self.socket.as_fd()
    }

    /// Replacement of the autopilot by another since the last time.
    pub(super) fn news(&mut self) -> Option<News> {
        self.learned.as_mut()?.news.take()
    }

    pub(super) fn send(&self, message: &[u8]) -> bool {
        match &self.learned {
            None => self.socket.send(message).is_ok(),
            Some(learned) => learned.peer.is_some_and(|(peer, _)| self.socket.send_to(message, peer).is_ok()),
        }
    }
}

fn resolve(address: &str) -> Result<SocketAddr, LinkError> {
    let failed = |why: String| {
        let reason = format!("address not found ({why}); check the name and the name service");
        LinkError { at: address.to_owned(), reason }
    };
    let mut found = address.to_socket_addrs().map_err(|error| failed(error.to_string()))?;
    found.next().ok_or_else(|| failed("it resolves to nothing".into()))
}
