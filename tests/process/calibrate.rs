//! `plumbline calibrate imu`, `masks` and `rig`.

use super::{fails, plumbline, stderr};

#[test]
fn noise_of_a_standing_sensor_is_written_as_a_configuration_with_a_figure() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (path, flight, out, plot) = (at("rest.tum"), at("flight"), at("imu.toml"), at("allan.svg"));
    let poses: String = (0..12).map(|k| format!("{}.0 1 2 1 0 0 0 1\n", 100 + 10 * k)).collect();
    std::fs::write(&path, poses).unwrap();
    // One frame in ten seconds: only the inertial samples count here.
    let slow = at("slow.toml");
    super::python::configuration(std::path::Path::new(&slow), &[("imu.rate_hz", "100.0".into())]);
    let text = std::fs::read_to_string(&slow).unwrap().replace("rate_hz = 20.0", "rate_hz = 1.0");
    std::fs::write(&slow, text).unwrap();
    let arguments = [
        "simulate",
        &flight,
        "--config",
        &slow,
        "--path",
        &path,
        "--duration",
        "90",
        "--scale",
        "0.3",
        "--mono",
    ];
    let simulated = plumbline(&arguments);
    assert!(simulated.status.success(), "{}", stderr(&simulated));
    let output = plumbline(&[
        "calibrate",
        "imu",
        &flight,
        "--out",
        &out,
        "--plot",
        &plot,
        "--inflate",
        "2",
        "--config",
        "sim",
    ]);
    assert!(output.status.success(), "{}", stderr(&output));
    let said = String::from_utf8(output.stdout.clone()).unwrap();
    assert!(said.contains("at rest from 0.0 s on for 90.2 s") && said.contains("gyroscope x"), "{said}");
    assert!(stderr(&output).contains("gyroscope: 90 s are too short"), "{}", stderr(&output));
    let written: toml::Table = std::fs::read_to_string(&out).unwrap().parse().unwrap();
    let number = |key: &str| written["imu"][key].as_float().unwrap();
    assert!((number("gyro_noise_density") / 2.0 / 1.6968e-4 - 1.0).abs() < 0.15);
    assert!((number("accel_noise_density") / 2.0 / 2.0e-3 - 1.0).abs() < 0.15);
    assert_eq!((number("gyro_bias_walk"), number("rate_hz")), (1.9393e-5, 100.0), "not seen, so as it was");
    assert!(std::fs::read_to_string(&plot).unwrap().contains("Gyroscope: Allan deviation"));
    assert!(plumbline(&["config", &out]).status.success());
    fails(&["calibrate", "imu", &flight, "--out", &out], 2, &["imu.toml", "--overwrite"]);
    // A rig that stands does not show where its cameras are.
    let rig = at("rig.toml");
    fails(&["calibrate", "rig", &flight, "--out", &rig], 1, &["flight", "lacks rotation about", "deg/s"]);
    assert!(!std::path::Path::new(&rig).exists());
}

#[test]
fn what_is_no_recording_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out.toml");
    let out = out.to_str().unwrap();
    fails(&["calibrate", "imu", "/nowhere/data.csv", "--out", out], 2, &["/nowhere/data.csv"]);
    fails(&["calibrate", "rig", "/nowhere", "--out", out], 2, &["/nowhere"]);
    fails(&["calibrate", "imu", "/nowhere", "--out", out, "--inflate", "0"], 2, &["--inflate"]);
}
