//! The keys that a vehicle publishes, by the table of topics: each with the quality of service that it needs.
//!
//! Messages without room on the link are dropped, since waiting would hold up the others. The next odometry
//! is 5 ms away, health comes again soon, and missing parts of the map are queried ([`super::answers`]).

use super::answers::{self, Answers};
use super::commands::CommandRelay;
use super::endpoints::Endpoints;
use super::error::NetError;
use super::health::HealthFeed;
use super::history::History;
use super::map::MapPublisher;
use super::odometry::OdometryPublisher;
use super::outlet::Outlet;
use super::pace::Rates;
use super::relay::{FeedReaders, RelayState, Relayed};
use super::vehicle::VehicleFacts;
use super::{ROOT, audit, camera, diagnosis, now_ns};
use parking_lot::Mutex;
use plumbline_estimator::{Estimate, MapSnapshot};
use plumbline_record::fields::Parts;
use plumbline_record::local::content::LocalRecord;
use plumbline_record::local::request::{Failure, Request};
use plumbline_record::messages::{Envelope, Health, LadderRung};
use plumbline_record::protobuf::encode;
use plumbline_record::topics::Topic;
use plumbline_rings::lane::LaneReader;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};
use tokio::sync::watch;
use zenoh::Session;
use zenoh::pubsub::Publisher;

/// Period at which refused accesses are logged.
const CHORES_PERIOD: Duration = Duration::from_millis(200);
/// Period of the signs of life.
const ALIVE_PERIOD: Duration = Duration::from_secs(1);
/// Topics whose messages are more than relayed. All others are sent as they come.
const OWN: [Topic; 5] = [Topic::Odometry, Topic::MapEstimate, Topic::Path, Topic::Picture, Topic::Keyframe];

/// The vehicle's keys, declared.
pub struct Publishers {
    session: Session,
    /// Moved into the task that sends odometry.
    odometry: Option<OdometryPublisher>,
    keyframe: Publisher<'static>,
    map: MapPublisher,
    /// Moved into the task that sends camera images.
    camera: Option<Publisher<'static>>,
    /// All other keys.
    outlets: Vec<(Topic, Outlet)>,
    _alive: zenoh::liveliness::LivelinessToken,
    rates: Rates,
    history: Arc<Mutex<History>>,
    resets: watch::Sender<u32>,
    commands: Arc<CommandRelay>,
    health: HealthFeed,
    chores: Instant,
    alive: Instant,
}

impl Publishers {
    /// Opens the session and declares everything; returns when others can see the vehicle.
    ///
    /// # Errors
    /// When the session cannot be opened or a key not be declared.
    pub async fn declare(
        endpoints: &Endpoints,
        vehicle: Arc<VehicleFacts>,
        rates: Rates,
    ) -> Result<Self, NetError> {
        let history = Arc::new(Mutex::new(History::new(rates.keyframe_landmarks)));
        let session = endpoints.open().await?;
        let (resets, newest_reset) = watch::channel(0);
        let answers =
            Answers { vehicle: Arc::clone(&vehicle), history: Arc::clone(&history), resets: newest_reset };
        answers::declare(&session, answers).await?;
        let (name, link) = (&vehicle.name, rates.link);
        let odometry = OdometryPublisher::declare(&session, name, link).await?;
        let keyframe = Outlet::declare(&session, name, Topic::Keyframe, link).await?.publisher;
        let map = MapPublisher::declare(&session, name, rates, Arc::clone(&history)).await?;
        let mut outlets = Vec::new();
        for (topic, _) in Topic::published().filter(|(topic, _)| !OWN.contains(topic)) {
            outlets.push((topic, Outlet::declare(&session, name, topic, link).await?));
        }
        let offers_camera = vehicle.offers_camera && rates.hz(Topic::Picture) > 0.0;
        let camera = match offers_camera {
            true => Some(Outlet::declare(&session, name, Topic::Picture, link).await?.publisher),
            false => None,
        };
        let ladder = LadderRung { level: 0, name: "full".into() };
        let health = Health { ladder, offers_camera, rot_v_b: vehicle.rot_v_b, ..Health::default() };
        let key = format!("{ROOT}/{}/alive", vehicle.name);
        let failed = |error: zenoh::Error| NetError::Declare { key: key.clone(), message: error.to_string() };
        let alive = session.liveliness().declare_token(&key).await.map_err(failed)?;
        Ok(Self {
            session: session.clone(),
            odometry: Some(odometry),
            keyframe,
            map,
            camera,
            outlets,
            _alive: alive,
            rates,
            history,
            resets,
            commands: Arc::clone(&vehicle.commands),
            health: HealthFeed::new(rates.period(Topic::Health), health),
            chores: Instant::now(),
            alive: Instant::now(),
        })
    }

