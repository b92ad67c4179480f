//! `simulate`, `replay` and `evaluate` fit together.

use super::dataset::{Folder, dataset};
use super::{plumbline, succeeds};

#[test]
fn a_written_flight_is_replayed_and_evaluated() {
    let folder = Folder::new();
    let (flight, trajectory, report) =
        (dataset(folder.path(), "3"), folder.at("out.tum"), folder.at("report.json"));
    succeeds(&["replay", &flight, "--trajectory", &trajectory, "--report", &report]);
    let report = crate::json(report);
    let keys = "frames frames_refused first_pose_s completion realtime_factor peak_rss_mb resets hot_path_allocations ate_rmse_m \
                estimate_digest frame_ms stage_ms points";
    for key in keys.split(' ') {
        assert!(!report[key].is_null(), "{key} is missing");
    }
    for stage in ["points", "window", "marginalize", "propagate"] {
        assert!(report["stage_ms"][stage]["p99"].is_number(), "{stage} is missing");
    }
    assert_eq!(report["hot_path_allocations"], 0);
    assert!(report["peak_rss_mb"].as_f64().unwrap() < 150.0);
    let evaluated = succeeds(&["evaluate", &trajectory, &flight, "--json"]);
    let figures: serde_json::Value = serde_json::from_slice(&evaluated.stdout).unwrap();
    let (own, reported) =
        (figures["ate_m"]["rmse"].as_f64().unwrap(), report["ate_rmse_m"].as_f64().unwrap());
    assert!((own - reported).abs() < 1e-3, "{own} against {reported}");
    let overwritten = plumbline(&["simulate", &flight, "--duration", "1"]);
    assert!(!overwritten.status.success(), "a data set must not be overwritten unasked");
}

#[test]
fn faults_are_put_into_recorded_frames_too() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = dataset(folder.path(), "3");
    let report = |faults: &[&str]| -> serde_json::Value {
        let output = succeeds(&[&["replay", &dataset, "--json"], faults].concat());
        serde_json::from_slice(&output.stdout).unwrap()
    };
    let (sound, again) = (report(&[]), report(&["--drop-rate", "0"]));
    assert_eq!(sound["estimate_digest"], again["estimate_digest"]);
    let dropped = report(&["--drop-rate", "0.3"]);
    let lost = dropped["faults"]["cameras"]["missing"].as_u64().unwrap();
    assert!((8..=40).contains(&lost), "{lost}");
    assert_eq!(dropped["frames"].as_u64().unwrap() + lost, sound["frames"].as_u64().unwrap());
    let single = report(&["--fault", "camera-lost:right@1+1"]);
    assert_eq!(single["faults"]["cameras"]["unpaired"], 20);
    let dark = report(&["--blackout", "2..3"]);
    assert!(dark["points"]["tracked"].as_f64() < sound["points"]["tracked"].as_f64());
}
