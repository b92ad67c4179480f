//! Every lens against its published formula, written out for points rather than for normalized coordinates, and against
//! OpenCV.

use super::{CameraModel, Distortion, MAX_THETA_RAD};
use crate::Random;
use nalgebra::{Matrix2, Matrix2x3, Vector2, Vector3};
use proptest::prelude::*;

/// Parameter sets of each lens.
const SETS: usize = 1_000;
/// Distance from the middle of the image in focal lengths.
const FURTHEST: f64 = 4.0;
/// Directions that are looked at for each.
const DIRECTIONS: usize = 12;

/// A lens of each model, as calibrations have it.
fn draw(model: usize, random: &mut Random) -> Distortion {
    let mut of = |low: f64, high: f64| random.range(low, high);
    let tangential = 2e-3;
    match model {
        0 => Distortion::RadialTangential {
            k1: of(-0.35, 0.1),
            k2: of(-0.02, 0.15),
            p1: of(-tangential, tangential),
            p2: of(-tangential, tangential),
        },
        1 => Distortion::Equidistant {
            k1: of(-0.05, 0.05),
            k2: of(-0.02, 0.05),
            k3: of(-0.02, 0.01),
            k4: of(-2e-3, 5e-3),
        },
        2 => {
            // Numerator and denominator nearly cancel each other.
            let common = of(-2.0, 20.0);
            Distortion::Rational {
                k1: common + of(-0.4, 0.05),
                k2: 0.5 * common + of(-0.1, 0.1),
                p1: of(-tangential, tangential),
                p2: of(-tangential, tangential),
                k3: of(0.0, 0.2),
                k4: common + of(-0.05, 0.3),
                k5: 0.5 * common + of(0.0, 0.2),
                k6: of(0.0, 0.3),
            }
        }
        3 => Distortion::Omni {
            xi: of(-0.3, 4.0),
            k1: of(-0.35, 0.1),
            k2: of(-0.02, 0.15),
            p1: of(-tangential, tangential),
            p2: of(-tangential, tangential),
        },
        4 => Distortion::Eucm { alpha: of(0.0, 1.0), beta: of(0.3, 3.0) },
        _ => Distortion::DoubleSphere { xi: of(-0.9, 0.95), alpha: of(0.0, 1.0) },
    }
}

fn camera(distortion: Distortion, random: &mut Random) -> CameraModel {
    CameraModel {
        width_px: 640,
        height_px: 480,
        focal_px: Vector2::new(random.range(150.0, 900.0), random.range(150.0, 900.0)),
        centre_px: Vector2::new(random.range(280.0, 360.0), random.range(200.0, 280.0)),
        distortion,
    }
}

/// A direction within the reach of the lens, with a margin, at some distance; `None` where the draw is beyond, or further off
/// the middle than the largest images, as before a pole of the model.
fn point(camera: &CameraModel, random: &mut Random) -> Option<Vector3<f64>> {
    let widest: f64 = match camera.distortion {
        Distortion::RadialTangential { .. } | Distortion::Rational { .. } => 0.8,
        _ => 1.5,
    };
    let (theta, around) = (random.range(0.0, widest), random.range(-3.2, 3.2));
    let xy = Vector2::new(around.cos(), around.sin()) * theta.tan();
    let is_within = camera.distortion.is_regular(&(xy * 1.05))
        && camera.distortion.distort(&(xy * 1.05)).0.norm() < FURTHEST;
    is_within.then(|| xy.push(1.0) * random.range(0.2, 30.0))
}

/// Calls `look` for every lens, parameter set and direction; tells how many there were for each lens.
fn for_each_lens(mut look: impl FnMut(&CameraModel, &Vector3<f64>)) {
    for model in 0..Distortion::MODELS.len() {
        let mut random = Random::new(4_700 + model as u64);
        let mut seen = 0;
        for _ in 0..SETS {
            let distortion = draw(model, &mut random);
            assert_eq!(distortion.model(), Distortion::MODELS[model]);
            let camera = camera(distortion, &mut random);
            for _ in 0..DIRECTIONS {
                let Some(p_c) = point(&camera, &mut random) else { continue };
                look(&camera, &p_c);
                seen += 1;
            }
        }
        assert!(seen > SETS * DIRECTIONS / 2, "{}: {seen} directions", Distortion::MODELS[model]);
    }
}

