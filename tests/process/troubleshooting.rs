//! Every command of the page on troubleshooting runs as it stands there.

use super::stderr;
use std::process::Command;

/// The commands of the page, each with the exit status that it is to have.
fn commands(page: &str) -> Vec<(Vec<String>, i32)> {
    let lines = page.lines().filter_map(|line| line.strip_prefix("    plumbline "));
    lines
        .map(|line| {
            let (command, note) = line.split_once('#').unwrap_or((line, ""));
            let status = if note.contains("status 1") { 1 } else { 0 };
            (command.split_whitespace().map(ToOwned::to_owned).collect(), status)
        })
        .collect()
}

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
    for (arguments, status) in commands {
        let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
        let mut command = Command::new(env!("CARGO_BIN_EXE_plumbline"));
        let output = command.args(&arguments).current_dir(folder.path()).output().expect("the command runs");
        assert_eq!(output.status.code(), Some(status), "{arguments:?}: {}", stderr(&output));
    }
}
