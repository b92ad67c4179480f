//! Sends odometry: from its ring to the link, as one task on the thread on which Zenoh writes.
//!
//! On another thread every message would wait for Zenoh's to be woken: one hand-over of three, a quarter of the
//! latency. Nothing else runs here, since what holds up this thread holds up what is sent.

use super::datagrams::Datagrams;
use super::error::NetError;
use super::outlet::{Outlet, key_of};
use super::relay::RelayState;
use plumbline_config::options::Link;
use plumbline_estimator::Odometry;
use plumbline_flight::schedule::lane::LaneReader;
use plumbline_record::messages::Envelope;
use plumbline_record::protobuf::{encode, encode_brief};
use plumbline_record::topics::Topic;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use tokio::task::JoinHandle;
use zenoh::Session;
use zenoh::key_expr::OwnedKeyExpr;
use zenoh_runtime::ZRuntime;

/// The key of a vehicle's odometry, and both ways to it.
pub struct OdometryPublisher {
    outlet: Outlet,
    key: OwnedKeyExpr,
    datagrams: Option<Datagrams>,
}

impl OdometryPublisher {
    /// Declares the key of a vehicle; odometry goes in `datagrams` where there are such, while they are open.
    ///
    /// # Errors
    /// When Zenoh refuses the key.
    pub async fn declare(
        session: &Session,
        vehicle: &str,
        datagrams: Option<Datagrams>,
        link: Link,
    ) -> Result<Self, NetError> {
        let outlet = Outlet::declare(session, vehicle, Topic::Odometry, link).await?;
        let key = key_of(vehicle, Topic::Odometry);
        let refused =
            |error: zenoh::Error| NetError::Declare { key: key.clone(), message: error.to_string() };
        let key = OwnedKeyExpr::new(key.clone()).map_err(refused)?;
        Ok(Self { outlet, key, datagrams })
    }

    /// Empties the ring until the flight is over.
    pub fn spawn(
        mut self,
        shared: Arc<RelayState>,
        mut waiting: LaneReader<(Odometry, i64)>,
    ) -> JoinHandle<()> {
        ZRuntime::TX.spawn(async move {
            let bell = match shared.odometry_bell.listen() {
                Ok(bell) => bell,
                Err(error) => return tracing::error!("cannot publish odometry: {error}"),
            };
            loop {
                let is_last = shared.stop.load(Ordering::Relaxed);
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
            if !self.outlet.admits(odometry.stamp) {
                continue;
            }
            let message = encode_brief(&odometry);
            self.send(Envelope::around(&odometry, message, self.outlet.sequence, handed_over_ns)).await;
            // To Zenoh's own task, which has been woken on this thread.
            tokio::task::yield_now().await;
        }
    }

    async fn send(&mut self, envelope: Envelope) {
        let Some(session) = self.datagrams.as_ref().and_then(Datagrams::session) else {
            return self.outlet.put(&envelope).await;
        };
        self.outlet.sequence += 1;
        // Not through a declared publisher: it would wait for a declaration of the other side, which may be lost here.
        let publisher = &self.outlet.publisher;
        let put = session.put(&self.key, encode(&envelope)).encoding(publisher.encoding().clone());
        let put = put.priority(publisher.priority()).express(true);
        let _ = put.congestion_control(publisher.congestion_control()).await;
    }
}
