//! The web socket of a page: sends what has changed, ten times a second.
//!
//! Each page has a cursor of its own in every path, map and list of events: a slow page delays no other and receives
//! everything in the end. Its queue is bounded: nothing is prepared while the last message is still being sent.

use super::super::fleet::Fleet;
use super::super::fleet::lock;
use super::super::listen::watch_camera;
use super::super::vehicle::VehicleState;
use super::{Station, messages};
use axum::extract::State;
use axum::extract::ws::{Message, WebSocket, WebSocketUpgrade};
use axum::response::Response;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};
use tokio::time::MissedTickBehavior;
use zenoh::pubsub::Subscriber;

/// Period of updates.
const PERIOD: Duration = Duration::from_millis(100);
/// Longest message of a page, bytes.
const MAX_MESSAGE_BYTES: usize = 4_096;
/// Pages that are served at a time.
const MAX_PAGES: u64 = 64;
/// Vehicles whose camera a page may watch at a time.
const MAX_CAMERAS: usize = 4;
/// Points of a path and keyframes in one message.
const MAX_TRACK: usize = 5_000;
const MAX_KEYFRAMES: usize = 100;
/// A page that accepts no data for so long is closed.
const SEND_PATIENCE: Duration = Duration::from_secs(10);

/// Opens the socket.
pub async fn upgrade(State(station): State<Arc<Station>>, upgrade: WebSocketUpgrade) -> Response {
    upgrade.max_message_size(MAX_MESSAGE_BYTES).max_frame_size(MAX_MESSAGE_BYTES).on_upgrade(
        move |socket| async move {
            let (pages, _place) = OpenPage::count(&station.pages);
            if pages < MAX_PAGES {
                Page::new(Arc::clone(&station)).run(socket).await;
            }
        },
    )
}

/// A page that is counted as long as this is there, however its task ends.
struct OpenPage(Arc<AtomicU64>);

impl OpenPage {
    /// Counts a page; with it, how many there were before.
    fn count(pages: &Arc<AtomicU64>) -> (u64, Self) {
        (pages.fetch_add(1, Ordering::Relaxed), Self(Arc::clone(pages)))
    }
}

impl Drop for OpenPage {
    fn drop(&mut self) {
        self.0.fetch_sub(1, Ordering::Relaxed);
    }
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
    cameras: BTreeMap<String, Subscriber<()>>,
}

impl Page {
    fn new(station: Arc<Station>) -> Self {
        Self { station, places: BTreeMap::new(), events: 0, cameras: BTreeMap::new() }
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
        self.cameras.retain(|name, _| camera.contains(name));
        for name in camera.into_iter().take(MAX_CAMERAS) {
            let is_known = lock(&self.station.fleet).vehicles.contains_key(&name);
            if is_known
                && !self.cameras.contains_key(&name)
                && let Some(session) = self.station.connection.session()
            {
                match watch_camera(session, &name, &self.station.fleet).await {
                    Ok(subscriber) => drop(self.cameras.insert(name, subscriber)),
                    Err(error) => tracing::warn!("{error}"),
                }
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
        let fleet = lock(&self.station.fleet);
        let news = figures(&fleet, self.station.malformed.load(Ordering::Relaxed), self.events, now);
        self.events = fleet.event_count;
        self.places.retain(|name, _| fleet.vehicles.contains_key(name));
        (news, fleet.vehicles.keys().cloned().collect())
    }

    /// News of a part of a vehicle.
    fn part(&mut self, name: &str, part: Part) -> Option<Message> {
        let place = self.places.entry(name.to_owned()).or_default();
        let fleet = lock(&self.station.fleet);
        let is_shown = part != Part::Picture || self.cameras.contains_key(name);
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
    news.extend(fleet.events_since(events).map(|event| Message::text(messages::event(event))));
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
    let (first, points) = vehicle.track.since(if is_new { 0 } else { place.track_next }, MAX_TRACK);
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
    fn a_page_whose_task_panics_gives_its_place_back() {
        let pages = Arc::<AtomicU64>::default();
        let runtime = tokio::runtime::Builder::new_current_thread().build().unwrap();
        for before in [0, 0] {
            let theirs = Arc::clone(&pages);
            let task = runtime.spawn(async move {
                let (count, _place) = OpenPage::count(&theirs);
                assert_ne!(count, before, "this task panics");
            });
            assert!(runtime.block_on(task).unwrap_err().is_panic());
            assert_eq!(pages.load(Ordering::Relaxed), 0);
        }
    }

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
