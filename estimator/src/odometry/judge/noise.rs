//! Scale of the accelerometer's noise by running normalized innovations.
//!
//! With consistent noise the correction `d` that a frame makes to the predicted velocity has the covariance by which the frame
//! lowers that of the prediction, `P_predicted - P_updated` (Mohamed and Schwarz 1999, "Adaptive Kalman filtering for INS/GPS").
//! Running means of `|d|²` and of that trace therefore have the ratio 1, and less with the cautious noise that presets state. Forces that the
//! stated noise does not explain raise it. The noise of new inertial factors then grows, until the ratio is back, and shrinks more slowly;
//! never below what is stated. It begins large: a tilt that was taken for certain before the first second had told what the forces are
//! worth would stay in the prior.

use super::SHOWS_S;
use super::leaning::{Corrected, Leaning};
use crate::estimate::HealthBits;
use crate::inertial::{ImuNoise, Preintegration};
use crate::window::Window;
use crate::window::growth::GrowingCovariance;
use crate::window::state::{FrameMatrix, NavState};
use nalgebra::Vector3;
use plumbline_config::Portable;

/// Time constant of the running means, and of a scale that shrinks, s.
const MEMORY_S: f64 = 1.0;
/// Speed of the scale's growth relative to its decay.
const GROWTH: f64 = 4.0;
/// A single innovation counts as at most this multiple of what is expected: a knock is no noise.
const MOST_IN_A_FRAME: f64 = 25.0;
/// Largest change of the logarithm of the variance in a time constant.
const MOST_LOG_CHANGE: f64 = 4.0;
/// Variance at first, as a multiple of the stated one.
const FIRST_VARIANCE: f64 = 100.0;
/// Largest variance, as a multiple of the stated one: vibration of 30 m/s² against the noise of a data sheet.
const MOST_VARIANCE: f64 = 1e7;
/// Largest walk of the bias that a scale leads to, m/s³/sqrt(Hz): forces that last seconds, at most. With more the bias would
/// follow the vibration to where it is taken for diverged.
const MOST_WALK: f64 = 0.03;
/// Variance from which it applies.
const APPLIED_VARIANCE: f64 = 1.5;
/// Variance from which it is reported, once it has been judged for [`REPORTED_AFTER_S`].
const REPORTED_VARIANCE: f64 = 4.0;
/// Time after which the initial value has been forgotten, s.
const REPORTED_AFTER_S: f64 = 3.0;

/// Running means of squared innovations of a vector and of what is expected of them.
#[derive(Clone, Copy, Debug, Default)]
struct Innovations {
    squared: f64,
    expected: f64,
}

impl Innovations {
    /// Takes an innovation; `share` is the weight of the newest.
    fn add(&mut self, share: f64, squared: f64, expected: f64) {
        let expected = expected.at_least(0.0);
        let most = MOST_IN_A_FRAME * expected.at_least(self.expected);
        self.squared += share * (squared.at_most(most) - self.squared);
        self.expected += share * (expected - self.expected);
    }

    fn ratio(&self) -> f64 {
        if self.expected > 0.0 { self.squared / self.expected } else { 0.0 }
    }
}

/// Variance of forces against the stated one, 1 or more, by what frames correct of the velocity.
#[derive(Clone, Copy, Debug)]
struct Scale {
    velocity: Innovations,
    variance: f64,
}

impl Scale {
    /// Takes a correction of the velocity; images that contradict each other have the ratio `by_images`.
    fn add(&mut self, share: f64, squared: f64, expected: f64, by_images: f64) {
        self.velocity.add(share, squared, expected);
        let excess = libm::log((self.velocity.ratio() / by_images).at_least(1e-3));
        let gain = if excess > 0.0 { GROWTH } else { 1.0 };
        self.multiply(gain * share * excess.clamp(-MOST_LOG_CHANGE, MOST_LOG_CHANGE));
    }

