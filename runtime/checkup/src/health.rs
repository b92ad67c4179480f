//! Health bits of a whole flight: counts, the line at the end, and warnings with causes and cures.

use crate::finding::Finding;
use plumbline_estimator::HealthBits;
use plumbline_estimator::health::HealthBit;
use plumbline_estimator::odometry::Missing;

/// Cure of bits that have several causes.
const LOOK: &str = "run `plumbline doctor` on the data";
/// Share of the frames from which a bit is in the line at the end of a flight.
const NAMED: f64 = 0.02;
/// Share of the frames from which a bit is a warning, and the same for sensors that repeat their data.
const WARNED: f64 = 0.1;
const WARNED_OF_REPEATS: f64 = 0.02;
/// Share of the frames from which left and right that do not agree are a warning: they show it only while the vehicle turns.
const WARNED_OF_PAIRS: f64 = 0.05;
/// Share of the frames from which a noisy accelerometer is a warning: clean flights with little texture have a sixth.
const WARNED_OF_NOISE: f64 = 0.25;
/// Fewest frames that are judged, and fewest with a bit for a warning.
const MIN_FRAMES: u64 = 20;
/// Frames with a bit that are worth a warning while the flight goes on: three seconds at 20 Hz.
const LASTING: u64 = 60;
/// Reasons that are given why there is no pose.
const MAX_REASONS: usize = 3;
/// A bit that explains so many of the frames of another one is its cause.
const CAUSED: f64 = 0.8;

/// Frames with each health bit, and the distribution of the quality. Never allocates.
#[derive(Clone, Debug, Default)]
pub struct HealthTally {
    /// Frames that were taken.
    pub frames: u64,
    /// Frames with each health bit, in the order of [`HealthBits::NAMES`].
    pub bits: [u64; HealthBits::COUNT],
    /// What the last attempt to start with one camera lacked, and the delay that one found.
    pub missing: Option<Missing>,
    /// See [`Self::missing`].
    pub found: Option<Missing>,
    /// Frames of each quality from -1 to 100.
    qualities: [[u64; 17]; 6],
}

/// A health bit that held for a part of a flight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeldBit {
    /// The bit, as people are told of it.
    pub about: &'static HealthBit,
    /// Frames with it.
    pub frames: u64,
    /// Frames with it over all frames.
    pub share: f64,
}

impl HealthTally {
    /// Takes the bits of a frame.
    pub fn add(&mut self, health: HealthBits) {
        self.frames += 1;
        for (frames, (bit, _)) in self.bits.iter_mut().zip(&HealthBits::NAMES) {
            *frames += u64::from(health.contains(*bit));
        }
    }

    /// Takes the quality of a frame, -1 to 100. Frames before the first pose have none.
    pub fn add_quality(&mut self, quality: i8) {
        let place = usize::try_from(i16::from(quality) + 1).unwrap_or(0).min(101);
        self.qualities.as_flattened_mut()[place] += 1;
    }

    /// Median quality; `None` without a pose.
    pub fn median_quality(&self) -> Option<i8> {
        let all: u64 = self.qualities.as_flattened().iter().sum();
        let mut below = 0;
        let place = self.qualities.as_flattened().iter().position(|count| {
            below += count;
            2 * below >= all
        });
        place.filter(|_| all > 0).map(|place| place as i8 - 1)
    }

    /// Bits that held for more than `share` of the frames, the most frequent first.
    fn held(&self, share: f64) -> Vec<HeldBit> {
        let all = self.frames.max(1) as f64;
        let bits = HealthBits::ABOUT.iter().zip(self.bits);
        let held = bits.map(|(about, frames)| HeldBit { about, frames, share: frames as f64 / all });
        let mut held: Vec<HeldBit> = held.filter(|held| held.share > share).collect();
        held.sort_by(|a, b| b.frames.cmp(&a.frames).then(a.about.bit.0.cmp(&b.about.bit.0)));
        held
    }

    /// Health of the flight in one line: median quality, each bit that held for more than 2 % of the frames, and what to do; of
    /// `known`, which explains all of these, instead.
    pub fn line(&self, known: Option<&Finding>) -> String {
        let quality = match self.median_quality() {
            None => "no valid estimate".to_owned(),
            Some(quality) if quality < 0 => "without a valid estimate most of the time".to_owned(),
            Some(quality) => format!("quality {quality} % in the median"),
        };
        if let Some(Finding { what, cure, .. }) = known {
            return format!("{quality}; {what}: {cure}");
        }
        let held = self.held(NAMED);
        let words =
            held.iter().map(|h| format!("{} in {} of {} frames", h.about.name, h.frames, self.frames));
        let line = [quality, words.collect::<Vec<_>>().join(", ")];
        let line = line[..if held.is_empty() { 1 } else { 2 }].join("; ");
        let faults = || held.iter().map(|held| held.about).filter(|about| about.is_fault());
        // A noisy accelerometer is often but a consequence of another fault.
        match faults().min_by_key(|about| about.bit == HealthBits::ACCEL_NOISY).map(|about| about.cure) {
            None => format!("{line}, no faults"),
            Some(cure) if faults().count() == 1 || cure.contains(LOOK) => format!("{line}: {cure}"),
            Some(cure) => format!("{line}: {cure}; {LOOK}"),
        }
    }

