//! The keys that a vehicle publishes, each with the quality of service that it needs.
//!
//! | key | priority | express | when the link is full |
//! |---|---|---|---|
//! | `odom` | real time | yes | dropped: the next one is 5 ms away; in datagrams where they are to be had ([`super::datagrams`]) |
//! | `state` | data, high | no | dropped |
//! | `health` | interactive, high | no | dropped: the next one is soon |
//! | `map/...` | data | no | dropped, and asked for again ([`super::answers`]): waiting would hold up the others |
//! | `scene` | data, low | no | dropped |
//! | `camera` | background | no | dropped |

use super::answers::{self, Answers, Archive, lock};
use super::commands::Commands;
use super::datagrams::Datagrams;
use super::declare::declare_publisher;
use super::endpoints::Endpoints;
use super::error::NetError;
use super::health::{Circumstances, HealthFeed};
use super::map::MapPublisher;
use super::odometry::OdometryPublisher;
use super::pace::{Pace, Rates};
use super::rings::{Rings, ToSend};
use super::vehicle::Vehicle;
use super::{ROOT, audit, camera, diagnosis, now_ns, wire};
use nalgebra::UnitQuaternion;
use plumbline_estimator::places::MapEstimate;
use plumbline_estimator::{Estimate, MapSnapshot};
use plumbline_flight::local::request::Request;
use plumbline_flight::schedule::ladder::Rung;
use plumbline_flight::schedule::lane::LaneReader;
use prost::Message;
use std::sync::atomic::Ordering;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};
use tokio::sync::watch;
use zenoh::Session;
use zenoh::pubsub::Publisher;
use zenoh::qos::Priority;

/// Period at which refused accesses are logged.
const CHORES_PERIOD: Duration = Duration::from_millis(200);
/// Period of the signs of life.
const ALIVE_PERIOD: Duration = Duration::from_secs(1);

/// The vehicle's keys, declared.
pub struct Publishers {
    session: Session,
    /// Moved into the task that sends odometry.
    odometry: Option<OdometryPublisher>,
    state: Publisher<'static>,
    health: Publisher<'static>,
    keyframe: Publisher<'static>,
    map: MapPublisher,
    scene: Publisher<'static>,
    /// Moved into the task that sends camera images.
    camera: Option<Publisher<'static>>,
    _alive: zenoh::liveliness::LivelinessToken,
    rates: Rates,
    offers_camera: bool,
    rot_v_b: Option<UnitQuaternion<f64>>,
    archive: Arc<Mutex<Archive>>,
    resets: watch::Sender<u32>,
    commands: Arc<Commands>,
    course: Course,
}

/// Counters and pace of the messages.
struct Course {
    feed: HealthFeed,
    state: Pace,
    scene: Pace,
    states: u64,
    scenes: u64,
    chores: Instant,
    alive: Instant,
}

impl Course {
    fn new(rates: &Rates) -> Self {
        Self {
            feed: HealthFeed::new(rates.health_period()),
            state: Pace::new(rates.state_hz),
            scene: Pace::new(rates.scene_hz),
            states: 0,
            scenes: 0,
            chores: Instant::now(),
            alive: Instant::now(),
        }
    }
}

impl Publishers {
    /// Opens the session and declares everything; returns when others can see the vehicle.
    ///
    /// # Errors
    /// When the session cannot be opened or a key not be declared.
    pub async fn declare(
        endpoints: &Endpoints,
        vehicle: Arc<Vehicle>,
        rates: Rates,
    ) -> Result<Self, NetError> {
        let archive = Arc::new(Mutex::new(Archive::new(rates.keyframe_landmarks)));
        let (streams, datagrams) = endpoints.split()?;
        let session = streams.open().await?;
        let datagrams = datagrams.map(|datagrams| Datagrams::start(&datagrams, &session));
        let (resets, newest_reset) = watch::channel(0);
        let answers =
            Answers { vehicle: Arc::clone(&vehicle), archive: Arc::clone(&archive), resets: newest_reset };
        answers::declare(&session, answers).await?;
        let declare =
            |name, schema, priority| declare_publisher(&session, &vehicle.name, name, schema, priority);
        let (name, hz) = (&vehicle.name, rates.odom_hz);
        let odometry = OdometryPublisher::declare(&session, name, datagrams, hz).await?;
        let state = declare("state", "State", Priority::DataHigh).await?;
        let health = declare("health", "Health", Priority::InteractiveHigh).await?;
        let keyframe = declare("map/keyframe", "Keyframe", Priority::Data).await?;
        let map = MapPublisher::declare(&session, &vehicle.name, rates, Arc::clone(&archive)).await?;
        let scene = declare("scene", "Scene", Priority::DataLow).await?;
        let offers_camera = vehicle.offers_camera && rates.camera_hz > 0.0;
        let camera = match offers_camera {
            true => Some(declare("camera", "Picture", Priority::Background).await?),
            false => None,
        };
        let key = format!("{ROOT}/{}/alive", vehicle.name);
        let failed = |error: zenoh::Error| NetError::Declare { key: key.clone(), message: error.to_string() };
        let alive = session.liveliness().declare_token(&key).await.map_err(failed)?;
        Ok(Self {
            session: session.clone(),
            odometry: Some(odometry),
            state,
            health,
            keyframe,
            map,
            scene,
            camera,
            _alive: alive,
            offers_camera,
            rot_v_b: vehicle.rot_v_b,
            rates,
            archive,
            resets,
            commands: Arc::clone(&vehicle.commands),
            course: Course::new(&rates),
        })
    }

