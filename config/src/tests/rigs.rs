//! The presets of real rigs: whether they mean what the makers' drawings and data sheets say.

use crate::options::{ImuEndpoint, V4l2Format};
use crate::{Config, PRESETS, ValidConfig, preset_text};
use nalgebra::Vector3;

/// Name, baseline in mm, horizontal field of view in degrees by the data sheet.
const RIGS: [(&str, f64, f64); 5] = [
    ("mipi-stereo", 80.0, 69.0),
    ("oak-d", 75.0, 80.0),
    ("realsense-d435i", 50.0, 90.0),
    ("realsense-d455", 95.0, 90.0),
    ("zed-mini", 63.0, 90.0),
];

fn rig(name: &str) -> ValidConfig {
    Config::preset(name).unwrap_or_else(|error| panic!("{error}"))
}

fn page(name: &str) -> String {
    let path = format!("{}/../docs/rigs/{name}", env!("CARGO_MANIFEST_DIR"));
    std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{path}: {error}"))
}

#[test]
fn every_rig_has_a_preset_and_a_line_in_the_table_of_rigs() {
    let names: Vec<&str> = PRESETS.iter().copied().filter(|name| !["euroc", "sim"].contains(name)).collect();
    assert_eq!(names, RIGS.map(|(name, ..)| name));
    let table = page("README.md");
    let rows: Vec<&str> = table.lines().filter(|line| line.starts_with("| [")).collect();
    for (name, ..) in RIGS {
        let with_name = rows.iter().filter(|row| row.contains(&format!("`{name}`"))).count();
        assert_eq!(with_name, 1, "{name} has one row in docs/rigs/README.md");
    }
    assert_eq!(rows.len(), RIGS.len(), "no row is of a preset that does not exist");
}

#[test]
fn a_preset_names_the_page_of_its_rig() {
    for (name, ..) in RIGS {
        let text = preset_text(name).unwrap();
        let at = text.split("docs/rigs/").nth(1).unwrap_or_else(|| panic!("{name} names no page"));
        let file: String =
            at.chars().take_while(|c| c.is_ascii_alphanumeric() || "-.".contains(*c)).collect();
        assert!(page(file.trim_end_matches('.')).contains(name), "{name} is not on its page {file}");
    }
}

#[test]
fn the_right_camera_is_the_makers_baseline_to_the_right_of_the_left_one() {
    for (name, baseline_mm, _) in RIGS {
        let config = rig(name);
        let right_c0 = config.camera[0].pose_b_c().inverse() * config.camera[1].pose_b_c();
        let expected = Vector3::new(baseline_mm * 1e-3, 0.0, 0.0);
        assert!((right_c0.translation.vector - expected).norm() < 1e-6, "{name}: {}", right_c0.translation);
    }
}

#[test]
fn cameras_look_forward_and_stand_upright_in_the_vehicle() {
    for (name, ..) in RIGS {
        let config = rig(name);
        let rot_v_c = config.vehicle.rot_v_b().unwrap() * config.camera[0].pose_b_c().rotation;
        // Camera axes x right, y down, z forward; vehicle axes x forward, y left, z up.
        for (axis_c, axis_v) in
            [(Vector3::x(), -Vector3::y()), (Vector3::y(), -Vector3::z()), (Vector3::z(), Vector3::x())]
        {
            assert!((rot_v_c * axis_c - axis_v).norm() < 1e-6, "{name}: {axis_c} is {}", rot_v_c * axis_c);
        }
    }
}

#[test]
fn focal_lengths_give_the_field_of_view_of_the_data_sheet() {
    for (name, _, degrees) in RIGS {
        for camera in &rig(name).camera {
            let model = camera.model();
            let edge = |x: f64| {
                let ray = model.unproject(&nalgebra::Vector2::new(x, camera.centre_px[1])).unwrap();
                ray.x.atan().to_degrees()
            };
            let field = edge(camera.width_px as f64 - 0.5) - edge(-0.5);
            assert!((field - degrees).abs() < 3.0, "{name}: {field:.1} degrees, not {degrees}");
        }
    }
}

#[test]
fn drivers_are_those_that_the_rig_has() {
    for (name, ..) in RIGS {
        let driver = rig(name).driver.clone();
        let imu = (!driver.imu.connect.is_empty()).then(|| ImuEndpoint::parse(&driver.imu.connect).unwrap());
        match name {
            // No device of the kernel.
            "oak-d" => assert!(driver.v4l2.left.is_empty() && imu.is_none()),
            "mipi-stereo" => {
                assert!(!driver.v4l2.right.is_empty() && matches!(imu, Some(ImuEndpoint::Serial(_))));
            }
            "zed-mini" => {
                assert!(driver.v4l2.right.is_empty() && matches!(imu, Some(ImuEndpoint::Serial(_))));
            }
            _ => {
                assert_eq!(driver.v4l2.format, V4l2Format::Y8i, "{name}");
                assert!(matches!(imu, Some(ImuEndpoint::Iio { accel: Some(_), .. })), "{name}");
            }
        }
    }
}
