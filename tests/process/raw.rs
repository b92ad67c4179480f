//! Peers that speak Zenoh without Zenoh, over TLS: they say what no session would, and hear all that comes.

#[path = "../../fuzz/hostile.rs"]
pub mod hostile;
#[path = "../../fuzz/raw_peer.rs"]
pub mod raw_peer;

use super::roles::{attacker, make_keys, open_vehicle};
use super::vehicle::free_port;
use raw_peer::{Kind, RawPeer, declare_key};
use rustls::pki_types::pem::PemObject as _;
use rustls::pki_types::{CertificateDer, PrivateKeyDer, ServerName};
use rustls::{ClientConfig, ClientConnection, RootCertStore, StreamOwned};
use std::net::TcpStream;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// What comes within this time has come.
const QUIET: Duration = Duration::from_secs(2);

/// A TLS connection with the certificate of a role, or with none.
pub fn connect(
    folder: &Path,
    role: Option<&str>,
    port: u16,
) -> std::io::Result<StreamOwned<ClientConnection, TcpStream>> {
    let mut roots = RootCertStore::empty();
    roots.add(CertificateDer::from_pem_file(folder.join("authority.pem")).unwrap()).unwrap();
    let provider = Arc::new(rustls::crypto::ring::default_provider());
    let config = ClientConfig::builder_with_provider(provider).with_safe_default_protocol_versions().unwrap();
    let config = config.with_root_certificates(roots);
    let config = match role {
        None => config.with_no_client_auth(),
        Some(role) => {
            let certificate = CertificateDer::from_pem_file(folder.join(format!("{role}.pem"))).unwrap();
            let key = PrivateKeyDer::from_pem_file(folder.join(format!("{role}.key"))).unwrap();
            config.with_client_auth_cert(vec![certificate], key).unwrap()
        }
    };
    let name = ServerName::try_from("127.0.0.1").unwrap();
    let connection = ClientConnection::new(Arc::new(config), name).unwrap();
    let stream = TcpStream::connect(("127.0.0.1", port))?;
    stream.set_read_timeout(Some(QUIET))?;
    Ok(StreamOwned::new(connection, stream))
}

/// Opens a vehicle's session in this process; its port.
async fn vehicle(folder: &Path, excluded: &[String]) -> (zenoh::Session, u16) {
    let port = free_port();
    (open_vehicle(folder, &format!("tls/127.0.0.1:{port}"), excluded).await, port)
}

fn runtime() -> tokio::runtime::Runtime {
    tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build().unwrap()
}

#[test]
fn network_malformed_key_expressions_end_the_link_and_leave_the_session() {
    let folder = tempfile::tempdir().unwrap();
    make_keys(folder.path(), false);
    let runtime = runtime();
    let (session, port) = runtime.block_on(vehicle(folder.path(), &[]));
    let stream = connect(folder.path(), Some("viewer"), port).unwrap();
    let mut peer = RawPeer::open(stream, Kind::Client, [5; 16]).unwrap();
    peer.send_frame(&declare_key(1, 0, "$*$*")).unwrap();
    let _ = peer.send_frame(&declare_key(2, 0, "a"));
    while peer.receive().is_ok() {}
    // Who comes next is let in, and the tables are not poisoned.
    let endpoint = format!("tls/127.0.0.1:{port}");
    let operator = runtime.block_on(attacker(folder.path(), "operator", &endpoint));
    let is_asked = runtime.block_on(async {
        let (sender, mut asked) = tokio::sync::mpsc::channel(8);
        let told = move |_| sender.try_send(()).unwrap_or_default();
        session.declare_queryable("plumbline/drone/config").callback(told).background().await.unwrap();
        for _ in 0..50 {
            drop(operator.get("plumbline/drone/config").await.unwrap());
            if tokio::time::timeout(QUIET / 10, asked.recv()).await.is_ok() {
                return true;
            }
        }
        false
    });
    assert!(is_asked);
}

#[test]
fn network_who_has_no_certificate_or_an_excluded_one_gets_no_transport() {
    let folder = tempfile::tempdir().unwrap();
    make_keys(folder.path(), false);
    let runtime = runtime();
    let (_session, port) = runtime.block_on(vehicle(folder.path(), &["router".into()]));
    let is_let_in = |role: Option<&str>| {
        let stream = connect(folder.path(), role, port).unwrap();
        RawPeer::open(stream, Kind::Client, [6; 16]).is_ok()
    };
    assert!(is_let_in(Some("viewer")));
    assert!(!is_let_in(Some("router")) && !is_let_in(None));
}

#[test]
fn network_identifiers_of_others_are_not_told() {
    let folder = tempfile::tempdir().unwrap();
    make_keys(folder.path(), false);
    let runtime = runtime();
    let (session, port) = runtime.block_on(vehicle(folder.path(), &[]));
    let endpoint = format!("tls/127.0.0.1:{port}");
    let operator = runtime.block_on(attacker(folder.path(), "operator", &endpoint));
    let stream = connect(folder.path(), Some("viewer"), port).unwrap();
    let mut viewer = RawPeer::open(stream, Kind::Peer, [7; 16]).unwrap();
    let mut heard = Vec::new();
    let end = Instant::now() + 2 * QUIET;
    while let Ok(batch) = viewer.receive()
        && Instant::now() < end
    {
        heard.extend(batch);
    }
    let tells = |zid: zenoh::config::ZenohId| {
        let bytes = zid.to_le_bytes();
        heard.windows(bytes.len()).any(|part| part == bytes)
    };
    assert!(!tells(operator.zid()), "a viewer that listens is told who the operator is");
    drop(session);
}
