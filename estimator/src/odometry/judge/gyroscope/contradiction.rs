//! A contradiction between gyroscope and images that lasts: which of them is wrong, and when it is over.

use super::super::FRAMES_TO_AGREE;
use super::PLAIN_RAD;
use super::angles::{GyroAngles, MAX_TURNS, Turn};
use super::lag::{delay, rotation};
use crate::estimate::HealthBits;
use crate::window::trial::SAME_TURN_RAD;
use heapless::Deque;
use nalgebra::Vector3;
use plumbline_config::{Portable, Timestamp};

/// It is over after [`FRAMES_TO_AGREE`], and twice as many if a delay was found. Once the gyroscope is named, those in which the vehicle does not
/// turn about the axis that was wrong count as so much: an axis that is dead agrees with them.
const IDLE_FRAME: f64 = 0.25;
/// While the vehicle turns by less than this in a frame, rad, agreement proves nothing.
const PROVES_RAD: f64 = 3e-3;
/// A contradiction without a name is a dispute after this time, s.
const DISPUTE_S: f64 = 1.0;
/// Mean over the frames of the squared multiple of what may differ, by which a gyroscope is wrong, and as much of it as counts: an image that
/// jumps differs once, and a crowd that is taken for the scene by little. Or the latter by which the newest frames differ in sum, if no frame
/// makes up half of it: a small error that lasts.
const MEAN_EXCESS_SQUARED: f64 = 0.7;
const MOST_EXCESS: f64 = 2.0;
/// It is wrong at once if so many frames on end differ by so many times what may, in one direction (cosine), and turn this many times as fast as
/// the images have: no delay and no jump of an image does that.
const PLAIN_FRAMES: u32 = 2;
pub(super) const PLAIN_EXCESS: f64 = 4.0;
const PLAIN_COSINE: f64 = 0.8;
const PLAIN_SPEED: f64 = 2.0;

/// Sensor that is wrong.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) enum Culprit {
    /// Not known yet.
    #[default]
    Unknown,
    /// Inertial samples are late by so many seconds.
    Imu(f64),
    /// Images are late by so many seconds.
    Images(f64),
    /// It could not be found out.
    Disputed,
}

impl Culprit {
    /// The stream that is late where the gyroscope is `lag_s` behind the images.
    pub(super) fn of(lag_s: f64) -> Self {
        if lag_s > 0.0 { Self::Imu(lag_s) } else { Self::Images(-lag_s) }
    }
}

/// Turns of the last frames, and what the gyroscope read.
#[derive(Clone, Copy)]
pub(super) struct Evidence<'a> {
    pub(super) angles: &'a GyroAngles,
    pub(super) turns: &'a Deque<Turn, MAX_TURNS>,
}

/// Addition of a frame to a contradiction.
#[derive(Clone, Copy, Debug)]
pub(super) struct NewestTurn {
    pub(super) turn: Turn,
    /// Difference from the gyroscope, rad, and as a multiple of what it may come to.
    pub(super) difference: Vector3<f64>,
    pub(super) excess: f64,
    /// Multiple of what the newest frames may differ by in sum; 0 where one of them makes up half of it.
    pub(super) sum_excess: f64,
    /// True if the frames that agree differ by too much in sum.
    pub(super) adds_up: bool,
}

impl NewestTurn {
    /// True if it contradicts by itself.
    pub(super) fn differs(&self) -> bool {
        self.excess > 1.0
    }
}

/// A contradiction that lasts.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Contradiction {
    pub(super) since: Timestamp,
    pub(super) culprit: Culprit,
    /// The bias before it, rad/s.
    pub(super) bias_gyro: Vector3<f64>,
    /// Frames on end that agree.
    agreeing: f64,
    /// Frames so far, at most as many as turns are kept, and the mean over them of the squared excess.
    frames: u32,
    mean_excess_squared: f64,
    /// True if the newest frames differ by much in sum.
    is_off_in_sum: bool,
    /// Frames on end that differ plainly, and the last difference.
    plain: u32,
    last: Vector3<f64>,
    /// Largest difference, rad, the sum of the squares of all, and whether the gyroscope has been named.
    largest: Vector3<f64>,
    squares: f64,
    was_gyro_named: bool,
    /// True if a turn that the images did not tell shortly precedes those that contradict.
    pub(super) is_begin_hidden: bool,
    /// Rotation of the cameras on the body that explains it, rad.
    turned: Option<Vector3<f64>>,
    /// False if something else is as likely to be wrong as the gyroscope.
    may_name_gyro: bool,
    /// True if a crowd may carry the images: they contradict the accelerometer too, or many landmarks do not agree with them.
    pub(super) is_carried: bool,
}

impl Contradiction {
    /// A contradiction that begins.
    pub(super) fn begin(since: Timestamp, bias_gyro: Vector3<f64>, may_name_gyro: bool) -> Self {
        Self { since, bias_gyro, may_name_gyro, is_carried: !may_name_gyro, ..Self::default() }
    }