    /// Sends what comes until the flight is over, then what is left.
    pub async fn run(mut self, shared: &Arc<RelayState>, waiting: FeedReaders) {
        let FeedReaders { odometry: waiting, mut records, pictures } = waiting;
        let odometry = self.odometry.take().map(|publisher| publisher.spawn(Arc::clone(shared), waiting));
        let pictures = self.camera.take().map(|camera| {
            let commands = Arc::clone(&self.commands);
            tokio::spawn(camera::serve(camera, Arc::clone(shared), pictures, self.rates, commands))
        });
        while !shared.stop.load(Ordering::Relaxed) {
            let _ = tokio::time::timeout(CHORES_PERIOD, shared.bell.notified()).await;
            self.empty(shared, &mut records).await;
            self.do_chores().await;
        }
        self.empty(shared, &mut records).await;
        self.map.finish().await;
        if let Some(pictures) = pictures {
            pictures.abort();
        }
        shared.odometry_bell.notify_one();
        if let Some(odometry) = odometry {
            let _ = odometry.await;
        }
        let _ = self.session.close().await;
    }

    /// Logs what was refused, and gives a sign of life to whoever started the process, or asks for another session.
    async fn do_chores(&mut self) {
        if self.chores.elapsed() < CHORES_PERIOD {
            return;
        }
        self.chores = Instant::now();
        audit::log_refusals();
        diagnosis::report_failures();
        if self.alive.elapsed() >= ALIVE_PERIOD {
            self.alive = Instant::now();
            self.commands.report(&Request::Alive);
        }
        // Whoever knows the identifier of a session may take its place while its link is down: a new session has a new one.
        if diagnosis::is_identifier_taken() {
            let words = "another session uses the identifier of this one".to_owned();
            self.commands.report(&Request::Failed(Failure { is_usage: false, words }));
            self.commands.close();
        }
    }

    /// Sends what waits.
    async fn empty(&mut self, shared: &RelayState, records: &mut LaneReader<Relayed>) {
        while let Some(relayed) = records.pop() {
            self.relay(shared, relayed).await;
        }
        // A change of the sensors is told also while there are no frames.
        self.count(shared);
        if let Some(health) = self.health.renew() {
            self.send_health(health).await;
        }
        self.map.send_path().await;
    }

    /// Sends a record on its key, and takes what other keys and answers need of it.
    async fn relay(&mut self, shared: &RelayState, Relayed { record, message }: Relayed) {
        match record {
            LocalRecord::Estimate(estimate, frame_ms) => {
                self.send(Topic::FullEstimate, &*estimate, message).await;
                self.note(shared, &estimate, frame_ms).await;
            }
            LocalRecord::MapEstimate(estimate) => self.map.follow(estimate, message).await,
            LocalRecord::Window(snapshot) => {
                self.send(Topic::Window, &snapshot, message).await;
                self.send_finished(&snapshot).await;
            }
            LocalRecord::Path(path) => self.map.take(path, message),
            LocalRecord::Ladder(ladder) => self.health.health.ladder = ladder,
            LocalRecord::Sensors(news) => self.health.health.sensors = news,
            LocalRecord::Other(kind) => {
                let Some(topic) = Topic::of_kind(kind) else { return };
                let record = topic.row().decode.map(|decode| decode(&message));
                if let Some(Ok(record)) = record {
                    self.send(topic, &*record, message).await;
                }
            }
            _ => {}
        }
    }

    /// Sends a message on the key of its topic, if it has one and the message is due.
    async fn send(&mut self, topic: Topic, record: &dyn Parts, message: Vec<u8>) {
        let Some((_, outlet)) = self.outlets.iter_mut().find(|(known, _)| *known == topic) else { return };
        let envelope = Envelope::around(record, message, outlet.sequence, now_ns());
        if outlet.admits(envelope.stamp()) {
            outlet.put(&envelope).await;
        }
    }

    /// Brings what health messages count up to date.
    fn count(&mut self, shared: &RelayState) {
        let health = &mut self.health.health;
        (health.keyframes, health.paths) = (self.history.lock().keyframe_count(), self.map.paths());
        health.dropped = shared.dropped();
    }

    /// Takes what answers and health need of an estimate.
    async fn note(&mut self, shared: &RelayState, estimate: &Estimate, frame_ms: f64) {
        self.history.lock().remember(estimate);
        self.resets.send_replace(estimate.reset_counter);
        self.health.health.frame_ms = frame_ms;
        self.count(shared);
        if let Some(health) = self.health.update(estimate) {
            self.send_health(health).await;
        }
    }

    async fn send_health(&mut self, (mut envelope, health): (Envelope, Health)) {
        let outlets = self.outlets.iter_mut();
        for (_, outlet) in outlets.filter(|(topic, _)| *topic == Topic::Health) {
            (envelope.sequence, envelope.published_ns) = (outlet.sequence, now_ns());
            envelope.message = encode(&health);
            outlet.put(&envelope).await;
        }
    }

    /// Sends the keyframes that have left the window.
    async fn send_finished(&self, snapshot: &MapSnapshot) {
        let keyframes = self.history.lock().update(snapshot);
        for envelope in keyframes {
            let _ = self.keyframe.put(envelope).await;
        }
    }
}
