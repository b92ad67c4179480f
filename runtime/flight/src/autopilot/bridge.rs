//! The pipeline's side of the bridge, and its thread.

use super::clock::StampClock;
use super::flow::FlowMeter;
use super::frames::VehicleFrames;
use super::handover::{FlowHandover, Handover, Signals, flow_ring, handover_ring};
use super::link::{AutopilotLink, LinkError};
use super::sender::{BridgeFigures, Sender};
use crate::pipeline::listener::{Listener, ListenerView, Producer, Subscriber};
use crate::pipeline::{Instants, Stamps};
use crate::schedule::host::raise_priority;
use crate::schedule::ring::Writer;
use crate::schedule::tasks::TaskId;
use crate::schedule::ticker::{Monotonic, Ticker};
use crate::schedule::watchdog::Pulse;
use crate::schedule::worker::Worker;
use nalgebra::UnitQuaternion;
use plumbline_config::ValidSetup;
use plumbline_config::options::{
    AutopilotConfig, AutopilotEndpoint, FlowMessages, UnknownMounting, VehicleConfig,
};
use plumbline_estimator::{HealthBits, TrackingState};
use plumbline_record::Said;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::Arc;
use std::sync::atomic::Ordering;
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
    #[error(transparent)]
    Mounting(#[from] UnknownMounting),
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
    worker: Worker<BridgeFigures>,
    pulse: Arc<Pulse>,
    /// Taken by the listener of the tick.
    tick: Option<TickListener>,
    /// Writer of flow measurements with their clock domain, until [`Self::measure_flow`] takes it.
    flows: Option<(Writer<FlowHandover>, Stamps)>,
    /// Taken by the listener of the front-end.
    front_end: Option<FlowListener>,
    has_flow: bool,
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
        let frames = VehicleFrames::new(&mounting.rot_v_b().ok_or(UnknownMounting("the autopilot"))?);
        let endpoint = AutopilotEndpoint::parse(&config.connect).map_err(BridgeError::Endpoint)?;
        let link = match stamps {
            Stamps::OfHost => AutopilotLink::open_patiently(&endpoint),
            Stamps::Replayed => AutopilotLink::open(&endpoint)?,
        };
        let (signals, (writer, waiting)) = (Arc::new(Signals::default()), handover_ring());
        let (flow_writer, flows) = flow_ring();
        let sender = Sender::new(config, link, frames);
        let period = Duration::from_secs_f64(1.0 / config.rate_hz);
        let (theirs, ours) = (Arc::clone(&signals), Arc::clone(&signals));
        let pulse = Arc::new(Pulse::new(TaskId::Autopilot));
        let beating = Arc::clone(&pulse);
        let stop = move || ours.stop.store(true, Ordering::Relaxed);
        let worker = Worker::start("plumbline-pilot", stop, move || {
            if is_realtime {
                // What the host refuses is told by the run.
                let _ = raise_priority(PRIORITY);
            }
            let first = Monotonic::now().plus_nanos(period.as_nanos() as i64);
            let run = || sender.run(&theirs, waiting, flows, Ticker::new(first, period), &beating);
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
        let flows = (config.flow != FlowMessages::Off).then_some((flow_writer, stamps));
        Ok(Self { signals, worker, pulse, tick: Some(tick), flows, front_end: None, has_flow: false })
    }

    /// Measures the flow of the points that a rig tracks, where the configuration wants it sent.
    pub fn measure_flow(&mut self, setup: &ValidSetup, mounting: &VehicleConfig) {
        let Some(meter) = FlowMeter::new(setup, mounting) else { return };
        let Some((writer, stamps)) = self.flows.take() else { return };
        let signals = Arc::clone(&self.signals);
        self.front_end = Some(FlowListener { signals, writer, meter, clock: StampClock::new(stamps) });
        self.has_flow = true;
    }

    /// Asks `instants` for the state at each CAMERA_TRIGGER of the autopilot from now on.
    pub fn ask_at_triggers(&self, instants: &Arc<Instants>) {
        let _ = self.signals.instants.set(Arc::clone(instants));
    }

    /// Says that there will be no more odometry, and ends. The counts, unless the thread ended by a fault.
    pub fn stop(mut self) -> Option<BridgeFigures> {
        let ended = self.worker.end();
        if ended.is_none() {
            tracing::error!("the autopilot's thread ended by a fault of its own; please report this");
        }
        ended
    }
}

impl Subscriber for Bridge {
    fn listener(&mut self, producer: Producer) -> Box<dyn Listener> {
        let boxed = |listener: Option<Box<dyn Listener>>| listener.unwrap_or_else(|| Box::new(()));
        match producer {
            Producer::Tick => boxed(self.tick.take().map(|tick| Box::new(tick) as _)),
            Producer::FrontEnd => boxed(self.front_end.take().map(|flow| Box::new(flow) as _)),
            Producer::Window => {
                Box::new(WindowListener { signals: Arc::clone(&self.signals), has_flow: self.has_flow })
            }
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
    frames: VehicleFrames,
    clock: StampClock,
    rot_l_o: Option<UnitQuaternion<f64>>,
}

impl TickListener {
    fn new(signals: Arc<Signals>, writer: Writer<Handover>, frames: VehicleFrames, stamps: Stamps) -> Self {
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

/// Measures the flow of the points of each frame.
#[derive(Debug)]
struct FlowListener {
    signals: Arc<Signals>,
    writer: Writer<FlowHandover>,
    meter: FlowMeter,
    clock: StampClock,
}

impl Listener for FlowListener {
    fn shown(&mut self, view: ListenerView<'_>) {
        let ListenerView::Tracked(tracked) = view else { return };
        if tracked.health.contains(HealthBits::BAD_STAMP) {
            return;
        }
        if tracked.is_clock_set {
            self.meter.clear();
        }
        let bias_gyro = self.signals.bias_gyro();
        let flow = self.meter.measure(tracked.time.stamp, &tracked.points, &tracked.samples, &bias_gyro);
        if let Some(flow) = flow {
            let measured = self.clock.measured(flow.stamp, Monotonic::now());
            let _ = self.writer.push(FlowHandover { flow, measured });
        }
    }
}

/// Notes an estimate that is given up, and the gyroscope's bias where there is flow.
struct WindowListener {
    signals: Arc<Signals>,
    has_flow: bool,
}

impl Listener for WindowListener {
    fn said(&mut self, said: &Said) {
        let Said::Estimate(full) = said else { return };
        if full.estimate.state == TrackingState::Failed {
            self.signals.has_pose.store(false, Ordering::Relaxed);
        }
        if self.has_flow && full.estimate.has_pose() {
            self.signals.set_bias_gyro(&full.estimate.bias_gyro);
        }
    }
}

#[cfg(test)]
#[path = "bridge_tests.rs"]
mod realtime;