    fn multiply(&mut self, log_change: f64) {
        self.variance = (self.variance * libm::exp(log_change)).clamp(1.0, MOST_VARIANCE);
    }
}

/// Scale of the accelerometer's noise, and the covariance of the newest state by which innovations are judged.
#[derive(Clone, Debug)]
pub(super) struct NoiseScale {
    stated: ImuNoise,
    /// By all corrections, and by what no errors of stamps explain.
    of_factors: Scale,
    reported: Scale,
    /// Time it has been judged for, s.
    judged_s: f64,
    position: Innovations,
    /// Covariance of the newest state and its biases; `None` before the first.
    newest: Option<FrameMatrix>,
}

/// A state before its frame was looked at.
#[derive(Clone, Debug)]
pub(in crate::odometry) struct Prediction {
    pub(in crate::odometry) nav: NavState,
    /// Covariance of state and biases; `None` in the first frame of an estimate.
    pub(in crate::odometry) covariance: Option<FrameMatrix>,
    pub(super) dt_s: f64,
}

/// Evidence of a frame about the noise.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Evidence {
    /// Nothing: its motion was not measured throughout, or is not believed for another reason.
    None,
    /// Its innovation.
    Innovation,
    /// The images contradicted its motion as a whole.
    Contradiction,
}

impl Prediction {
    /// Standard deviation of the velocity in its worst direction, at most, m/s.
    pub(super) fn velocity_sigma_m_s(&self) -> Option<f64> {
        let covariance = self.covariance.as_ref()?;
        let variance: f64 = (NavState::V..NavState::V + 3).map(|k| covariance[(k, k)]).sum();
        (variance >= 0.0).then(|| variance.sqrt())
    }
}

impl NoiseScale {
    /// Noise assumed of a sensor with `stated` noise before the first frame. With one camera the noise stays as stated.
    pub(super) fn new(stated: ImuNoise, cameras: usize) -> Self {
        let variance = if cameras > 1 { FIRST_VARIANCE } else { 1.0 };
        let position = Innovations::default();
        let scale = Scale { velocity: position, variance };
        Self { stated, of_factors: scale, reported: scale, judged_s: 0.0, position, newest: None }
    }

    /// Forgets the state, as at a reset. The scale stays: it is the sensor's.
    pub(super) fn forget_state(&mut self) {
        (self.position, self.of_factors.velocity, self.reported.velocity) = Default::default();
        self.newest = None;
    }

    /// Forgets what the sensor's noise is beyond the stated one.
    pub(super) fn forget_scale(&mut self, window: &mut Window) {
        *self = Self::new(self.stated, window.options.cameras);
        window.imu_noise = self.stated;
        window.options.point_sigma = 1.0;
    }

    /// Takes the correction `d` of position, m, and velocity, m/s, that lowered the covariance of a state of velocity `v_o` from `before` to
    /// `after`. Errors of this stamp and the one before, too small to show, correct both along the way: what they explain is not the forces'.
    fn add(
        &mut self,
        dt_s: f64,
        d: &[Vector3<f64>; 2],
        [before, after]: [&FrameMatrix; 2],
        v_o: &Vector3<f64>,
    ) {
        let gained = |part: usize| (part..part + 3).map(|k| before[(k, k)] - after[(k, k)]).sum::<f64>();
        let by_stamps = 2.0 * v_o.norm_squared() * SHOWS_S.squared();
        let of_stamps = by_stamps / (by_stamps + gained(NavState::P).at_least(f64::MIN_POSITIVE) / 3.0);
        let along = v_o.try_normalize(0.0).unwrap_or_default();
        let beyond = d[1].norm_squared() - of_stamps * d[1].dot(&along).squared();
        let share = (dt_s / MEMORY_S).at_most(1.0);
        self.position.add(share, d[0].norm_squared(), gained(NavState::P));
        let by_images = self.position.ratio().at_least(1.0);
        self.of_factors.add(share, d[1].norm_squared(), gained(NavState::V), by_images);
        self.reported.add(share, beyond, gained(NavState::V), by_images);
        self.judged_s += dt_s;
    }

