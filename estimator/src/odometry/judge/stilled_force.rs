//! Forces that stop changing.
//!
//! An accelerometer that freezes goes on with the force that it last felt, and noise. The images contradict it once the vehicle has
//! accelerated otherwise by metres per second squared; until then the velocity is off by centimetres per second, and nothing shows it but
//! that the force no longer changes as it used to, from one frame to the next, by more than its noise. An axis that does so by chance, in
//! every tenth frame, has gone on with its changes before they would have made a difference.
//!
//! An axis that is still in most frames of a second, while another one moves and it usually felt more than noise itself, measures nothing. Where
//! the readings of all axes are noise, the images tell whether the vehicle moves ([`super::scale_watch`]).

use crate::inertial::Preintegration;
use nalgebra::{Matrix3, UnitQuaternion, Vector3};
use plumbline_config::{Portable, Timestamp};

/// Time constant of the mean squares of the changes, s, and their beginning, m²/s⁶.
const MEMORY_S: f64 = 2.0;
const FIRST_SQUARE: f64 = 4.0;
/// A force has not changed if it did so by less than this share of what is usual, or by less than so many standard deviations of its noise;
/// what is usual must be larger than noise by as much more.
const STILL_SHARE: f64 = 0.15;
const NOISE_SIGMAS: f64 = 2.5;
const NOISE_SHARE: f64 = 0.4;
/// Frames on end without a change of one axis that make the velocity uncertain; of all three it takes one. So much time counts at most, s.
const FRAMES_OF_AXIS: u32 = 2;
const MOST_S: f64 = 0.4;
/// An axis that has been still in so many of the last frames, while another one has in half of them at most, measures nothing, until it has been
/// in no more than half of them.
const LAST_FRAMES: u32 = 20;
const SILENT_IN: u32 = 15;
/// Noise is less than this share of what it usually feels. From so many quiet frames on, frames count as little for what is usual.
const SILENT_SHARE: f64 = 0.45;
const QUIET_IN: u32 = 9;
const QUIET_SHARE: f64 = 0.1;
/// Largest quality while an axis is silent.
const SILENT_QUALITY: i8 = 10;
/// Readings are noise if their means over frames scatter by less than so many times the configured noise, and than noise of this density,
/// m/s²/sqrt(Hz): what vehicles feel in flight has 0.04 and more. The time constant, s, and the fewest frames.
const SILENT_NOISE: f64 = 3.0;
const MOST_SILENT: f64 = 0.03;
const SILENT_S: f64 = 3.0;
const SILENT_FRAMES: f64 = 20.0;
/// Images have contradicted a force that did not act after this time, s.
const HELD_S: f64 = 0.3;
/// Standard deviation of the velocity, as a share of what the usual changes would have added.
const SIGMA_SHARE: f64 = 0.3;

/// Scatter of the mean forces of frames.
#[derive(Clone, Copy, Debug, Default)]
struct Spread {
    frames: f64,
    mean_b: Vector3<f64>,
    /// As the square of a density of noise, by axis, m²/s⁴/Hz.
    density_squared: Vector3<f64>,
}

impl Spread {
    fn add(&mut self, force_b: &Vector3<f64>, dt_s: f64) {
        self.frames += 1.0;
        let share = (dt_s / SILENT_S).at_least(1.0 / self.frames).at_most(1.0);
        let off = force_b - self.mean_b;
        self.mean_b += off * share;
        self.density_squared +=
            (off.component_mul(&off) * (dt_s * (1.0 - share)) - self.density_squared) * share;
    }
}

