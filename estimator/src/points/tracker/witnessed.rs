//! Turns that tracks tell where the predicted one is wrong ([`crate::points::witness`]).

use super::PointTracker;
use crate::points::prediction::{PredictedMotion, WitnessedTurn};
use crate::points::temporal::{Transition, WIDE_PX};
use crate::points::track::Track;
use crate::points::witness::{MAX_WITNESSES, Witnesses, find_turn};

/// With so many predicted points, a prediction that most of them miss is wrong.
const MIN_PREDICTED: usize = 12;
/// A point is told from its rival anywhere within [`WIDE_PX`] if that is so many times as far away.
const RIVAL_TIMES: f64 = 2.0;

impl PointTracker {
    /// The turn of the body by the tracks without rivals, as they were followed.
    pub(super) fn turn_by_unique(&self) -> Option<WitnessedTurn> {
        let motion = self.motion.as_ref()?;
        let followed = |track: &&Track| !track.lost && track.rival_px.is_none();
        turn_by(self.transitions(), motion, |transition| {
            let unique = self.store.tracks.iter().filter(followed);
            unique.filter_map(|track| transition.witness(track)).take(MAX_WITNESSES).collect()
        })
    }

    /// True if most points were not found well within the search around their predicted places.
    pub(super) fn is_prediction_missed(&self) -> bool {
        let was_within = self.store.tracks.iter().filter_map(|track| track.was_predicted);
        let (all, within) = (was_within.clone().count(), was_within.filter(|is_within| *is_within).count());
        all >= MIN_PREDICTED && 2 * within < all
    }

    /// Looks further for the points whose rivals are far away, where most points missed their predictions: a force that was not measured moves
    /// all of them. If most agree about it, all are followed once more.
    pub(super) fn follow_by_rivals(&mut self) {
        let Some(turn) = self.turn_by_rivals().filter(|turn| turn.is_other) else { return };
        if let Some(motion) = &mut self.motion {
            motion.pose_prev_cur_b.rotation = turn.rot_prev_cur_b;
        }
        std::mem::swap(&mut self.before, &mut self.store.tracks);
        self.follow_all();
    }

    /// The turn of the body by tracks whose rivals are far away, as they were before they were followed.
    fn turn_by_rivals(&self) -> Option<WitnessedTurn> {
        let motion = self.motion.as_ref()?;
        let is_far = |track: &&Track| track.rival_px.is_some_and(|px| f64::from(px) > RIVAL_TIMES * WIDE_PX);
        let wide = self.transitions().map(|t| t.map(|transition| Transition { is_wide: true, ..transition }));
        turn_by(wide, motion, |transition| {
            let found = |track: &Track| {
                let (mut track, mask) =
                    (Track { came_by: None, ..*track }, self.masks[transition.index].as_ref());
                let reference = &self.store.references[track.slot];
                let _ = transition.follow(&mut track, reference, mask);
                transition.witness(&track)
            };
            self.before.iter().filter(is_far).filter_map(found).take(MAX_WITNESSES).collect()
        })
    }
}

/// The turn of the body by the `witnesses` of the first camera in which enough of them agree.
fn turn_by<'a>(
    transitions: [Option<Transition<'a>>; 2],
    motion: &PredictedMotion,
    witnesses: impl Fn(&Transition<'a>) -> Witnesses,
) -> Option<WitnessedTurn> {
    transitions.iter().flatten().find_map(|transition| {
        let camera = transition.camera;
        let found = find_turn(&witnesses(transition), camera.focal_px(), motion.sigma_m)?;
        Some(WitnessedTurn::new(&motion.pose_prev_cur_b.rotation, &camera.pose_b_c.rotation, &found))
    })
}
