//! Plausibility of a flight's input: the judge is [`plumbline_checkup::plausibility`], fed while a flight goes on ([`watch`]).

pub mod watch;

pub use plumbline_checkup::Fitness;
pub use plumbline_checkup::health::HealthTally;
pub use plumbline_checkup::plausibility::{Finding, GIVEN_UP, missing_camera};
pub use plumbline_checkup::timing::{BURSTS, JITTER_WORD};
use plumbline_drivers::Faults;

/// Finding about the faults that the drivers survived, if they are worth a word; `files` names the files of a recording, `None`
/// is a live flight.
pub fn of_faults(imu: Faults, cameras: Faults, files: Option<&[String]>) -> Option<Finding> {
    let counts = [
        (cameras.missing, "images or frames missing"),
        (cameras.corrupt, "images that cannot be decoded"),
        (imu.missing, "inertial samples missing"),
        (imu.corrupt, "inertial samples that cannot be read"),
    ];
    let told: Vec<String> =
        counts.iter().filter(|(n, _)| *n > 0).map(|(n, what)| format!("{n} {what}")).collect();
    let (what, cause, cure) = if files.is_none() {
        (
            "the sensors have gaps",
            "a cable, a program that does not keep up, or stamps or values that were refused",
            "look at the warnings above, at cables and at the load of this computer",
        )
    } else {
        (
            "the recording or the sensors have gaps",
            "an incomplete copy, a torn file or a link that loses data",
            "copy the data again, or look at cables and load",
        )
    };
    let seen = [&[told.join(", ")], files.unwrap_or_default()].concat().join("; ");
    (!told.is_empty()).then(|| Finding::new(what, seen, cause, cure))
}

/// Stamps that ran backwards or repeated, of so many frames that were flown; of a live flight from `LIVE` on, since single ones are
/// refused without harm.
pub fn of_stamps(imu: Faults, cameras: Faults, frames: u64, is_live: bool) -> Option<Finding> {
    let counts = [(imu.disordered, "inertial samples"), (cameras.disordered, "images")];
    let least = if is_live { LIVE } else { 1 };
    let told: Vec<String> = counts
        .iter()
        .filter(|(n, _)| *n >= least)
        .map(|(n, what)| format!("{n} {what} out of order or of the same stamp"))
        .collect();
    if told.is_empty() {
        return None;
    }
    let seen = format!("{}, {frames} frames flown", told.join(", "));
    // Of frames that all have one stamp one is left.
    if frames <= FEW && cameras.disordered > 0 {
        return Some(Finding::new(
            "the images are not stamped",
            seen,
            "a driver that leaves the stamps at zero",
            "write the time of the measurement into each header",
        ));
    }
    Some(
        Finding::new(
            "stamps run backwards or repeat",
            seen,
            "a clock that was set while it recorded (NTP steps it back), stamps of two clocks, or messages that came out of order",
            if is_live {
                "stamp by one clock that is never set, such as CLOCK_MONOTONIC"
            } else {
                "stamp by one clock that is never set; after a step of the clock two stretches are mixed into each other: cut the \
                 recording before it"
            },
        )
        .mild(),
    )
}

/// Fewest refused stamps of a live flight that are worth a word.
const LIVE: u64 = 20;
/// Frames of a recording whose stamps are all the same.
const FEW: u64 = 2;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stamps_that_run_backwards_or_are_all_the_same_are_told_with_counts() {
        let disordered = |n: u64| Faults { disordered: n, ..Faults::default() };
        assert_eq!(of_stamps(Faults::default(), Faults::default(), 100, false), None);
        let words = of_stamps(disordered(199), disordered(38), 240, false).unwrap().to_string();
        for part in ["199 inertial samples", "38 images", "clock that was set", "cut the recording"] {
            assert!(words.contains(part), "{part}: {words}");
        }
        let words = of_stamps(Faults::default(), disordered(299), 1, false).unwrap().to_string();
        assert!(words.contains("not stamped") && words.contains("299 images"), "{words}");
        assert_eq!(of_stamps(disordered(3), disordered(19), 240, true), None);
        let words = of_stamps(disordered(300), disordered(0), 240, true).unwrap().to_string();
        assert!(words.contains("CLOCK_MONOTONIC") && !words.contains("cut the recording"), "{words}");
    }

    #[test]
    fn faults_of_drivers_are_told_with_their_counts() {
        let torn = Faults { missing: 2, corrupt: 3, ..Faults::default() };
        let unpaired = Faults { unpaired: 4, ..Faults::default() };
        assert_eq!(of_faults(Faults::default(), unpaired, Some(&[])), None);
        let words =
            of_faults(Faults::default(), torn, Some(&["a.png is missing".into()])).unwrap().to_string();
        assert!(words.contains("; a.png is missing)"), "{words}");
        assert!(words.contains("2 images or frames missing, 3 images that cannot be decoded"), "{words}");
        assert!(words.contains("copy the data again"), "{words}");
        // Nothing was copied of a live flight.
        let words = of_faults(Faults::default(), torn, None).unwrap().to_string();
        assert!(words.contains("2 images or frames missing") && !words.contains("copy"), "{words}");
    }
}
