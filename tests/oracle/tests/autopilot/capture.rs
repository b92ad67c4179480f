//! Capture of the messages to the autopilot in a flight, by data time: the bridge's own choice and contents of messages, its
//! thread replaced by the stamps of the inertial samples. A capture is therefore the same on every run, and takes no real time.

use mavlink::dialects::common::ODOMETRY_DATA;
use nalgebra::UnitQuaternion;
use plumbline_config::{ImuSample, Timestamp, ValidConfig};
use plumbline_drivers::ImuReading;
use plumbline_estimator::Odometry;
use plumbline_flight::autopilot::feed::MessageFeed;
use plumbline_flight::autopilot::frames::VehicleFrames;
use plumbline_flight::autopilot::handover::Handover;
use plumbline_flight::flight::{Flight, Truth};
use plumbline_flight::pipeline::listener::{Listener, Producer, Subscriber};
use plumbline_flight::pipeline::{Control, RunOptions};
use plumbline_flight::schedule::ticker::Monotonic;
use plumbline_record::Said;
use plumbline_simulator::{Scenario, Simulator};
use std::path::Path;
use std::sync::{Arc, Mutex};

/// Inputs of an autopilot on board.
pub struct Captured {
    pub config: ValidConfig,
    /// Ground truth of the vehicle.
    pub simulator: Simulator,
    /// Inertial samples, in the axes of the IMU.
    pub samples: Vec<ImuSample>,
    /// Odometry at the rate of the IMU.
    pub odometry: Vec<Odometry>,
    /// Messages, and when they were sent.
    pub messages: Vec<(Timestamp, ODOMETRY_DATA)>,
}

/// Flies `scenario` as fast as it goes, and captures it.
pub fn capture(scenario: &Scenario) -> Captured {
    let flight = opened(scenario, None);
    let config = flight.config.clone();
    let mut tap = Tap::new(&config);
    let options = RunOptions { speed: None, threads: 2 };
    let flown = plumbline_flight::flight::fly(flight, &options, &Control::default(), vec![&mut tap]).unwrap();
    let Truth::Simulated(simulator) = flown.truth else { panic!("a simulated flight") };
    let (samples, odometry, messages) = tap.into_parts();
    Captured { config, simulator, samples, odometry, messages }
}

/// A simulated flight without a map; its frames are kept in `frames`, a folder.
pub fn opened(scenario: &Scenario, frames: Option<&Path>) -> Flight {
    let mut flight = plumbline_flight::flight::open_simulation(None, scenario, false, 0.0, frames).unwrap();
    let set = |c: &mut plumbline_config::Config| c.estimator.places.enabled = false;
    flight.config = flight.config.with("test", set).unwrap();
    flight
}

#[derive(Default)]
struct Taken {
    samples: Vec<ImuSample>,
    odometry: Vec<Odometry>,
    messages: Vec<(Timestamp, ODOMETRY_DATA)>,
    sending: Option<Sending>,
}

struct Sending {
    frames: VehicleFrames,
    feed: MessageFeed,
    rot_l_o: Option<UnitQuaternion<f64>>,
    period_ns: i64,
    due: Option<Timestamp>,
}

/// Listens to the odometry.
#[derive(Clone)]
pub struct Tap(Arc<Mutex<Taken>>);

impl Tap {
    pub fn new(config: &ValidConfig) -> Self {
        let (autopilot, frames) = (&config.autopilot, VehicleFrames::new(&config.vehicle.rot_v_b().unwrap()));
        let feed = MessageFeed::new(frames, autopilot.lost_pose);
        let period_ns = (1e9 / autopilot.rate_hz) as i64;
        let sending = Some(Sending { frames, feed, rot_l_o: None, period_ns, due: None });
        Self(Arc::new(Mutex::new(Taken { sending, ..Taken::default() })))
    }

    /// Samples, odometry and messages.
    pub fn into_parts(self) -> (Vec<ImuSample>, Vec<Odometry>, Vec<(Timestamp, ODOMETRY_DATA)>) {
        let taken = std::mem::take(&mut *self.0.lock().unwrap());
        (taken.samples, taken.odometry, taken.messages)
    }
}

impl Subscriber for Tap {
    fn listener(&mut self, producer: Producer) -> Box<dyn Listener> {
        match producer {
            Producer::Tick => Box::new(self.clone()),
            _ => Box::new(()),
        }
    }
}

impl Listener for Tap {
    fn said(&mut self, said: &Said) {
        match said {
            Said::Odometry(odometry) => self.odometry(odometry),
            Said::Imu(reading) => self.reading(reading),
            _ => {}
        }
    }
}

impl Tap {
    fn odometry(&self, odometry: &Odometry) {
        let mut taken = self.0.lock().unwrap();
        taken.odometry.push(odometry.clone());
        let Some(sending) = &mut taken.sending else { return };
        let rot_l_o = *sending.rot_l_o.get_or_insert_with(|| sending.frames.local_frame(&odometry.pose_o_b));
        let measured = Monotonic(odometry.stamp.as_nanos());
        sending.feed.take(Handover { odometry: odometry.clone(), measured, rot_l_o });
    }

    /// Comes after the odometry of the same sample.
    fn reading(&self, reading: &ImuReading) {
        let mut taken = self.0.lock().unwrap();
        let stamp = reading.sample.stamp;
        taken.samples.push(reading.sample);
        let Some(sending) = &mut taken.sending else { return };
        let due = *sending.due.get_or_insert(stamp);
        if stamp < due {
            return;
        }
        sending.due = Some(due.plus_nanos(sending.period_ns));
        let now = Monotonic(stamp.as_nanos());
        let condition = sending.feed.condition(true, now, |_| true);
        let message = sending.feed.message(condition, now, |at| u64::try_from(at.0 / 1000).ok());
        taken.messages.extend(message.map(|message| (stamp, message)));
    }
}