fn brown([k1, k2, p1, p2]: [f64; 4], (x, y): (f64, f64)) -> (f64, f64) {
    let r2 = x.powi(2) + y.powi(2);
    let radial = 1.0 + k1 * r2 + k2 * r2.powi(2);
    (
        x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x.powi(2)),
        y * radial + p1 * (r2 + 2.0 * y.powi(2)) + 2.0 * p2 * x * y,
    )
}

/// Distorted coordinates of a point by the formula of the paper.
fn published(distortion: &Distortion, p: &Vector3<f64>) -> (f64, f64) {
    let length = p.norm();
    match *distortion {
        Distortion::RadialTangential { k1, k2, p1, p2 } => brown([k1, k2, p1, p2], (p.x / p.z, p.y / p.z)),
        Distortion::Equidistant { k1, k2, k3, k4 } => {
            let theta = p.xy().norm().atan2(p.z);
            let theta_d =
                theta + k1 * theta.powi(3) + k2 * theta.powi(5) + k3 * theta.powi(7) + k4 * theta.powi(9);
            let around = p.y.atan2(p.x);
            (theta_d * around.cos(), theta_d * around.sin())
        }
        Distortion::Rational { k1, k2, p1, p2, k3, k4, k5, k6 } => {
            let (x, y) = (p.x / p.z, p.y / p.z);
            let r = x.hypot(y);
            let quotient = (1.0 + k1 * r.powi(2) + k2 * r.powi(4) + k3 * r.powi(6))
                / (1.0 + k4 * r.powi(2) + k5 * r.powi(4) + k6 * r.powi(6));
            let (dx, dy) = brown([0.0, 0.0, p1, p2], (x, y));
            (x * quotient + dx - x, y * quotient + dy - y)
        }
        Distortion::Omni { xi, k1, k2, p1, p2 } => {
            let s = p / length;
            brown([k1, k2, p1, p2], (s.x / (s.z + xi), s.y / (s.z + xi)))
        }
        Distortion::Eucm { alpha, beta } => {
            let d = (beta * (p.x.powi(2) + p.y.powi(2)) + p.z.powi(2)).sqrt();
            let scale = alpha * d + (1.0 - alpha) * p.z;
            (p.x / scale, p.y / scale)
        }
        Distortion::DoubleSphere { xi, alpha } => {
            let shifted = xi * length + p.z;
            let d2 = (p.x.powi(2) + p.y.powi(2) + shifted.powi(2)).sqrt();
            let scale = alpha * d2 + (1.0 - alpha) * shifted;
            (p.x / scale, p.y / scale)
        }
    }
}

#[test]
fn pixels_are_those_of_the_published_formula() {
    for_each_lens(|camera, p_c| {
        let (x, y) = published(&camera.distortion, p_c);
        let expected = Vector2::new(x, y).component_mul(&camera.focal_px) + camera.centre_px;
        let px = camera.project(p_c).expect("within the reach of the lens");
        assert!(
            (px - expected).norm() < 1e-9 * (1.0 + 1e-3 * expected.norm()),
            "{camera:?} {p_c} {px} {expected}"
        );
    });
}

/// The two lenses that flights were recorded with stop at 1e-11 of a focal length, the others at rounding.
#[test]
fn pixels_lead_back_to_the_direction_that_they_are_of() {
    for_each_lens(|camera, p_c| {
        let tolerance_px = match camera.distortion {
            Distortion::RadialTangential { .. } | Distortion::Equidistant { .. } => {
                1e-11 * camera.focal_px.max()
            }
            _ => 1e-9,
        };
        let px = camera.project(p_c).expect("within the reach of the lens");
        let Some(xy) = camera.unproject(&px) else { panic!("{camera:?}: {px} of {p_c} has no direction") };
        let (back, _) = camera.project_normalized(&xy);
        assert!((back - px).norm() < tolerance_px.max(1e-9), "{camera:?}: {px} comes back as {back}");
        let angle = xy.push(1.0).angle(p_c);
        assert!(angle < 1e-6, "{camera:?}: {px} is {angle} rad off");
    });
}

