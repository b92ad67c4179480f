//! What a flight is handed to while it goes on: autopilot, network, ROS 2, map file, recorder. Each listens to the run on the
//! threads that produce, and has a thread of its own for the rest.

use super::{Flight, FlightError};
use crate::autopilot::{Bridge, BridgeFigures};
use crate::log::recorder::RecorderSummary;
use crate::log::{Recorder, WhenFull};
use crate::net::{Endpoints, Publisher};
use crate::pipeline::listener::Subscriber;
use crate::pipeline::{Control, RunError, Stamps};
use crate::places::MapSaver;
use crate::ros::RosOutput;
use plumbline_config::ValidConfig;
use std::path::Path;
use std::sync::Arc;

/// Those who listen to a flight.
#[derive(Default)]
pub struct Outputs {
    bridge: Option<Bridge>,
    publisher: Option<Publisher>,
    ros: Option<RosOutput>,
    saver: Option<MapSaver>,
    recorder: Option<Recorder>,
}

/// What became of what was handed over.
#[derive(Default)]
pub struct OutputFigures {
    /// What the autopilot was told, where there was one.
    pub autopilot: Option<BridgeFigures>,
    /// What the recorder wrote, where there was one.
    pub recording: Option<RecorderSummary>,
}

impl Outputs {
    /// Sends odometry to the autopilot that the flight's configuration names; in one with live sensors, as soon as that can be
    /// done.
    ///
    /// # Errors
    /// When the address or device cannot be used.
    pub fn pilot(&mut self, flight: &Flight) -> Result<(), FlightError> {
        let (config, stamps) = (&flight.config, flight.stamps);
        let (autopilot, vehicle) = (&config.autopilot, &config.vehicle);
        let bridge = Bridge::start(autopilot, vehicle, stamps, config.runtime.realtime)?;
        self.bridge = Some(bridge);
        Ok(())
    }

    /// Puts the vehicle on the network. `control` takes the commands that come from there.
    ///
    /// # Errors
    /// When the session cannot be opened.
    pub fn publish(
        &mut self,
        config: &ValidConfig,
        endpoints: &Endpoints,
        control: &Arc<Control>,
    ) -> Result<(), FlightError> {
        self.publisher = Some(Publisher::start(config, endpoints, Arc::clone(control))?);
        Ok(())
    }

    /// Starts publishing as soon as the session can be opened. A port in use, or a network that is not up yet, does not
    /// delay the flight.
    ///
    /// # Errors
    /// When the endpoints cannot be what was meant.
    pub fn publish_patiently(
        &mut self,
        config: &ValidConfig,
        endpoints: &Endpoints,
        control: &Arc<Control>,
    ) -> Result<(), FlightError> {
        self.publisher = Some(Publisher::start_patiently(config, endpoints, Arc::clone(control))?);
        Ok(())
    }

    /// Puts `vehicle` on the network of ROS 2; `stamps` are those of the samples.
    ///
    /// # Errors
    /// When no thread can be had.
    pub fn publish_ros(
        &mut self,
        config: &ValidConfig,
        vehicle: &str,
        stamps: Stamps,
    ) -> Result<(), FlightError> {
        self.ros = Some(RosOutput::start(&config.ros, vehicle, config.vehicle.rot_v_b(), stamps)?);
        Ok(())
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
        self.recorder = Some(Recorder::start_going_on(path, &flight.config, before, when_full)?);
        Ok(())
    }

    /// All of them, in the order in which they are to be told: the recorder keeps frames, and comes last.
    pub fn subscribers(&mut self) -> Vec<&mut dyn Subscriber> {
        let Self { bridge, publisher, ros, saver, recorder } = self;
        let mut all: Vec<&mut dyn Subscriber> = Vec::new();
        all.extend(bridge.as_mut().map(|bridge| bridge as &mut dyn Subscriber));
        all.extend(publisher.as_mut().map(|publisher| publisher as &mut dyn Subscriber));
        all.extend(ros.as_mut().map(|ros| ros as &mut dyn Subscriber));
        all.extend(saver.as_mut().map(|saver| saver as &mut dyn Subscriber));
        all.extend(recorder.as_mut().map(|recorder| recorder as &mut dyn Subscriber));
        all
    }

    /// The run is over: what waits is sent and written.
    pub fn finish(self) -> OutputFigures {
        let Self { bridge, publisher, ros, saver, recorder } = self;
        let autopilot = bridge.and_then(Bridge::stop);
        let recording = recorder.map(Recorder::finish);
        if let Some(publisher) = publisher {
            publisher.stop();
        }
        if let Some(ros) = ros {
            ros.stop();
        }
        if let Some(saver) = saver {
            saver.finish();
        }
        OutputFigures { autopilot, recording }
    }
}
