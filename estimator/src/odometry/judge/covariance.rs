//! The covariance that is stated of the newest frame: that of the window, with what sensors that contradict each other, or are suspect, may hide.

use super::Judge;
use crate::estimate::NavCovariance;
use crate::odometry::estimation::Estimation;
use crate::odometry::vibrating;
use crate::window::state::NavState;
use nalgebra::Matrix3;

impl Judge {
    /// The covariance of the newest frame, with what sensors that contradict each other may hide, and what vibration makes of
    /// its velocity.
    pub(in crate::odometry) fn stated_covariance(&self, estimation: &Estimation) -> NavCovariance {
        // Whoever is wrong: frames correct so much more than this explains.
        let covariance = estimation.covariance * self.noise.disagreement();
        let Some(newest) = estimation.window.frames.last() else { return covariance };
        let added = self.gyroscope.added_covariance(&newest.nav, &estimation.turn_rate_b());
        let mut stated = added.map_or(covariance, |added| covariance + added);
        let sway = vibrating::sway(&estimation.vibration, self.noise.stated(), &newest.nav);
        add(&mut stated, NavState::V, sway);
        if let Some(variance) = self.stamps.newest_variance() {
            let by_time = estimation.rates_of(&newest.nav).derivative();
            stated += by_time * by_time.transpose() * variance;
        }
        add(&mut stated, NavState::V, self.sudden_force.of_velocity(newest.stamp));
        self.leaning.add_to(&mut stated, newest.stamp);
        stated
    }
}

/// Adds to the block of a covariance that begins at `part`.
fn add(covariance: &mut NavCovariance, part: usize, more: Option<Matrix3<f64>>) {
    if let Some(more) = more {
        let mut view = covariance.fixed_view_mut::<3, 3>(part, part);
        view += more;
    }
}
