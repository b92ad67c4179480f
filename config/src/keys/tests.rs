//! Products of the declarations: the file of all keys, and files that start from a preset.

use super::{Key, Kind, Table as _};
use crate::{Config, ConfigError, PRESETS, every_key, preset_text};
use toml::{Table, Value};

/// Paths of the keys for experiments.
pub(crate) fn experiments() -> Vec<String> {
    fn add(path: &str, keys: &[Key], found: &mut Vec<String>) {
        for key in keys {
            let path = if path.is_empty() { key.name.to_owned() } else { format!("{path}.{}", key.name) };
            match (key.kind)() {
                Kind::Table(inner) => add(&path, inner(), found),
                _ if key.is_experiment => found.push(path),
                _ => {}
            }
        }
    }
    let mut found = Vec::new();
    add("", Config::keys(), &mut found);
    found
}

fn parsed(text: &str) -> Result<Config, ConfigError> {
    Config::from_toml_str(text, "drone.toml").map(Config::from)
}

#[test]
fn a_preset_printed_in_full_is_the_preset() {
    for name in PRESETS {
        for with_experiments in [false, true] {
            let text = every_key(name, with_experiments).unwrap();
            assert_eq!(parsed(&text).unwrap(), Config::preset(name).unwrap().into_inner(), "{name}");
        }
    }
}

#[test]
fn the_file_of_defaults_lacks_what_is_required_and_nothing_else() {
    for with_experiments in [false, true] {
        let text = every_key("defaults", with_experiments).unwrap();
        let error = parsed(&text).unwrap_err();
        assert!(error.violations().iter().all(|violation| violation.reason == "missing"), "{error}");
        assert!(error.to_string().contains("`camera[0]."), "{error}");
        let euroc = Config::preset("euroc").unwrap();
        let (mut table, preset): (Table, Value) = (text.parse().unwrap(), Value::try_from(&*euroc).unwrap());
        for key in
            ["rate_hz", "gyro_noise_density", "gyro_bias_walk", "accel_noise_density", "accel_bias_walk"]
        {
            table["imu"].as_table_mut().unwrap().insert(key.into(), preset["imu"][key].clone());
        }
        table.insert("camera".into(), preset["camera"].clone());
        let imu = &euroc.imu;
        let imu = crate::options::ImuConfig::with_noise(
            imu.rate_hz,
            (imu.gyro_noise_density, imu.gyro_bias_walk),
            (imu.accel_noise_density, imu.accel_bias_walk),
        );
        let expected = Config::new(euroc.camera.clone(), imu);
        assert_eq!(parsed(&table.to_string()).unwrap(), expected);
    }
}

#[test]
fn keys_for_experiments_are_shown_on_request_alone_and_can_be_set_always() {
    let experiments = experiments();
    assert!(experiments.contains(&"estimator.window.cauchy_scale".to_owned()), "{experiments:?}");
    let (shown, all) = (every_key("euroc", false).unwrap(), every_key("euroc", true).unwrap());
    let [shown_table, all_table]: [Value; 2] = [&shown, &all].map(|text| Value::Table(text.parse().unwrap()));
    let has =
        |table: &Value, path: &str| path.split('.').try_fold(table, |table, key| table.get(key)).is_some();
    for path in &experiments {
        assert!(!has(&shown_table, path) && has(&all_table, path), "{path}");
        let (table, key) = path.rsplit_once('.').unwrap();
        let value = path.split('.').fold(&all_table, |table, key| &table[key]);
        let set = format!("base = \"sim\"\n[{table}]\n{key} = {value}\n");
        assert_eq!(parsed(&set).unwrap(), Config::preset("sim").unwrap().into_inner(), "{path}");
    }
    assert!(preset_text("sim").unwrap().contains("\nkeyframes = 7\n"));
    assert!(!preset_text("sim").unwrap().contains("cauchy_scale"));
}

/// Fewer numbers to turn: what is shown of the estimator.
#[test]
fn the_estimator_has_at_most_25_keys_to_show() {
    let text = every_key("defaults", false).unwrap();
    let estimator = &text.parse::<Table>().unwrap()["estimator"];
    let keys: usize = estimator.as_table().unwrap().values().map(|part| part.as_table().unwrap().len()).sum();
    assert!(keys <= 25, "{keys}");
}

#[test]
fn a_file_takes_what_it_does_not_set_from_its_base() {
    let text = "base = \"sim\"\n[imu]\nrate_hz = 400.0\n[estimator.points]\nmax_points = 80\n";
    let mut expected = Config::preset("sim").unwrap().into_inner();
    (expected.imu.rate_hz, expected.estimator.points.max_points) = (400.0, 80);
    assert_eq!(parsed(text).unwrap(), expected);
    let written = Config::from_toml_str(text, "drone.toml").unwrap().to_toml().unwrap();
    assert!(!written.contains("base =") && parsed(&written).unwrap() == expected);
}

