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
use super::datagrams::Datagrams;
use super::declare::declare_publisher;
use super::endpoints::Endpoints;
use super::error::NetError;
use super::health::{Circumstances, HealthFeed};
use super::map::MapPublisher;
use super::memory::SessionMemory;
use super::odometry::OdometryPublisher;
use super::pace::{Pace, Rates};
use super::rings::{Rings, ToSend};
use super::vehicle::Vehicle;
use super::{ROOT, audit, camera, diagnosis, now_ns, wire};
use nalgebra::UnitQuaternion;
use plumbline_estimator::{Estimate, MapSnapshot};
use plumbline_flight::schedule::ladder::Rung;
use prost::Message;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};
use tokio::sync::watch;
use zenoh::Session;
use zenoh::pubsub::Publisher;
use zenoh::qos::Priority;

/// Period at which refused accesses are logged.
const CHORES_PERIOD: Duration = Duration::from_millis(200);

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
    rot_v_b: UnitQuaternion<f64>,
    archive: Arc<Mutex<Archive>>,
    resets: watch::Sender<u32>,
    memory: SessionMemory,
}

/// What a flight keeps where its session is opened anew: counters and pace of the messages, and what is answered.
pub struct Course {
    feed: HealthFeed,
    state: Pace,
    scene: Pace,
    odometry: u64,
    states: u64,
    scenes: u64,
    chores: Instant,
    archive: Arc<Mutex<Archive>>,
}

impl Course {
    /// Creates the state for the beginning of a flight.
    #[must_use]
    pub fn new(rates: &Rates) -> Self {
        Self {
            feed: HealthFeed::new(rates.health_period()),
            state: Pace::new(rates.state_hz),
            scene: Pace::new(rates.scene_hz),
            odometry: 0,
            states: 0,
            scenes: 0,
            chores: Instant::now(),
            archive: Arc::new(Mutex::new(Archive::new(rates.keyframe_landmarks))),
        }
    }
}

/// Why publishing has ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum End {
    /// There is nothing more to publish.
    FlightIsOver,
    /// The session holds too much ([`super::memory`]).
    TooMuchHeld,
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
        course: &Course,
    ) -> Result<Self, NetError> {
        let archive = Arc::clone(&course.archive);
        let memory = SessionMemory::begin(endpoints.max_memory_mb, lock(&archive).bytes());
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
        let odometry = OdometryPublisher::declare(&session, name, datagrams, hz, course.odometry).await?;
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
            memory,
        })
    }

    /// Sends what the rings hold until the flight is over, or the session holds too much, then once more.
    pub async fn run(mut self, rings: &Arc<Rings>, to_send: &mut ToSend, course: &mut Course) -> End {
        let is_closing = Arc::new(AtomicBool::new(false));
        let odometry =
            self.odometry.take().zip(to_send.odometry.take()).map(|(publisher, waiting)| {
                publisher.spawn(Arc::clone(rings), waiting, Arc::clone(&is_closing))
            });
        let pictures = self
            .camera
            .take()
            .map(|camera| tokio::spawn(camera::serve(camera, Arc::clone(rings), self.rates)));
        let bell = rings.bell.listen();
        let mut is_too_much = false;
        while !rings.stop.load(Ordering::Relaxed) && !is_too_much {
            match &bell {
                Ok(bell) => drop(tokio::time::timeout(CHORES_PERIOD, bell.rung()).await),
                Err(_) => tokio::time::sleep(CHORES_PERIOD).await,
            }
            rings.pulse.busy();
            self.empty(rings, to_send, course).await;
            is_too_much = self.do_chores(course);
        }
        rings.pulse.idle();
        self.empty(rings, to_send, course).await;
        self.map.finish().await;
        if let Some(pictures) = pictures {
            pictures.abort();
        }
        is_closing.store(true, Ordering::Relaxed);
        rings.odometry_bell.ring();
        if let Some(odometry) = odometry
            && let Ok((waiting, next)) = odometry.await
        {
            (to_send.odometry, course.odometry) = (Some(waiting), next);
        }
        let _ = self.session.close().await;
        if is_too_much { End::TooMuchHeld } else { End::FlightIsOver }
    }

    /// Tells what was refused; whether the session holds too much.
    fn do_chores(&self, course: &mut Course) -> bool {
        if course.chores.elapsed() < CHORES_PERIOD {
            return false;
        }
        course.chores = Instant::now();
        audit::log_refusals();
        diagnosis::report_failures();
        let kept = lock(&self.archive).bytes();
        self.memory.is_too_much(kept)
    }

    /// Sends what the rings hold. A message that cannot be sent is dropped, by its quality of service; receivers see a gap
    /// in the sequence numbers.
    async fn empty(&mut self, rings: &Rings, to_send: &mut ToSend, course: &mut Course) {
        while let Some((estimate, frame_ms)) = to_send.estimates.pop() {
            self.send_estimate(rings, course, &estimate, frame_ms).await;
        }
        while let Some(estimate) = to_send.places.pop() {
            self.map.follow(&estimate).await;
        }
        self.map.send_path(rings).await;
        while let Some(snapshot) = rings.snapshots.read(|snapshot| snapshot.clone()) {
            self.send_snapshot(course, &snapshot).await;
        }
    }

    async fn send_estimate(&self, rings: &Rings, course: &mut Course, estimate: &Estimate, frame_ms: f64) {
        let keyframes = {
            let mut archive = lock(&self.archive);
            archive.remember(estimate);
            archive.keyframes.count()
        };
        self.resets.send_replace(estimate.reset_counter);
        if course.state.admits(estimate.stamp) {
            let _ = self.state.put(wire::state(estimate, course.states, now_ns()).encode_to_vec()).await;
            course.states += 1;
        }
        let around = Circumstances {
            dropped: rings.dropped(),
            rung: Rung::of_level(rings.rung.load(Ordering::Relaxed)).unwrap_or(Rung::Full),
            keyframes,
            offers_camera: self.offers_camera,
            rot_v_b: self.rot_v_b,
        };
        if let Some(message) = course.feed.update(estimate, frame_ms, &around) {
            let _ = self.health.put(message.encode_to_vec()).await;
        }
    }

    async fn send_snapshot(&self, course: &mut Course, snapshot: &MapSnapshot) {
        let keyframes = lock(&self.archive).keyframes.update(snapshot);
        for message in keyframes {
            let _ = self.keyframe.put(message).await;
        }
        if course.scene.admits(snapshot.stamp) {
            let _ = self.scene.put(wire::scene(snapshot, course.scenes, now_ns()).encode_to_vec()).await;
            course.scenes += 1;
        }
    }
}