/// Watches the mean forces of frames for axes that stop changing.
#[derive(Clone, Debug)]
pub(super) struct StilledForce {
    /// Density of the sensor's noise by the configuration, m/s²/sqrt(Hz).
    density: f64,
    /// Mean squares of the changes of the force along the axes of the body, m²/s⁶.
    mean_square: Vector3<f64>,
    spread: Spread,
    /// Mean force of the last frame, m/s² in `B`.
    force_b: Option<Vector3<f64>>,
    /// Frames on end in which an axis has not changed, and their time, s.
    still: [(u32, f64); 3],
    /// The last frames in which an axis has not changed by more than noise, a bit each, and whether it is silent.
    within_noise: [u32; 3],
    /// Mean squares of the changes that an axis has felt, m²/s⁶, and the mean bound of noise, m/s³: after missing frames it is lower.
    felt_square: Vector3<f64>,
    usual_noise: f64,
    is_silent: [bool; 3],
    /// Standard deviations of the velocity, m/s, with the axes of the body in `O`, and when they were last renewed.
    held: Option<(Timestamp, Vector3<f64>, Matrix3<f64>)>,
}

impl StilledForce {
    /// For a sensor whose noise has the density `density` by the configuration, m/s²/sqrt(Hz).
    pub(super) fn new(density: f64) -> Self {
        Self {
            density,
            mean_square: Vector3::repeat(FIRST_SQUARE),
            spread: Spread::default(),
            force_b: None,
            still: [(0, 0.0); 3],
            within_noise: [0; 3],
            felt_square: Vector3::zeros(),
            usual_noise: 0.0,
            is_silent: [false; 3],
            held: None,
        }
    }

    /// Forgets everything but the sensor.
    pub(super) fn clear(&mut self) {
        *self = Self::new(self.density);
    }

    /// True if the readings of all axes have been noise for a while: a sensor that measures nothing, or a vehicle that stands or flies evenly.
    pub(super) fn is_silent(&self) -> bool {
        let of_noise = (SILENT_NOISE * self.density).at_most(MOST_SILENT);
        self.spread.frames >= SILENT_FRAMES && self.spread.density_squared.max() < of_noise.squared()
    }

    /// Forgets the forces, as where their motion was not measured. What is usual stays.
    pub(super) fn forget_forces(&mut self) {
        (self.force_b, self.still) = (None, [(0, 0.0); 3]);
    }

    /// Takes the `motion` to the frame of `stamp` from one with attitude `rot_o_before`; `density` is that of the noise, m/s²/sqrt(Hz).
    pub(super) fn update(
        &mut self,
        stamp: Timestamp,
        rot_o_before: &UnitQuaternion<f64>,
        motion: &Preintegration,
        density: f64,
    ) {
        let force_b = motion.delta_v / motion.dt_s;
        if !force_b.iter().all(|x| x.is_finite()) {
            return self.forget_forces();
        }
        self.spread.add(&force_b, motion.dt_s);
        let Some(before) = self.force_b.replace(force_b) else { return };
        let change = (force_b - before) / motion.dt_s;
        let usual = self.mean_square.map(f64::sqrt);
        let noise = NOISE_SIGMAS * density * (2.0 / motion.dt_s).sqrt() / motion.dt_s;
        for (axis, still) in self.still.iter_mut().enumerate() {
            let bound = noise.at_least(STILL_SHARE * usual[axis]);
            let is_still = change[axis].abs() < bound && noise < NOISE_SHARE * usual[axis];
            *still = if is_still { (still.0 + 1, (still.1 + motion.dt_s).at_most(MOST_S)) } else { (0, 0.0) };
        }
        let share = (motion.dt_s / MEMORY_S).at_most(1.0);
        self.judge_axes(&change, noise, share);
        self.mean_square += (change.component_mul(&change) - self.mean_square) * share;
        let is_all = self.still.iter().all(|(frames, _)| *frames > 0);
        let sigmas = Vector3::from_fn(|axis, _| {
            let (frames, time_s) = self.still[axis];
            let counts = is_all || frames >= FRAMES_OF_AXIS;
            if counts { SIGMA_SHARE * 0.5 * time_s.squared() * usual[axis] } else { 0.0 }
        });
        let held = self.held.filter(|(last, ..)| stamp.seconds_since(*last) < HELD_S);
        let is_larger = held.is_none_or(|(_, held, _)| sigmas.norm_squared() >= held.norm_squared());
        self.held = match held {
            _ if is_larger && sigmas.norm_squared() > 0.0 => {
                Some((stamp, sigmas, rot_o_before.to_rotation_matrix().into_inner()))
            }
            held => held,
        };
    }

