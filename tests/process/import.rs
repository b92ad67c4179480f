//! A calibration by Kalibr becomes a configuration that flies.

use super::dataset::Folder;
use super::{fails, plumbline, stderr, succeeds};
use std::path::Path;

/// `camchain-imucam.yaml` as Kalibr writes it, of the EuRoC rig.
const CAMCHAIN: &str = "cam0:
  T_cam_imu:
  - [0.01486554, 0.99955725, -0.02577444, 0.06522291]
  - [-0.99988093, 0.01496721, 0.00375619, -0.02070639]
  - [0.00414030, 0.02571553, 0.99966073, -0.00805460]
  - [0.0, 0.0, 0.0, 1.0]
  cam_overlaps: [1]
  camera_model: pinhole
  distortion_coeffs: [-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05]
  distortion_model: radtan
  intrinsics: [458.654, 457.296, 367.215, 248.375]
  resolution: [752, 480]
  rostopic: /cam0/image_raw
  timeshift_cam_imu: 0.0001
cam1:
  T_cn_cnm1:
  - [0.99999727, 0.00231202, -0.00037611, -0.11007381]
  - [-0.00231714, 0.99989799, -0.01409344, 0.00039901]
  - [0.00034349, 0.01409427, 0.99990062, -0.00085359]
  - [0.0, 0.0, 0.0, 1.0]
  cam_overlaps: [0]
  camera_model: pinhole
  distortion_coeffs: [-0.28368365, 0.07451284, -0.00010473, -3.55590700e-05]
  distortion_model: radtan
  intrinsics: [457.587, 456.134, 379.999, 255.238]
  resolution: [752, 480]
  rostopic: /cam1/image_raw
  timeshift_cam_imu: 0.0001
";
const IMU: &str = "rostopic: /imu0
update_rate: 200.0
accelerometer_noise_density: 0.002
accelerometer_random_walk: 0.003
gyroscope_noise_density: 0.00016968
gyroscope_random_walk: 0.000019393
";

/// Kalibr's files in `folder`.
fn kalibr(folder: &Path) -> (String, String) {
    let at = |name: &str| folder.join(name).to_str().unwrap().to_owned();
    let (camchain, imu) = (at("camchain-imucam.yaml"), at("imu.yaml"));
    std::fs::write(&camchain, CAMCHAIN).unwrap();
    std::fs::write(&imu, IMU).unwrap();
    (camchain, imu)
}

#[test]
fn kalibrs_files_become_a_configuration_that_is_valid_and_flies() {
    let folder = tempfile::tempdir().unwrap();
    let (camchain, imu) = kalibr(folder.path());
    let out = folder.path().join("my.toml").to_str().unwrap().to_owned();
    let import = ["config", "import", "--camchain", &camchain, "--imu", &imu, "--out", &out];
    let mounted = [&import[..], &["--imu-to-vehicle", "180,-70.3,0"]].concat();
    let imported = succeeds(&[&mounted[..], &["--inflate", "10"]].concat());
    let told = String::from_utf8_lossy(&imported.stdout).into_owned();
    assert!(told.contains("white noise of the files times 10"), "{told}");
    assert!(told.contains("752x480 px") && told.contains("baseline    0.110"), "{told}");
    let text = std::fs::read_to_string(&out).unwrap();
    assert!(
        text.contains("camchain-imucam.yaml") && text.contains("gyro_noise_density = 0.001696"),
        "{text}"
    );
    let checked = succeeds(&["config", &out]);
    assert!(String::from_utf8_lossy(&checked.stdout).contains("valid, 2 camera(s)"));
    let flown =
        plumbline(&["replay", "sim:room", "--duration", "2", "--scale", "0.5", "--config", &out, "--json"]);
    assert!(flown.status.success(), "{}", stderr(&flown));
    let at_rest = plumbline(&[&mounted[..], &["--overwrite"]].concat());
    assert!(
        String::from_utf8_lossy(&at_rest.stdout)
            .contains("holds for a sensor at rest; for flight, give --inflate 10")
    );
    // A file that is there is not replaced unasked.
    fails(&import, 2, &["my.toml", "--overwrite"]);
    assert!(!told.contains("9999"), "digits that mean nothing: {told}");
}

