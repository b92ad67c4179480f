//! Messages of the bridge to an autopilot on a real socket, by the clock.

use super::super::fixture::{estimate, odometry};
use super::*;
use mavlink::dialects::common::{
    MavMessage, ODOMETRY_DATA, OPTICAL_FLOW_DATA, OPTICAL_FLOW_RAD_DATA, TIMESYNC_DATA,
};
use mavlink::{MavHeader, MavlinkReader, MavlinkVersion};
use nalgebra::{Point3, Vector2, Vector3};
use plumbline_config::options::AutopilotClock;
use plumbline_config::{Config, ImuSample, Timestamp, ValidConfig};
use plumbline_estimator::Tracked;
use plumbline_estimator::points::PointObservation;
use plumbline_record::said::FullEstimate;
use std::f64::consts::{FRAC_PI_2, PI};
use std::net::UdpSocket;
use std::time::Instant;

/// Lead of the autopilot's clock, ns.
const AHEAD_NS: i64 = 1_234_567_000_000;

struct Autopilot {
    socket: UdpSocket,
    odometry: Vec<(Instant, ODOMETRY_DATA)>,
    flow: Vec<OPTICAL_FLOW_RAD_DATA>,
    rates: Vec<OPTICAL_FLOW_DATA>,
    distances: Vec<u16>,
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
        let autopilot = Self {
            socket,
            odometry: vec![],
            flow: vec![],
            rates: vec![],
            distances: vec![],
            texts: vec![],
            heartbeats: 0,
            answered: 0,
        };
        (autopilot, config)
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
                MavMessage::OPTICAL_FLOW_RAD(flow) => self.flow.push(flow),
                MavMessage::OPTICAL_FLOW(flow) => self.rates.push(flow),
                MavMessage::DISTANCE_SENSOR(down) => self.distances.push(down.current_distance),
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

/// Flight over a floor: frames of points that move, seen by both cameras of the `sim` rig, as the front-end shows them.
struct Floor {
    tracked: Tracked,
    config: ValidConfig,
    frames: i64,
    last: Instant,
}

impl Floor {
    const PERIOD_NS: i64 = 50_000_000;

    /// A vehicle whose down is where the left camera looks, and whose nose is the upper edge of the image.
    fn new(flow: FlowMessages) -> Self {
        let left = Config::preset("sim").unwrap().camera[0].pose_b_c().rotation;
        let rot_v_c = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), -FRAC_PI_2)
            * UnitQuaternion::from_axis_angle(&Vector3::x_axis(), PI);
        let (roll, pitch, yaw) = (rot_v_c * left.inverse()).euler_angles();
        let change = |c: &mut Config| {
            c.vehicle = VehicleConfig::mounted([roll, pitch, yaw].map(f64::to_degrees));
            c.autopilot.connect = "udp://127.0.0.1:9".into();
            c.autopilot.flow = flow;
        };
        let config = Config::preset("sim").unwrap().with("test", change).unwrap();
        Self { tracked: Tracked::new(config.setup()), config, frames: 0, last: Instant::now() }
    }

    /// Shows the next frame when it is time.
    fn show(&mut self, listener: &mut dyn Listener) {
        if self.last.elapsed() < Duration::from_nanos(Self::PERIOD_NS as u64) {
            return;
        }
        (self.frames, self.last) = (self.frames + 1, Instant::now());
        let at = |k: i64| Timestamp::from_nanos(1_500_000_000_000_000_000 + Self::PERIOD_NS / 10 * k);
        let pose_c0_c1 = self.config.camera[0].pose_b_c().inverse() * self.config.camera[1].pose_b_c();
        self.tracked.time.stamp = at(10 * self.frames);
        self.tracked.samples.clear();
        self.tracked.points.clear();
        for k in 10 * self.frames - 9..=10 * self.frames {
            let (gyro, accel) = (Vector3::zeros(), Vector3::zeros());
            self.tracked.samples.push(ImuSample { stamp: at(k), gyro, accel });
        }
        for k in 0..150_u32 {
            // The vehicle flies forward at 1 m/s, 2 m above the floor: what it sees moves down in the image.
            let down = 0.05 * self.frames as f64;
            let p_c0 = Point3::new(0.2 * f64::from(k % 6) - 0.5, 0.2 * f64::from(k / 6) - 4.6 + down, 2.0);
            let p_c1 = pose_c0_c1.inverse() * p_c0;
            let xy = [p_c0, p_c1].map(|p| Some(Vector2::new(p.x / p.z, p.y / p.z)));
            let covariance_px2 = [nalgebra::Matrix2::zeros(); 2];
            self.tracked.points.push(PointObservation {
                track_id: k,
                age: 2,
                px: [None; 2],
                xy,
                covariance_px2,
            });
        }
        listener.shown(ListenerView::Tracked(&self.tracked));
    }
}

