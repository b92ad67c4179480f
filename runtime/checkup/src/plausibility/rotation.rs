//! The rotation that images show against that of the gyroscope.
//!
//! With the right extrinsics both are the same vector, but for the gyroscope's bias and for what translation adds to
//! the images. Their correlation over a flight was 0.7 to 0.95 on real and simulated ones; with another assignment of
//! axes it is near zero or negative, and the right assignment can be told by trying all of them.

use super::Finding;
use nalgebra::{Matrix3, UnitQuaternion, Vector3};
use plumbline_config::{Config, median};

/// Fewest rotations that are judged: five seconds at 20 Hz.
const MIN_PAIRS: usize = 100;
/// Rotations vary at least so much where axes are judged, rad/s root mean square: well above the noise.
const MIN_VARIATION_RAD_S: f64 = 0.03;
/// Below this correlation the configured axes are in doubt; above the other one, and so much better, another
/// assignment convinces.
const DOUBTFUL: f64 = 0.5;
const CONVINCING: f64 = 0.6;
const BETTER: f64 = 0.3;
/// Assignments this close are told apart by which mistake is more common.
const TIE: f64 = 0.05;
/// The gyroscope turns this many times as fast as the images where it is in degrees (57.3).
const DEGREE_FACTOR: f64 = 15.0;
/// And at least so fast, rad/s: below, a bias may do it.
const MIN_DEGREE_RATE: f64 = 1.0;
/// Images that turn faster than this, rad/s, show the factor one by one, and so many of them are enough.
const CLEAR_RATE_RAD_S: f64 = 0.1;
const MIN_CLEAR: usize = 20;
/// Rates across the optical axis from which the focal length can be told, rad/s, and how many of them.
const STRONG_RATE_RAD_S: f64 = 0.3;
const MIN_STRONG: usize = 40;
/// Median of the images' rate over the gyroscope's across the optical axis: translation makes it 0.85 to 1.15.
const FOCAL_RATIO: std::ops::Range<f64> = 0.62..1.5;
/// Images that turn by a smaller share of what the gyroscope does stand still.
const STANDING_SHARE: f64 = 0.1;

/// One rotation rate, twice.
#[derive(Clone, Copy, Debug)]
pub struct RotationPair {
    /// By the images, in the left camera, rad/s.
    pub rate_c: Vector3<f64>,
    /// By the gyroscope, in the body, as it is delivered.
    pub gyro_b: Vector3<f64>,
}

/// Rotations of a flight.
#[derive(Clone, Debug)]
pub struct RotationAgreement {
    rot_c_b: Matrix3<f64>,
    pairs: Vec<RotationPair>,
}

impl RotationAgreement {
    /// For a left camera with this rotation in the body.
    #[must_use]
    pub fn new(rot_b_c: UnitQuaternion<f64>) -> Self {
        let rot_c_b = rot_b_c.inverse().to_rotation_matrix().into_inner();
        Self { rot_c_b, pairs: Vec::with_capacity(super::MAX_PAIRS) }
    }

    /// For the left camera of a configuration.
    #[must_use]
    pub fn of(config: &Config) -> Self {
        Self::new(config.camera.first().map(|camera| camera.pose_b_c().rotation).unwrap_or_default())
    }

    /// Rotations so far.
    #[must_use]
    pub fn len(&self) -> usize {
        self.pairs.len()
    }