    /// Warnings of bits that held for a tenth of the frames; of frozen images and stuck sensors for a fiftieth. While the flight
    /// goes on, such that held for three seconds. Bits of `known` are explained elsewhere.
    pub fn findings(&self, is_over: bool, known: HealthBits) -> Vec<Finding> {
        let least = if is_over { MIN_FRAMES } else { LASTING };
        let is_warned = |held: &&HeldBit| {
            let share = match held.about.bit {
                HealthBits::ACCEL_NOISY => WARNED_OF_NOISE,
                HealthBits::CAMERAS_DISAGREE => WARNED_OF_PAIRS,
                bit if REPEATS.contains(&bit) => WARNED_OF_REPEATS,
                _ => WARNED,
            };
            held.about.is_fault()
                && known.0 & held.about.bit.0 == 0
                && held.frames >= least
                && held.share >= share
        };
        let held = self.held(0.0);
        held.iter()
            .filter(|held| !self.is_consequence(held))
            .filter(is_warned)
            .map(|held| self.finding(held, is_over))
            .collect()
    }

    /// Reason why no pose was found, with the cure: what the last start with one camera lacked, else the health bits.
    pub fn why_no_pose(&self) -> String {
        if self.frames == 0 {
            return "no frame arrived".to_owned();
        }
        if let Some(missing) = self.missing {
            return format!("the start with one camera: {missing}");
        }
        if self.frames < MIN_FRAMES {
            return format!("{} frames are too few for a start: give two seconds and more", self.frames);
        }
        let findings = self.findings(true, HealthBits::VELOCITY_UNCERTAIN);
        let reasons: Vec<String> = findings.iter().take(MAX_REASONS).map(ToString::to_string).collect();
        if reasons.is_empty() {
            return "no health bit tells why: run `plumbline doctor` on the data, which checks stamps, units and calibration"
                .to_owned();
        }
        reasons.join("; ")
    }

    /// True if a bit only follows from another one: images that are missing or repeat have no
    /// points.
    fn is_consequence(&self, held: &HeldBit) -> bool {
        let of_images = [HealthBits::LEFT_FROZEN, HealthBits::LEFT_MISSING, HealthBits::BAD_IMAGE_SIZE];
        let frames = |bit: &HealthBits| {
            let at = HealthBits::NAMES.iter().position(|(known, _)| known == bit);
            at.map_or(0, |at| self.bits[at])
        };
        let cause = of_images.iter().map(frames).max().unwrap_or(0);
        let follows = [HealthBits::NO_FEATURES, HealthBits::LOW_FEATURES];
        follows.contains(&held.about.bit) && cause as f64 >= CAUSED * held.frames as f64
    }

    fn finding(&self, held: &HeldBit, is_over: bool) -> Finding {
        let HealthBit { name, finding, causes, cure, .. } = *held.about;
        // The line at the end of the flight counts more frames than a warning while it goes on.
        let all = if is_over { "" } else { "the first " };
        let evidence = format!(
            "health bit `{name}` in {} of {all}{} frames, {:.0} %",
            held.frames,
            self.frames,
            100.0 * held.share
        );
        let finding = Finding::new(finding, evidence, causes, cure);
        if REPEATS.contains(&held.about.bit) || FAILING.contains(&held.about.bit) {
            finding
        } else {
            finding.mild()
        }
    }
}

/// Bits of sensors that fail otherwise: no calibration explains it.
const FAILING: [HealthBits; 4] = [
    HealthBits::IMU_SATURATED,
    HealthBits::LEFT_MISSING,
    HealthBits::RIGHT_MISSING,
    HealthBits::BAD_IMAGE_SIZE,
];

/// Bits of sensors that contradict each other: most of them leave a quality of 10.
pub(crate) const CONTRADICTED: HealthBits = HealthBits(
    HealthBits::CAMERAS_DISAGREE.0
        | HealthBits::CAMERAS_OUT_OF_STEP.0
        | HealthBits::IMU_CONTRADICTED.0
        | HealthBits::ACCEL_CONTRADICTED.0
        | HealthBits::GYRO_CONTRADICTED.0
        | HealthBits::SCALE_CONTRADICTED.0
        | HealthBits::ROTATION_DISPUTED.0
        | HealthBits::IMU_LATE.0
        | HealthBits::IMAGES_LATE.0,
);

/// Bits of sensors that repeat their data.
const REPEATS: [HealthBits; 4] =
    [HealthBits::GYRO_STUCK, HealthBits::ACCEL_STUCK, HealthBits::LEFT_FROZEN, HealthBits::RIGHT_FROZEN];