    /// Judges which axes are silent, by the newest `change`, m/s³, and what noise makes of it; `share` is the weight of the newest.
    fn judge_axes(&mut self, change: &Vector3<f64>, noise: f64, share: f64) {
        for (axis, frames) in self.within_noise.iter_mut().enumerate() {
            let newest = u32::from(change[axis].abs() < noise);
            *frames = (*frames << 1 | newest) & ((1 << LAST_FRAMES) - 1);
            // What an axis feels is hardly unlearnt while it may have fallen silent.
            let share = if frames.count_ones() >= QUIET_IN { QUIET_SHARE * share } else { share };
            self.felt_square[axis] += (change[axis].squared() - self.felt_square[axis]) * share;
        }
        self.usual_noise += (noise - self.usual_noise) * share;
        let noise = noise.at_least(self.usual_noise);
        let counts = self.within_noise.map(u32::count_ones);
        let is_moved = counts.iter().any(|count| *count <= LAST_FRAMES / 2);
        for (axis, is_silent) in self.is_silent.iter_mut().enumerate() {
            let falls_silent =
                counts[axis] >= SILENT_IN && is_moved && noise < SILENT_SHARE * self.felt_square[axis].sqrt();
            *is_silent = falls_silent || (*is_silent && counts[axis] > LAST_FRAMES / 2);
        }
    }

    /// True if an axis measures nothing any more.
    pub(super) fn is_axis_silent(&self) -> bool {
        self.is_silent.contains(&true)
    }

    /// The quality of an estimate that would have `quality` if all axes measured.
    pub(super) fn bounded(&self, quality: i8) -> i8 {
        if self.is_axis_silent() { quality.min(SILENT_QUALITY) } else { quality }
    }

    /// Nothing could be learnt from the frame of `stamp`: what is uncertain stays so.
    pub(super) fn prolong_suspicion(&mut self, stamp: Timestamp) {
        self.held = self.held.map(|(_, sigmas, axes_o)| (stamp, sigmas, axes_o));
    }

