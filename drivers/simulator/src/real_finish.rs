//! Finishes as real rooms have them: tones from black to white, and patterns that are mostly weak.
//!
//! Tone, contrast and size are drawn evenly in their logarithms, in ranges that give rendered images the grey levels and gradients
//! of recorded ones: a machine hall, and a room with mats on its walls (EuRoC).

use super::pattern::Material;
use super::world::Finish;
use crate::random::{Draws, Purpose};

/// Albedo of surfaces in a hall and in a room, least and largest; beyond white the sensor saturates.
const HALL_TONES: (f64, f64) = (0.05, 1.8);
const ROOM_TONES: (f64, f64) = (0.3, 1.3);
/// Contrast of a pattern against its tone, least and largest.
const CONTRASTS: (f64, f64) = (0.06, 1.3);
/// Enlargement of a pattern, and size of leaves against the usual ones.
const ZOOMS: (f64, f64) = (1.0, 2.5);
const LEAF_ZOOMS: (f64, f64) = (0.5, 2.5);
/// Share of surfaces with a pattern of leaves, which lie one over the other in all sizes: its statistics are those of natural images.
const LEAVES: f64 = 0.2;
/// Share of surfaces that are almost plain, and their contrast.
const BARE: f64 = 0.45;
const BARE_CONTRAST: f64 = 0.06;
/// From this size on a surface fills much of an image, m². Its tone and contrast are drawn from the middle of their ranges.
const LARGE_M2: f64 = 4.0;
const ANY: [f64; 2] = [0.0, 1.0];
const MIDDLE_TONES: [f64; 2] = [0.3, 0.7];
const MIDDLE_CONTRASTS: [f64; 2] = [0.42, 0.82];
/// Share of glossy surfaces, and brightness of lamps in them against white.
const GLOSSY: f64 = 0.2;
const GLOSS: (f64, f64) = (0.2, 1.0);

/// Draws of finishes.
#[derive(Clone, Debug)]
pub(super) struct RealFinishes {
    draws: Draws,
    tones: (f64, f64),
}

impl RealFinishes {
    /// Finishes of a hall.
    pub(super) fn of_hall(seed: u64) -> Self {
        Self { draws: Draws::new(seed, Purpose::RealFinish, 0), tones: HALL_TONES }
    }

    /// Finishes of a room.
    pub(super) fn of_room(seed: u64) -> Self {
        Self { tones: ROOM_TONES, ..Self::of_hall(seed) }
    }

    /// Draws the finish of a thing of `area_m2` whose usual one is `finish`.
    pub(super) fn draw(&mut self, finish: &Finish, area_m2: f64) -> Finish {
        let is_large = area_m2 > LARGE_M2;
        let [tones, contrasts] = if is_large { [MIDDLE_TONES, MIDDLE_CONTRASTS] } else { [ANY; 2] };
        let tone = self.even_log(self.tones, tones);
        let contrast = self.even_log(CONTRASTS, contrasts);
        let kind = self.draws.unit();
        let (has_leaves, is_bare) = (kind < LEAVES, kind > 1.0 - BARE);
        let (material, zoom) = match has_leaves {
            true => (Material::Posters, self.even_log(LEAF_ZOOMS, ANY)),
            false => (finish.material, finish.zoom * self.even_log(ZOOMS, ANY)),
        };
        let contrast = if is_bare { BARE_CONTRAST } else { contrast };
        let is_glossy = self.draws.unit() < GLOSSY;
        let gloss = if is_glossy { self.draws.range(GLOSS.0, GLOSS.1) as f32 } else { 0.0 };
        let at = |share: f64| (tone * (1.0 + share)) as f32;
        Finish { material, zoom, gloss, ..finish.toned(at(-contrast), at(contrast)) }
    }

    /// Draws evenly in the logarithm, from a part of a range.
    fn even_log(&mut self, (low, high): (f64, f64), [from, to]: [f64; 2]) -> f64 {
        let (low, high) = (libm::log(low), libm::log(high));
        libm::exp(low + self.draws.range(from, to) * (high - low))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_things_have_all_tones_and_large_ones_those_in_between() {
        let finish = Finish::of(Material::Bricks);
        let mut hall = RealFinishes::of_hall(1);
        let mut range = |area_m2| {
            let tones =
                (0..500).map(|_| hall.draw(&finish, area_m2)).map(|f| f64::from(f.dark + f.bright) * 0.5);
            tones.fold((f64::MAX, 0.0_f64), |(low, high), tone| (low.min(tone), high.max(tone)))
        };
        let (small, large) = (range(1.0), range(10.0));
        assert!(small.0 < 0.06 && small.1 > 1.6, "{small:?}");
        assert!(large.0 > 0.14 && large.1 < 0.65, "{large:?}");
    }
}
