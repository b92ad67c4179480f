use super::euroc;
use crate::camera::Distortion;
use crate::options::{FlowMessages, ImuProtocol, PairBy, V4l2Format, VehicleConfig};
use crate::shape::sample_for_tests;
use crate::{Config, Violation};
use nalgebra::{UnitQuaternion, Vector3};
use serde::Deserialize;
use toml::Value;

pub(super) fn refused(change: impl Fn(&mut Config)) -> Vec<Violation> {
    let mut config = euroc().into_inner();
    change(&mut config);
    config.violations()
}

/// A change is refused by this key, with a reason or cure that says this.
pub(super) fn check(key: &str, says: &str, change: impl Fn(&mut Config)) {
    let found = refused(change);
    let hit = found.iter().any(|v| v.key == key && format!("{} {}", v.reason, v.cure).contains(says));
    assert!(hit, "{key}: {says}: {found:#?}");
}

#[test]
fn good_rigs_pass() {
    assert_eq!(refused(|_| {}), []);
    assert_eq!(refused(|c| c.camera.truncate(1)), []);
    let flat = Distortion::RadialTangential { k1: 0.0, k2: 0.0, p1: 0.0, p2: 0.0 };
    assert_eq!(refused(|c| c.camera[0].distortion = flat), []);
}

#[test]
fn the_number_of_cameras_is_one_or_two() {
    check("camera", "0 cameras", |c| c.camera.clear());
    check("camera", "3 cameras", |c| c.camera.push(c.camera[0].clone()));
}

#[test]
fn impossible_extrinsics_are_refused() {
    let key = "camera[1].pose_b_c";
    check(key, "NaN", |c| c.camera[1].pose_b_c[0][0] = f64::NAN);
    check(key, "not a rotation", |c| c.camera[1].pose_b_c[0][0] += 0.1);
    check(key, "not a rotation", |c| c.camera[1].pose_b_c[0] = [1e200, 1e200, 1e200, 0.0]);
    check(key, "reflection", |c| c.camera[1].pose_b_c[0][..3].iter_mut().for_each(|x| *x = -*x));
    check(key, "transpose", |c| {
        let rows = c.camera[1].pose_b_c;
        c.camera[1].pose_b_c = std::array::from_fn(|i| std::array::from_fn(|j| rows[j][i]));
    });
    check(key, "is this in mm?", |c| c.camera[1].pose_b_c[1][3] *= 1000.0);
    check(key, "baseline", |c| c.camera[1].pose_b_c = c.camera[0].pose_b_c);
    check(key, "must overlap", |c| {
        // Turned by half about the vertical of the camera: looks backwards.
        for row in &mut c.camera[1].pose_b_c[..3] {
            (row[0], row[2]) = (-row[0], -row[2]);
        }
    });
}

#[test]
fn impossible_lenses_are_refused() {
    check("camera[0].centre_px[0]", "outside the image", |c| c.camera[0].centre_px[0] = 752.0);
    check("camera[0].centre_px[1]", "outside the image", |c| c.camera[0].centre_px[1] = f64::NAN);
    check("camera[0].focal_px[1]", "in mm", |c| c.camera[0].focal_px[1] = 0.0);
    check("camera[0].focal_px[1]", "in mm", |c| c.camera[0].focal_px[1] = 6.0);
    let folding = Distortion::RadialTangential { k1: -0.9, k2: 0.0, p1: 0.0, p2: 0.0 };
    check("camera[0].distortion", "folds back", |c| c.camera[0].distortion = folding);
    let broken = Distortion::Equidistant { k1: 0.0, k2: 0.0, k3: f64::NAN, k4: 0.0 };
    check("camera[1].distortion.k3", "NaN", |c| c.camera[1].distortion = broken);
}

#[test]
fn unit_mistakes_get_a_hint() {
    check("imu.gyro_noise_density", "in radians", |c| c.imu.gyro_noise_density = 0.1);
    check("imu.gyro_noise_density", "in radians", |c| c.imu.gyro_noise_density = -1e-4);
    check("rig.time_offset_s", "in ms?", |c| c.rig.time_offset_s = 3.5);
    check("imu.rate_hz", "period", |c| c.imu.rate_hz = 0.005);
    check("imu.gyro_range_rad_s", "1000 deg/s", |c| c.imu.gyro_range_rad_s = 1000.0);
    check("estimator.health.max_blind_s", "in ms?", |c| c.estimator.health.max_blind_s = 5000.0);
}

