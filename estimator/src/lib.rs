//! Visual-inertial estimation as a pure function of configuration and ordered inputs.
//!
//! No I/O, no clock, no threads of its own accord: samples and images in, estimates out. A reader starts
//! at [`facade`]; the modules follow the flow of the data.

pub mod estimate;
pub mod facade;
pub mod front_end;
pub mod geometry;
pub mod image;
pub mod inertial;
pub mod initial;
pub mod lines;
pub mod odometry;
pub mod points;
pub mod propagator;
pub mod window;
pub mod work_budget;

pub use estimate::{
    Estimate, FrameFigures, FrameInput, HealthBits, NavCovariance, Odometry, Stage, StageProbe, TrackingState,
};
pub use facade::{Estimator, ImuAdmission, ResetKind};
pub use front_end::{Feedback, FrontEnd, Tracked};
pub use odometry::Odometer;
pub use propagator::Propagator;
pub use window::snapshot::MapSnapshot;
pub use work_budget::{Fork, InTurn, WorkBudget};
