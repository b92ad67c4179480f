//! Drawn recordings: one part of a calibration or of a clock is wrong, by a size that is drawn; the cause is to come first.

use super::{ALL, Data, FlightPath, is_fit, missing, rendered, told};
use crate::Fitness;
use nalgebra::{UnitQuaternion, Vector3};
use plumbline_config::options::rows_from_isometry;
use plumbline_config::{Config, GrayImage};
use plumbline_drivers::ImuSource as _;
use plumbline_simulator::{Scenario, Scene, Simulator};

/// Kinds of faults, recordings, and share of them whose cause is to come first.
const KINDS: u64 = 16;
const RECORDINGS: u64 = 120;
const FIRST: f64 = 0.9;

/// Numbers between 0 and 1 (splitmix64).
struct Draw(u64);

impl Draw {
    fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        (z ^ (z >> 31)) as f64 / u64::MAX as f64
    }

    /// A size of either sign, evenly by its logarithm.
    fn size(&mut self, least: f64, most: f64) -> f64 {
        let size = least * (most / least).powf(self.unit());
        if self.unit() < 0.5 { -size } else { size }
    }

    fn direction(&mut self) -> Vector3<f64> {
        Vector3::from_fn(|_, _| 2.0 * self.unit() - 1.0).normalize()
    }
}

/// A flight of half a minute by hand.
fn flight(seed: u64, scene: Scene, is_noisy: bool) -> Data {
    let mut preset = Config::preset("sim").unwrap().into_inner();
    if is_noisy {
        preset.imu.gyro_noise_density *= 5.0;
        preset.imu.accel_noise_density *= 5.0;
    }
    let path = FlightPath::HandHeld;
    let scenario =
        Scenario { scene, path, seed, duration_s: 30.0, resolution_scale: 0.5, ..Scenario::default() };
    let simulator = Simulator::new(&preset, &scenario).unwrap();
    let mut imu = simulator.imu();
    let samples = std::iter::from_fn(|| imu.next_reading().unwrap());
    let samples = samples.map(|reading| (reading.sequence, reading.sample)).collect();
    let frames = rendered(&simulator, &format!("{scenario:?}"), ALL);
    Data { config: simulator.config().clone(), samples, frames }
}

/// Puts a fault in; the names of causes that are right.
fn spoil(data: &mut Data, kind: u64, draw: &mut Draw) -> (&'static [&'static str], String) {
    let first = data.samples[0].1.stamp;
    let cameras = &mut data.config.camera;
    match kind {
        0 => (&[], "sound".into()),
        1 | 2 => {
            let factor = 1.0 + draw.size(0.01, 0.2);
            cameras.iter_mut().for_each(|camera| camera.focal_px = camera.focal_px.map(|f| f * factor));
            (&["focal length"], format!("focal {factor:.3}"))
        }
        3 => {
            let turn = UnitQuaternion::from_scaled_axis(draw.direction() * draw.size(0.1, 0.3));
            cameras
                .iter_mut()
                .for_each(|camera| camera.pose_b_c = rows_from_isometry(&(turn * camera.pose_b_c())));
            (&["camera-IMU rotation"], format!("rotation {:.3}", turn.angle()))
        }
        4 | 5 => {
            let late_s = draw.size(0.05, 0.15);
            data.frames.iter_mut().for_each(|(_, stamp, _)| *stamp = stamp.plus_seconds(late_s));
            (&["time offset"], format!("late {late_s:.3}"))
        }
        6 | 7 => {
            let rate = 1.0 + draw.size(0.0005, 0.03);
            for (_, sample) in &mut data.samples {
                sample.stamp = first.plus_seconds(rate * sample.stamp.seconds_since(first));
            }
            (&["clock rate", "IMU timing"], format!("clock {rate:.4}"))
        }
        8 => {
            let factor = 1.0 + draw.size(0.1, 0.4);
            data.samples.iter_mut().for_each(|(_, sample)| sample.gyro *= factor);
            (&["gyroscope scale", "gyroscope axes"], format!("gyroscope {factor:.3}"))
        }
        9 => {
            let (a, b) = ((3.0 * draw.unit()) as usize % 3, (3.0 * draw.unit()) as usize % 3);
            data.samples
                .iter_mut()
                .for_each(|(_, s)| if a == b { s.gyro[a] = -s.gyro[a] } else { s.gyro.swap_rows(a, b) });
            (&["gyroscope axes"], format!("gyroscope {a} {b}"))
        }
        10 => {
            let factor = 1.0 + draw.size(0.1, 0.3);
            data.samples.iter_mut().for_each(|(_, sample)| sample.accel *= factor);
            (&["accelerometer scale", "accelerometer axes", "baseline"], format!("accelerometer {factor:.3}"))
        }
        11 => {
            let seconds = draw.size(1.0, 12.0).abs();
            let (step, swings) = (draw.size(0.01, 0.05), draw.unit() < 0.5);
            for (_, stamp, images) in &mut data.frames {
                let turns = stamp.seconds_since(first) / seconds;
                let share =
                    if swings { (std::f64::consts::TAU * turns).sin() } else { f64::from(turns > 1.0) };
                for (image, camera) in images.iter_mut().zip(cameras.iter()) {
                    *image = zoomed(image, camera.centre_px, 1.0 + step * share);
                }
            }
            let names = &["focal length", "left focal length", "right focal length"];
            (names, format!("focus {step:.3} {} {seconds:.1} s", if swings { "in" } else { "at" }))
        }
        12 => {
            for (_, _, images) in data.frames.iter_mut().skip(1).step_by(2) {
                images.iter_mut().for_each(|image| image.pixels_mut().fill(2));
            }
            (&["black images"], "black in turn".into())
        }
        _ if cameras.len() == 1 => (&[], "sound".into()),
        13 => {
            let way = (3.0 * draw.unit()) as usize;
            for image in data.frames.iter_mut().flat_map(|(_, _, images)| images) {
                let width = image.width();
                match way {
                    0 => image.pixels_mut().chunks_mut(width).for_each(<[u8]>::reverse),
                    1 => image.pixels_mut().reverse(),
                    _ => {
                        image.pixels_mut().reverse();
                        image.pixels_mut().chunks_mut(width).for_each(<[u8]>::reverse);
                    }
                }
            }
            (&["way the images lie"], format!("way {way}"))
        }
        14 => {
            let [left, right] = [0, 1].map(|k| cameras[k].pose_b_c());
            let mut apart = left.inverse() * right;
            let factor = 1.0 + draw.size(0.1, 0.6);
            apart.translation.vector *= factor;
            cameras[1].pose_b_c = rows_from_isometry(&(left * apart));
            (&["baseline", "camera-camera position"], format!("baseline {factor:.3}"))
        }
        _ => {
            let turn = UnitQuaternion::from_scaled_axis(draw.direction() * draw.size(0.01, 0.05));
            cameras[1].pose_b_c = rows_from_isometry(&(cameras[1].pose_b_c() * turn));
            (&["camera-camera rotation"], format!("pair {:.3}", turn.angle()))
        }
    }
}

