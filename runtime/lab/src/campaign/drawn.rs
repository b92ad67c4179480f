//! Failures that are drawn, not listed: kind, axis, size, moment and noise, among jitter of stamps, gaps, crowds and textures.
//!
//! A health bit that names a sensor is a statement. Over many drawn flights the table counts how often each was made, and how often it
//! was right.

use super::{CampaignFault, Entry};
use crate::report::honesty::Honesty;
use crate::report::silence::MAX_NAMELESS_S;
use plumbline_config::Random;
use plumbline_estimator::HealthBits;
use plumbline_simulator::InjectedFault;
use std::fmt::Write as _;

/// Moment of a failure, s after the first frame.
const MOMENT_S: [f64; 2] = [4.0, 8.0];
/// Share of the flights without a failure, and of those with each disturbance.
const SOUND_SHARE: f64 = 0.15;
const DISTURBED_SHARE: f64 = 0.25;
/// Jitter of stamps, ms, share of the frames that are missing, and share of the view that a crowd fills, %.
const JITTER_MS: [f64; 2] = [0.5, 2.0];
const MISSING_SHARE: [f64; 2] = [0.05, 0.3];
const CROWD_PERCENT: [f64; 2] = [15.0, 35.0];
const CROWD_M_S: f64 = 1.2;

/// Target of a failure.
#[derive(Clone, Copy, Debug)]
enum Target {
    Axis,
    Axes(&'static [&'static str]),
    Camera,
    None,
}

/// A kind of failure with the ranges that its doses are drawn from; `signed` doses are drawn with either sign.
struct Family {
    kind: &'static str,
    target: Target,
    doses: &'static [[f64; 2]],
    is_signed: bool,
    length_s: Option<[f64; 2]>,
}

const fn family(kind: &'static str, target: Target, doses: &'static [[f64; 2]]) -> Family {
    Family { kind, target, doses, is_signed: false, length_s: None }
}

const PAIRS: Target = Target::Axes(&["xy", "yz", "xz"]);
const ALL: Target = Target::Axes(&["xyz"]);
const NOISE: [f64; 2] = [0.5, 2.0];

const FAMILIES: [Family; 20] = [
    Family {
        is_signed: true,
        length_s: Some([0.1, 1.0]),
        ..family("accel-pulse", Target::Axis, &[[10.0, 60.0]])
    },
    Family { is_signed: true, ..family("accel-step", Target::Axis, &[[2.0, 10.0]]) },
    family("accel-clip", ALL, &[[3.0, 12.0]]),
    family("accel-dead", Target::Axis, &[NOISE]),
    family("accel-frozen", Target::Axis, &[NOISE]),
    family("accel-sign", Target::Axis, &[]),
    family("accel-exchanged", PAIRS, &[]),
    Family {
        is_signed: true,
        length_s: Some([0.1, 1.0]),
        ..family("gyro-pulse", Target::Axis, &[[1.0, 6.0]])
    },
    Family { is_signed: true, ..family("gyro-step", Target::Axis, &[[0.05, 0.5]]) },
    family("gyro-dead", Target::Axis, &[NOISE]),
    family("gyro-frozen", Target::Axis, &[NOISE]),
    family("gyro-sign", Target::Axis, &[]),
    family("gyro-exchanged", PAIRS, &[]),
    family("imu-frozen", ALL, &[NOISE]),
    family("imu-late", Target::None, &[[20.0, 100.0]]),
    family("image-late", Target::Camera, &[[1.0, 3.5]]),
    family("image-frozen", Target::Camera, &[NOISE]),
    family("image-shift", Target::Camera, &[[4.0, 8.0]]),
    family("stamp-late", Target::None, &[[50.0, 200.0]]),
    Family { length_s: Some([0.2, 0.8]), ..family("frame-gap", Target::None, &[]) },
];

impl Family {
    /// The failure as `--fault` takes it.
    fn draw(&self, random: &mut Random) -> String {
        let mut text = self.kind.to_owned();
        let target = match self.target {
            Target::Axis => Some(["x", "y", "z"][random.below(3)]),
            Target::Axes(sets) => Some(sets[random.below(sets.len())]),
            Target::Camera => Some(["left", "right"][random.below(2)]),
            Target::None => None,
        };
        target.iter().for_each(|target| _ = write!(text, ":{target}"));
        for [low, high] in self.doses {
            let dose = random.range(*low, *high);
            let sign = if self.is_signed && random.below(2) == 1 { -1.0 } else { 1.0 };
            let _ = match self.target {
                // Of whole frames and pixels.
                Target::Camera if self.kind != "image-frozen" => write!(text, ":{:.0}", dose.floor()),
                _ => write!(text, ":{:.2}", sign * dose),
            };
        }
        let _ = write!(text, "@{:.2}", random.range(MOMENT_S[0], MOMENT_S[1]));
        if let Some([low, high]) = self.length_s {
            let _ = write!(text, "+{:.2}", random.range(low, high));
        }
        text
    }
}

