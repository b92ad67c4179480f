//! Alignment of a patch by inverse composition (Baker and Matthews 2004), translation only.
//!
//! The residual is taken between zero-mean patches of equal norm, so a gain and an offset of the intensity
//! (exposure) do not matter. With the template `T` (zero mean, `|T|^2 = E`), its gradient `J` and the
//! current patch `I`, gain and offset are eliminated by projecting `J` onto the complement of `1` and `T`:
//!
//! `J' = J - mean(J) - T (T . J) / E`,  `r = I sqrt(E) / |I - mean(I)| - T`,  `delta = (J'^T J')^-1 J'^T r`.
//!
//! Since `J'` is orthogonal to both, `J'^T r` is `J'^T I` up to the gain. Neither `J'` nor `r` is ever written
//! down: with `s = J^T 1`, `c = J^T T` and `N` pixels,
//! `J'^T J' = J^T J - s s^T / N - c c^T / E` and `J'^T I = J^T I - s mean(I) - c (T . I) / E`,
//! which one pass over the sampled patch gives.

use crate::image::Plane;
use crate::image::patch::{AREA, FRAMED, Patch, sample_patch, split_framed, sums};
use nalgebra::{Matrix2, Vector2};
use plumbline_config::Portable;

/// Least standard deviation of a patch that can be aligned, grey levels: below it there is only rounding.
const MIN_CONTRAST: f32 = 0.7;
/// Least lesser eigenvalue of `J'^T J' / AREA`, squared grey levels per px².
const MIN_STIFFNESS: f32 = 0.15;

/// Alignment of two patches, with its agreement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Alignment {
    /// Centre of the patch in the current image, px of its level.
    pub px: Vector2<f32>,
    /// Zero-mean normalized cross-correlation, -1 to 1.
    pub zncc: f32,
    /// Root mean square of the residual in grey levels of the template.
    pub rms: f32,
    /// Length of the last step, px.
    pub last_step_px: f32,
}

/// Limits at which the alignment stops.
#[derive(Clone, Copy, Debug)]
pub struct AlignLimits {
    /// Gauss-Newton steps at most.
    pub max_iterations: usize,
    /// A step below this ends the alignment, px.
    pub tolerance_px: f32,
    /// Distance from the start at which the alignment counts as lost, px.
    pub max_move_px: f32,
}

/// Sums over a sampled patch that the normalisation needs.
#[derive(Clone, Copy, Debug)]
pub(super) struct Moments {
    /// `sqrt(E) / |I - mean(I)|`: the gain from the current patch to the template.
    pub gain: f32,
    /// Zero-mean normalized cross-correlation with the template.
    pub zncc: f32,
}

impl Moments {
    /// From `sum(I)`, `sum(I^2)` and `T . I`; `None` for a patch without contrast.
    pub(super) fn new(sum: f32, square: f32, correlation: f32, energy: f32) -> Option<Self> {
        let variation = square - sum * sum * (1.0 / AREA as f32);
        // Written so that a NaN fails.
        let textured = variation > MIN_CONTRAST * MIN_CONTRAST * AREA as f32;
        textured.then(|| {
            let gain = (energy / variation).sqrt();
            Self { gain, zncc: correlation * gain / energy }
        })
    }
}

/// A patch prepared for alignment by translation.
#[derive(Clone, Copy, Debug)]
pub struct TranslationTemplate {
    intensity: Patch,
    gradient_x: Patch,
    gradient_y: Patch,
    /// `J^T 1`.
    column_sums: Vector2<f32>,
    /// `J^T T`.
    correlations: Vector2<f32>,
    /// Mean intensity.
    pub(super) mean: f32,
    energy: f32,
    inverse_hessian: Matrix2<f32>,
}

impl TranslationTemplate {
    /// A template of nothing, to be filled by [`Self::prepare`].
    #[must_use]
    pub const fn empty() -> Self {
        Self {
            intensity: Patch::ZERO,
            gradient_x: Patch::ZERO,
            gradient_y: Patch::ZERO,
            column_sums: Vector2::new(0.0, 0.0),
            correlations: Vector2::new(0.0, 0.0),
            mean: 0.0,
            energy: 0.0,
            inverse_hessian: Matrix2::new(0.0, 0.0, 0.0, 0.0),
        }
    }

