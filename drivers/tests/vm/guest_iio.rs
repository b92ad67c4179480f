//! Tests in the virtual machine: inertial sensors that a real kernel drives, behind a hub of HID sensors.

use crate::hid::Hub;
use plumbline_config::options::{ImuConfig, ImuDriverConfig};
use plumbline_drivers::clock::monotonic_ns;
use plumbline_drivers::iio::{IioImu, iio_devices};
use plumbline_drivers::{ImuReading, ImuSource as _, StopFlag};
use std::process::Command;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

/// Slow enough for an emulated processor on a busy host.
const RATE_HZ: f64 = 100.0;
const PLUGGED_IN: [Duration; 2] = [Duration::from_secs(8), Duration::from_secs(6)];
const UNPLUGGED: Duration = Duration::from_secs(2);
const MS: f64 = 1e-6;

fn load_modules() {
    for module in ["uhid", "hid-sensor-hub", "hid-sensor-accel-3d", "hid-sensor-gyro-3d"] {
        assert!(Command::new("modprobe").arg(module).status().unwrap().success(), "{module}");
    }
}

/// Values measured now: gravity, and a rate about y that shows the time within a second, rad/s and s alike.
fn values() -> [[f64; 3]; 2] {
    let now_ns = monotonic_ns();
    let wobble = 1e-3 * (now_ns / 10_000_000 % 7) as f64;
    [[0.1 + wobble, -0.2, 9.81], [0.05, (now_ns % 1_000_000_000) as f64 * 1e-9, -0.3]]
}

/// Plays the hub, with a time without it in between; `false` is told while it is away.
fn play(stop: &StopFlag) {
    for (k, plugged_in) in PLUGGED_IN.into_iter().enumerate() {
        if k > 0 {
            thread::sleep(UNPLUGGED);
        }
        let is_over = AtomicBool::new(false);
        thread::scope(|scope| {
            let hub = Hub::plug_in().unwrap();
            let player = scope.spawn(|| hub.play(&is_over, values).unwrap());
            thread::sleep(plugged_in);
            is_over.store(true, Ordering::Relaxed);
            player.join().unwrap();
        });
    }
    // Its going is seen first.
    thread::sleep(Duration::from_millis(500));
    stop.stop();
}

/// From the time in its values to its stamp, ms.
fn late_ms(reading: &ImuReading) -> f64 {
    let told_ns = (reading.sample.gyro.y * 1e9) as i64;
    let late_ns = (reading.sample.stamp.as_nanos() - told_ns).rem_euclid(1_000_000_000);
    // A little before is as good as a little after.
    (if late_ns > 500_000_000 { late_ns - 1_000_000_000 } else { late_ns }) as f64 * MS
}

#[test]
#[ignore = "runs in the virtual machine"]
fn two_inertial_devices_of_the_kernel_are_one_sensor_that_comes_and_goes() {
    load_modules();
    let stop = StopFlag::new();
    let (begin, mut readings, mut names, mut allocations) = (Instant::now(), Vec::new(), Vec::new(), 0);
    let figures = thread::scope(|scope| {
        scope.spawn(|| play(&stop));
        let driver =
            ImuDriverConfig { connect: "iio://gyro_3d,accel_3d".into(), ..ImuDriverConfig::default() };
        let config = ImuConfig::with_noise(RATE_HZ, (1e-3, 1e-5), (1e-2, 1e-3));
        let mut imu = IioImu::open(&driver, &config, stop.clone()).unwrap();
        readings.reserve(4000);
        loop {
            let mut reading = None;
            let counted = allocation_counter::measure(|| reading = imu.next_reading().unwrap());
            let Some(reading) = reading else { break };
            if names.is_empty() {
                names = iio_devices().into_iter().map(|device| (device.name, device.rate_hz)).collect();
            }
            let is_steady = readings
                .last()
                .is_some_and(|last: &ImuReading| reading.sample.stamp.seconds_since(last.sample.stamp) < 0.5);
            allocations += if is_steady { counted.count_total } else { 0 };
            readings.push(reading);
        }
        imu.figures()
    });
    let mut late: Vec<f64> = readings.iter().map(late_ms).collect();
    late.sort_by(f64::total_cmp);
    let seconds = begin.elapsed().as_secs_f64();
    let at = |share: f64| late[((late.len() - 1) as f64 * share) as usize];
    println!(
        "{{\"run\":\"inertial devices of the kernel\",\"seconds\":{seconds:.1},\"devices\":{names:?},\"samples\":{},\
         \"stamped_late_ms\":{{\"median\":{:.3},\"p99\":{:.3},\"max\":{:.3}}},\"missing\":{},\"unpaired\":{},\"opened\":{},\
         \"lost\":{},\"allocations\":{allocations}}}",
        readings.len(),
        at(0.5),
        at(0.99),
        at(1.0),
        figures.missing,
        figures.unpaired,
        figures.link.opened,
        figures.link.lost,
    );
    assert_eq!(names, [("accel_3d".to_owned(), Some(RATE_HZ)), ("gyro_3d".to_owned(), Some(RATE_HZ))]);
    // Two devices, twice.
    assert_eq!((figures.link.opened, figures.link.lost), (4, 4), "{figures:?}");
    let plugged_in_s: f64 = PLUGGED_IN.iter().map(Duration::as_secs_f64).sum();
    // Up to a second is taken by the kernel's and our own looking for it, each time; an emulated processor may be late.
    assert!(readings.len() as f64 > 0.5 * (plugged_in_s - 2.0) * RATE_HZ, "{}", readings.len());
    assert!(readings.windows(2).all(|w| w[0].sample.stamp < w[1].sample.stamp));
    // The kernel stamps when a report is there, which is a moment after we wrote it.
    assert!(at(0.0) > -1.0 && at(0.5) < 5.0, "{} to {} ms", at(0.0), at(0.5));
    for reading in &readings {
        let sample = &reading.sample;
        assert!((sample.accel.z - 9.81).abs() < 1e-3 && (sample.accel.y + 0.2).abs() < 1e-3, "{sample:?}");
        assert!((sample.gyro.x - 0.05).abs() < 1e-4 && (sample.gyro.z + 0.3).abs() < 1e-4, "{sample:?}");
    }
    assert_eq!(allocations, 0);
}