#[test]
fn jacobians_are_those_of_differences() {
    for_each_lens(|camera, p_c| {
        let (_, analytic) = camera.project_with_jacobian(p_c).expect("within the reach of the lens");
        let h = 1e-6 * p_c.z;
        let numeric = Matrix2x3::from_columns(&[0, 1, 2].map(|axis| {
            let step = Vector3::ith(axis, h);
            let ahead = camera.project(&(p_c + step)).expect("within reach");
            (ahead - camera.project(&(p_c - step)).expect("within reach")) / (2.0 * h)
        }));
        let error = (analytic - numeric).amax() / analytic.amax();
        assert!(error < 1e-5, "{camera:?} {p_c}: {error}");
    });
}

#[test]
fn derivatives_by_the_coefficients_are_those_of_differences() {
    for_each_lens(|camera, p_c| {
        let (lens, xy) = (camera.distortion, p_c.xy() / p_c.z);
        let values: Vec<f64> = lens.coefficients().iter().map(|(_, value)| *value).collect();
        let analytic = lens.by_coefficients(&xy);
        assert_eq!(analytic.len(), values.len());
        for (k, analytic) in analytic.iter().enumerate() {
            let h = 1e-6;
            let at = |step: f64| {
                let mut values = values.clone();
                values[k] += step;
                lens.with_coefficients(&values).distort(&xy).0
            };
            let error = ((at(h) - at(-h)) / (2.0 * h) - analytic).norm() / (1.0 + analytic.norm());
            assert!(error < 1e-5, "{lens:?} {xy} {k}: {error}");
        }
    });
}

/// Made by `opencv/lenses.cpp`, which stands beside.
#[test]
fn pixels_are_those_of_opencv() {
    let mut rows = [0; 6];
    for line in include_str!("../tests/opencv/lenses.csv").lines() {
        let (camera, rest) = line.split_once(',').expect("a model");
        let parts: Vec<Vec<f64>> = rest
            .split(';')
            .map(|part| part.split(',').map(|number| number.parse().expect("a number")).collect())
            .collect();
        let model = Distortion::MODELS.iter().position(|name| *name == camera).expect("a model");
        rows[model] += 1;
        let lens = draw(model, &mut Random::new(0)).with_coefficients(&parts[0][4..]);
        let camera = CameraModel {
            width_px: 640,
            height_px: 480,
            focal_px: Vector2::new(parts[0][0], parts[0][1]),
            centre_px: Vector2::new(parts[0][2], parts[0][3]),
            distortion: lens,
        };
        let xy = Vector2::new(parts[1][0], parts[1][1]) / parts[1][2];
        let (px, _) = camera.project_normalized(&xy);
        let expected = Vector2::new(parts[2][0], parts[2][1]);
        assert!((px - expected).norm() < 1e-9, "{line}: {px}");
    }
    assert_eq!(rows, [250, 250, 250, 250, 0, 0]);
}

fn typical(distortion: Distortion) -> CameraModel {
    let (focal_px, centre_px) = (Vector2::new(300.0, 301.0), Vector2::new(321.0, 238.0));
    CameraModel { width_px: 640, height_px: 480, focal_px, centre_px, distortion }
}

/// A lens of each model that ends before 89.4 degrees, and the normalized radius at which it does.
fn ending() -> [(Distortion, f64); 4] {
    let fold = (1.0f64 / 0.9).sqrt();
    // Of the unified model the fold is at |m| = r / (1 + xi sqrt(1 + r²)).
    let xi = 0.1;
    let of_omni = {
        // m = r / (1 + xi s) solved for the angle by the inverse in the paper.
        let m2 = fold * fold;
        let eta = (xi + (1.0 + (1.0 - xi * xi) * m2).sqrt()) / (1.0 + m2);
        fold * eta / (eta - xi)
    };
    // Of the double sphere with alpha > 0.5 it is where the second sphere folds: z1 = -d2 (1 - alpha) / alpha, with
    // d2² = 1 + 2 xi c + xi² and z1 = c + xi at the cosine c.
    let (xi_ds, alpha) = (-0.8f64, 0.7f64);
    let w1 = (1.0 - alpha) / alpha;
    let (mut low, mut high) = (0.0f64, 1.0f64);
    for _ in 0..60 {
        let cosine = 0.5 * (low + high);
        let is_beyond = cosine + xi_ds < -w1 * (1.0 + 2.0 * xi_ds * cosine + xi_ds * xi_ds).sqrt();
        if is_beyond { low = cosine } else { high = cosine }
    }
    let brown = |k1| Distortion::RadialTangential { k1, k2: 0.0, p1: 0.0, p2: 0.0 };
    [
        (brown(-0.3), fold),
        // r (1 - 0.3 r²) / 1 folds as Brown's model does.
        (
            Distortion::Rational { k1: -0.3, k2: 0.0, p1: 0.0, p2: 0.0, k3: 0.0, k4: 0.0, k5: 0.0, k6: 0.0 },
            fold,
        ),
        (Distortion::Omni { xi, k1: -0.3, k2: 0.0, p1: 0.0, p2: 0.0 }, of_omni),
        (Distortion::DoubleSphere { xi: xi_ds, alpha }, (1.0 / (low * low) - 1.0).sqrt()),
    ]
}

