//! No sensor of a sound flight is called faulty: the default flights as a newcomer starts them, and motions that vehicles make.

use super::dataset::Folder;
use super::succeeds;

/// Bits that name a sensor or a calibration.
const NAMES: &str = "cameras disagree|IMU contradicted|IMU late|images late|rotation disputed|accelerometer contradicted|\
                     gyroscope contradicted|cameras out of step|scale contradicted";

/// Flies `arguments` in small images, whose points have more noise, and asserts that nothing is named and that an autopilot with a threshold of 20 uses every pose after the
/// first half second.
fn is_sound(arguments: &[&str]) {
    let folder = Folder::new();
    let (report, states) = (folder.at("report.json"), folder.at("states.csv"));
    let outputs = ["--scale", "0.35", "--no-loop", "--report", &report, "--states", &states];
    succeeds(&[&["replay"], arguments, &outputs].concat());
    let report = crate::json(report);
    let named: Vec<_> = NAMES.split('|').filter(|name| !report["health_frames"][*name].is_null()).collect();
    assert!(named.is_empty(), "{arguments:?}: {}", report["health_frames"]);
    let states = std::fs::read_to_string(states).unwrap();
    let mut rows = states.lines().map(|line| line.split(',').collect::<Vec<_>>());
    let quality = rows.next().unwrap().iter().position(|name| *name == "quality").unwrap();
    let low = rows.skip(10).filter(|row| row[quality].parse::<i32>().unwrap() < 20).count();
    assert_eq!(low, 0, "{arguments:?}");
    assert_eq!(report["resets"], 0);
}

#[test]
fn the_flight_of_the_demo_names_no_sensor() {
    is_sound(&["sim:room", "--duration", "45"]);
}

#[test]
fn the_default_flight_through_the_hall_names_no_sensor() {
    is_sound(&["sim:hall", "--seed", "2", "--duration", "40"]);
}

/// Product of two quaternions, x y z w.
fn times([ax, ay, az, aw]: [f64; 4], [bx, by, bz, bw]: [f64; 4]) -> [f64; 4] {
    [
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    ]
}

/// Attitude of the body of the simulator's rig, whose x axis is up and whose z axis looks along x: tilted about x by `tilt`, then turned about
/// the vertical by `yaw`.
fn attitude(yaw: f64, tilt: f64) -> [f64; 4] {
    let (half_yaw, half_tilt) = (0.5 * yaw, 0.5 * tilt);
    let level = [0.5_f64.sqrt(), 0.0, 0.5_f64.sqrt(), 0.0];
    let tilted = times([half_tilt.sin(), 0.0, 0.0, half_tilt.cos()], level);
    times([0.0, 0.0, half_yaw.sin(), half_yaw.cos()], tilted)
}

/// Flies along `pose(t)`, position in metres, yaw and tilt in radians, for `seconds`.
fn path_is_sound(seconds: u32, pose: impl Fn(f64) -> ([f64; 3], f64, f64)) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("path.tum");
    let rows = (0..=200 * seconds).map(|k| {
        let t = f64::from(k) / 200.0;
        let ([x, y, z], yaw, tilt) = pose(t);
        let [qx, qy, qz, qw] = attitude(yaw, tilt);
        format!("{:.6} {x:.9} {y:.9} {z:.9} {qx:.9} {qy:.9} {qz:.9} {qw:.9}\n", 10.0 + t)
    });
    std::fs::write(&path, rows.collect::<String>()).unwrap();
    is_sound(&["sim:room", "--path", path.to_str().unwrap()]);
}

#[test]
fn an_even_circle_names_no_sensor() {
    path_is_sound(25, |t| {
        let ramp = (t / 4.0).min(1.0);
        let angle = 0.6 * (t - if t < 4.0 { t - 0.5 * t * ramp } else { 2.0 });
        ([1.5 * angle.sin(), 1.5 - 1.5 * angle.cos(), 1.2], angle, 0.0)
    });
}

#[test]
fn a_fall_and_a_fast_turn_name_no_sensor() {
    // Smoothly from 0 to 1 between `from` and `to`.
    let step = |t: f64, from: f64, to: f64| {
        let s = ((t - from) / (to - from)).clamp(0.0, 1.0);
        s.powi(4) * (35.0 - 84.0 * s + 70.0 * s * s - 20.0 * s.powi(3))
    };
    path_is_sound(20, |t| {
        let sway = step(t, 0.0, 3.0);
        let place = [0.6 * sway * (1.3 * t).sin(), 0.6 * sway * (1.1 * t).sin()];
        // Falls by 1.4 m, and climbs back.
        let height = 2.0 - 1.4 * (step(t, 4.0, 5.1) - step(t, 8.0, 11.0));
        let turn = 2.5 * step(t, 12.0, 13.2);
        (
            [place[0], place[1], height],
            turn,
            0.05 * sway * (5.5 * t).sin() + 0.5 * (step(t, 4.2, 4.7) - step(t, 5.0, 5.8)),
        )
    });
}
