//! Messages name options that the command has which says them: every string of the sources is read.
//!
//! An option after the name of a command (`` `plumbline replay --cache` ``) is one of that command. Any other in the sources of a
//! command is one of its own, and in what several commands share, one that `fly`, `replay` and `doctor` all have.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// Options of a command, global ones and `--help` included.
fn options(command: &str) -> BTreeSet<String> {
    let mut cli = super::help::command();
    cli.build();
    let mut found = cli.clone();
    for name in command.split(' ') {
        let inner = found.find_subcommand(name).unwrap_or_else(|| panic!("there is no command {command}"));
        found = inner.clone();
    }
    let long = found.get_arguments().filter_map(|argument| argument.get_long()).map(str::to_owned);
    long.chain(["help".to_owned(), "version".to_owned()]).collect()
}

/// String literals of a source without its tests and comments.
fn literals(path: &Path) -> Vec<String> {
    let text = std::fs::read_to_string(path).unwrap();
    let code = text.split("#[cfg(test)]").next().unwrap_or_default();
    let (mut found, mut rest) = (Vec::new(), code);
    let lines: String =
        rest.lines().filter(|line| !line.trim_start().starts_with("//")).collect::<Vec<_>>().join("\n");
    rest = &lines;
    while let Some(begin) = rest.find('"') {
        let tail = &rest[begin + 1..];
        // The character '"' opens no string.
        if rest[..begin].ends_with('\'') && tail.starts_with('\'') {
            rest = &tail[1..];
            continue;
        }
        let mut escaped = false;
        let end = tail.find(|c| {
            let is_end = c == '"' && !escaped;
            escaped = c == '\\' && !escaped;
            is_end
        });
        let Some(end) = end else { break };
        found.push(tail[..end].replace("\\\n", " "));
        rest = &tail[end + 1..];
    }
    found
}

/// Options in a message, each with the command that is named before it in the same piece of code, if one is.
fn named(message: &str) -> Vec<(Option<String>, String)> {
    let mut found = Vec::new();
    for (index, piece) in message.split('`').enumerate() {
        let words: Vec<&str> = piece.split_whitespace().collect();
        let is_code = index % 2 == 1 && words.first() == Some(&"plumbline");
        let command = is_code.then(|| {
            let names = words[1..].iter().take_while(|word| word.chars().all(|c| c.is_ascii_lowercase()));
            names.copied().collect::<Vec<_>>().join(" ")
        });
        for word in words {
            let Some(option) = word.trim_start_matches(['(', '[', '\'']).strip_prefix("--") else { continue };
            let name: String = option.chars().take_while(|c| c.is_ascii_lowercase() || *c == '-').collect();
            if name.starts_with(|c: char| c.is_ascii_lowercase()) {
                found.push((command.clone(), name));
            }
        }
    }
    found
}

fn sources(folder: &Path, into: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()) {
        if entry.is_dir() && !entry.ends_with("tests") {
            sources(&entry, into);
        } else if entry.extension().is_some_and(|extension| extension == "rs")
            && !entry.file_stem().is_some_and(|stem| stem.to_string_lossy().contains("test"))
        {
            into.push(entry);
        }
    }
}

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// Options that a message names and its commands lack.
fn strays(paths: &[PathBuf], allowed: &BTreeSet<String>) -> Vec<String> {
    let mut strays = Vec::new();
    for path in paths {
        for message in literals(path) {
            for (command, option) in named(&message) {
                let is_there = match &command {
                    Some(command) if !command.is_empty() => options(command).contains(&option),
                    _ => allowed.contains(&option),
                };
                if !is_there {
                    strays.push(format!("{}: --{option} in {message:?}", path.display()));
                }
            }
        }
    }
    strays
}

#[test]
fn messages_that_commands_share_name_options_that_all_of_them_have() {
    let mut paths = Vec::new();
    for folder in
        ["runtime/checkup/src", "drivers/src/frame_socket", "drivers/src/inertial", "drivers/src/clock"]
    {
        sources(&root().join(folder), &mut paths);
    }
    for file in
        ["sensor_watch.rs", "sensors.rs", "capture.rs", "plausibility/mod.rs", "plausibility/watch.rs"]
    {
        paths.push(root().join("runtime/flight/src/flight").join(file));
    }
    let [fly, replay, doctor] = ["fly", "replay", "doctor"].map(options);
    let shared: BTreeSet<String> =
        fly.intersection(&replay).filter(|name| doctor.contains(*name)).cloned().collect();
    let strays = strays(&paths, &shared);
    assert!(paths.len() > 20 && strays.is_empty(), "{strays:#?}");
}

#[test]
fn messages_of_a_command_name_its_own_options() {
    let mut doctor = Vec::new();
    sources(&root().join("runtime/cli/src/doctor"), &mut doctor);
    let cli = |name: &str| vec![root().join("runtime/cli/src").join(name)];
    for (command, paths) in [
        ("fly", [cli("fly.rs"), cli("fly_status.rs")].concat()),
        ("replay", cli("replay.rs")),
        ("doctor", doctor),
    ] {
        let strays = strays(&paths, &options(command));
        assert!(strays.is_empty(), "{command}: {strays:#?}");
    }
}

#[test]
fn options_in_messages_are_found_with_the_command_before_them() {
    let found = named("give --map, or join two with `plumbline map merge --out FILE` (--set KEY)");
    let of = |command: Option<&str>, option: &str| (command.map(str::to_owned), option.to_owned());
    assert_eq!(found, [of(None, "map"), of(Some("map merge"), "out"), of(None, "set")]);
}
