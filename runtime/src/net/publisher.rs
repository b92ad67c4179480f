//! Publication: rings that never hold up the estimator, emptied by a Tokio runtime.

use super::session::{Endpoints, NetError};
use super::{ROOT, proto, wire};
use crate::pipeline::Sink;
use crate::ros::RosOutlet;
use crossbeam_queue::ArrayQueue;
use plumbline_config::options::RosConfig;
use plumbline_estimator::{Estimate, Odometry};
use prost::Message;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};
use tokio::sync::Notify;
use zenoh::Session;
use zenoh::bytes::Encoding;
use zenoh::qos::{CongestionControl, Priority};

/// Odometry that waits for the network: a quarter of a second.
const ODOMETRY_RING: usize = 50;
/// Estimates that wait for the network: two seconds.
const ESTIMATE_RING: usize = 40;
/// Health is sent this often, and on change.
const HEALTH_PERIOD: Duration = Duration::from_millis(200);

/// A bounded ring that forgets its oldest entry rather than make the writer wait.
#[derive(Debug)]
pub struct DropOldest<T> {
    queue: ArrayQueue<T>,
    dropped: AtomicU64,
}

impl<T> DropOldest<T> {
    /// Room for `capacity` entries.
    #[must_use]
    pub fn new(capacity: usize) -> Self {
        Self { queue: ArrayQueue::new(capacity), dropped: AtomicU64::new(0) }
    }

