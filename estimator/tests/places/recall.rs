//! Real images found among others that were taken seconds before and after.

use super::building::FEATURES;
use super::images::{Pair, real};
use plumbline_estimator::places::refine::Gravity;
use plumbline_estimator::places::{Located, Locator, LocatorOptions, MapLimits, PlaceMap, Query};
use plumbline_test_support::shared;

/// Uncertainty of the vertical, rad.
const SIGMA_VERTICAL_RAD: f64 = 0.01;
/// The pairs before and after one that is located are left out of the map.
const APART: usize = 1;
/// Further off than this is wrong, m and degrees.
pub const WRONG: (f64, f64) = (0.3, 5.0);

/// A map of pairs, their numbers those of its keyframes.
pub fn map_of(pairs: &[Pair]) -> PlaceMap {
    let limits = MapLimits { keyframes: pairs.len(), features: FEATURES };
    let mut map = PlaceMap::new(limits);
    for pair in pairs {
        map.add(pair.keyframe.clone(), &pair.features);
    }
    map
}

/// Error of a pose, m and degrees.
pub fn error(found: &Located, pair: &Pair) -> (f64, f64) {
    let truth = pair.keyframe.pose_m_b;
    let moved = (found.pose_m_b.translation.vector - truth.translation.vector).norm();
    (moved, found.pose_m_b.rotation.angle_to(&truth.rotation).to_degrees())
}

/// Outcome for all pairs.
#[derive(Default)]
struct Outcome {
    found: usize,
    wrong: usize,
    errors_m: Vec<f64>,
    errors_deg: Vec<f64>,
    nees: Vec<f64>,
}

impl Outcome {
    fn print(&mut self) {
        let median = |values: &mut Vec<f64>| {
            values.sort_by(f64::total_cmp);
            (values[values.len() / 2], values[values.len() - 1])
        };
        let (m, deg, nees) =
            (median(&mut self.errors_m), median(&mut self.errors_deg), median(&mut self.nees));
        println!(
            "{} found, {} wrong; median {:.3} m {:.2} deg, worst {:.3} m {:.2} deg; NEES median {:.1}, worst {:.1}",
            self.found, self.wrong, m.0, deg.0, m.1, deg.1, nees.0, nees.1
        );
    }
}

/// Locates each pair by all others but its neighbours.
fn leave_three_out(pairs: &[Pair]) -> Outcome {
    let map = map_of(pairs);
    let mut locator = Locator::new(&LocatorOptions::default(), pairs.len(), FEATURES);
    let mut outcome = Outcome::default();
    for (k, pair) in pairs.iter().enumerate() {
        let (pose_b_c, seed) = (pair.keyframe.pose_b_c, k as u64);
        let gravity =
            Gravity { up_b: pose_b_c.rotation * pair.keyframe.up_c(), sigma_rad: SIGMA_VERTICAL_RAD };
        let query = Query { features: &pair.features, pose_b_c, gravity, seed };
        let Some(found) = locator.locate(&map, &query, |other| (other.id as usize).abs_diff(k) > APART)
        else {
            continue;
        };
        let (m, deg) = error(&found, pair);
        outcome.found += 1;
        outcome.wrong += usize::from(m > WRONG.0 || deg > WRONG.1);
        outcome.errors_m.push(m);
        outcome.errors_deg.push(deg);
        let truth = pair.keyframe.pose_m_b;
        let mut off = nalgebra::Vector6::zeros();
        off.fixed_rows_mut::<3>(0).copy_from(&(found.pose_m_b.translation.vector - truth.translation.vector));
        off.fixed_rows_mut::<3>(3)
            .copy_from(&(truth.rotation.inverse() * found.pose_m_b.rotation).scaled_axis());
        outcome.nees.push(off.dot(&found.covariance.cholesky().unwrap().solve(&off)));
    }
    outcome
}

#[test]
fn nine_of_ten_images_of_a_room_are_found_seconds_apart() {
    let Some(folder) = shared("euroc/V1_01_places") else { return };
    let pairs = real(&folder);
    let mut outcome = leave_three_out(&pairs);
    outcome.print();
    assert!(10 * outcome.found >= 9 * pairs.len() && outcome.wrong == 0);
    let middle = outcome.found / 2;
    assert!(outcome.errors_m[middle] <= 0.025 && outcome.errors_deg[middle] <= 0.5);
    // Six unknowns: half of the values of a chi-squared variable lie below 5.3.
    assert!((2.0..8.0).contains(&outcome.nees[middle]));
}
