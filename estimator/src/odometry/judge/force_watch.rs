//! Agreement of accelerometer and images about the vehicle's acceleration.
//!
//! The ways `m1` and `m2` between three frames, `h1` and `h2` seconds long, tell how much velocity was gained from the first half of the span
//! to the second, whatever the velocity was. A way is the sum, over its frames, of what lies between the frame before in the window and
//! the sighted position ([`crate::window::sighting`]): the window as a whole may shift meanwhile. The readings tell the same: with the gain
//! of velocity `dv` and the way `dp` of either half, as preintegrated and turned into the odometry frame by the attitudes of the window,
//!
//! ```text
//! r = m2 / h2 - m1 / h1 - (g (h1 + h2) / 2 + dv_1 + dp_2 / h2 - dp_1 / h1)
//! ```
//!
//! in m/s. A force that did not act, `f`, makes `r = f (h1 + h2) / 2`; one that is wrong since `t` seconds, `r = f t² / (2 h2)`. Short spans find
//! blows within a frame, long ones a force that is wrong by a fraction of a metre per second squared. Neither a velocity nor a bias that the
//! fault has spoilt already takes part, as they would in an innovation of the filter. The first frame of a blow shows in such an innovation
//! alone ([`crate::window::trial`]), and is taken from there.

use super::stamp::noise::LEAST_SIGMA_S;
use super::{PROBATION_S, SET_RIGHT_S};
use crate::inertial::{ImuNoise, Preintegration};
use crate::window::sighting::{LEAST_SIGHTING_M, variance_along};
use crate::window::trial::CONTRADICTS_SIGMAS;
use heapless::Deque;
use nalgebra::{Matrix3, UnitQuaternion, Vector3};
use plumbline_config::{Portable, Timestamp};

/// Frames in half a span.
const HALVES: [usize; 3] = [2, 4, 8];
/// Sightings that are kept: those of the longest span.
const MAX_LEGS: usize = SPAN_FRAMES + 1;
/// Frames of the longest span.
pub(super) const SPAN_FRAMES: usize = 2 * HALVES[2];
/// Standard deviation of a force that scale, alignment and temperature make wrong, m/s².
const MODEL_SIGMA_M_S2: f64 = 0.15;
/// Forces are doubted between these, m/s².
const LEAST_DOUBT_M_S2: f64 = 2.0;
const MOST_DOUBT_M_S2: f64 = 50.0;
/// Frames on end that contradict before the accelerometer is named.
const FRAMES_TO_NAME: u32 = 4;
/// A contradiction holds for [`SET_RIGHT_S`] after the last frame that showed it, and for [`PROBATION_S`] while no frame can show it, or once the
/// accelerometer is named, since an axis that is dead agrees while it has nothing to feel. Once it is named it holds so long while no frame can show
/// it, s, since that has to be seen to agree.
const UNSEEN_S: f64 = 5.0;

/// A sighted frame, and the motion that leads to it.
#[derive(Clone, Copy, Debug)]
struct Leg {
    stamp: Timestamp,
    /// Way from where the window has the frame before, m in `O`: the window as a whole may shift from frame to frame.
    moved: Vector3<f64>,
    /// Covariance of the position, m², with what an error of the stamp makes of it.
    covariance: Matrix3<f64>,
    dt_s: f64,
    /// Attitude of the frame before.
    rot_o_before: UnitQuaternion<f64>,
    /// Gain of velocity, m/s, and way, m, by the forces since the leg before, in `O`.
    gained: Vector3<f64>,
    travelled: Vector3<f64>,
}

/// Evidence of a frame about the forces.
#[derive(Clone, Copy, Debug)]
pub(super) struct SeenMotion<'a> {
    pub(super) stamp: Timestamp,
    /// Way from the frame before to where the images place this one, m in `O`, with the covariance of its end, m².
    pub(super) moved: Vector3<f64>,
    pub(super) covariance: Matrix3<f64>,
    /// Attitude of the frame before.
    pub(super) rot_o_before: UnitQuaternion<f64>,
    /// Motion since the frame before.
    pub(super) motion: &'a Preintegration,
    /// Velocity, m/s in `O`, and standard deviation of the stamp, s.
    pub(super) v_o_b: Vector3<f64>,
    pub(super) stamp_sigma_s: f64,
    /// Force that explains where the images place the frame, m/s², if they contradict where it was predicted.
    pub(super) blow_m_s2: Option<f64>,
}

/// Uncertainty of the forces.
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
    /// Standard deviation to give the forces, m/s².
    pub(super) sigma_m_s2: f64,
}

