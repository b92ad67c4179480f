//! Agreement of gyroscope and images about the vehicle's rotation, and the late one of the two if they disagree.
//!
//! The images alone give the turn of every frame since the one before ([`super::turn_by_images`]), to some tenths of a
//! milliradian. In clean and in recorded flights the gyroscope differs from it by less than a milliradian. What the frames of some tenths of
//! a second differ by in sum contradicts it, and the inertial samples are not believed any more, from the first of them on. An error of
//! a frame's stamp turns that frame by as much as the vehicle turns in that time, but leaves no trace in the sum: its size is learnt from
//! frames on end that differ in opposite directions ([`super::stamp::noise`]). A clock that jumps leaves a hole in its stream: right after one,
//! a single frame is enough.
//!
//! After a hole of the inertial samples they are on probation: not believed until the turns of frames are likelier with them than
//! with samples that are late by the hole ([`probation`]).
//!
//! In a contradiction the attitudes of the last frames are compared with what the gyroscope measured up to 0.6 s earlier or later ([`lag`]). If
//! they agree with the gyroscope of a later stamp, the stamps of the IMU are late; with that of an earlier one, those of the images
//! are. Without such a time neither can be named, and the rotation is disputed. While stamps are corrected, a delay need not contradict first.

mod angles;
mod contradiction;
mod differences;
mod lag;
mod probation;

use super::stamp::noise::StampNoise;
use super::{FRAMES_TO_AGREE, SHORTLY_S};
use crate::estimate::{HealthBits, NavCovariance};
use crate::geometry::log_so3;
use crate::window::sighting::variance_along;
use crate::window::state::NavState;
use crate::window::trial::{CONTRADICTS_SIGMAS, DOUBTFUL_SIGMAS};
use angles::{Gap, GyroAngles, MAX_TURNS, Turn};
use contradiction::{Contradiction, Culprit, Evidence, NewestTurn, PLAIN_EXCESS};
use differences::{Difference, Differences, Sigmas};
use heapless::Deque;
use lag::{delay, on_end};
use nalgebra::{Matrix3, UnitQuaternion, Vector3};
use plumbline_config::options::ImuConfig;
use plumbline_config::{ImuSample, Portable, Timestamp};
use probation::Probation;

/// One frame is enough if it differs by [`PLAIN_EXCESS`] times as much, and by more than this, rad, and than what the vehicle turns in this time, s: no
/// sighting and no stamp is that wrong.
const PLAIN_RAD: f64 = 0.02;
const PLAIN_S: f64 = 0.015;
/// A hole in a stream is thought of for so long, s; frames that are further apart than this have one between them, s.
const SUSPICIOUS_S: f64 = 1.0;
const FRAME_HOLE_S: f64 = 0.25;
/// Speed assumed of the position's drift from the estimate while it is undecided which sensor is wrong, m/s.
const DISPUTED_M_S: f64 = 0.5;
/// Share of the landmarks below which a crowd may carry the images: fewer agree with their pose. The heading is unknown beyond this angle, rad.
const CARRIED_SHARE: f64 = 0.8;
const MOST_CARRIED_RAD: f64 = 1.0;

/// Rotation of a frame as the images saw it.
#[derive(Clone, Copy, Debug)]
pub(super) struct SeenTurn {
    /// Times of the states of the frame before, and of this one.
    pub(super) span: [Timestamp; 2],
    /// Stamps of both.
    pub(super) stamps: [Timestamp; 2],
    /// Standard deviation of these times where errors of stamps are corrected, s.
    pub(super) time_sigma_s: Option<f64>,
    /// Attitude of this frame by known landmarks.
    pub(super) rot_o_b: Option<UnitQuaternion<f64>>,
    /// The turn from the state of the frame before, rad, and its covariance, rad².
    pub(super) seen: Vector3<f64>,
    pub(super) covariance: Matrix3<f64>,
    /// Share of the landmarks that agree with where the images place the frame, and its speed, m/s.
    pub(super) agreeing_share: f64,
    pub(super) speed_m_s: f64,
    /// Present bias of the gyroscope, rad/s, and its standard deviation.
    pub(super) bias_gyro: Vector3<f64>,
    pub(super) bias_sigma_rad_s: f64,
    /// Samples are missing since the frame before.
    pub(super) skips_samples: bool,
    /// The accelerometer is contradicted.
    pub(super) is_force_contradicted: bool,
    /// Landmarks vote for the turn by the images against the predicted one; where both explain them, the former is that of a few, or of a
    /// crowd that is hardly faster than its noise.
    pub(super) is_voted: bool,
}