#[test]
fn values_are_checked_against_each_other() {
    check("estimator.window.min_depth_m", "max_depth_m", |c| c.estimator.window.min_depth_m = 60.0);
    check("imu.gyro_bias_sigma_rad_s", "max_gyro_bias", |c| c.imu.gyro_bias_sigma_rad_s = 0.6);
    check("estimator.points.max_points", "max_landmarks", |c| c.estimator.points.max_points = 601);
    check("recorder.max_file_mb", "max_total_mb", |c| c.recorder.max_file_mb = 20_000);
    check("estimator.window.keyframes", "more than 15", |c| c.estimator.window.keyframes = 13);
    check("imu.rate_hz", "twice", |c| c.imu.rate_hz = 0.0);
    check("camera[1].rate_hz", "differs", |c| c.camera[1].rate_hz = 10.0);
    check("driver.pair_tolerance_s", "half a frame", |c| c.driver.pair_tolerance_s = 0.05);
    check("estimator.points.pyramid_levels", "fewer levels", |c| c.estimator.points.pyramid_levels = 7);
    check("estimator.points.border_px", "too little", |c| c.estimator.points.border_px = 121);
}

#[test]
fn autopilots_have_an_address_and_a_line_that_is_fast_enough() {
    let bads = "127.0.0.1:14540|tcp://h:1|udp://h|udp://:1|udp://h:0|udp://h:70000|udp://h h:1|serial://ttyS0:921600|\
                serial:///dev/ttyS0|serial:///dev/ttyS0:1|udpin://0.0.0.0:14550?from=autopilot";
    for bad in bads.split('|') {
        check("autopilot.connect", "serial:///dev/ttyS0:921600", |c| c.autopilot.connect = bad.into());
    }
    let goods = "|udp://127.0.0.1:14540|udpout://[::1]:14540|udpin://0.0.0.0:14550|udpin://0.0.0.0:14550?from=192.168.1.10|\
                 udpin://[::]:14550?from=fd00::1|serial:///dev/ttyS0:115200|serial:///dev/serial/by-path/a:1:921600";
    for good in goods.split('|') {
        assert_eq!(refused(|c| c.autopilot.connect = good.into()), []);
    }
    check("autopilot.connect", "57600 baud are too slow", |c| {
        c.autopilot.connect = "serial:///dev/ttyS0:57600".into();
    });
    check("autopilot.rate_hz", "30 to 50", |c| c.autopilot.rate_hz = 10.0);
    check("autopilot.connect", "115200 baud are too slow", |c| {
        c.autopilot.connect = "serial:///dev/ttyS0:115200".into();
        c.autopilot.flow = FlowMessages::Always;
    });
    check("autopilot.flow", "camera[0] looks 71 degrees", |c| {
        c.autopilot.connect = "udp://127.0.0.1:14540".into();
        c.autopilot.flow = FlowMessages::WhenLost;
    });
    let looking_down = refused(|c| {
        c.autopilot.connect = "udp://127.0.0.1:14540".into();
        c.autopilot.flow = FlowMessages::WhenLost;
        let forward = c.vehicle.rot_v_b().unwrap();
        let pitched = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), 70_f64.to_radians()) * forward;
        let (roll, pitch, yaw) = pitched.euler_angles();
        c.vehicle = VehicleConfig::mounted([roll, pitch, yaw].map(f64::to_degrees));
    });
    assert_eq!(looking_down, []);
    check("vehicle.imu_to_vehicle_deg[1]", "degrees", |c| {
        c.vehicle = VehicleConfig::mounted([0.0, 270.0, 0.0]);
    });
}

/// Two devices, as they are listed.
fn two_devices(config: &mut Config) {
    config.driver.v4l2.left = "/dev/v4l/by-path/platform-a-video-index0".into();
    config.driver.v4l2.right = "/dev/v4l/by-path/platform-b-video-index0".into();
}