#[test]
fn a_file_is_printed_with_the_values_of_its_base_and_is_the_same_then() {
    for (text, words) in [
        ("base = \"sim\"\n[imu]\nrate_hz = 400.0\n", "\nrate_hz = 400.0\n"),
        ("base = \"sim\"\n[estimator.window]\nkeyframes = 9\n", "\nkeyframes = 9\n"),
        // A key for experiments, which is else left out.
        ("base = \"sim\"\n[estimator.window]\ncauchy_scale = 3.0\n", "\ncauchy_scale = 3.0\n"),
        ("base = \"mipi-stereo\"\n", "CHANGE-ME"),
        ("base = \"sim\"\n[network]\nvehicle = \"hawk\"\n", "\nvehicle = \"hawk\"\n"),
    ] {
        let config = parsed(text).unwrap();
        let printed = config.to_commented_toml("Values of drone.toml.", false);
        assert!(printed.starts_with("# Values of drone.toml.\n") && printed.contains(words), "{printed}");
        assert!(!printed.contains("\nbase = "), "{printed}");
        assert_eq!(parsed(&printed).unwrap(), config, "{text}");
        assert_eq!(parsed(&config.to_commented_toml("All.", true)).unwrap(), config, "{text}");
    }
    let short = parsed("base = \"sim\"\n").unwrap().to_commented_toml("Short.", false);
    assert!(!short.contains("cauchy_scale"), "{short}");
}

#[test]
fn a_list_is_taken_from_a_file_or_its_base_as_a_whole() {
    let left = preset_text("sim").unwrap();
    let [first, second] = [left.find("\n[[camera]]\n"), left.rfind("\n[[camera]]\n")].map(Option::unwrap);
    let left = &left[first..second];
    let config = parsed(&format!("base = \"sim\"\n{left}")).unwrap();
    assert_eq!(config.camera, Config::preset("sim").unwrap().camera[..1]);
    let error = parsed("base = \"sim\"\n[[camera]]\nwidth_px = 640\n").unwrap_err();
    assert!(error.violations().iter().any(|violation| violation.key.starts_with("camera[0].")), "{error}");
}

#[test]
fn defaults_are_a_base_like_none() {
    let text = preset_text("euroc").unwrap();
    assert_eq!(parsed(&format!("base = \"defaults\"\n{text}")).unwrap(), parsed(&text).unwrap());
    let error = parsed("base = \"defaults\"\n").unwrap_err();
    assert_eq!(error.violations().iter().map(|v| v.key.as_str()).collect::<Vec<_>>(), ["camera"]);
}

#[test]
fn a_wrong_base_and_what_it_refuses_are_told_with_line_and_cure() {
    for (text, words) in [
        (
            "# rig\nbase = \"simulator\"\n",
            "`base` (line 2): there is no preset \"simulator\"; choose one of defaults, euroc",
        ),
        ("base = 7\n", "`base` (line 1): there is no preset \"7\""),
        (
            "base = \"sim\"\n[imu]\nrate = 3\n[estimator]\nmax_point = 3\n[[camera]]\nfocus = 1\n",
            "3 keys refused\n  `imu.rate` (line 3): unknown key; did you mean `rate_hz`?",
        ),
        ("base = \"sim\"\n[imu]\nrate = 3\n", "`imu.rate` (line 3): unknown key; did you mean `rate_hz`?"),
        ("base = \"sim\"\n[imu]\nrate_hz = 3.0\n", "`imu.rate_hz` (line 3): 3 is outside 50 to 4000"),
        ("base = \"sim\"\n[rig]\nbase = \"sim\"\n", "`rig.base` (line 3): belongs to the whole file"),
    ] {
        let error = parsed(text).unwrap_err().to_string();
        assert!(error.contains(words), "{words}: {error}");
    }
}

#[test]
fn a_word_that_a_key_does_not_have_is_refused_by_its_key_with_those_it_has() {
    let error = parsed("base = \"sim\"\n[network]\nlink = \"lann\"\n").unwrap_err().to_string();
    let words = "`network.link` (line 3): unknown variant `lann`, expected one of `lan`, `wifi`, `radio`";
    assert!(error.contains(words), "{error}");
    // The spelling of before 2026.
    let old = parsed("base = \"sim\"\n[autopilot]\nlost_pose = \"nan\"\n").unwrap();
    assert_eq!(old.autopilot.lost_pose, crate::options::LostPose::None);
}
