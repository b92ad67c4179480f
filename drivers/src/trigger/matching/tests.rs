//! Triggers and frames that are lost, late, and begin anew.

use super::*;
use plumbline_config::{Random, Timestamp};

const MS: i64 = 1_000_000;
const PERIOD_NS: i64 = 50 * MS;
const PULSE_NS: u32 = 4_000_000;
/// From the start of the exposure to its middle, ns.
const HALF_NS: i64 = 2 * MS;

/// A camera and its microcontroller; what was said of each frame.
struct Rig {
    matching: Matching,
    draws: Random,
    /// Stamps are late by this and by up to so much more, ns.
    late_ns: i64,
    jitter_ns: i64,
    /// Number of the first trigger, and of the frame less that of the trigger.
    first_counter: u32,
    frame_less_trigger: u64,
}

fn rig(late_ms: i64, jitter_ms: i64) -> Rig {
    Rig {
        matching: Matching::new(PERIOD_NS as f64),
        draws: Random::new(11),
        late_ns: late_ms * MS,
        jitter_ns: jitter_ms * MS,
        first_counter: 900,
        frame_less_trigger: 5000,
    }
}

/// Time of trigger `n`.
fn edge_ns(n: i64) -> i64 {
    1_000_000 * MS + n * PERIOD_NS
}

impl Rig {
    fn trigger(&mut self, n: i64) {
        self.matching.triggered(&TriggerEvent {
            counter: self.first_counter.wrapping_add(n as u32),
            stamp: Timestamp::from_nanos(edge_ns(n)),
            pulse_ns: PULSE_NS,
            cameras: 3,
        });
    }

    /// The frame of trigger `n`: what is said of it, as an error of its stamp where it has one, ns.
    fn frame(&mut self, n: i64) -> Result<i64, Matched> {
        let late_ns = self.late_ns + (self.draws.unit() * self.jitter_ns as f64) as i64;
        let stamp_ns = edge_ns(n) + HALF_NS + late_ns;
        let sequence = n as u64 + self.frame_less_trigger;
        match self.matching.frame(sequence, stamp_ns, |pulse_ns| i64::from(pulse_ns) / 2) {
            Matched::Trigger(middle_ns) | Matched::Predicted(middle_ns) => {
                Ok(middle_ns - edge_ns(n) - HALF_NS)
            }
            other => Err(other),
        }
    }

    /// Feeds trigger and frame `n`, except those that `lost` names.
    fn both(&mut self, n: i64, lost: impl Fn(i64) -> [bool; 2]) -> Option<Result<i64, Matched>> {
        let [trigger, frame] = lost(n);
        if !trigger {
            self.trigger(n);
        }
        (!frame).then(|| self.frame(n))
    }

    fn plays(&mut self, which: std::ops::Range<i64>) -> Vec<Result<i64, Matched>> {
        which.filter_map(|n| self.both(n, |_| [false; 2])).collect()
    }
}

#[test]
fn frames_are_stamped_by_their_own_triggers_whatever_is_lost_and_however_stamps_jitter() {
    for (late_ms, jitter_ms) in [(0, 0), (12, 20), (1, 24), (30, 5), (-8, 4)] {
        let mut rig = rig(late_ms, jitter_ms);
        let lost = |n: i64| [n % 7 == 3 || (40..46).contains(&n), n % 11 == 5 || (60..64).contains(&n)];
        let stamped: Vec<_> = (0..300).filter_map(|n| rig.both(n, lost)).collect();
        assert!(stamped[..AGREEING as usize - 1].iter().all(|said| *said == Err(Matched::Unknown)));
        let wrong: Vec<_> =
            stamped[AGREEING as usize..].iter().filter(|said| !matches!(said, Ok(-1..=1))).collect();
        assert!(wrong.is_empty(), "{late_ms} {jitter_ms}: {wrong:?}");
        assert_eq!(rig.matching.found(), 1);
        let delay_ms = rig.matching.delay_ns().unwrap() / MS as f64;
        assert!((delay_ms - late_ms as f64 - jitter_ms as f64 / 2.0).abs() < 8.0, "{delay_ms}");
    }
}

