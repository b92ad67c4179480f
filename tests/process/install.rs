//! Contents of a package: manual pages, completions; and the oldest processor.

use super::{plumbline, stderr, succeeds};
use plumbline_test_support::{Need, skip};
use std::path::Path;
use std::process::Command;

/// The commands that `plumbline COMMAND... --help` names, or all.
fn commands_below(path: &[&str]) -> Vec<String> {
    let arguments = if path.is_empty() { vec!["help", "all"] } else { [path, &["--help"]].concat() };
    let help = String::from_utf8(plumbline(&arguments).stdout).unwrap();
    let list = match help.split_once("\nCommands:\n") {
        Some((_, list)) => list.split_once("\n\n").unwrap().0,
        None if path.is_empty() => &help,
        None => return Vec::new(),
    };
    let names = list.lines().filter(|line| line.starts_with("  ") && !line.starts_with("   "));
    let names = names.filter_map(|line| line.split_whitespace().next());
    names.filter(|name| *name != "help").map(str::to_owned).collect()
}

/// Looks at the pages of a command and of all below it; how many there are.
fn pages_of(folder: &Path, path: &[&str]) -> usize {
    let name = [&["plumbline"], path].concat().join("-");
    let page = std::fs::read_to_string(folder.join(format!("{name}.1"))).unwrap();
    let escaped = name.replace('-', "\\-");
    assert!(page.contains(&format!(".SH NAME\n{escaped} \\- ")), "{page}");
    assert!(page.contains("\n.SH SYNOPSIS\n") && page.contains("\n.SH DESCRIPTION\n"), "{page}");
    let below = commands_below(path);
    1 + below.iter().map(|command| pages_of(folder, &[path, &[command.as_str()]].concat())).sum::<usize>()
}

#[test]
fn every_command_has_a_manual_page_and_no_page_is_left_of_another() {
    let folder = tempfile::tempdir().unwrap();
    let pages = folder.path().join("new/man1");
    succeeds(&["man", pages.to_str().unwrap()]);
    let found = pages_of(&pages, &[]);
    assert_eq!(found, std::fs::read_dir(&pages).unwrap().count());
    assert!(found > 25, "{found} pages");
}

/// The exposure that systemd finds of a unit of ours: 0 is none, 10 all.
fn exposure(unit: &str) -> Option<f64> {
    let root = tempfile::tempdir().unwrap();
    let units = root.path().join("usr/lib/systemd/system");
    std::fs::create_dir_all(&units).unwrap();
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../systemd").join(unit);
    let text = std::fs::read_to_string(file).unwrap();
    // What a unit starts has to be there.
    for program in ["usr/local/bin/plumbline", "bin/chgrp", "bin/chmod"] {
        let program = root.path().join(program);
        std::fs::create_dir_all(program.parent().unwrap()).unwrap();
        std::fs::copy("/bin/true", program).unwrap();
    }
    std::fs::write(units.join(unit), text).unwrap();
    let mut command = Command::new("systemd-analyze");
    command.arg("security").arg("--offline=true").arg(format!("--root={}", root.path().display()));
    let output = command.args(["--no-pager", unit]).output();
    let said =
        output.as_ref().map_or(String::new(), |output| String::from_utf8_lossy(&output.stdout).into_owned());
    let Some((_, found)) = said.split_once("exposure level for ") else {
        skip(Need::Systemd, format!("systemd-analyze security: {output:?}"));
        return None;
    };
    Some(found.split_whitespace().nth(1).unwrap().parse().unwrap())
}

#[test]
fn units_can_do_little_beside_their_work() {
    for unit in ["plumbline.service", "plumbline-link.service"] {
        let Some(exposure) = exposure(unit) else { return };
        assert!(exposure <= 3.0, "{unit}: {exposure}");
    }
}

#[test]
fn completions_know_every_command() {
    for shell in ["bash", "zsh", "fish"] {
        let output = succeeds(&["completions", shell]);
        let script = String::from_utf8(output.stdout).unwrap();
        for command in commands_below(&[]) {
            assert!(script.contains(&command), "{shell} knows nothing of {command}");
        }
    }
}

#[test]
fn the_oldest_processor_that_is_promised_runs_it() {
    if cfg!(not(all(target_arch = "x86_64", target_feature = "avx2"))) {
        skip(Need::ReferenceProcessor, "this build is for older processors, or for others");
        return;
    }
    let mut command = Command::new("qemu-x86_64-static");
    match command.args(["-cpu", "Haswell", env!("CARGO_BIN_EXE_plumbline"), "--version"]).output() {
        Ok(output) => {
            let version = concat!("plumbline ", env!("CARGO_PKG_VERSION"));
            assert!(output.status.success(), "{}", stderr(&output));
            assert!(String::from_utf8_lossy(&output.stdout).starts_with(version));
        }
        Err(error) => skip(Need::UserEmulation, format!("qemu-x86_64-static: {error}")),
    }
}