    /// True if there are no pairs.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.pairs.is_empty()
    }

    /// Takes a rotation.
    pub fn add(&mut self, pair: RotationPair) {
        self.pairs.push(pair);
    }

    /// Finding, the most convincing first.
    #[must_use]
    pub fn finding(&self) -> Option<Finding> {
        if let Some(finding) = self.degrees_finding() {
            return Some(finding);
        }
        if self.pairs.len() < MIN_PAIRS {
            return None;
        }
        let rms = |of: &dyn Fn(&RotationPair) -> Vector3<f64>| {
            let sum: f64 = self.pairs.iter().map(|pair| of(pair).norm_squared()).sum();
            (sum / self.pairs.len() as f64).sqrt()
        };
        let (images, gyro) = (rms(&|pair| pair.rate_c), rms(&|pair| pair.gyro_b));
        if gyro > MIN_DEGREE_RATE && gyro > DEGREE_FACTOR * images {
            return Some(in_degrees(&rates(gyro, images)));
        }
        if let Some(finding) = self.standing_finding() {
            return Some(finding);
        }
        let centred = self.centred();
        let cross: Matrix3<f64> = centred.iter().map(|p| p.rate_c * p.gyro_b.transpose()).sum();
        let power = |of: &dyn Fn(&RotationPair) -> f64| centred.iter().map(of).sum::<f64>();
        let (images, gyro) = (power(&|p| p.rate_c.norm_squared()), power(&|p| p.gyro_b.norm_squared()));
        let least = MIN_VARIATION_RAD_S * MIN_VARIATION_RAD_S * centred.len() as f64;
        if images < least || gyro < least {
            return None;
        }
        let score = |rot_c_b: &Matrix3<f64>| cross.component_mul(rot_c_b).sum() / (images * gyro).sqrt();
        if score(&self.rot_c_b) < DOUBTFUL { self.axes_finding(score) } else { self.focal_finding(&centred) }
    }

    /// Finding: single rotations that images clearly show are those of a gyroscope in degrees. A driver drops
    /// its fastest samples as impossible; the slow ones that are left still show the factor.
    fn degrees_finding(&self) -> Option<Finding> {
        let clear: Vec<&RotationPair> =
            self.pairs.iter().filter(|pair| pair.rate_c.norm() > CLEAR_RATE_RAD_S).collect();
        let of = |value: &dyn Fn(&RotationPair) -> f64| median(clear.iter().map(|pair| value(pair)));
        let (images, gyro) = (of(&|pair| pair.rate_c.norm())?, of(&|pair| pair.gyro_b.norm())?);
        let ratio = of(&|pair| pair.gyro_b.norm() / pair.rate_c.norm())?;
        let is_clear = clear.len() >= MIN_CLEAR && gyro > MIN_DEGREE_RATE && ratio > DEGREE_FACTOR;
        is_clear.then(|| in_degrees(&rates(gyro, images)))
    }

    /// Finding: images stand still in some fast turns and follow others. A wrong calibration shows in all of them.
    fn standing_finding(&self) -> Option<Finding> {
        let strong = self.pairs.iter().filter(|pair| pair.gyro_b.norm() > STRONG_RATE_RAD_S);
        let stands = |pair: &&RotationPair| pair.rate_c.norm() < STANDING_SHARE * pair.gyro_b.norm();
        let (standing, moving): (Vec<&RotationPair>, Vec<&RotationPair>) = strong.partition(stands);
        (standing.len().min(moving.len()) >= MIN_STRONG).then(|| {
            Finding::new(
                STAND_STILL,
                format!("in {} of {} fast turns", standing.len(), standing.len() + moving.len()),
                "images that freeze, with noise of their own, or a gyroscope that fails",
                "look at cable, driver and load of the camera, and restart it",
            )
        })
    }

    /// The pairs less their means: a bias goes.
    fn centred(&self) -> Vec<RotationPair> {
        let n = self.pairs.len() as f64;
        let mean_c = self.pairs.iter().map(|p| p.rate_c).sum::<Vector3<f64>>() / n;
        let mean_b = self.pairs.iter().map(|p| p.gyro_b).sum::<Vector3<f64>>() / n;
        let centre = |p: &RotationPair| RotationPair { rate_c: p.rate_c - mean_c, gyro_b: p.gyro_b - mean_b };
        self.pairs.iter().map(centre).collect()
    }

    /// Finding: another assignment of axes than the configured one explains the images, by the correlation
    /// that `score` gives a rotation.
    fn axes_finding(&self, score: impl Fn(&Matrix3<f64>) -> f64) -> Option<Finding> {
        let configured = score(&self.rot_c_b);
        let convincing = CONVINCING.max(configured + BETTER);
        let inverse = score(&self.rot_c_b.transpose());
        let (assigned, axes) =
            assignments().map(|axes| (score(&(self.rot_c_b * axes)), axes)).max_by(|a, b| {
                (a.0 - TIE * rarity_of_sensor(&a.1)).total_cmp(&(b.0 - TIE * rarity_of_sensor(&b.1)))
            })?;
        let what = OTHER_AXES;
        let evidence = |as_well: f64| {
            format!("correlation {configured:.2} as configured, {as_well:.2} with the probable axes")
        };
        if inverse > convincing && inverse > assigned - TIE {
            const INVERTED: &str = "that the extrinsics are inverted (T_CB where T_BC is expected)";
            const INVERT: &str =
                "invert camera[..].pose_b_c: it takes coordinates from the camera to the IMU";
            if assigned <= inverse - TIE || assigned <= convincing {
                return Some(Finding::new(what, evidence(inverse), INVERTED, INVERT));
            }
            return Some(Finding::new(
                what,
                evidence(inverse),
                format!("{INVERTED}, or that the axes of the IMU are: as x y z it delivers {}", names(&axes)),
                format!("{INVERT}; or put the axes of the IMU in order"),
            ));
        }
        (assigned > convincing).then(|| {
            Finding::new(
                what,
                evidence(assigned),
                format!(
                    "that columns of the gyroscope are swapped or negated: as x y z it delivers {}",
                    names(&axes)
                ),
                "put the columns in order (of the accelerometer too), or the extrinsics right",
            )
        })
    }

    /// Finding: images turn much faster or slower than the gyroscope, as with a wrong focal length.
    fn focal_finding(&self, centred: &[RotationPair]) -> Option<Finding> {
        let ratio = |pair: &RotationPair| {
            let (images, gyro) = (pair.rate_c.xy(), (self.rot_c_b * pair.gyro_b).xy());
            (gyro.norm() > STRONG_RATE_RAD_S).then(|| gyro.dot(&images) / gyro.norm_squared())
        };
        let ratios: Vec<f64> = centred.iter().filter_map(ratio).collect();
        if ratios.len() < MIN_STRONG {
            return None;
        }
        let median = median(ratios)?;
        (!FOCAL_RATIO.contains(&median)).then(|| {
            Finding::new(
                OTHER_RATE,
                format!("{median:.2} times as fast across the optical axis"),
                "focal lengths of another camera or of another image size, or a wrong lens model",
                "use the calibration of this camera (camera[..].focal_px, distortion)",
            )
        })
    }
}

