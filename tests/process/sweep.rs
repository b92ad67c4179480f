//! A sweep is the same however it is flown, and goes on where it was interrupted.

use super::{fails, plumbline, stderr};
use plumbline_lab::sweep::published::SUITES;
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

/// Clips of EuRoC, beside a simulated flight under the name of a sequence.
#[test]
fn the_open_table_of_a_folder_has_medians_sources_and_what_is_missing() {
    let Some(clips) = plumbline_test_support::shared("euroc/MH_05_mono_clip") else { return };
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let written = plumbline(&[
        "simulate",
        &at("sets/V1_02_medium"),
        "--start",
        "5",
        "--duration",
        "6",
        "--scale",
        "0.4",
    ]);
    assert!(written.status.success(), "{}", stderr(&written));
    std::os::unix::fs::symlink(&clips, folder.path().join("sets/MH_05_mono_clip")).unwrap();
    let (sets, cells) = (at("sets"), at("cells"));
    let flown = ["sweep", "--folder", &sets, "--starts", "0,0.5,1", "--cells", &cells];
    let [markdown, csv, tex] = ["table.md", "table.csv", "table.tex"].map(at);
    let text = succeeds(&plumbline(
        &[&flown[..], &["--table", &markdown, "--table", &csv, "--table", &tex]].concat(),
    ));
    println!("{text}");
    let read = |path: &str| std::fs::read_to_string(path).unwrap();
    assert_eq!(read(&markdown), text);
    for words in [
        "| V1_02_medium (part of 6 s) ",
        "| MH_05_mono_clip ",
        "arXiv:2510.04612",
        "10.3929/ethz-b-000690084",
        "all (11 of 11)",
    ] {
        assert!(text.contains(words), "'{words}' is missing in {text}");
    }
    let rows: Vec<Vec<String>> =
        read(&csv).lines().map(|line| line.split(',').map(str::to_owned).collect()).collect();
    let column = |name: &str| rows[0].iter().position(|n| n == name).unwrap();
    assert_eq!(rows.len(), 3);
    for row in &rows[1..] {
        let figure = |name: &str| row[column(name)].parse::<f64>().unwrap();
        assert_eq!((figure("flights"), figure("failed")), (3.0, 0.0), "{row:?}");
        let ate = [figure("ate_causal_min_m"), figure("ate_causal_m"), figure("ate_causal_max_m")];
        assert!(ate[0] > 0.0 && ate[0] < ate[1] && ate[1] < ate[2], "{row:?}");
        assert!(figure("rpe_1s_m") > 0.0 && figure("coverage_percent") > 50.0 && figure("nees_tilt") > 0.0);
        let times = ["frame_cpu_ms_p50", "frame_cpu_ms_p99", "frame_cpu_ms_max"].map(figure);
        assert!(times[0] > 0.0 && times[0] <= times[1] && times[1] <= times[2], "{row:?}");
        assert_eq!(row[column("digest")].len(), 16);
    }
    assert!(rows[1..].iter().all(|row| row[column("ate_final_m")].parse::<f64>().is_ok()));
    let cameras: Vec<&str> = rows[1..].iter().map(|row| row[column("cameras")].as_str()).collect();
    assert_eq!(cameras, ["1", "2"], "one camera of the clip, two of the simulated flight");
    assert!(!text.contains("| mean of "), "a part is no sequence: {text}");
    assert!(read(&tex).contains("V1\\_02\\_medium (part of 6 s) & 3 & 2 & "));
    // Spread over machines, cell by cell, it is the same table.
    let again = at("again.csv");
    succeeds(&plumbline(&["sweep", "--collect", &cells, "--table", &again]));
    assert_eq!(read(&again), read(&csv));
}

