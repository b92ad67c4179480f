//! Two maps of one place become one: keyframes of the second are located in the first, and the transform that most
//! of them agree on carries the whole second map over.
//!
//! Both maps know the vertical, so the transform is a turn about it and a shift.

use super::codec::MapContents;
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use plumbline_estimator::places::refine::Gravity;
use plumbline_estimator::places::{Locator, LocatorOptions, MapLimits, PlaceMap, Query};

/// Keyframes that must agree before two maps are taken to be of one place.
pub const MIN_AGREEING: usize = 3;
/// Transforms agree within this, m and rad.
const MAX_DIFFERENCE: (f64, f64) = (0.25, 0.05);
/// Uncertainty of a map's vertical, rad.
const SIGMA_VERTICAL_RAD: f64 = 0.01;

/// Alignment of two maps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MapFit {
    /// Takes coordinates of the second map to the first.
    pub pose_a_b: Isometry3<f64>,
    /// Keyframes of the second map that were located in the first.
    pub located: usize,
    /// Located keyframes that agree with the transform.
    pub agreeing: usize,
}

/// Finds how the second map lies in the first; `None` when too few of its keyframes are found there, or they
/// contradict each other.
pub fn fit(first: &PlaceMap, second: &MapContents) -> Option<MapFit> {
    let limits = second.limits();
    let mut locator = Locator::new(&LocatorOptions::default(), first.limits().keyframes, limits.features);
    let mut transforms = Vec::new();
    for (number, keyframe) in second.keyframes.iter().enumerate() {
        let up_b = keyframe.pose_m_b.rotation.inverse() * Vector3::z();
        let query = Query {
            features: &keyframe.features,
            pose_b_c: keyframe.pose_b_c,
            gravity: Gravity { up_b, sigma_rad: SIGMA_VERTICAL_RAD },
            seed: number as u64,
        };
        if let Some(found) = locator.locate(first, &query, |_| true) {
            transforms.push(upright(
                &(found.pose_m_b * keyframe.pose_m_b.inverse()),
                &keyframe.pose_m_b,
                &found.pose_m_b,
            ));
        }
    }
    let agreeing = |a: &Isometry3<f64>| transforms.iter().filter(|b| agree(a, b)).count();
    let best = transforms.iter().max_by_key(|a| agreeing(a))?;
    let count = agreeing(best);
    if count < MIN_AGREEING || 2 * count <= transforms.len() {
        return None;
    }
    let chosen: Vec<_> = transforms.iter().filter(|b| agree(best, b)).collect();
    Some(MapFit { pose_a_b: mean(&chosen), located: transforms.len(), agreeing: count })
}

/// The second map's keyframes in the first, those of the second as later flights.
pub fn merged(first: MapContents, second: MapContents, fit: &MapFit, limits: MapLimits) -> PlaceMap {
    let sessions = first.keyframes.iter().map(|k| k.session + 1).max().unwrap_or(0);
    let mut all = first;
    all.keyframes.extend(second.keyframes.into_iter().map(|mut k| {
        k.session += sessions;
        k.pose_m_b = fit.pose_a_b * k.pose_m_b;
        k
    }));
    all.into_map(limits)
}

/// The transform with its tilt taken out, kept exact at the keyframe by which it was found.
fn upright(transform: &Isometry3<f64>, at: &Isometry3<f64>, found: &Isometry3<f64>) -> Isometry3<f64> {
    let q = transform.rotation.quaternion();
    let yaw = UnitQuaternion::try_new(nalgebra::Quaternion::new(q.w, 0.0, 0.0, q.k), 1e-9);
    let yaw = yaw.unwrap_or_else(UnitQuaternion::identity);
    let shift = found.translation.vector - yaw * at.translation.vector;
    Isometry3::from_parts(shift.into(), yaw)
}

fn agree(a: &Isometry3<f64>, b: &Isometry3<f64>) -> bool {
    (a.translation.vector - b.translation.vector).norm() <= MAX_DIFFERENCE.0
        && a.rotation.angle_to(&b.rotation) <= MAX_DIFFERENCE.1
}

/// The mean of transforms that are nearly alike.
fn mean(transforms: &[&Isometry3<f64>]) -> Isometry3<f64> {
    let count = transforms.len().max(1) as f64;
    let reference = transforms.first().map_or_else(UnitQuaternion::identity, |t| t.rotation);
    let shift = transforms.iter().fold(Vector3::zeros(), |s, t| s + t.translation.vector) / count;
    let turn =
        transforms.iter().fold(Vector3::zeros(), |s, t| s + (reference.inverse() * t.rotation).scaled_axis())
            / count;
    Isometry3::from_parts(shift.into(), reference * UnitQuaternion::from_scaled_axis(turn))
}
