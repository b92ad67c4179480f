use crate::shape::sample_for_tests;
use crate::{Config, PRESETS, preset_text};
use toml::{Table, Value};

/// The presets that show every option; the others are of single rigs, and short.
const FULL: [&str; 2] = ["euroc", "sim"];

#[test]
fn presets_survive_being_written_and_read() {
    for name in PRESETS {
        let config = Config::preset(name).expect("is good");
        let text = config.to_toml().expect("is plain data");
        assert_eq!(Config::from_toml_str(&text, "written").expect("is good"), config, "{name}");
    }
}

#[test]
fn an_unknown_preset_is_refused_with_the_known_ones() {
    let error = Config::preset("tumvi").expect_err("does not exist");
    assert_eq!(
        error.to_string(),
        "preset `tumvi`: does not exist; choose one of euroc, sim, mipi-stereo, oak-d, realsense-d435i, \
         realsense-d455, zed-mini"
    );
}

/// The keys of a tree, with `[]` for any element of a list of tables.
fn keys(value: &Value, prefix: &str, into: &mut Vec<String>) {
    match value {
        Value::Table(table) => {
            for (key, inner) in table {
                keys(inner, &format!("{prefix}.{key}"), into);
            }
        }
        Value::Array(list) if list.first().is_some_and(Value::is_table) => {
            keys(&list[0], &format!("{prefix}[]"), into)
        }
        _ => into.push(prefix.to_owned()),
    }
}

#[test]
fn full_presets_show_every_option_but_those_for_experiments() {
    for name in FULL {
        let table: Table = preset_text(name).expect("exists").parse().expect("is TOML");
        let (mut shown, mut known) = (Vec::new(), Vec::new());
        keys(&Value::Table(table), "", &mut shown);
        keys(&Value::Table(sample_for_tests()), "", &mut known);
        known.retain(|key| !crate::keys::tests::experiments().contains(&key[1..].to_owned()));
        shown.sort();
        known.sort();
        assert_eq!(shown, known, "{name}");
    }
}

/// Each `key = value` of a preset with its table and the comment above it.
fn documented(text: &str) -> Vec<(String, String, String)> {
    let (mut table, mut comment, mut found) = (String::new(), String::new(), Vec::new());
    for line in text.lines() {
        if let Some(words) = line.strip_prefix('#') {
            comment += words;
        } else if line.starts_with('[') {
            table = line.trim_matches(['[', ']']).to_owned();
            comment.clear();
        } else if let Some((key, _)) = line.split_once(" = ") {
            found.push((table.clone(), key.to_owned(), std::mem::take(&mut comment)));
        }
    }
    found
}

#[test]
fn comments_state_the_true_defaults() {
    let preset = Config::preset("euroc").expect("is good");
    let imu = crate::options::ImuConfig::with_noise(1.0, (1.0, 1.0), (1.0, 1.0));
    let defaults = Value::try_from(Config::new(preset.camera.clone(), imu)).expect("is plain data");
    for name in FULL {
        for (table, key, comment) in documented(&preset_text(name).expect("exists")) {
            let has_default = !table.starts_with("camera")
                && !(table == "imu"
                    && (key.ends_with("density") || key.ends_with("walk") || key == "rate_hz"));
            let Some((_, stated)) = comment.rsplit_once("Default ") else {
                assert!(!has_default, "{name}: {table}.{key} states no default");
                continue;
            };
            if !has_default {
                continue;
            }
            let stated = format!("v = {}", stated.trim_end_matches('.'));
            let stated: Table = stated.parse().unwrap_or_else(|e| panic!("{name}: {table}.{key}: {e}"));
            let truth = table.split('.').fold(&defaults, |value, part| &value[part]);
            assert!(same(&stated["v"], &truth[&key]), "{name}: {table}.{key} defaults to {}", truth[&key]);
        }
    }
}

/// Equal, numbers to the precision of f32, in which some options are held.
fn same(a: &Value, b: &Value) -> bool {
    match (a.as_float(), b.as_float()) {
        (Some(a), Some(b)) => (a - b).abs() <= 1e-6 * b.abs(),
        _ => a == b,
    }
}

#[test]
fn the_preset_of_the_simulator_has_the_noise_of_the_data_sheet() {
    let imu = Config::preset("sim").expect("is good").imu.clone();
    assert_eq!((imu.gyro_noise_density, imu.gyro_bias_walk), (1.6968e-4, 1.9393e-5));
    assert_eq!((imu.accel_noise_density, imu.accel_bias_walk), (2e-3, 3e-3));
}
