//! The walk-through of `docs/own-sensors.md`, and the example of `estimator/README.md`, as they are written.

use super::python::interpreter;
use plumbline_test_support::workspace;
use std::ffi::OsString;
use std::path::Path;
use std::process::{Command, Output};

/// Code of a document: its language, and its lines.
fn blocks(document: &str) -> Vec<(String, String)> {
    let mut found: Vec<(String, String)> = Vec::new();
    let mut is_inside = false;
    for line in document.lines() {
        match (line.strip_prefix("```"), is_inside) {
            (Some(language), false) => {
                found.push((language.split(',').next().unwrap().to_owned(), String::new()));
                is_inside = true;
            }
            (Some(_), true) => is_inside = false,
            (None, true) => {
                let code = &mut found.last_mut().unwrap().1;
                code.push_str(line);
                code.push('\n');
            }
            (None, false) => {}
        }
    }
    found
}

/// Sets the keys of `changes` in the configuration, as somebody does in an editor.
fn edit(config: &Path, changes: &str) {
    let mut text = std::fs::read_to_string(config).unwrap();
    let mut table = "";
    for line in changes.lines().filter(|line| !line.trim().is_empty()) {
        if line.starts_with('[') {
            table = line;
            continue;
        }
        let key = line.split('=').next().unwrap();
        let start = text.find(&format!("\n{table}\n")).unwrap_or_else(|| panic!("no {table}"));
        let at = start + text[start..].find(&format!("\n{key}=")).unwrap_or_else(|| panic!("no {key}")) + 1;
        let end = at + text[at..].find('\n').unwrap();
        text.replace_range(at..end, line);
    }
    std::fs::write(config, text).unwrap();
}

/// A line with each number, and the blanks around it, as one sign.
fn masked(line: &str) -> String {
    let is_number = |word: &str| word.trim_matches(['(', ')', ',', ';', '+', '-']).parse::<f64>().is_ok();
    let words = line.split_whitespace().map(|word| if is_number(word) { "#" } else { word });
    words.collect::<Vec<_>>().join(" ")
}

/// The folder of the command first, then that of the Python of the tests.
fn search_path(python: &Path) -> OsString {
    let folder = |program: &Path| program.parent().unwrap().to_owned();
    let command = Path::new(env!("CARGO_BIN_EXE_plumbline"));
    let own = [folder(command), folder(python)];
    let others = std::env::var_os("PATH").unwrap_or_default();
    std::env::join_paths(own.into_iter().chain(std::env::split_paths(&others))).unwrap()
}

fn said(output: &Output) -> String {
    [&output.stdout, &output.stderr].map(|bytes| String::from_utf8_lossy(bytes).into_owned()).concat()
}

/// Frames and samples come in real time: see `.config/nextest.toml`.
mod realtime {
    use super::*;

    #[test]
    fn the_walk_through_for_own_cameras_runs_as_it_is_written() {
        let Some(python) = interpreter("PIL") else { return };
        let document = std::fs::read_to_string(workspace().join("docs/own-sensors.md")).unwrap();
        let folder = tempfile::tempdir().unwrap();
        // Several of these tests may run at a time.
        let document = document.replace("/tmp/own-sensors", folder.path().to_str().unwrap());
        let examples = workspace().join("examples").canonicalize().unwrap();
        let (mut last, mut all) = (String::new(), String::new());
        for (language, code) in blocks(&document) {
            match language.as_str() {
                "sh" => {
                    let mut shell = Command::new("bash");
                    shell.args(["-euo", "pipefail", "-c", &code]).current_dir(folder.path());
                    shell.env("PATH", search_path(&python)).env("EXAMPLES", &examples);
                    let output = shell.output().unwrap();
                    last = said(&output);
                    all.push_str(&last);
                    println!("$ {code}{last}");
                    assert!(output.status.success(), "{code}{last}");
                }
                "toml" => edit(&folder.path().join("my.toml"), &code),
                "text" => {
                    let came: Vec<String> = last.lines().map(masked).collect();
                    for line in code.lines().filter(|line| !line.starts_with("...")) {
                        assert!(came.contains(&masked(line)), "'{line}' was not printed:\n{last}");
                    }
                }
                other => panic!("what is a block of {other:?}?"),
            }
        }
        assert!(!all.contains("is stalled"), "a sound flight has no errors:\n{all}");
        let report = std::fs::read_to_string(folder.path().join("report.json")).unwrap();
        let report: serde_json::Value = serde_json::from_str(&report).unwrap();
        println!("{:#}", report["sensors"]);
        assert!(report["completion"].as_f64().unwrap() > 0.8, "{report:#}");
        assert_eq!((&report["resets"], &report["hot_path_allocations"]), (&0.into(), &0.into()));
        let ate = last.lines().find(|line| line.starts_with("ATE [m]")).unwrap();
        let rmse_m: f64 = ate.split_whitespace().nth(2).unwrap().parse().unwrap();
        assert!(rmse_m < 0.05, "{last}");
    }

