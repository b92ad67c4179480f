//! The map on the network: where the odometry lies in it, and the corrected path with its loops.
//!
//! The path is sent as a whole, since a loop moves all of it; so it is bounded, and seldom. Each correction says how many
//! paths there were: who has missed the newest one asks for it ([`super::answers`]).

use super::answers::{Archive, lock};
use super::declare::declare_publisher;
use super::error::NetError;
use super::pace::{Pace, Rates};
use super::rings::Rings;
use super::wire;
use plumbline_estimator::places::{MapEstimate, MapPath};
use prost::Message;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};
use zenoh::Session;
use zenoh::pubsub::Publisher;
use zenoh::qos::Priority;

/// The keys `map/correction` and `map/path`.
pub struct MapPublisher {
    correction: Publisher<'static>,
    path: Publisher<'static>,
    archive: Arc<Mutex<Archive>>,
    pace: Pace,
    path_period: Duration,
    corrections: u64,
    paths: u64,
    /// The last that was told of.
    last: Option<MapEstimate>,
    /// The path as it is now, as it was sent, and when.
    newest: MapPath,
    sent: MapPath,
    sent_at: Option<Instant>,
}

impl MapPublisher {
    /// Declares the keys; `archive` keeps the newest path for those who ask.
    ///
    /// # Errors
    /// When Zenoh refuses a key.
    pub async fn declare(
        session: &Session,
        vehicle: &str,
        rates: Rates,
        archive: Arc<Mutex<Archive>>,
    ) -> Result<Self, NetError> {
        let declare = |name, schema| declare_publisher(session, vehicle, name, schema, Priority::Data);
        Ok(Self {
            correction: declare("map/correction", "MapCorrection").await?,
            path: declare("map/path", "MapPath").await?,
            archive,
            pace: Pace::new(rates.correction_hz),
            path_period: rates.path_period(),
            corrections: 0,
            paths: 0,
            last: None,
            newest: MapPath::new(rates.path_poses),
            sent: MapPath::new(rates.path_poses),
            sent_at: None,
        })
    }

    /// Takes where the odometry lies in the map, and sends it where it is due, or has become known or unknown.
    pub async fn follow(&mut self, map: &MapEstimate) {
        let was_known = self.last.as_ref().is_some_and(|last| last.pose_m_o.is_some());
        let is_news = self.last.is_none() || was_known != map.pose_m_o.is_some();
        if self.pace.admits(map.stamp) || is_news {
            self.send_correction(map).await;
        }
        self.last = Some(map.clone());
    }

    /// Takes the paths that wait, and sends the newest if it has changed and is due.
    pub async fn send_path(&mut self, rings: &Rings) {
        while rings.paths.read(|path| self.newest.clone_from(path)).is_some() {}
        if self.sent_at.is_none_or(|at| at.elapsed() >= self.path_period) {
            self.send_changed_path().await;
        }
    }

    /// Sends how it all ended: the flight is over.
    pub async fn finish(&mut self) {
        self.send_changed_path().await;
        if let Some(last) = self.last.take() {
            self.send_correction(&last).await;
        }
    }

    async fn send_changed_path(&mut self) {
        if self.newest == self.sent {
            return;
        }
        let bytes = wire::path(&self.newest, self.paths).encode_to_vec();
        self.paths += 1;
        lock(&self.archive).path.clone_from(&bytes);
        let _ = self.path.put(bytes).await;
        self.sent.clone_from(&self.newest);
        self.sent_at = Some(Instant::now());
    }

    async fn send_correction(&mut self, map: &MapEstimate) {
        let message = wire::correction(map, self.corrections, self.paths);
        self.corrections += 1;
        let _ = self.correction.put(message.encode_to_vec()).await;
    }
}
