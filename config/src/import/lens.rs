//! Lenses as calibration files state them.

use super::yaml::Node;
use crate::camera::Distortion;
use crate::error::ConfigError;

/// A lens without distortion.
pub(super) const STRAIGHT: Distortion = Distortion::RadialTangential { k1: 0.0, k2: 0.0, p1: 0.0, p2: 0.0 };

/// Intrinsics and distortion of a camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Lens {
    pub focal_px: [f64; 2],
    pub centre_px: [f64; 2],
    pub distortion: Distortion,
}

impl Lens {
    pub fn new([fx, fy, cx, cy]: [f64; 4], distortion: Distortion) -> Self {
        Self { focal_px: [fx, fy], centre_px: [cx, cy], distortion }
    }
}

/// Names of the projections in files of Kalibr, with the parameters before `fu, fv, pu, pv`.
const PROJECTIONS: [(&str, &str); 4] =
    [("pinhole", ""), ("omni", "xi, "), ("eucm", "alpha, beta, "), ("ds", "xi, alpha, ")];

/// Counts of coefficients that are taken for radtan, with the model and the order that they are of.
const LONGER: [(usize, &str, &str); 2] =
    [(5, "plumb_bob", "k1 k2 p1 p2 k3"), (8, "rational_polynomial", "k1 k2 p1 p2 k3 k4 k5 k6")];

/// Lens of a camera as Kalibr and the ASL format state it: `camera_model`, `intrinsics`, `distortion_model`, and the
/// coefficients by a key of the format's own.
pub(super) fn kalibr(camera: &Node<'_>, coefficients_key: &str) -> Result<Lens, ConfigError> {
    let model = match camera.optional("camera_model") {
        Some(model) => model.text()?,
        None => "pinhole",
    };
    let intrinsics = camera.get("intrinsics")?;
    if intrinsics.elements().is_ok_and(|elements| elements.len() == 9) {
        let cure = "give fu, fv, pu, pv: its numbers 1, 5, 3 and 6, row by row";
        return Err(intrinsics.refuse("is a camera matrix of 9 numbers", cure));
    }
    match model {
        "pinhole" => Ok(Lens::new(intrinsics.numbers()?, pinhole_distortion(camera, coefficients_key)?)),
        "omni" => {
            let [xi, fx, fy, cx, cy] = with_parameters(&intrinsics, model)?;
            let [k1, k2, p1, p2] = radtan_or_none(camera, coefficients_key)?;
            Ok(Lens::new([fx, fy, cx, cy], Distortion::Omni { xi, k1, k2, p1, p2 }))
        }
        "eucm" => {
            let [alpha, beta, fx, fy, cx, cy] = with_parameters(&intrinsics, model)?;
            none(camera, model)?;
            Ok(Lens::new([fx, fy, cx, cy], Distortion::Eucm { alpha, beta }))
        }
        "ds" => {
            let [xi, alpha, fx, fy, cx, cy] = with_parameters(&intrinsics, model)?;
            none(camera, model)?;
            Ok(Lens::new([fx, fy, cx, cy], Distortion::DoubleSphere { xi, alpha }))
        }
        _ => {
            let known = PROJECTIONS.map(|(name, _)| name).join(", ");
            let cure = format!("calibrate with one of {known}");
            Err(camera.get("camera_model")?.refuse("is no known projection", cure))
        }
    }
}

/// Exactly as many numbers as a projection has.
fn with_parameters<const N: usize>(intrinsics: &Node<'_>, model: &str) -> Result<[f64; N], ConfigError> {
    let count = intrinsics.elements()?.len();
    if count == N {
        return intrinsics.numbers();
    }
    let own = PROJECTIONS.iter().find(|(name, _)| *name == model).map_or("", |(_, own)| own);
    Err(intrinsics.refuse(
        format!("has {count} numbers"),
        format!("camera_model {model} has {N}: [{own}fu, fv, pu, pv]"),
    ))
}

