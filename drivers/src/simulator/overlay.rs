//! Light that reaches the sensor past the scene: the veil of bright lights, and specks of rain.

use super::effects::Glare;
use super::lens::{Lens, TILE};
use crate::random::{Draws, Purpose};
use nalgebra::{UnitQuaternion, Vector3};
use plumbline_config::Portable;
use std::f64::consts::{FRAC_PI_2, TAU};

/// Bright lights around the horizon, and how high they stand, rad.
const LIGHTS: usize = 4;
const ELEVATION_RAD: f64 = 0.15;
/// A light in the middle of the view takes this share of the exposure away, and falls off by this angle, rad.
const EXPOSURE_LOSS: f64 = 0.5;
const METERED_RAD: f64 = 0.6;
/// Length, half width (px of an image 752 px wide) and brightness (grey levels) of specks.
const SPECK_LENGTH_PX: (f64, f64) = (3.0, 16.0);
const SPECK_HALF_PX: (f64, f64) = (0.7, 1.8);
const SPECK_GREY: (f64, f64) = (30.0, 110.0);

/// Brightness at the angle whose cosine is given, against that in the middle.
fn falloff(cosine: f64, radius_rad: f64) -> f64 {
    let square = 2.0 * (1.0 - cosine) / radius_rad.squared().at_least(1e-6);
    1.0 / (1.0 + square).squared()
}

/// Directions of the lights in a camera of attitude `rot_w_c`.
fn lights(rot_w_c: &UnitQuaternion<f64>, seed: u64) -> [Vector3<f64>; LIGHTS] {
    let first = Draws::new(seed, Purpose::Glare, 0).range(0.0, TAU);
    let (sin_up, cos_up) = libm::sincos(ELEVATION_RAD);
    std::array::from_fn(|k| {
        let (sin, cos) = libm::sincos(first + k as f64 * FRAC_PI_2);
        rot_w_c.inverse() * Vector3::new(cos_up * cos, cos_up * sin, sin_up)
    })
}

/// Factor of the exposure by which a camera gives way to the lights.
pub(super) fn exposure(rot_w_c: &UnitQuaternion<f64>, seed: u64) -> f64 {
    let seen: f64 = lights(rot_w_c, seed).iter().map(|d| falloff(d.z, METERED_RAD)).sum();
    1.0 - EXPOSURE_LOSS * seen.at_most(1.0)
}

/// Adds the veils of the lights to an image.
pub(super) fn add_glare(
    glare: &Glare,
    lens: &Lens,
    rot_w_c: &UnitQuaternion<f64>,
    seed: u64,
    light: &mut [f32],
) {
    let (width, height) = (lens.model.width_px, lens.model.height_px);
    let (grey, square) = (glare.grey as f32, glare.radius_rad.squared().at_least(1e-6) as f32);
    for d in lights(rot_w_c, seed).iter().filter(|d| d.z > -0.2) {
        let d = d.map(|x| x as f32);
        for tile in 0..lens.tiles.len() {
            let (u0, v0) = (tile % lens.columns * TILE, tile / lens.columns * TILE);
            for (v, [x, y]) in (v0..height).zip(lens.bearings(tile)) {
                for (k, out) in light[v * width..][..width].iter_mut().skip(u0).take(TILE).enumerate() {
                    let norm = (x[k] * x[k] + y[k] * y[k] + 1.0).sqrt();
                    let cosine = (d.x * x[k] + d.y * y[k] + d.z) / norm;
                    let fall = 1.0 + 2.0 * (1.0 - cosine) / square;
                    let veil = grey / (fall * fall);
                    // A pixel without a bearing sees nothing.
                    *out += if veil > 0.0 { veil } else { 0.0 };
                }
            }
        }
    }
}

/// Adds `count` specks to an image of `width` pixels a row; `stream` names frame and camera.
pub(super) fn add_specks(count: u32, width: usize, seed: u64, stream: u64, light: &mut [f32]) {
    let mut draws = Draws::new(seed, Purpose::Specks, stream);
    let (height, scale) = (light.len() / width, width as f64 / 752.0);
    for _ in 0..count {
        let (u, v) = (draws.range(0.0, width as f64), draws.range(0.0, height as f64));
        let length = scale * draws.range(SPECK_LENGTH_PX.0, SPECK_LENGTH_PX.1);
        let half = (scale * draws.range(SPECK_HALF_PX.0, SPECK_HALF_PX.1)).at_least(0.5);
        let grey = draws.range(SPECK_GREY.0, SPECK_GREY.1);
        let rows = v as usize..((v + length).ceil() as usize).min(height);
        let columns = (u - half).at_least(0.0) as usize..((u + half).ceil() as usize + 1).min(width);
        for row in rows {
            for column in columns.clone() {
                let share = (1.0 - (column as f64 - u).abs() / (half + 0.5)).at_least(0.0);
                light[row * width + column] += (grey * share) as f32;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::fixture;
    use super::*;

    fn lens() -> Lens {
        let camera = &fixture::config().camera[0];
        Lens::new(camera.model(), camera.pose_b_c())
    }

    #[test]
    fn glare_is_brightest_towards_the_light() {
        let lens = lens();
        let seed = 5;
        let towards = lights(&UnitQuaternion::identity(), seed)[0];
        let rot_w_c = UnitQuaternion::rotation_between(&Vector3::z(), &towards).unwrap();
        let mut light = vec![0.0; 752 * 480];
        add_glare(&Glare { grey: 300.0, radius_rad: 0.14 }, &lens, &rot_w_c, seed, &mut light);
        let at = |u: f64, v: f64| light[v as usize * 752 + u as usize];
        assert!((at(367.0, 248.0) - 300.0).abs() < 2.0, "{}", at(367.0, 248.0));
        // 458 px are one radian: at the radius a quarter is left.
        assert!((at(367.0 + 0.14 * 458.0, 248.0) - 75.0).abs() < 6.0);
        assert!(at(40.0, 40.0) < 6.0 && exposure(&rot_w_c, seed) < 0.52);
    }

    #[test]
    fn specks_differ_by_image_and_cover_little() {
        let drawn = |stream| {
            let mut light = vec![0.0; 752 * 480];
            add_specks(60, 752, 1, stream, &mut light);
            light
        };
        let image = drawn(7);
        let share = image.iter().filter(|grey| **grey > 0.0).count() as f64 / image.len() as f64;
        assert!((0.001..0.02).contains(&share), "{share}");
        assert!(image == drawn(7) && image != drawn(8));
    }
}
