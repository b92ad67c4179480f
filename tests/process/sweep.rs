//! A sweep is the same however it is flown, and goes on where it was interrupted.

use super::{fails, plumbline, stderr};
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

/// Two settings on a flight of two seconds with two seeds.
const SWEEP: [&str; 5] = [
    "--set",
    "estimator.lines.enabled=true,false",
    "sim:room?start=3&duration=2&scale=0.4",
    "--seeds",
    "1..2",
];

fn sweep(arguments: &[&str]) -> Output {
    plumbline(&[&["sweep"], &SWEEP[..], arguments].concat())
}

fn succeeds(output: &Output) -> String {
    assert!(output.status.success(), "{}", stderr(output));
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// Digest and seed of the cells in a list.
fn digests(csv: &str) -> Vec<String> {
    let rows = csv.lines().map(|line| line.split(',').map(str::to_owned).collect::<Vec<_>>());
    let rows: Vec<Vec<String>> = rows.collect();
    let column = |name: &str| rows[0].iter().position(|n| n == name).unwrap();
    let (seed, digest) = (column("seed"), column("estimate_digest"));
    rows[1..].iter().map(|row| format!("{} {}", row[seed], row[digest])).collect()
}

#[test]
fn two_at_a_time_one_at_a_time_and_cell_by_cell_are_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (both, single, apart) = (at("both.csv"), at("single.csv"), at("apart"));
    let table = succeeds(&sweep(&["--jobs", "2", "--out", &both, "--paired"]));
    assert!(table.contains("\n| ATE mm | 2 | ") && table.contains("8 are needed to decide"), "{table}");
    assert!(table.contains("| estimator.lines.enabled |") && table.matches('*').count() >= 1, "{table}");
    succeeds(&sweep(&["--jobs", "1", "--out", &single]));
    let listed = succeeds(&sweep(&["--list"]));
    assert_eq!(listed.lines().count(), 4, "{listed}");
    let starts = succeeds(&sweep(&["--list", "--starts", "3,3.5"]));
    assert!(starts.lines().count() == 8 && starts.contains("from 3.5 s"), "{starts}");
    // Backwards: no cell knows of another.
    for cell in ["3", "2", "1", "0"] {
        succeeds(&sweep(&["--cell", cell, "--cells", &apart]));
    }
    let (list, of_cells) = (at("list.csv"), Path::new(&apart));
    succeeds(&plumbline(&["sweep", "--collect", &apart, "--out", &list]));
    let read = |path: &str| digests(&std::fs::read_to_string(path).unwrap());
    assert_eq!(read(&both), read(&single));
    assert_eq!(read(&both), read(&list));
    let mut different = read(&both);
    different.dedup();
    assert_eq!(different.len(), 4, "settings and seeds make a difference: {different:?}");
    // A cell that is there is not flown again.
    let before = std::fs::metadata(of_cells.join("cell-0.json")).unwrap().modified().unwrap();
    assert!(succeeds(&sweep(&["--cell", "0", "--cells", &apart])).contains("is there already"));
    assert_eq!(std::fs::metadata(of_cells.join("cell-0.json")).unwrap().modified().unwrap(), before);
    // One that is missing is told.
    std::fs::remove_file(of_cells.join("cell-2.json")).unwrap();
    fails_after_its_table(&["sweep", "--collect", &apart], "1 of 4 cells are missing: 2");
}

/// The command prints a table, and fails with a line that has `words` in it.
fn fails_after_its_table(arguments: &[&str], words: &str) {
    let output = plumbline(arguments);
    assert_eq!(output.status.code(), Some(1));
    assert!(stderr(&output).contains(words), "{}", stderr(&output));
}