/// Distortion of a pinhole, whichever way the format names the models.
fn pinhole_distortion(camera: &Node<'_>, coefficients_key: &str) -> Result<Distortion, ConfigError> {
    let model = camera.get("distortion_model")?;
    let coefficients = || camera.get(coefficients_key);
    match model.text()? {
        "radial-tangential" | "radtan" => {
            let [k1, k2, p1, p2] = radtan(&coefficients()?, Some(&model))?;
            Ok(Distortion::RadialTangential { k1, k2, p1, p2 })
        }
        // With four numbers k3 is left out.
        "plumb_bob" if coefficients()?.elements()?.len() == 4 => {
            coefficients()?.numbers().map(|[k1, k2, p1, p2]| Distortion::RadialTangential { k1, k2, p1, p2 })
        }
        "plumb_bob" => coefficients()?.numbers().map(|[k1, k2, p1, p2, k3]| brown(k1, k2, p1, p2, k3)),
        "equidistant" | "equi" => {
            coefficients()?.numbers().map(|[k1, k2, k3, k4]| Distortion::Equidistant { k1, k2, k3, k4 })
        }
        "rational" | "rational_polynomial" | "radtan8" => {
            coefficients()?.numbers().map(|[k1, k2, p1, p2, k3, k4, k5, k6]| Distortion::Rational {
                k1,
                k2,
                p1,
                p2,
                k3,
                k4,
                k5,
                k6,
            })
        }
        "none" => Ok(STRAIGHT),
        name => Err(other_name(&model, name).unwrap_or_else(|| model.refuse(
            "is no known model",
            "calibrate with radtan (radial-tangential), equidistant, plumb_bob (k1 k2 p1 p2 k3) or rational_polynomial (k1 k2 p1 \
             p2 k3 k4 k5 k6)",
        ))),
    }
}

/// Names of distortion models in other programs, and those in files of Kalibr with the same numbers.
const OTHER_NAMES: [(&str, &str); 8] = [
    ("fisheye", "equidistant"),
    ("kannala_brandt", "equidistant"),
    ("kannala_brandt4", "equidistant"),
    ("kb4", "equidistant"),
    ("opencv_fisheye", "equidistant"),
    ("brown_conrady", "plumb_bob"),
    ("opencv", "plumb_bob"),
    ("opencv8", "rational_polynomial"),
];

/// Error of a model by the name that another program gives it.
fn other_name(model: &Node<'_>, name: &str) -> Option<ConfigError> {
    let (_, known) = OTHER_NAMES.iter().find(|(other, _)| name.eq_ignore_ascii_case(other))?;
    let cure = format!("write `{}: {known}` if its numbers are of that model, in that order", model.name());
    Some(model.refuse(format!("{name} is another program's name, probably of {known}"), cure))
}

/// The four coefficients of radtan. More of them are of another model: named by `model`, the key of a pinhole's.
fn radtan(coefficients: &Node<'_>, model: Option<&Node<'_>>) -> Result<[f64; 4], ConfigError> {
    let count = coefficients.elements()?.len();
    let (Some(model), Some((name, order))) =
        (model, LONGER.iter().find_map(|(n, name, order)| (*n == count).then_some((name, order))))
    else {
        return coefficients.numbers();
    };
    let key = model.name();
    Err(coefficients.refuse(
        format!("has {count} numbers, radtan has 4 (k1 k2 p1 p2)"),
        format!("if these are {order}, write `{key}: {name}`; do not delete any"),
    ))
}

fn radtan_or_none(camera: &Node<'_>, coefficients_key: &str) -> Result<[f64; 4], ConfigError> {
    let model = camera.get("distortion_model")?;
    match model.text()? {
        "radial-tangential" | "radtan" => radtan(&camera.get(coefficients_key)?, None),
        "none" => Ok([0.0; 4]),
        _ => {
            Err(model.refuse("does not go with camera_model omni", "calibrate with omni-radtan or omni-none"))
        }
    }
}

/// Refuses a distortion beside a projection that has none.
fn none(camera: &Node<'_>, projection: &str) -> Result<(), ConfigError> {
    match camera.optional("distortion_model") {
        Some(model) if model.text()? != "none" => Err(model.refuse(
            format!("does not go with camera_model {projection}"),
            format!("calibrate with {projection}-none"),
        )),
        _ => Ok(()),
    }
}

/// Radial and tangential distortion with a third radial coefficient, which only the rational model has room for.
pub(super) fn brown(k1: f64, k2: f64, p1: f64, p2: f64, k3: f64) -> Distortion {
    match k3 == 0.0 {
        true => Distortion::RadialTangential { k1, k2, p1, p2 },
        false => Distortion::Rational { k1, k2, p1, p2, k3, k4: 0.0, k5: 0.0, k6: 0.0 },
    }
}
