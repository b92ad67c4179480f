//! Whether what a flight is given can be right: the judge is [`plumbline_checkup::plausibility`], fed while a flight goes on
//! ([`watch`]).

pub mod watch;

pub use plumbline_checkup::plausibility::{COPY, Finding, missing_camera};
use plumbline_drivers::Faults;

/// What the drivers survived, where that is worth a word; `files` names the files.
#[must_use]
pub fn of_faults(imu: Faults, cameras: Faults, files: &[String]) -> Option<Finding> {
    let counts = [
        (cameras.missing, "images or frames missing"),
        (cameras.corrupt, "images that cannot be decoded"),
        (imu.missing, "inertial samples missing"),
        (imu.corrupt, "inertial samples that cannot be read"),
    ];
    let told: Vec<String> =
        counts.iter().filter(|(n, _)| *n > 0).map(|(n, what)| format!("{n} {what}")).collect();
    (!told.is_empty()).then(|| {
        Finding::new(
            "the recording or the sensors have gaps",
            [&[told.join(", ")], files].concat().join("; "),
            "an incomplete copy, a torn file or a link that loses data",
            "copy the data again, or look at cables and load",
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faults_of_drivers_are_told_with_their_counts() {
        assert_eq!(of_faults(Faults::default(), Faults { unpaired: 4, ..Faults::default() }, &[]), None);
        let torn = Faults { missing: 2, corrupt: 3, ..Faults::default() };
        let words = of_faults(Faults::default(), torn, &["a.png is missing".into()]).unwrap().to_string();
        assert!(words.contains("; a.png is missing)"), "{words}");
        assert!(words.contains("2 images or frames missing, 3 images that cannot be decoded"), "{words}");
    }
}
