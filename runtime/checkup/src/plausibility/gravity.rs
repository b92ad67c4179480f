//! Rotation of gravity in the accelerometer against that of the gyroscope.
//!
//! The mean of the specific force over two seconds is gravity, but for what the vehicle accelerates. Turned back by the
//! gyroscope, the means of a few seconds are one vector where both sensors have the same axes. With another assignment of the
//! accelerometer's columns they turn with the vehicle. The means are linear in the assignment, and nearly so in the bias of the
//! gyroscope: sums of a few seconds hold all assignments at once. The bias is estimated with each, so that it misleads none.
//!
//! An accelerometer that is negated altogether turns as one that is right: the mounting shows it.

use super::Finding;
use super::rotation::{assignments, names, rarity};
use crate::mounting::UPSIDE_DOWN_CAUSE;
use crate::verdict::{Fitness, Measure};
use nalgebra::{Matrix3, Matrix4, SMatrix, SVector, UnitQuaternion, Vector3};
use plumbline_config::{ImuSample, Timestamp};

/// Name of the measure.
pub const NAME: &str = "accelerometer axes";
/// Finding about columns of the accelerometer.
pub const DISAGREE: &str = "gyroscope and accelerometer disagree on how gravity turns";
/// Finding about a vehicle that is upside down all the time.
pub const UPSIDE_DOWN: &str = "gravity points upwards in the vehicle";
/// Length of a mean, s.
const MEAN_S: f64 = 2.0;
/// Means that are compared with each other.
const MEANS: usize = 3;
/// Comparisons that are held: a minute.
const MAX_COMPARED: usize = 10;
/// Samples further apart begin anew, s.
const MAX_GAP_S: f64 = 0.1;
/// Standard deviation of the gyroscope's bias, rad/s, and of a mean by what the vehicle accelerates, m/s².
const BIAS_RAD_S: f64 = 0.1;
const MEAN_M_S2: f64 = 1.0;
/// Scatter below which nothing is said, m/s², of many comparisons; of one it is twice as much. Real and simulated vehicles
/// scattered by 0.3 to 1.2.
const LEAST_M_S2: f64 = 0.75;
/// An assignment explains gravity better where it leaves this share of the scatter.
const BETTER: f64 = 0.6;
/// Assignments are told apart from this ratio of their scatter on; below, the more common mistake is named.
const TIE: f64 = 1.3;
/// Share of the other assignments that must be excluded for a verdict.
const EXCLUDED: f64 = 0.75;
/// Cosine of the angle between the mean of the specific force and the vehicle's vertical beyond which it is upside down.
const DOWN: f64 = -0.8;
/// Time over which it is, s.
const DOWN_S: f64 = 5.0;

/// Mean of the specific force as a linear function of the assignment of columns (column `3 k + j` is what column `k` of the
/// accelerometer adds where it stands for axis `j`), and after that its derivatives by the three axes of the gyroscope's bias.
type Mean = SMatrix<f64, 3, 36>;

/// Sums of a flight.
#[derive(Clone, Debug)]
pub struct GravityTurns {
    /// Rotation from the body to what it was when the comparison began, and its integral, s.
    rot_0_b: UnitQuaternion<f64>,
    rotation_s: Matrix3<f64>,
    last: Option<ImuSample>,
    mean_begin: Option<Timestamp>,
    sum: (Mean, f64),
    means: Vec<Mean>,
    /// Quadratic form of the scatter of the means.
    scatter: Box<SMatrix<f64, 36, 36>>,
    compared: usize,
    /// Sum of the specific force over time, and that time, s.
    force: (Vector3<f64>, f64),
}

impl Default for GravityTurns {
    fn default() -> Self {
        Self {
            rot_0_b: UnitQuaternion::identity(),
            rotation_s: Matrix3::zeros(),
            last: None,
            mean_begin: None,
            sum: (Mean::zeros(), 0.0),
            means: Vec::with_capacity(MEANS),
            scatter: Box::new(SMatrix::zeros()),
            compared: 0,
            force: (Vector3::zeros(), 0.0),
        }
    }
}

