//! Public bug reports of the field, each with a script that makes its input, runs the command and judges what it did: the folder
//! `cases` of the shared data. A script is given the command and a folder, and ends with 0 for the right thing.

use plumbline_test_support::{Need, python, shared, skip};
use std::path::{Path, PathBuf};
use std::process::Command;

/// Name, and last lines, of a case that was not right.
type Wrong = (String, String);

fn run(case: &Path, folder: &Path) -> Option<Wrong> {
    let name = case.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let folder = folder.join(&name);
    let interpreter = Some(python()).filter(|path| path.exists()).unwrap_or_else(|| PathBuf::from("python3"));
    let output = Command::new(interpreter)
        .arg(case)
        .args([Path::new(env!("CARGO_BIN_EXE_plumbline")), &folder])
        .output()
        .expect("an interpreter of Python");
    let _ = std::fs::remove_dir_all(&folder);
    let said = [output.stdout, output.stderr].concat();
    println!("{name}: {}", if output.status.success() { "right" } else { "WRONG" });
    (!output.status.success()).then(|| (name, String::from_utf8_lossy(&said).into_owned()))
}

#[test]
#[ignore = "minutes; run by `make soak`"]
fn soak_public_bug_reports_end_right() {
    let Some(cases) = shared("cases") else { return };
    let mut scripts: Vec<PathBuf> =
        std::fs::read_dir(&cases).unwrap().map(|entry| entry.unwrap().path()).collect();
    scripts.retain(|path| path.extension().is_some_and(|ending| ending == "py"));
    scripts.sort();
    if scripts.is_empty() {
        return skip(Need::SharedData, format_args!("{} holds no script", cases.display()));
    }
    let folder = tempfile::tempdir().unwrap();
    let wrong: Vec<Wrong> = scripts.iter().filter_map(|case| run(case, folder.path())).collect();
    let told: String = wrong.iter().map(|(name, said)| format!("{name}:\n{said}\n")).collect();
    assert!(wrong.is_empty(), "{} of {} are wrong:\n{told}", wrong.len(), scripts.len());
}
