//! The web socket of a page: sends what has changed, ten times a second.
//!
//! Each page has a cursor of its own in every path, map and list of events: a slow page delays no other and receives
//! everything in the end. Its queue is bounded: nothing is prepared while the last message is still being sent.

use super::super::fleet::Fleet;
use super::super::fleet::lock;
use super::super::listen::watch_camera;
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
            let pages = station.pages.fetch_add(1, Ordering::Relaxed);
            if pages < MAX_PAGES {
                Page::new(Arc::clone(&station)).run(socket).await;
            }
            station.pages.fetch_sub(1, Ordering::Relaxed);
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

/// What a page has received of a vehicle.
#[derive(Clone, Copy, Default)]
struct Place {
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
    places: BTreeMap<String, Place>,
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
        if !send(&mut socket, vec![Message::text(messages::hello(self.station.commands))]).await {
            return;
        }
        loop {
            tokio::select! {
                _ = clock.tick() => {
                    let updates = self.updates(Instant::now());
                    if !send(&mut socket, updates).await {
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

    /// Everything that this page has not received yet.
    fn updates(&mut self, now: Instant) -> Vec<Message> {
        let station = Arc::clone(&self.station);
        let fleet = lock(&station.fleet);
        let mut news =
            vec![Message::text(messages::fleet(&fleet, station.malformed.load(Ordering::Relaxed), now))];
        news.extend(fleet.events_since(self.events).map(|event| Message::text(messages::event(event))));
        self.events = fleet.event_count;
        let Self { places, cameras, .. } = self;
        places.retain(|name, _| fleet.vehicles.contains_key(name));
        for name in fleet.vehicles.keys() {
            let place = places.entry(name.clone()).or_default();
            paths_and_maps(&fleet, name, place, &mut news);
            if cameras.contains_key(name) {
                picture(&fleet, name, place, &mut news);
            }
        }
        news
    }
}

/// The cameras that a page says it looks at; `None` for words that are not understood.
pub fn watched(text: &str) -> Option<Vec<String>> {
    serde_json::from_str(text).ok().map(|PageMessage::Watch { camera }| camera)
}

/// Everything that a page which has just been opened is told of every vehicle.
#[cfg(any(test, feature = "fuzzing"))]
pub fn everything(fleet: &Fleet) -> Vec<Message> {
    let mut news = vec![Message::text(messages::fleet(fleet, 0, Instant::now()))];
    news.extend(fleet.events_since(0).map(|event| Message::text(messages::event(event))));
    for name in fleet.vehicles.keys() {
        let mut place = Place::default();
        paths_and_maps(fleet, name, &mut place, &mut news);
        picture(fleet, name, &mut place, &mut news);
    }
    news
}

fn paths_and_maps(fleet: &Fleet, name: &str, place: &mut Place, news: &mut Vec<Message>) {
    let Some(vehicle) = fleet.vehicles.get(name) else { return };
    let is_new = place.track != Some(vehicle.track.epoch);
    let (first, points) = vehicle.track.since(if is_new { 0 } else { place.track_next }, MAX_TRACK);
    if is_new || !points.is_empty() {
        place.track = Some(vehicle.track.epoch);
        place.track_next = first + points.len() as u64;
        news.push(Message::text(messages::track(name, is_new, &points)));
    }
    let is_new = place.map != Some(vehicle.map.epoch);
    let (next, keyframes) = vehicle.map.since(if is_new { 0 } else { place.map_next }, MAX_KEYFRAMES);
    if is_new || !keyframes.is_empty() {
        place.map = Some(vehicle.map.epoch);
        place.map_next = next;
        news.push(Message::text(messages::map(name, is_new, &keyframes)));
    }
    if place.corrected != vehicle.corrected.version {
        place.corrected = vehicle.corrected.version;
        news.push(Message::text(messages::corrected(name, &vehicle.corrected)));
    }
    if place.scene != vehicle.map.scene.version {
        place.scene = vehicle.map.scene.version;
        news.push(Message::text(messages::scene(name, &vehicle.map.scene)));
    }
}

fn picture(fleet: &Fleet, name: &str, place: &mut Place, news: &mut Vec<Message>) {
    let Some(picture) = fleet.vehicles.get(name).and_then(|vehicle| vehicle.picture.as_ref()) else { return };
    if place.picture != picture.version {
        place.picture = picture.version;
        news.push(Message::binary(messages::picture(name, &picture.message)));
    }
}

/// Sends the messages; whether the page accepted them.
async fn send(socket: &mut WebSocket, messages: Vec<Message>) -> bool {
    for message in messages {
        let sent = tokio::time::timeout(SEND_PATIENCE, socket.send(message)).await;
        if !matches!(sent, Ok(Ok(()))) {
            return false;
        }
    }
    true
}