/// Compares the forces of the last frames with the images.
#[derive(Clone, Debug, Default)]
pub(super) struct ForceWatch {
    gravity_o: Vector3<f64>,
    legs: Deque<Leg, MAX_LEGS>,
    /// Frames on end that contradict; when the last of them was, and how far off its forces might be, m/s².
    contradicting: u32,
    last: Option<(Timestamp, f64)>,
    is_named: bool,
    /// When the accelerometer was last named.
    named: Option<Timestamp>,
    /// Gain over the longest span that ends at the newest frame.
    gain: Option<Gain>,
}

/// Gain of velocity over a span of frames, m/s in `O`, as the forces make it, and as the images show it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Gain {
    pub(super) felt: Vector3<f64>,
    pub(super) seen: Vector3<f64>,
    /// Share of gravity in both, m/s in `O`.
    pub(super) by_gravity: Vector3<f64>,
    /// Attitude in the middle of the span.
    pub(super) rot_o_b: UnitQuaternion<f64>,
    /// Covariance of the difference of both, m²/s² in `O`.
    pub(super) covariance: Matrix3<f64>,
    pub(super) span_s: f64,
}

/// Change of velocity over a span of frames that the images show and the forces do not explain.
#[derive(Clone, Copy, Debug)]
struct Unexplained {
    gain: Gain,
    sigmas: f64,
    forces: WrongForces,
}

impl ForceWatch {
    pub(super) fn new(gravity_o: Vector3<f64>) -> Self {
        Self { gravity_o, ..Self::default() }
    }

    /// Forgets what was seen and what was found.
    pub(super) fn clear(&mut self) {
        *self = Self::new(self.gravity_o);
    }

    /// The frame of `stamp` says nothing of its forces: too few known landmarks place it, or its motion was not measured. Those that are
    /// contradicted stay so for a while.
    pub(super) fn pass_over(&mut self, stamp: Timestamp) -> Option<WrongForces> {
        self.legs.clear();
        self.gain = None;
        let (last, sigma_m_s2) = self.last?;
        let (seen, unseen_s) = match self.named.filter(|_| self.is_named) {
            Some(named) => (named, UNSEEN_S),
            None => (last, PROBATION_S),
        };
        if stamp.seconds_since(seen) < unseen_s {
            if self.is_named {
                self.last = Some((stamp, sigma_m_s2));
            }
            return Some(WrongForces { since: last, sigma_m_s2 });
        }
        self.settle(stamp);
        None
    }

    /// Takes a frame that known landmarks place; returns what is wrong with the forces that lead to it.
    pub(super) fn update(&mut self, seen: &SeenMotion<'_>, sigmas: &ForceSigmas) -> Option<WrongForces> {
        let stamp_s = seen.stamp_sigma_s.at_least(LEAST_SIGMA_S);
        let by_stamp = seen.v_o_b * stamp_s;
        if self.legs.is_full() {
            self.legs.pop_front();
        }
        let _ = self.legs.push_back(Leg {
            stamp: seen.stamp,
            moved: seen.moved,
            covariance: seen.covariance
                + by_stamp * by_stamp.transpose()
                + Matrix3::identity() * LEAST_SIGHTING_M.squared(),
            dt_s: seen.motion.dt_s,
            rot_o_before: seen.rot_o_before,
            gained: seen.rot_o_before * seen.motion.delta_v,
            travelled: seen.rot_o_before * seen.motion.delta_p,
        });
        let unexplained = HALVES.map(|half| self.unexplained(half, sigmas));
        self.gain = unexplained[HALVES.len() - 1].map(|span| span.gain);
        let contradicts = |span: &Unexplained| span.sigmas > CONTRADICTS_SIGMAS;
        let of_spans = unexplained.into_iter().flatten().find(contradicts).map(|span| span.forces);
        let found = self.blow(seen).or(of_spans);
        if let Some(wrong) = found {
            self.contradicting += 1;
            self.last = Some((seen.stamp, wrong.sigma_m_s2));
            self.is_named |= self.contradicting >= FRAMES_TO_NAME;
            if self.is_named {
                self.named = Some(seen.stamp);
            }
        } else {
            self.settle(seen.stamp);
        }
        found
    }

    /// Contradiction by a newest frame that is not where it was predicted: the frame before it may have been struck already.
    fn blow(&self, seen: &SeenMotion<'_>) -> Option<WrongForces> {
        let sigma_m_s2 = seen.blow_m_s2?.clamp(LEAST_DOUBT_M_S2, MOST_DOUBT_M_S2);
        let since =
            self.legs.iter().nth(self.legs.len().saturating_sub(3)).map_or(seen.stamp, |leg| leg.stamp);
        Some(WrongForces { since, sigma_m_s2 })
    }

    /// Ends a contradiction that has not been seen for a while at `stamp`.
    fn settle(&mut self, stamp: Timestamp) {
        self.contradicting = 0;
        if !self.is_held_at(stamp) {
            (self.last, self.is_named) = (None, false);
        }
    }

