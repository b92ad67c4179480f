//! Every command of the page on troubleshooting runs as it stands there, and prints or writes what the page says that it shows.

use super::stderr;
use std::collections::BTreeMap;
use std::process::Command;

/// Command of the page.
struct Shown {
    /// Number of the question that it answers; 0 before the first.
    question: usize,
    arguments: Vec<String>,
    /// Exit status that it is to have.
    status: i32,
}

/// The commands of the page.
fn commands(page: &str) -> Vec<Shown> {
    let mut question = 0;
    let mut commands = Vec::new();
    for line in page.lines() {
        if let Some((number, _)) = line.strip_prefix("### ").and_then(|heading| heading.split_once('.')) {
            question = number.parse().unwrap();
        } else if let Some(line) = line.strip_prefix("    plumbline ") {
            let (command, note) = line.split_once('#').unwrap_or((line, ""));
            let status = note.split_once("status ").map_or(0, |(_, rest)| rest[..1].parse().unwrap());
            let arguments = command.split_whitespace().map(ToOwned::to_owned).collect();
            commands.push(Shown { question, arguments, status });
        }
    }
    commands
}

/// Words that the commands of each question print or write, by which its cause is told.
const SHOWN: [(usize, &[&str]); 21] = [
    (0, &["flight.mcap"]),
    (1, &["noise of the IMU"]),
    (2, &["covariance", "\"consistency\""]),
    (3, &["baseline", "accelerometer scale"]),
    (4, &["focal length", "principal point", "lens model"]),
    (5, &["0 resets", "frame gap"]),
    (6, &["quality", "health_bits"]),
    (7, &["health", "quality"]),
    (8, &["no pose was found", "one camera"]),
    (9, &["first after"]),
    (10, &["IMU timing"]),
    (11, &["in the body", "baseline"]),
    (12, &["docs/rigs/oak-d.md"]),
    (13, &["time offset", "clock rate"]),
    (14, &["right camera's delay", "camera-camera rotation"]),
    (15, &["IMU timing", "camera timing", "another rate"]),
    (16, &["[vehicle]", "imu_to_vehicle_deg = \"unknown\""]),
    (17, &["NEES"]),
    (18, &["ATE [m]", "RPE [m]"]),
    (19, &["bit-identical"]),
    (20, &["places seen again"]),
];

/// Texts that commands of the page write, which belong to what they show.
const FILES: [&str; 2] = ["report.json", "states.csv"];

#[test]
fn every_command_of_the_page_runs_as_it_stands() {
    let page = std::fs::read_to_string(
        std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/troubleshooting.md"),
    )
    .unwrap();
    let commands = commands(&page);
    assert!(commands.len() >= 20, "{}", commands.len());
    assert_eq!(page.matches("\n### ").count(), 20);
    let folder = tempfile::tempdir().unwrap();
    let mut shown: BTreeMap<usize, String> = BTreeMap::new();
    // A command that answers several questions is run for the first of them.
    let mut told: BTreeMap<Vec<String>, String> = BTreeMap::new();
    for Shown { question, arguments, status } in commands {
        let text = shown.entry(question).or_default();
        if let Some(told) = told.get(&arguments) {
            *text += told;
            continue;
        }
        let mut command = Command::new(env!("CARGO_BIN_EXE_plumbline"));
        let output = command.args(&arguments).current_dir(folder.path()).output().expect("the command runs");
        assert_eq!(output.status.code(), Some(status), "{arguments:?}: {}", stderr(&output));
        let said = String::from_utf8_lossy(&output.stdout).into_owned() + &stderr(&output);
        *text += &said;
        for file in FILES.iter().filter(|file| arguments.iter().any(|argument| argument == *file)) {
            *text += &std::fs::read_to_string(folder.path().join(file)).unwrap();
        }
        told.insert(arguments, said);
    }
    for (question, words) in SHOWN {
        let text = &shown[&question];
        words.iter().for_each(|word| assert!(text.contains(word), "{question}: {word} is missing in {text}"));
    }
}
