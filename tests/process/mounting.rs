//! Mounting of the IMU: imported, simulated, unknown, and measured.

use super::{plumbline, stderr, succeeds};
use plumbline_config::Config;
use plumbline_config::options::VehicleConfig;
use serde_json::Value;
use std::path::Path;

fn simulated(folder: &Path, config: &str) -> String {
    let path = folder.join(config).to_str().unwrap().to_owned();
    let arguments = ["simulate", &path, "--config", config, "--duration", "1.5", "--scale", "0.5"];
    succeeds(&arguments);
    path
}

/// The measures of a recording by their names.
fn measured(arguments: &[&str]) -> Value {
    let output = plumbline(arguments);
    let report: Value =
        serde_json::from_slice(&output.stdout).unwrap_or_else(|e| panic!("{e}: {}", stderr(&output)));
    let measures = report["measures"].as_array().unwrap();
    measures.iter().find(|measure| measure["name"] == "mounting").unwrap().clone()
}

#[test]
fn a_simulated_vehicle_is_level_in_the_data_set_that_is_written_of_it() {
    let folder = tempfile::tempdir().unwrap();
    let rot_v_b = |config: &Config| config.vehicle.rot_v_b().unwrap();
    let [sim, euroc] = ["sim", "euroc"].map(|name| rot_v_b(&Config::preset(name).unwrap()));
    assert!(sim.angle_to(&euroc).to_degrees() > 10.0, "the same rig on two vehicles");
    for config in ["euroc", "sim"] {
        let path = simulated(folder.path(), config);
        // The imported configuration has the mounting that the data set states.
        let out = folder.path().join(format!("{config}.toml"));
        succeeds(&["config", "import", "--euroc", &path, "--out", out.to_str().unwrap()]);
        let off = rot_v_b(&Config::load(&out).unwrap()).angle_to(&sim).to_degrees();
        assert!(off < 0.2, "{config}: {off} degrees");
        let flown = plumbline(&["replay", &path, "--json"]);
        let report: Value = serde_json::from_slice(&flown.stdout).unwrap();
        let angles: [f64; 3] = serde_json::from_value(report["imu_to_vehicle_deg"].clone()).unwrap();
        let off = VehicleConfig::mounted(angles).rot_v_b().unwrap().angle_to(&sim).to_degrees();
        assert!(off < 0.2, "{config}: {off} degrees");
    }
    let path = folder.path().join("sim");
    let measure = measured(&["doctor", path.to_str().unwrap(), "--json"]);
    assert!(measure["figures"]["tilt_deg"].as_f64().unwrap() < 2.0, "{measure:#}");
}

#[test]
fn an_unknown_mounting_is_imported_flown_and_reported() {
    let folder = tempfile::tempdir().unwrap();
    let path = simulated(folder.path(), "sim");
    let out = folder.path().join("my.toml");
    let out = out.to_str().unwrap();
    let import = ["config", "import", "--euroc", &path, "--out", out, "--imu-to-vehicle", "unknown"];
    let imported = succeeds(&import);
    let text = String::from_utf8_lossy(&imported.stdout).into_owned();
    assert!(text.contains("mounting    unknown: neither autopilot nor ROS 2 is served"), "{text}");
    let flown = plumbline(&["replay", &path, "--config", out, "--json"]);
    let report: Value =
        serde_json::from_slice(&flown.stdout).unwrap_or_else(|e| panic!("{e}: {}", stderr(&flown)));
    assert_eq!(report["imu_to_vehicle_deg"], Value::Null);
    let measure = measured(&["doctor", &path, "--config", out, "--json"]);
    let words = measure.to_string();
    assert!(
        words.contains("unknown; at rest the vertical is along") && words.contains("lift its nose"),
        "{words}"
    );
}
