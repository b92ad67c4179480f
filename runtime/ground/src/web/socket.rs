//! The web socket of a page: sends what has changed, ten times a second.
//!
//! Each page has a cursor of its own in every path, map and list of events: a slow page delays no other and receives
//! everything in the end. Its queue is bounded: nothing is prepared while the last message is still being sent.

use super::super::cameras::Cameras;
use super::super::fleet::Fleet;
use super::super::vehicle::VehicleState;
use super::{Station, messages};
use axum::extract::State;
use axum::extract::ws::{Message, WebSocket, WebSocketUpgrade};
use axum::response::Response;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};
use tokio::time::MissedTickBehavior;

/// Period of updates.
const PERIOD: Duration = Duration::from_millis(100);
/// Longest message of a page, bytes.
const MAX_MESSAGE_BYTES: usize = 4_096;
/// Pages that are served at a time.
pub const MAX_PAGES: usize = 64;
/// Points of a path and keyframes in one message.
const MAX_TRACK: usize = 5_000;
const MAX_KEYFRAMES: usize = 100;
/// A page that accepts no data for so long is closed.
const SEND_PATIENCE: Duration = Duration::from_secs(10);

/// Opens the socket.
pub async fn upgrade(State(station): State<Arc<Station>>, upgrade: WebSocketUpgrade) -> Response {
    upgrade.max_message_size(MAX_MESSAGE_BYTES).max_frame_size(MAX_MESSAGE_BYTES).on_upgrade(
        move |socket| async move {
            if let Ok(_place) = station.pages.try_acquire() {
                Page::new(Arc::clone(&station)).run(socket).await;
            }
        },
    )
}

/// Messages of a page.
#[derive(Deserialize)]
#[serde(tag = "type", rename_all = "lowercase")]
enum PageMessage {
    /// Names of the vehicles whose camera is shown.
    Watch { camera: Vec<String> },
}

/// Position of a page in the data of a vehicle: up to where it was sent.
#[derive(Clone, Copy, Default)]
struct SentUpTo {
    track: Option<u64>,
    track_next: u64,
    map: Option<u64>,
    map_next: u64,
    scene: u64,
    corrected: u64,
    picture: u64,
}

/// One open page.
struct Page {
    station: Arc<Station>,
    places: BTreeMap<String, SentUpTo>,
    events: u64,
    cameras: Cameras,
}

impl Page {
    fn new(station: Arc<Station>) -> Self {
        Self { station, places: BTreeMap::new(), events: 0, cameras: Cameras::default() }
    }

    async fn run(mut self, mut socket: WebSocket) {
        let mut clock = tokio::time::interval(PERIOD);
        clock.set_missed_tick_behavior(MissedTickBehavior::Delay);
        if !send(&mut socket, Message::text(messages::hello(self.station.commands))).await {
            return;
        }
        loop {
            tokio::select! {
                _ = clock.tick() => {
                    if !self.send_news(&mut socket).await {
                        return;
                    }
                }
                received = socket.recv() => match received {
                    Some(Ok(Message::Text(text))) => self.receive(text.as_str()).await,
                    Some(Ok(Message::Binary(_))) => self.count_malformed(),
                    Some(Ok(Message::Ping(_) | Message::Pong(_))) => {}
                    Some(Ok(Message::Close(_))) | None => return,
                    Some(Err(_)) => {
                        // Too long, or no web socket at all.
                        self.count_malformed();
                        return;
                    }
                },
            }
        }
    }

    fn count_malformed(&self) {
        self.station.malformed.fetch_add(1, Ordering::Relaxed);
    }

    async fn receive(&mut self, text: &str) {
        let Some(camera) = watched(text) else { return self.count_malformed() };
        self.cameras.retain(|name| camera.contains(name));
        for name in camera {
            let is_known = self.station.fleet.lock().vehicles.contains_key(&name);
            if is_known
                && let Err(reason) =
                    self.cameras.watch(&self.station.connection, &self.station.fleet, name).await
            {
                tracing::debug!("{reason}");
            }
        }
    }

    /// Sends everything that this page has not received yet; whether it took it. One message at a time is made, so a page
    /// that does not read holds one in memory, however many vehicles there are.
    async fn send_news(&mut self, socket: &mut WebSocket) -> bool {
        let (first, names) = self.first_news(Instant::now());
        for message in first {
            if !send(socket, message).await {
                return false;
            }
        }
        for name in names {
            for part in PARTS {
                if let Some(message) = self.part(&name, part)
                    && !send(socket, message).await
                {
                    return false;
                }
            }
        }
        true
    }

    /// Figures and events, and the vehicles there are.
    fn first_news(&mut self, now: Instant) -> (Vec<Message>, Vec<String>) {
        let fleet = self.station.fleet.lock();
        let news = figures(&fleet, self.station.malformed.load(Ordering::Relaxed), self.events, now);
        self.events = fleet.events.total();
        self.places.retain(|name, _| fleet.vehicles.contains_key(name));
        (news, fleet.vehicles.keys().cloned().collect())
    }