    /// Takes a motion of `dt_s` that the images contradicted as a whole: its innovation cannot be judged by what was predicted.
    fn add_contradiction(&mut self, dt_s: f64) {
        let share = (dt_s / MEMORY_S).at_most(1.0);
        self.of_factors.multiply(share * MOST_LOG_CHANGE);
        self.reported.multiply(share * MOST_LOG_CHANGE);
        self.judged_s += dt_s;
    }

    /// The noise as the configuration states it.
    pub(super) fn stated(&self) -> &ImuNoise {
        &self.stated
    }

    /// The noise of new factors: as stated, bit for bit, until that is plainly too little.
    pub(super) fn noise(&self) -> ImuNoise {
        if self.of_factors.variance < APPLIED_VARIANCE {
            return self.stated;
        }
        let sigma = self.of_factors.variance.sqrt();
        let ImuNoise { accel_density, accel_walk, .. } = self.stated;
        let most_walk = MOST_WALK.at_least(accel_walk);
        ImuNoise {
            accel_density: accel_density * sigma,
            accel_walk: (accel_walk * sigma).at_most(most_walk),
            ..self.stated
        }
    }

    /// Mean square of what frames correct, as a multiple of what is expected; 1 at least.
    pub(super) fn disagreement(&self) -> f64 {
        self.position.ratio().at_least(self.of_factors.velocity.ratio()).at_least(1.0)
    }

    /// True if the forces are plainly noisier than stated.
    fn is_reported(&self) -> bool {
        self.reported.variance > REPORTED_VARIANCE && self.judged_s > REPORTED_AFTER_S
    }

    /// Covariance of the newest state, carried on by the `motion` from `nav`.
    fn carried(&self, nav: &NavState, motion: &Preintegration, noise: &ImuNoise) -> Option<FrameMatrix> {
        let mut grown = GrowingCovariance::of_frame(self.newest.as_ref()?);
        grown.grow(nav, motion, noise);
        Some(grown.of_all())
    }

    /// Prediction of the frame at the end of `motion`, which begins at `from`.
    pub(super) fn predict(&self, window: &Window, from: &NavState, motion: &Preintegration) -> Prediction {
        Prediction {
            nav: from.after(motion, &window.options.gravity_o),
            covariance: self.carried(from, motion, &window.imu_noise),
            dt_s: motion.dt_s,
        }
    }

    /// Scales the inertial noise of new factors by what the newest frame corrected of its `prediction`, which `leaning` takes as well.
    pub(super) fn learn(
        &mut self,
        window: &mut Window,
        prediction: &Prediction,
        (evidence, leaning): (Evidence, &mut Leaning),
        health: &mut HealthBits,
    ) {
        let after = window.covariance_of_newest().filter(|c| c.iter().all(|x| x.is_finite()));
        let before = prediction.covariance.as_ref().filter(|c| c.iter().all(|x| x.is_finite()));
        match (evidence, before, &after, window.frames.last()) {
            (Evidence::Contradiction, ..) => self.add_contradiction(prediction.dt_s),
            (Evidence::Innovation, Some(before), Some(after), Some(newest)) => {
                let states = [&prediction.nav, &newest.nav];
                let (stamp, dt_s) = (newest.stamp, prediction.dt_s);
                leaning.add(&Corrected { stamp, dt_s, states, covariances: [before, after] });
                let [expected, nav] = states;
                let d = [nav.p_o_b - expected.p_o_b, nav.v_o_b - expected.v_o_b];
                if d.iter().flatten().all(|x| x.is_finite()) {
                    self.add(dt_s, &d, [before, after], &nav.v_o_b);
                }
            }
            _ => {}
        }
        self.newest = after;
        window.imu_noise = self.noise();
        if self.is_reported() {
            health.insert(HealthBits::ACCEL_NOISY);
        }
    }

