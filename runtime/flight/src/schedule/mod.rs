//! Real-time execution of a run: the task table, priorities and locked memory, absolute deadlines, rings between threads, the
//! degradation ladder and the watchdog.
//!
//! Nothing here knows what the tasks compute; [`crate::pipeline`] puts both together.

pub mod bare_timer;
pub mod host;
pub mod ladder;
pub mod pool;
pub mod queue;
#[cfg(feature = "sabotage")]
pub mod sabotage;
pub mod supervisor;
pub mod tasks;
pub mod times;
pub mod watchdog;

pub use plumbline_rings::{event_bell, lane, pace, ring, ticker, worker};