    /// Flies with sensors that other programs send, in which the IMU fails from the fifth to the eighth second; each line of the log
    /// with its time after the start of the sensors, s, and the report.
    const FLY: &str = r#"
plumbline fly --config my.toml --duration 15 --report report.json 2>&1 | python3 -u -c '
import sys, time
for line in sys.stdin: print(f"{time.monotonic():.3f} {line}", end="", flush=True)' > fly.log &
START=$(python3 -c 'import time; print(time.monotonic() + 3)')
echo $START > start
python3 $TESTS/faulty_imu.py $EXAMPLES/send_imu.py $MODE 5 8 --start $START my_flight $FOLDER/imu &
python3 $EXAMPLES/send_frames.py --start $START my_flight $FOLDER/frames &
wait
"#;

    #[test]
    fn an_imu_that_stops_repeats_or_sends_nan_is_named_within_a_second_and_no_task_is_blamed() {
        let Some(python) = interpreter("PIL") else { return };
        let folder = tempfile::tempdir().unwrap();
        let run = |code: &str, mode: &str| {
            let mut shell = Command::new("bash");
            shell.args(["-euo", "pipefail", "-c", code]).current_dir(folder.path());
            shell.env("PATH", search_path(&python)).env("FOLDER", folder.path()).env("MODE", mode);
            let project = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").canonicalize().unwrap();
            shell.env("EXAMPLES", project.join("examples")).env("TESTS", project.join("tests/python"));
            let output = shell.output().unwrap();
            println!("{mode}: {}", said(&output));
            assert!(output.status.success(), "{}", said(&output));
        };
        run("plumbline simulate my_flight --start 1 --duration 10 --scale 0.5", "");
        run("plumbline config import --euroc my_flight --base sim --out my.toml", "");
        let at = folder.path().display();
        edit(
            &folder.path().join("my.toml"),
            &format!(
                "[driver.imu]\nconnect = \"serial://{at}/imu:921600\"\nprotocol = \"plumbline\"\n[driver.frames]\nlisten = \"{at}/frames\"\n"
            ),
        );
        for (mode, words) in [
            ("silent", "the IMU has stopped sending samples"),
            ("nan", "are unusable (NaN"),
            ("repeated", "the IMU sends samples whose times do not increase"),
        ] {
            run(FLY, mode);
            let read = |name: &str| std::fs::read_to_string(folder.path().join(name)).unwrap();
            let (start, log): (f64, String) = (read("start").trim().parse().unwrap(), read("fly.log"));
            let named = log.lines().filter(|line| line.contains(words)).filter_map(|line| {
                let at: f64 = line.split_whitespace().next()?.parse().ok()?;
                Some(at - start)
            });
            let named: Vec<f64> = named.collect();
            println!("{mode}: named after {named:?} s");
            assert!(named.first().is_some_and(|at| (5.0..6.0).contains(at)), "{mode}: {named:?}\n{log}");
            assert!(named.len() <= 2 && !log.contains("is stalled"), "{mode}: {log}");
            let report: serde_json::Value = serde_json::from_str(&read("report.json")).unwrap();
            assert_eq!(report["live"]["stalls"], 0, "{mode}: {report:#}");
        }
    }
}

/// A crate beside this repository that depends on the estimator by the lines of the README; its example is a doctest of
/// the estimator.
#[test]
fn the_readme_of_the_estimator_names_its_dependencies() {
    let readme = std::fs::read_to_string(workspace().join("estimator/README.md")).unwrap();
    let (_, lines) = blocks(&readme).into_iter().find(|(language, _)| language == "toml").unwrap();
    let folder = tempfile::tempdir().unwrap();
    let own = folder.path().join("own");
    std::fs::create_dir_all(own.join("src")).unwrap();
    std::os::unix::fs::symlink(workspace().canonicalize().unwrap(), folder.path().join("plumbline")).unwrap();
    let package = "[package]\nname = \"own\"\nversion = \"0.1.0\"\nedition = \"2024\"\n\n";
    std::fs::write(own.join("Cargo.toml"), format!("{package}{lines}")).unwrap();
    std::fs::write(own.join("src/lib.rs"), "").unwrap();
    // The versions that are there; nothing is fetched.
    std::fs::copy(workspace().join("Cargo.lock"), own.join("Cargo.lock")).unwrap();
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let mut metadata = Command::new(cargo);
    metadata.args(["metadata", "--offline", "--format-version", "1"]).current_dir(&own);
    crate::done(metadata);
}