#[test]
fn nothing_beyond_the_end_of_a_lens_is_seen_and_no_pixel_points_there() {
    for (distortion, end) in ending() {
        let camera = typical(distortion);
        assert!(camera.project(&Vector3::new(0.999 * end, 0.0, 1.0)).is_some(), "{distortion:?}");
        assert_eq!(camera.project(&Vector3::new(1.001 * end, 0.0, 1.0)), None, "{distortion:?}");
        let fold_rad = distortion.fold_rad().expect("ends");
        assert!((fold_rad - end.atan()).abs() < 0.003, "{distortion:?}: {fold_rad} {}", end.atan());
        for percent in 1..98 {
            let xy = Vector2::new(end * f64::from(percent) / 100.0, 0.0);
            let (px, _) = camera.project_normalized(&xy);
            let found = camera.unproject(&px).expect("within the reach of the lens");
            assert!((found - xy).norm() < 1e-6 * (1.0 + xy.norm_squared()), "{distortion:?}: {xy} {found}");
        }
        let (furthest, _) = camera.project_normalized(&Vector2::new(end, 0.0));
        let beyond = furthest + Vector2::new(1.0, 0.0);
        assert_eq!(camera.unproject(&beyond), None, "{distortion:?}");
        assert!(!camera.has_direction(&beyond), "{distortion:?}");
    }
}

/// A denominator that vanishes at r = 1 ends the image of a rational lens, although the radius grows on both sides of it.
#[test]
fn a_rational_lens_ends_where_its_denominator_vanishes() {
    let [k1, k2, p1, p2, k3, k5, k6] = [0.0; 7];
    let camera = typical(Distortion::Rational { k1, k2, p1, p2, k3, k4: -1.0, k5, k6 });
    assert!(camera.project(&Vector3::new(0.99, 0.0, 1.0)).is_some());
    for x in [1.0001, 1.01, 2.0, 50.0] {
        assert_eq!(camera.project(&Vector3::new(x, 0.0, 1.0)), None, "{x}");
    }
    let far = camera.unproject(&Vector2::new(5_000.0, 238.0)).expect("before the pole");
    assert!(far.x < 1.0, "{far}");
}

/// Coefficients of hundreds that cancel each other, as the colour camera of an OAK-D has them from the factory
/// (`camera_info` of a TurtleBot 4 in public repositories).
#[test]
fn the_large_coefficients_of_an_oak_are_regular_over_its_image() {
    let lens = Distortion::Rational {
        k1: -3.475_167_036_056_518_6,
        k2: -38.573_474_884_033_2,
        p1: 0.000_343_096_035_066_992_04,
        p2: -9.377_215_610_584_244e-5,
        k3: 286.440_093_994_140_6,
        k4: -3.640_804_529_190_063_5,
        k5: -36.688_980_102_539_06,
        k6: 279.052_368_164_062_5,
    };
    let camera = CameraModel {
        width_px: 250,
        height_px: 250,
        focal_px: Vector2::repeat(202.619_644_165_039_06),
        centre_px: Vector2::new(124.346_000_671_386_72, 127.286_422_729_492_19),
        distortion: lens,
    };
    for (x, y) in [(0.0, 0.0), (249.0, 0.0), (0.0, 249.0), (249.0, 249.0), (124.0, 127.0)] {
        let px = Vector2::new(x, y);
        let xy = camera.unproject(&px).expect("a pixel of the image");
        assert!((camera.project_normalized(&xy).0 - px).norm() < 1e-9);
        assert!((xy - (px - camera.centre_px) / 202.6).norm() < 0.05, "a narrow lens bends little: {xy}");
    }
}

