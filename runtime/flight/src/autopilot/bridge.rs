//! The pipeline's side of the bridge, and its thread.

use super::clock::StampClock;
use super::frames::Frames;
use super::handover::{Handover, Signals, handover_ring};
use super::link::{Link, LinkError};
use super::sender::{BridgeFigures, Sender};
use crate::pipeline::listener::{Listener, Producer, Subscriber};
use crate::pipeline::{Instants, Stamps};
use crate::schedule::host::raise_priority;
use crate::schedule::ring::Writer;
use crate::schedule::tasks::TaskId;
use crate::schedule::ticker::{Monotonic, Ticker};
use crate::schedule::watchdog::Pulse;
use nalgebra::UnitQuaternion;
use plumbline_config::options::{AutopilotConfig, AutopilotEndpoint, VehicleConfig};
use plumbline_estimator::TrackingState;
use plumbline_record::Said;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::thread::JoinHandle;
use std::time::Duration;
use thiserror::Error;

/// SCHED_FIFO priority of the bridge's thread: frames, which take whole processors, must not shake the rate that an
/// autopilot counts on; the odometry itself goes first (see the task table, [`crate::schedule::tasks`]).
const PRIORITY: u8 = 70;

/// Why there is no bridge.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum BridgeError {
    /// The configured address cannot be read.
    #[error("autopilot.connect: {0}")]
    Endpoint(String),
    /// The mounting of the IMU is not known, and with it the attitude that the autopilot would receive.
    #[error(
        "{}, and the autopilot would receive a wrong attitude: {}",
        VehicleConfig::UNKNOWN,
        VehicleConfig::CURE
    )]
    Mounting,
    /// The line cannot be opened.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// The system refuses the thread.
    #[error("cannot start the autopilot's thread: {0}")]
    Thread(#[from] std::io::Error),
}

/// The bridge to the autopilot, for one run.
#[derive(Debug)]
pub struct Bridge {
    signals: Arc<Signals>,
    thread: Option<JoinHandle<BridgeFigures>>,
    pulse: Arc<Pulse>,
    /// Taken by the listener of the tick.
    tick: Option<TickListener>,
}

impl Bridge {
    /// Opens the line and begins to send, before frames where real-time priorities are wanted (`is_realtime`); nothing but
    /// signs of life before there is odometry. A line that cannot be had yet is waited for in a flight with live sensors.
    ///
    /// # Errors
    /// When the mounting is unknown, or the address or device cannot be used.
    pub fn start(
        config: &AutopilotConfig,
        mounting: &VehicleConfig,
        stamps: Stamps,
        is_realtime: bool,
    ) -> Result<Self, BridgeError> {
        let frames = Frames::new(&mounting.rot_v_b().ok_or(BridgeError::Mounting)?);
        let endpoint = AutopilotEndpoint::parse(&config.connect).map_err(BridgeError::Endpoint)?;
        let link = match stamps {
            Stamps::OfHost => Link::open_patiently(&endpoint),
            Stamps::Replayed => Link::open(&endpoint)?,
        };
        let (signals, (writer, waiting)) = (Arc::new(Signals::default()), handover_ring());
        let sender = Sender::new(config, link, frames);
        let period = Duration::from_secs_f64(1.0 / config.rate_hz);
        let theirs = Arc::clone(&signals);
        let pulse = Arc::new(Pulse::new(TaskId::Autopilot));
        let beating = Arc::clone(&pulse);
        let thread = std::thread::Builder::new().name("plumbline-pilot".into()).spawn(move || {
            if is_realtime {
                // What the host refuses is told by the run.
                let _ = raise_priority(PRIORITY);
            }
            let first = Monotonic::now().plus_nanos(period.as_nanos() as i64);
            let run = || sender.run(&theirs, waiting, Ticker::new(first, period), &beating);
            match catch_unwind(AssertUnwindSafe(run)) {
                Ok(figures) => {
                    beating.idle();
                    figures
                }
                Err(fault) => {
                    beating.die();
                    resume_unwind(fault)
                }
            }
        })?;
        let tick = TickListener::new(Arc::clone(&signals), writer, frames, stamps);
        Ok(Self { signals, thread: Some(thread), pulse, tick: Some(tick) })
    }

    /// Asks `instants` for the state at each CAMERA_TRIGGER of the autopilot from now on.
    pub fn ask_at_triggers(&self, instants: &Arc<Instants>) {
        let _ = self.signals.instants.set(Arc::clone(instants));
    }

    /// Says that there will be no more odometry, and ends. The counts, unless the thread ended by a fault.
    pub fn stop(mut self) -> Option<BridgeFigures> {
        self.end()
    }

