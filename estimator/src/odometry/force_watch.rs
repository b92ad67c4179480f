//! Whether accelerometer and images agree about how the vehicle speeds up.
//!
//! Three sighted positions ([`crate::window::sighting`]) `a`, `b`, `c`, with `h1` and `h2` seconds between them, tell how much velocity was
//! gained from the first half of the span to the second, whatever the velocity was. So do the readings: with the gain of velocity `dv` and the
//! way `dp` of either half, as preintegrated and turned into the odometry frame by the attitudes that the images give,
//!
//! ```text
//! r = (p_c - p_b) / h2 - (p_b - p_a) / h1 - (g (h1 + h2) / 2 + dv_1 + dp_2 / h2 - dp_1 / h1)
//! ```
//!
//! in m/s. A force that did not act, `f`, makes `r = f (h1 + h2) / 2`; one that is wrong since `t` seconds, `r = f t² / (2 h2)`. Short spans find
//! blows within a frame, long ones a force that is wrong by a fraction of a metre per second squared. Neither a velocity nor a bias that the
//! fault has spoilt already takes part, as they would in an innovation of the filter.

use crate::inertial::{ImuNoise, Preintegration};
use heapless::Deque;
use nalgebra::{UnitQuaternion, Vector3};
use plumbline_config::{Portable, Timestamp};

/// Frames in half a span.
const HALVES: [usize; 3] = [2, 4, 8];
/// Sightings that are kept: those of the longest span.
const MAX_LEGS: usize = 2 * HALVES[2] + 1;
/// A gain of velocity contradicts by this many standard deviations.
const CONTRADICTS_SIGMAS: f64 = 5.0;
/// Standard deviation of a force that scale, alignment and temperature make wrong, m/s².
const MODEL_SIGMA_M_S2: f64 = 0.15;
/// A sighting is not better than this, m.
const LEAST_SIGHTING_M: f64 = 5e-4;
/// Forces are doubted between these, m/s².
const LEAST_DOUBT_M_S2: f64 = 2.0;
const MOST_DOUBT_M_S2: f64 = 50.0;
/// Frames on end that contradict before the accelerometer is named.
const FRAMES_TO_NAME: u32 = 4;
/// A contradiction holds for this long after the last frame that showed it, s.
const HELD_S: f64 = 0.3;
/// Largest quality while forces are contradicted.
const CONTRADICTED_QUALITY: i8 = 10;

/// A sighted frame, and the motion that leads to it.
#[derive(Clone, Copy, Debug)]
struct Leg {
    stamp: Timestamp,
    p_o_b: Vector3<f64>,
    /// Standard deviation of the position, m, with what an error of the stamp makes of it.
    sigma_m: f64,
    dt_s: f64,
    /// Gain of velocity, m/s, and way, m, by the forces since the leg before, in `O`.
    gained: Vector3<f64>,
    travelled: Vector3<f64>,
}

/// What a frame tells of the forces.
#[derive(Clone, Copy, Debug)]
pub(super) struct SeenMotion<'a> {
    pub(super) stamp: Timestamp,
    /// Where the images place the frame, m in `O`.
    pub(super) p_o_b: Vector3<f64>,
    pub(super) sigma_m: f64,
    /// Attitude of the frame before.
    pub(super) rot_o_before: UnitQuaternion<f64>,
    /// Motion since the frame before.
    pub(super) motion: &'a Preintegration,
    /// Velocity, m/s, and standard deviation of the stamp, s.
    pub(super) speed_m_s: f64,
    pub(super) stamp_sigma_s: f64,
}

/// How well forces are known.
#[derive(Clone, Copy, Debug)]
pub(super) struct ForceSigmas {
    pub(super) noise: ImuNoise,
    /// Standard deviations of the bias, m/s², and of roll and pitch, rad.
    pub(super) bias_m_s2: f64,
    pub(super) tilt_rad: f64,
}

/// Forces that the images contradict.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct WrongForces {
    /// Frames later than this rest on them.
    pub(super) since: Timestamp,
    /// How far off they may be, m/s².
    pub(super) sigma_m_s2: f64,
}

/// Compares the forces of the last frames with the images.
#[derive(Clone, Debug)]
pub(super) struct ForceWatch {
    gravity_o: Vector3<f64>,
    legs: Deque<Leg, MAX_LEGS>,
    /// Frames on end that contradict, and when the last of them was.
    contradicting: u32,
    last: Option<Timestamp>,
    is_named: bool,
}

impl ForceWatch {
    pub(super) fn new(gravity_o: Vector3<f64>) -> Self {
        Self { gravity_o, legs: Deque::new(), contradicting: 0, last: None, is_named: false }
    }

    /// Forgets what was seen and what was found.
    pub(super) fn clear(&mut self) {
        *self = Self::new(self.gravity_o);
    }

    /// The frame of `stamp` says nothing of its forces: it was not sighted, or its motion not measured.
    pub(super) fn pass_over(&mut self, stamp: Timestamp) {
        self.legs.clear();
        self.settle(stamp);
    }

