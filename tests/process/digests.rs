//! Estimates are the same bits as when `tests/digests.toml` was written: the recorded clips and simulated flights.
//!
//! They are the same on x86-64 and aarch64; elsewhere, where nobody has looked, the tests skip themselves. A change that is
//! meant is recorded by `make digests`.

use plumbline_test_support::{Need, shared, skip};
use serde_json::Value;
use std::fmt::Write as _;
use std::path::PathBuf;
use std::process::Command;

/// Stands for the folder of shared data in the arguments of a flight.
const SHARED: &str = "SHARED/";

/// A flight by its name, and the arguments of `plumbline replay`.
pub(super) type Flight = (&'static str, &'static str);

pub(super) const FLIGHTS: [Flight; 7] = [
    ("v1_01_clip", "SHARED/euroc/V1_01_easy_clip"),
    ("mh_05_mono_clip", "SHARED/euroc/MH_05_mono_clip --mono"),
    ("room", "sim:room --start=2 --duration=10 --scale=0.5"),
    ("hall", "sim:hall --start=2 --duration=10 --scale=0.5"),
    ("low_texture", "sim:low-texture --start=2 --duration=10 --scale=0.5"),
    ("room_mono", "sim:room --start=2 --duration=10 --scale=0.5 --mono"),
    (
        "room_with_faults",
        "sim:room --start=2 --duration=10 --scale=0.5 --blackout=5..6 --drop-rate=0.05 --flicker",
    ),
];

/// Digests of a flight.
#[derive(Debug, PartialEq)]
pub(super) struct Digests {
    estimate: String,
    odometry: String,
}

fn file() -> PathBuf {
    plumbline_test_support::workspace().join("tests/digests.toml")
}

/// Digests of a flight by a build; `None` where the shared data are missing. `command` starts it.
pub(super) fn flown(mut command: Command, (_, arguments): Flight) -> Option<Digests> {
    let place = |argument: &str| match argument.strip_prefix(SHARED) {
        Some(inside) => shared(inside).map(|path| path.display().to_string()),
        None => Some(argument.to_owned()),
    };
    let arguments: Vec<String> = arguments.split(' ').map(place).collect::<Option<_>>()?;
    let output = crate::done(command.arg("replay").args(&arguments).arg("--json"));
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    let digest = |key: &str| report[key].as_str().unwrap().to_owned();
    assert!(report["completion"].as_f64().unwrap() > 0.8, "{arguments:?} hardly has a pose to compare");
    Some(Digests { estimate: digest("estimate_digest"), odometry: digest("odometry_digest") })
}

fn is_promised_here() -> bool {
    let is_promised = cfg!(all(target_os = "linux", any(target_arch = "x86_64", target_arch = "aarch64")));
    if !is_promised {
        skip(Need::ReferenceProcessor, "digests are promised for x86-64 and aarch64, and Linux");
    }
    is_promised
}

fn is_as_recorded(name: &str) {
    if !is_promised_here() {
        return;
    }
    let flight = FLIGHTS.into_iter().find(|(known, _)| *known == name).unwrap();
    let Some(now) = flown(Command::new(env!("CARGO_BIN_EXE_plumbline")), flight) else { return };
    assert_eq!(now, recorded(name), "{name}: other bits; if that is meant, record them with `make digests`");
}

/// Digests of a flight in the file.
pub(super) fn recorded(name: &str) -> Digests {
    let recorded: toml::Table = std::fs::read_to_string(file()).unwrap().parse().unwrap();
    let digest = |key: &str| recorded[name][key].as_str().unwrap().to_owned();
    Digests { estimate: digest("estimate"), odometry: digest("odometry") }
}

#[test]
fn digest_of_the_v1_01_clip() {
    is_as_recorded("v1_01_clip");
}

#[test]
fn digest_of_the_mh_05_mono_clip() {
    is_as_recorded("mh_05_mono_clip");
}

#[test]
fn digest_of_a_room() {
    is_as_recorded("room");
}

#[test]
fn digest_of_a_hall() {
    is_as_recorded("hall");
}

#[test]
fn digest_of_low_texture() {
    is_as_recorded("low_texture");
}

#[test]
fn digest_of_a_room_with_one_camera() {
    is_as_recorded("room_mono");
}

#[test]
fn digest_of_a_room_with_faults() {
    is_as_recorded("room_with_faults");
}

/// `make digests`: writes the file anew, by the command that `PLUMBLINE_BINARY` names, else by the one just built.
#[test]
#[ignore = "writes tests/digests.toml: `make digests`"]
fn record_digests() {
    assert!(is_promised_here());
    let built = || PathBuf::from(env!("CARGO_BIN_EXE_plumbline"));
    let binary = std::env::var_os("PLUMBLINE_BINARY").map_or_else(built, PathBuf::from);
    let mut text = String::from(
        "# What flights come to, bit for bit, on x86-64 and aarch64. Written by `make digests`; the flights are in\n\
         # tests/process/digests.rs. A change of these lines is a change of the estimator: say why in its commit.\n",
    );
    for flight in FLIGHTS {
        let digests = flown(Command::new(&binary), flight).expect("the shared data are there");
        let (name, Digests { estimate, odometry }) = (flight.0, digests);
        write!(text, "\n[{name}]\nestimate = \"{estimate}\"\nodometry = \"{odometry}\"\n").unwrap();
    }
    std::fs::write(file(), text).unwrap();
}
