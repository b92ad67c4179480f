//! The pieces of a recording put together: their weighted mean, and a covariance that their scatter has confirmed.
//!
//! Unknowns are place and attitude of the left camera in the body and the time offset, as a step from the calibration that
//! all pieces began with. A piece's covariance holds the prior too, which counts once and not in every piece: with `P_i` and
//! `W` for piece and prior the mean has the information `W^-1 + sum (P_i^-1 - W^-1)`.
//!
//! An estimator over tracked patches believes too much in itself: errors of one patch repeat from frame to frame. So the
//! covariance of each group of unknowns (place, attitude, time) grows by the mean square of the scatter of the pieces
//! over what they say of themselves, where that is above one (Birge 1932).

use nalgebra::{SMatrix, SVector};
use plumbline_estimator::RigEstimate;
use plumbline_estimator::window::state::{RIG_DIM, Rig};

/// Unknowns: place (0..3, m, body), attitude (3..6, rad, right perturbation in the camera), time offset (6, s).
pub const DIM: usize = 7;
/// Where they stand in the rig's error state.
const PLACES: [usize; DIM] = [
    Rig::P_B_C0,
    Rig::P_B_C0 + 1,
    Rig::P_B_C0 + 2,
    Rig::ROT_B_C0,
    Rig::ROT_B_C0 + 1,
    Rig::ROT_B_C0 + 2,
    Rig::TIME_OFFSET,
];
/// Place, attitude and time: what has one scatter.
const GROUPS: [std::ops::Range<usize>; 3] = [0..3, 3..6, 6..7];

/// A step of the unknowns.
pub type Step = SVector<f64, DIM>;
/// Its covariance.
pub type Covariance = SMatrix<f64, DIM, DIM>;

/// The mean of the pieces.
#[derive(Clone, Debug, PartialEq)]
pub struct Fused {
    /// From the calibration that the pieces began with.
    pub step: Step,
    /// Its covariance, grown by the scatter.
    pub covariance: Covariance,
    /// By how much the standard deviations grew: place, attitude, time.
    pub growth: [f64; 3],
}

/// The mean of what `pieces` found, all of which began with `start` and the standard deviations `prior`; `None` without
/// pieces, or where a covariance is none.
#[must_use]
pub fn fuse(pieces: &[RigEstimate], start: &Rig, prior: &SVector<f64, RIG_DIM>) -> Option<Fused> {
    let prior = Covariance::from_diagonal(&Step::from_fn(|k, _| prior[PLACES[k]].powi(-2)));
    let (mut information, mut sum) = (prior, Step::zeros());
    let mut found = Vec::with_capacity(pieces.len());
    for piece in pieces {
        let step = piece.rig.minus(start);
        let step = Step::from_fn(|k, _| step[PLACES[k]]);
        let covariance = Covariance::from_fn(|i, j| piece.covariance[(PLACES[i], PLACES[j])]);
        let own = covariance.cholesky()?.inverse();
        information += own - prior;
        sum += own * step;
        found.push((step, covariance));
    }
    let covariance = information.cholesky()?.inverse();
    let step = covariance * sum;
    let growth = GROUPS.map(|group| scatter(&found, &step, group).max(1.0).sqrt());
    let factor = |k: usize| growth[GROUPS.iter().position(|group| group.contains(&k)).unwrap_or(0)];
    let covariance = Covariance::from_fn(|i, j| covariance[(i, j)] * factor(i) * factor(j));
    (!found.is_empty()).then_some(Fused { step, covariance, growth })
}

/// Mean square of the scatter of a group over what the pieces say of themselves; 1 for a single piece.
fn scatter(found: &[(Step, Covariance)], mean: &Step, group: std::ops::Range<usize>) -> f64 {
    let count = group.len();
    let freedom = (found.len().saturating_sub(1) * count) as f64;
    let square = |(step, covariance): &(Step, Covariance)| {
        let residual = (step - mean).rows(group.start, count).into_owned();
        let own = covariance.view((group.start, group.start), (count, count)).into_owned();
        own.cholesky().map_or(f64::INFINITY, |factor| residual.dot(&factor.solve(&residual)))
    };
    if freedom == 0.0 { 1.0 } else { found.iter().map(square).sum::<f64>() / freedom }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Isometry3;
    use plumbline_estimator::RigCovariance;

    fn start() -> Rig {
        Rig {
            pose_b_c0: Isometry3::identity(),
            pose_c0_c1: Isometry3::identity(),
            time_offset_s: 0.001,
            intrinsics: Default::default(),
        }
    }

    fn piece(place_x: f64, sigma: f64) -> RigEstimate {
        let mut step = SVector::<f64, RIG_DIM>::zeros();
        step[Rig::P_B_C0] = place_x;
        let covariance = RigCovariance::from_diagonal_element(sigma * sigma);
        RigEstimate { rig: start().plus(&step), covariance }
    }

    fn prior(sigma: f64) -> SVector<f64, RIG_DIM> {
        SVector::from_element(sigma)
    }

    #[test]
    fn the_prior_counts_once_however_many_pieces_there_are() {
        // A prior of 1 and four measurements of 1 each: each piece says 1/sqrt(2), half of what it measured.
        let half = 0.5_f64.sqrt();
        let pieces: Vec<_> = (0..4).map(|_| piece(0.005, half)).collect();
        let fused = fuse(&pieces, &start(), &prior(1.0)).unwrap();
        assert!((fused.covariance[(0, 0)] - 0.2).abs() < 1e-12, "{fused:?}");
        assert!((fused.step[0] - 0.008).abs() < 1e-9, "0.01 measured, four fifths of it");
        assert_eq!(fused.growth, [1.0; 3]);
    }

    #[test]
    fn pieces_that_scatter_more_than_they_say_are_believed_less() {
        let pieces = [piece(0.01, 1e-3), piece(-0.01, 1e-3), piece(0.01, 1e-3), piece(-0.01, 1e-3)];
        let fused = fuse(&pieces, &start(), &prior(1.0)).unwrap();
        // Four times (10 sigma)², over 9 degrees of freedom.
        assert!((fused.growth[0] - (400.0_f64 / 9.0).sqrt()).abs() < 1e-3, "{fused:?}");
        assert_eq!(&fused.growth[1..], [1.0; 2]);
        assert!((fused.covariance[(0, 0)].sqrt() - 0.5e-3 * fused.growth[0]).abs() < 1e-8);
        assert!((fused.covariance[(6, 6)].sqrt() - 0.5e-3).abs() < 1e-8);
    }

    #[test]
    fn no_pieces_say_nothing() {
        assert_eq!(fuse(&[], &start(), &prior(1.0)), None);
    }
}
