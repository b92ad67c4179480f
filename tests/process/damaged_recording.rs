//! Recordings that were cut off or damaged in part: `replay` and `doctor` name the file, the first place and what to do.

use super::{plumbline, stderr};
use std::fs;
use std::path::{Path, PathBuf};

/// Three seconds of a simulated flight.
fn recording(folder: &Path) -> PathBuf {
    let path = folder.join("flight");
    let arguments = ["simulate", path.to_str().unwrap(), "--start", "3", "--duration", "3", "--scale", "0.5"];
    let written = plumbline(&arguments);
    assert!(written.status.success(), "{}", stderr(&written));
    path
}

/// Keeps the share `kept` of the rows of a table.
fn cut(table: &Path, kept: f64) {
    let text = fs::read_to_string(table).unwrap();
    let lines: Vec<&str> = text.lines().collect();
    fs::write(table, lines[..(lines.len() as f64 * kept) as usize].join("\n")).unwrap();
}

/// What `replay` warns of, and status and output of `doctor`.
fn told(flight: &Path) -> (String, Option<i32>, String) {
    let flight = flight.to_str().unwrap();
    let flown = plumbline(&["replay", flight]);
    assert_eq!(flown.status.code(), Some(0), "{}", stderr(&flown));
    let checked = plumbline(&["doctor", flight]);
    let text = String::from_utf8_lossy(&checked.stdout).into_owned();
    (stderr(&flown), checked.status.code(), text + &stderr(&checked))
}

#[test]
fn samples_that_end_before_the_images_are_named_with_the_time() {
    let folder = tempfile::tempdir().unwrap();
    let flight = recording(folder.path());
    cut(&flight.join("mav0/imu0/data.csv"), 0.5);
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
    let flight = recording(folder.path());
    cut(&flight.join("mav0/cam0/data.csv"), 0.5);
    let (replayed, _, checked) = told(&flight);
    for said in [&replayed, &checked] {
        assert!(said.contains("images more than cam0") && said.contains("copy cam0 again"), "{said}");
    }
}

#[test]
fn rows_and_images_that_cannot_be_read_are_named_by_file_and_place() {
    let folder = tempfile::tempdir().unwrap();
    let flight = recording(folder.path());
    let table = flight.join("mav0/imu0/data.csv");
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
    assert_eq!(status, Some(0), "{checked}");

    let mut images: Vec<_> =
        fs::read_dir(flight.join("mav0/cam0/data")).unwrap().map(|entry| entry.unwrap().path()).collect();
    images.sort();
    fs::remove_file(&images[5]).unwrap();
    fs::write(&images[6], b"no image").unwrap();
    // Images of the other size are those of another flight.
    let small = folder.path().join("small");
    let arguments =
        ["simulate", small.to_str().unwrap(), "--start", "3", "--duration", "0.5", "--scale", "0.25"];
    let written = plumbline(&arguments);
    assert!(written.status.success(), "{}", stderr(&written));
    let other = fs::read_dir(small.join("mav0/cam0/data")).unwrap().next().unwrap().unwrap().path();
    for image in &images[20..23] {
        fs::copy(&other, image).unwrap();
    }
    let (replayed, status, checked) = told(&flight);
    let name = |index: usize| images[index].display().to_string();
    for said in [&replayed, &checked] {
        for words in [
            format!("{} is missing", name(5)),
            format!("{} is cut off or no PNG", name(6)),
            format!("3 images are 188x120, not 376x240; the first is {}", name(20)),
        ] {
            assert!(said.contains(&words), "{words}: {said}");
        }
        assert!(!said.contains("trigger both cameras"), "{said}");
    }
    assert_eq!(status, Some(1), "{checked}");
}
