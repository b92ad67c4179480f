//! Which landmark lines are structural: every frame's edges vote for the heading of the Manhattan world, and every
//! landmark line is held against its directions.

use super::manhattan::Axis;
use super::{LineTrack, Window};

/// Landmark lines that are vertical only together: a single one may be any edge that nearly is, and would tilt the whole window.
const MIN_VERTICALS: usize = 2;
/// Tilt known worse than this selects lines that agree with its error, rad: the gate of the plane of a vertical.
const MAX_TILT_SIGMA_RAD: f64 = 0.006;

impl Window {
    /// Finds the heading of the Manhattan world and the landmark lines along its directions, with the newest frame's
    /// `lines`, by the present estimates. Verticals are taken while roll and pitch are known to [`MAX_TILT_SIGMA_RAD`]:
    /// `tilt_sigma_rad` is their standard deviation.
    pub fn update_manhattan(&mut self, lines: &[LineTrack], tilt_sigma_rad: f64) {
        if self.manhattan.options.vanishing_directions {
            self.discover(lines);
        }
        let Self { rig, manhattan, frames, lines, .. } = self;
        let rot_b_c = [0, 1].map(|camera| rig.pose_b_c(camera).rotation.to_rotation_matrix().into_inner());
        for landmark in lines.all_mut().iter_mut().filter(|l| l.is_triangulated) {
            let rot_o_b = frames[usize::from(landmark.host)].nav.rot_o_b.to_rotation_matrix().into_inner();
            let rot_o_c = rot_o_b * rot_b_c[usize::from(landmark.host_camera)];
            landmark.feature.axis =
                manhattan.axis_of(&landmark.feature.axes, landmark.feature.axis, &rot_o_c);
        }
        if tilt_sigma_rad > MAX_TILT_SIGMA_RAD || self.verticals() < MIN_VERTICALS {
            self.forget(|axis| axis == Axis::Vertical);
        }
        self.manhattan.verticals = self.verticals();
        self.is_manhattan_in_sight = self.horizontals_agree();
        if !self.is_manhattan_in_sight {
            self.forget(|axis| axis != Axis::Vertical);
        }
    }

    /// Directions of the Manhattan world along which the landmark lines lie.
    fn axes(&self) -> impl Iterator<Item = Option<Axis>> {
        self.lines.all().iter().filter(|l| l.is_triangulated).map(|l| l.feature.axis)
    }

    fn verticals(&self) -> usize {
        self.axes().filter(|axis| *axis == Some(Axis::Vertical)).count()
    }

    /// True if enough of the landmark lines that are not vertical lie along or across the heading: among edges of all headings
    /// a few always do.
    fn horizontals_agree(&self) -> bool {
        let (mut members, mut others) = (0, 0);
        for axis in self.axes() {
            match axis {
                Some(Axis::Vertical) => {}
                Some(_) => members += 1,
                None => others += 1,
            }
        }
        let (min_members, most_others) =
            if self.is_manhattan_in_sight { (5, 2 * members) } else { (8, members) };
        members >= min_members && others <= most_others
    }

    /// Lines along such a direction belong to none from now on.
    fn forget(&mut self, is_forgotten: impl Fn(Axis) -> bool) {
        for landmark in self.lines.all_mut() {
            let axis = &mut landmark.feature.axis;
            *axis = axis.filter(|axis| !is_forgotten(*axis));
        }
    }

    fn discover(&mut self, lines: &[LineTrack]) {
        let Some(newest) = self.frames.last() else { return };
        self.heading_votes.fade();
        for line in lines {
            let Some(camera) = (0..2).find(|&c| line.measured[c].is_some()) else { continue };
            let Some(measured) = &line.measured[camera] else { continue };
            let n_o = newest.nav.rot_o_b * (self.rig.pose_b_c(camera).rotation * measured.normal());
            self.heading_votes.vote(&n_o.normalize(), measured.angle_rad());
        }
        if let Some(heading) = self.heading_votes.verdict(self.manhattan.heading_rad) {
            self.manhattan.heading_rad = Some(heading);
            self.is_manhattan_in_sight = false;
            self.forget(|axis| axis != Axis::Vertical);
        }
    }

    /// Number of structural lines: landmark lines along a direction of the Manhattan world.
    pub fn structural_lines(&self) -> usize {
        self.axes().flatten().count()
    }
}

#[cfg(test)]
#[path = "structural_lines_tests.rs"]
mod tests;