    /// Takes what a frame differs by.
    pub(super) fn count(&mut self, newest: &NewestTurn, evidence: &Evidence<'_>) {
        self.frames = (self.frames + 1).min(MAX_TURNS as u32);
        let excess_squared = newest.excess.at_most(MOST_EXCESS).squared();
        self.mean_excess_squared += (excess_squared - self.mean_excess_squared) / f64::from(self.frames);
        self.is_off_in_sum = newest.sum_excess >= MOST_EXCESS;
        if self.plain < PLAIN_FRAMES {
            let fastest =
                evidence.turns.iter().map(Turn::rate_rad_s).fold(0.0, |most, x: f64| x.at_least(most));
            let speed = newest.difference.norm() / newest.turn.dt_s();
            let is_plain = newest.excess > PLAIN_EXCESS && speed > PLAIN_SPEED * fastest;
            let along = self.last.dot(&newest.difference) / (self.last.norm() * newest.difference.norm());
            self.plain = match (is_plain, along > PLAIN_COSINE) {
                (true, true) => self.plain + 1,
                (true, false) => 1,
                (false, _) => 0,
            };
        }
        self.last = newest.difference;
        self.squares += newest.difference.norm_squared();
        if newest.differs() && newest.difference.norm_squared() > self.largest.norm_squared() {
            self.largest = newest.difference;
        }
    }

    /// Takes another frame: who is to blame, and whether it is over.
    pub(super) fn settle(&mut self, newest: &NewestTurn, evidence: &Evidence<'_>) -> bool {
        self.count(newest, evidence);
        if self.is_open() {
            if let Some(lag_s) = delay(evidence.angles, evidence.turns, self.since, &self.bias_gyro) {
                self.culprit = Culprit::of(lag_s);
            } else if newest.turn.to.seconds_since(self.since) > DISPUTE_S {
                self.culprit = Culprit::Disputed;
            }
            // Seen as it happened, or hidden while all points were lost: else a gyroscope that is wrong explains the turns.
            let is_seen = |turned: &Vector3<f64>| {
                self.is_jump() && 4.0 * (self.largest + turned).norm_squared() < turned.norm_squared()
            };
            self.turned = rotation(evidence.angles, evidence.turns, self.since, &self.bias_gyro)
                .filter(|turned| self.is_begin_hidden || is_seen(turned));
        }
        self.was_gyro_named |= self.is_gyro_named(evidence);
        if newest.differs() {
            self.agreeing = 0.0;
        } else if self.proves_agreement(&newest.turn, evidence) {
            let is_idle = newest.turn.seen.dot(&self.largest).abs() < PROVES_RAD * self.largest.norm();
            self.agreeing += if self.was_gyro_named && is_idle { IDLE_FRAME } else { 1.0 };
        }
        let is_delay = matches!(self.culprit, Culprit::Imu(_) | Culprit::Images(_));
        let agrees = self.agreeing >= f64::from(FRAMES_TO_AGREE) * if is_delay { 2.0 } else { 1.0 };
        self.turned.is_some() || (agrees && !newest.adds_up)
    }

    /// True if no delay explains it.
    fn is_open(&self) -> bool {
        matches!(self.culprit, Culprit::Unknown | Culprit::Disputed)
    }

    /// True if agreement of the turn with the gyroscope is evidence: the turn is large, or would contradict the gyroscope under
    /// the lag in question.
    fn proves_agreement(&self, turn: &Turn, Evidence { angles, turns }: &Evidence<'_>) -> bool {
        let lag_s = match self.culprit {
            Culprit::Unknown => return true,
            Culprit::Disputed => return turn.seen.norm() > PROVES_RAD,
            Culprit::Imu(lag_s) => lag_s,
            Culprit::Images(late_s) => -late_s,
        };
        // The gyroscope of a later time is known for an earlier turn only.
        let lag_ns = (lag_s * 1e9) as i64;
        let known = turns.iter().rev().find_map(|t| angles.difference(t, lag_ns, &self.bias_gyro));
        known.is_some_and(|difference| difference.norm() > 2.0 * SAME_TURN_RAD)
    }

    /// True if a single frame makes up most of what differs.
    fn is_jump(&self) -> bool {
        2.0 * self.largest.norm_squared() > self.squares
    }

    /// Rotation, rad, that takes turns of the vehicle to those that the images show since these have jumped against the gyroscope, if nothing
    /// names one of them: the cameras may have been moved.
    pub(super) fn jump(&self) -> Option<Vector3<f64>> {
        let turned = self.turned.unwrap_or(-self.largest);
        let may_be = self.turned.is_some() || self.is_jump() || !self.was_gyro_named;
        (self.is_open() && may_be && turned.norm() > PLAIN_RAD).then_some(turned)
    }

    /// Says in `health` what was found.
    pub(super) fn report(&self, evidence: &Evidence<'_>, health: &mut HealthBits) {
        if self.is_gyro_named(evidence) {
            health.insert(HealthBits::GYRO_CONTRADICTED);
        }
        health.insert(match self.culprit {
            Culprit::Unknown => HealthBits::IMU_CONTRADICTED,
            Culprit::Imu(_) => HealthBits::IMU_LATE,
            Culprit::Images(_) => HealthBits::IMAGES_LATE,
            Culprit::Disputed => HealthBits::ROTATION_DISPUTED,
        });
    }

    /// True if the gyroscope is the faulty sensor: plainly, or since no delay explains what differs over so many turns.
    fn is_gyro_named(&self, Evidence { angles, turns }: &Evidence<'_>) -> bool {
        if self.plain >= PLAIN_FRAMES {
            return true;
        }
        let is_lasting = self.mean_excess_squared >= MEAN_EXCESS_SQUARED || self.is_off_in_sum;
        if !self.is_open() || !self.may_name_gyro || !is_lasting {
            return false;
        }
        let since = turns.iter().rev().take_while(|turn| turn.from >= self.since);
        let measured = since.filter(|turn| angles.difference(turn, 0, &self.bias_gyro).is_some());
        measured.count() >= FRAMES_TO_AGREE as usize
    }
}
