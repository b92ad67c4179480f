//! Turn of the camera by corners that look like nothing around them.
//!
//! Where texture repeats, a point with rivals is looked for where the inertial samples put it. Those of a gyroscope that fails put all of
//! them in another place, to be missed, or found in another cell. Corners without rivals are found wherever they are: the turn that most of
//! them agree about is the turn.
//!
//! A place `(x, y)` moves by `A theta + rho B t` if the camera turns by `theta` and is moved by `t` more than predicted; `A` and `B` are
//! the derivatives of `xy / z`, `rho` is the inverse depth.

use heapless::Vec;
use nalgebra::{Matrix2x3, Matrix2x6, Matrix3, Matrix6, Rotation3, Vector2, Vector3, Vector6};
use plumbline_config::Portable;

/// Corners that are asked at most.
pub(super) const MAX_WITNESSES: usize = 64;
/// Fewest that must agree, and their least share of all.
const MIN_AGREEING: usize = 4;
const MIN_SHARE: f64 = 0.6;
/// They agree to this many pixels.
const AGREES_PX: f64 = 0.8;
/// The prediction is another turn if it explains no more of those that agree than this share.
const MOST_PREDICTED: f64 = 0.5;
/// Standard deviations before anything is seen: a turn about each axis, rad, and a way beyond that of the velocity, m.
const TURN_SIGMA_RAD: f64 = 0.1;
const WAY_SIGMA_M: f64 = 3e-3;
/// Standard deviation of a place, px.
const PLACE_SIGMA_PX: f64 = 0.5;

/// Corners that are asked about a turn.
pub(super) type Witnesses = Vec<Witness, MAX_WITNESSES>;

/// Place of a corner in the new image, as predicted and as found.
#[derive(Clone, Copy, Debug)]
pub(super) struct Witness {
    /// Normalized coordinates.
    pub expected: Vector2<f64>,
    pub found: Vector2<f64>,
    /// Inverse depth, 1/m.
    pub rho: f64,
}

/// Turn of a camera beyond the predicted one.
#[derive(Clone, Copy, Debug)]
pub(super) struct FoundTurn {
    /// Takes predicted axes to true ones.
    pub rot_cur_predicted: Rotation3<f64>,
    /// Covariance, rad².
    pub covariance: Matrix3<f64>,
    /// True if the predicted turn is another one.
    pub is_other: bool,
}

impl Witness {
    /// What is left between both, in normalized coordinates, after a small turn, rad.
    fn off(&self, theta: &Vector3<f64>) -> Vector2<f64> {
        self.found - self.expected - self.by_turn() * theta
    }

    /// Derivative of the coordinates by a small turn of the camera's axes.
    fn by_turn(&self) -> Matrix2x3<f64> {
        let (x, y) = (self.expected.x, self.expected.y);
        Matrix2x3::new(-x * y, 1.0 + x * x, -y, -1.0 - y * y, x * y, x)
    }

    /// Derivative of the coordinates by a small turn and a small way.
    fn by_motion(&self) -> Matrix2x6<f64> {
        let (x, y, rho) = (self.expected.x, self.expected.y, self.rho);
        let mut by_motion = Matrix2x6::zeros();
        by_motion.fixed_columns_mut::<3>(0).copy_from(&self.by_turn());
        by_motion.fixed_columns_mut::<3>(3).copy_from(&(Matrix2x3::new(1.0, 0.0, -x, 0.0, 1.0, -y) * rho));
        by_motion
    }

    /// The turn about the axes across the view that explains it alone.
    fn turn_across(&self) -> Vector3<f64> {
        let across = self.by_turn().fixed_columns::<2>(0).try_inverse();
        let turn = across.map_or_else(Vector2::zeros, |across| across * (self.found - self.expected));
        Vector3::new(turn.x, turn.y, 0.0)
    }
}

/// Turn beyond the predicted one of a camera of this focal length, where the way is predicted to `way_sigma_m`; `None` where too few
/// witnesses agree.
pub(super) fn find_turn(witnesses: &Witnesses, focal_px: f64, way_sigma_m: f64) -> Option<FoundTurn> {
    let gate = AGREES_PX / focal_px;
    let agrees = |witness: &&Witness, theta: &Vector3<f64>| witness.off(theta).norm_squared() < gate * gate;
    let count = |theta: &Vector3<f64>| witnesses.iter().filter(|witness| agrees(witness, theta)).count();
    if witnesses.len() < MIN_AGREEING {
        return None;
    }
    let predicted = count(&Vector3::zeros());
    let turns = witnesses.iter().map(Witness::turn_across);
    // The first of those with the most votes, that of the prediction before all.
    let all = std::iter::once((Vector3::zeros(), predicted)).chain(turns.map(|turn| (turn, count(&turn))));
    let (mut theta, _) = all.reduce(|a, b| if b.1 > a.1 { b } else { a })?;
    let mut covariance = Matrix3::zeros();
    for _ in 0..2 {
        let agreeing = witnesses.iter().filter(|witness| agrees(witness, &theta));
        (theta, covariance) = solve(agreeing, focal_px, way_sigma_m)?;
    }
    let agreeing = count(&theta);
    let is_agreed = agreeing >= MIN_AGREEING && agreeing as f64 >= MIN_SHARE * witnesses.len() as f64;
    is_agreed.then(|| FoundTurn {
        rot_cur_predicted: Rotation3::new(theta),
        covariance,
        is_other: predicted as f64 <= MOST_PREDICTED * agreeing as f64,
    })
}

