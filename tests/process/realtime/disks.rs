//! Recordings of real flights on disks that are full, whose files are deleted, or whose folder is: what the recorder can still write is
//! written, and no flight changes. Part of `make soak`.

use crate::local::{digests, was_disturbed};
use crate::mounted::Mounted;
use crate::vehicle::{PLUMBLINE, Running, cache, eventually, flight, render};
use serde_json::Value;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

/// Length of the flights, s: 145 MB of images, or 60.
const LONG_S: u32 = 40;
const SHORT_S: u32 = 16;
const PATIENCE: Duration = Duration::from_secs(20);

/// A flight of so many seconds that records images as they are; `more` are its further arguments.
fn recording(flight_s: u32, folder: &Path, log: &Path, more: &[&str]) -> Running {
    render(flight_s);
    let mut command = flight("drone", flight_s);
    command.args(["--set", "recorder.images=raw"]).args(more).arg("--record").arg(log);
    command.arg("--report").arg(folder.join("report.json"));
    Running::start(command)
}

/// Waits for the end of a flight; its report, after a comparison with the flight that is not recorded.
fn finish(mut vehicle: Running, flight_s: u32, folder: &Path) -> Value {
    assert!(vehicle.child.wait().unwrap().success(), "{}", vehicle.words());
    let report = crate::json(folder.join("report.json"));
    let duration = flight_s.to_string();
    let mut command = Command::new(PLUMBLINE);
    command.args(["replay", "sim:room", "--start", "2", "--scale", "0.5", "--no-lines", "--json"]);
    let alone = command.args(["--duration", &duration]).arg("--cache").arg(cache()).output().unwrap();
    let alone = serde_json::from_slice(&alone.stdout).unwrap();
    assert!(was_disturbed(&report) || digests(&report) == digests(&alone));
    report
}

/// Parts of the log in a folder, the oldest first.
fn parts(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let mut parts: Vec<(std::time::SystemTime, PathBuf)> = entries
        .map(|entry| entry.path())
        .filter(|path| path.extension().is_some_and(|end| end == "mcap"))
        .filter_map(|path| Some((path.metadata().ok()?.modified().ok()?, path)))
        .collect();
    parts.sort();
    parts.into_iter().map(|(_, path)| path).collect()
}

fn bytes(folder: &Path) -> u64 {
    parts(folder).iter().filter_map(|part| Some(part.metadata().ok()?.len())).sum()
}

#[test]
#[ignore = "minutes: `make soak`"]
fn soak_a_recorder_keeps_the_newest_on_a_full_disk_also_while_parts_are_deleted() {
    for deletes in [false, true] {
        let folder = tempfile::tempdir().unwrap();
        let Some(disk) =
            Mounted::with(&["-t", "tmpfs", "-o", "size=80m", "tmpfs"], folder.path().join("disk"))
        else {
            return;
        };
        let more = ["--set", "recorder.keep=\"newest\"", "--set", "recorder.max_file_mb=32"];
        let mut vehicle = recording(LONG_S, folder.path(), &disk.0.join("flight.mcap"), &more);
        let mut deleted = 0;
        while vehicle.child.try_wait().unwrap().is_none() {
            let parts = parts(&disk.0);
            // The oldest one, which is the next to be deleted.
            if deletes && deleted == 0 && parts.len() > 1 {
                deleted += usize::from(std::fs::remove_file(&parts[0]).is_ok());
            }
            std::thread::sleep(Duration::from_millis(200));
        }
        let report = finish(vehicle, LONG_S, folder.path());
        let (recording, kept) = (&report["recording"], bytes(&disk.0));
        println!("{deleted} parts deleted by hand, {kept} bytes kept: {recording}");
        assert!(recording["ended_early"].is_null(), "{recording}");
        assert_eq!(recording["not_recorded"], 0, "{recording}");
        assert!(kept > 30_000_000 && recording["deleted_bytes"].as_u64() > Some(10_000_000), "{recording}");
        assert_eq!(deleted, usize::from(deletes));
    }
}

#[test]
#[ignore = "minutes: `make soak`"]
fn soak_a_recording_resumes_when_a_full_disk_has_room_again() {
    for keep in ["beginning", "newest"] {
        let folder = tempfile::tempdir().unwrap();
        let Some(disk) =
            Mounted::with(&["-t", "tmpfs", "-o", "size=200m", "tmpfs"], folder.path().join("disk"))
        else {
            return;
        };
        let filler = disk.0.join("filler");
        std::io::copy(
            &mut std::io::Read::take(std::io::repeat(7), 190 << 20),
            &mut File::create(&filler).unwrap(),
        )
        .unwrap();
        let log = disk.0.join("flight.mcap");
        let vehicle =
            recording(LONG_S, folder.path(), &log, &["--set", &format!("recorder.keep=\"{keep}\"")]);
        eventually("the disk is full", PATIENCE, || bytes(&disk.0) > 9_000_000);
        // Longer than the recorder's queue bridges.
        std::thread::sleep(Duration::from_secs(4));
        std::fs::remove_file(&filler).unwrap();
        let freed = Instant::now();
        eventually("the recording resumes", Duration::from_secs(5), || bytes(&disk.0) > 13_000_000);
        println!("{keep}: goes on {:?} after there is room", freed.elapsed());
        let report = finish(vehicle, LONG_S, folder.path());
        let recording = &report["recording"];
        assert!(recording["ended_early"].is_null(), "{recording}");
        assert!(recording["not_recorded"].as_u64() > Some(0), "{recording}");
    }
}

#[test]
#[ignore = "half a minute: `make soak`"]
fn soak_a_folder_of_a_recording_that_is_removed_or_moved_is_begun_anew() {
    for moved in [false, true] {
        let folder = tempfile::tempdir().unwrap();
        let logs = folder.path().join("logs");
        std::fs::create_dir(&logs).unwrap();
        let vehicle = recording(SHORT_S, folder.path(), &logs.join("flight.mcap"), &[]);
        eventually("it is recorded", PATIENCE, || bytes(&logs) > 5_000_000);
        match moved {
            true => std::fs::rename(&logs, folder.path().join("elsewhere")).unwrap(),
            false => std::fs::remove_dir_all(&logs).unwrap(),
        }
        let gone = Instant::now();
        eventually("another file is begun", Duration::from_secs(3), || bytes(&logs) > 0);
        println!("moved {moved}: another file after {:?}; {}", gone.elapsed(), vehicle.words());
        let report = finish(vehicle, SHORT_S, folder.path());
        assert!(report["recording"]["ended_early"].is_null(), "{}", report["recording"]);
        assert!(bytes(&logs) > 5_000_000, "{}", report["recording"]);
    }
}
