//! Opening of a replay: a recording or a simulated flight, with the options of `plumbline replay`.

use crate::config::config_of;
use crate::errors::{ArgumentError, ArgumentTypeError, of_data, of_flight};
use plumbline_drivers::BagTopics;
use plumbline_flight::flight::{
    Cut, Flight, FlightError, Truth, open_recording, open_simulation, with_overrides,
};
use plumbline_lab::evaluate::load_trajectory;
use plumbline_simulator::{FlightPath, Scenario, Scene, USUAL_DURATION_S};
use pyo3::prelude::*;
use std::path::PathBuf;
use std::str::FromStr;

/// Options, as `plumbline.flights` puts them together.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct OpeningOptions {
    set: Vec<String>,
    start: f64,
    duration: Option<f64>,
    frames: Option<(usize, usize)>,
    mono: bool,
    lines: bool,
    loops: bool,
    truth: Option<PathBuf>,
    topics: [Option<String>; 4],
    path: String,
    seed: u64,
    scale: f64,
    laps: u32,
    conditions: Vec<String>,
    imu_errors: Vec<String>,
}

impl OpeningOptions {
    /// Opens `dataset` with `config`, or with the one that goes with it.
    ///
    /// # Errors
    /// When it cannot be used.
    pub fn open(&self, dataset: &Bound<'_, PyAny>, config: Option<&Bound<'_, PyAny>>) -> PyResult<Flight> {
        let py = dataset.py();
        let config = config.map(config_of).transpose()?;
        let path: PathBuf = dataset.extract().map_err(|_| {
            let message = "dataset: expected a path, or the name of a simulated flight such as 'sim:room'";
            ArgumentTypeError::new_err(message)
        })?;
        let scene = path.to_str().and_then(|name| name.strip_prefix("sim:"));
        let opened = match scene {
            Some(scene) => {
                let scenario = self.scenario(scene)?;
                py.detach(|| open_simulation(config, &scenario, self.mono, 0.0, None))
            }
            None => {
                let seconds =
                    self.start..self.duration.map_or(f64::INFINITY, |duration| self.start + duration);
                let cut = Cut { frames: self.frames.map(|(from, to)| from..to), seconds };
                let [left, right, imu, accel] = self.topics.clone();
                let topics = BagTopics { left, right, imu, accel };
                py.detach(|| open_recording(&path, config, &topics, cut, self.mono))
            }
        };
        let mut flight = opened.map_err(|error| of_flight(py, &error))?;
        flight.config = self.changed(&flight).map_err(|error| of_flight(py, &error))?;
        if let Some(file) = &self.truth {
            flight.truth = Truth::of_poses(&load_trajectory(file).map_err(|error| of_data(&error))?);
        }
        Ok(flight)
    }

    /// Configuration with what the options change of it.
    fn changed(&self, flight: &Flight) -> Result<plumbline_config::ValidConfig, FlightError> {
        let config = with_overrides(&flight.config, &self.set)?;
        Ok(config.with("the options lines and loops", |config| {
            config.estimator.lines.enabled &= self.lines;
            config.estimator.places.enabled &= self.loops;
        })?)
    }

    fn scenario(&self, scene: &str) -> PyResult<Scenario> {
        let scene = Scene::named(scene).ok_or_else(|| {
            ArgumentError::new_err(format!("no scene '{scene}': choose room, hall, low-texture or far"))
        })?;
        let mut scenario = Scenario {
            scene,
            path: FlightPath::named(&self.path),
            start_s: self.start,
            duration_s: self.duration.unwrap_or(USUAL_DURATION_S),
            laps: self.laps,
            seed: self.seed,
            resolution_scale: self.scale,
            ..Scenario::default()
        };
        for error in parsed::<plumbline_simulator::ImuError>("imu_errors", &self.imu_errors)? {
            error.apply(&mut scenario);
        }
        for condition in parsed::<plumbline_simulator::SimulatedCondition>("conditions", &self.conditions)? {
            condition.apply(&mut scenario);
        }
        Ok(scenario)
    }
}

fn parsed<T: FromStr<Err = String>>(name: &str, texts: &[String]) -> PyResult<Vec<T>> {
    let parse = |text: &String| {
        text.parse().map_err(|reason| ArgumentError::new_err(format!("{name}: '{text}': {reason}")))
    };
    texts.iter().map(parse).collect()
}