    fn is_held_at(&self, stamp: Timestamp) -> bool {
        let held_s = if self.is_named { PROBATION_S } else { SET_RIGHT_S };
        self.last.is_some_and(|(last, _)| stamp.seconds_since(last) < held_s)
    }

    /// Gain of velocity over the longest span that ends at the newest frame; `None` where it was not seen throughout.
    pub(super) fn gain(&self) -> Option<Gain> {
        self.gain
    }

    /// True if forces of the newest frames are contradicted.
    pub(super) fn is_contradicted(&self) -> bool {
        self.last.is_some()
    }

    /// True if the accelerometer has been identified as the faulty sensor.
    pub(super) fn is_named(&self) -> bool {
        self.is_named
    }

    /// Change of velocity over the newest span of twice `half` frames that the forces do not explain. `None` if there are fewer
    /// frames, or if it is not finite.
    fn unexplained(&self, half: usize, sigmas: &ForceSigmas) -> Option<Unexplained> {
        let first = self.legs.len().checked_sub(2 * half + 1)?;
        let mut legs = self.legs.iter().skip(first);
        let a = legs.next()?;
        let [first, second] = [join(&mut legs, half)?, join(&mut legs, half)?];
        let [(b, h1), (c, h2)] = [&first, &second].map(|joined| (joined.end, joined.span_s));
        let seen = second.moved / h2 - first.moved / h1;
        let half_s = 0.5 * (h1 + h2);
        let by_gravity = self.gravity_o * half_s;
        let felt = by_gravity + first.gained + second.travelled / h2 - first.travelled / h1;
        let off = seen - felt;
        let off_m_s = off.norm();
        let of_images = a.covariance / h1.squared()
            + b.covariance * (1.0 / h1 + 1.0 / h2).squared()
            + c.covariance / h2.squared()
            + first.within / h1.squared()
            + second.within / h2.squared();
        // A tilt that is off turns all that is felt.
        let force_m_s2 = (first.gained + second.gained).norm() / (h1 + h2);
        let of_forces = sigmas.bias_m_s2.squared()
            + (force_m_s2 * sigmas.tilt_rad).squared()
            + MODEL_SIGMA_M_S2.squared();
        let of_forces = of_forces * half_s.squared() + sigmas.noise.accel_density.squared() * 2.0 * half_s;
        let variance = variance_along(&of_images, &off) + of_forces;
        let of_newest = 2.0 * off_m_s * h2 / c.dt_s.squared();
        let throughout = 2.0 * off_m_s / half_s;
        let sigma_m_s2 = if half == HALVES[0] { of_newest } else { throughout };
        let sigmas = off_m_s / variance.sqrt();
        let sigma_m_s2 = sigma_m_s2.clamp(LEAST_DOUBT_M_S2, MOST_DOUBT_M_S2);
        sigmas.is_finite().then_some(Unexplained {
            gain: Gain {
                felt,
                seen,
                by_gravity,
                rot_o_b: b.rot_o_before,
                covariance: of_images + Matrix3::identity() * of_forces,
                span_s: h1 + h2,
            },
            sigmas,
            forces: WrongForces { since: b.stamp, sigma_m_s2 },
        })
    }
}

/// Legs on end.
#[derive(Clone, Copy, Debug)]
struct Joined<'a> {
    end: &'a Leg,
    span_s: f64,
    /// Sum of the covariances of the frames within it, m²: each is sighted at one place, and the window has it at another.
    within: Matrix3<f64>,
    /// Way as seen, m; gain of velocity, m/s, and way, m, by the forces alone.
    moved: Vector3<f64>,
    gained: Vector3<f64>,
    travelled: Vector3<f64>,
}

/// The next `count` legs together.
fn join<'a>(legs: &mut impl Iterator<Item = &'a Leg>, count: usize) -> Option<Joined<'a>> {
    let zero = Vector3::zeros();
    let mut joined: Option<Joined<'a>> = None;
    for leg in legs.take(count) {
        let within = joined.map_or(Matrix3::zeros(), |before| before.within + before.end.covariance);
        let before = joined.unwrap_or(Joined {
            end: leg,
            span_s: 0.0,
            within,
            moved: zero,
            gained: zero,
            travelled: zero,
        });
        joined = Some(Joined {
            end: leg,
            within,
            span_s: before.span_s + leg.dt_s,
            moved: before.moved + leg.moved,
            gained: before.gained + leg.gained,
            travelled: before.travelled + before.gained * leg.dt_s + leg.travelled,
        });
    }
    joined.filter(|joined| joined.span_s > 0.0)
}

#[cfg(test)]
#[path = "force_watch_tests.rs"]
mod tests;
