//! A camera of a pair whose image jumps against that of the other.
//!
//! Known landmarks tell how far each image is from where the predicted pose has them ([`crate::window::image_shift`]). An error of the pose
//! moves both, so that the shift of one against the other stays as it was, within a tenth of a pixel, whatever the vehicle does. Where it
//! leaves its mean, one camera has been knocked, or its image is frozen, late or of another place: that which is further from
//! where the landmarks were expected, if the other one sees them there. Its images are not used until the shift is back.
//!
//! A left image that jumps across the lines on which the right one is searched has no such shift: its points are not found in the right
//! one any more. Where that happens from one frame to the next, and the left image is not where it was expected, it is the left one.

use super::super::FRAMES_TO_AGREE;
use crate::window::image_shift::{ImageShifts, PairShifts};
use nalgebra::Vector2;
use plumbline_config::Portable;

/// Frames of which the mean shift is taken, at least before anything is judged, and at most.
const FRAMES_OF_MEAN: [u32; 2] = [5, 20];
/// A pair has jumped if its shift is this far from the mean, px, and so many times the spread of the last frames; the camera is used again after
/// [`FRAMES_TO_AGREE`] with half of that at most.
const JUMP_PX: f64 = 1.5;
const JUMP_SPREADS: f64 = 8.0;
/// The other camera sees most landmarks where they were expected, within this share of the jump: else the pose is wrong, or a crowd moves.
const OTHER_SHARE: f64 = 0.4;
/// The left image loses the right one if it is this far from where it was expected, px, and the share of landmarks that both show falls below
/// this share of what it was.
const LOST_PX: f64 = 3.0;
const LOST_SHARE: f64 = 0.5;
/// The left camera leads the tracks. They go on in the right one if the left one is not to be used, but for the last two of so many frames, by
/// which it can show that it is back.
pub(super) const LEFT: usize = 0;
const FRAMES_TO_PROBE: u64 = 20;
const PROBES: u64 = 2;

/// True if the frame of number `frame` since is one of the last two.
pub(super) fn is_probe(frame: u64) -> bool {
    frame % FRAMES_TO_PROBE >= FRAMES_TO_PROBE - PROBES
}

/// The camera that has jumped.
#[derive(Clone, Copy, Debug)]
struct Jumped {
    camera: usize,
    /// Frames since, and frames on end in which it is back.
    frames: u32,
    agreeing: u32,
}

/// Running mean of the shift of the right image against the left one, and the camera that has jumped.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct PairShift {
    frames: u32,
    mean_px: Vector2<f64>,
    /// Mean square of the distance from the mean, px².
    spread: f64,
    /// Share of the landmarks that both images of the last frame showed.
    shared: f64,
    jumped: Option<Jumped>,
}

impl PairShift {
    /// Takes the shifts of a frame, if it has any.
    pub(super) fn add(&mut self, shifts: Option<ImageShifts>) {
        if let Some(jumped) = &mut self.jumped {
            jumped.frames += 1;
        }
        let Some(shifts) = shifts else { return };
        let shared = std::mem::replace(&mut self.shared, shifts.shared);
        let is_lost = shifts.left > LOST_PX && shifts.shared < LOST_SHARE * shared;
        if is_lost && self.jumped.is_none() && self.frames >= FRAMES_OF_MEAN[0] {
            return self.jumped = Some(Jumped { camera: LEFT, frames: 0, agreeing: 0 });
        }
        match (shifts.of_pair, &mut self.jumped) {
            (Some(of_pair), _) => self.add_pair(&of_pair),
            (None, Some(jumped)) => jumped.agreeing = 0,
            (None, None) => {}
        }
    }

    /// Takes the shifts of a frame whose images show landmarks together.
    fn add_pair(&mut self, shifts: &PairShifts) {
        let off = shifts.apart - self.mean_px;
        let bound_px = JUMP_PX.at_least(JUMP_SPREADS * self.spread.sqrt());
        if let Some(jumped) = &mut self.jumped {
            jumped.agreeing = if off.norm() < 0.5 * bound_px { jumped.agreeing + 1 } else { 0 };
            if jumped.agreeing >= FRAMES_TO_AGREE {
                self.jumped = None;
            }
        } else if self.frames >= FRAMES_OF_MEAN[0] && off.norm() > bound_px {
            let [left_px, right_px] = shifts.of_camera;
            if left_px.at_most(right_px) < OTHER_SHARE * off.norm() {
                let camera = usize::from(right_px > left_px);
                self.jumped = Some(Jumped { camera, frames: 0, agreeing: 0 });
            }
        } else {
            let is_first = self.frames == 0;
            self.frames = (self.frames + 1).min(FRAMES_OF_MEAN[1]);
            let share = 1.0 / f64::from(self.frames);
            self.mean_px += off * share;
            let squared = if is_first { 0.0 } else { off.norm_squared() };
            self.spread += share * (squared - self.spread);
        }
    }