    /// Sends what the rings hold until the flight is over, then once more.
    pub async fn run(mut self, rings: &Arc<Rings>, to_send: ToSend) {
        let ToSend { odometry: waiting, mut estimates, mut places } = to_send;
        let odometry = self.odometry.take().map(|publisher| publisher.spawn(Arc::clone(rings), waiting));
        let pictures = self.camera.take().map(|camera| {
            tokio::spawn(camera::serve(camera, Arc::clone(rings), self.rates, Arc::clone(&self.commands)))
        });
        let bell = rings.bell.listen();
        while !rings.stop.load(Ordering::Relaxed) {
            match &bell {
                Ok(bell) => drop(tokio::time::timeout(CHORES_PERIOD, bell.rung()).await),
                Err(_) => tokio::time::sleep(CHORES_PERIOD).await,
            }
            self.empty(rings, &mut estimates, &mut places).await;
            self.do_chores();
        }
        self.empty(rings, &mut estimates, &mut places).await;
        self.map.finish().await;
        if let Some(pictures) = pictures {
            pictures.abort();
        }
        rings.odometry_bell.ring();
        if let Some(odometry) = odometry {
            let _ = odometry.await;
        }
        let _ = self.session.close().await;
    }

    /// Logs what was refused, and gives a sign of life to whoever started the process.
    fn do_chores(&mut self) {
        if self.course.chores.elapsed() < CHORES_PERIOD {
            return;
        }
        self.course.chores = Instant::now();
        audit::log_refusals();
        diagnosis::report_failures();
        if self.course.alive.elapsed() >= ALIVE_PERIOD {
            self.course.alive = Instant::now();
            self.commands.report(&Request::Alive);
        }
    }

    /// Sends what the rings hold. A message that cannot be sent is dropped, by its quality of service; receivers see a gap
    /// in the sequence numbers.
    async fn empty(
        &mut self,
        rings: &Rings,
        estimates: &mut LaneReader<(Estimate, f64)>,
        places: &mut LaneReader<MapEstimate>,
    ) {
        while let Some((estimate, frame_ms)) = estimates.pop() {
            self.send_estimate(rings, &estimate, frame_ms).await;
        }
        while let Some(estimate) = places.pop() {
            self.map.follow(&estimate).await;
        }
        // A change of the sensors is told also while there are no frames.
        if let Some(message) = self.course.feed.renew(&rings.sensors()) {
            let _ = self.health.put(message.encode_to_vec()).await;
        }
        self.map.send_path(rings).await;
        while let Some(snapshot) = rings.snapshots.read(|snapshot| snapshot.clone()) {
            self.send_snapshot(&snapshot).await;
        }
    }

    async fn send_estimate(&mut self, rings: &Rings, estimate: &Estimate, frame_ms: f64) {
        let keyframes = {
            let mut archive = lock(&self.archive);
            archive.remember(estimate);
            archive.keyframes.count()
        };
        self.resets.send_replace(estimate.reset_counter);
        if self.course.state.admits(estimate.stamp) {
            let _ = self.state.put(wire::state(estimate, self.course.states, now_ns()).encode_to_vec()).await;
            self.course.states += 1;
        }
        let around = Circumstances {
            dropped: rings.dropped(),
            rung: Rung::of_level(rings.rung.load(Ordering::Relaxed)).unwrap_or(Rung::Full),
            keyframes,
            offers_camera: self.offers_camera,
            rot_v_b: self.rot_v_b,
            sensors: rings.sensors(),
        };
        if let Some(message) = self.course.feed.update(estimate, frame_ms, &around) {
            let _ = self.health.put(message.encode_to_vec()).await;
        }
    }

    async fn send_snapshot(&mut self, snapshot: &MapSnapshot) {
        let keyframes = lock(&self.archive).keyframes.update(snapshot);
        for message in keyframes {
            let _ = self.keyframe.put(message).await;
        }
        if self.course.scene.admits(snapshot.stamp) {
            let _ = self.scene.put(wire::scene(snapshot, self.course.scenes, now_ns()).encode_to_vec()).await;
            self.course.scenes += 1;
        }
    }
}