#[cfg(test)]
mod tests {
    use super::*;

    fn tally(frames: u64, bits: &[(HealthBits, u64)], quality: i8) -> HealthTally {
        let mut tally = HealthTally::default();
        for k in 0..frames {
            let mut health = HealthBits::default();
            bits.iter().filter(|(_, count)| k < *count).for_each(|(bit, _)| health.insert(*bit));
            tally.add(health);
            tally.add_quality(quality);
        }
        tally
    }

    #[test]
    fn the_line_names_quality_bits_counts_and_cure() {
        assert_eq!(tally(100, &[], 98).line(None), "quality 98 % in the median, no faults");
        assert_eq!(HealthTally::default().line(None), "no valid estimate, no faults");
        let rare = tally(100, &[(HealthBits::IMU_GAP, 2), (HealthBits::STATIONARY, 40)], 98);
        assert_eq!(rare.line(None), "quality 98 % in the median; stationary in 40 of 100 frames, no faults");
        let late = tally(100, &[(HealthBits::IMAGES_LATE, 88), (HealthBits::BLURRED, 3)], 10).line(None);
        assert!(
            late.starts_with("quality 10 % in the median; images late in 88 of 100 frames, blurred in 3"),
            "{late}"
        );
        let units = Finding::new("another unit", "", "", "multiply it");
        assert_eq!(
            tally(100, &[], 98).line(Some(&units)),
            "quality 98 % in the median; another unit: multiply it"
        );
        assert!(
            late.contains("rig.time_offset_s") && late.ends_with("run `plumbline doctor` on the data"),
            "{late}"
        );
    }

    #[test]
    fn a_bit_of_a_tenth_of_the_frames_is_a_warning_with_its_causes() {
        assert_eq!(
            tally(240, &[(HealthBits::CAMERAS_DISAGREE, 11)], 90).findings(true, HealthBits::default()),
            []
        );
        let found =
            tally(240, &[(HealthBits::CAMERAS_DISAGREE, 24)], 90).findings(true, HealthBits::default());
        let words = found[0].to_string();
        for part in ["24 of 240 frames, 10 %", "same moment", "exchanged", "plumbline doctor"] {
            assert!(words.contains(part), "{part}: {words}");
        }
        // A vehicle may stand, and a fault of three seconds is warned of while it lasts.
        assert_eq!(
            tally(240, &[(HealthBits::STATIONARY, 240)], 90).findings(true, HealthBits::default()),
            []
        );
        assert_eq!(tally(240, &[(HealthBits::BLURRED, 59)], 90).findings(false, HealthBits::default()), []);
        let lasting = tally(240, &[(HealthBits::BLURRED, 60)], 90).findings(false, HealthBits::default());
        assert!(
            lasting.len() == 1 && lasting[0].evidence.contains("60 of the first 240 frames"),
            "{lasting:?}"
        );
    }

    #[test]
    fn repeats_are_warned_of_sooner_with_both_keys() {
        let bits = [(HealthBits::ACCEL_STUCK, 30), (HealthBits::LEFT_FROZEN, 30), (HealthBits::BLURRED, 30)];
        let words: Vec<String> = tally(660, &bits, 90)
            .findings(true, HealthBits::default())
            .iter()
            .map(ToString::to_string)
            .collect();
        assert_eq!(words.len(), 2, "{words:?}");
        assert!(words.iter().any(|words| words.contains("imu.stuck_after_s")), "{words:?}");
        assert!(words.iter().any(|words| words.contains("refuse_repeated_images")), "{words:?}");
    }

    #[test]
    fn the_reason_of_no_pose_is_what_the_start_lacked_or_that_of_the_bits() {
        assert!(tally(1, &[], 0).why_no_pose().contains("too few"));
        assert!(tally(196, &[], 0).why_no_pose().contains("plumbline doctor"));
        let dark = [(HealthBits::NO_FEATURES, 190), (HealthBits::LOW_FEATURES, 150)];
        let words = tally(196, &dark, 0).why_no_pose();
        assert!(
            words.starts_with(
                "no point was found in the images (health bit `no features` in 190 of 196 frames"
            ) && words.contains("few features"),
            "{words}"
        );
        let lacking = HealthTally { missing: Some(Missing::Time(1.0)), ..tally(10, &dark, 0) };
        assert_eq!(lacking.why_no_pose(), "the start with one camera: gathered 1.0 of 1.5 s");
    }

    #[test]
    fn the_median_quality_is_that_of_the_middle_frame() {
        let mut tally = HealthTally::default();
        assert_eq!(tally.median_quality(), None);
        [-1, 10, 10, 90, 100].into_iter().for_each(|quality| tally.add_quality(quality));
        assert_eq!(tally.median_quality(), Some(10));
    }
}