/// Rates of gyroscope and images, in words.
fn rates(gyro: f64, images: f64) -> String {
    format!("rate {gyro:.2} by the gyroscope, {images:.3} rad/s by the images")
}

/// Finding about columns of the gyroscope or about extrinsics.
pub const OTHER_AXES: &str = "the gyroscope and the images turn about different axes";
/// Finding about focal lengths.
pub const OTHER_RATE: &str = "the images turn at another rate than the gyroscope";
/// Finding about images that freeze.
pub const STAND_STILL: &str = "the images stand still while the gyroscope turns";
/// Finding about a gyroscope in degrees.
pub const IN_DEGREES: &str = "the gyroscope turns faster than a vehicle can, or than the images";

/// The gyroscope is in degrees.
pub(super) fn in_degrees(evidence: &str) -> Finding {
    Finding::new(
        IN_DEGREES,
        evidence,
        "that it is in degrees a second",
        "multiply it by pi/180: rad/s is expected",
    )
}

/// All assignments of three columns with all signs but the one that changes nothing.
pub(crate) fn assignments() -> impl Iterator<Item = Matrix3<f64>> {
    const ORDERS: [[usize; 3]; 6] = [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]];
    let all = ORDERS.into_iter().flat_map(|order| (0..8).map(move |signs| (order, signs)));
    all.skip(1).map(|(order, signs)| {
        let mut axes = Matrix3::zeros();
        for (row, column) in order.into_iter().enumerate() {
            axes[(row, column)] = if signs >> row & 1 == 1 { -1.0 } else { 1.0 };
        }
        axes
    })
}

/// Rarity of a mistake of the whole sensor: that of its columns, but half a turn of the mounting is common.
fn rarity_of_sensor(axes: &Matrix3<f64>) -> f64 {
    let is_half_turn = axes.trace() == -1.0 && axes.diagonal().iter().all(|x| *x != 0.0);
    if is_half_turn { 0.5 } else { rarity(axes) }
}

/// Rarity of a mistake of columns: the number of signs that it changes, and half of one when no axis stays in
/// its place.
pub(super) fn rarity(axes: &Matrix3<f64>) -> f64 {
    let stays = axes.diagonal().iter().any(|x| *x != 0.0);
    axes.iter().filter(|x| **x < 0.0).count() as f64 + if stays { 0.0 } else { 0.5 }
}

/// Columns in which x, y and z of the body are delivered, such as `y x z`.
pub(super) fn names(axes: &Matrix3<f64>) -> String {
    let name = |column: usize| {
        let row = (0..3).find(|row| axes[(*row, column)] != 0.0).unwrap_or(column);
        format!("{}{}", if axes[(row, column)] < 0.0 { "-" } else { "" }, ["x", "y", "z"][row])
    };
    (0..3).map(name).collect::<Vec<_>>().join(" ")
}