/// Lenses that see beyond a right angle; directions further than 89.4 degrees aside are not used.
#[test]
fn rays_at_a_right_angle_and_beyond_have_no_pixel_and_their_pixels_no_direction() {
    let lenses = [
        Distortion::Equidistant { k1: -0.003_269, k2: 0.054_05, k3: -0.051_59, k4: 0.010_75 },
        Distortion::Omni { xi: 1.4, k1: -0.1, k2: 0.01, p1: 0.0, p2: 0.0 },
        Distortion::Eucm { alpha: 0.63, beta: 1.04 },
        Distortion::DoubleSphere { xi: -0.18, alpha: 0.59 },
    ];
    for distortion in lenses {
        let camera = typical(distortion);
        assert_eq!(distortion.fold_rad(), None, "{distortion:?}");
        for theta in [MAX_THETA_RAD - 1e-6, 1.5, 1.2] {
            let xy = Vector2::new(theta.tan(), 0.0);
            let (px, _) = camera.project_normalized(&xy);
            let found = camera.unproject(&px).expect("before 89.4 degrees");
            assert!((found.x.atan() - theta).abs() < 1e-9, "{distortion:?}: {}", found.x.atan());
        }
        for p_c in [Vector3::new(1.0, 0.0, 0.0), Vector3::new(1.0, 0.2, -0.3), Vector3::new(0.0, 0.0, -1.0)] {
            assert_eq!(camera.project(&p_c), None, "{distortion:?}");
        }
        let (edge, _) = camera.project_normalized(&Vector2::new((MAX_THETA_RAD + 1e-4).tan(), 0.0));
        for beyond in [edge, edge + Vector2::new(5.0, 0.0), edge + Vector2::new(40.0, 0.0)] {
            assert_eq!(camera.unproject(&beyond), None, "{distortion:?} {beyond}");
            assert!(camera.has_direction(&beyond), "{distortion:?} {beyond}");
        }
    }
}

#[test]
fn a_lens_is_written_and_read_by_its_name() {
    for model in 0..Distortion::MODELS.len() {
        let lens = draw(model, &mut Random::new(1));
        let values: Vec<f64> = lens.coefficients().iter().map(|(_, value)| *value).collect();
        assert_eq!(lens.with_coefficients(&values), lens);
    }
}

proptest! {
    /// Any solution projects to the pixel, from the branch of the centre, for all lenses and pixels.
    #[test]
    fn unproject_is_right_or_says_no(
        model in 0..6usize,
        k in prop::array::uniform8(-1.0..1.0f64),
        x in -500.0..1500.0f64,
        y in -500.0..1000.0f64,
    ) {
        let mut k = k;
        match model {
            4 => (k[0], k[1]) = (k[0].abs(), 1.5 + k[1]),
            5 => k[1] = k[1].abs(),
            3 => (k[3], k[4]) = (0.02 * k[3], 0.02 * k[4]),
            _ => (k[2], k[3]) = (0.02 * k[2], 0.02 * k[3]),
        }
        let camera = typical(draw(model, &mut Random::new(0)).with_coefficients(&k));
        let px = Vector2::new(x, y);
        if let Some(xy) = camera.unproject(&px) {
            prop_assert!(camera.distortion.is_regular(&xy), "{camera:?} {xy}");
            let (back, jacobian): (_, Matrix2<f64>) = camera.project_normalized(&xy);
            prop_assert!((back - px).norm() < 1e-6, "{camera:?} {back}");
            prop_assert!(jacobian.determinant() > 0.0);
        }
    }

    #[test]
    fn no_number_makes_it_panic(
        model in 0..6usize,
        k in prop::array::uniform8(prop::num::f64::ANY),
        p in prop::array::uniform3(prop::num::f64::ANY),
    ) {
        let lens = draw(model, &mut Random::new(0));
        let wild = typical(lens.with_coefficients(&k));
        let _ = wild.project_with_jacobian(&Vector3::from(p));
        let _ = wild.unproject(&Vector2::new(p[0], p[1]));
        let _ = wild.has_direction(&Vector2::new(p[0], p[1]));
        let _ = wild.distortion.fold_rad();
        let tame = typical(lens);
        if let Some(px) = tame.project(&Vector3::from(p)) {
            prop_assert!(px.iter().all(|x| x.is_finite()));
        }
        prop_assert_eq!(tame.unproject(&Vector2::new(f64::NAN, 1.0)), None);
        prop_assert_eq!(tame.unproject(&Vector2::new(1.0, f64::INFINITY)), None);
    }
}
