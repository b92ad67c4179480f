//! The live server for Foxglove: vehicles as its schemas over its WebSocket protocol (`foxglove.sdk.v1`), on the axum and
//! the Tokio that the page has.
//!
//! It sends and takes no commands. [`protocol`] are the messages, [`drawn`](super::drawn) is what a vehicle has to show,
//! [`client`] one connection. There is no queue: a client is sent what is new when its last message has gone, so a slow one misses what was
//! replaced meanwhile, and is told so.

mod client;
pub mod protocol;

use super::connection::StationSession;
use super::fleet::Fleet;
use super::web::connections::{self, ServeError};
use super::web::guard;
use axum::Router;
use axum::extract::ws::WebSocketUpgrade;
use axum::extract::{Request, State};
use axum::http::{HeaderMap, StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use parking_lot::Mutex;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::SystemTime;
use tokio::net::TcpListener;
use tokio::sync::Semaphore;

/// Names of the protocol: the present one, and the one before, which is the same in what is used here.
const PROTOCOLS: [&str; 2] = ["foxglove.sdk.v1", "foxglove.websocket.v1"];
/// Origins of Foxglove's pages; its desktop program names a file, or nothing.
const ORIGINS: [&str; 2] = ["https://app.foxglove.dev", "file://"];

/// Clients at a time.
const MAX_CLIENTS: usize = 16;

/// State shared by the clients.
struct Server {
    fleet: Arc<Mutex<Fleet>>,
    connection: StationSession,
    address: SocketAddr,
    names: Vec<String>,
    /// Tells this run of the station from others.
    session: String,
    places: Arc<Semaphore>,
}

/// Takes the address of the server.
///
/// # Errors
/// When it is taken, or none of this host's.
pub fn bind(address: SocketAddr) -> Result<std::net::TcpListener, ServeError> {
    connections::bind("Foxglove", address, "give another address with --foxglove")
}

/// Serves Foxglove at a bound address until the runtime ends; returns that address. Other hosts may use an address of the
/// station, its host name, or one of `names`.
///
/// # Errors
/// When the system refuses the socket.
pub async fn serve(
    listener: std::net::TcpListener,
    fleet: Arc<Mutex<Fleet>>,
    connection: StationSession,
    names: &[String],
) -> Result<SocketAddr, ServeError> {
    let listener = TcpListener::from_std(listener)?;
    let address = listener.local_addr()?;
    let names = names.iter().cloned().chain(guard::own_names()).collect();
    let since_1970 = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
    let session = since_1970.as_nanos().to_string();
    let places = Arc::new(Semaphore::new(MAX_CLIENTS));
    let server = Arc::new(Server { fleet, connection, address, names, session, places });
    let app = Router::new()
        .route("/", get(upgrade))
        .layer(axum::middleware::from_fn_with_state(Arc::clone(&server), check))
        .with_state(server);
    tokio::spawn(connections::serve(listener, app));
    Ok(address)
}

/// Refuses requests that a page of another origin makes: a browser lets any page open a socket to this host.
async fn check(State(server): State<Arc<Server>>, request: Request, next: Next) -> Response {
    match refusal(request.headers(), server.address.ip().is_loopback(), &server.names) {
        Some(reason) => (StatusCode::FORBIDDEN, reason).into_response(),
        None => next.run(request).await,
    }
}

fn refusal(headers: &HeaderMap, is_local: bool, names: &[String]) -> Option<&'static str> {
    if let Err(reason) = guard::own_host(headers, is_local, names) {
        return Some(reason);
    }
    let is_known = |origin: &[u8]| {
        let text = std::str::from_utf8(origin).unwrap_or_default();
        let own = text.strip_prefix("http://").is_some_and(guard::is_loopback);
        own || ORIGINS.contains(&text)
    };
    let is_refused = !headers.get_all(header::ORIGIN).iter().all(|origin| is_known(origin.as_bytes()));
    is_refused.then_some("only Foxglove and pages of this host may connect\n")
}

/// Opens the socket.
async fn upgrade(State(server): State<Arc<Server>>, upgrade: WebSocketUpgrade) -> Response {
    let upgrade = upgrade.protocols(PROTOCOLS);
    if upgrade.selected_protocol().is_none() {
        let words = "this server speaks foxglove.sdk.v1: open it in Foxglove as a Foxglove WebSocket\n";
        return (StatusCode::BAD_REQUEST, words).into_response();
    }
    let Ok(place) = Arc::clone(&server.places).try_acquire_owned() else {
        return (StatusCode::SERVICE_UNAVAILABLE, "too many clients; close one\n").into_response();
    };
    upgrade
        .max_message_size(protocol::MAX_REQUEST_BYTES)
        .max_frame_size(protocol::MAX_REQUEST_BYTES)
        .on_upgrade(move |socket| async move {
            client::Client::new(&server).run(socket).await;
            drop(place);
        })
}

#[cfg(test)]
mod tests {
    use super::*;
    use axum::http::HeaderValue;

    fn refused(host: &'static str, origin: Option<&'static str>, is_local: bool) -> bool {
        let mut headers = HeaderMap::new();
        headers.insert(header::HOST, HeaderValue::from_static(host));
        if let Some(origin) = origin {
            headers.insert(header::ORIGIN, HeaderValue::from_static(origin));
        }
        refusal(&headers, is_local, &["tower".into()]).is_some()
    }

    #[test]
    fn pages_of_others_are_refused() {
        for origin in [None, Some("https://app.foxglove.dev"), Some("file://"), Some("http://localhost:8080")]
        {
            assert!(!refused("127.0.0.1:8765", origin, true), "{origin:?}");
        }
        for origin in
            ["https://evil.example", "null", "https://app.foxglove.dev.evil.example", "http://localhost.evil"]
        {
            assert!(refused("127.0.0.1:8765", Some(origin), true), "{origin}");
        }
        assert!(refused("evil.example:8765", None, true) && refused("192.168.1.7:8765", None, true));
        assert!(!refused("tower:8765", None, false) && !refused("192.168.1.7:8765", None, false));
        assert!(refused("evil.example:8765", None, false));
    }
}
