//! Sends odometry: from its ring to the link, as one task on the thread on which Zenoh writes.
//!
//! On another thread every message would wait for Zenoh's to be woken: one hand-over of three, a quarter of the
//! latency. Nothing else runs here, since what holds up this thread holds up what is sent.

use super::error::NetError;
use super::outlet::Outlet;
use super::relay::RelayState;
use plumbline_config::options::Link;
use plumbline_estimator::Odometry;
use plumbline_record::messages::Envelope;
use plumbline_record::protobuf::encode_brief;
use plumbline_record::topics::Topic;
use plumbline_rings::lane::LaneReader;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use tokio::task::JoinHandle;
use zenoh::Session;
use zenoh_runtime::ZRuntime;

/// The key of a vehicle's odometry.
pub struct OdometryPublisher(Outlet);

impl OdometryPublisher {
    /// Declares the key of a vehicle.
    ///
    /// # Errors
    /// When Zenoh refuses the key.
    pub async fn declare(session: &Session, vehicle: &str, link: Link) -> Result<Self, NetError> {
        Outlet::declare(session, vehicle, Topic::Odometry, link).await.map(Self)
    }

    /// Empties the ring until the flight is over.
    pub fn spawn(
        mut self,
        shared: Arc<RelayState>,
        mut waiting: LaneReader<(Odometry, i64)>,
    ) -> JoinHandle<()> {
        ZRuntime::TX.spawn(async move {
            loop {
                let is_last = shared.stop.load(Ordering::Relaxed);
                self.empty(&mut waiting).await;
                if is_last {
                    return;
                }
                shared.odometry_bell.notified().await;
            }
        })
    }

    /// Sends what the ring holds. A message that cannot be sent is dropped; receivers see a gap in the sequence numbers.
    async fn empty(&mut self, waiting: &mut LaneReader<(Odometry, i64)>) {
        while let Some((odometry, handed_over_ns)) = waiting.pop() {
            if !self.0.admits(odometry.stamp) {
                continue;
            }
            let message = encode_brief(&odometry);
            let envelope = Envelope::around(&odometry, message, self.0.sequence, handed_over_ns);
            self.0.put(&envelope).await;
            // To Zenoh's own task, which has been woken on this thread.
            tokio::task::yield_now().await;
        }
    }
}
