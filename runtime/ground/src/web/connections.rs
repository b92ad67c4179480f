//! Connections of browsers: few at a time, and none that begins a request without ending it. `axum::serve` bounds neither.

use axum::Router;
use hyper::body::Incoming;
use hyper::service::{Service as _, service_fn};
use hyper::{Request, server::conn::http1};
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use plumbline_rings::places::gives_way;
use std::cmp::Reverse;
use std::collections::VecDeque;
use std::net::{IpAddr, SocketAddr};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;
use tokio::net::{TcpListener, TcpStream};
use tokio::task::AbortHandle;

/// Connections at a time, web sockets apart: a browser has six.
const MAX_CONNECTIONS: usize = 128;
/// The head of a request has this long to come.
const HEAD_PATIENCE: Duration = Duration::from_secs(5);
/// Longest head of a request, bytes.
const MAX_HEAD_BYTES: usize = 16 * 1024;
/// Pause after a connection could not be accepted, for want of descriptors.
const REFUSED_PAUSE: Duration = Duration::from_millis(100);

/// Reason why something is not served.
#[derive(Debug, thiserror::Error)]
pub enum ServeError {
    /// An address that cannot be listened at.
    #[error("cannot serve {what} at {address}; {cure}")]
    Address {
        /// What was to be served.
        what: &'static str,
        /// Address on which it was to be served.
        address: SocketAddr,
        /// What to do about it.
        cure: &'static str,
        /// Error of the system.
        source: std::io::Error,
    },
    /// The system refuses the socket.
    #[error("cannot serve a socket")]
    Socket(#[from] std::io::Error),
}

/// Takes an address to serve; what is to be served there, and the cure where it cannot be had, are for the error.
///
/// # Errors
/// When it is taken, or none of this host's.
pub(crate) fn bind(
    what: &'static str,
    address: SocketAddr,
    cure: &'static str,
) -> Result<std::net::TcpListener, ServeError> {
    let taken = |source| ServeError::Address { what, address, cure, source };
    let listener = std::net::TcpListener::bind(address).map_err(taken)?;
    listener.set_nonblocking(true)?;
    Ok(listener)
}

/// Serves `app` to whoever connects, until the runtime ends.
pub(crate) async fn serve(listener: TcpListener, app: Router) {
    let mut connections = Connections::default();
    let mut is_told = false;
    loop {
        match listener.accept().await {
            Ok((stream, peer)) => connections.begin(stream, peer.ip(), &app),
            Err(error) => {
                if !std::mem::replace(&mut is_told, true) {
                    tracing::warn!("the web page cannot accept a connection: {error}");
                }
                tokio::time::sleep(REFUSED_PAUSE).await;
            }
        }
    }
}

/// A connection that goes on.
struct Connection {
    peer: IpAddr,
    /// True once a whole request has come.
    has_asked: Arc<AtomicBool>,
    task: AbortHandle,
}

/// Connections that go on, the oldest first.
#[derive(Default)]
struct Connections(VecDeque<Connection>);

impl Connections {
    fn begin(&mut self, stream: TcpStream, peer: IpAddr, app: &Router) {
        self.0.retain(|connection| !connection.task.is_finished());
        if self.0.len() >= MAX_CONNECTIONS {
            self.evict();
        }
        let has_asked = Arc::new(AtomicBool::new(false));
        let task = tokio::spawn(answer(stream, app.clone(), Arc::clone(&has_asked))).abort_handle();
        self.0.push_back(Connection { peer, has_asked, task });
    }

    /// Ends the oldest of the host that has most of them; those that have asked for something go last.
    fn evict(&mut self) {
        let is_idle = |connection: &Connection| !connection.has_asked.load(Ordering::Relaxed);
        let is_any_idle = self.0.iter().any(is_idle);
        let may_go = self.0.iter().enumerate().filter(|(_, connection)| !is_any_idle || is_idle(connection));
        let oldest = gives_way(may_go.map(|(at, connection)| (at, connection.peer, Some(Reverse(at)))));
        if let Some(connection) = oldest.and_then(|(at, _)| self.0.remove(at)) {
            connection.task.abort();
        }
    }
}

/// Answers the requests of one connection.
async fn answer(stream: TcpStream, app: Router, has_asked: Arc<AtomicBool>) {
    let app = TowerToHyperService::new(app);
    let service = service_fn(move |request: Request<Incoming>| {
        has_asked.store(true, Ordering::Relaxed);
        app.call(request)
    });
    let mut server = http1::Builder::new();
    server.timer(TokioTimer::new()).header_read_timeout(HEAD_PATIENCE).max_buf_size(MAX_HEAD_BYTES);
    // What goes wrong with a connection is the browser's affair.
    let _ = server.serve_connection(TokioIo::new(stream), service).with_upgrades().await;
}

#[cfg(test)]
mod tests {
    use super::*;
    use axum::routing::get;
    use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};

    #[tokio::test]
    async fn half_requests_do_not_take_the_page_away() {
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let address = listener.local_addr().unwrap();
        tokio::spawn(serve(listener, Router::new().route("/", get(|| async { "the page" }))));
        let mut halves = Vec::new();
        for _ in 0..2 * MAX_CONNECTIONS {
            let mut stream = TcpStream::connect(address).await.unwrap();
            stream.write_all(b"GET / HTTP/1.1\r\nHost: loc").await.unwrap();
            halves.push(stream);
        }
        let mut browser = TcpStream::connect(address).await.unwrap();
        browser.write_all(b"GET / HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n").await.unwrap();
        let mut page = String::new();
        browser.read_to_string(&mut page).await.unwrap();
        assert!(page.ends_with("the page"), "{page}");
        // The oldest have made way.
        for half in &mut halves[..MAX_CONNECTIONS] {
            assert!(!matches!(half.read(&mut [0; 64]).await, Ok(1..)));
        }
    }
}
