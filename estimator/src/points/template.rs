//! The reference patch of a track: what keeps its position from drifting.
//!
//! Frame-to-frame flow adds a small error to a position in every frame, and the sum walks away at random.
//! Therefore each track keeps the patch around its corner as it was first seen, and every position is
//! refined against it, with an affine warp that follows the change of viewpoint (Shi and Tomasi 1994) and
//! gain and offset of the intensity taken out as in [`super::align`]. Both cameras are aligned to the same
//! reference, so that left and right pixel belong to the same point of the surface.
//!
//! With the warped reference `T(d) = Ref(A^-1 d)` on an upright grid `d`, the step `(dt, dA)` minimises
//! `|I(p + d) - T(d + dt + dA d)|^2 + lambda |dA|^2`. Then `p <- p - (1 + dA)^-1 dt` at once, and
//! `A <- (1 + dA)^-1 A` when the iterations are over.

use super::affine_sums::{AffineMatrix, AffineVector, UNKNOWNS, gram, products};
use super::align::{Moments, agreement};
use crate::image::patch::{AREA, FRAMED, HALF, Patch, sample_patch, sample_warped, split_framed};
use crate::image::{Plane, Pyramid};
use nalgebra::{Matrix2, Vector2};
use plumbline_config::Portable;

/// Side of the stored patch, px: a patch at an angle of 45 degrees and twice the size.
const STORED_SIDE: usize = 40;
/// Index of the stored pixel nearest to the centre.
const STORED_CENTRE: usize = 19;
/// Weight of the prior that the warp is the predicted one: `(noise / change)²` with an intensity noise of
/// 3 grey levels and a change between frames of 0.3 px at the edge of the patch.
const WARP_PRIOR: f32 = 100.0;
/// A warp that changed by more than this at the edge of the patch, px, asks for a new linearisation.
const RELINEARIZE_PX: f32 = 0.5;
/// Steps of the position below this end the refinement, px.
const TOLERANCE_PX: f32 = 0.01;
/// The reference is of no use when an area has grown or shrunk by more than this factor.
const MAX_AREA_CHANGE: f32 = 3.0;
/// Largest ratio between the warp's extent in one direction and in another.
const MAX_STRETCH: f32 = 2.2;
/// Least noise of a pixel, grey levels: rounding and interpolation.
const MIN_NOISE: f32 = 1.0;
/// Least energy of the template: as in [`super::align`], 0.7 grey levels.
const MIN_ENERGY: f32 = 0.49 * AREA as f32;

/// Result of a refinement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Refinement {
    /// Position in the current image, px.
    pub px: Vector2<f32>,
    /// Warp from offsets in the reference to offsets in the current image.
    pub warp: Matrix2<f32>,
    /// Zero-mean normalized cross-correlation, the last warp step allowed for.
    pub zncc: f32,
    /// Root mean square residual, grey levels of the reference.
    pub rms: f32,
    /// Length of the last step, px.
    pub last_step_px: f32,
    /// Covariance of the position by the curvature of the template and the residual, px².
    pub covariance_px2: Matrix2<f32>,
}

/// Work allowed for one refinement.
#[derive(Clone, Copy, Debug)]
pub struct RefineLimits {
    /// Gauss-Newton steps per linearisation.
    pub max_iterations: usize,
    /// Linearisations of the warp.
    pub max_linearizations: usize,
    /// Largest distance from the start, px.
    pub max_move_px: f32,
    /// Largest difference of an entry of the warp from where it started: with six unknowns and gain and offset
    /// free, one smooth patch can otherwise be bent into another.
    pub max_warp_change: f32,
}

/// The patch of a track as it was first seen.
#[derive(Clone, Copy, Debug)]
pub struct ReferencePatch {
    pixels: [u8; STORED_SIDE * STORED_SIDE],
    /// Place of the point between the stored pixels, from [`STORED_CENTRE`], px.
    fraction: Vector2<f32>,
}

impl ReferencePatch {
    /// A patch without content, to be filled by [`Self::store`].
    #[must_use]
    pub const fn empty() -> Self {
        Self { pixels: [0; STORED_SIDE * STORED_SIDE], fraction: Vector2::new(0.0, 0.0) }
    }

    /// Stores the surroundings of `px`; `false` when the point lies too far outside the image.
    pub fn store(&mut self, pyramid: &Pyramid, px: &Vector2<f32>) -> bool {
        let plane = pyramid.plane(0);
        let corner = px.map(|v| v.floor() - STORED_CENTRE as f32 + plane.origin as f32);
        let side = STORED_SIDE as f32;
        let inside = px.x.is_finite()
            && px.y.is_finite()
            && corner.x > -side
            && corner.y > -side
            && corner.x < plane.columns as f32
            && corner.y < plane.rows as f32;
        if !inside {
            return false;
        }
        self.fraction = px.map(|v| v - v.floor());
        let clamp = |v: isize, size: usize| v.clamp(0, size as isize - 1) as usize;
        for (r, stored) in self.pixels.chunks_exact_mut(STORED_SIDE).enumerate() {
            let row = clamp(corner.y as isize + r as isize, plane.rows);
            let row = &plane.pixels[row * plane.columns..][..plane.columns];
            if let Some(whole) = row.get(corner.x as usize..).and_then(<[u8]>::first_chunk::<STORED_SIDE>)
                && corner.x >= 0.0
            {
                stored.copy_from_slice(whole);
                continue;
            }
            for (c, pixel) in stored.iter_mut().enumerate() {
                *pixel = row[clamp(corner.x as isize + c as isize, plane.columns)];
            }
        }
        true
    }

