//! Check that the autopilot answers.

use super::Verdict;
use mavlink::MavHeader;
use mavlink::dialects::common::{MavMessage, MavState};
use plumbline_checkup::Fitness;
use plumbline_config::options::{AutopilotConfig, AutopilotEndpoint};
use plumbline_flight::autopilot::inbox::{CHUNK, MavlinkInbox};
use plumbline_flight::autopilot::link::AutopilotLink;
use plumbline_flight::autopilot::message;
use plumbline_flight::autopilot::sender::{AUTOPILOT, COMPONENT};
use plumbline_flight::schedule::ticker::Monotonic;
use std::collections::BTreeSet;

/// An autopilot sends a heartbeat every second.
const PATIENCE_NS: i64 = 3_000_000_000;
/// Ours go out more often: an autopilot behind UDP learns from them where we are.
const HEARTBEAT_NS: i64 = 500_000_000;

/// Listens for a message of the autopilot that is configured.
pub(super) fn check(config: &AutopilotConfig) -> Verdict {
    if config.connect.is_empty() {
        return (Fitness::Good, "none configured".into());
    }
    let link = AutopilotEndpoint::parse(&config.connect)
        .and_then(|endpoint| AutopilotLink::open(&endpoint).map_err(|error| error.to_string()));
    match link {
        Ok(mut link) => judge(config, &heard(&mut link, config.system_id)),
        Err(words) => (Fitness::NotFit, words),
    }
}

/// Systems and components that sent something, until the autopilot has.
fn heard(link: &mut AutopilotLink, system_id: u32) -> BTreeSet<(u32, u8)> {
    let (mut inbox, mut bytes, mut heard) = (MavlinkInbox::default(), [0; CHUNK], BTreeSet::new());
    let began = Monotonic::now();
    let (end, mut next) = (began.plus_nanos(PATIENCE_NS), began);
    let mut now = began;
    while now < end && !heard.contains(&(system_id, AUTOPILOT)) {
        if now >= next {
            link.send(&heartbeat(system_id), now);
            next = now.plus_nanos(HEARTBEAT_NS);
        }
        if link.wait(next.min(end)) {
            let count = link.read(&mut bytes, Monotonic::now());
            inbox.put(&bytes[..count], |received| {
                heard.insert((received.system_id, received.component_id));
            });
            link.confirm(Monotonic::now());
        }
        now = Monotonic::now();
    }
    heard
}

fn heartbeat(system_id: u32) -> Vec<u8> {
    let header = MavHeader { system_id, component_id: COMPONENT, sequence: 0 };
    let message = MavMessage::HEARTBEAT(message::heartbeat(MavState::MAV_STATE_BOOT));
    let mut bytes = Vec::new();
    // Into memory: there is nothing that could fail.
    let _ = mavlink::write_v2_msg(&mut bytes, header, &message);
    bytes
}

fn judge(config: &AutopilotConfig, heard: &BTreeSet<(u32, u8)>) -> Verdict {
    let (address, system_id) = (&config.connect, config.system_id);
    if heard.contains(&(system_id, AUTOPILOT)) {
        return (Fitness::Good, format!("system {system_id} answers at {address}"));
    }
    if let Some((other, _)) = heard.iter().find(|(_, component)| *component == AUTOPILOT) {
        return (
            Fitness::NotFit,
            format!("{address}: system {other} answers, not {system_id}; set autopilot.system_id = {other}"),
        );
    }
    (
        Fitness::NotFit,
        format!(
            "{address}: no message within {} s; check the wiring, the baud rate, and that MAVLink is enabled on that port",
            PATIENCE_NS / 1_000_000_000
        ),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::net::UdpSocket;

    /// An autopilot of this system that answers the first datagram, or none.
    fn verdict(answers_as: Option<u32>) -> Verdict {
        let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
        let connect = format!("udp://{}", socket.local_addr().unwrap());
        let peer = std::thread::spawn(move || {
            let (_, from) = socket.recv_from(&mut [0; 512]).unwrap();
            if let Some(system_id) = answers_as {
                let header = MavHeader { system_id, component_id: AUTOPILOT, sequence: 0 };
                let message = MavMessage::HEARTBEAT(message::heartbeat(MavState::MAV_STATE_STANDBY));
                let mut bytes = Vec::new();
                mavlink::write_v2_msg(&mut bytes, header, &message).unwrap();
                socket.send_to(&bytes, from).unwrap();
            }
            socket
        });
        let verdict = check(&AutopilotConfig { connect, ..AutopilotConfig::default() });
        drop(peer.join().unwrap());
        verdict
    }

    #[test]
    fn an_autopilot_that_answers_is_named_and_another_system_too() {
        assert!(matches!(verdict(Some(1)), (Fitness::Good, words) if words.contains("system 1 answers")));
        assert!(
            matches!(verdict(Some(7)), (Fitness::NotFit, words) if words.contains("autopilot.system_id = 7"))
        );
    }

    #[test]
    fn silence_is_not_fit_and_no_autopilot_is_fine() {
        assert!(matches!(verdict(None), (Fitness::NotFit, words) if words.contains("no message within 3 s")));
        assert!(matches!(check(&AutopilotConfig::default()), (Fitness::Good, _)));
    }
}
