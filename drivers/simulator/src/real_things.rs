//! Things of a machine hall: pipes, framed doors, bars.

use super::builder::Builder;
use super::pattern::Material;
use super::solid::Solid;
use super::world::Finish;
use nalgebra::Vector3;

/// Faces of a pipe.
const FACES: usize = 12;
/// Width of the frame of a door, m.
const FRAME_M: f64 = 0.05;
/// Tones of sheet metal and of bars, and brightness of lamps in sheet metal against white.
const SHEET: (f64, f64) = (0.25, 1.1);
const BARS: (f64, f64) = (0.1, 1.3);
const GLOSS: (f64, f64) = (0.5, 1.2);

/// A pipe of sheet metal from `start` along `way`.
pub(super) fn tube(b: &mut Builder<'_>, start: Vector3<f64>, way: Vector3<f64>, radius: f64) {
    let axis = way.normalize();
    let aside = if axis.z.abs() < 0.5 { Vector3::z() } else { Vector3::x() };
    let u = (aside - axis * axis.dot(&aside)).normalize();
    let v = axis.cross(&u);
    let tone = b.draws.range(SHEET.0, SHEET.1) as f32;
    let gloss = b.draws.range(GLOSS.0, GLOSS.1) as f32;
    let sheet = Finish { gloss, ..Finish::of(Material::Plaster).zoomed(1.5).toned(0.8 * tone, 1.15 * tone) };
    let rim = |k: usize| {
        let (sin, cos) = libm::sincos(std::f64::consts::TAU * k as f64 / FACES as f64);
        start + (u * cos + v * sin) * radius
    };
    b.as_given(|b| {
        for k in 0..FACES {
            b.quad(rim(k), rim(k + 1) - rim(k), way, sheet);
        }
    });
}

/// Finish of bars and frames.
pub(super) fn bar(b: &mut Builder<'_>) -> Finish {
    let tone = b.draws.range(BARS.0, BARS.1) as f32;
    Finish::of(Material::Paint).toned(0.0, tone)
}

/// Frames of doors on the side of a solid towards `side` times its y.
pub(super) fn framed_side(b: &mut Builder<'_>, solid: &Solid, side: f64, doors: usize) {
    let look = bar(b);
    let [a, c] = solid.axes();
    let (up, height, width) = (Vector3::z(), 2.0 * solid.half.z, 2.0 * solid.half.x);
    let along = a * side * -1.0;
    let corner =
        solid.centre + c * (side * (solid.half.y + 0.004)) - along * solid.half.x - up * solid.half.z;
    let strip = |b: &mut Builder<'_>, at: f64, z: f64, w: f64, h: f64| {
        b.quad(corner + along * at + up * z, along * w, up * h, look);
    };
    b.as_given(|b| {
        for k in 0..=doors {
            strip(b, (width - FRAME_M) * k as f64 / doors as f64, 0.0, FRAME_M, height);
        }
        for z in [0.0, 0.5, 1.0] {
            strip(b, 0.0, (height - FRAME_M) * z, width, FRAME_M);
        }
    });
}
