//! A contradiction between gyroscope and images that lasts: which of them is wrong, and when it is over.

use super::gyro_angles::{GyroAngles, MAX_TURNS, Turn};
use super::lag::{Delay, delay};
use super::rotation_watch::AGREES_RAD;
use crate::estimate::HealthBits;
use heapless::Deque;
use nalgebra::Vector3;
use plumbline_config::Timestamp;

/// Frames on end that agree before it is over: half a second at 20 Hz, and twice as many if a delay was found.
const FRAMES_TO_AGREE: u32 = 10;
/// While the vehicle turns by less than this in a frame, rad, agreement proves nothing.
const PROVES_RAD: f64 = 3e-3;
/// A contradiction without a name is a dispute after this time, s.
const DISPUTE_S: f64 = 1.0;
/// Largest quality while it is not known which of the sensors is wrong, or while the images are late.
const DISPUTED_QUALITY: i8 = 10;
/// Turns by which the gyroscope is named, and how much of what differs the images turn by themselves.
const TURNS_TO_NAME: usize = 10;
const TURNING_SHARE: f64 = 0.2;
/// Share of the turns that differ by themselves if the gyroscope is wrong: an image that jumps differs once, and a crowd that is taken
/// for the scene by little.
const DIFFERING_SHARE: f64 = 0.5;
/// Errors of the stamps of a turn explain so much of it, s; and this share of what differs must be left.
const STAMPS_S: f64 = 0.012;
const UNEXPLAINED_SHARE: f64 = 0.5;

/// Sensor that is wrong.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Culprit {
    /// Not known yet.
    Unknown,
    /// Inertial samples are late by so many seconds.
    Imu(f64),
    /// Images are late by so many seconds.
    Images(f64),
    /// It could not be found out.
    Disputed,
}

/// Turns of the last frames, and what the gyroscope read.
#[derive(Clone, Copy)]
pub(super) struct Evidence<'a> {
    pub(super) angles: &'a GyroAngles,
    pub(super) turns: &'a Deque<Turn, MAX_TURNS>,
}

/// What a frame adds to a contradiction.
#[derive(Clone, Copy, Debug)]
pub(super) struct NewestTurn {
    pub(super) turn: Turn,
    /// True if it contradicts by itself.
    pub(super) differs: bool,
    /// True if the frames that agree differ by too much in sum.
    pub(super) adds_up: bool,
}

/// A contradiction that lasts.
#[derive(Clone, Copy, Debug)]
pub(super) struct Contradiction {
    pub(super) since: Timestamp,
    pub(super) culprit: Culprit,
    /// The bias before it, rad/s.
    pub(super) bias_gyro: Vector3<f64>,
    /// True while a delay would explain much of it.
    is_delay_suspected: bool,
    /// Frames on end that agree.
    agreeing: u32,
    /// Frames so far, and those that differ by themselves.
    frames: u32,
    differing: u32,
    /// False if something else is as likely to be wrong as the gyroscope.
    may_name_gyro: bool,
}

impl Contradiction {
    /// A contradiction that begins, with a frame that `differs` by itself or not.
    pub(super) fn begin(
        since: Timestamp,
        bias_gyro: Vector3<f64>,
        differs: bool,
        may_name_gyro: bool,
    ) -> Self {
        Self {
            since,
            culprit: Culprit::Unknown,
            bias_gyro,
            is_delay_suspected: false,
            agreeing: 0,
            frames: 1,
            differing: u32::from(differs),
            may_name_gyro,
        }
    }

    /// Takes another frame: who is to blame, and whether it is over.
    pub(super) fn settle(&mut self, newest: &NewestTurn, evidence: &Evidence<'_>) -> bool {
        self.frames += 1;
        self.differing += u32::from(newest.differs);
        if self.is_open() {
            let delay = delay(evidence.angles, evidence.turns, self.since, &self.bias_gyro);
            self.is_delay_suspected = delay == Delay::Suspected;
            if let Delay::Found(lag_s) = delay {
                self.culprit = if lag_s > 0.0 { Culprit::Imu(lag_s) } else { Culprit::Images(-lag_s) };
            } else if newest.turn.to.seconds_since(self.since) > DISPUTE_S {
                self.culprit = Culprit::Disputed;
            }
        }
        if newest.differs {
            self.agreeing = 0;
        } else if self.proves_agreement(&newest.turn, evidence) {
            self.agreeing += 1;
        }
        let is_delay = matches!(self.culprit, Culprit::Imu(_) | Culprit::Images(_));
        self.agreeing >= FRAMES_TO_AGREE * if is_delay { 2 } else { 1 } && !newest.adds_up
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
        known.is_some_and(|difference| difference.norm() > 2.0 * AGREES_RAD)
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

    /// True if the gyroscope is the faulty sensor: after so many turns, half of which differ by themselves, no delay explains the
    /// contradiction, nor much of it, errors of stamps do not explain most of it, and the images do turn.
    fn is_gyro_named(&self, Evidence { angles, turns }: &Evidence<'_>) -> bool {
        let is_lasting = f64::from(self.differing) >= DIFFERING_SHARE * f64::from(self.frames);
        if !self.is_open() || !self.may_name_gyro || self.is_delay_suspected || !is_lasting {
            return false;
        }
        let (mut seen, mut off, mut left, mut count) = (0.0, 0.0, 0.0, 0);
        for turn in turns.iter().rev().take_while(|turn| turn.from >= self.since) {
            let Some(difference) = angles.difference(turn, 0, &self.bias_gyro) else { continue };
            seen += turn.seen.norm();
            off += difference.norm();
            left += beyond_stamps(&difference, turn).norm();
            count += 1;
        }
        count >= TURNS_TO_NAME && left > UNEXPLAINED_SHARE * off && seen > TURNING_SHARE * off
    }

    /// The quality of an estimate that would have `quality` if the sensors agreed.
    pub(super) fn bounded(&self, quality: i8) -> i8 {
        if let Culprit::Imu(_) = self.culprit { quality } else { quality.min(DISPUTED_QUALITY) }
    }
}

/// What is left of a turn's `difference` when errors of the stamps explain as much of it as they can, rad.
fn beyond_stamps(difference: &Vector3<f64>, turn: &Turn) -> Vector3<f64> {
    let rate = turn.seen / turn.to.seconds_since(turn.from);
    let squared = rate.norm_squared();
    let error_s = if squared > 0.0 { difference.dot(&rate) / squared } else { 0.0 };
    difference - rate * error_s.clamp(-STAMPS_S, STAMPS_S)
}