    /// News of a part of a vehicle.
    fn part(&mut self, name: &str, part: Part) -> Option<Message> {
        let place = self.places.entry(name.to_owned()).or_default();
        let fleet = self.station.fleet.lock();
        let is_shown = part != Part::Picture || self.cameras.contains(name);
        fleet.vehicles.get(name).filter(|_| is_shown).and_then(|vehicle| part.news(name, vehicle, place))
    }
}

/// The cameras that a page says it looks at; `None` for words that are not understood.
pub fn watched(text: &str) -> Option<Vec<String>> {
    serde_json::from_str(text).ok().map(|PageMessage::Watch { camera }| camera)
}

/// Figures of all vehicles, and events from this count on.
fn figures(fleet: &Fleet, malformed: u64, events: u64, now: Instant) -> Vec<Message> {
    let mut news = vec![Message::text(messages::fleet(fleet, malformed, now))];
    news.extend(fleet.events.since(events).map(|event| Message::text(messages::event(event))));
    news
}

/// Messages about every vehicle for a page that has just been opened.
#[cfg(any(test, feature = "fuzzing"))]
pub fn everything(fleet: &Fleet) -> Vec<Message> {
    let mut news = figures(fleet, 0, 0, Instant::now());
    for (name, vehicle) in &fleet.vehicles {
        let mut place = SentUpTo::default();
        news.extend(PARTS.iter().filter_map(|part| part.news(name, vehicle, &mut place)));
    }
    news
}

/// Parts of a vehicle that a page gets beside its figures, each in a message of its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Part {
    Track,
    Map,
    Corrected,
    Scene,
    Picture,
}

/// In the order in which they are sent.
const PARTS: [Part; 5] = [Part::Track, Part::Map, Part::Corrected, Part::Scene, Part::Picture];

impl Part {
    /// News for a page that has everything up to `place`.
    fn news(self, name: &str, vehicle: &VehicleState, place: &mut SentUpTo) -> Option<Message> {
        match self {
            Self::Track => track(name, vehicle, place),
            Self::Map => map(name, vehicle, place),
            Self::Corrected => is_newer(&mut place.corrected, vehicle.corrected.version)
                .then(|| Message::text(messages::corrected(name, &vehicle.corrected))),
            Self::Scene => is_newer(&mut place.scene, vehicle.map.scene.version)
                .then(|| Message::text(messages::scene(name, &vehicle.map.scene))),
            Self::Picture => {
                let picture = vehicle.picture.as_ref()?;
                is_newer(&mut place.picture, picture.version)
                    .then(|| Message::binary(messages::picture(name, &picture.message)))
            }
        }
    }
}

/// True if a version differs from the last one, which it becomes.
fn is_newer(last: &mut u64, version: u64) -> bool {
    std::mem::replace(last, version) != version
}

fn track(name: &str, vehicle: &VehicleState, place: &mut SentUpTo) -> Option<Message> {
    let is_new = place.track != Some(vehicle.track.epoch);
    let all = &vehicle.track.points;
    let first = if is_new { 0 } else { place.track_next }.clamp(all.first(), all.total());
    let points: Vec<_> = all.since(first).take(MAX_TRACK).copied().collect();
    if !is_new && points.is_empty() {
        return None;
    }
    place.track = Some(vehicle.track.epoch);
    place.track_next = first + points.len() as u64;
    Some(Message::text(messages::track(name, is_new, &points)))
}

fn map(name: &str, vehicle: &VehicleState, place: &mut SentUpTo) -> Option<Message> {
    let is_new = place.map != Some(vehicle.map.epoch);
    let (next, keyframes) = vehicle.map.since(if is_new { 0 } else { place.map_next }, MAX_KEYFRAMES);
    if !is_new && keyframes.is_empty() {
        return None;
    }
    place.map = Some(vehicle.map.epoch);
    place.map_next = next;
    Some(Message::text(messages::map(name, is_new, &keyframes)))
}

/// Sends a message; whether the page accepted it.
async fn send(socket: &mut WebSocket, message: Message) -> bool {
    let sent = tokio::time::timeout(SEND_PATIENCE, socket.send(message)).await;
    matches!(sent, Ok(Ok(())))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_part_of_a_vehicle_is_told_once() {
        let mut fleet = Fleet::default();
        fleet.alive("drone", true);
        let vehicle = &fleet.vehicles["drone"];
        let mut place = SentUpTo::default();
        let mut told = || PARTS.iter().filter_map(|part| part.news("drone", vehicle, &mut place)).count();
        // An empty path and an empty map begin what was there before.
        assert_eq!((told(), told()), (2, 0));
        assert_eq!(everything(&fleet).len(), 4, "figures, the event, path and map");
    }
}
