//! Options of places: recognition, loops, the map in flight.

use serde::{Deserialize, Serialize};

/// Recognition of places and the map that a flight makes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PlacesConfig {
    /// Whether places are recognized, and a map is made, in flight.
    pub enabled: bool,
    /// Keyframes that the map holds; beyond, those go whose view others cover best. 27 kB each.
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