    fn end(&mut self) -> Option<BridgeFigures> {
        self.signals.stop.store(true, Ordering::Relaxed);
        let ended = self.thread.take()?.join();
        if ended.is_err() {
            tracing::error!("the autopilot's thread ended by a fault of its own; please report this");
        }
        ended.ok()
    }
}

impl Drop for Bridge {
    fn drop(&mut self) {
        self.end();
    }
}

impl Subscriber for Bridge {
    fn listener(&mut self, producer: Producer) -> Box<dyn Listener> {
        match (producer, self.tick.take_if(|_| producer == Producer::Tick)) {
            (Producer::Tick, Some(tick)) => Box::new(tick),
            (Producer::Window, _) => Box::new(WindowListener(Arc::clone(&self.signals))),
            _ => Box::new(()),
        }
    }

    fn pulses(&self, adopt: &mut dyn FnMut(Arc<Pulse>)) {
        adopt(Arc::clone(&self.pulse));
    }
}

/// Hears odometry.
#[derive(Debug)]
struct TickListener {
    signals: Arc<Signals>,
    writer: Writer<Handover>,
    frames: Frames,
    clock: StampClock,
    rot_l_o: Option<UnitQuaternion<f64>>,
}

impl TickListener {
    fn new(signals: Arc<Signals>, writer: Writer<Handover>, frames: Frames, stamps: Stamps) -> Self {
        Self { signals, writer, frames, clock: StampClock::new(stamps), rot_l_o: None }
    }
}

impl Listener for TickListener {
    fn said(&mut self, said: &Said) {
        let Said::Odometry(odometry) = said else { return };
        let measured = self.clock.measured(odometry.stamp, Monotonic::now());
        let rot_l_o = *self.rot_l_o.get_or_insert_with(|| self.frames.local_frame(&odometry.pose_o_b));
        // Without room the autopilot's thread is a third of a second behind, and finds enough.
        let _ = self.writer.push(Handover { odometry: odometry.clone(), measured, rot_l_o });
        self.signals.has_pose.store(true, Ordering::Relaxed);
    }
}

/// Notes an estimate that is given up.
struct WindowListener(Arc<Signals>);

impl Listener for WindowListener {
    fn said(&mut self, said: &Said) {
        if let Said::Estimate(full) = said
            && full.estimate.state == TrackingState::Failed
        {
            self.0.has_pose.store(false, Ordering::Relaxed);
        }
    }
}

#[cfg(test)]
mod realtime {
    use super::super::fixture::{estimate, odometry};
    use super::*;
    use mavlink::dialects::common::{MavMessage, ODOMETRY_DATA, TIMESYNC_DATA};
    use mavlink::{MavHeader, MavlinkReader, MavlinkVersion};
    use plumbline_config::options::AutopilotClock;
    use plumbline_record::said::FullEstimate;
    use std::net::UdpSocket;
    use std::time::Instant;

    /// How far the clock of the autopilot is ahead, ns.
    const AHEAD_NS: i64 = 1_234_567_000_000;

    struct Autopilot {
        socket: UdpSocket,
        odometry: Vec<(Instant, ODOMETRY_DATA)>,
        texts: Vec<String>,
        heartbeats: usize,
        answered: usize,
    }

    impl Autopilot {
        fn new() -> (Self, AutopilotConfig) {
            let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
            socket.set_read_timeout(Some(Duration::from_millis(20))).unwrap();
            let connect = format!("udp://{}", socket.local_addr().unwrap());
            let config = AutopilotConfig { connect, ..AutopilotConfig::default() };
            (Self { socket, odometry: vec![], texts: vec![], heartbeats: 0, answered: 0 }, config)
        }

        /// Takes what comes for this long, feeding the bridge meanwhile.
        fn fly(&mut self, duration: Duration, mut feed: impl FnMut()) {
            let end = Instant::now() + duration;
            while Instant::now() < end {
                feed();
                let mut bytes = [0; 2048];
                let Ok((count, from)) = self.socket.recv_from(&mut bytes) else { continue };
                let mut reader = MavlinkReader::new(&bytes[..count]);
                let (header, message) = reader.read_message::<MavMessage>(MavlinkVersion::V2).unwrap();
                assert_eq!((header.system_id, header.component_id), (1, 197));
                match message {
                    MavMessage::ODOMETRY(odometry) => self.odometry.push((Instant::now(), odometry)),
                    MavMessage::STATUSTEXT(text) => self.texts.push(text.text.to_str().unwrap().into()),
                    MavMessage::HEARTBEAT(_) => self.heartbeats += 1,
                    MavMessage::TIMESYNC(ask) if ask.tc1 == 0 => {
                        let tc1 = Monotonic::now().0 + AHEAD_NS;
                        let answer = TIMESYNC_DATA { tc1, target_system: 1, target_component: 197, ..ask };
                        self.say(&MavMessage::TIMESYNC(answer), from);
                    }
                    MavMessage::TIMESYNC(answer) => {
                        assert_eq!(answer.ts1, 42);
                        self.answered += 1;
                    }
                    other => panic!("{other:?}"),
                }
            }
        }