#[test]
fn an_interrupted_sweep_keeps_what_has_landed() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out.csv").to_str().unwrap().to_owned();
    let cells = folder.path().join("out.cells");
    let long = ["sweep", "sim:room?duration=4&scale=0.4", "--seeds", "1..50", "--jobs", "1", "--out", &out];
    let mut running = Command::new(env!("CARGO_BIN_EXE_plumbline"))
        .args(long)
        .stderr(Stdio::piped())
        .stdout(Stdio::null())
        .spawn()
        .unwrap();
    let start = Instant::now();
    while !cells.join("cell-1.json").exists() {
        assert!(start.elapsed() < Duration::from_secs(120), "two cells take too long");
        std::thread::sleep(Duration::from_millis(20));
    }
    let interrupt = Command::new("kill").args(["-INT", &running.id().to_string()]).status().unwrap();
    assert!(interrupt.success());
    let asked = Instant::now();
    let status = running.wait().unwrap();
    assert!(asked.elapsed() < Duration::from_secs(20), "it ends soon after the signal");
    assert_eq!(status.code(), Some(1));
    let mut said = String::new();
    std::io::Read::read_to_string(&mut running.stderr.take().unwrap(), &mut said).unwrap();
    assert!(
        said.contains("of 50 cells are in") && said.contains("the same command flies the others"),
        "{said}"
    );
    let whole = |entry: &std::fs::DirEntry| {
        let text = std::fs::read_to_string(entry.path()).unwrap();
        serde_json::from_str::<serde_json::Value>(&text).is_ok_and(|cell| cell["figures"].is_object())
    };
    let kept: Vec<_> = std::fs::read_dir(&cells).unwrap().map(Result::unwrap).collect();
    assert!(kept.len() >= 2 && kept.iter().all(whole));
}

/// Regression: the leavings of a first try must not be in the way of a second one.
#[test]
fn a_second_sweep_with_other_values_needs_no_cleaning_up() {
    let folder = tempfile::tempdir().unwrap();
    let sweep = |values: &str, arguments: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_plumbline"));
        command.current_dir(folder.path()).env("XDG_CACHE_HOME", folder.path().join("cache"));
        let axis = format!("estimator.points.max_points={values}");
        command.args(["sweep", "--set", &axis, "sim:room?start=3&duration=1&scale=0.3"]).args(arguments);
        command.output().unwrap()
    };
    succeeds(&sweep("60", &[]));
    succeeds(&sweep("60,70", &[]));
    let left: Vec<_> = folder.path().read_dir().unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert_eq!(left, ["cache"], "nothing is left in the working folder");
    assert_eq!(folder.path().join("cache/plumbline").read_dir().unwrap().count(), 0);
    // Folders that were asked for stay, and the message says which and what to do.
    succeeds(&sweep("60", &["--out", "first.csv"]));
    let refused = sweep("60,70", &["--out", "first.csv"]);
    assert_eq!(refused.status.code(), Some(2), "{}", stderr(&refused));
    for part in ["first.cells/cell-0.json", "another sweep", "--cells", "delete first.cells"] {
        assert!(stderr(&refused).contains(part), "'{part}' is missing in {}", stderr(&refused));
    }
    let unnamed = sweep("60", &["--cell", "0"]);
    assert_eq!(unnamed.status.code(), Some(2));
    assert!(stderr(&unnamed).contains("--cells"), "{}", stderr(&unnamed));
}

#[test]
fn what_cannot_be_swept_is_said_before_anything_is_flown() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let cells = at("cells");
    let refused = |arguments: &[&str], parts: &[&str]| {
        fails(&[&["sweep", "--cells", &cells], arguments].concat(), 2, parts);
    };
    refused(&["--set", "estimator.points.sigma=1,2", "sim:room"], &["sigma"]);
    refused(&["--set", "estimator.points.sigma_px=1,-2", "sim:room"], &["sigma_px"]);
    refused(&["--set", "estimator.points.sigma_px", "sim:room"], &["section.key=value"]);
    refused(&["sim:room?durations=4"], &["--durations"]);
    refused(&["/nowhere/at/all"], &["/nowhere/at/all"]);
    refused(&["sim:room", "--cell", "7"], &["no cell 7", "0 to 0"]);
    assert!(!Path::new(&cells).join("cell-0.json").exists());
}
