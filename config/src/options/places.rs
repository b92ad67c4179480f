//! Options of places: recognition, loops, the map in flight.

use plumbline_keys::keys;
use serde::{Deserialize, Serialize};

/// Recognition of places and the map that a flight makes.
#[keys]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlacesConfig {
    /// Recognize places, and build a map.
    #[key(default = true)]
    pub enabled: bool,
    /// Largest number of keyframes in the map, 27 kB each. Above it, the most redundant keyframe is dropped.
    #[key(default = 1000, range = 16..=20_000)]
    pub max_keyframes: usize,
    /// Largest number of features of a keyframe.
    #[key(default = 400, range = 50..=2000, experiment)]
    pub max_features: usize,
    /// Smallest distance between successive keyframes, m; a rotation of 30 degrees counts as one metre.
    #[key(default = 0.2, range = 0.0..=10.0, unit = METRES, experiment)]
    pub spacing_m: f64,
}
