//! The map on the network: where the odometry lies in it, and the corrected path with its loops.
//!
//! The path is sent as a whole, since a loop moves all of it; so it is bounded, and seldom. Each health message says how many
//! paths there were: who has missed the newest one asks for it ([`super::answers`]).

use super::error::NetError;
use super::history::History;
use super::now_ns;
use super::outlet::Outlet;
use super::pace::Rates;
use parking_lot::Mutex;
use plumbline_estimator::places::{MapEstimate, MapPath};
use plumbline_record::messages::Envelope;
use plumbline_record::protobuf::encode;
use plumbline_record::topics::Topic;
use std::sync::Arc;
use std::time::{Duration, Instant};
use zenoh::Session;

/// The keys `map/correction` and `map/path`.
pub struct MapPublisher {
    correction: Outlet,
    path: Outlet,
    history: Arc<Mutex<History>>,
    path_poses: usize,
    path_period: Duration,
    /// The last place in the map that came, with its message.
    last: Option<(MapEstimate, Vec<u8>)>,
    /// The newest path and its message, until it is sent.
    newest: Option<(MapPath, Vec<u8>)>,
    /// Message of the path that was sent last, and when.
    sent: Option<(Vec<u8>, Instant)>,
}

impl MapPublisher {
    /// Declares the keys; `history` keeps the newest path for those who ask.
    ///
    /// # Errors
    /// When Zenoh refuses a key.
    pub async fn declare(
        session: &Session,
        vehicle: &str,
        rates: Rates,
        history: Arc<Mutex<History>>,
    ) -> Result<Self, NetError> {
        let declare = |topic| Outlet::declare(session, vehicle, topic, rates.link);
        Ok(Self {
            correction: declare(Topic::MapEstimate).await?,
            path: declare(Topic::Path).await?,
            history,
            path_poses: rates.path_poses,
            path_period: rates.period(Topic::Path),
            last: None,
            newest: None,
            sent: None,
        })
    }

    /// Paths sent so far.
    pub fn paths(&self) -> u64 {
        self.path.sequence
    }

    /// Takes where the odometry lies in the map, and sends it where it is due, or has become known or unknown.
    pub async fn follow(&mut self, map: MapEstimate, message: Vec<u8>) {
        let was_known = self.last.as_ref().is_some_and(|(last, _)| last.pose_m_o.is_some());
        let is_news = self.last.is_none() || was_known != map.pose_m_o.is_some();
        if self.correction.admits(map.stamp) || is_news {
            self.correction.send(&map, message.clone()).await;
        }
        self.last = Some((map, message));
    }

    /// Takes the newest path.
    pub fn take(&mut self, path: MapPath, message: Vec<u8>) {
        self.newest = Some((path, message));
    }

    /// Sends the newest path if it has changed and is due.
    pub async fn send_path(&mut self) {
        if self.sent.as_ref().is_none_or(|(_, at)| at.elapsed() >= self.path_period) {
            self.send_changed_path().await;
        }
    }

    /// Sends how it all ended: the flight is over.
    pub async fn finish(&mut self) {
        self.send_changed_path().await;
        if let Some((last, message)) = self.last.take() {
            self.correction.send(&last, message).await;
        }
    }

    async fn send_changed_path(&mut self) {
        let Some((mut path, mut message)) = self.newest.take() else { return };
        if self.sent.as_ref().is_some_and(|(sent, _)| *sent == message) {
            return;
        }
        self.sent = Some((message.clone(), Instant::now()));
        if path.poses.len() > self.path_poses {
            thin_out(&mut path, self.path_poses);
            message = encode(&path);
        }
        let mut envelope = Envelope::around(&path, message, self.path.sequence, now_ns());
        if let Some(newest) = path.poses.last() {
            (envelope.stamp_ns, envelope.reset_counter) = (newest.stamp.as_nanos(), newest.reset_counter);
        }
        self.history.lock().path = encode(&envelope);
        self.path.put(&envelope).await;
    }
}

/// Keeps at most `limit` poses, evenly spread, the newest among them, and as many of the newest loops.
fn thin_out(path: &mut MapPath, limit: usize) {
    let known = path.poses.len();
    let (kept, mut at, mut taken) = (known.min(limit), 0, 0);
    path.poses.retain(|_| {
        at += 1;
        let is_taken = taken < kept && at * kept >= (taken + 1) * known;
        taken += usize::from(is_taken);
        is_taken
    });
    path.loops.drain(..path.loops.len().saturating_sub(limit));
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Isometry3;
    use plumbline_config::Timestamp;
    use plumbline_estimator::places::mapper::path::PathPose;

    #[test]
    fn a_path_is_thinned_evenly_and_keeps_its_newest_pose() {
        let mut path = MapPath::new(0);
        path.poses.extend((0..10).map(|k| PathPose {
            stamp: Timestamp::from_nanos(k),
            reset_counter: 0,
            pose_m_b: Isometry3::identity(),
        }));
        thin_out(&mut path, 4);
        let stamps: Vec<_> = path.poses.iter().map(|pose| pose.stamp.as_nanos()).collect();
        assert_eq!(stamps, [2, 4, 7, 9]);
        thin_out(&mut path, 100);
        assert_eq!(path.poses.len(), 4);
    }
}
