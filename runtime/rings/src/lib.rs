//! What threads hand to each other, and by which clock: rings that nobody waits for, bells, paces, absolute deadlines,
//! places, and threads that end with their owners.

pub mod event_bell;
pub mod lane;
pub mod pace;
pub mod places;
pub mod ring;
pub mod ticker;
pub mod worker;

/// Clock domain of the sample timestamps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Stamps {
    /// This host's monotonic clock: live sensors. A sample is due when it arrives.
    OfHost,
    /// Clock of a recording or simulation, which is played against the host's clock in a live run.
    #[default]
    Replayed,
}