#[test]
fn cameras_of_the_kernel_are_two_devices_or_one_for_both() {
    assert_eq!(refused(two_devices), []);
    assert_eq!(refused(|c| c.driver.v4l2.left = "/dev/video0".into()), []);
    check("driver.v4l2.left", "plumbline devices", |c| c.driver.v4l2.left = "video0".into());
    check("driver.v4l2.right", "no left device", |c| c.driver.v4l2.right = "/dev/video0".into());
    let with_two = |key: &str, says: &str, change: fn(&mut Config)| {
        check(key, says, |c| {
            two_devices(c);
            change(c);
        });
    };
    with_two("driver.v4l2.right", "same device", |c| c.driver.v4l2.right = c.driver.v4l2.left.clone());
    with_two("driver.v4l2.right", "one `[[camera]]` only", |c| c.camera.truncate(1));
    with_two("driver.v4l2.right", "Y8I", |c| c.driver.v4l2.format = V4l2Format::Y8i);
    let with_one = |key: &str, says: &str, change: fn(&mut Config)| {
        check(key, says, |c| {
            c.driver.v4l2.left = "/dev/video0".into();
            change(c);
        });
    };
    with_one("camera[1].width_px", "one size", |c| c.camera[1].width_px = 740);
    with_one("driver.v4l2.pair_by", "nothing to pair", |c| c.driver.v4l2.pair_by = PairBy::Sequence);
    with_one("driver.v4l2.format", "two cameras", |c| {
        c.camera.truncate(1);
        c.driver.v4l2.format = V4l2Format::Y8i;
    });
}

#[test]
fn controls_of_cameras_have_a_name_and_a_number() {
    for bad in ["", "gain", "=1", "gain=", "gain=high", "gain=9999999999", &"x=1".repeat(30)] {
        check("driver.v4l2.controls[0]", "NAME=VALUE", |c| c.driver.v4l2.controls = vec![bad.into()]);
    }
    for good in ["trigger_mode=1", "Power Line Frequency = 2", "auto_exposure=-1"] {
        assert_eq!(refused(|c| c.driver.v4l2.controls = vec![good.into()]), []);
    }
    check("driver.v4l2.exposure_us", "do not fit", |c| {
        two_devices(c);
        c.driver.v4l2.exposure_us = 50_000.0;
    });
}

#[test]
fn frames_come_over_one_way() {
    assert_eq!(refused(|c| c.driver.frames.listen = "/run/plumbline/frames".into()), []);
    check("driver.frames.listen", "absolute path", |c| c.driver.frames.listen = "frames".into());
    check("driver.frames.listen", "107 bytes", |c| c.driver.frames.listen = format!("/{:0>107}", ""));
    check("driver.frames.listen", "driver.v4l2", |c| {
        c.driver.frames.listen = "/run/plumbline/frames".into();
        c.driver.v4l2.left = "/dev/video0".into();
    });
}

#[test]
fn inertial_sensors_have_an_address_and_a_line_that_is_fast_enough() {
    let bads = "/dev/ttyS0|udp://h:1|serial://ttyS0:921600|serial:///dev/ttyS0|iio://|iio://a,|iio://a,b,c";
    for bad in bads.split('|') {
        check("driver.imu.connect", "serial:///dev/ttyACM0:921600", |c| c.driver.imu.connect = bad.into());
    }
    let goods = "|serial:///dev/ttyS0:921600|serial:///dev/serial/by-path/a:1:115200|iio://bmi088|iio://a,b";
    for good in goods.split('|') {
        assert_eq!(refused(|c| c.driver.imu.connect = good.into()), []);
    }
    check("driver.imu.connect", "imu.rate_hz = 200: 94000 are needed", |c| {
        c.driver.imu.connect = "serial:///dev/ttyS0:57600".into();
    });
    check("driver.imu.delay_s", "in ms?", |c| c.driver.imu.delay_s = 2.5);
}

