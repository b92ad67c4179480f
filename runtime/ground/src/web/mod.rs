//! The web page of the ground station: one origin, everything embedded in the binary.
//!
//! The page (`runtime/ground/web`) speaks to [`socket`] for what changes and to [`api`] for what one asks. Who may is in
//! [`guard`].

pub(super) mod api;
mod assets;
pub(super) mod connections;
pub(super) mod guard;
mod messages;
pub(super) mod socket;

use super::connection::StationSession;
use super::fleet::Fleet;
use axum::Router;
use axum::routing::{get, post};
use connections::ServeError;
use parking_lot::Mutex;
use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::AtomicU64;
use tokio::net::TcpListener;
use tokio::sync::Semaphore;

/// State shared by the handlers.
pub struct Station {
    /// Vehicles known.
    pub fleet: Arc<Mutex<Fleet>>,
    /// To the vehicles.
    pub connection: StationSession,
    /// True if the page may give commands.
    pub commands: bool,
    /// Messages of pages that could not be understood.
    pub malformed: AtomicU64,
    /// Pages that may still be opened.
    pub pages: Semaphore,
    /// Address on which it is served.
    pub address: SocketAddr,
    /// Names by which the page may be opened, beside the station's addresses.
    pub names: Vec<String>,
    /// Downloads that may go on at a time: each is made in memory.
    pub downloads: Arc<Semaphore>,
}

/// Downloads at a time.
const MAX_DOWNLOADS: usize = 2;

/// Takes the address of the page.
///
/// # Errors
/// When it is taken, or none of this host's.
pub fn bind(address: SocketAddr) -> Result<std::net::TcpListener, ServeError> {
    let cure = "give another address with --http, or --no-http for none";
    connections::bind("the page", address, cure)
}

/// Serves the page at a bound address until the runtime ends; returns that address. Other hosts open it by an address of
/// the station, by its host name, or by one of `names`.
///
/// # Errors
/// When the system refuses the socket.
pub async fn serve(
    listener: std::net::TcpListener,
    fleet: Arc<Mutex<Fleet>>,
    connection: StationSession,
    commands: bool,
    names: &[String],
) -> Result<SocketAddr, ServeError> {
    let listener = TcpListener::from_std(listener)?;
    let address = listener.local_addr()?;
    let (malformed, pages) = (AtomicU64::new(0), Semaphore::new(socket::MAX_PAGES));
    let names = names.iter().cloned().chain(guard::own_names()).collect();
    let downloads = Arc::new(Semaphore::new(MAX_DOWNLOADS));
    let station =
        Arc::new(Station { fleet, connection, commands, malformed, pages, address, names, downloads });
    let app = router(station);
    tokio::spawn(connections::serve(listener, app));
    Ok(address)
}

fn router(station: Arc<Station>) -> Router {
    Router::new()
        .route("/ws", get(socket::upgrade))
        .route("/api/vehicles/{vehicle}/reset", post(api::reset))
        .route("/api/vehicles/{vehicle}/trajectory.tum", get(api::download))
        .fallback(get(assets::serve))
        .layer(axum::extract::DefaultBodyLimit::max(guard::MAX_BODY_BYTES))
        .layer(axum::middleware::from_fn_with_state(Arc::clone(&station), guard::check))
        .with_state(station)
}