    /// Takes a frame; returns what is wrong with the forces that lead to it. While something moves in sight, `is_witness` is not set, and
    /// nothing is.
    pub(super) fn update(
        &mut self,
        seen: &SeenMotion<'_>,
        sigmas: &ForceSigmas,
        is_witness: bool,
    ) -> Option<WrongForces> {
        let sighted = seen.sigma_m.at_least(LEAST_SIGHTING_M);
        if self.legs.is_full() {
            self.legs.pop_front();
        }
        let _ = self.legs.push_back(Leg {
            stamp: seen.stamp,
            p_o_b: seen.p_o_b,
            sigma_m: libm::hypot(sighted, seen.speed_m_s * seen.stamp_sigma_s),
            dt_s: seen.motion.dt_s,
            gained: seen.rot_o_before * seen.motion.delta_v,
            travelled: seen.rot_o_before * seen.motion.delta_p,
        });
        let contradiction = || HALVES.iter().find_map(|half| self.contradiction(*half, sigmas));
        let found = is_witness.then(contradiction).flatten();
        if found.is_some() {
            self.contradicting += 1;
            self.last = Some(seen.stamp);
            self.is_named |= self.contradicting >= FRAMES_TO_NAME;
        } else {
            self.settle(seen.stamp);
        }
        found
    }

    /// Ends a contradiction that has not been seen for a while at `stamp`.
    fn settle(&mut self, stamp: Timestamp) {
        self.contradicting = 0;
        if !self.is_held_at(stamp) {
            (self.last, self.is_named) = (None, false);
        }
    }

    fn is_held_at(&self, stamp: Timestamp) -> bool {
        self.last.is_some_and(|last| stamp.seconds_since(last) < HELD_S)
    }

    /// Whether forces of the newest frames are contradicted.
    pub(super) fn is_contradicted(&self) -> bool {
        self.last.is_some()
    }

    /// Whether the accelerometer has been named as what is wrong.
    pub(super) fn is_named(&self) -> bool {
        self.is_named
    }

    /// The quality of an estimate that would have `quality` if images and forces agreed.
    pub(super) fn bounded(&self, quality: i8) -> i8 {
        if self.is_contradicted() { quality.min(CONTRADICTED_QUALITY) } else { quality }
    }

    /// What is wrong with the forces by the newest span of twice `half` frames.
    fn contradiction(&self, half: usize, sigmas: &ForceSigmas) -> Option<WrongForces> {
        let first = self.legs.len().checked_sub(2 * half + 1)?;
        let mut legs = self.legs.iter().skip(first);
        let a = legs.next()?;
        let [(b, h1, dv_1, dp_1), (c, h2, _, dp_2)] = [join(&mut legs, half)?, join(&mut legs, half)?];
        let seen = (c.p_o_b - b.p_o_b) / h2 - (b.p_o_b - a.p_o_b) / h1;
        let half_s = 0.5 * (h1 + h2);
        let felt = self.gravity_o * half_s + dv_1 + dp_2 / h2 - dp_1 / h1;
        let off_m_s = (seen - felt).norm();
        let of_images = (a.sigma_m / h1).squared()
            + (b.sigma_m * (1.0 / h1 + 1.0 / h2)).squared()
            + (c.sigma_m / h2).squared();
        let gravity_m_s2 = self.gravity_o.norm();
        let of_forces = sigmas.bias_m_s2.squared()
            + (gravity_m_s2 * sigmas.tilt_rad).squared()
            + MODEL_SIGMA_M_S2.squared();
        let variance =
            of_images + of_forces * half_s.squared() + sigmas.noise.accel_density.squared() * 2.0 * half_s;
        // Also what is no number is no contradiction.
        let is_wrong = off_m_s > CONTRADICTS_SIGMAS * variance.sqrt();
        let of_newest = 2.0 * off_m_s * h2 / c.dt_s.squared();
        let throughout = 2.0 * off_m_s / half_s;
        let sigma_m_s2 = if half == HALVES[0] { of_newest } else { throughout };
        is_wrong.then(|| WrongForces {
            since: b.stamp,
            sigma_m_s2: sigma_m_s2.clamp(LEAST_DOUBT_M_S2, MOST_DOUBT_M_S2),
        })
    }
}

/// The last of the next `count` legs, the time that all of them take, s, and what forces make of velocity and position in that time.
fn join<'a>(
    legs: &mut impl Iterator<Item = &'a Leg>,
    count: usize,
) -> Option<(&'a Leg, f64, Vector3<f64>, Vector3<f64>)> {
    let (mut end, mut span_s) = (None, 0.0);
    let (mut gained, mut travelled) = (Vector3::zeros(), Vector3::zeros());
    for leg in legs.take(count) {
        travelled += gained * leg.dt_s + leg.travelled;
        gained += leg.gained;
        span_s += leg.dt_s;
        end = Some(leg);
    }
    end.filter(|_| span_s > 0.0).map(|leg| (leg, span_s, gained, travelled))
}

#[cfg(test)]
#[path = "force_watch_tests.rs"]
mod tests;