/// Compares the turns of frames with the gyroscope.
#[derive(Clone, Debug)]
pub(super) struct RotationWatch {
    angles: GyroAngles,
    turns: Deque<Turn, MAX_TURNS>,
    differences: Differences,
    stamps: StampNoise,
    /// When a hole in a stream began, and until when it is thought of.
    suspicious: Option<(Timestamp, Timestamp)>,
    contradiction: Option<Contradiction>,
    /// When the accelerometer was last contradicted.
    forces_contradicted: Option<Timestamp>,
    probation: Option<Probation>,
    /// Rotation by a contradiction that is over and has named nothing, rad.
    jumped: Option<Vector3<f64>>,
    /// Standard deviation of the position that disputes have left, m, and of the attitude, rad.
    left_m: f64,
    left_rad: f64,
    /// Turn during which a crowd may have carried the images, rad: the standard deviation of the direction of the way since.
    carried_rad: f64,
    /// Sum of the newest differences on end that are in doubt, rad: they contradict nothing yet, and the attitude has followed the gyroscope.
    doubtful: Vector3<f64>,
}

impl RotationWatch {
    pub(super) fn new(imu: &ImuConfig) -> Self {
        Self {
            angles: GyroAngles::new(imu),
            turns: Deque::new(),
            differences: Differences::new(imu.gyro_noise_density),
            stamps: StampNoise::default(),
            suspicious: None,
            contradiction: None,
            forces_contradicted: None,
            probation: None,
            jumped: None,
            left_m: 0.0,
            left_rad: 0.0,
            carried_rad: 0.0,
            doubtful: Vector3::zeros(),
        }
    }

    /// Forgets samples and turns, as after a clock was set.
    pub(super) fn clear(&mut self) {
        self.angles.clear();
        self.forget_turns();
        self.forces_contradicted = None;
    }

    /// Forgets turns and contradiction: the estimate starts anew.
    pub(super) fn forget_turns(&mut self) {
        self.turns.clear();
        self.differences.clear();
        (self.contradiction, self.suspicious, self.probation, self.jumped) = (None, None, None, None);
        (self.left_m, self.left_rad, self.carried_rad, self.doubtful) = (0.0, 0.0, 0.0, Vector3::zeros());
    }

    /// Takes a sample of the gyroscope, as it was read.
    pub(super) fn add(&mut self, sample: &ImuSample) {
        if let Some(Gap { since, length_ns }) = self.angles.add(sample)
            && let Some(probation) = Probation::after_hole(since, length_ns, sample.stamp)
        {
            self.probation = Some(probation);
        }
    }

