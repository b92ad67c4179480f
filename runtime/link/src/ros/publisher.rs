//! The way out to ROS 2: a session of its own with the router of `rmw_zenoh`.
//!
//! Its own, and as a client of the router, because the router of `rmw_zenoh` passes nothing on between peers: it
//! takes all of them to be of its host, connected with each other (`peers_failover_brokering` is off). For a
//! client it does, to every host. And what secures our network is not theirs.

use super::node::RosNode;
use crate::net::NetError;
use nalgebra::UnitQuaternion;
use plumbline_config::options::RosConfig;
use plumbline_estimator::Odometry;
use plumbline_estimator::places::MapEstimate;
use plumbline_flight::pipeline::Stamps;
use std::time::{Duration, Instant};
use tokio::sync::oneshot::{self, Receiver};
use zenoh::{Session, Wait};

/// First and longest pause between attempts to reach the router, ms.
const RETRY_MS: (u32, u32) = (500, 1000);
/// A router that is not there after this time is worth a word.
const PATIENCE: Duration = Duration::from_secs(3);

/// Publishes odometry to ROS 2 as soon as the router is there, and again when it comes back.
pub struct RosPublisher {
    options: RosConfig,
    vehicle: String,
    rot_v_b: UnitQuaternion<f64>,
    stamps: Stamps,
    /// The newest word on where the odometry lies in the map.
    map: Option<MapEstimate>,
    state: State,
}

enum State {
    /// Since when, whether it was told of, and where the session comes from.
    Waiting(Instant, bool, Receiver<Result<Session, NetError>>),
    Connected(Session, Box<RosNode>),
    /// There will be nothing to publish to: why was told.
    Failed,
}

impl RosPublisher {
    /// Begins to look for the router; returns at once. `rot_v_b` takes coordinates from the IMU to the vehicle.
    ///
    /// # Errors
    /// When no thread can be had.
    pub fn start(
        options: &RosConfig,
        vehicle: &str,
        rot_v_b: UnitQuaternion<f64>,
        stamps: Stamps,
    ) -> Result<Self, NetError> {
        let (sender, receiver) = oneshot::channel();
        let router = options.router.clone();
        // Zenoh holds its caller until the router is there, which may be never: it gets a thread that nobody
        // waits for. A session that nobody wants any more is closed as it is dropped.
        std::thread::Builder::new().name("plumbline-ros".into()).spawn(move || {
            let _ = sender.send(open(&router));
        })?;
        let state = State::Waiting(Instant::now(), false, receiver);
        Ok(Self { options: options.clone(), vehicle: vehicle.to_owned(), rot_v_b, stamps, map: None, state })
    }

    /// Takes where the odometry lies in the map: it goes out with the odometry.
    pub fn follow(&mut self, map: MapEstimate) {
        self.map = Some(map);
    }

    /// Publishes an odometry, if it is due and has a pose. What cannot be sent is lost; the sequence numbers of
    /// the samples tell.
    pub async fn odometry(&mut self, odometry: &Odometry) {
        if let State::Waiting(since, told, receiver) = &mut self.state {
            match receiver.try_recv() {
                Ok(session) => self.state = self.connected(session).await,
                Err(oneshot::error::TryRecvError::Closed) => self.state = State::Failed,
                Err(oneshot::error::TryRecvError::Empty) => {
                    if !*told && since.elapsed() > PATIENCE {
                        *told = true;
                        let router = &self.options.router;
                        tracing::warn!("no router of ROS 2 at {router} yet; retrying until it is available");
                    }
                }
            }
        }
        if let State::Connected(_, node) = &mut self.state {
            // After a reset the odometry frame is another one.
            let map = self.map.as_ref().filter(|map| map.reset_counter == odometry.reset_counter);
            node.odometry(odometry, map.and_then(|map| map.pose_m_o.as_ref())).await;
        }
    }

    async fn connected(&self, session: Result<Session, NetError>) -> State {
        let declared = async {
            let session = session?;
            let node =
                RosNode::declare(&session, &self.options, &self.vehicle, self.rot_v_b, self.stamps).await?;
            Ok::<_, NetError>(State::Connected(session, Box::new(node)))
        };
        declared.await.unwrap_or_else(|error| {
            tracing::warn!("cannot publish to ROS 2: {error}");
            State::Failed
        })
    }

    /// Takes the node off the network.
    pub async fn stop(self) {
        if let State::Connected(session, node) = self.state {
            drop(node);
            let _ = session.close().await;
        }
    }
}

/// Waits for the router, as long as it takes.
fn open(router: &str) -> Result<Session, NetError> {
    let failed = |error: zenoh::Error| NetError::Open {
        listen: Vec::new(),
        connect: vec![router.to_owned()],
        message: error.to_string(),
    };
    let retry = serde_json::json!({
        "period_init_ms": RETRY_MS.0, "period_max_ms": RETRY_MS.1, "period_increase_factor": 2.0,
    });
    let settings = [
        ("mode", "\"client\"".to_owned()),
        ("connect/endpoints", serde_json::json!([router]).to_string()),
        ("connect/timeout_ms", "-1".to_owned()),
        ("connect/retry", retry.to_string()),
        ("scouting/multicast/enabled", "false".to_owned()),
    ];
    let mut config = zenoh::Config::default();
    for (key, value) in settings {
        config.insert_json5(key, &value).map_err(failed)?;
    }
    zenoh::open(config).wait().map_err(failed)
}