#[test]
fn cameras_are_triggered_by_a_microcontroller_alone_and_by_pulses_shorter_than_a_frame() {
    let triggered = |connect: &str, protocol| {
        refused(|c| {
            c.driver.imu.trigger_cameras = true;
            (c.driver.imu.connect, c.driver.imu.protocol) = (connect.into(), protocol);
        })
    };
    let line = "serial:///dev/ttyS0:921600";
    assert_eq!(triggered(line, ImuProtocol::Plumbline), []);
    for (connect, protocol) in [(line, ImuProtocol::Xsens), ("iio://bmi088", ImuProtocol::Plumbline)] {
        assert_eq!(triggered(connect, protocol)[0].key, "driver.imu.trigger_cameras");
    }
    check("driver.imu.trigger_pulse_s", "1 / camera[0].rate_hz", |c| {
        c.driver.imu.trigger_cameras = true;
        c.driver.imu.trigger_pulse_s = 0.06;
    });
}

/// Replaces the numbers of a tree one at a time and calls `with_key` on each changed tree.
fn each_number(root: &Value, poison: fn(&Value) -> Option<Value>, with_key: &mut dyn FnMut(&str, Value)) {
    fn walk(
        value: &Value,
        key: &str,
        visit: &mut dyn FnMut(&str, &Value, &[String]),
        path: &mut Vec<String>,
    ) {
        let children: Vec<(String, String, &Value)> = match value {
            Value::Table(t) => t.iter().map(|(k, v)| (k.clone(), format!("{key}.{k}"), v)).collect(),
            Value::Array(a) => {
                a.iter().enumerate().map(|(i, v)| (i.to_string(), format!("{key}[{i}]"), v)).collect()
            }
            _ => return visit(key.trim_start_matches('.'), value, path),
        };
        for (step, child_key, child) in children {
            path.push(step);
            walk(child, &child_key, visit, path);
            path.pop();
        }
    }
    let mut visit = |key: &str, value: &Value, path: &[String]| {
        let Some(bad) = poison(value) else { return };
        let mut changed = root.clone();
        let place = path.iter().fold(&mut changed, |v, step| match v {
            Value::Table(t) => &mut t[step.as_str()],
            Value::Array(a) => &mut a[step.parse::<usize>().expect("an index")],
            _ => unreachable!("leaves have no children"),
        });
        *place = bad;
        with_key(key, changed);
    };
    walk(root, "", &mut visit, &mut Vec::new());
}

/// No option can be added without a range: whatever is a number is refused when it is NaN, infinite, huge
/// or hugely negative, by its own key.
#[test]
fn every_number_has_a_range() {
    let mut sample = sample_for_tests();
    sample.remove("network");
    let sample = Value::Table(sample);
    let poisons: [fn(&Value) -> Option<Value>; 5] = [
        |v| v.is_float().then_some(Value::Float(f64::NAN)),
        |v| v.is_float().then_some(Value::Float(f64::INFINITY)),
        |v| v.is_float().then_some(Value::Float(1e30)),
        |v| v.is_float().then_some(Value::Float(-1e30)),
        |v| v.is_integer().then_some(Value::Integer(i64::from(u32::MAX))),
    ];
    let mut tried = 0;
    for poison in poisons {
        each_number(&sample, poison, &mut |key, changed| {
            tried += 1;
            let config = Config::deserialize(changed).expect("the shape is right");
            // A matrix is refused as a whole.
            let expected = key.split("pose_b_c").next().filter(|_| key.contains("pose_b_c"));
            let hit =
                config.violations().iter().any(|v| expected.map_or(v.key == key, |p| v.key.starts_with(p)));
            assert!(hit, "{key} has no range: {:?}", config.violations());
        });
    }
    assert!(tried > 300, "{tried}");
}

/// -1 stands in the comment of the key, and in the message where the host refuses another value.
#[test]
fn the_idle_latency_may_be_negative_and_no_count_may() {
    let preset = crate::preset_text("sim").unwrap();
    let with = |before: &str, after: &str| {
        assert!(preset.contains(before));
        Config::from_toml_str(&preset.replacen(before, after, 1), "sim.toml")
    };
    let config = with("\nidle_latency_us = 50", "\nidle_latency_us = -1").unwrap();
    assert_eq!(config.runtime.idle_latency_us, -1);
    let refused = with("\nmax_keyframes = 1000", "\nmax_keyframes = -1").unwrap_err().to_string();
    assert!(refused.contains("max_keyframes") && refused.contains("a whole number from 0"), "{refused}");
}
