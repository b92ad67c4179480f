//! Rule or recorded order: what decides when an estimate takes effect.

/// When an estimate corrects the odometry, and what was found with a frame takes effect in the map.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Effect {
    /// A fixed time, or number of frames, after it was measured.
    ByRule,
    /// When an order says so.
    ByOrder,
}