        fn say(&self, message: &MavMessage, to: std::net::SocketAddr) {
            let header = MavHeader { system_id: 1, component_id: 1, sequence: 0 };
            let mut bytes = Vec::new();
            mavlink::write_v2_msg(&mut bytes, header, message).unwrap();
            self.socket.send_to(&bytes, to).unwrap();
        }

        fn qualities(&mut self) -> Vec<i8> {
            self.odometry.drain(..).map(|(_, message)| message.quality).collect()
        }
    }

    /// Odometry as of now, by a clock of 1970.
    fn fresh() -> Said {
        let mut fresh = odometry();
        fresh.stamp = plumbline_config::Timestamp::from_nanos(1_500_000_000_000_000_000 + Monotonic::now().0);
        Said::Odometry(fresh)
    }

    #[test]
    fn odometry_goes_on_at_its_rate_while_the_estimator_comes_and_goes() {
        let (mut autopilot, config) = Autopilot::new();
        let mut bridge =
            Bridge::start(&config, &VehicleConfig::mounted([0.0; 3]), Stamps::Replayed, false).unwrap();
        let mut tick = bridge.listener(Producer::Tick);
        autopilot.fly(Duration::from_millis(500), || {});
        assert!(autopilot.odometry.is_empty(), "nothing is sent before the first pose");
        let began = Instant::now();
        autopilot.fly(Duration::from_millis(1200), || tick.said(&fresh()));
        let (_, newest) = autopilot.odometry.last().unwrap().clone();
        assert_eq!((newest.quality, newest.reset_counter), (80, 2));
        let age_us = Monotonic::now().0 / 1000 - newest.time_usec as i64;
        assert!((0..60_000).contains(&age_us), "{age_us} us");
        assert!(autopilot.qualities().iter().filter(|q| **q == 80).count() > 40);
        autopilot.fly(Duration::from_millis(1500), || {});
        let lost = autopilot.odometry.last().unwrap().1.clone();
        assert_eq!((lost.quality, lost.x, lost.vx), (-1, newest.x, 0.0));
        assert!(lost.pose_covariance[0] > 1e5);
        assert!(autopilot.qualities().iter().filter(|q| **q == -1).count() >= 30);
        // For half a second nothing new comes, and nothing is sent twice.
        let ran = began.elapsed().as_secs_f64() - 0.5;
        let figures = bridge.stop().unwrap();
        assert!((figures.odometry as f64 / ran / 40.0 - 1.0).abs() < 0.1, "{figures:?} in {ran} s");
        autopilot.fly(Duration::from_millis(100), || {});
        assert_eq!(autopilot.texts[..2], ["Plumbline: tracking", "Plumbline: lost, estimator is silent"]);
        assert_eq!(autopilot.texts.last().unwrap(), "Plumbline: lost, stopped");
        assert!((3..=5).contains(&autopilot.heartbeats), "{}", autopilot.heartbeats);
        let offset_ms = figures.clock_offset_ms.unwrap();
        assert!((offset_ms - AHEAD_NS as f64 * 1e-6).abs() < 5.0, "{offset_ms}");
    }

    #[test]
    fn a_failed_estimate_is_lost_at_once() {
        let (signals, (writer, waiting)) = (Arc::new(Signals::default()), handover_ring());
        let frames = Frames::new(&UnitQuaternion::identity());
        let mut tick = TickListener::new(Arc::clone(&signals), writer, frames, Stamps::Replayed);
        let mut window = WindowListener(Arc::clone(&signals));
        tick.said(&fresh());
        assert!(signals.has_pose.load(Ordering::Relaxed));
        let estimate = estimate(TrackingState::Failed);
        window.said(&Said::Estimate(FullEstimate { estimate, frame_ms: 10.0 }));
        assert!(!signals.has_pose.load(Ordering::Relaxed));
        tick.said(&fresh());
        assert!(signals.has_pose.load(Ordering::Relaxed), "the next odometry ends it");
        assert_eq!(waiting.waiting(), 2);
    }