#[test]
fn counters_begin_anew_after_their_last_number() {
    let mut rig = rig(10, 5);
    rig.first_counter = u32::MAX - 20;
    assert!(rig.plays(0..60)[4..].iter().all(|said| *said == Ok(0)));
}

#[test]
fn a_camera_that_was_unplugged_is_found_again_and_stamped_by_its_usual_delay_meanwhile() {
    let mut rig = rig(12, 4);
    rig.plays(0..40);
    (40..80).for_each(|n| rig.trigger(n));
    // Its frames are numbered by time, which may be one off.
    rig.frame_less_trigger += 1;
    let back = rig.plays(80..120);
    let (first, rest) = back.split_at(AGREEING as usize);
    for (n, said) in (80..).zip(first) {
        let Err(Matched::Delay(stamp_ns)) = said else { panic!("{said:?}") };
        assert!((stamp_ns - edge_ns(n) - HALF_NS).abs() < 4 * MS);
    }
    assert!(rest.iter().all(|said| *said == Ok(0)), "{rest:?}");
    assert_eq!(rig.matching.found(), 2);
}

#[test]
fn a_frame_that_a_camera_lost_without_counting_is_noticed_and_none_is_stamped_a_period_off() {
    for off in [1_u64.wrapping_neg(), 1] {
        let mut rig = rig(12, 4);
        rig.plays(0..40);
        rig.frame_less_trigger = rig.frame_less_trigger.wrapping_add(off);
        let after = rig.plays(40..80);
        let doubtful = after.iter().filter(|said| **said == Err(Matched::Doubtful)).count();
        assert!(doubtful < CONTRADICTING as usize, "{after:?}");
        let exact = after.iter().filter(|said| **said == Ok(0)).count();
        assert!(exact >= 40 - 8, "{after:?}");
        assert!(!after.iter().any(|said| matches!(said, Ok(error) if *error != 0)), "{after:?}");
    }
}

#[test]
fn one_late_stamp_is_in_doubt_and_changes_nothing() {
    let mut rig = rig(10, 0);
    rig.plays(0..40);
    rig.late_ns += 40 * MS;
    assert_eq!(rig.plays(40..41), [Err(Matched::Doubtful)]);
    rig.late_ns -= 40 * MS;
    assert!(rig.plays(41..60).iter().all(|said| *said == Ok(0)));
    assert_eq!(rig.matching.found(), 1);
}

#[test]
fn a_microcontroller_that_was_started_anew_is_followed() {
    let mut rig = rig(12, 4);
    rig.plays(0..40);
    rig.first_counter = 0_u32.wrapping_sub(60);
    rig.frame_less_trigger += 3;
    let after = rig.plays(60..100);
    assert!(after[..3].iter().all(|said| matches!(said, Err(Matched::Delay(_)))), "{after:?}");
    assert!(after[5..].iter().all(|said| *said == Ok(0)), "{after:?}");
}

#[test]
fn without_triggers_the_usual_delay_is_taken_off_and_nothing_is_known_before() {
    let mut rig = rig(12, 0);
    assert!((0..20).all(|n| rig.frame(n) == Err(Matched::Unknown)));
    rig.plays(20..60);
    // A few are told by those before.
    let without: Vec<_> = (60..100).map(|n| rig.frame(n)).collect();
    let ahead = AHEAD as usize;
    assert!(without[..ahead].iter().all(|said| *said == Ok(0)), "{without:?}");
    for (n, said) in (60..).zip(&without).skip(ahead) {
        assert_eq!(*said, Err(Matched::Delay(edge_ns(n) + HALF_NS)));
    }
    assert!(rig.plays(100..140)[1..].iter().all(|said| *said == Ok(0)));
}

#[test]
fn triggers_of_other_cameras_are_none() {
    let mut rig = rig(10, 0);
    let stamp = Timestamp::from_nanos(edge_ns(0));
    rig.matching.triggered(&TriggerEvent { counter: 1, stamp, pulse_ns: 0, cameras: 0b100 });
    assert!(rig.matching.triggers.is_empty());
}
