//! A line from the planes of two or more views.

use super::factor::Linearization;
use super::feature::{Estimated, Feature, Jacobians};
use super::landmark::{LineLandmark, Observation};
use super::line::{HostedLine, LineMeasurement};
use super::options::Options;
use super::triangulate::{Scene, Triangulation, camera_pose, consistent};
use nalgebra::{Matrix4, Vector3, Vector4};
use plumbline_config::Portable;

/// Planes that meet at less than this angle are one plane within noise, rad.
const MIN_PLANE_ANGLE: f64 = 0.004;
/// Steps of the refinement over all views.
const REFINEMENTS: usize = 4;
/// A line has a distance when its inverse exceeds this many standard deviations. Half of what points need:
/// a line has more pixels behind it, and fewer of them lie about.
const MIN_PARALLAX_SIGMAS: f64 = 3.0;
/// Largest standard deviation of the line's slope in depth, rad.
const MAX_SLOPE_SIGMA: f64 = 0.3;

/// Finds the line in its host camera: the host's plane meets that of the view at the largest angle, then all
/// views refine it. It waits while no view has parallax (the baseline along the line, or the line in the
/// epipolar plane), judged by the standard deviations of distance and slope.
pub fn triangulate_line(landmark: &mut LineLandmark, scene: &Scene<'_>, options: &Options) -> Triangulation {
    let is_host =
        |o: &&Observation<LineMeasurement>| o.frame == landmark.host && o.camera == landmark.host_camera;
    let Some(at_host) = landmark.observations.iter().find(is_host).map(|o| o.measured) else {
        return Triangulation::Contradiction;
    };
    let Some(line) = widest_intersection(landmark, &at_host, scene) else {
        return Triangulation::Waiting;
    };
    landmark.feature = line;
    let Some(information) = refine(landmark, scene) else {
        return Triangulation::Waiting;
    };
    let Some(covariance) = information.try_inverse() else { return Triangulation::Waiting };
    let (slope_sigma, phi_sigma) =
        (covariance[(0, 0)].at_least(0.0).sqrt(), covariance[(3, 3)].at_least(0.0).sqrt());
    let inverse_distance = libm::tan(landmark.feature.phi);
    let is_wide = phi_sigma * MIN_PARALLAX_SIGMAS < inverse_distance && slope_sigma < MAX_SLOPE_SIGMA;
    if !is_wide {
        return Triangulation::Waiting;
    }
    let depths = at_host.ends_xy.map(|xy| landmark.feature.depth_at(&xy));
    let is_seen = depths.iter().all(|d| (1.0 / options.max_rho..=1.0 / options.min_rho).contains(d));
    if !is_seen || !consistent(landmark, scene) {
        return Triangulation::Contradiction;
    }
    landmark.is_triangulated = true;
    Triangulation::Done
}

/// The line in which the host's plane meets that of the view at the largest angle to it.
fn widest_intersection(
    landmark: &LineLandmark,
    at_host: &LineMeasurement,
    scene: &Scene<'_>,
) -> Option<HostedLine> {
    let Scene { frames, mounts, .. } = *scene;
    let camera = usize::from(landmark.host_camera);
    let (rot_host, p_host) = camera_pose(&frames[usize::from(landmark.host)], &mounts[camera]);
    let plane = at_host.normal().normalize();
    let mut widest: Option<(f64, Vector3<f64>, f64)> = None;
    for o in &landmark.observations {
        let (rot, p) = camera_pose(&frames[usize::from(o.frame)], &mounts[usize::from(o.camera)]);
        let other = rot_host.tr_mul(&(rot * o.measured.normal().normalize()));
        let sine = plane.cross(&other).norm();
        let distance = other.dot(&rot_host.tr_mul(&(p - p_host)));
        if widest.is_none_or(|(s, _, _)| sine > s) {
            widest = Some((sine, other, distance));
        }
    }
    let (sine, other, distance) = widest?;
    if sine < MIN_PLANE_ANGLE {
        return None;
    }
    // Points x with plane'x = 0 and other'x = distance: v = plane x other, n = x x v = distance plane. The
    // sense of the edge makes n the host's normal.
    let sense = if distance < 0.0 { -1.0 } else { 1.0 };
    HostedLine::of(&(plane * (distance * sense)), &(plane.cross(&other) * sense))
}

/// Gauss-Newton over all views with the poses held; the information of the four parameters at the end.
fn refine(landmark: &mut LineLandmark, scene: &Scene<'_>) -> Option<Matrix4<f64>> {
    let mut information = Matrix4::zeros();
    for _ in 0..REFINEMENTS {
        information = Matrix4::zeros();
        let mut gradient = Vector4::zeros();
        let mut jacobians = Jacobians::zeros();
        for o in &landmark.observations {
            let r = scene.with_view(landmark, o, |view, step_s| {
                let linearization = Linearization { at: view, jacobians: &mut jacobians };
                landmark.feature.residual(view, &o.measured, step_s, Some(linearization))
            })?;
            let j = &jacobians.landmark;
            information += j.tr_mul(j);
            gradient += j.tr_mul(&r);
        }
        let step = information.cholesky()?.solve(&-gradient);
        landmark.feature = landmark.feature.plus(&step);
    }
    (0.0..std::f64::consts::FRAC_PI_2).contains(&landmark.feature.phi).then_some(information)
}

#[cfg(test)]
#[path = "triangulate_line_tests.rs"]
mod tests;
