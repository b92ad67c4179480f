//! The archive of a flight has what a question needs, and nothing that is private.

use super::{fails, plumbline, stderr};
use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;

/// Files of an archive by their names.
fn extracted(archive: &str) -> BTreeMap<String, Vec<u8>> {
    let folder = tempfile::tempdir().unwrap();
    let tar = Command::new("tar").args(["-xzf", archive, "-C"]).arg(folder.path()).output().unwrap();
    assert!(tar.status.success(), "{}", stderr(&tar));
    let mut files = BTreeMap::new();
    for entry in std::fs::read_dir(folder.path().join("plumbline-report")).unwrap() {
        let entry = entry.unwrap();
        files.insert(entry.file_name().into_string().unwrap(), std::fs::read(entry.path()).unwrap());
    }
    files
}

/// A log of a flight of twelve seconds with a blackout, and whose configuration has secrets.
fn log(folder: &Path) -> String {
    let at = |name: &str| folder.join(name).display().to_string();
    let config = at("secret-place.toml");
    let preset = String::from_utf8(plumbline(&["config", "sim"]).stdout).unwrap();
    let mut text = preset.replacen("vehicle = \"drone\"", "vehicle = \"hawk-seventeen\"", 1);
    let imu = "# found by: setup\nconnect = \"serial:///dev/serial/by-id/usb-ACME_SN4711-if00:921600\"";
    text = text.replacen("connect = \"\"", imu, 1);
    assert!(text.contains("hawk-seventeen") && text.contains("SN4711"));
    std::fs::write(&config, text).unwrap();
    let log = at("flight.mcap");
    let options = ["--start", "3", "--duration", "12", "--scale", "0.4", "--fault", "image-black@5+2"];
    let flown =
        plumbline(&[&["replay", "sim:room", "--config", &config, "--record", &log], &options[..]].concat());
    assert!(flown.status.success(), "{}", stderr(&flown));
    log
}

#[test]
fn the_archive_of_a_log_answers_questions_and_keeps_secrets() {
    let folder = tempfile::tempdir().unwrap();
    let log = log(folder.path());
    let out = folder.path().join("report.tar.gz").display().to_string();
    let written = plumbline(&["report", &log, "--out", &out]);
    assert!(written.status.success(), "{}", stderr(&written));
    let files = extracted(&out);
    let text =
        |name: &str| String::from_utf8(files[name].clone()).unwrap_or_else(|_| panic!("{name} is no text"));
    println!("{}{}", text("README.txt"), text("doctor.txt"));
    for name in files.keys() {
        assert!(
            name == "README.txt" || text("README.txt").contains(name.as_str()),
            "{name} is not explained"
        );
    }
    assert_eq!(text("health.csv").lines().count(), 13);
    assert!(text("health.csv").lines().any(|line| !line.ends_with(',')), "no second has a health bit");
    assert!(text("doctor.txt").contains("stereo pairs") && text("about.json").contains("\"rustc\""));
    assert!(text("config.toml").contains("sigma_px") && text("config.toml").contains("(left out)"));
    let host = std::fs::read_to_string("/proc/sys/kernel/hostname").unwrap();
    let place = folder.path().display().to_string();
    for secret in ["hawk-seventeen", "SN4711", "ACME", "secret-place", host.trim(), &place] {
        for (name, content) in &files {
            let is_there = content.windows(secret.len()).any(|window| window == secret.as_bytes());
            assert!(!is_there || secret.len() < 3, "'{secret}' is in {name}");
        }
    }
    // Only what is asked for.
    let written = plumbline(&["report", &log, "--out", &out, "--with-addresses"]);
    assert!(written.status.success(), "{}", stderr(&written));
    assert!(String::from_utf8_lossy(&extracted(&out)["config.toml"]).contains("SN4711"));
}

#[test]
fn a_report_of_nothing_and_into_nothing_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("report.tar.gz").display().to_string();
    fails(&["report", "/nowhere/flight.mcap", "--out", &out], 2, &["/nowhere/flight.mcap"]);
    fails(&["report", "a.mcap", "--out", "/nowhere/report.tar.gz"], 2, &["/nowhere/report.tar.gz"]);
    fails(&["report", "sim:room", "--out", &out], 2, &["sim:room"]);
    fails(&["report", "a.mcap", "--out", "report.rar"], 2, &["report.rar", ".tar.gz"]);
}
