//! Distance between the poses of a relative error.

use serde::Serialize;

/// Distance between the poses of a relative error.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Delta {
    /// Poses.
    Frames(usize),
    /// Metres of path.
    Metres(f64),
    /// Seconds.
    Seconds(f64),
}

impl std::fmt::Display for Delta {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Frames(n) => write!(f, "{n} frames"),
            Self::Metres(d) => write!(f, "{d} m"),
            Self::Seconds(t) => write!(f, "{t} s"),
        }
    }
}
