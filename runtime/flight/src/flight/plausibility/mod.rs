//! Whether what a flight is given can be right: the judge is [`plumbline_checkup::plausibility`], fed while a flight goes on
//! ([`watch`]).

pub mod watch;

pub use plumbline_checkup::plausibility::{COPY, Finding, missing_camera};
use plumbline_drivers::Faults;

/// What the drivers survived, where that is worth a word; `files` names the files of a recording, `None` is a live flight.
#[must_use]
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

#[cfg(test)]
mod tests {
    use super::*;

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
