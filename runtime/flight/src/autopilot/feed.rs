//! Which `ODOMETRY` goes out at a deadline, if any: a function of the odometry so far and of the time.
//!
//! Nothing is sent before the first pose. A message never repeats the stamp of one before it: where the tick has missed its time,
//! the deadline passes without a message. While the odometry is lost, the last pose goes out with quality -1.

use super::frames::{VehicleFrames, VehicleOdometry};
use super::handover::Handover;
use super::message;
use super::status::{OdometryCondition, Reason, STALE_NS};
use crate::schedule::ticker::Monotonic;
use mavlink::dialects::common::ODOMETRY_DATA;
use plumbline_config::options::LostPose;
use plumbline_record::QUALITY_TO_USE;

/// Lowest quality that stands for odometry to be used: MAVLink's 0 is an unknown one.
const MIN_QUALITY: i8 = 1;

/// State of what is sent.
#[derive(Clone, Debug)]
pub struct MessageFeed {
    frames: VehicleFrames,
    lost_pose: LostPose,
    newest: Option<Handover>,
    /// Last pose that was good, and the count of steps that belongs to it.
    last: Option<(VehicleOdometry, u32)>,
    /// Time that stamped the last message.
    sent: Monotonic,
}

impl MessageFeed {
    /// A feed without odometry.
    pub fn new(frames: VehicleFrames, lost_pose: LostPose) -> Self {
        Self { frames, lost_pose, newest: None, last: None, sent: Monotonic(i64::MIN) }
    }

    /// Takes newer odometry.
    pub fn take(&mut self, newer: Handover) {
        self.newest = Some(newer);
    }

    /// Condition of the newest odometry at `now`. `has_pose` is false when the estimate was given up after that odometry: it is then
    /// lost at once. `has_stamp` says whether a time can be brought to the clock that stamps.
    pub fn condition(
        &mut self,
        has_pose: bool,
        now: Monotonic,
        has_stamp: impl Fn(Monotonic) -> bool,
    ) -> OdometryCondition {
        let Some(Handover { odometry, measured, rot_l_o }) = &self.newest else {
            return OdometryCondition::Starting;
        };
        if now.0.saturating_sub(measured.0) > STALE_NS {
            return OdometryCondition::Lost(Reason::Silent);
        }
        if !has_pose {
            return OdometryCondition::Lost(Reason::Failed);
        }
        if !has_stamp(*measured) {
            return OdometryCondition::Lost(Reason::NoClock);
        }
        match OdometryCondition::of(odometry.state) {
            OdometryCondition::Tracking => {}
            lost => return lost,
        }
        if odometry.quality < MIN_QUALITY {
            return OdometryCondition::Lost(Reason::Uncertain);
        }
        let vehicle = self.frames.convert(odometry, rot_l_o);
        if !vehicle.is_finite() {
            return OdometryCondition::Lost(Reason::NotFinite);
        }
        self.last = Some((vehicle, odometry.steps()));
        OdometryCondition::Tracking
    }

    /// True if the odometry in this condition is good enough for flight: it tracks, and its velocity is known well.
    pub fn is_usable(&self, condition: OdometryCondition) -> bool {
        let quality = self.newest.as_ref().map_or(0, |newest| newest.odometry.quality);
        condition == OdometryCondition::Tracking && quality >= QUALITY_TO_USE
    }

    /// Message for a deadline at `now` in this condition; `usec` stamps a time, where that is known.
    pub fn message(
        &mut self,
        condition: OdometryCondition,
        now: Monotonic,
        usec: impl Fn(Monotonic) -> Option<u64>,
    ) -> Option<ODOMETRY_DATA> {
        let (vehicle, steps) = self.last.as_ref()?;
        let (message, stamped) = match (condition, &self.newest) {
            (OdometryCondition::Tracking, Some(newest)) => {
                let (at, quality) = (newest.measured, newest.odometry.quality);
                (message::tracking(vehicle, usec(at)?, quality, *steps), at)
            }
            _ if self.lost_pose == LostPose::Last => (message::lost(vehicle, usec(now)?, *steps), now),
            _ => return None,
        };
        if stamped <= self.sent {
            return None;
        }
        self.sent = stamped;
        Some(message)
    }
}

#[cfg(test)]
mod tests {
    use super::super::fixture::odometry;
    use super::*;
    use nalgebra::UnitQuaternion;
    use plumbline_estimator::Odometry;

    const MS: i64 = 1_000_000;

    fn feed(lost_pose: LostPose) -> MessageFeed {
        MessageFeed::new(VehicleFrames::new(&UnitQuaternion::identity()), lost_pose)
    }

    /// Message that is sent at `now`, ms.
    fn sent(feed: &mut MessageFeed, has_pose: bool, now_ms: i64) -> Option<ODOMETRY_DATA> {
        let now = Monotonic(now_ms * MS);
        let condition = feed.condition(has_pose, now, |_| true);
        feed.message(condition, now, |at| Some((at.0 / 1000) as u64))
    }

    fn taken(feed: &mut MessageFeed, at_ms: i64, odometry: Odometry) {
        let frames = VehicleFrames::new(&UnitQuaternion::identity());
        let rot_l_o = frames.local_frame(&odometry.pose_o_b);
        feed.take(Handover { odometry, measured: Monotonic(at_ms * MS), rot_l_o });
    }

    #[test]
    fn a_missed_tick_repeats_no_stamp() {
        let mut feed = feed(LostPose::Last);
        taken(&mut feed, 100, odometry());
        assert_eq!(sent(&mut feed, true, 102).unwrap().time_usec, 100_000);
        assert_eq!(sent(&mut feed, true, 127), None);
        taken(&mut feed, 130, odometry());
        assert_eq!(sent(&mut feed, true, 152).unwrap().time_usec, 130_000);
        // Silence ends in messages that say so, each with a time of its own.
        let after: Vec<_> = (1..80).filter_map(|k| sent(&mut feed, true, 152 + 25 * k)).collect();
        assert!(after.len() > 50 && after.iter().all(|m| m.quality == -1));
        assert!(after.windows(2).all(|pair| pair[1].time_usec > pair[0].time_usec));
    }

    #[test]
    fn a_feed_told_to_be_silent_sends_nothing_while_lost() {
        let mut feed = feed(LostPose::None);
        taken(&mut feed, 100, odometry());
        assert!(sent(&mut feed, true, 101).is_some());
        assert!((0..80).all(|k| sent(&mut feed, true, 125 + 25 * k).is_none()));
    }
}
