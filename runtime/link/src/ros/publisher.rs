//! The way out to ROS 2: a session of its own with the router of `rmw_zenoh`.
//!
//! Its own, and as a client of the router, because the router of `rmw_zenoh` passes nothing on between peers: it
//! takes all of them to be of its host, connected with each other (`peers_failover_brokering` is off). For a
//! client it does, to every host. And what secures our network is not theirs.

use super::identity::Identity;
use super::node::{RosNode, is_worth_sending};
use super::path::PathHistory;
use crate::net::{CommandRelay, NetError};
use plumbline_estimator::Odometry;
use plumbline_estimator::places::MapEstimate;
use plumbline_record::InstantAnswer;
use std::sync::Arc;
use std::time::{Duration, Instant};
use tokio::sync::oneshot::{self, Receiver};
use zenoh::{Session, Wait};

/// First and longest pause between attempts to reach the router, ms.
const RETRY_MS: (u32, u32) = (500, 1000);
/// Poses of the path at most.
const MAX_PATH_POSES: usize = 2_000;
/// A session that could not be used is followed by another after this time.
const RENEWAL: Duration = Duration::from_secs(2);
/// A router that is not there after this time is worth a word.
const PATIENCE: Duration = Duration::from_secs(3);

/// Period at which the router is looked for.
pub const LOOK_PERIOD: Duration = Duration::from_millis(200);

/// Publishes to ROS 2 as soon as the router is there, and again when it comes back.
pub struct RosPublisher {
    identity: Identity,
    commands: Arc<CommandRelay>,
    state: State,
    /// Failure that was logged last.
    failure: String,
    path: PathHistory,
    /// Newest pose of the odometry frame in the map.
    pub map: Option<MapEstimate>,
}

enum State {
    /// Since when, whether it was told of, and where the session comes from.
    Waiting(Instant, bool, Receiver<Result<Session, NetError>>),
    Connected(Session, Box<RosNode>),
    /// The node could not be declared, which is tried again after a while: since when.
    Failed(Instant),
}

impl RosPublisher {
    /// Starts to look for the router; returns at once.
    ///
    /// # Errors
    /// When no thread can be had.
    pub fn start(identity: Identity, commands: Arc<CommandRelay>) -> Result<Self, NetError> {
        let receiver = search(&identity.options.router)?;
        let state = State::Waiting(Instant::now(), false, receiver);
        let path = PathHistory::new(MAX_PATH_POSES);
        Ok(Self { identity, commands, state, failure: String::new(), path, map: None })
    }

    /// Declares the node when the router has appeared.
    pub async fn look(&mut self) {
        if let State::Failed(since) = &self.state
            && since.elapsed() >= RENEWAL
        {
            self.state = match search(&self.identity.options.router) {
                Ok(receiver) => State::Waiting(Instant::now(), true, receiver),
                Err(error) => self.failed(&error.to_string()),
            };
        }
        if let State::Waiting(since, told, receiver) = &mut self.state {
            match receiver.try_recv() {
                Ok(session) => self.state = self.connected(session).await,
                Err(oneshot::error::TryRecvError::Closed) => {
                    self.state = self.failed("the thread that looks for the router has ended");
                }
                Err(oneshot::error::TryRecvError::Empty) => {
                    if !*told && since.elapsed() > PATIENCE {
                        *told = true;
                        let router = &self.identity.options.router;
                        tracing::warn!("no router of ROS 2 at {router} yet; retrying until it is available");
                    }
                }
            }
        }
    }

    /// Publishes an odometry, if it is due and has a pose. What cannot be sent is lost; the sequence numbers of
    /// the samples show it.
    pub async fn odometry(&mut self, odometry: &Odometry) {
        if is_worth_sending(odometry) {
            self.path.follow(odometry);
        }
        if let State::Connected(_, node) = &mut self.state {
            let map = self.map.as_ref().filter(|map| map.reset_counter == odometry.reset_counter);
            node.odometry(odometry, map.and_then(|map| map.pose_m_o.as_ref()), &self.path).await;
        }
    }

    /// Publishes the state at an instant.
    pub async fn instant(&mut self, answer: &InstantAnswer) {
        if let State::Connected(_, node) = &mut self.state {
            node.instant(answer).await;
        }
    }

    async fn connected(&mut self, session: Result<Session, NetError>) -> State {
        let declared = async {
            let session = session?;
            let node = RosNode::declare(&session, &self.identity, &self.commands).await?;
            Ok::<_, NetError>(State::Connected(session, Box::new(node)))
        };
        match declared.await {
            Ok(state) => {
                self.failure.clear();
                state
            }
            Err(error) => self.failed(&error.to_string()),
        }
    }

    /// Logs a failure that is another than the last one.
    fn failed(&mut self, words: &str) -> State {
        if self.failure != words {
            tracing::warn!("cannot publish to ROS 2: {words}; trying again");
            words.clone_into(&mut self.failure);
        }
        State::Failed(Instant::now())
    }

    /// Takes the node off the network.
    pub async fn stop(self) {
        if let State::Connected(session, node) = self.state {
            drop(node);
            let _ = session.close().await;
        }
    }
}

/// Looks for the router. Zenoh holds its caller until the router is there, which may be never: it gets a thread that nobody
/// waits for. A session that nobody wants any more is closed as it is dropped.
fn search(router: &str) -> std::io::Result<Receiver<Result<Session, NetError>>> {
    let (sender, receiver) = oneshot::channel();
    let router = router.to_owned();
    std::thread::Builder::new().name("plumbline-ros".into()).spawn(move || {
        let _ = sender.send(open(&router));
    })?;
    Ok(receiver)
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

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::UnitQuaternion;
    use plumbline_config::options::RosConfig;
    use plumbline_rings::Stamps;

    #[test]
    fn a_node_that_could_not_be_declared_is_tried_again() {
        let options = RosConfig { router: "tcp/127.0.0.1:1".into(), ..RosConfig::default() };
        let (vehicle, rot_v_b, stamps) = ("drone".into(), UnitQuaternion::identity(), Stamps::Replayed);
        let identity = Identity { options, vehicle, rot_v_b, stamps };
        let mut publisher = RosPublisher::start(identity, Arc::default()).unwrap();
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
        let fails = |publisher: &mut RosPublisher| {
            let (sender, receiver) = oneshot::channel();
            let error = NetError::Declare { key: "plumbline".into(), message: "the router restarts".into() };
            assert!(sender.send(Err(error)).is_ok());
            publisher.state = State::Waiting(Instant::now(), true, receiver);
            runtime.block_on(publisher.look());
            matches!(publisher.state, State::Failed(_))
        };
        for _ in 0..3 {
            assert!(fails(&mut publisher));
            runtime.block_on(publisher.look());
            assert!(matches!(publisher.state, State::Failed(_)), "not at once");
            publisher.state = State::Failed(Instant::now().checked_sub(RENEWAL).unwrap());
            runtime.block_on(publisher.look());
            assert!(matches!(publisher.state, State::Waiting(..)), "it looks for the router again");
        }
        drop(publisher.stop());
    }
}
