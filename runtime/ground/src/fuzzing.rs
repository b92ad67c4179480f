//! Input of a ground station from the fuzzers: messages of vehicles, and requests of pages.

use super::clock::Exchange;
use super::fleet::Fleet;
use super::foxglove;
use super::listen;
use super::track::tum;
use super::web::{api, guard, socket};
use axum::extract::ws::Message;
use parking_lot::Mutex;
use plumbline_link::net::{read, security};
use plumbline_record::messages::{MapSaved, PastTrajectory, ResetDone};
use plumbline_record::topics::Topic;
use std::time::Instant;

/// Messages of a vehicle, one after the other: the number of the topic, the length as two bytes (little end first), and
/// the payload. What they make of the station can be shown, told to a page and exported.
///
/// # Panics
/// When a message is neither taken nor counted, or what a page is told is no JSON.
pub fn network_messages(data: &[u8]) {
    show(&heard(data).lock());
}

/// State of a station after these messages.
fn heard(data: &[u8]) -> Mutex<Fleet> {
    let fleet = Mutex::new(Fleet::default());
    let mut rest = data;
    while let Some(([topic, low, high], after)) = rest.split_first_chunk() {
        let length = usize::from(u16::from_le_bytes([*low, *high])).min(after.len());
        let (payload, next) = after.split_at(length);
        take(&fleet, *topic, payload);
        rest = next;
    }
    fleet
}

/// Number of a published topic in seeds, which stays while others come: that of its kind, if it has one.
fn seed_number(topic: Topic) -> u8 {
    let mut without_kind = Topic::published().filter(|(topic, _)| topic.kind() == 0);
    without_kind.position(|(known, _)| known == topic).map_or(topic.kind() as u8, |place| place as u8)
}

/// Takes `bytes` as a message of a vehicle on the topic of this number; others are counted round.
pub fn apply_numbered(fleet: &Mutex<Fleet>, number: u8, bytes: &[u8]) {
    let topics: Vec<Topic> = Topic::published().map(|(topic, _)| topic).collect();
    let known = topics.iter().find(|topic| seed_number(**topic) == number);
    listen::apply(
        fleet,
        *known.unwrap_or(&topics[usize::from(number) % topics.len()]),
        "drone",
        bytes,
        0,
        false,
    );
}

/// A message of a topic, or the answer to a question.
fn take(fleet: &Mutex<Fleet>, topic: u8, payload: &[u8]) {
    match topic {
        b'c' => {
            let Some(clock) = read::clock(payload) else { return };
            let mut fleet = fleet.lock();
            let Some(vehicle) = fleet.vehicles.get_mut("drone") else { return };
            let (received_ns, answered_ns) = (clock.received_ns, clock.answered_ns);
            vehicle.clock.add(Exchange { asked_ns: 0, received_ns, answered_ns, came_ns: 1_000_000 });
        }
        b't' => {
            let Some(PastTrajectory { poses: mut past }) = read::decode(payload) else { return };
            past.sort_by_key(|pose| pose.stamp);
            if let Some(vehicle) = fleet.lock().vehicle("drone") {
                vehicle.fill(&past);
            }
        }
        b'r' => drop(read::decode::<ResetDone>(payload)),
        b's' => drop(read::decode::<MapSaved>(payload)),
        topic => {
            let count = |fleet: &Fleet| fleet.malformed + fleet.vehicles.len() as u64;
            apply_numbered(fleet, topic, payload);
            assert!(count(&fleet.lock()) >= 1);
        }
    }
}

fn show(fleet: &Fleet) {
    let _ = fleet.lines(Instant::now());
    for message in socket::everything(fleet) {
        if let Message::Text(text) = message {
            let told: serde_json::Value = serde_json::from_str(text.as_str()).expect("the page reads JSON");
            assert!(told["type"].is_string());
        }
    }
    for vehicle in fleet.vehicles.values() {
        let _ = vehicle.map.missing(100);
        let samples: Vec<_> = vehicle.poses.iter().copied().collect();
        assert_eq!(tum(&samples).lines().count(), samples.len());
    }
}

/// Input from a page: on its web socket, as the body of a request, and as the host it was opened by.
///
/// # Panics
/// When the name of another host passes for this one.
pub fn web_socket(data: &[u8]) {
    let Ok(text) = std::str::from_utf8(data) else { return };
    let _ = socket::watched(text);
    let _ = foxglove::protocol::request(text);
    let _ = serde_json::from_str::<api::ResetRequest>(text);
    if guard::is_loopback(text) {
        assert!(text.contains("localhost") || text.contains("127.") || text.contains("::"), "{text:?}");
    }
}

/// An endpoint: what passes for this host's alone is this host's to Zenoh as well.
///
/// # Panics
/// When it is not.
pub fn peer_endpoint(data: &[u8]) {
    let Ok(text) = std::str::from_utf8(data) else { return };
    let is_ours = security::is_loopback(text);
    let Ok(endpoint) = text.parse::<zenoh::config::EndPoint>() else { return };
    if is_ours {
        let address = endpoint.address();
        let host = address.as_str().rsplit_once(':').map_or("", |(host, _)| host);
        let host = host.trim_start_matches('[').trim_end_matches(']');
        let ip = host.parse::<std::net::IpAddr>();
        assert!(host == "localhost" || ip.is_ok_and(|ip| ip.is_loopback()), "{text:?}");
    }
}

#[cfg(test)]
#[path = "../../../fuzz/smoke.rs"]
mod smoke;

#[cfg(test)]
mod tests {
    use super::smoke::over_seeds_and_mutations;
    use super::*;

    #[test]
    fn fuzz_seeds_of_the_network_are_understood() {
        let seed = include_bytes!("../../../fuzz/seeds/network_messages/all");
        let fleet = heard(seed);
        let fleet = fleet.lock();
        let vehicle = &fleet.vehicles["drone"];
        assert_eq!((fleet.malformed, vehicle.map.len()), (0, 1));
        assert!(
            vehicle.picture.is_some()
                && vehicle.clock.round_trip_ns().is_some()
                && !vehicle.track.points.is_empty()
        );
    }

    #[test]
    fn fuzz_network_messages() {
        over_seeds_and_mutations("network_messages", 2000, network_messages);
    }

    #[test]
    fn fuzz_web_socket() {
        over_seeds_and_mutations("web_socket", 20_000, web_socket);
    }

    #[test]
    fn fuzz_peer_endpoint() {
        over_seeds_and_mutations("peer_endpoint", 20_000, peer_endpoint);
    }
}