    /// Covariance of the velocity at `stamp` by forces that may have stopped changing, m²/s² in `O`.
    pub(super) fn of_velocity(&self, stamp: Timestamp) -> Option<Matrix3<f64>> {
        let (_, sigmas, axes_o) = self.held.filter(|(last, ..)| stamp.seconds_since(*last) < HELD_S)?;
        Some(axes_o * Matrix3::from_diagonal(&sigmas.component_mul(&sigmas)) * axes_o.transpose())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Watches frames of a twentieth of a second whose mean forces are these, m/s²; returns the largest standard deviation of the
    /// velocity after each, m/s.
    fn watched(force_b: impl Fn(f64) -> Vector3<f64>) -> Vec<f64> {
        let mut watch = StilledForce::new(2e-3);
        let zero = Vector3::zeros();
        let of_frame = |k: u32| {
            let motion = Preintegration {
                dt_s: 0.05,
                delta_v: force_b(0.05 * f64::from(k)) * 0.05,
                ..Preintegration::new(&zero, &zero)
            };
            let stamp = Timestamp::default().plus_seconds(0.05 * f64::from(k));
            watch.update(stamp, &UnitQuaternion::identity(), &motion, 2e-3);
            watch.of_velocity(stamp).map_or(0.0, |covariance| covariance.diagonal().max().sqrt())
        };
        (0..200).map(of_frame).collect()
    }

    /// Forces of a vehicle that flies about, with noise.
    fn flying(t: f64) -> Vector3<f64> {
        let noise = Vector3::new(libm::sin(1e4 * t), libm::cos(2e4 * t), libm::sin(3e4 * t)) * 0.01;
        Vector3::new(2.0 * libm::sin(4.0 * t), 2.0 * libm::cos(3.0 * t), 9.8 + libm::sin(5.0 * t)) + noise
    }

    #[test]
    fn flying_about_leaves_the_velocity_certain() {
        let sigmas = watched(flying);
        assert!(sigmas.iter().all(|sigma| *sigma < 0.03), "{sigmas:?}");
    }

    #[test]
    fn forces_that_freeze_make_the_velocity_as_uncertain_as_they_would_have_changed() {
        let frozen = |t: f64| flying(t.at_most(5.0)) + (flying(t) - flying(0.0)) * 1e-3;
        let sigmas = watched(frozen);
        // The second derivative of the velocity is 5.7 m/s³ in the root mean square.
        for (frame, t) in [(103, 0.15), (105, 0.25)] {
            assert!(sigmas[frame] > 5.7 * t * t / 2.0 / 5.0, "{frame}: {}", sigmas[frame]);
        }
        assert!(sigmas[130..150].iter().all(|sigma| *sigma < 0.5), "it does not grow for good");
    }

    #[test]
    fn a_sensor_whose_readings_are_noise_is_silent_and_one_in_a_smooth_flight_is_not() {
        let watched = |size: f64| {
            let mut watch = StilledForce::new(2e-3);
            let zero = Vector3::zeros();
            for k in 0..100 {
                let t = 0.05 * f64::from(k);
                let force_b = (flying(0.2 * t) - flying(0.0)) * size + flying(0.0);
                let noise = Vector3::new(libm::sin(1e4 * t), libm::cos(2e4 * t), libm::sin(3e4 * t)) * 0.012;
                let delta_v = (force_b + noise) * 0.05;
                let motion = Preintegration { dt_s: 0.05, delta_v, ..Preintegration::new(&zero, &zero) };
                let stamp = Timestamp::default().plus_seconds(t);
                watch.update(stamp, &UnitQuaternion::identity(), &motion, 2e-3);
            }
            watch.is_silent()
        };
        assert_eq!([0.0, 0.1].map(watched), [true, false]);
    }

    #[test]
    fn an_axis_that_dies_is_silent_within_a_second_until_it_is_back() {
        let mut watch = StilledForce::new(2e-3);
        let zero = Vector3::zeros();
        let mut silent_s = Vec::new();
        for k in 0..300 {
            let t = 0.05 * f64::from(k);
            let mut force_b = flying(t);
            if (5.0..10.0).contains(&t) {
                force_b.y = 0.012 * libm::sin(7e4 * t);
            }
            let motion =
                Preintegration { dt_s: 0.05, delta_v: force_b * 0.05, ..Preintegration::new(&zero, &zero) };
            let stamp = Timestamp::default().plus_seconds(t);
            watch.update(stamp, &UnitQuaternion::identity(), &motion, 2e-3);
            if watch.is_axis_silent() {
                silent_s.push(t);
            }
        }
        let [first, last] = [silent_s.first(), silent_s.last()].map(|s| s.copied().unwrap_or(f64::NAN));
        assert!((5.5..6.0).contains(&first) && (9.9..11.0).contains(&last), "{first} to {last}");
    }

    #[test]
    fn axes_that_feel_less_than_the_noise_are_not_silent_because_frames_are_missing() {
        let (mut watch, zero, noise) = (StilledForce::new(0.016), Vector3::zeros(), 0.016);
        let (mut t, mut silent) = (0.0, 0);
        for k in 0..400 {
            let dt_s = if k % 10 == 9 { 0.2 } else { 0.05 };
            t += dt_s;
            let force_b = Vector3::new(2.0 * libm::sin(4.0 * t), libm::cos(5.0 * t), 9.8);
            let delta_v = force_b * dt_s;
            let motion = Preintegration { dt_s, delta_v, ..Preintegration::new(&zero, &zero) };
            watch.update(Timestamp::default().plus_seconds(t), &UnitQuaternion::identity(), &motion, noise);
            silent += u32::from(watch.is_axis_silent());
        }
        assert_eq!(silent, 0);
    }

    #[test]
    fn hovering_has_nothing_that_could_freeze() {
        let hovering = |t: f64| Vector3::new(0.01 * libm::sin(t), 0.01, 9.8);
        assert!(watched(hovering)[100..].iter().all(|sigma| *sigma == 0.0));
    }
}
