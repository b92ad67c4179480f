use super::{euroc, with};
use crate::{Config, ConfigError, preset_text};
use std::io::Write;

fn refused(text: &str) -> ConfigError {
    Config::from_toml_str(text, "drone.toml").expect_err("is refused")
}

fn preset() -> String {
    preset_text("euroc").expect("exists")
}

#[test]
fn a_file_loads_as_its_text_does() {
    let mut file = tempfile::NamedTempFile::new().expect("temporary file");
    file.write_all(preset().as_bytes()).expect("written");
    assert_eq!(Config::load(file.path()).expect("good"), euroc());
}

#[test]
fn a_missing_file_is_named() {
    let message = Config::load("/nowhere/drone.toml").expect_err("missing").to_string();
    assert!(message.starts_with("/nowhere/drone.toml: cannot be read"), "{message}");
    assert!(Config::load("/").unwrap_err().to_string().starts_with("/: cannot be read"));
}

#[test]
fn a_huge_file_is_not_read() {
    let file = tempfile::NamedTempFile::new().expect("temporary file");
    file.as_file().set_len(1 << 40).expect("sparse file");
    assert!(Config::load(file.path()).unwrap_err().to_string().contains("longer than"));
}

#[test]
fn bytes_that_are_no_text_are_located() {
    let mut file = tempfile::NamedTempFile::new().expect("temporary file");
    file.write_all(b"a = 1\nb = \xff\n").expect("written");
    let message = Config::load(file.path()).expect_err("refused").to_string();
    assert!(message.contains("line 2, column 5: not UTF-8"), "{message}");
}

#[test]
fn yaml_is_named_with_the_command_that_reads_it() {
    for text in ["cam0:\n  T_cam_imu:\n", "# rig\n%YAML:1.0\n---\n", "rostopic: /imu0\nupdate_rate: 200.0\n"]
    {
        let message = refused(text).to_string();
        assert!(message.contains("is YAML") && message.contains("plumbline config import"), "{message}");
    }
    assert!(refused("[imu]\nrate_hz: 3\n").to_string().contains("line 2, column"));
}

#[test]
fn a_syntax_error_has_line_and_column() {
    let error = refused("[imu]\nrate_hz = = 3\n");
    assert!(error.to_string().contains("line 2, column 11: "), "{error}");
}

#[test]
fn an_unknown_key_suggests_the_nearest() {
    let error = refused(&with(&preset(), "keyframes = 7", "keyframe = 7"));
    let line = 1 + preset().lines().position(|l| l == "keyframes = 7").expect("is there");
    assert_eq!(
        error.to_string(),
        format!(
            "drone.toml: `estimator.window.keyframe` (line {line}): unknown key; did you mean `keyframes`?"
        )
    );
    let error = refused(&with(&preset(), "keyframes = 7", "colour = 7"));
    let message = error.to_string();
    assert!(message.contains("remove it; known here: cauchy_scale") && !message.contains("did you mean"));
}

#[test]
fn a_mounting_may_be_unknown_and_no_other_word() {
    let degrees = "imu_to_vehicle_deg = [180.0, -70.3, 0.0]";
    let unknown = with(&preset(), degrees, "imu_to_vehicle_deg = \"unknown\"");
    let config = Config::from_toml_str(&unknown, "drone.toml").expect("is good");
    assert_eq!(config.vehicle.rot_v_b(), None);
    let written = config.to_toml().expect("is plain data");
    assert_eq!(Config::from_toml_str(&written, "written").expect("is good"), config);
    let error = refused(&with(&preset(), degrees, "imu_to_vehicle_deg = \"upright\"")).to_string();
    assert!(error.contains("a list of 3 numbers or \"unknown\" is expected"), "{error}");
}

#[test]
fn all_values_out_of_range_are_collected() {
    let text = with(&preset(), "gravity_m_s2 = 9.81", "gravity_m_s2 = -9.81");
    let text = with(&text, "border_px = 8", "border_px = 99999999999");
    let error = refused(&text);
    let keys: Vec<&str> = error.violations().iter().map(|v| v.key.as_str()).collect();
    assert!(keys.contains(&"imu.gravity_m_s2") && keys.contains(&"estimator.points.border_px"), "{error}");
    assert!(error.violations().iter().all(|v| v.line.is_some() && !v.cure.is_empty()));
}