    /// Prepares a patch given with its rim, in place: a template is too large to be moved for each patch. `false`, and of no
    /// use, without texture in both directions.
    #[must_use]
    pub fn prepare(&mut self, framed: &[[f32; FRAMED]; FRAMED]) -> bool {
        let Self { intensity, gradient_x, gradient_y, .. } = self;
        split_framed(framed, intensity, [gradient_x, gradient_y]);
        self.mean = intensity.centre();
        let energy = intensity.dot(intensity);
        if energy < MIN_CONTRAST * MIN_CONTRAST * AREA as f32 {
            return false;
        }
        let column_sums = Vector2::new(gradient_x.sum(), gradient_y.sum());
        let [correlation_x, correlation_y, xx, xy, yy] = products(intensity, gradient_x, gradient_y);
        let correlations = Vector2::new(correlation_x, correlation_y);
        let hessian = Matrix2::new(xx, xy, xy, yy)
            - column_sums * column_sums.transpose() / AREA as f32
            - correlations * correlations.transpose() / energy;
        let (xx, xy, yy) = (hessian[(0, 0)], hessian[(0, 1)], hessian[(1, 1)]);
        let lesser = 0.5 * ((xx + yy) - ((xx - yy) * (xx - yy) + 4.0 * xy * xy).sqrt());
        if lesser < MIN_STIFFNESS * AREA as f32 {
            return false;
        }
        let determinant = xx * yy - xy * xy;
        self.inverse_hessian = Matrix2::new(yy, -xy, -xy, xx) / determinant;
        (self.column_sums, self.correlations, self.energy) = (column_sums, correlations, energy);
        true
    }

    /// Finds the patch in `plane`, starting at `start`; `None` when it leaves the plane, runs away or meets
    /// a patch without contrast.
    #[must_use]
    pub fn align(&self, plane: &Plane<'_>, start: &Vector2<f32>, limits: &AlignLimits) -> Option<Alignment> {
        let mut out = Alignment { px: *start, zncc: -1.0, rms: f32::MAX, last_step_px: f32::MAX };
        let mut current = Patch::ZERO;
        for _ in 0..limits.max_iterations {
            if !sample_patch(plane, &out.px, self.mean, &mut current) {
                return None;
            }
            let [sum, square, x, y, correlation] = self.sums(&current);
            let moments = Moments::new(sum, square, correlation, self.energy)?;
            let projection = Vector2::new(x, y)
                - self.column_sums * (sum / AREA as f32)
                - self.correlations * (correlation / self.energy);
            let step = self.inverse_hessian * projection * moments.gain;
            out.px -= step;
            out.zncc = moments.zncc;
            if (out.px - start).norm_squared() > limits.max_move_px * limits.max_move_px {
                return None;
            }
            out.last_step_px = step.norm();
            if out.last_step_px < limits.tolerance_px {
                break;
            }
        }
        // The residual that belongs to a correlation: `|r|^2 = 2 E (1 - zncc)`.
        out.rms = (2.0 * self.energy * (1.0 - out.zncc).at_least(0.0) / AREA as f32).sqrt();
        Some(out)
    }

    /// Agreement with the patch at `px` as it is.
    #[must_use]
    pub fn zncc_at(&self, plane: &Plane<'_>, px: &Vector2<f32>) -> Option<f32> {
        let mut current = Patch::ZERO;
        sample_patch(plane, px, self.mean, &mut current).then_some(())?;
        self.zncc(&current)
    }

    /// Agreement with a patch less the template's mean.
    pub(super) fn zncc(&self, centred: &Patch) -> Option<f32> {
        let [sum, square, correlation] = agreement(centred, &self.intensity);
        Moments::new(sum, square, correlation, self.energy).map(|moments| moments.zncc)
    }

    /// Sums over the current patch `v`, less the template's mean: `v`, `v²`, `v gx`, `v gy`, `v T`.
    #[inline(never)]
    fn sums(&self, current: &Patch) -> [f32; 5] {
        sums(|i| {
            // Without the template's mean the sums are small and so exact.
            let v = current.0[i];
            [v, v * v, v * self.gradient_x.0[i], v * self.gradient_y.0[i], v * self.intensity.0[i]]
        })
    }
}

/// Sums over a patch `v` and a template `T`: `v`, `v²`, `v T`.
#[inline(never)]
pub(super) fn agreement(v: &Patch, intensity: &Patch) -> [f32; 3] {
    sums(|i| [v.0[i], v.0[i] * v.0[i], v.0[i] * intensity.0[i]])
}

/// Sums of `T gx`, `T gy`, `gx²`, `gx gy`, `gy²`.
#[inline(never)]
fn products(intensity: &Patch, gx: &Patch, gy: &Patch) -> [f32; 5] {
    sums(|i| {
        let (t, x, y) = (intensity.0[i], gx.0[i], gy.0[i]);
        [t * x, t * y, x * x, x * y, y * y]
    })
}
