//! Differences between the turns of frames by the images and by the gyroscope, and what they come to in sum.

use crate::window::sighting::variance_along;
use crate::window::trial::{CONTRADICTS_SIGMAS, SAME_TURN_RAD};
use heapless::Deque;
use nalgebra::{Matrix3, Vector3};
use plumbline_config::{Portable, Timestamp};

/// Share of a turn that the scale of the gyroscope, or an offset of the stamps that changes, may be wrong by.
const SCALE_SHARE: f64 = 0.01;
/// Frames whose differences are added up, and the standard deviation of a stamp that is admitted at least in each sum, s.
const SUMS: [(usize, f64); 2] = [(3, 2e-3), (8, 1e-3)];
const MAX_SUM: usize = SUMS[1].0;

/// Difference between a frame's rotation by the images and by the gyroscope.
#[derive(Clone, Copy, Debug)]
pub(super) struct Difference {
    pub(super) from: Timestamp,
    pub(super) dt_s: f64,
    pub(super) rad: Vector3<f64>,
    pub(super) seen: Vector3<f64>,
    /// Difference by the turn from the sighting of the frame before, rad, where both frames were sighted: what landmarks are off by is in neither.
    pub(super) between: Option<Vector3<f64>>,
    /// Covariance of the sighting, rad².
    pub(super) covariance: Matrix3<f64>,
    /// True if landmarks vote for it.
    pub(super) is_voted: bool,
    /// Difference by the stamps as they are, rad.
    pub(super) by_stamps: Vector3<f64>,
    /// Standard deviation of the times of the states where errors of stamps are corrected, s.
    pub(super) time_sigma_s: Option<f64>,
}

impl Difference {
    pub(super) fn rate_b(&self) -> Vector3<f64> {
        self.seen / self.dt_s
    }
}

/// Standard deviations of what makes gyroscope and images differ without a fault.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sigmas {
    /// Bias of the gyroscope, rad/s.
    pub(super) bias_rad_s: f64,
    /// Stamps of frames, as far as learnt, s.
    pub(super) stamp_s: f64,
}

/// Differences of the last frames on end.
#[derive(Clone, Debug)]
pub(super) struct Differences {
    gyro_density: f64,
    newest: Deque<Difference, MAX_SUM>,
}

impl Differences {
    /// For a gyroscope with noise of this density, rad/s/sqrt(Hz).
    pub(super) fn new(gyro_density: f64) -> Self {
        Self { gyro_density, newest: Deque::new() }
    }

    /// Forgets the differences.
    pub(super) fn clear(&mut self) {
        self.newest.clear();
    }

    /// Takes the difference of another frame; returns that of the frame before.
    pub(super) fn push(&mut self, difference: Difference) -> Option<Difference> {
        let before = self.newest.back().copied();
        if self.newest.is_full() {
            self.newest.pop_front();
        }
        let _ = self.newest.push_back(difference);
        before
    }

    /// Difference of the newest frame as a multiple of what it may come to without a fault.
    pub(super) fn newest_excess(&self, sigmas: &Sigmas) -> f64 {
        self.excess((1, SUMS[0].1), sigmas, false).unwrap_or(0.0)
    }

    /// Longest sum of differences as a multiple of what it may come to without a fault where the errors of sightings are independent; 0 where it is
    /// not complete, or a single difference makes up half of it.
    pub(super) fn even_excess(&self, sigmas: &Sigmas) -> f64 {
        let sum = self.sum(MAX_SUM);
        let is_even = self.newest.iter().all(|d| d.rad.norm() < 0.5 * sum.norm());
        self.excess(SUMS[1], sigmas, false).filter(|_| is_even).unwrap_or(0.0)
    }

    /// Beginning of the differences that add up to more than what is admitted.
    pub(super) fn contradict_since(&self, sigmas: &Sigmas) -> Option<Timestamp> {
        SUMS.into_iter().find_map(|span| {
            let excess = self.excess(span, sigmas, true)?;
            let first = self.newest.len().checked_sub(span.0)?;
            self.newest.iter().nth(first).filter(|_| excess > 1.0).map(|d| d.from)
        })
    }

    /// Sum of the newest `count` differences, rad.
    fn sum(&self, count: usize) -> Vector3<f64> {
        self.newest.iter().rev().take(count).map(|d| d.rad).sum()
    }

    /// Sum of the newest `count` differences as a multiple of what it may come to without a fault, where stamps have a standard deviation of at
    /// least `stamp_sigma_s`; `None` where there are fewer. Sightings that no landmark votes for err alike if `are_errors_shared`: by what the same
    /// landmarks are off by, so that standard deviations add up and not variances. And what they are off by is no turn: the sum from sighting to
    /// sighting, whose ends alone err, has to exceed as well.
    fn excess(
        &self,
        (count, stamp_sigma_s): (usize, f64),
        sigmas: &Sigmas,
        are_errors_shared: bool,
    ) -> Option<f64> {
        let first = self.newest.len().checked_sub(count)?;
        let newest = || self.newest.iter().skip(first);
        let sum: Vector3<f64> = newest().map(|d| d.rad).sum();
        let span_s: f64 = newest().map(|d| d.dt_s).sum();
        let turned: f64 = newest().map(|d| d.seen.norm()).sum();
        let (mut own, mut shared) = (0.0, 0.0);
        for difference in newest() {
            let variance = variance_along(&difference.covariance, &sum);
            match are_errors_shared && !difference.is_voted {
                true => shared += variance.sqrt(),
                false => own += variance,
            }
        }
        let ends = [newest().next()?, newest().last()?];
        let stamp = |d: &Difference| d.time_sigma_s.unwrap_or(sigmas.stamp_s).at_least(stamp_sigma_s);
        let of_stamps: f64 = ends.map(|d| (d.rate_b().norm() * stamp(d)).squared()).iter().sum();
        let admitted = |count: usize, of_sightings: f64| {
            let variance = of_sightings
                + of_stamps
                + self.gyro_density.squared() * span_s
                + (sigmas.bias_rad_s * span_s).squared();
            (SAME_TURN_RAD * (count as f64).sqrt()).at_least(CONTRADICTS_SIGMAS * variance.sqrt())
                + SCALE_SHARE * turned
        };
        let excess = sum.norm() / admitted(count, own + shared.squared());
        let sighted = newest().filter(|d| d.between.is_some()).count();
        if !are_errors_shared || sighted == 0 {
            return Some(excess);
        }
        let between: Vector3<f64> = newest().filter_map(|d| d.between).sum();
        let of_ends = ends.map(|d| variance_along(&d.covariance, &between)).iter().sum();
        Some(excess.at_most(between.norm() / admitted(sighted, of_ends)))
    }
}
