//! Legs and rotors of the vehicle: where they are in the view of its cameras, and the masks that hide them.

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use plumbline_config::Portable;
use plumbline_config::options::{CameraConfig, PixelMask};
use std::f64::consts::TAU;

/// Feet of the legs and hubs of the rotors in the left camera (x right, y down, z forward), m; those of the other side are mirrored.
const LEG_M: [f64; 3] = [0.28, 0.22, 0.35];
const HUB_M: [f64; 3] = [0.26, -0.17, 0.36];
/// Sizes of a leg and of a blade, m.
pub(super) const LEG_SIZE_M: [f64; 3] = [0.02, 0.25, 0.02];
pub(super) const BLADE_SIZE_M: [f64; 3] = [0.24, 0.006, 0.03];
/// Revolutions of the two rotors, 1/s.
const ROTORS_HZ: [f64; 2] = [95.0, 97.3];
/// Distance of the points by which parts are masked, m, and pixels around each that are masked.
const PART_STEP_M: f64 = 0.002;
const MARGIN_PX: f64 = 4.0;

/// Legs and blades in the left camera, `seconds` into the flight.
pub(super) fn vehicle_parts(seconds: f64) -> [Isometry3<f64>; 4] {
    let at = |[x, y, z]: [f64; 3], side: f64| Translation3::new(side * x, y, z);
    let leg = |side| Isometry3::from_parts(at(LEG_M, side), UnitQuaternion::identity());
    let blade = |side: f64, hz: f64| {
        let turn = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), side * TAU * (hz * seconds).fract());
        Isometry3::from_parts(at(HUB_M, side), turn)
    };
    [leg(-1.0), leg(1.0), blade(-1.0, ROTORS_HZ[0]), blade(1.0, ROTORS_HZ[1])]
}

/// Masks of what legs and rotors cover in the images of `cameras`, at any angle of the rotors, with a margin.
pub(super) fn vehicle_masks(cameras: &[CameraConfig]) -> Vec<PixelMask> {
    let Some(left) = cameras.first() else { return Vec::new() };
    let points_c0 = points_of_parts();
    let mask = |camera: &CameraConfig| {
        let (width, height) = (camera.width_px, camera.height_px);
        let (model, pose_c_c0) = (camera.model(), camera.pose_b_c().inverse() * left.pose_b_c());
        let mut is_covered = vec![false; width * height];
        for px in points_c0.iter().filter_map(|p| model.project(&(pose_c_c0 * p).coords)) {
            let around = |x: f64, size: usize| {
                // A cast saturates: what is beyond an edge has no pixels.
                let first = (x - MARGIN_PX).at_least(0.0).ceil() as usize;
                first..((x + MARGIN_PX + 1.0) as usize).min(size)
            };
            for v in around(px.y, height) {
                let columns = around(px.x, width);
                if columns.start < columns.end {
                    is_covered[v * width..][columns].fill(true);
                }
            }
        }
        PixelMask::of(width, height, |u, v| !is_covered[v * width + u])
    };
    cameras.iter().map(mask).collect()
}

/// Points of both legs and of the discs that the rotors sweep, in the left camera, so close that their margins have no gaps.
fn points_of_parts() -> Vec<Point3<f64>> {
    let steps = |size: f64| {
        let count = (size / PART_STEP_M).ceil() as i32;
        (-count..=count).map(move |k| 0.5 * size * f64::from(k) / f64::from(count))
    };
    let mut points = Vec::new();
    for side in [-1.0, 1.0] {
        let mut add = |[cx, cy, cz]: [f64; 3], x: f64, y: f64, z: f64| {
            points.push(Point3::new(side * (cx + x), cy + y, cz + z));
        };
        for y in steps(LEG_SIZE_M[1]) {
            steps(LEG_SIZE_M[0]).for_each(|x| steps(LEG_SIZE_M[2]).for_each(|z| add(LEG_M, x, y, z)));
        }
        let radius = 0.5 * libm::hypot(BLADE_SIZE_M[0], BLADE_SIZE_M[2]);
        for y in [-0.5, 0.0, 0.5].map(|share| share * BLADE_SIZE_M[1]) {
            for x in steps(2.0 * radius) {
                steps(2.0 * radius)
                    .filter(|z| libm::hypot(x, *z) <= radius)
                    .for_each(|z| add(HUB_M, x, y, z));
            }
        }
    }
    points
}