/// Names of EuRoC, each with a part of a flight; two are missing, and one folder has no images.
#[test]
fn eleven_names_fly_unattended_and_two_parts_make_the_whole_table() {
    let names = SUITES[0].sequences.iter().map(|sequence| sequence.name);
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    for (name, start) in [("a", "3"), ("b", "8")] {
        let flight = at(&format!("flights/{name}"));
        succeeds(&plumbline(&["simulate", &flight, "--start", start, "--duration", "2.5", "--scale", "0.3"]));
    }
    let (sets, missing) = (folder.path().join("sets"), ["MH_04_difficult", "V2_03_difficult"]);
    for (k, name) in names.enumerate().filter(|(_, name)| !missing.contains(name)) {
        let group = sets.join(if name.starts_with("MH") { "machine_hall" } else { "vicon" });
        std::fs::create_dir_all(&group).unwrap();
        std::os::unix::fs::symlink(at(["flights/a", "flights/b"][k % 2]), group.join(name)).unwrap();
    }
    std::fs::create_dir_all(sets.join("V2_03_difficult/mav0/imu0")).unwrap();
    let flown = ["sweep", "--folder", sets.to_str().unwrap(), "--starts", "0,0.3"];
    let [markdown, csv] = ["whole.md", "whole.csv"].map(at);
    let whole = plumbline(&[&flown[..], &["--table", &markdown, "--table", &csv]].concat());
    let text = succeeds(&whole);
    println!("{text}{}", stderr(&whole));
    assert!(stderr(&whole).contains("V2_03_difficult") && stderr(&whole).contains("it has no mav0/cam0"));
    for words in ["MH_01_easy (part of 2 s)", "Missing of EuRoC: all (11 of 11)", "10.3929/ethz-b-000690084"]
    {
        assert!(text.contains(words), "'{words}' is missing in {text}");
    }
    // Two machines fly every second cell each, and one makes the table of both.
    let cells = succeeds(&plumbline(&[&flown[..], &["--list"]].concat())).lines().count();
    assert_eq!(cells, 18);
    let parts = ["even", "odd"].map(at);
    for cell in 0..cells {
        let part = &parts[cell % 2];
        succeeds(&plumbline(&[&flown[..], &["--cell", &cell.to_string(), "--cells", part]].concat()));
    }
    fails_after_its_table(&["sweep", "--collect", &parts[0]], "9 of 18 cells are missing");
    for entry in std::fs::read_dir(&parts[1]).unwrap().map(Result::unwrap) {
        std::fs::copy(entry.path(), Path::new(&parts[0]).join(entry.file_name())).unwrap();
    }
    let collected = at("collected.csv");
    succeeds(&plumbline(&["sweep", "--collect", &parts[0], "--table", &collected]));
    // Times of frames are of the machine; all else is of the flights.
    let estimates = |path: &str| -> Vec<Vec<String>> {
        let text = std::fs::read_to_string(path).unwrap();
        let rows: Vec<Vec<&str>> = text.lines().map(|line| line.split(',').collect()).collect();
        let kept = |row: &Vec<&str>| {
            let cells = row.iter().zip(&rows[0]).filter(|(_, head)| !head.starts_with("frame_cpu_ms"));
            cells.map(|(cell, _)| (*cell).to_owned()).collect()
        };
        rows.iter().map(kept).collect()
    };
    let (whole, collected) = (estimates(&csv), estimates(&collected));
    assert_eq!(whole.len(), 10);
    assert_eq!(whole, collected);
}

#[test]
fn a_table_is_refused_before_the_flights() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    fails(&["sweep", "--folder", &at("")], 2, &["no data set", "mav0/cam0"]);
    fails(&["sweep", "--folder", "/nowhere"], 2, &["--folder /nowhere"]);
    fails(&["sweep", "sim:room?duration=1", "--table", &at("t.xls")], 2, &["t.xls", ".md, .csv or .tex"]);
    let two = ["--set", "estimator.lines.enabled=true,false"];
    let table = at("t.md");
    let several = [&["sweep", "sim:room?duration=1"], &two[..], &["--table", &table]].concat();
    fails(&several, 2, &["--table", "--set makes 2"]);
}
