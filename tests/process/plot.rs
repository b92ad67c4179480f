//! A flight becomes a table of its states and a picture.

use super::{fails, plumbline, stderr};
use std::path::Path;
use std::process::Output;

fn succeeds(arguments: &[&str]) -> Output {
    let output = plumbline(arguments);
    assert!(output.status.success(), "{arguments:?}: {}", stderr(&output));
    output
}

/// Width and height of a PNG, px.
fn png_size(path: &Path) -> (u32, u32) {
    let bytes = std::fs::read(path).unwrap();
    assert_eq!(&bytes[..8], b"\x89PNG\r\n\x1a\n");
    let side = |at: usize| u32::from_be_bytes(bytes[at..at + 4].try_into().unwrap());
    (side(16), side(20))
}

#[test]
fn states_and_trajectory_of_a_flight_are_drawn_over_its_truth() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (flight, states, trajectory, log) = (at("flight"), at("states.csv"), at("out.tum"), at("log.mcap"));
    succeeds(&["simulate", &flight, "--start", "2", "--duration", "3", "--scale", "0.5"]);
    let outputs = ["--states", &states, "--trajectory", &trajectory, "--record", &log, "--json"];
    let flown = succeeds(&[&["replay", flight.as_str()][..], &outputs].concat());
    let report: serde_json::Value = serde_json::from_slice(&flown.stdout).unwrap();
    assert_eq!(report["hot_path_allocations"], 0);

    // A row a frame, and as many with a pose as the trajectory has.
    let table = std::fs::read_to_string(&states).unwrap();
    assert_eq!(table.lines().count() as u64, report["frames"].as_u64().unwrap() + 1);
    let with_pose = table.lines().skip(1).filter(|row| !row.split(',').nth(6).unwrap().is_empty()).count();
    let poses = std::fs::read_to_string(&trajectory).unwrap().lines().count();
    assert_eq!(with_pose, poses);

    for (estimate, out) in [(&states, "states.svg"), (&trajectory, "path.svg"), (&log, "log.svg")] {
        let picture = at(out);
        succeeds(&["plot", estimate, "--truth", &flight, "--out", &picture]);
        let svg = std::fs::read_to_string(&picture).unwrap();
        assert!(svg.starts_with("<svg width=\"1200\" height=\"900\""), "{}", &svg[..200]);
        assert!(svg.contains("Position error x [m]") && svg.contains("ATE RMSE"), "{out}");
        assert_eq!(svg.contains("Gyroscope bias"), out != "path.svg", "{out}");
    }
    // The log holds what the table has, bit for bit.
    let svg = |name: &str| std::fs::read_to_string(at(name)).unwrap();
    assert_eq!(svg("states.svg").replace(&states, ""), svg("log.svg").replace(&log, ""));

    let picture = at("flight.png");
    succeeds(&["plot", &states, "--out", &picture, "--size", "800x600"]);
    assert_eq!(png_size(Path::new(&picture)), (800, 600));
}

#[test]
fn what_cannot_be_drawn_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (path, other, states) = (at("a.tum"), at("b.tum"), at("states.csv"));
    std::fs::write(&path, "1.0 0 0 0 0 0 0 1\n2.0 1 0 0 0 0 0 1\n").unwrap();
    std::fs::write(&other, "100.0 0 0 0 0 0 0 1\n101.0 1 0 0 0 0 0 1\n").unwrap();
    fails(&["plot", &path, "--out", &at("x.pdf")], 2, &["x.pdf", ".svg or .png"]);
    fails(&["plot", &path, "--out", "/nowhere/x.png"], 2, &["/nowhere"]);
    fails(&["plot", &path, "--truth", &other, "--out", &at("x.png")], 1, &["no stamps within"]);
    std::fs::write(&states, "stamp_ns,frame,walking\n").unwrap();
    fails(&["plot", &states, "--out", &at("x.png")], 1, &["states.csv", "line 1", "`walking`"]);
}
