//! From two sensor streams to estimates and odometry: the same answers in virtual time and live.
//!
//! A flight is a machine ([`machine`]) that is driven by orders. In virtual time a rule makes them ([`virtual_time`]):
//! readings up to the time that a frame needs, then the frame; its estimate corrects the odometry just before the first
//! reading at or after its time plus [`CORRECTION_DELAY_NS`]. [`live`] runs the stages of the machine ([`stages`],
//! [`tick`], [`places`]) against the clock on threads of their own; what the clock decides there is written down as orders
//! ([`plumbline_record::orders`]), which a re-execution follows ([`crate::log::execute`]). When nothing had to be refused
//! or came late, all give the same bits.

#![deny(clippy::disallowed_methods)]

pub mod clock;
mod control;
pub(crate) mod effect;
pub mod figures;
pub mod instants;
pub mod listener;
mod live;
pub(crate) mod machine;
mod map_saves;
pub mod places;
mod stages;
pub(crate) mod team;
mod tick;
mod virtual_time;

pub use control::Control;
pub use instants::{InstantRequest, Instants};
pub use live::LiveFigures;
pub use map_saves::{MapRequest, MapSaveResult, MapSaves};
pub use tick::CORRECTION_DELAY_NS;

pub use plumbline_rings::Stamps;

use crate::schedule::host::Host;
use figures::Figures;
use listener::Subscriber;
use live::Live;
use places::{PlacesFigures, PlacesStage};
use plumbline_config::ValidConfig;
use plumbline_drivers::{DriverError, Faults, ImuSource, StereoSource};
use plumbline_estimator::places::{Mapper, PlaceMap};
use stages::WindowStage;
use std::sync::Arc;
use team::Team;

/// Options of a run.
#[derive(Clone, Copy, Debug)]
pub struct RunOptions {
    /// Multiple of real time; `None` for as fast as it goes.
    pub speed: Option<f64>,
    /// 1 does everything in turn, 2 decodes or renders ahead, more share the work on a frame.
    pub threads: usize,
}

/// The sensors of a run, and what is known beforehand.
pub struct Streams {
    /// Inertial samples.
    pub imu: Box<dyn ImuSource>,
    /// Frames.
    pub stereo: Box<dyn StereoSource>,
    /// Keyframes of a map that the flight goes on with, of the limits of [`Mapper::limits`].
    pub map: Option<PlaceMap>,
    /// Clock domain of the sample timestamps.
    pub stamps: Stamps,
    /// First value of the reset counter.
    pub first_reset_counter: u32,
}

/// The map at the end of a run.
pub struct PlacesEnd {
    /// Keyframes, graph, and the way to correct a trajectory.
    pub mapper: Mapper,
    /// Times and counts.
    pub figures: PlacesFigures,
}

impl PlacesEnd {
    fn new(stage: PlacesStage, window: &WindowStage, passed_over: u64) -> Self {
        let (mapper, times_ms) = stage.into_end();
        let figures = window.map().map(|map| map.figures(times_ms, passed_over, &mapper));
        Self { figures: figures.unwrap_or_default(), mapper }
    }
}

/// Outcome of a run.
pub struct RunOutcome {
    /// Times and counts.
    pub figures: Figures,
    /// SHA-256 over the bits of all estimates.
    pub estimate_digest: String,
    /// SHA-256 over the bits of all odometry.
    pub odometry_digest: String,
    /// Faults survived by the drivers.
    pub faults: DriverFaults,
    /// The map; `None` where places are switched off.
    pub places: Option<PlacesEnd>,
    /// Figures of a live run only.
    pub live: Option<LiveFigures>,
}

/// Faults survived by the drivers of a run.
#[derive(Clone, Copy, Debug, Default, serde::Serialize)]
pub struct DriverFaults {
    /// The inertial driver.
    pub imu: Faults,
    /// The driver of the cameras.
    pub cameras: Faults,
}

/// Reason why a run ended early.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// A driver cannot go on.
    #[error(transparent)]
    Driver(#[from] DriverError),
    /// The system refused a thread.
    #[error("cannot start a thread: {0}; check the limits on threads and memory")]
    Thread(String),
    /// A task of the run ended by a fault of its own.
    #[error("the task {0} ended by a fault of its own; please report this with the flight's log")]
    Fault(&'static str),
    /// A task of the run stands still.
    #[error("the task {0} is hung; please report this with the flight's log")]
    Stalled(&'static str),
}

impl RunError {
    /// True if the same run, started again, may succeed: the fault lies in the program, and not in its input.
    pub fn is_fault(&self) -> bool {
        matches!(self, Self::Fault(_) | Self::Stalled(_))
    }
}

/// Runs both streams to their end, or until `control` says so: live with a speed, else in virtual time. The listeners of
/// `subscriber` are told of everything that passes.
///
/// # Errors
/// When a driver cannot go on, or a thread cannot be had.
pub fn run(
    config: &ValidConfig,
    mut streams: Streams,
    options: &RunOptions,
    control: &Control,
    subscriber: &mut dyn Subscriber,
) -> Result<RunOutcome, RunError> {
    let refused = |error: rayon_core::ThreadPoolBuildError| RunError::Thread(error.to_string());
    let helpers = options.threads.saturating_sub(1);
    match options.speed {
        None => {
            let team = Team::new(helpers, || {}).map_err(refused)?;
            virtual_time::run(config, streams, options, control, &team, subscriber)
        }
        Some(speed) => {
            let host = Arc::new(Host::new(&config.runtime));
            let instants = control.instants().cloned();
            Live::new(config, speed, (helpers, host), (streams.map.take(), instants), subscriber)?
                .run(streams, control)
        }
    }
}
