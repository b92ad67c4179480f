//! Filters and layers of the log lines.

use super::log_lines;
use plumbline_link::net::audit;
use std::io::IsTerminal as _;

/// Logs warnings; of a live flight (`is_live`) also what it says of itself.
pub fn start(verbose: u8, is_live: bool) {
    use tracing_subscriber::layer::SubscriberExt as _;
    use tracing_subscriber::util::SubscriberInitExt as _;
    use tracing_subscriber::{EnvFilter, Layer as _};

    // Attempts to connect are many; the audit logs the cause of those that fail, and handshakes that were refused. That peers
    // do not gossip is meant. Data of a peer that has just gone are nothing to act on.
    let default = [
        "warn,zenoh::net::runtime::orchestrator=error,zenoh_link_tls::unicast=error,zenoh::net::routing::hat::peer=error,zenoh::api::session=off,zenoh_transport::unicast::establishment=off",
        "info,zenoh=warn,zenoh::net::runtime::orchestrator=error,zenoh_link_tls::unicast=error,zenoh::net::routing::hat::peer=error,zenoh::api::session=off,zenoh_transport::unicast::establishment=off",
        "debug",
    ][usize::from(verbose.min(2))];
    let live = if is_live && verbose == 0 { ",plumbline=info,plumbline_flight=info" } else { "" };
    let filter =
        EnvFilter::try_from_default_env().unwrap_or_else(|_| EnvFilter::new(format!("{default}{live}")));
    // Colours are for people: https://no-color.org.
    let is_coloured =
        std::io::stderr().is_terminal() && std::env::var_os("NO_COLOR").is_none_or(|value| value.is_empty());
    let lines = tracing_subscriber::fmt::layer()
        .log_internal_errors(false)
        .with_writer(log_lines::LogLines)
        .with_ansi(is_coloured)
        .with_target(verbose > 0)
        .without_time();
    let access = tracing_subscriber::filter::Targets::new().with_targets(audit::TARGETS);
    tracing_subscriber::registry()
        .with(lines.with_filter(filter))
        .with(audit::Audit.with_filter(access))
        .init();
    log_lines::start();
    log_lines::take_panics();
}