impl GravityTurns {
    /// The sums of these samples.
    #[must_use]
    pub fn of(samples: &[ImuSample]) -> Self {
        let mut turns = Self::default();
        samples.iter().for_each(|sample| turns.add(sample));
        turns
    }

    /// Takes a sample.
    pub fn add(&mut self, sample: &ImuSample) {
        if self.compared == MAX_COMPARED || !sample.is_finite() {
            return;
        }
        if let Some(last) = self.last.replace(*sample) {
            let dt_s = sample.stamp.seconds_since(last.stamp);
            if dt_s <= 0.0 || dt_s > MAX_GAP_S {
                self.begin();
            } else {
                self.rot_0_b *= UnitQuaternion::from_scaled_axis(0.5 * (last.gyro + sample.gyro) * dt_s);
                self.rotation_s += self.rot_0_b.to_rotation_matrix().into_inner() * dt_s;
                self.force.0 += sample.accel * dt_s;
                self.force.1 += dt_s;
            }
        }
        let begin = *self.mean_begin.get_or_insert(sample.stamp);
        if sample.stamp.seconds_since(begin) >= MEAN_S {
            self.end_mean(sample.stamp);
        }
        self.sum.0 += self.contribution(&sample.accel);
        self.sum.1 += 1.0;
    }

    /// Contribution of a sample to a mean.
    fn contribution(&self, accel: &Vector3<f64>) -> Mean {
        let rotation = self.rot_0_b.to_rotation_matrix();
        Mean::from_columns(&std::array::from_fn::<_, 36, _>(|column| {
            let (bias, k, j) = (column / 9, column % 9 / 3, column % 3);
            let force: Vector3<f64> = rotation.matrix().column(j) * accel[k];
            // A bias turned what is turned back, by its integral.
            if bias == 0 { force } else { force.cross(&self.rotation_s.column(bias - 1)) }
        }))
    }

    /// Forgets the means that were not compared yet.
    fn begin(&mut self) {
        (self.rot_0_b, self.rotation_s) = (UnitQuaternion::identity(), Matrix3::zeros());
        (self.mean_begin, self.sum) = (None, (Mean::zeros(), 0.0));
        self.means.clear();
    }

    fn end_mean(&mut self, now: Timestamp) {
        self.means.push(self.sum.0 / self.sum.1.max(1.0));
        (self.mean_begin, self.sum) = (Some(now), (Mean::zeros(), 0.0));
        if self.means.len() < MEANS {
            return;
        }
        let middle = self.means.iter().sum::<Mean>() / MEANS as f64;
        for mean in &self.means {
            let apart = mean - middle;
            *self.scatter += apart.transpose() * apart / MEANS as f64;
        }
        self.compared += 1;
        self.begin();
        self.mean_begin = Some(now);
    }

    /// Root mean square of the scatter of gravity with this assignment, m/s²: what the best bias of the gyroscope leaves.
    fn scatter_m_s2(&self, axes: &Matrix3<f64>) -> f64 {
        let axes = SVector::<f64, 9>::from_column_slice(axes.as_slice());
        let form = Matrix4::from_fn(|a, b| axes.dot(&(self.scatter.fixed_view::<9, 9>(9 * a, 9 * b) * axes)));
        let prior = self.compared as f64 * (MEAN_M_S2 / BIAS_RAD_S).powi(2);
        let normal: Matrix3<f64> = form.fixed_view::<3, 3>(1, 1) + Matrix3::identity() * prior;
        let by_bias: Vector3<f64> = form.fixed_view::<3, 1>(1, 0).into_owned();
        let bias = normal.cholesky().map_or(Vector3::zeros(), |normal| normal.solve(&by_bias));
        ((form[(0, 0)] - bias.dot(&by_bias)) / self.compared.max(1) as f64).max(0.0).sqrt()
    }