    /// `camera` has jumped.
    pub(super) fn jump(&mut self, camera: usize) {
        self.jumped.get_or_insert(Jumped { camera, frames: 0, agreeing: 0 });
    }

    /// The camera whose images are not used.
    pub(super) fn jumped(&self) -> Option<usize> {
        self.jumped.map(|jumped| jumped.camera)
    }

    /// The camera whose images points are not to be followed in.
    pub(super) fn untracked(&self) -> Option<usize> {
        let jumped = self.jumped.filter(|jumped| jumped.camera == LEFT && jumped.agreeing == 0)?;
        (!is_probe(jumped.frames.into())).then_some(LEFT)
    }

    /// Forgets all frames.
    pub(super) fn clear(&mut self) {
        *self = Self::default();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two seconds of frames whose right image is shifted by `px` and the left one by as much as the pose is off, then one with `newest`.
    fn watched(px: impl Fn(u32) -> Vector2<f64>, newest: [Vector2<f64>; 2]) -> PairShift {
        let mut watch = PairShift::default();
        for k in 0..40 {
            let pose = Vector2::new(libm::sin(f64::from(k)), libm::cos(f64::from(k))) * 3.0;
            let noise = Vector2::new(libm::sin(f64::from(k * k)), libm::cos(f64::from(k * k))) * 0.05;
            watch.add(Some(of([pose, pose + px(k) + noise])));
        }
        watch.add(Some(of(newest)));
        watch
    }

    fn of(of_camera: [Vector2<f64>; 2]) -> ImageShifts {
        let apart = of_camera[1] - of_camera[0];
        let of_pair = PairShifts { of_camera: of_camera.map(|shift| shift.norm()), apart };
        ImageShifts { left: of_camera[0].norm(), shared: 0.9, of_pair: Some(of_pair) }
    }

    #[test]
    fn a_pair_that_is_out_of_line_for_good_or_drifts_has_not_jumped() {
        let low = Vector2::new(0.0, 8.0);
        assert_eq!(watched(|_| low, [Vector2::zeros(), low]).jumped(), None);
        let warm = |k: u32| Vector2::new(0.02 * f64::from(k), 0.0);
        assert_eq!(watched(warm, [Vector2::zeros(), warm(40)]).jumped(), None);
    }

    #[test]
    fn the_camera_that_is_further_off_has_jumped() {
        let [jump, pose] = [Vector2::new(4.0, 0.0), Vector2::new(0.5, 0.3)];
        assert_eq!(watched(|_| Vector2::zeros(), [pose + jump, pose]).jumped(), Some(0));
        assert_eq!(watched(|_| Vector2::zeros(), [pose, pose - jump]).jumped(), Some(1));
        let far = Vector2::new(0.0, 9.0);
        assert_eq!(watched(|_| Vector2::zeros(), [far, far + jump]).jumped(), None, "the pose is wrong");
    }

    #[test]
    fn a_camera_is_used_again_once_its_image_has_been_back_for_ten_frames() {
        let zero = Vector2::zeros();
        let mut watch = watched(|_| zero, [zero, Vector2::new(0.0, 5.0)]);
        for k in 0..FRAMES_TO_AGREE {
            assert_eq!(watch.jumped(), Some(1), "{k}");
            watch.add(None);
            watch.add(Some(of([zero, Vector2::new(0.1, 0.1)])));
        }
        assert_eq!(watch.jumped(), None);
    }

    #[test]
    fn tracks_leave_a_left_camera_that_has_jumped_but_for_two_frames_a_second() {
        let (zero, jump) = (Vector2::zeros(), Vector2::new(5.0, 0.0));
        let mut watch = watched(|_| zero, [jump, zero]);
        let left_out = (0..60).filter(|_| {
            watch.add(None);
            watch.untracked() == Some(LEFT)
        });
        assert_eq!(left_out.count(), 54);
        assert_eq!(watched(|_| zero, [zero, jump]).untracked(), None, "the right one does not lead");
    }

    #[test]
    fn nothing_is_said_before_the_mean_is_known() {
        let mut watch = PairShift::default();
        for px in [0.0, 3.0, -3.0] {
            watch.add(Some(of([Vector2::zeros(), Vector2::new(px, 0.0)])));
            assert_eq!(watch.jumped(), None);
        }
    }

    #[test]
    fn a_left_image_that_loses_the_right_one_has_jumped_unless_it_is_where_it_was_expected() {
        let lost = |left_px: f64| {
            let mut watch = watched(|_| Vector2::zeros(), [Vector2::zeros(); 2]);
            watch.add(Some(ImageShifts { left: left_px, shared: 0.4, of_pair: None }));
            watch.jumped()
        };
        assert_eq!([9.0, 0.5].map(lost), [Some(LEFT), None]);
    }
}