    /// Takes the turn of a frame; returns since when inertial samples are not to be believed, once that begins.
    pub(super) fn update(&mut self, frame: &SeenTurn) -> Option<Timestamp> {
        let [from, to] = frame.span;
        let SeenTurn { seen, covariance, is_voted, time_sigma_s, .. } = *frame;
        let by_stamp_rad = self.stamps.sigma_s() * seen.norm() / to.seconds_since(from);
        let variance = variance_along(&covariance, &seen) + by_stamp_rad.squared();
        let turn = Turn { from, to, seen, rot_o_b: frame.rot_o_b, variance };
        let stamped = Turn { from: frame.stamps[0], to: frame.stamps[1], ..turn };
        // The state of the frame before follows the gyroscope, too: where both were sighted counts.
        let before = self.turns.back().filter(|before| before.to == stamped.from);
        let between = before.and_then(|before| Some(log_so3(&(before.rot_o_b?.inverse() * frame.rot_o_b?))));
        if self.turns.is_full() {
            self.turns.pop_front();
        }
        let _ = self.turns.push_back(Turn { seen: between.unwrap_or(seen), ..stamped });
        let dt_s = to.seconds_since(from);
        self.left_m += self.carried_rad.at_most(MOST_CARRIED_RAD) * frame.speed_m_s * dt_s;
        if frame.skips_samples || dt_s > FRAME_HOLE_S {
            let begun = self.suspicious.filter(|(_, until)| from <= *until).map_or(from, |(begun, _)| begun);
            self.suspicious = Some((begun, to.plus_seconds(SUSPICIOUS_S)));
        }
        if frame.is_force_contradicted {
            self.forces_contradicted = Some(to);
        }
        let begun = self.probation.as_mut().and_then(Probation::begin);
        let bias_gyro = self.contradiction.map_or(frame.bias_gyro, |c| c.bias_gyro);
        let Some(rad) = self.angles.difference(&turn, 0, &bias_gyro) else {
            self.differences.clear();
            return begun;
        };
        let between = between.and_then(|seen| self.angles.difference(&Turn { seen, ..turn }, 0, &bias_gyro));
        let by_stamps = self.angles.difference(&stamped, 0, &bias_gyro).unwrap_or(rad);
        let difference =
            Difference { from, dt_s, rad, seen, between, covariance, is_voted, by_stamps, time_sigma_s };
        let before = self.differences.push(difference).filter(|_| self.contradiction.is_none());
        if let Some(before) = &before {
            self.stamps.add(
                [before.by_stamps, by_stamps],
                [before.rate_b(), difference.rate_b()],
                variance_along(&covariance, &seen),
            );
        }
        let sigmas = Sigmas { bias_rad_s: frame.bias_sigma_rad_s, stamp_s: self.stamps.sigma_s() };
        let excess = self.differences.newest_excess(&sigmas);
        self.probation = self.probation.and_then(|probation| probation.after(&self.turns, &rad, excess));
        let mut newest = NewestTurn { turn, difference: rad, excess, sum_excess: 0.0, adds_up: false };
        let contradicted = if self.contradiction.is_some() {
            newest.adds_up = self.differences.contradict_since(&sigmas).is_some();
            newest.sum_excess = self.differences.even_excess(&sigmas);
            self.settle(&newest, frame.agreeing_share);
            None
        } else {
            self.begin_contradiction(&newest, frame, &sigmas)
        };
        let is_doubtful = self.contradiction.is_none() && excess > DOUBTFUL_SIGMAS / CONTRADICTS_SIGMAS;
        self.doubtful = if is_doubtful { self.doubtful + rad } else { Vector3::zeros() };
        contradicted.or(begun)
    }

    /// Standard deviation of the stamps of frames, s, as far as it shows.
    pub(super) fn stamp_sigma_s(&self) -> f64 {
        self.stamps.sigma_s()
    }

    /// Ends the probation: nothing is seen by which samples could prove themselves.
    pub(super) fn end_probation(&mut self) {
        self.probation = None;
    }

    /// Before a contradiction: whether it begins, and since when.
    fn begin_contradiction(
        &mut self,
        newest: &NewestTurn,
        frame: &SeenTurn,
        sigmas: &Sigmas,
    ) -> Option<Timestamp> {
        let [from, to] = frame.span;
        let hole = self.hole_before(to);
        let least_rad = PLAIN_RAD + PLAIN_S * newest.turn.rate_rad_s();
        let is_plain = newest.difference.norm() > least_rad && newest.excess > PLAIN_EXCESS;
        let alone = (is_plain || (hole.is_some() && newest.differs())).then_some(from);
        let by_sums = alone.or_else(|| self.differences.contradict_since(sigmas));
        let (first, culprit) = match by_sums {
            Some(first) => (first, Culprit::Unknown),
            None => self.late_since(frame)?,
        };
        let since = hole.map_or(first, |(begun, _)| begun.min(first));
        // Where the accelerometer was contradicted, the images have gone on alone since, and not as well.
        let may_name_gyro = self.forces_contradicted.is_none_or(|last| from.seconds_since(last) > SHORTLY_S);
        let mut contradiction = Contradiction::begin(since, frame.bias_gyro, may_name_gyro);
        contradiction.culprit = culprit;
        let on_end_since = on_end(&self.turns, Timestamp::default()).last().map(|turn| turn.from);
        let shortly_before = since.plus_seconds(-f64::from(FRAMES_TO_AGREE) * newest.turn.dt_s());
        contradiction.is_begin_hidden = hole.is_none() && on_end_since > Some(shortly_before);
        contradiction.count(newest, &self.evidence());
        self.contradiction = Some(contradiction);
        Some(since)
    }

    /// Which stream is late, and since when at the latest, if that explains what is corrected as errors of stamps. A delay by a frame or more
    /// contradicts without that.
    fn late_since(&self, frame: &SeenTurn) -> Option<(Timestamp, Culprit)> {
        frame.time_sigma_s?;
        let first = on_end(&self.turns, Timestamp::default()).last()?;
        let lag_s = delay(&self.angles, &self.turns, first.from, &frame.bias_gyro)?;
        (lag_s.abs() < first.dt_s()).then(|| (first.to, Culprit::of(lag_s)))
    }