    /// Scatter below which nothing is said, m/s².
    fn least_m_s2(&self) -> f64 {
        LEAST_M_S2 * (1.0 + 1.0 / self.compared.max(1) as f64)
    }

    /// The scatter with every other assignment. Gravity and its opposite turn alike: the sign of all is left out.
    fn others(&self) -> impl Iterator<Item = (f64, Matrix3<f64>)> {
        let all = assignments().filter(|axes| *axes != -Matrix3::identity());
        all.map(|axes| (self.scatter_m_s2(&axes), axes))
    }

    /// Finding: another assignment of the accelerometer's columns explains how gravity turns, for an IMU with
    /// this mounting.
    #[must_use]
    pub fn finding(&self, rot_v_b: Option<UnitQuaternion<f64>>) -> Option<Finding> {
        let configured = self.scatter_m_s2(&Matrix3::identity());
        if self.compared == 0 || configured < self.least_m_s2() {
            return None;
        }
        let least = self.others().map(|(scatter, _)| scatter).min_by(f64::total_cmp)?;
        if least > BETTER * configured {
            return None;
        }
        let is_upright =
            |axes: &Matrix3<f64>| rot_v_b.is_none_or(|rot| (rot * (axes * self.force.0)).z > 0.0);
        let candidates = self.others().filter(|(scatter, _)| *scatter <= TIE * least);
        let unlikely =
            |(_, axes): &(f64, Matrix3<f64>)| rarity(axes) + if is_upright(axes) { 0.0 } else { 3.0 };
        let (scatter, axes) = candidates.min_by(|a, b| unlikely(a).total_cmp(&unlikely(b)))?;
        Some(Finding::new(
            DISAGREE,
            format!(
                "gravity varies by {configured:.2} m/s^2 as configured, by {scatter:.2} with the probable columns"
            ),
            format!(
                "that columns of the accelerometer are swapped or negated: as x y z it delivers {}",
                names(&axes)
            ),
            "put the columns in order",
        ))
    }

    /// Finding: the vehicle would be upside down all the time.
    #[must_use]
    pub fn upside_down(&self, rot_v_b: Option<UnitQuaternion<f64>>) -> Option<Finding> {
        let (force, seconds) = self.force;
        let up_v = (rot_v_b? * force).try_normalize(1e-3).filter(|_| seconds >= DOWN_S)?;
        (up_v.z < DOWN).then(|| {
            Finding::new(
                UPSIDE_DOWN,
                format!(
                    "over {seconds:.0} s its mean is {:.0} degrees off",
                    up_v.angle(&Vector3::z()).to_degrees()
                ),
                UPSIDE_DOWN_CAUSE,
                "negate the accelerometer, or correct `vehicle.imu_to_vehicle_deg`",
            )
        })
    }

    /// Agreement of gravity's rotation with the gyroscope, where nothing is wrong.
    #[must_use]
    pub fn judge(&self) -> Measure {
        let configured = self.scatter_m_s2(&Matrix3::identity());
        let limit = self.least_m_s2().max(configured / BETTER);
        let (excluded, all) = self.others().fold((0.0, 0.0), |(excluded, all), (scatter, _)| {
            (excluded + if scatter > limit { 1.0 } else { 0.0 }, all + 1.0)
        });
        if self.compared == 0 || excluded < EXCLUDED * all {
            return Measure::missing(
                NAME,
                "too little turning to compare gravity with the gyroscope",
                "turn the vehicle by hand about all axes, by 30 degrees and more",
            );
        }
        let seconds = self.compared as f64 * MEAN_S * MEANS as f64;
        let value =
            format!("gravity turns as the gyroscope does, within {configured:.2} m/s² over {seconds:.0} s");
        Measure::new(NAME, Fitness::Good, value, "", &[("scatter_m_s2", configured), ("compared_s", seconds)])
    }
}

#[cfg(test)]
mod tests;