#[test]
fn presets_are_written_to_a_file_and_named_where_one_is_meant() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("my.toml").to_str().unwrap().to_owned();
    assert!(plumbline(&["config", "euroc", "--out", &out]).status.success());
    let printed = plumbline(&["config", "euroc"]).stdout;
    assert_eq!(
        std::fs::read_to_string(&out).unwrap().trim_end(),
        String::from_utf8_lossy(&printed).trim_end()
    );
    fails(&["config", "euroc", "--out", &out], 2, &["my.toml", "--overwrite"]);
    fails(&["config", &out, "--all"], 2, &["--all", "defaults", "my.toml", "--merged"]);
    fails(&["config", &out, "--out", &out], 2, &["--out", "--merged", "realsense-d455"]);
    fails(&["config", "orbbec"], 2, &["orbbec", "no preset of this name", "realsense-d455", "oak-d"]);
}

#[test]
fn every_key_is_printed_with_its_default_and_a_file_may_start_from_a_preset() {
    let printed = |arguments: &[&str]| String::from_utf8(plumbline(arguments).stdout).unwrap();
    let (shown, all) = (printed(&["config", "defaults"]), printed(&["config", "defaults", "--all"]));
    assert!(shown.contains("\nmax_points = 120\n") && !shown.contains("\ncauchy_scale = "), "{shown}");
    assert!(all.contains("\nmax_points = 120\n") && all.contains("\ncauchy_scale = 2.0\n"), "{all}");
    let folder = tempfile::tempdir().unwrap();
    let [short, full] = ["short.toml", "full.toml"].map(|name| folder.path().join(name));
    std::fs::write(&short, "base = \"sim\"\n").unwrap();
    std::fs::write(&full, printed(&["config", "sim", "--all"])).unwrap();
    let hash = |file: &std::path::Path| {
        let said = printed(&["config", file.to_str().unwrap()]);
        said.trim_end().rsplit(' ').next().unwrap_or_default().to_owned()
    };
    let (of_short, of_full) = (hash(&short), hash(&full));
    assert!(of_short.len() == 64 && of_short == of_full, "{of_short} {of_full}");
    std::fs::write(&short, "base = \"sim\"\n[estimator.window]\ncauchy_scale = 3.0\n").unwrap();
    let merged = printed(&["config", short.to_str().unwrap(), "--merged"]);
    assert!(merged.starts_with("# Values of ") && merged.contains("\ncauchy_scale = 3.0\n"), "{merged}");
    std::fs::write(&full, &merged).unwrap();
    assert_eq!(hash(&short), hash(&full));
    std::fs::write(&short, "base = \"sim\"\n[network]\nlink = \"lann\"\n").unwrap();
    fails(
        &["config", short.to_str().unwrap()],
        2,
        &["short.toml", "network.link", "line 3", "`lan`, `wifi`, `radio`"],
    );
}

/// A simulated data set states its lens as Kalibr does, and gives it back with all its digits.
#[test]
fn every_lens_goes_through_a_data_set() {
    let folder = Folder::new();
    let preset = plumbline_config::preset_text("sim").unwrap();
    let lenses = [
        "model = \"rational\"\nk1 = 0.626\nk2 = 0.466\np1 = -0.00019\np2 = -0.000043\nk3 = 0.0042\nk4 = 0.894\nk5 = 0.543\nk6 = 0.066\n",
        "model = \"omni\"\nxi = 0.8\nk1 = -0.335\nk2 = 0.132\np1 = 0.00056\np2 = 0.00058\n",
        "model = \"eucm\"\nalpha = 0.629\nbeta = 1.042\n",
        "model = \"double-sphere\"\nxi = -0.241\nalpha = 0.567\n",
    ];
    for (k, lens) in lenses.iter().enumerate() {
        let (rig, flight, out) = (
            folder.at(&format!("rig{k}.toml")),
            folder.at(&format!("flight{k}")),
            folder.at(&format!("{k}.toml")),
        );
        let lens_line = format!("distortion = {{ {} }}", lens.trim().replace('\n', ", "));
        let lines =
            preset.lines().map(|line| if line.starts_with("distortion = ") { &lens_line } else { line });
        let text = lines.collect::<Vec<_>>().join("\n");
        std::fs::write(&rig, &text).unwrap();
        let simulated =
            plumbline(&["simulate", &flight, "--duration", "0.2", "--scale", "0.5", "--config", &rig]);
        assert!(simulated.status.success(), "{}", stderr(&simulated));
        succeeds(&["config", "import", "--euroc", &flight, "--base", "sim", "--out", &out]);
        let written = std::fs::read_to_string(&out).unwrap();
        let lines = lens.lines().filter(|line| written.matches(line).count() == 2).count();
        assert_eq!(lines, lens.lines().count(), "{written}");
    }
}

