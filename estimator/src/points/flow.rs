//! Pyramidal optical flow of a patch (Lucas and Kanade 1981; Bouguet 2000) by inverse composition.
//!
//! The patch around a point of one image is found in another, from the coarsest level to the finest. A known
//! 2x2 warp (of the predicted rotation) is applied once to the sampling of the template, so that the current
//! image is always sampled upright.

use super::align::{AlignLimits, Alignment, TranslationTemplate};
use crate::image::Pyramid;
use crate::image::patch::{FRAMED, sample_upright, sample_warped};
use nalgebra::{Matrix2, Vector2};

/// Largest entry of `warp - 1` that leaves the patch as it is: 0.03 px at its edge.
const NEGLIGIBLE_WARP: f32 = 0.005;
/// Largest move within one level, px of that level: half a patch.
const MAX_MOVE_PX: f32 = 7.0;
/// Steps below this end a level, px of that level (the finest and all others).
const TOLERANCE_PX: (f32, f32) = (0.01, 0.04);
/// Least correlation on a coarse level for its result to be used.
const MIN_COARSE_ZNCC: f32 = 0.6;
/// Overhang of the patch beyond the image on a coarse level, px, at most: replicated pixels move with the
/// frame and not with the scene.
const MAX_OVERHANG_PX: f32 = 1.0;

/// A last step longer than this at full resolution means no convergence, px.
pub(super) const MAX_LAST_STEP_PX: f32 = 0.1;
/// Places closer than this are one, px.
pub(super) const SAME_PLACE_PX: f32 = 2.0;

/// Work limit and levels of the flow of one patch.
#[derive(Clone, Copy, Debug)]
pub struct FlowOptions {
    /// Coarsest level used.
    pub top_level: usize,
    /// Gauss-Newton steps per level.
    pub max_iterations: usize,
}

/// Finds the patch around `from_px` of `from` in `to`. `warp` takes offsets in `from` to offsets in `to`.
/// All positions in pixels of level 0. `None` when the patch is lost: outside the image, no texture, no
/// convergence. Whether the agreement is good enough is for the caller to judge.
#[must_use]
pub fn track_patch(
    (from, from_px): (&Pyramid, &Vector2<f32>),
    (to, guess_px): (&Pyramid, &Vector2<f32>),
    warp: &Matrix2<f32>,
    options: &FlowOptions,
) -> Option<Alignment> {
    let to_from = warp.try_inverse()?;
    let mut px = *guess_px;
    let mut template = TranslationTemplate::empty();
    let top = options.top_level.min(from.level_count() - 1).min(to.level_count() - 1);
    for level in (1..=top).rev() {
        let scale = 1.0 / (1u32 << level) as f32;
        let limits = AlignLimits {
            max_iterations: options.max_iterations,
            tolerance_px: TOLERANCE_PX.1,
            max_move_px: MAX_MOVE_PX,
        };
        if !is_inside(from, level, &(from_px * scale)) || !is_inside(to, level, &(px * scale)) {
            continue;
        }
        if !prepare_at(from, level, &(from_px * scale), &to_from, &mut template) {
            continue;
        }
        // A coarse level that fails is left out: a finer one may still find the patch from the guess.
        let found = template.align(&to.plane(level), &(px * scale), &limits);
        if let Some(found) = found.filter(|f| f.zncc >= MIN_COARSE_ZNCC) {
            px = found.px / scale;
        }
    }
    let limits = AlignLimits {
        max_iterations: options.max_iterations,
        tolerance_px: TOLERANCE_PX.0,
        max_move_px: MAX_MOVE_PX,
    };
    prepare_at(from, 0, from_px, &to_from, &mut template).then_some(())?;
    template.align(&to.plane(0), &px, &limits)
}

/// True if the flow of what was `found` in one image by `warp` leads back to where it came from in the other, but for
/// `max_return_px`.
pub(super) fn returns(
    found: (&Pyramid, &Vector2<f32>),
    (from, px): (&Pyramid, &Vector2<f32>),
    warp: &Matrix2<f32>,
    options: &FlowOptions,
    max_return_px: f32,
) -> bool {
    let back = warp.try_inverse().and_then(|back| track_patch(found, (from, px), &back, options));
    back.is_some_and(|back| (back.px - px).norm() <= max_return_px)
}

/// True if a patch at `px` of `level` lies in the image but for [`MAX_OVERHANG_PX`].
fn is_inside(pyramid: &Pyramid, level: usize, px: &Vector2<f32>) -> bool {
    let (width, height) = pyramid.size(level);
    let margin = FRAMED as f32 / 2.0 - MAX_OVERHANG_PX;
    px.x >= margin && px.y >= margin && px.x < width as f32 - margin && px.y < height as f32 - margin
}

/// Makes `template` the one around `px` of `level`, with offsets in the target taken to offsets here by `warp`; `false` when
/// it leaves the image or has no texture.
#[must_use]
pub fn prepare_at(
    from: &Pyramid,
    level: usize,
    px: &Vector2<f32>,
    warp: &Matrix2<f32>,
    template: &mut TranslationTemplate,
) -> bool {
    let mut framed = [[0.0; FRAMED]; FRAMED];
    let plane = from.plane(level);
    let inside = if (warp - Matrix2::identity()).amax() < NEGLIGIBLE_WARP {
        sample_upright(&plane, px, 0.0, &mut framed)
    } else {
        sample_warped(&plane, px, warp, &mut framed)
    };
    inside && template.prepare(&framed)
}