    fn plane(&self) -> Plane<'_> {
        Plane { pixels: &self.pixels, columns: STORED_SIDE, rows: STORED_SIDE, origin: STORED_CENTRE }
    }

    /// Refines the position `start` and the warp `warp` (reference to current offsets) in the full-size
    /// image of `pyramid`; `None` when the patch is lost. Whether the agreement is good enough is for the
    /// caller to judge.
    #[must_use]
    pub fn refine(
        &self,
        pyramid: &Pyramid,
        start: &Vector2<f32>,
        warp: &Matrix2<f32>,
        limits: &RefineLimits,
    ) -> Option<Refinement> {
        let plane = pyramid.plane(0);
        let mut out = Refinement {
            px: *start,
            warp: *warp,
            zncc: -1.0,
            rms: f32::MAX,
            last_step_px: f32::MAX,
            covariance_px2: Matrix2::zeros(),
        };
        let mut template = AffineTemplate::empty();
        for _ in 0..limits.max_linearizations {
            template.prepare(&self.plane(), &self.fraction, &out.warp)?;
            let change = template.align(&plane, start, &mut out, limits)?;
            if change.amax() * HALF < RELINEARIZE_PX {
                break;
            }
        }
        let near = (out.warp - warp).amax() <= limits.max_warp_change;
        (near && is_sound(&out.warp)).then_some(out)
    }
}

/// True if a change of viewpoint may cause the warp, and the stored patch can serve it.
fn is_sound(warp: &Matrix2<f32>) -> bool {
    let area = warp.determinant();
    // |A|_F^2 / det = s + 1/s for singular values in the ratio s.
    let stretch = warp.norm_squared() / area;
    area > 1.0 / MAX_AREA_CHANGE && area < MAX_AREA_CHANGE && stretch < MAX_STRETCH + 1.0 / MAX_STRETCH
}

/// The reference under a warp, prepared for alignment.
struct AffineTemplate {
    intensity: Patch,
    gradient: [Patch; 2],
    /// `J^T 1`.
    column_sums: AffineVector,
    /// `J^T T`.
    correlations: AffineVector,
    mean: f32,
    energy: f32,
    inverse_hessian: AffineMatrix,
}

impl AffineTemplate {
    fn empty() -> Self {
        Self {
            intensity: Patch::ZERO,
            gradient: [Patch::ZERO; 2],
            column_sums: AffineVector::zeros(),
            correlations: AffineVector::zeros(),
            mean: 0.0,
            energy: 0.0,
            inverse_hessian: AffineMatrix::zeros(),
        }
    }

    /// Prepares the reference in place: a template is too large to be moved for each patch. `None`, and of no use, where it
    /// has no texture or the warp is not sound.
    fn prepare(&mut self, reference: &Plane<'_>, fraction: &Vector2<f32>, warp: &Matrix2<f32>) -> Option<()> {
        /// For sums of gradients without a factor.
        const ONE: Patch = Patch([1.0; AREA]);
        is_sound(warp).then_some(())?;
        let mut framed = [[0.0; FRAMED]; FRAMED];
        sample_warped(reference, fraction, &warp.try_inverse()?, &mut framed).then_some(())?;
        let Self { intensity, gradient: [gx, gy], .. } = self;
        split_framed(&framed, intensity, [gx, gy]);
        self.mean = intensity.centre();
        self.energy = intensity.dot(intensity);
        if self.energy < MIN_ENERGY {
            return None;
        }
        self.column_sums = products(gx, gy, const { &ONE });
        self.correlations = products(gx, gy, intensity);
        let mut hessian = gram(gx, gy);
        hessian -= self.column_sums * self.column_sums.transpose() / AREA as f32;
        hessian -= self.correlations * self.correlations.transpose() / self.energy;
        for i in 2..UNKNOWNS {
            hessian[(i, i)] += WARP_PRIOR;
        }
        self.inverse_hessian = hessian.cholesky()?.inverse();
        Some(())
    }