/// The image with another focal length.
fn zoomed(image: &GrayImage, centre_px: [f64; 2], factor: f64) -> GrayImage {
    let (width, height) = (image.width(), image.height());
    let (view, mut zoomed) = (image.view(), GrayImage::new(width, height));
    for (k, grey) in zoomed.pixels_mut().iter_mut().enumerate() {
        let from = |at: usize, axis: usize, size: usize| {
            let at = centre_px[axis] + (at as f64 - centre_px[axis]) / factor;
            at.clamp(0.0, size as f64 - 1.001)
        };
        let (x, y) = (from(k % width, 0, width), from(k / width, 1, height));
        let row = |y: usize| {
            let (row, share) = (view.row(y), x.fract());
            f64::from(row[x as usize]) * (1.0 - share) + f64::from(row[x as usize + 1]) * share
        };
        let share = y.fract();
        *grey = (row(y as usize) * (1.0 - share) + row(y as usize + 1) * share).round() as u8;
    }
    zoomed
}

#[test]
#[ignore = "an hour of processor; cargo test --release -p plumbline-checkup drawn -- --ignored --nocapture"]
fn the_cause_comes_first_in_nine_of_ten_drawn_recordings() {
    let (mut right, mut faults, mut fit, mut sound) = (0.0, 0.0, 0.0, 0.0);
    let number = |name: &str| std::env::var(name).ok().and_then(|n| n.parse().ok());
    let (begin, count) = (number("FROM").unwrap_or(0), number("RECORDINGS").unwrap_or(RECORDINGS));
    for k in begin..begin + count {
        let mut draw = Draw(k);
        let scene = [Scene::Room, Scene::Hall, Scene::LowTexture][k as usize % 3];
        let mut data = flight(k / KINDS, scene, (k + k / KINDS) % 2 == 1);
        if k % 5 == 4 {
            data.config.camera.truncate(1);
        }
        let (names, words) = spoil(&mut data, number("KIND").unwrap_or(k % KINDS), &mut draw);
        let report = data.report();
        let first = &report[0];
        let is_named = first.verdict == Fitness::NotFit && names.contains(&first.name);
        let is_fit = is_fit(&report) && missing(&report).is_empty();
        let is_right = if names.is_empty() { is_fit } else { is_named };
        println!(
            "{k:3} {} {words}: {} ({} {})",
            if is_right { "right" } else { "WRONG" },
            first.name,
            first.verdict,
            first.value
        );
        if !is_right && count < RECORDINGS {
            println!("{}", told(&report));
        }
        let (of, all) = if names.is_empty() { (&mut fit, &mut sound) } else { (&mut right, &mut faults) };
        *of += f64::from(is_right);
        *all += 1.0;
    }
    println!("cause first in {right} of {faults}, fit {fit} of {sound}");
    assert!(right >= FIRST * faults && fit >= 0.95 * sound);
}