/// Basalt's calibration of EuRoC, its numbers rounded.
#[test]
fn the_calibration_of_another_program_is_imported_as_it_is() {
    let folder = Folder::new();
    let (rig, out) = (folder.at("calibration.json"), folder.at("my.toml"));
    let text = "{\"value0\": {\"T_imu_cam\": [{\"px\": -0.0168, \"py\": -0.0689, \"pz\": 0.0051, \"qx\": -0.00724, \"qy\": 0.00754, \
                \"qz\": 0.70178, \"qw\": 0.71231}], \"intrinsics\": [{\"camera_type\": \"ds\", \"intrinsics\": {\"fx\": 349.76, \"fy\": \
                348.72, \"cx\": 365.89, \"cy\": 249.33, \"xi\": -0.24096, \"alpha\": 0.567}}], \"resolution\": [[752, 480]], \
                \"imu_update_rate\": 200.0, \"accel_noise_std\": 0.016, \"gyro_noise_std\": 0.000282, \"accel_bias_std\": 0.001, \
                \"gyro_bias_std\": 0.0001, \"cam_time_offset_ns\": 0}}";
    std::fs::write(&rig, text).unwrap();
    let import = ["config", "import", "--rig", &rig, "--imu-to-vehicle", "unknown", "--out", &out];
    succeeds(&[&import[..], &["--inflate", "2"]].concat());
    let written = std::fs::read_to_string(&out).unwrap();
    assert!(
        written.contains("double-sphere") && written.contains("gyro_noise_density = 0.000564"),
        "{written}"
    );
    assert!(written.contains("calibration.json"), "{written}");
    assert!(plumbline(&["config", &out]).status.success());
    std::fs::write(&rig, text.replace("\"ds\"", "\"fov\"")).unwrap();
    fails(&[&import[..], &["--overwrite"]].concat(), 2, &["calibration.json", "camera_type", "eucm"]);
    std::fs::write(&rig, "a: 1\n").unwrap();
    fails(&[&import[..], &["--overwrite"]].concat(), 2, &["calibration.json", "ORB-SLAM3", "TUM-VI"]);
    fails(&["config", "import", "--out", &out, "--overwrite"], 2, &["--rig"]);
}

#[test]
fn what_cannot_be_imported_is_named_with_file_key_and_cure() {
    let folder = tempfile::tempdir().unwrap();
    let (camchain, imu) = kalibr(folder.path());
    let out = folder.path().join("my.toml").to_str().unwrap().to_owned();
    let import = |camchain: &str| {
        let mounted = ["--imu-to-vehicle", "unknown"];
        let [a, b] = mounted;
        ["config", "import", "--camchain", camchain, "--imu", &imu, "--out", &out, a, b].map(str::to_owned)
    };
    let refused = |arguments: [String; 10], parts: &[&str]| {
        fails(&arguments.iter().map(String::as_str).collect::<Vec<_>>(), 2, parts);
    };
    refused(import("/nowhere/camchain.yaml"), &["/nowhere/camchain.yaml", "cannot be read"]);
    for (from, to, parts) in [
        ("T_cam_imu", "T_body_cam", ["camchain-imucam.yaml", "cam0.T_cam_imu"]),
        ("radtan", "fov", ["cam0.distortion_model", "radtan"]),
        ("[458.654,", "[-458.654,", ["camera[0].focal_px", "camchain-imucam.yaml"]),
    ] {
        std::fs::write(&camchain, CAMCHAIN.replacen(from, to, 1)).unwrap();
        refused(import(&camchain), &parts);
    }
    assert!(!Path::new(&out).exists());
    std::fs::write(&camchain, CAMCHAIN).unwrap();
    fails(
        &["config", "import", "--camchain", &camchain, "--imu", &imu, "--out", "/nowhere/x.toml"],
        2,
        &["/nowhere"],
    );
}
