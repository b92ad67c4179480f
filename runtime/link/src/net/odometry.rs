//! Sends odometry: from its ring to the link, as one task on the thread on which Zenoh writes.
//!
//! On another thread every message would wait for Zenoh's to be woken: one hand-over of three, a quarter of the
//! latency. Nothing else runs here, since what holds up this thread holds up what is sent.

use super::datagrams::Datagrams;
use super::declare::declare_publisher;
use super::error::NetError;
use super::pace::Pace;
use super::rings::Rings;
use super::{ROOT, wire};
use plumbline_estimator::Odometry;
use plumbline_flight::schedule::lane::LaneReader;
use prost::Message as _;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use tokio::task::JoinHandle;
use zenoh::Session;
use zenoh::key_expr::OwnedKeyExpr;
use zenoh::pubsub::Publisher;
use zenoh::qos::Priority;
use zenoh_runtime::ZRuntime;

/// Name and schema of the key.
const KEY: (&str, &str) = ("odom", "Odom");

/// The key of a vehicle's odometry, and both ways to it.
pub struct OdometryPublisher {
    publisher: Publisher<'static>,
    key: OwnedKeyExpr,
    datagrams: Option<Datagrams>,
    pace: Pace,
    sequence: u64,
}

impl OdometryPublisher {
    /// Declares the key; odometry goes in `datagrams` while there are any.
    ///
    /// # Errors
    /// When Zenoh refuses the key.
    pub async fn declare(
        session: &Session,
        vehicle: &str,
        datagrams: Option<Datagrams>,
        rate_hz: f64,
    ) -> Result<Self, NetError> {
        let publisher = declare_publisher(session, vehicle, KEY.0, KEY.1, Priority::RealTime).await?;
        let name = format!("{ROOT}/{vehicle}/{}", KEY.0);
        let refused =
            |error: zenoh::Error| NetError::Declare { key: name.clone(), message: error.to_string() };
        let key = OwnedKeyExpr::new(name.clone()).map_err(refused)?;
        Ok(Self { publisher, key, datagrams, pace: Pace::new(rate_hz), sequence: 0 })
    }

    /// Empties the ring until the flight is over.
    pub fn spawn(mut self, rings: Arc<Rings>, mut waiting: LaneReader<(Odometry, i64)>) -> JoinHandle<()> {
        ZRuntime::TX.spawn(async move {
            let bell = match rings.odometry_bell.listen() {
                Ok(bell) => bell,
                Err(error) => return tracing::error!("cannot publish odometry: {error}"),
            };
            loop {
                let is_last = rings.stop.load(Ordering::Relaxed);
                self.empty(&mut waiting).await;
                if is_last {
                    return;
                }
                bell.rung().await;
            }
        })
    }

    /// Sends what the ring holds. A message that cannot be sent is dropped; receivers see a gap in the sequence numbers.
    async fn empty(&mut self, waiting: &mut LaneReader<(Odometry, i64)>) {
        while let Some((odometry, handed_over_ns)) = waiting.pop() {
            if !self.pace.admits(odometry.stamp) {
                continue;
            }
            self.send(wire::odom(&odometry, self.sequence, handed_over_ns).encode_to_vec()).await;
            self.sequence += 1;
            // To Zenoh's own task, which has been woken on this thread.
            tokio::task::yield_now().await;
        }
    }

    async fn send(&self, message: Vec<u8>) {
        let _ = match self.datagrams.as_ref().and_then(Datagrams::session) {
            None => self.publisher.put(message).await,
            // Not through a declared publisher: it would wait for a declaration of the other side, which may be lost here.
            Some(session) => {
                let put = session.put(&self.key, message).encoding(self.publisher.encoding().clone());
                let put = put.priority(self.publisher.priority()).express(true);
                put.congestion_control(self.publisher.congestion_control()).await
            }
        };
    }
}