    /// Adds an entry; full, the oldest goes and is counted.
    pub fn push(&self, entry: T) {
        if self.queue.force_push(entry).is_some() {
            self.dropped.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// Takes the oldest entry.
    pub fn pop(&self) -> Option<T> {
        self.queue.pop()
    }

    /// Entries forgotten so far.
    pub fn dropped(&self) -> u64 {
        self.dropped.load(Ordering::Relaxed)
    }
}

#[derive(Debug)]
struct Rings {
    odometry: DropOldest<Odometry>,
    estimates: DropOldest<(Estimate, f64)>,
    wake: Notify,
    stop: AtomicBool,
}

/// A vehicle's presence on the network. As a [`Sink`] it takes what the pipeline produces.
#[derive(Debug)]
pub struct Publisher {
    rings: Arc<Rings>,
    thread: Option<JoinHandle<()>>,
}

impl Publisher {
    /// Opens the session and declares everything, for ROS 2 too where that is enabled; returns when others can
    /// see the vehicle.
    ///
    /// # Errors
    /// When the session cannot be opened.
    pub fn start(endpoints: &Endpoints, ros: &RosConfig) -> Result<Self, NetError> {
        let rings = Arc::new(Rings {
            odometry: DropOldest::new(ODOMETRY_RING),
            estimates: DropOldest::new(ESTIMATE_RING),
            wake: Notify::new(),
            stop: AtomicBool::new(false),
        });
        let (ready, wait) = std::sync::mpsc::sync_channel(1);
        let (theirs, endpoints, ros) = (Arc::clone(&rings), endpoints.clone(), ros.clone());
        let runtime = tokio::runtime::Builder::new_multi_thread()
            .worker_threads(1)
            .thread_name("plumbline-net")
            .enable_all()
            .build()?;
        let thread = std::thread::Builder::new().name("plumbline-net".into()).spawn(move || {
            runtime.block_on(async {
                match Outlets::declare(&endpoints, &ros).await {
                    Ok(outlets) => {
                        let _ = ready.send(Ok(()));
                        outlets.run(&theirs).await;
                    }
                    Err(error) => drop(ready.send(Err(error))),
                }
            });
        })?;
        let outcome = wait.recv().unwrap_or_else(|_| {
            Err(NetError::Thread(std::io::Error::other("it ended before the session was open")))
        });
        outcome.map(|()| Self { rings, thread: Some(thread) })
    }

    /// Sends what is left, and takes the vehicle off the network.
    pub fn stop(mut self) {
        self.end();
    }

    fn end(&mut self) {
        self.rings.stop.store(true, Ordering::Relaxed);
        self.rings.wake.notify_one();
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

impl Drop for Publisher {
    fn drop(&mut self) {
        self.end();
    }
}

impl Sink for Publisher {
    fn estimate(&mut self, estimate: &Estimate, frame_ms: f64) {
        self.rings.estimates.push((estimate.clone(), frame_ms));
        self.rings.wake.notify_one();
    }

    fn odometry(&mut self, odometry: &Odometry) {
        self.rings.odometry.push(odometry.clone());
        self.rings.wake.notify_one();
    }
}

/// The vehicle's keys, declared.
struct Outlets {
    session: Session,
    odom: zenoh::pubsub::Publisher<'static>,
    state: zenoh::pubsub::Publisher<'static>,
    health: zenoh::pubsub::Publisher<'static>,
    ros: Option<RosOutlet>,
    _alive: zenoh::liveliness::LivelinessToken,
}

/// What health messages are made of.
struct HealthFeed {
    last: Option<proto::Health>,
    sent: Instant,
    sequence: u64,
    frame_rate_hz: f64,
    last_stamp_ns: i64,
}

impl Outlets {
    async fn declare(endpoints: &Endpoints, ros: &RosConfig) -> Result<Self, NetError> {
        let session = endpoints.open().await?;
        let key = |name: &str| format!("{ROOT}/{}/{name}", endpoints.vehicle);
        let failed =
            |key: String| move |error: zenoh::Error| NetError::Declare { key, message: error.to_string() };
        let odom = session
            .declare_publisher(key("odom"))
            .encoding(Encoding::APPLICATION_PROTOBUF.with_schema("plumbline.v1.Odom"))
            .priority(Priority::RealTime)
            .congestion_control(CongestionControl::Drop)
            .express(true)
            .await
            .map_err(failed(key("odom")))?;
        let state = session
            .declare_publisher(key("state"))
            .encoding(Encoding::APPLICATION_PROTOBUF.with_schema("plumbline.v1.State"))
            .priority(Priority::DataHigh)
            .congestion_control(CongestionControl::Drop)
            .await
            .map_err(failed(key("state")))?;
        let health = session
            .declare_publisher(key("health"))
            .encoding(Encoding::APPLICATION_PROTOBUF.with_schema("plumbline.v1.Health"))
            .priority(Priority::Data)
            .congestion_control(CongestionControl::Drop)
            .await
            .map_err(failed(key("health")))?;
        let alive = session.liveliness().declare_token(key("alive")).await.map_err(failed(key("alive")))?;
        let ros = ros.enabled.then(|| RosOutlet::start(ros, &endpoints.vehicle)).transpose()?;
        Ok(Self { session, odom, state, health, ros, _alive: alive })
    }

    /// Empties the rings until told to stop, then once more.
    async fn run(mut self, rings: &Rings) {
        let mut feed = HealthFeed {
            last: None,
            sent: Instant::now(),
            sequence: 0,
            frame_rate_hz: 0.0,
            last_stamp_ns: 0,
        };
        let mut sequence = 0;
        while !rings.stop.load(Ordering::Relaxed) {
            let _ = tokio::time::timeout(HEALTH_PERIOD, rings.wake.notified()).await;
            self.empty(rings, &mut feed, &mut sequence).await;
        }
        self.empty(rings, &mut feed, &mut sequence).await;
        if let Some(ros) = self.ros {
            ros.stop().await;
        }
        let _ = self.session.close().await;
    }

    async fn empty(&mut self, rings: &Rings, feed: &mut HealthFeed, sequence: &mut u64) {
        while let Some(odometry) = rings.odometry.pop() {
            // What cannot be sent is lost, as its quality of service says; the sequence number tells.
            let _ = self.odom.put(wire::odom(&odometry, now_ns()).encode_to_vec()).await;
            if let Some(ros) = &mut self.ros {
                ros.odometry(&odometry).await;
            }
        }
        while let Some((estimate, frame_ms)) = rings.estimates.pop() {
            let _ = self.state.put(wire::state(&estimate, *sequence, now_ns()).encode_to_vec()).await;
            *sequence += 1;
            let dropped = rings.odometry.dropped() + rings.estimates.dropped();
            if let Some(message) = feed.update(&estimate, frame_ms, dropped) {
                let _ = self.health.put(message.encode_to_vec()).await;
            }
        }
    }
}

impl HealthFeed {
    /// The message to send after this estimate, if one is due: on change, or after the period.
    fn update(&mut self, e: &Estimate, frame_ms: f64, dropped: u64) -> Option<proto::Health> {
        let stamp_ns = e.stamp.as_nanos();
        let period_s = (stamp_ns - self.last_stamp_ns) as f64 * 1e-9;
        if self.last_stamp_ns != 0 && period_s > 0.0 {
            self.frame_rate_hz += 0.1 * (1.0 / period_s - self.frame_rate_hz);
        }
        self.last_stamp_ns = stamp_ns;
        let state = i32::from(wire::state_of(e.state));
        let is_news = self.last.as_ref().is_none_or(|l| l.bits != e.health.0 || l.state != state);
        if !is_news && self.sent.elapsed() < HEALTH_PERIOD {
            return None;
        }
        let message = proto::Health {
            header: Some(proto::Header {
                stamp_ns,
                published_ns: now_ns(),
                sequence: self.sequence,
                reset_counter: e.reset_counter,
                quality: i32::from(e.quality),
            }),
            state,
            bits: e.health.0,
            words: wire::health_words(e.health.0),
            frame_rate_hz: self.frame_rate_hz,
            frame_ms,
            dropped,
        };
        self.sequence += 1;
        self.sent = Instant::now();
        self.last = Some(message.clone());
        Some(message)
    }
}

fn now_ns() -> i64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |d| d.as_nanos() as i64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_full_ring_forgets_the_oldest_and_counts_it() {
        let ring = DropOldest::new(3);
        (0..5).for_each(|k| ring.push(k));
        assert_eq!(ring.dropped(), 2);
        assert_eq!(std::iter::from_fn(|| ring.pop()).collect::<Vec<_>>(), [2, 3, 4]);
    }
}