/// `count` flights drawn by `seed` from the `sound` ones, each with a failure or none, and with disturbances or none.
///
/// # Errors
/// When a failure cannot be read, with its text: never, unless a family and its grammar differ.
pub fn drawn(sound: &[Entry], count: usize, seed: u64) -> Result<Vec<Entry>, String> {
    let mut random = Random::new(seed);
    (0..count).map(|number| draw(sound, &mut random, number)).collect()
}

fn draw(sound: &[Entry], random: &mut Random, number: usize) -> Result<Entry, String> {
    let mut entry = sound[random.below(sound.len())].clone();
    entry.scenario.seed = number as u64 + 1;
    let is_sound = random.unit() < SOUND_SHARE;
    let text = FAMILIES[random.below(FAMILIES.len())].draw(random);
    let failure: InjectedFault = text.parse()?;
    let from_s = failure.span_s().start;
    let dose = |random: &mut Random, [low, high]: [f64; 2]| random.range(low, high);
    let [jitter, missing, crowd] = [0; 3].map(|_| random.unit() < DISTURBED_SHARE);
    let (jitter_ms, share) = (dose(random, JITTER_MS), dose(random, MISSING_SHARE));
    let percent = dose(random, CROWD_PERCENT);
    let injected = |text: String| text.parse().map(CampaignFault::Injected);
    let from = format!("@{from_s:.2}");
    let disturbances = [
        jitter.then(|| injected(format!("stamp-jitter:{jitter_ms:.2}{from}"))),
        missing.then(|| injected(format!("frames-missing:{share:.2}{from}"))),
        crowd.then(|| {
            format!("people:{percent:.0}:{CROWD_M_S}:{from_s:.1}").parse().map(CampaignFault::Condition)
        }),
    ];
    for disturbance in disturbances.into_iter().flatten() {
        entry = entry.with_beside(disturbance?);
    }
    Ok(if is_sound { entry } else { entry.with_fault(CampaignFault::Injected(failure)) })
}

/// Bits that name a sensor or its clock.
const NAMES: [HealthBits; 11] = [
    HealthBits::ACCEL_STUCK,
    HealthBits::ACCEL_CONTRADICTED,
    HealthBits::GYRO_STUCK,
    HealthBits::GYRO_CONTRADICTED,
    HealthBits::IMU_LATE,
    HealthBits::IMAGES_LATE,
    HealthBits::CAMERAS_OUT_OF_STEP,
    HealthBits::CAMERAS_DISAGREE,
    HealthBits::LEFT_FROZEN,
    HealthBits::RIGHT_FROZEN,
    HealthBits::SCALE_CONTRADICTED,
];

/// Head of the table of what was named.
const NAMED_HEAD: &str = "\
| health bit | flights | right | share | failures it was wrong about |
|---|---|---|---|---|";

/// Head of the table of kinds.
const KINDS_HEAD: &str = "\
| drawn | flights | honest | named within 1 s | another sensor named |
|---|---|---|---|---|";

/// Tables of drawn flights and of how honest each was: what was named, and how each kind fared.
#[must_use]
pub fn tables(flights: &[(&Entry, &Honesty)]) -> String {
    let (mut claims, mut right_claims) = (0, 0);
    let mut text = format!("{NAMED_HEAD}\n");
    for (bit, name) in HealthBits::NAMES.iter().filter(|(bit, _)| NAMES.contains(bit)) {
        let named = flights.iter().filter(|(_, honesty)| raised_s(honesty, name).is_some());
        let count = named.clone().count();
        let wrong = named.filter(|(entry, _)| !entry.fault.named_by().contains(bit));
        let mut kinds: Vec<String> = wrong.map(|(entry, _)| kind(entry)).collect();
        let right = count - kinds.len();
        (claims, right_claims) = (claims + count, right_claims + right);
        kinds.sort_unstable();
        kinds.dedup();
        let (share, kinds) = (percent(right, count), kinds.join(", "));
        let _ = writeln!(text, "| {name} | {count} | {right} | {share} | {kinds} |");
    }
    let _ = writeln!(text, "| all | {claims} | {right_claims} | {} | |", percent(right_claims, claims));
    let _ = writeln!(text, "\n{KINDS_HEAD}");
    let mut kinds: Vec<String> = flights.iter().map(|(entry, _)| kind(entry)).collect();
    kinds.sort_unstable();
    kinds.dedup();
    for name in kinds.iter().map(String::as_str).chain(["all"]) {
        let of_kind: Vec<_> =
            flights.iter().filter(|(entry, _)| name == "all" || kind(entry) == name).collect();
        let honest = of_kind.iter().filter(|(_, honesty)| honesty.is_honest()).count();
        let nameable: Vec<_> =
            of_kind.iter().filter(|(entry, _)| !entry.fault.named_by().is_empty()).collect();
        let named = nameable.iter().filter(|(entry, honesty)| is_named_soon(entry, honesty)).count();
        let others = of_kind.iter().filter(|(entry, honesty)| is_other_named(entry, honesty)).count();
        let _ = writeln!(
            text,
            "| {name} | {} | {honest} | {named} of {} | {others} |",
            of_kind.len(),
            nameable.len()
        );
    }
    text
}