    #[test]
    fn by_the_autopilots_clock_nothing_is_sent_before_that_is_known() {
        let (mut autopilot, config) = Autopilot::new();
        let config = AutopilotConfig { clock: AutopilotClock::Autopilot, ..config };
        let mut bridge =
            Bridge::start(&config, &VehicleConfig::mounted([0.0; 3]), Stamps::Replayed, false).unwrap();
        let mut tick = bridge.listener(Producer::Tick);
        autopilot.fly(Duration::from_millis(2500), || tick.said(&fresh()));
        let (first, last) = (&autopilot.odometry[0].1, &autopilot.odometry.last().unwrap().1);
        assert!(first.quality == 80 && first.time_usec as i64 > AHEAD_NS / 1000, "{first:?}");
        let age_us = (Monotonic::now().0 + AHEAD_NS) / 1000 - last.time_usec as i64;
        assert!(last.quality == 80 && (-5000..60_000).contains(&age_us), "{age_us} us");
    }

    #[test]
    fn on_an_open_port_the_odometry_goes_to_the_autopilot_and_to_nobody_else_who_speaks() {
        let (autopilot, config) = Autopilot::new();
        let port = UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
        let config = AutopilotConfig { connect: format!("udpin://{port}"), ..config };
        let _bridge =
            Bridge::start(&config, &VehicleConfig::mounted([0.0; 3]), Stamps::Replayed, false).unwrap();
        let station = UdpSocket::bind("127.0.0.1:0").unwrap();
        station.set_read_timeout(Some(Duration::from_millis(20))).unwrap();
        let is_answered = |socket: &UdpSocket, (system_id, component_id): (_, u8)| {
            (0..20).any(|_| {
                let mut bytes = Vec::new();
                let header = MavHeader { system_id, component_id, sequence: 0 };
                let message = MavMessage::HEARTBEAT(mavlink::dialects::common::HEARTBEAT_DATA::default());
                mavlink::write_v2_msg(&mut bytes, header, &message).unwrap();
                socket.send_to(&bytes, port).unwrap();
                socket.recv_from(&mut [0; 2048]).is_ok()
            })
        };
        assert!(!is_answered(&station, (255, 190)), "a ground station");
        assert!(!is_answered(&station, (2, 1)), "the autopilot of another vehicle");
        assert!(is_answered(&autopilot.socket, (1, 1)));
    }

    #[test]
    fn noise_and_floods_from_outside_change_nothing() {
        let (mut autopilot, config) = Autopilot::new();
        let mut bridge =
            Bridge::start(&config, &VehicleConfig::mounted([0.0; 3]), Stamps::Replayed, false).unwrap();
        let mut tick = bridge.listener(Producer::Tick);
        let from = std::iter::repeat_with(|| autopilot.socket.recv_from(&mut [0; 2048]))
            .take(100)
            .find_map(|received| received.ok())
            .unwrap()
            .1;
        let flood = UdpFlood { socket: autopilot.socket.try_clone().unwrap(), to: from };
        let began = Instant::now();
        std::thread::scope(|scope| {
            scope.spawn(|| flood.pour(Duration::from_millis(1500)));
            autopilot.fly(Duration::from_millis(1500), || tick.said(&fresh()));
        });
        let ran = began.elapsed().as_secs_f64();
        let figures = bridge.stop().unwrap();
        assert!((figures.odometry as f64 / ran / 40.0 - 1.0).abs() < 0.15, "{figures:?}");
        assert!(figures.passed_over_bytes > 10_000 && figures.received > 100, "{figures:?}");
    }

    struct UdpFlood {
        socket: UdpSocket,
        to: std::net::SocketAddr,
    }

    impl UdpFlood {
        /// Noise and requests for the time, as fast as they go.
        fn pour(&self, duration: Duration) {
            let end = Instant::now() + duration;
            let header = MavHeader { system_id: 1, component_id: 1, sequence: 0 };
            let ask = TIMESYNC_DATA { tc1: 0, ts1: 42, target_system: 0, target_component: 0 };
            let mut request = Vec::new();
            mavlink::write_v2_msg(&mut request, header, &MavMessage::TIMESYNC(ask)).unwrap();
            let noise: Vec<u8> = (0..1400_u32).map(|k| (k * k % 251) as u8).collect();
            while Instant::now() < end {
                let _ = self.socket.send_to(&noise, self.to);
                let _ = self.socket.send_to(&request, self.to);
                std::thread::sleep(Duration::from_micros(200));
            }
        }
    }
}
