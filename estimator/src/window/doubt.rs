//! A frame that most of what it sees contradicts: then the frame is wrong, and not what was seen in it.
//!
//! One wrong motion (a blow, a sample that lies) puts the newest frame where nothing fits.

use super::Window;
use super::frame::Frame;
use super::inertial_factor::InertialFactor;
use super::problem::Problem;
use super::state::NavState;
use super::tracks;
use crate::geometry::{exp_so3, log_so3};
use crate::inertial::Preintegration;
use plumbline_config::Timestamp;

impl Window {
    /// True if most observations of the newest frame contradict its pose, at the poses last linearized or costed. If one
    /// observation does not fit, the observation is wrong; if most do not, the pose is.
    pub fn is_newest_doubtful(&self) -> bool {
        let Self { rig, frames, points, lines, linearizer, options, .. } = self;
        let problem = Problem::of_frames(rig, frames, options);
        let of_points = tracks::judge_within(points, &linearizer.poses, &problem, 1.0);
        of_points.and(tracks::judge_within(lines, &linearizer.poses, &problem, 1.0)).is_mistrial()
    }

    /// Solves anew without the motion that leads to the newest frame, which its images contradict: the inertial sensor was
    /// hit, or lied. Whether the images agree among each other then; if not, the motion counts again.
    pub fn doubt_newest_motion(&mut self, max_iterations: usize) -> bool {
        let Some(Frame { inertial: Some(inertial), nav, .. }) = self.frames.last() else { return false };
        let (believed, nav) = (inertial.clone(), nav.clone());
        let loose = believed.loosened(&self.imu_noise);
        self.replace_newest(loose, self.steady_newest().unwrap_or_else(|| nav.clone()));
        let _ = self.optimize(max_iterations);
        if !self.is_newest_doubtful() {
            return true;
        }
        self.replace_newest(believed, nav);
        let _ = self.optimize(max_iterations);
        false
    }

    /// Takes the forces on the way to all frames later than `since` for uncertain by `sigma_m_s2`.
    pub fn doubt_forces(&mut self, since: Timestamp, sigma_m_s2: f64) {
        let noise = self.imu_noise;
        for frame in self.frames.iter_mut().rev().take_while(|frame| frame.stamp > since) {
            frame.inertial =
                frame.inertial.take().map(|inertial| inertial.with_doubted_forces(sigma_m_s2, &noise));
        }
    }

    /// Where the newest frame would be if the vehicle had gone on as it did between the two before.
    pub fn steady_newest(&self) -> Option<NavState> {
        let [.., a, b, newest] = &self.frames[..] else { return None };
        let dt = newest.taken.seconds_since(b.taken);
        let turn = log_so3(&(a.nav.rot_o_b.inverse() * b.nav.rot_o_b));
        let turn = exp_so3(&(turn * (dt / b.taken.seconds_since(a.taken))));
        let p_o_b = b.nav.p_o_b + b.nav.v_o_b * dt;
        Some(NavState { p_o_b, rot_o_b: b.nav.rot_o_b * turn, ..b.nav.clone() })
    }

    /// Puts the newest frame, with the time of its state, to the end of `motion`: at `nav`, at `taken`.
    pub fn put_newest_at(&mut self, taken: Timestamp, nav: NavState, motion: Preintegration) {
        let inertial = InertialFactor::new(motion, &self.imu_noise);
        if let Some(newest) = self.frames.last_mut() {
            newest.taken = taken;
            newest.linearization = nav.clone();
        }
        self.replace_newest(inertial, nav);
    }

    fn replace_newest(&mut self, motion: InertialFactor, nav: NavState) {
        if let Some(newest) = self.frames.last_mut() {
            newest.inertial = Some(motion);
            newest.nav = nav;
        }
    }
}