/// The turn by least squares, rad, and its covariance, rad².
fn solve<'a>(
    agreeing: impl Iterator<Item = &'a Witness>,
    focal_px: f64,
    way_sigma_m: f64,
) -> Option<(Vector3<f64>, Matrix3<f64>)> {
    let per_px = focal_px / PLACE_SIGMA_PX;
    let of_turn = 1.0 / TURN_SIGMA_RAD.squared();
    let of_way = 1.0 / (WAY_SIGMA_M.squared() + way_sigma_m.squared());
    let mut hessian =
        Matrix6::from_diagonal(&Vector6::new(of_turn, of_turn, of_turn, of_way, of_way, of_way));
    let mut gradient = Vector6::zeros();
    for witness in agreeing {
        let by_motion = witness.by_motion() * per_px;
        hessian += by_motion.tr_mul(&by_motion);
        gradient += by_motion.tr_mul(&((witness.found - witness.expected) * per_px));
    }
    let covariance = hessian.cholesky()?.inverse();
    let motion = covariance * gradient;
    Some((motion.fixed_rows::<3>(0).into(), covariance.fixed_view::<3, 3>(0, 0).into()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use plumbline_config::Random;

    const FOCAL_PX: f64 = 230.0;

    /// Twenty corners of a camera that turned by `turn` more than predicted; every `wrong`th of them is found elsewhere.
    fn witnesses(turn: &Vector3<f64>, wrong: usize) -> Witnesses {
        let (rotation, mut random) = (Rotation3::new(*turn), Random::new(5));
        let mut draw = |sigma: f64| Vector2::new(random.gaussian(), random.gaussian()) * sigma;
        let of_corner = |k: usize| {
            let expected = draw(0.4);
            let p = rotation * Vector3::new(expected.x, expected.y, 1.0);
            let sigma_px = if k.is_multiple_of(wrong) { 6.0 } else { 0.2 };
            Witness { expected, found: p.xy() / p.z + draw(sigma_px / FOCAL_PX), rho: 0.4 + 0.01 * k as f64 }
        };
        (0..20).map(of_corner).collect()
    }

    #[test]
    fn turns_that_were_not_predicted_are_told_by_most_corners() {
        for turn in [[0.01, 0.0, 0.0], [-0.012, 0.02, 0.0], [0.01, 0.0, -0.02]].map(Vector3::from) {
            let found = find_turn(&witnesses(&turn, 4), FOCAL_PX, 1e-3).expect("most agree");
            let off = found.rot_cur_predicted.scaled_axis() - turn;
            assert!(found.is_other && off.norm() < 3e-3, "{turn:?}: off by {off:?}");
            let squared =
                found.covariance.try_inverse().map_or(f64::INFINITY, |inverse| off.dot(&(inverse * off)));
            assert!(squared < 16.0, "{turn:?}: {squared} for three unknowns");
        }
    }

    #[test]
    fn derivatives_by_turn_and_way_agree_with_numeric_differentiation() {
        let witness = Witness { expected: Vector2::new(0.3, -0.4), found: Vector2::zeros(), rho: 0.6 };
        let place = |motion: Vector6<f64>| {
            let turn = Rotation3::new(motion.fixed_rows::<3>(0).into_owned());
            let p = turn * Vector3::new(witness.expected.x, witness.expected.y, 1.0)
                + motion.fixed_rows::<3>(3) * witness.rho;
            p.xy() / p.z
        };
        for k in 0..6 {
            let step = Vector6::ith(k, 1e-6);
            let numeric = (place(step) - place(-step)) / 2e-6;
            assert!((witness.by_motion().column(k) - numeric).norm() < 1e-8, "{k}");
        }
    }

    #[test]
    fn corners_that_agree_with_the_prediction_tell_no_other_turn() {
        let found = find_turn(&witnesses(&Vector3::new(1e-3, 0.0, 0.0), 4), FOCAL_PX, 1e-3);
        assert!(found.is_some_and(|found| !found.is_other));
    }

    #[test]
    fn corners_that_do_not_agree_or_are_few_tell_nothing() {
        assert!(find_turn(&witnesses(&Vector3::new(0.02, 0.0, 0.0), 1), FOCAL_PX, 1e-3).is_none());
        let few = witnesses(&Vector3::new(0.02, 0.0, 0.0), 20).into_iter().take(3).collect();
        assert!(find_turn(&few, FOCAL_PX, 1e-3).is_none());
    }
}
