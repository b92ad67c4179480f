//! Errors of stamps that change slowly, as those of an exposure that follows the light, by what turns of frames have in common.
//!
//! Frames that are taken `e` after their stamps, all alike, seem to turn by `e (w_k - w_0)` too much from frame 0 to frame k, where `w` is the
//! angular rate. A regression of such differences against the change of the rate finds `e`; a wrong scale of the gyroscope differs by what
//! the vehicle turns, as errors do that grow, and not by how its rate changes.

use super::TimeError;
use crate::window::sighting::variance_along;
use heapless::Deque;
use nalgebra::{Matrix3, Vector3};
use plumbline_config::Portable;

/// Frames over which differences are summed.
const FRAMES: usize = 8;
/// Evidence is remembered so long, s.
const MEMORY_S: f64 = 5.0;
/// An error shows from this size on, s, and from so many standard deviations, by the sightings and by what is left of the differences.
const LEAST_S: f64 = 1e-3;
const SHOWS_SIGMAS: f64 = 3.0;
/// Change of the rate and turn must be independent by this.
const INDEPENDENT: f64 = 0.1;
/// Changes of the rate that are too small to tell, rad/s.
const STEADY_RAD_S: f64 = 0.1;

/// Difference of a frame's turn by the images from that by the gyroscope, and the size of the turn itself.
#[derive(Clone, Copy, Debug)]
struct Leg {
    rad: Vector3<f64>,
    turn: Vector3<f64>,
    rate_b: Vector3<f64>,
    covariance: Matrix3<f64>,
}

/// Sums of the regression of differences `D` against the change of the rate `W` and the turn `T`: `D = e W + s T`.
#[derive(Clone, Debug, Default)]
pub(in crate::odometry::judge) struct StampDrift {
    legs: Deque<Leg, { FRAMES + 1 }>,
    ww: f64,
    wt: f64,
    tt: f64,
    wd: f64,
    td: f64,
    dd: f64,
    count: f64,
    /// Variance of a difference, rad², by its weight.
    noise: f64,
}

impl StampDrift {
    /// Takes what a frame turns, rad, and how much less by the gyroscope, rad, with the covariance, the rate at its end and its length.
    pub(in crate::odometry::judge) fn add(
        &mut self,
        [turn, rad]: [Vector3<f64>; 2],
        covariance: Matrix3<f64>,
        rate_b: Vector3<f64>,
        dt_s: f64,
    ) {
        if self.legs.is_full() {
            self.legs.pop_front();
        }
        let _ = self.legs.push_back(Leg { rad, turn, rate_b, covariance });
        let Some(first) = self.legs.front() else { return };
        let w = rate_b - first.rate_b;
        if w.norm() < STEADY_RAD_S {
            return;
        }
        let (mut d, mut t, mut covariance) = (Vector3::zeros(), Vector3::zeros(), Matrix3::zeros());
        for leg in self.legs.iter().skip(1) {
            (d, t, covariance) = (d + leg.rad, t + leg.turn, covariance + leg.covariance);
        }
        let kept = (1.0 - dt_s / MEMORY_S).at_least(0.0);
        let add = |sum: &mut f64, x: f64| *sum = kept * *sum + x;
        add(&mut self.ww, w.norm_squared());
        add(&mut self.wt, w.dot(&t));
        add(&mut self.tt, t.norm_squared());
        add(&mut self.wd, w.dot(&d));
        add(&mut self.td, t.dot(&d));
        add(&mut self.dd, d.norm_squared());
        add(&mut self.count, 3.0);
        // Sums that end at neighbouring frames share most of their frames.
        add(&mut self.noise, FRAMES as f64 * w.norm_squared() * variance_along(&covariance, &w));
    }

    /// Frames do not follow each other any more.
    pub(in crate::odometry::judge) fn clear(&mut self) {
        self.legs.clear();
    }

    /// The error that shows, s; `None` where none does.
    pub(in crate::odometry::judge) fn error(&self) -> Option<TimeError> {
        let determinant = self.ww * self.tt - self.wt.squared();
        if determinant <= INDEPENDENT * self.ww * self.tt || self.ww <= 0.0 {
            return None;
        }
        let value = (self.wd * self.tt - self.td * self.wt) / determinant;
        let scale = (self.td * self.ww - self.wd * self.wt) / determinant;
        let left = self.dd - value * self.wd - scale * self.td;
        let by_left = FRAMES as f64 * left / self.count * self.ww;
        let variance = self.noise.at_least(by_left) * self.tt / (self.ww * determinant);
        let shows = value.abs() > LEAST_S && value.squared() > SHOWS_SIGMAS.squared() * variance;
        shows.then_some(TimeError { value, variance })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The error that is found where the vehicle turns by `rate(t)`, images are taken `late(t)` after their stamps, and a gyroscope with
    /// a scale of `1 + scale` measures.
    fn found(rate: impl Fn(f64) -> f64, late: impl Fn(f64) -> f64, scale: f64) -> Option<TimeError> {
        let mut drift = StampDrift::default();
        let about = |x: f64| Vector3::new(0.0, 0.0, x);
        for k in 1..60 {
            let (from, to) = (f64::from(k - 1) * 0.05, f64::from(k) * 0.05);
            let rad = about(rate(to) * late(to) - rate(from) * late(from) + scale * 0.05 * rate(to));
            drift.add([about(0.05 * rate(to)), rad], Matrix3::identity() * 1e-7, about(rate(to)), 0.05);
        }
        drift.error()
    }

    #[test]
    fn stamps_that_swing_are_found() {
        let error = found(|t| 2.0 * libm::sin(3.0 * t), |t| 3e-3 * libm::cos(0.2 * t), 0.0).expect("shows");
        assert!((error.value - 2.7e-3).abs() < 5e-4, "{error:?}");
    }

    #[test]
    fn a_scale_and_a_gyroscope_that_is_dead_are_no_error_of_stamps() {
        for scale in [0.02, -1.0] {
            assert_eq!(found(|t| 2.0 * libm::sin(3.0 * t), |_| 0.0, scale), None, "{scale}");
        }
        assert_eq!(found(|t| 2.0 * libm::sin(3.0 * t), |_| 0.0, 0.0), None);
    }
}
