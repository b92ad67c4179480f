//! Options of places: recognition, loops, the map in flight.

use serde::{Deserialize, Serialize};

/// Recognition of places and the map that a flight makes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PlacesConfig {
    /// Whether places are recognized, and a map is made, in flight.
    pub enabled: bool,
    /// Largest number of keyframes in the map, 27 kB each. Above it, the most redundant keyframe is dropped.
    pub max_keyframes: usize,
    /// Largest number of features of a keyframe.
    pub max_features: usize,
    /// Least difference between the views of successive keyframes, m; a turn of 30 degrees counts as a metre.
    pub spacing_m: f64,
}

impl Default for PlacesConfig {
    fn default() -> Self {
        Self { enabled: true, max_keyframes: 1000, max_features: 400, spacing_m: 0.2 }
    }
}