    /// The hole in a stream that is still thought of at `stamp`.
    fn hole_before(&self, stamp: Timestamp) -> Option<(Timestamp, Timestamp)> {
        self.suspicious.filter(|(_, until)| stamp <= *until)
    }

    /// True if a stream had a hole shortly before `stamp`.
    pub(super) fn is_suspicious_at(&self, stamp: Timestamp) -> bool {
        self.hole_before(stamp).is_some()
    }

    /// Goes on with a contradiction; `agreeing_share` of the landmarks agree with the images.
    fn settle(&mut self, newest: &NewestTurn, agreeing_share: f64) {
        let Some(mut contradiction) = self.contradiction else { return };
        contradiction.is_carried |= agreeing_share < CARRIED_SHARE;
        let is_over = contradiction.settle(newest, &self.evidence());
        let turned_rad = newest.turn.seen.norm();
        if contradiction.culprit == Culprit::Disputed || contradiction.is_carried {
            self.left_m += DISPUTED_M_S * newest.turn.to.seconds_since(newest.turn.from);
            self.left_rad += turned_rad;
        }
        if contradiction.is_carried {
            self.carried_rad += turned_rad;
        }
        self.contradiction = (!is_over).then_some(contradiction);
        if is_over {
            self.jumped = contradiction.jump();
            self.differences.clear();
        }
    }

    fn evidence(&self) -> Evidence<'_> {
        Evidence { angles: &self.angles, turns: &self.turns }
    }

    /// True while the inertial samples are distrusted.
    pub(super) fn is_distrusting(&self) -> bool {
        self.contradiction.is_some() || self.probation.is_some_and(|probation| probation.has_begun())
    }

    /// True while the inertial samples are distrusted by images that a crowd may carry.
    pub(super) fn is_carried(&self) -> bool {
        self.contradiction.is_some_and(|contradiction| contradiction.is_carried)
    }

    /// Says in `health` what was found.
    pub(super) fn report(&self, health: &mut HealthBits) {
        if let Some(contradiction) = &self.contradiction {
            contradiction.report(&self.evidence(), health);
        }
    }

    /// The rotation by which images and gyroscope have jumped against each other, rad, once their contradiction is over and nothing was named.
    pub(super) fn take_jump(&mut self) -> Option<Vector3<f64>> {
        self.jumped.take()
    }

    /// True while images and gyroscope contradict each other.
    pub(super) fn is_contradicted(&self) -> bool {
        self.contradiction.is_some()
    }

    /// Covariance to add to that of the state `nav`, which turns by `rate_b`, for errors that it does not include.
    pub(super) fn added_covariance(&self, nav: &NavState, rate_b: &Vector3<f64>) -> Option<NavCovariance> {
        let late_s = match self.contradiction.map(|c| c.culprit) {
            Some(Culprit::Images(late_s)) => late_s,
            _ => 0.0,
        };
        if late_s == 0.0 && self.left_m == 0.0 && self.left_rad == 0.0 && self.doubtful == Vector3::zeros() {
            return None;
        }
        let mut added = NavCovariance::zeros();
        let mut add = |part: usize, off: &Vector3<f64>, sigma: f64| {
            let mut block = off * off.transpose();
            (0..3).for_each(|k| block[(k, k)] += sigma * sigma);
            added.fixed_view_mut::<3, 3>(part, part).copy_from(&block);
        };
        add(NavState::P, &(nav.v_o_b * late_s), self.left_m);
        // Gravity tells roll and pitch again once the sensors agree; only the yaw stays lost.
        let tilt_rad = if self.contradiction.is_some() { self.left_rad } else { 0.0 };
        add(NavState::ROT, &(rate_b * late_s), tilt_rad);
        add(NavState::V, &Vector3::zeros(), nav.v_o_b.norm() * rate_b.norm() * late_s);
        let up_b = nav.rot_o_b.inverse() * Vector3::z();
        let mut of_rotation = added.fixed_view_mut::<3, 3>(NavState::ROT, NavState::ROT);
        of_rotation += up_b * up_b.transpose() * (self.left_rad.squared() - tilt_rad.squared());
        of_rotation += self.doubtful * self.doubtful.transpose();
        Some(added)
    }
}

#[cfg(test)]
mod tests;