    /// Iterates the position in `out`; its warp follows at the end. Returns the change of the warp.
    fn align(
        &self,
        plane: &Plane<'_>,
        start: &Vector2<f32>,
        out: &mut Refinement,
        limits: &RefineLimits,
    ) -> Option<Matrix2<f32>> {
        let mut current = Patch::ZERO;
        let mut to_template = Matrix2::identity();
        for _ in 0..limits.max_iterations {
            sample_patch(plane, &out.px, self.mean, &mut current).then_some(())?;
            let (step, zncc) = self.step(&current)?;
            let edge = 1.0 / HALF;
            to_template = Matrix2::identity() + Matrix2::new(step[2], step[3], step[4], step[5]) * edge;
            let move_px = -(to_template.try_inverse()? * Vector2::new(step[0], step[1]));
            out.px += move_px;
            out.zncc = zncc;
            out.last_step_px = move_px.norm();
            // Written so that a NaN fails.
            let near = (out.px - start).norm_squared() <= limits.max_move_px * limits.max_move_px;
            near.then_some(())?;
            if out.last_step_px < TOLERANCE_PX {
                break;
            }
        }
        out.rms = (2.0 * self.energy * (1.0 - out.zncc).at_least(0.0) / AREA as f32).sqrt();
        out.warp = to_template.try_inverse()? * out.warp;
        out.covariance_px2 = self.inverse_hessian.fixed_view::<2, 2>(0, 0)
            * (out.rms * out.rms).at_least(MIN_NOISE * MIN_NOISE);
        Some(to_template - Matrix2::identity())
    }

    /// The Gauss-Newton step from the current patch less the template's mean, and the correlation after the step to first
    /// order: `|r|^2 = 2 E (1 - zncc)` falls by `delta^T J^T r`.
    fn step(&self, centred: &Patch) -> Option<(AffineVector, f32)> {
        let [sum, square, correlation] = agreement(centred, &self.intensity);
        let moments = Moments::new(sum, square, correlation, self.energy)?;
        let projection = products(&self.gradient[0], &self.gradient[1], centred)
            - self.column_sums * (sum / AREA as f32)
            - self.correlations * (correlation / self.energy);
        let gradient = projection * moments.gain;
        let step = self.inverse_hessian * gradient;
        let zncc = moments.zncc + step.dot(&gradient) / (2.0 * self.energy);
        Some((step, zncc.at_most(1.0)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::synthetic::Texture;

    const SIZE: usize = 100;

    fn pyramid_of(
        texture: &Texture,
        warp: Matrix2<f64>,
        shift: Vector2<f64>,
        tone: impl Fn(f64) -> f64,
    ) -> Pyramid {
        let centre = Vector2::new(50.0, 50.0);
        let back = warp.try_inverse().expect("invertible");
        let image = texture.render_through(SIZE, SIZE, |p| centre + back * (p - centre - shift), tone);
        let mut pyramid = Pyramid::new(SIZE, SIZE, 1);
        assert!(pyramid.build(&image.view()));
        pyramid
    }

    const LIMITS: RefineLimits =
        RefineLimits { max_iterations: 8, max_linearizations: 4, max_move_px: 3.0, max_warp_change: 0.2 };

    #[test]
    fn an_affine_change_with_gain_and_offset_is_recovered() {
        for seed in 0..20 {
            let texture = Texture::new(seed);
            let mut reference = ReferencePatch::empty();
            let start = Vector2::new(50.0f32, 50.0);
            assert!(
                reference.store(&pyramid_of(&texture, Matrix2::identity(), Vector2::zeros(), |g| g), &start)
            );
            let truth = Matrix2::new(1.08, 0.05, -0.06, 0.93);
            let shift = Vector2::new(0.6, -0.8);
            let now = pyramid_of(&texture, truth, shift, |g| 20.0 + 0.6 * g);
            let found = reference.refine(&now, &start, &Matrix2::identity(), &LIMITS).expect("found");
            let error = found.px.cast::<f64>() - Vector2::new(50.0, 50.0) - shift;
            assert!(error.norm() < 0.1, "seed {seed}: {error}");
            assert!((found.warp.cast::<f64>() - truth).amax() < 0.04, "{} for {truth}", found.warp);
            assert!(found.zncc > 0.99, "{}", found.zncc);
        }
    }

    #[test]
    fn another_texture_does_not_agree() {
        let mut reference = ReferencePatch::empty();
        let start = Vector2::new(50.0f32, 50.0);
        let still = |seed| pyramid_of(&Texture::new(seed), Matrix2::identity(), Vector2::zeros(), |g| g);
        assert!(reference.store(&still(1), &start));
        for seed in 2..30 {
            let found = reference.refine(&still(seed), &start, &Matrix2::identity(), &LIMITS);
            assert!(found.is_none_or(|f| f.zncc < 0.88), "seed {seed}: {found:?}");
        }
    }

    #[test]
    fn a_point_outside_the_image_is_no_reference() {
        let mut reference = ReferencePatch::empty();
        let pyramid = pyramid_of(&Texture::new(1), Matrix2::identity(), Vector2::zeros(), |g| g);
        assert!(!reference.store(&pyramid, &Vector2::new(-500.0, 3.0)));
        assert!(!reference.store(&pyramid, &Vector2::new(f32::NAN, 3.0)));
        assert!(reference.store(&pyramid, &Vector2::new(1.0, 99.0)));
    }
}
