//! Rule or recorded order: what decides when an estimate takes effect.

/// Time at which an estimate corrects the odometry, and the results of a frame take effect in the map.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Effect {
    /// A fixed time, or number of frames, after it was measured.
    ByRule,
    /// On an order.
    ByOrder,
}