    /// Keeps the prediction as the state's covariance where the frame tells nothing of it.
    pub(super) fn keep_prediction(&mut self, prediction: Prediction) {
        self.newest = prediction.covariance;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STATED: ImuNoise = ImuNoise {
        gyro_density: 1e-4,
        accel_density: 1e-3,
        gyro_walk: 1e-5,
        accel_walk: 1e-4,
        ..ImuNoise::NONE
    };

    /// Twenty seconds of frames whose corrections of the velocity are these multiples of the expected ones, and of the position the
    /// half.
    fn after(velocity: impl Fn(usize) -> f64) -> NoiseScale {
        let mut scale = NoiseScale::new(STATED, 2);
        let (before, after) = (FrameMatrix::identity() * 2.0, FrameMatrix::identity());
        for k in 0..400 {
            let d = [0.5, velocity(k)].map(Vector3::repeat);
            scale.add(0.05, &d, [&before, &after], &Vector3::zeros());
        }
        scale
    }

    #[test]
    fn begins_with_ten_times_the_stated_noise_and_one_camera_with_the_stated_one() {
        let scale = NoiseScale::new(STATED, 2);
        assert!(
            (scale.noise().accel_density - 10.0 * STATED.accel_density).abs() < 1e-12 && !scale.is_reported()
        );
        assert_eq!(NoiseScale::new(STATED, 1).noise(), STATED);
    }

    #[test]
    fn comes_to_the_stated_noise_while_innovations_are_as_expected() {
        let scale = after(|_| 0.5);
        assert_eq!((scale.noise(), scale.is_reported()), (STATED, false));
    }

    #[test]
    fn grows_with_velocities_that_the_stated_noise_does_not_explain() {
        let scale = after(|_| 2.0);
        assert!(scale.noise().accel_density > 5e-3 && scale.noise().accel_walk > 5e-4 && scale.is_reported());
        assert_eq!(scale.noise().gyro_density.to_bits(), STATED.gyro_density.to_bits());
        assert!(scale.of_factors.variance <= MOST_VARIANCE);
    }

    #[test]
    fn what_stamps_explain_along_the_way_is_not_reported() {
        let reports = |d: Vector3<f64>| {
            let mut scale = NoiseScale::new(STATED, 2);
            let (before, after) = (FrameMatrix::identity() * 2e-6, FrameMatrix::identity() * 1e-6);
            // 0.8 ms at 3 m/s are 2.4 mm, of which 1 mm is explained otherwise.
            let v_o = Vector3::x() * 3.0;
            for _ in 0..400 {
                scale.add(0.05, &[Vector3::repeat(5e-4), d], [&before, &after], &v_o);
            }
            assert!(scale.noise().accel_density > 2.0 * STATED.accel_density, "factors take it in");
            scale.is_reported()
        };
        assert!(!reports(Vector3::x() * 4e-3) && reports(Vector3::y() * 4e-3));
    }

    #[test]
    fn the_bias_never_walks_as_fast_as_vibration() {
        assert!((after(|_| 20.0).noise().accel_walk - MOST_WALK).abs() < 1e-12);
    }

    #[test]
    fn returns_to_the_stated_noise_afterwards() {
        let scale = after(|k| if k < 40 { 2.0 } else { 0.3 });
        assert_eq!(scale.noise(), STATED);
    }

    #[test]
    fn grows_with_motions_that_images_contradict_for_seconds() {
        let mut scale = after(|_| 0.5);
        scale.add_contradiction(0.05);
        assert!(!scale.is_reported());
        (0..100).for_each(|_| scale.add_contradiction(0.05));
        assert!((scale.of_factors.variance / MOST_VARIANCE - 1.0).abs() < 1e-9);
    }

    #[test]
    fn a_single_knock_is_no_noise() {
        let scale = after(|k| if k == 399 { 1e3 } else { 0.4 });
        assert!(!scale.is_reported(), "{}", scale.reported.variance);
    }
}
