//! `simulate`, `replay` and `evaluate` fit together.

use super::{plumbline, stderr};

#[test]
fn a_written_flight_is_replayed_and_evaluated() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (flight, trajectory, report) = (at("flight"), at("out.tum"), at("report.json"));
    let simulated = plumbline(&["simulate", &flight, "--start", "2", "--duration", "4", "--scale", "0.5"]);
    assert!(simulated.status.success(), "{}", stderr(&simulated));
    let replayed = plumbline(&["replay", &flight, "--trajectory", &trajectory, "--report", &report]);
    assert!(replayed.status.success(), "{}", stderr(&replayed));
    let report: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(report).unwrap()).unwrap();
    for key in [
        "frames",
        "frames_refused",
        "first_pose_s",
        "completion",
        "realtime_factor",
        "peak_rss_mb",
        "resets",
        "hot_path_allocations",
        "ate_rmse_m",
        "estimate_digest",
        "frame_ms",
        "stage_ms",
        "points",
    ] {
        assert!(!report[key].is_null(), "{key} is missing");
    }
    for stage in ["points", "window", "marginalize", "propagate"] {
        assert!(report["stage_ms"][stage]["p99"].is_number(), "{stage} is missing");
    }
    assert_eq!(report["hot_path_allocations"], 0);
    assert!(report["peak_rss_mb"].as_f64().unwrap() < 150.0);
    let evaluated = plumbline(&["evaluate", &trajectory, &flight, "--json"]);
    assert!(evaluated.status.success(), "{}", stderr(&evaluated));
    let figures: serde_json::Value = serde_json::from_slice(&evaluated.stdout).unwrap();
    let (own, reported) =
        (figures["ate_m"]["rmse"].as_f64().unwrap(), report["ate_rmse_m"].as_f64().unwrap());
    assert!((own - reported).abs() < 1e-3, "{own} against {reported}");
    let overwritten = plumbline(&["simulate", &flight, "--duration", "1"]);
    assert!(!overwritten.status.success(), "a data set must not be overwritten unasked");
}