#[test]
fn flow_is_sent_until_the_odometry_has_held_and_distance_always() {
    let (mut autopilot, config) = Autopilot::new();
    let config = AutopilotConfig { flow: FlowMessages::WhenLost, ..config };
    let mut floor = Floor::new(FlowMessages::WhenLost);
    let (setup, mounting) = (floor.config.setup().clone(), floor.config.vehicle.clone());
    let mut bridge = Bridge::start(&config, &mounting, Stamps::Replayed, false).unwrap();
    bridge.measure_flow(&setup, &mounting);
    let (mut tick, mut front_end) = (bridge.listener(Producer::Tick), bridge.listener(Producer::FrontEnd));
    autopilot.fly(Duration::from_millis(1000), || floor.show(&mut *front_end));
    assert!((8..=20).contains(&autopilot.flow.len()), "{}", autopilot.flow.len());
    for flow in &autopilot.flow {
        // 1 m/s forward at 2 m, for 50 ms: 0.025 rad about y, and nothing of it is the gyroscope's.
        assert!((flow.integrated_y - 0.025).abs() < 1e-4 && flow.integrated_x.abs() < 1e-4, "{flow:?}");
        assert_eq!((flow.integrated_ygyro, flow.integration_time_us, flow.quality), (0.0, 50_000, 255));
    }
    assert!(autopilot.flow.windows(2).all(|pair| pair[1].time_usec > pair[0].time_usec));
    assert!(
        autopilot.rates.iter().all(|rate| (rate.flow_rate_y - 0.5).abs() < 2e-3),
        "{:?}",
        autopilot.rates
    );
    // The last distance may still be on its way.
    assert!(autopilot.distances.len() + 1 >= autopilot.flow.len());
    assert!(autopilot.distances.iter().all(|cm| *cm == 200), "{:?}", autopilot.distances);
    // Good odometry ends it, but not at once.
    let before = autopilot.flow.len();
    autopilot.fly(Duration::from_millis(1000), || {
        floor.show(&mut *front_end);
        tick.said(&fresh());
    });
    assert!(autopilot.flow.len() > before + 5);
    autopilot.fly(Duration::from_millis(1500), || {
        floor.show(&mut *front_end);
        tick.said(&fresh());
    });
    let (before, distances) = (autopilot.flow.len(), autopilot.distances.len());
    autopilot.fly(Duration::from_millis(500), || {
        floor.show(&mut *front_end);
        tick.said(&fresh());
    });
    assert_eq!(autopilot.flow.len(), before, "odometry has held for two seconds");
    assert!(autopilot.distances.len() > distances + 5, "a range finder that was silent is not trusted");
    // Odometry of low quality is not flown by.
    let poor = || match fresh() {
        Said::Odometry(good) => Said::Odometry(plumbline_estimator::Odometry { quality: 19, ..good }),
        other => other,
    };
    autopilot.fly(Duration::from_millis(500), || {
        floor.show(&mut *front_end);
        tick.said(&poor());
    });
    assert!(autopilot.flow.len() > before + 5);
    let figures = bridge.stop().unwrap();
    assert!(
        figures.flow >= autopilot.flow.len() as u64 && figures.distances > figures.flow + 5,
        "{figures:?}"
    );
    let mut flow_texts: Vec<_> = autopilot.texts.iter().filter(|text| text.contains("flow")).collect();
    // Who has just been heard is told again.
    flow_texts.dedup();
    let (on, off) = ("Plumbline: sending optical flow", "Plumbline: odometry is back, optical flow ends");
    assert_eq!(flow_texts, [on, off, on]);
}

#[test]
fn without_the_key_nobody_listens_to_the_front_end_and_no_flow_is_sent() {
    let (mut autopilot, config) = Autopilot::new();
    let mut floor = Floor::new(FlowMessages::Off);
    let (setup, mounting) = (floor.config.setup().clone(), floor.config.vehicle.clone());
    let mut bridge = Bridge::start(&config, &mounting, Stamps::Replayed, false).unwrap();
    bridge.measure_flow(&setup, &mounting);
    assert!(bridge.front_end.is_none() && !bridge.has_flow);
    let mut front_end = bridge.listener(Producer::FrontEnd);
    autopilot.fly(Duration::from_millis(400), || floor.show(&mut *front_end));
    assert!(autopilot.flow.is_empty() && autopilot.rates.is_empty() && autopilot.texts.is_empty());
}

#[test]
fn a_failed_estimate_is_lost_at_once() {
    let (signals, (writer, waiting)) = (Arc::new(Signals::default()), handover_ring());
    let frames = VehicleFrames::new(&UnitQuaternion::identity());
    let mut tick = TickListener::new(Arc::clone(&signals), writer, frames, Stamps::Replayed);
    let mut window = WindowListener { signals: Arc::clone(&signals), has_flow: false };
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
