//! Images that stop while the vehicle flies on.
//!
//! A camera that repeats an image, with noise of its own on each copy, shows a view that moved in the last frame and stands still in this one.
//! A vehicle does not stop between two frames; where the samples say that it went on, or the other camera does, the image is frozen. It is
//! left out until it moves again, or until the vehicle is found to be at rest. One of two cameras has jumped then ([`super::pair`]); without
//! any, the samples carry the estimate.

use crate::estimate::HealthBits;
use crate::odometry::estimation::Estimation;
use plumbline_config::Portable;

/// A view stops if it moved by this much in the last frame, px, and by less than this share of that in this one. It moves again from the former on,
/// which noise does not leave in the median.
const MOVED_PX: f64 = 1.0;
const STOPPED_SHARE: f64 = 0.15;
/// It would have moved on by this share of what it did in the last frame, as its speed has changed (a swing that turns would not), and as
/// the landmarks are predicted.
const EXPECTED_SHARE: f64 = 0.5;

/// Motion of a camera's view, px in a frame period, of the last frames, newest first, as far as its points were followed.
#[derive(Clone, Copy, Debug, Default)]
struct View {
    moved_px: [Option<f64>; 3],
}

impl View {
    fn add(&mut self, moved_px: Option<f64>) {
        self.moved_px.rotate_right(1);
        self.moved_px[0] = moved_px;
    }

    /// How far it should have moved if it stops with this frame, px, by its motion in those before.
    fn stops(&self) -> Option<f64> {
        let [Some(now), Some(before), Some(earlier)] = self.moved_px else { return None };
        let expected = EXPECTED_SHARE * before;
        let is_stop = before > MOVED_PX && now < (STOPPED_SHARE * before).at_most(MOVED_PX);
        (is_stop && 2.0 * before - earlier > expected).then_some(expected)
    }

    /// True if it moves by much less than in the last frame.
    fn stands(&self) -> bool {
        let [now, before, _] = self.moved_px;
        now.zip(before).is_some_and(|(now, before)| now < 2.0 * STOPPED_SHARE * before)
    }

    fn moves(&self) -> bool {
        self.moved_px[0].is_some_and(|moved_px| moved_px > MOVED_PX)
    }
}

/// Cameras whose images stop with a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Stop {
    /// One of two.
    One(usize),
    /// All there are.
    All,
}

/// Motion of the views, and whether they are frozen.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct StoppedView {
    views: [View; 2],
    is_frozen: bool,
}

impl StoppedView {
    /// Takes how far the view of each camera moves in a frame period, px.
    pub(super) fn see(&mut self, moved_px: [Option<f64>; 2]) {
        for (view, moved_px) in self.views.iter_mut().zip(moved_px) {
            view.add(moved_px);
        }
    }

    /// Judges the images of the newest frame, where its prediction is, before anything rests on them.
    pub(super) fn judge(&mut self, estimation: &mut Estimation, health: &mut HealthBits) -> Option<Stop> {
        self.is_frozen &= !health.contains(HealthBits::STATIONARY);
        let cameras = estimation.window.options.cameras;
        let off_px = || estimation.window.image_shifts().map(|shifts| shifts.left);
        let stop = if self.is_frozen { None } else { self.stop(cameras, off_px) };
        self.is_frozen |= stop == Some(Stop::All);
        self.leave_out(estimation, health);
        stop
    }

    /// Leaves the images of the newest frame out while they are frozen.
    pub(super) fn leave_out(&mut self, estimation: &mut Estimation, health: &mut HealthBits) {
        self.is_frozen &= !self.views.iter().any(View::moves);
        if !self.is_frozen {
            return;
        }
        let bits = [HealthBits::LEFT_FROZEN, HealthBits::RIGHT_FROZEN];
        for (camera, bit) in bits.into_iter().enumerate().take(estimation.window.options.cameras) {
            health.insert(bit);
            estimation.leave_out_image(camera);
        }
    }

    /// The images that stop; `off_px` tells how far the landmarks are from where they were predicted.
    fn stop(&self, cameras: usize, off_px: impl FnOnce() -> Option<f64>) -> Option<Stop> {
        let [left, right] = self.views;
        match [left, right].map(|view| view.stops()) {
            [Some(_), None] if right.moves() => Some(Stop::One(0)),
            [None, Some(_)] if left.moves() => Some(Stop::One(1)),
            [Some(expected_px), _] => {
                let is_left_alone = cameras > 1 && right.moved_px[1].is_some() && !right.stands();
                let stop = if is_left_alone { Stop::One(0) } else { Stop::All };
                off_px().is_some_and(|off_px| off_px > expected_px).then_some(stop)
            }
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What is said of the last of frames in which the views have moved by `px`, if the landmarks are `off_px` from where they were predicted.
    fn said(px: [[Option<f64>; 2]; 3], off_px: f64) -> Option<Stop> {
        let mut watch = StoppedView::default();
        px.into_iter().for_each(|moved_px| watch.see(moved_px));
        watch.stop(2, || Some(off_px))
    }

    fn both(px: [f64; 3]) -> [[Option<f64>; 2]; 3] {
        px.map(|px| [Some(px); 2])
    }

    #[test]
    fn views_that_stop_from_one_frame_to_the_next_while_the_samples_go_on_are_frozen() {
        assert_eq!(said(both([6.0, 6.0, 0.1]), 6.0), Some(Stop::All));
        assert_eq!(said(both([6.0, 6.0, 0.1]), 0.2), None, "the samples stop as well");
        assert_eq!(said(both([6.0, 6.0, 2.0]), 4.0), None, "slower is not still");
        assert_eq!(said(both([12.0, 6.0, 0.1]), 6.0), None, "a swing turns");
        assert_eq!(said(both([0.5, 0.5, 0.01]), 0.5), None, "noise");
    }

    #[test]
    fn one_view_that_stops_while_the_other_moves_is_frozen_whatever_the_samples_say() {
        let fast = [Some(6.0); 2];
        assert_eq!(said([fast, fast, [Some(0.1), Some(6.0)]], 0.0), Some(Stop::One(0)));
        assert_eq!(said([fast, fast, [Some(6.0), Some(0.1)]], 0.0), Some(Stop::One(1)));
    }

    #[test]
    fn a_left_view_that_stops_and_loses_the_right_one_is_frozen_if_the_samples_go_on() {
        let fast = [Some(6.0); 2];
        assert_eq!(said([fast, fast, [Some(0.1), None]], 6.0), Some(Stop::One(0)));
        assert_eq!(said([fast, fast, [Some(0.1), None]], 0.1), None);
        let alone = [Some(6.0), None];
        assert_eq!(
            said([alone, alone, [Some(0.1), None]], 6.0),
            Some(Stop::All),
            "the right one shows nothing"
        );
    }
}