fn kind(entry: &Entry) -> String {
    match entry.fault {
        CampaignFault::Injected(fault) => fault.kind().name.clone(),
        _ => "none".to_owned(),
    }
}

fn percent(part: usize, of: usize) -> String {
    if of == 0 { "-".to_owned() } else { format!("{:.0} %", 100.0 * part as f64 / of as f64) }
}

/// First time at which the bit was up, s: since the failure where there is one.
fn raised_s(honesty: &Honesty, name: &str) -> Option<f64> {
    honesty.since_fault_s.as_ref().unwrap_or(&honesty.first_s).get(name).copied()
}

fn is_named_soon(entry: &Entry, honesty: &Honesty) -> bool {
    let named_by = entry.fault.named_by();
    let names = HealthBits::NAMES.iter().filter(|(bit, _)| named_by.contains(bit));
    names.filter_map(|(_, name)| raised_s(honesty, name)).any(|s| s <= MAX_NAMELESS_S)
}

fn is_other_named(entry: &Entry, honesty: &Honesty) -> bool {
    let named_by = entry.fault.named_by();
    let others = HealthBits::NAMES.iter().filter(|(bit, _)| NAMES.contains(bit) && !named_by.contains(bit));
    others.into_iter().any(|(_, name)| raised_s(honesty, name).is_some())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    fn sound() -> Vec<Entry> {
        let entry = |path| {
            Entry::new(Path::new(""), (path, 0.0), super::super::SCENES[0], 1, 12.0, CampaignFault::None)
        };
        vec![entry("yaws"), entry("hover")]
    }

    #[test]
    fn every_kind_is_drawn_in_time_and_one_seed_draws_the_same() {
        let entries = drawn(&sound(), 400, 7).unwrap();
        for family in &FAMILIES {
            assert!(entries.iter().any(|entry| kind(entry) == family.kind), "{}", family.kind);
        }
        let faults = |entries: &[Entry]| entries.iter().map(|entry| entry.fault.name()).collect::<Vec<_>>();
        assert_eq!(faults(&entries), faults(&drawn(&sound(), 400, 7).unwrap()));
        assert_ne!(faults(&entries), faults(&drawn(&sound(), 400, 8).unwrap()));
        let none = entries.iter().filter(|entry| entry.fault == CampaignFault::None).count();
        assert!((30..90).contains(&none), "{none}");
        let beside = entries.iter().filter(|entry| !entry.beside.is_empty()).count();
        assert!((190..270).contains(&beside), "{beside}");
        let late = |entry: &Entry| entry.fault.injected_from_s().is_some_and(|s| !(4.0..=8.0).contains(&s));
        assert!(!entries.iter().any(late));
    }

    #[test]
    fn a_bit_is_right_where_it_names_what_was_drawn() {
        let raised =
            |name: &'static str, s| Honesty { since_fault_s: Some([(name, s)].into()), ..Honesty::default() };
        let dead = sound()[0].with_fault(CampaignFault::Injected("accel-dead:x@5".parse().unwrap()));
        let flown = [raised("accelerometer contradicted", 0.5), raised("gyroscope contradicted", 0.5)];
        let text = tables(&flown.each_ref().map(|honesty| (&dead, honesty)));
        assert!(text.contains("| accelerometer contradicted | 1 | 1 | 100 % |  |"), "{text}");
        assert!(text.contains("| gyroscope contradicted | 1 | 0 | 0 % | accel-dead |"), "{text}");
        assert!(text.contains("| accel-dead | 2 | 2 | 1 of 2 | 1 |"), "{text}");
    }
}
