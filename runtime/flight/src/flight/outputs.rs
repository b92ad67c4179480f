//! Outputs of a flight while it goes on: autopilot, map file, recorder, and those of the caller, such as the network.
//! Each listens to the run on the threads that produce, and has a thread of its own for the rest.

use super::{Flight, FlightError};
use crate::autopilot::{Bridge, BridgeFigures};
use crate::log::recorder::RecorderSummary;
use crate::log::{Recorder, WhenFull};
use crate::pipeline::listener::Subscriber;
use crate::pipeline::{Control, RunError};
use crate::places::MapSaver;
use std::path::Path;
use std::sync::Arc;

/// Outputs of a flight.
#[derive(Default)]
pub struct Outputs {
    bridge: Option<Bridge>,
    others: Vec<Box<dyn Subscriber>>,
    saver: Option<MapSaver>,
    recorder: Option<Recorder>,
}

/// Figures of the outputs.
#[derive(Default)]
pub struct OutputFigures {
    /// Figures of the autopilot's bridge, if there is one.
    pub autopilot: Option<BridgeFigures>,
    /// Summary of the recorder, if there is one.
    pub recording: Option<RecorderSummary>,
}

impl Outputs {
    /// Sends odometry to the autopilot that the flight's configuration names; in one with live sensors, as soon as that can be
    /// done. In one with a local socket, the states at the camera triggers of the autopilot are asked of `control`.
    ///
    /// # Errors
    /// When the address or device cannot be used.
    pub fn pilot(&mut self, flight: &Flight, control: &Control) -> Result<(), FlightError> {
        let (config, stamps) = (&flight.config, flight.stamps);
        let (autopilot, vehicle) = (&config.autopilot, &config.vehicle);
        let mut bridge = Bridge::start(autopilot, vehicle, stamps, config.runtime.realtime)?;
        bridge.measure_flow(config.setup(), vehicle);
        // Where there is nobody else to ask, and nobody to tell, nothing is kept.
        if !config.local.path.is_empty() {
            bridge.ask_at_triggers(&control.keep_instants());
        }
        self.bridge = Some(bridge);
        Ok(())
    }

    /// Adds what the caller brings, such as the network, which this crate does not know; several are told, and end, in the order in
    /// which they were added.
    pub fn add(&mut self, output: impl Subscriber + 'static) {
        self.others.push(Box::new(output));
    }

    /// Keeps the map at `path` whenever somebody asks `control` for it.
    ///
    /// # Errors
    /// When there can be no thread.
    pub fn save_map(&mut self, path: &Path, control: &Arc<Control>) -> Result<(), FlightError> {
        let saver = MapSaver::start(path, control);
        self.saver = Some(saver.map_err(|error| RunError::Thread(error.to_string()))?);
        Ok(())
    }

    /// Records `flight` at `path`.
    ///
    /// # Errors
    /// When there is a log of that name, or its file cannot be created.
    pub fn record(&mut self, path: &Path, flight: &Flight, when_full: WhenFull) -> Result<(), FlightError> {
        let known_map = flight.map.as_ref().map(|known| known.sha256.clone());
        let before = (known_map, flight.first_reset_counter);
        self.recorder = Some(Recorder::start(path, &flight.config, before, when_full)?);
        Ok(())
    }

    /// All of them, the autopilot first: it waits for odometry.
    pub fn subscribers(&mut self) -> Vec<&mut dyn Subscriber> {
        let Self { bridge, others, saver, recorder } = self;
        let mut all: Vec<&mut dyn Subscriber> = Vec::new();
        all.extend(bridge.as_mut().map(|bridge| bridge as &mut dyn Subscriber));
        all.extend(others.iter_mut().map(|other| other.as_mut() as _));
        all.extend(saver.as_mut().map(|saver| saver as &mut dyn Subscriber));
        all.extend(recorder.as_mut().map(|recorder| recorder as &mut dyn Subscriber));
        all
    }

    /// The run is over: what waits is sent and written.
    pub fn finish(self) -> OutputFigures {
        let Self { bridge, others, saver, recorder } = self;
        let autopilot = bridge.and_then(Bridge::stop);
        let recording = recorder.map(Recorder::finish);
        drop((others, saver));
        OutputFigures { autopilot, recording }
    }
}
