//! Surroundings under a condition: usual, repeated, bare or real.

/// Change of a scene.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Surroundings {
    /// It stays.
    #[default]
    Usual,
    /// One pattern on everything, which repeats itself.
    Repeated {
        /// Period at a distance of 3 m, px of the preset `sim` at full size.
        period_px: f64,
    },
    /// Plain walls without furniture.
    Bare {
        /// Dark spots in a view.
        spots: f64,
    },
    /// A hall of machines, a room of mats: surfaces of all tones, plain or with mostly weak patterns, some of which mirror the lamps.
    Real,
}
