//! Subjects of a sweep's cells.

use plumbline_config::ValidConfig;
use plumbline_drivers::{BagTopics, StampedPose};
use plumbline_flight::flight::{Cut, Flight, FlightError, open_recording, open_simulation};
use plumbline_simulator::InjectedFault;
use plumbline_simulator::Scenario;
use std::path::PathBuf;
use std::sync::Arc;

/// Subject of a flight.
#[derive(Clone, Debug)]
pub enum Subject {
    /// A EuRoC data set, a flight log or a ROS bag.
    Recorded {
        /// Its place.
        path: PathBuf,
    },
    /// A simulated flight.
    Simulated {
        /// Name: the argument that it was made of.
        name: String,
        /// Simulated flight; each seed of the sweep replaces its own.
        scenario: Box<Scenario>,
        /// The estimator believes the cameras turned by this angle, degrees.
        extrinsics_error_deg: f64,
        /// Faults that are injected, with the seed of the flight.
        faults: Vec<InjectedFault>,
    },
}

impl Subject {
    /// Opens it, ready to run; a simulated flight with `seed` in place of its own, any from `start_s` on where that is given.
    ///
    /// # Errors
    /// When it cannot be read or simulated.
    pub fn open(
        &self,
        common: &Common,
        seed: Option<u64>,
        start_s: Option<f64>,
    ) -> Result<Flight, FlightError> {
        let Common { config, topics, mono, cache, .. } = common;
        match self {
            Self::Recorded { path } => {
                let cut = start_s.map(|start_s| Cut { frames: None, seconds: start_s..f64::INFINITY });
                let cut = cut.unwrap_or_else(|| None.into());
                open_recording(path, config.clone(), topics, cut, *mono)
            }
            Self::Simulated { scenario, extrinsics_error_deg, faults, .. } => {
                let (seed, start_s) = (seed.unwrap_or(scenario.seed), start_s.unwrap_or(scenario.start_s));
                let scenario = Scenario { seed, start_s, ..(**scenario).clone() };
                open_simulation(config.clone(), &scenario, *mono, *extrinsics_error_deg, cache.as_deref())?
                    .with_injected(faults, seed)
            }
        }
    }

    /// Its name.
    #[must_use]
    pub fn name(&self) -> String {
        match self {
            Self::Recorded { path } => path.display().to_string(),
            Self::Simulated { name, .. } => name.clone(),
        }
    }
}

/// Ground truth that was read from a file.
#[derive(Clone, Debug)]
pub struct NamedTruth {
    /// The file.
    pub path: PathBuf,
    /// Its poses.
    pub poses: Vec<StampedPose>,
}

/// Common part of all cells.
#[derive(Clone, Debug, Default)]
pub struct Common {
    /// The configuration; without one that of the data set, of the log, or the preset `sim`.
    pub config: Option<ValidConfig>,
    /// Ground truth in place of those of the data sets.
    pub truth: Option<Arc<NamedTruth>>,
    /// Topics of the recordings that are bags.
    pub topics: BagTopics,
    /// The left camera alone.
    pub mono: bool,
    /// Folder of rendered frames.
    pub cache: Option<PathBuf>,
}
