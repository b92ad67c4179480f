//! Recordings that were cut off or damaged in part: `replay` and `doctor` name the file, the first place and what to do.

use super::dataset::dataset;
use super::vehicle::{PLUMBLINE, Running, eventually};
use super::{plumbline, stderr, succeeds};
use plumbline_client::Local;
use plumbline_flight::local::record::{Kind, Kinds};
use plumbline_flight::local::request::Request;
use plumbline_record::local::content::LocalRecord;
use std::fs;
use std::os::unix::net::UnixStream;
use std::process::Command;
use std::time::Duration;

/// Keeps the share `kept` of the rows of a table.
fn cut(table: &str, kept: f64) {
    let text = fs::read_to_string(table).unwrap();
    let lines: Vec<&str> = text.lines().collect();
    fs::write(table, lines[..(lines.len() as f64 * kept) as usize].join("\n")).unwrap();
}

/// Warnings of `replay`, and status and output of `doctor`.
fn told(flight: &str) -> (String, Option<i32>, String) {
    let flown = plumbline(&["replay", flight]);
    assert_eq!(flown.status.code(), Some(0), "{}", stderr(&flown));
    let checked = plumbline(&["doctor", flight]);
    let text = String::from_utf8_lossy(&checked.stdout).into_owned();
    (stderr(&flown), checked.status.code(), text + &stderr(&checked))
}

#[test]
fn samples_that_end_before_the_images_are_named_with_the_time() {
    let folder = tempfile::tempdir().unwrap();
    let flight = dataset(folder.path(), "3");
    cut(&format!("{flight}/mav0/imu0/data.csv"), 0.5);
    let (replayed, status, checked) = told(&flight);
    for said in [&replayed, &checked] {
        for words in
            ["end before the images", "imu0/data.csv: its last sample is at", "the images go on for 1."]
        {
            assert!(said.contains(words), "{words}: {said}");
        }
    }
    assert_eq!(status, Some(1), "{checked}");
}

#[test]
fn a_camera_with_half_of_the_images_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let flight = dataset(folder.path(), "3");
    cut(&format!("{flight}/mav0/cam0/data.csv"), 0.5);
    let (replayed, _, checked) = told(&flight);
    for said in [&replayed, &checked] {
        assert!(said.contains("images more than cam0") && said.contains("copy cam0 again"), "{said}");
    }
}

#[test]
fn rows_and_images_that_cannot_be_read_are_named_by_file_and_place() {
    let folder = tempfile::tempdir().unwrap();
    let flight = dataset(folder.path(), "3");
    let table = format!("{flight}/mav0/imu0/data.csv");
    let text = fs::read_to_string(&table).unwrap();
    let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
    let mut row: Vec<&str> = lines[99].split(',').collect();
    row[2] = "nan";
    lines[99] = row.join(",");
    fs::write(&table, lines.join("\n")).unwrap();
    let (replayed, status, checked) = told(&flight);
    for said in [&replayed, &checked] {
        assert!(said.contains("imu0/data.csv, line 100: column 3 is 'nan', no finite number"), "{said}");
    }
    assert_eq!(status, Some(4), "{checked}");

    let mut images: Vec<_> = fs::read_dir(format!("{flight}/mav0/cam0/data"))
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .collect();
    images.sort();
    fs::remove_file(&images[5]).unwrap();
    fs::write(&images[6], b"no image").unwrap();
    // Images of the other size are those of another flight.
    let small = folder.path().join("small");
    let arguments =
        ["simulate", small.to_str().unwrap(), "--start", "3", "--duration", "0.5", "--scale", "0.25"];
    succeeds(&arguments);
    let other = fs::read_dir(small.join("mav0/cam0/data")).unwrap().next().unwrap().unwrap().path();
    for image in &images[20..23] {
        fs::copy(&other, image).unwrap();
    }
    let (replayed, status, checked) = told(&flight);
    let name = |index: usize| images[index].display().to_string();
    for said in [&replayed, &checked] {
        for words in [
            format!("{} is missing", name(5)),
            format!("{} is cut off or not a PNG", name(6)),
            format!("3 images are 188x120, not 376x240; the first is {}", name(20)),
        ] {
            assert!(said.contains(&words), "{words}: {said}");
        }
        assert!(!said.contains("trigger both cameras"), "{said}");
    }
    assert_eq!(status, Some(1), "{checked}");
}

#[test]
fn truncated_images_and_a_nan_are_survived_and_counted() {
    let folder = tempfile::tempdir().unwrap();
    let flight = dataset(folder.path(), "0.5");
    let images = fs::read_dir(format!("{flight}/mav0/cam0/data")).unwrap();
    let image = images.map(|entry| entry.unwrap().path()).min().unwrap();
    let bytes = fs::read(&image).unwrap();
    fs::write(&image, &bytes[..bytes.len() / 3]).unwrap();
    let table = format!("{flight}/mav0/imu0/data.csv");
    let mut lines: Vec<String> = fs::read_to_string(&table).unwrap().lines().map(str::to_owned).collect();
    let stamp = lines[50].split(',').next().unwrap().to_owned();
    lines[50] = format!("{stamp},NaN,0,0,0,0,9.81");
    fs::write(&table, lines.join("\n")).unwrap();
    let output = succeeds(&["replay", &flight, "--json"]);
    let report: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(report["faults"]["imu"]["corrupt"], 1);
    assert_eq!(report["faults"]["cameras"]["corrupt"], 1);
    assert_eq!(report["resets"], 0);
}

#[test]
fn readers_of_the_local_socket_hear_what_the_data_of_a_flight_show_to_be_wrong() {
    let folder = tempfile::tempdir().unwrap();
    let flight = dataset(folder.path(), "6");
    let table = format!("{flight}/mav0/imu0/data.csv");
    let exchanged = |line: &str| {
        let row: Vec<&str> = line.split(',').collect();
        if line.starts_with('#') {
            line.to_owned()
        } else {
            [&row[..1], &row[4..7], &row[1..4]].concat().join(",")
        }
    };
    let text = fs::read_to_string(&table).unwrap();
    fs::write(&table, text.lines().map(exchanged).collect::<Vec<_>>().join("\n")).unwrap();
    let socket = folder.path().join("local");
    let mut command = Command::new(PLUMBLINE);
    command.arg("replay").arg(&flight).args(["--speed", "1"]);
    command.args(["--set", &format!("local.path=\"{}\"", socket.display())]);
    let running = Running::start(command);
    eventually("the local socket is there", Duration::from_secs(20), || socket.exists());
    let mut client = Local::over(UnixStream::connect(&socket).unwrap());
    client.requests().unwrap().send(&Request::Subscribe(Kinds::of(&[Kind::Sensors]))).unwrap();
    let notices = loop {
        match client.next_record() {
            Ok(LocalRecord::Sensors(news)) if !news.notices.is_empty() => break news.notices,
            Ok(LocalRecord::End) | Err(_) => panic!("nothing was told: {}", running.words()),
            Ok(_) => {}
        }
    };
    assert!(notices.iter().any(|notice| notice.contains("columns")), "{notices:?}");
}