#[test]
fn a_wrong_type_or_size_is_refused_by_its_key_and_line() {
    for (from, to, key) in [
        ("width_px = 752", "width_px = 752.5", "camera[0].width_px"),
        ("rate_hz = 20.0", "rate_hz = \"20\"", "camera[0].rate_hz"),
        ("focal_px = [458.654, 457.296]", "focal_px = 458.0", "camera[0].focal_px"),
        ("focal_px = [458.654, 457.296]", "focal_px = [1.0]", "camera[0].focal_px"),
        ("[0.0, 0.0, 0.0, 1.0]", "[0.0, 0.0, 0.0]", "camera[0].pose_b_c[3]"),
        ("listen = []", "listen = [7447]", "network.listen[0]"),
        ("model = \"radial-tangential\"", "model = \"fisheye\"", "camera[0].distortion"),
        ("k1 = -0.28340811", "k3 = -0.28340811", "camera[0].distortion"),
        ("scouting = false", "scouting = \"no\"", "network.scouting"),
        ("border_px = 8", "border_px = -120", "estimator.points.border_px"),
    ] {
        let error = refused(&with(&preset(), from, to));
        let [found] = error.violations() else { panic!("{to}: {error}") };
        assert!(found.key.starts_with(key) && found.line.is_some(), "{to}: {error}");
    }
}

#[test]
fn a_missing_part_is_named_and_defaults_may_be_missing() {
    let error = refused("[imu]\nrate_hz = 200.0\n");
    assert!(error.violations()[0].reason == "missing", "{error}");
    let text = preset();
    let bare = text.split("[rig]").next().expect("has a head");
    let config = Config::from_toml_str(bare, "bare").expect("all else has defaults");
    assert_eq!(config.estimator, Config::new(Vec::new(), config.imu.clone()).estimator);
}

#[test]
fn values_are_refused_with_their_line() {
    let error = refused(&with(&preset(), "gravity_m_s2 = 9.81", "gravity_m_s2 = -9.81"));
    let line = 1 + preset().lines().position(|l| l == "gravity_m_s2 = 9.81").expect("is there");
    assert_eq!(
        error.to_string(),
        format!(
            "drone.toml: `imu.gravity_m_s2` (line {line}): -9.81 is outside 9.7 to 9.9; \
             write the positive magnitude on Earth in m/s², about 9.81"
        )
    );
}

#[test]
fn a_long_list_of_violations_is_cut() {
    let names = ["\"!\""; 100].join(", ");
    let error = refused(&with(&preset(), "excluded = []", &format!("excluded = [{names}]")));
    let message = error.to_string();
    assert!(error.violations().len() == 100 && message.lines().count() == 42, "{message}");
    assert!(message.ends_with("and 60 more"), "{message}");
}

#[test]
fn what_a_base_would_have_given_is_said_where_it_is_missing() {
    let said = |text: &str| refused(text).to_string();
    let bare = said("[estimator.points]\nmax_points = 100\n");
    assert!(bare.contains("`camera`") && bare.contains("begin the file with `base = \"euroc\"`"), "{bare}");
    let late = said("[estimator.points]\nbase = \"euroc\"\n");
    assert!(late.contains("estimator.points.base") && late.contains("first line of the file"), "{late}");
    let part = said("base = \"euroc\"\n[[camera]]\nexposure_s = 0.01\n");
    assert!(part.contains("copy the cameras whole"), "{part}");
}

#[test]
fn names_that_are_neither_file_nor_preset_are_told_with_what_is_alike() {
    let said = |name: &str| Config::load_or_preset(name).expect_err("refused").to_string();
    for (name, words) in [
        ("euroq", "did you mean euroc?"),
        ("realsense", "did you mean realsense-d435i or realsense-d455?"),
        ("zed-mni", "did you mean zed-mini?"),
        ("orbbec", "choose one of euroc, sim, "),
        ("defaults", "cameras and IMU have no defaults; write `[[camera]]` and `[imu]` into a file"),
        ("./defaults", "./defaults: cannot be read"),
        ("drone.toml", "drone.toml: cannot be read"),
    ] {
        assert!(said(name).contains(words), "{name}: {}", said(name));
    }
}
