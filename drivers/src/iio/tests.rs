//! Devices of a made-up sysfs, their buffers pipes.

use super::devices::{IioRoots, devices_below};
use super::imu::IioImu;
use crate::clock::monotonic_ns;
use crate::{DriverError, ImuReading, ImuSource, StopFlag};
use nalgebra::Vector3;
use plumbline_config::options::{ImuConfig, ImuDriverConfig};
use rustix::fd::OwnedFd;
use rustix::fs::{CWD, FileType, Mode, OFlags};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

const MS: i64 = 1_000_000;

/// A folder for devices.
struct Kernel {
    _folder: tempfile::TempDir,
    roots: IioRoots,
}

impl Kernel {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path().canonicalize().unwrap();
        let roots = IioRoots { sys: root.join("sys"), dev: root.join("dev") };
        std::fs::create_dir_all(&roots.sys).unwrap();
        std::fs::create_dir_all(&roots.dev).unwrap();
        Self { _folder: folder, roots }
    }

    /// A device with these attributes, channels (`in_accel_x 0 le:s16/16>>0`) and a buffer.
    fn device(&self, number: u32, name: &str, attributes: &[(&str, &str)], channels: &[&str]) -> Chip {
        let chip = Chip {
            folder: self.roots.sys.join(format!("iio:device{number}")),
            buffer: self.roots.dev.join(format!("iio:device{number}")),
        };
        chip.write("name", name);
        let standing = [
            ("buffer/enable", "0"),
            ("buffer/length", "2"),
            ("buffer/watermark", "1"),
            ("current_timestamp_clock", "realtime\n"),
        ];
        standing.iter().chain(attributes).for_each(|(file, text)| chip.write(file, text));
        for channel in channels {
            let [name, index, kind] = channel.split(' ').collect::<Vec<_>>()[..] else { panic!("{channel}") };
            chip.write(&format!("scan_elements/{name}_en"), "0");
            chip.write(&format!("scan_elements/{name}_index"), index);
            chip.write(&format!("scan_elements/{name}_type"), kind);
        }
        rustix::fs::mknodat(CWD, &chip.buffer, FileType::Fifo, Mode::from_raw_mode(0o600), 0).unwrap();
        chip
    }

    fn open(&self, connect: &str) -> Result<IioImu, DriverError> {
        self.open_until(connect, 0.0, &StopFlag::new())
    }

    fn open_until(&self, connect: &str, delay_s: f64, stop: &StopFlag) -> Result<IioImu, DriverError> {
        let driver = ImuDriverConfig { connect: connect.into(), delay_s, ..ImuDriverConfig::default() };
        let imu = ImuConfig::with_noise(200.0, (1e-3, 1e-5), (1e-2, 1e-3));
        IioImu::open_below(&self.roots, &driver, &imu, stop.clone())
    }
}

/// A device's place.
struct Chip {
    folder: PathBuf,
    buffer: PathBuf,
}

impl Chip {
    fn write(&self, file: &str, text: &str) {
        let path = self.folder.join(file);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, text).unwrap();
    }

    fn read(&self, file: &str) -> String {
        std::fs::read_to_string(self.folder.join(file)).unwrap().trim().to_owned()
    }

    /// The end of the buffer that the kernel writes to; while it is open the device is there.
    fn kernel_end(&self) -> OwnedFd {
        rustix::fs::open(&self.buffer, OFlags::RDWR | OFlags::NONBLOCK, Mode::empty()).unwrap()
    }

    fn unplug(&self) {
        std::fs::remove_dir_all(&self.folder).unwrap();
        std::fs::remove_file(&self.buffer).unwrap();
    }
}

/// A sensor of both, as `bmi270` is: little-endian, with a magnetometer and a temperature that nobody wants.
fn both(kernel: &Kernel) -> Chip {
    kernel.device(
        0,
        "bmi270",
        &[
            ("in_accel_scale", "0.01"),
            ("in_accel_offset", "5"),
            ("in_anglvel_scale", "0.001"),
            ("in_mount_matrix", "0, 1, 0; -1, 0, 0; 0, 0, 1"),
            ("in_temp_scale", "100"),
            ("in_temp_offset", "50"),
            ("sampling_frequency", "25"),
            ("sampling_frequency_available", "25 50 100 200.000000 400"),
        ],
        &[
            "in_accel_x 0 le:s16/16>>0",
            "in_accel_y 1 le:s16/16>>0",
            "in_accel_z 2 le:s16/16>>0",
            "in_anglvel_x 3 le:s16/16>>0",
            "in_anglvel_y 4 le:s16/16>>0",
            "in_anglvel_z 5 le:s16/16>>0",
            "in_temp 6 le:s16/16>>0",
            "in_magn_x 7 le:s16/16>>0",
            "in_timestamp 8 le:s64/64>>0",
        ],
    )
}

/// A scan of [`both`]: six values, padding up to the stamp.
fn scan_of_both(values: [i16; 6], stamp_ns: i64) -> Vec<u8> {
    let values = values.iter().flat_map(|value| value.to_le_bytes());
    values.chain([0xEE; 4]).chain(stamp_ns.to_le_bytes()).collect()
}

fn send(kernel: &OwnedFd, bytes: &[u8]) {
    assert_eq!(rustix::io::write(kernel, bytes).unwrap(), bytes.len());
}

fn readings(imu: &mut IioImu, count: usize) -> Vec<ImuReading> {
    (0..count).map(|_| imu.next_reading().unwrap().expect("nobody said stop")).collect()
}

#[test]
fn scans_are_read_in_si_in_the_axes_of_the_device_with_the_stamps_of_the_kernel() {
    let kernel = Kernel::new();
    let chip = both(&kernel);
    let end = chip.kernel_end();
    let mut imu = kernel.open_until("iio://bmi270", 0.002, &StopFlag::new()).unwrap();
    let start_ns = monotonic_ns() - 500 * MS;
    for k in 0..100 {
        send(&end, &scan_of_both([95, 195, 976, 10, 20, 30], start_ns + k * 5 * MS));
    }
    let read = readings(&mut imu, 100);
    for (k, reading) in read.iter().enumerate() {
        assert_eq!(reading.sequence, k as u64);
        assert_eq!(reading.sample.stamp.as_nanos(), start_ns + k as i64 * 5 * MS - 2 * MS);
        // Turned by a right angle: y becomes x, x becomes -y.
        assert!((reading.sample.accel - Vector3::new(2.0, -1.0, 9.81)).norm() < 1e-9, "{reading:?}");
        assert!((reading.sample.gyro - Vector3::new(0.02, -0.01, 0.03)).norm() < 1e-9, "{reading:?}");
    }
    let figures = imu.figures();
    assert_eq!((figures.samples, figures.faults()), (100, crate::Faults::default()));
    // The same numbers again and again are flagged.
    assert_eq!(figures.watch.stuck, 90);
    assert!(figures.link.is_open);
}

#[test]
fn a_device_is_told_what_to_do_and_stopped_at_the_end() {
    let kernel = Kernel::new();
    let chip = both(&kernel);
    chip.write("trigger/current_trigger", "\n");
    for (number, name) in [(0, "other-dev0"), (1, "bmi270-dev0")] {
        let folder = kernel.roots.sys.join(format!("trigger{number}"));
        std::fs::create_dir_all(&folder).unwrap();
        std::fs::write(folder.join("name"), name).unwrap();
    }
    let _end = chip.kernel_end();
    let imu = kernel.open("iio://bmi270").unwrap();
    for (file, text) in [
        ("buffer/enable", "1"),
        ("buffer/watermark", "1"),
        ("buffer/length", "256"),
        ("current_timestamp_clock", "monotonic"),
        ("sampling_frequency", "200"),
        ("trigger/current_trigger", "bmi270-dev0"),
        ("scan_elements/in_accel_z_en", "1"),
        ("scan_elements/in_timestamp_en", "1"),
        ("scan_elements/in_magn_x_en", "0"),
    ] {
        assert_eq!(chip.read(file), text, "{file}");
    }
    drop(imu);
    assert_eq!(chip.read("buffer/enable"), "0");
}

/// An accelerometer and a gyroscope as two devices, big-endian and in more bits than they need.
fn two(kernel: &Kernel) -> (Chip, Chip) {
    let channels = |channel: &str, kind: &str| {
        let axis = |(k, axis)| format!("{channel}_{axis} {k} {kind}");
        let mut all: Vec<String> = ["x", "y", "z"].iter().enumerate().map(axis).collect();
        all.push("in_timestamp 3 le:s64/64>>0".into());
        all
    };
    let of = |number, name, channel: &str, scale, kind| {
        let channels = channels(channel, kind);
        let channels: Vec<&str> = channels.iter().map(String::as_str).collect();
        let attributes = [(format!("{channel}_scale"), scale), ("label".into(), name)];
        let attributes: Vec<(&str, &str)> = attributes.iter().map(|(a, b)| (a.as_str(), *b)).collect();
        kernel.device(number, "imu-3d", &attributes, &channels)
    };
    (
        of(0, "accelerometer", "in_accel", "0.01", "be:s12/16>>4"),
        of(1, "gyroscope", "in_anglvel", "0.0001", "le:s24/32>>8"),
    )
}

fn scan_be12(values: [i16; 3], stamp_ns: i64) -> Vec<u8> {
    let values = values.iter().flat_map(|value| (value << 4).to_be_bytes());
    values.chain([0; 2]).chain(stamp_ns.to_le_bytes()).collect()
}

fn scan_le24(values: [i32; 3], stamp_ns: i64) -> Vec<u8> {
    let values = values.iter().flat_map(|value| (value << 8).to_le_bytes());
    values.chain([0; 4]).chain(stamp_ns.to_le_bytes()).collect()
}

#[test]
fn the_accelerometer_of_another_device_is_interpolated_to_the_gyroscope() {
    let kernel = Kernel::new();
    let (accel, gyro) = two(&kernel);
    let ends = (accel.kernel_end(), gyro.kernel_end());
    let mut imu = kernel.open("iio://gyroscope,accelerometer").unwrap();
    let start_ns = monotonic_ns() - 500 * MS;
    // 250 Hz and 200 Hz; the accelerometer's x rises by 0.01 m/s² each ms.
    (0..100).for_each(|k| send(&ends.0, &scan_be12([4 * k, -200, 981], start_ns + i64::from(k) * 4 * MS)));
    (0..79).for_each(|k| send(&ends.1, &scan_le24([-7, k, 70_000], start_ns + i64::from(k) * 5 * MS)));
    for (k, reading) in readings(&mut imu, 79).iter().enumerate() {
        let ms = k as f64 * 5.0;
        assert_eq!(reading.sample.stamp.as_nanos(), start_ns + k as i64 * 5 * MS);
        assert!((reading.sample.accel - Vector3::new(0.01 * ms, -2.0, 9.81)).norm() < 1e-9, "{reading:?}");
        assert!(
            (reading.sample.gyro - Vector3::new(-0.0007, 1e-4 * k as f64, 7.0)).norm() < 1e-9,
            "{reading:?}"
        );
    }
}

#[test]
fn a_device_may_be_missing_at_the_start_and_may_go_away_and_come_back() {
    let kernel = Kernel::new();
    let mut imu = kernel.open("iio://bmi270").unwrap();
    assert!(!imu.figures().link.is_open);
    for life in 1..=2 {
        let chip = both(&kernel);
        let (end, is_read) = (chip.kernel_end(), AtomicBool::new(false));
        std::thread::scope(|scope| {
            scope.spawn(|| {
                for k in (0..400).take_while(|_| !is_read.load(Ordering::Relaxed)) {
                    // The buffer of a device that nobody reads yet fills up.
                    let _ = rustix::io::write(&end, &scan_of_both([k, 0, 0, 0, 0, 0], monotonic_ns()));
                    std::thread::sleep(std::time::Duration::from_millis(5));
                }
            });
            assert_eq!(readings(&mut imu, 50).len(), 50);
            chip.unplug();
            is_read.store(true, Ordering::Relaxed);
        });
        drop(end);
        while imu.figures().link.is_open {
            imu.exchange();
        }
        assert_eq!((imu.figures().link.opened, imu.figures().link.lost), (life, life));
    }
}

#[test]
fn a_silent_or_missing_device_ends_soon_after_it_is_told_to() {
    let kernel = Kernel::new();
    let chip = both(&kernel);
    let _end = chip.kernel_end();
    for connect in ["iio://bmi270", "iio://nobody"] {
        let stop = StopFlag::new();
        let mut imu = kernel.open_until(connect, 0.0, &stop).unwrap();
        stop.stop();
        assert_eq!(imu.next_reading().unwrap(), None);
    }
}

/// Reason why a device is refused.
fn refused(connect: &str, change: impl Fn(&Chip)) -> String {
    let kernel = Kernel::new();
    let chip = both(&kernel);
    change(&chip);
    let _end = chip.kernel_end();
    kernel.open(connect).expect_err("is refused").to_string()
}

fn remove(path: &Path) {
    std::fs::remove_file(path).unwrap();
}

#[test]
fn what_cannot_be_used_is_refused_with_its_cure() {
    let as_it_is = |_: &Chip| {};
    let none = refused("iio://bmi270", |chip| {
        ["en", "index", "type"]
            .iter()
            .for_each(|end| remove(&chip.folder.join(format!("scan_elements/in_timestamp_{end}"))));
    });
    assert!(none.contains("no timestamps"), "{none}");
    let rate = refused("iio://bmi270", |chip| chip.write("sampling_frequency_available", "25 50"));
    assert!(rate.contains("set imu.rate_hz to what it offers (25, 50)"), "{rate}");
    let scale = refused("iio://bmi270", |chip| remove(&chip.folder.join("in_accel_scale")));
    assert!(scale.contains("in_accel_scale"), "{scale}");
    let mount = refused("iio://bmi270", |chip| chip.write("in_mount_matrix", "1, 0, 0; 0, 1, 0; 0, 0, -1"));
    assert!(mount.contains("not a rotation"), "{mount}");
    let kind = refused("iio://bmi270", |chip| chip.write("scan_elements/in_accel_y_type", "le:s16/16X4>>0"));
    assert!(kind.contains("in_accel_y_type"), "{kind}");
    let alone = refused("iio://bmi270", |chip| {
        std::fs::rename(chip.folder.join("scan_elements/in_anglvel_x_en"), chip.folder.join("x")).unwrap();
    });
    assert!(alone.contains("iio://GYROSCOPE,ACCELEROMETER"), "{alone}");
    assert!(refused("serial:///dev/ttyS0:9600", as_it_is).contains("iio://NAME"));
}

/// Another program streams from it, as iio-sensor-proxy does.
#[test]
fn a_device_that_cannot_be_opened_keeps_its_buffer_running() {
    let kernel = Kernel::new();
    let chip = both(&kernel);
    chip.write("buffer/enable", "1");
    std::fs::remove_file(&chip.buffer).unwrap();
    assert!(kernel.open("iio://bmi270").is_err());
    assert_eq!(
        (chip.read("buffer/enable"), chip.read("scan_elements/in_accel_x_en")),
        ("1".into(), "0".into())
    );
}

#[test]
fn names_that_several_have_are_refused_and_places_are_names_too() {
    let kernel = Kernel::new();
    let _chips = two(&kernel);
    let error = kernel.open("iio://imu-3d,accelerometer").err().map(|error| error.to_string());
    assert_eq!(error, None, "one of both has a gyroscope");
    let other = kernel.device(2, "imu-3d", &[], &["in_anglvel_x 0 le:s16/16>>0"]);
    let error = kernel.open("iio://imu-3d,accelerometer").unwrap_err().to_string();
    assert!(error.contains("are several; name one of") && error.contains("gyroscope"), "{error}");
    let devices = devices_below(&kernel.roots);
    let names: Vec<&str> = devices.iter().map(|device| device.name.as_str()).collect();
    let place = kernel.roots.sys.display().to_string();
    assert_eq!(names, ["accelerometer", "gyroscope", &place]);
    assert_eq!(devices[2].folder, other.folder);
    assert!(devices[0].has_accel && !devices[0].has_gyro && devices[1].has_gyro);
}

/// Samples come until enough were read: some are refused where this machine stands still in between.
#[test]
fn nothing_is_allocated_while_samples_come() {
    let kernel = Kernel::new();
    let (accel, gyro) = two(&kernel);
    let ends = (accel.kernel_end(), gyro.kernel_end());
    let mut imu = kernel.open("iio://gyroscope,accelerometer").unwrap();
    let is_enough = AtomicBool::new(false);
    std::thread::scope(|scope| {
        scope.spawn(|| {
            for _ in (0..2000).take_while(|_| !is_enough.load(Ordering::Relaxed)) {
                let stamp_ns = monotonic_ns();
                send(&ends.0, &scan_be12([0, 0, 981], stamp_ns));
                send(&ends.1, &scan_le24([0, 0, 0], stamp_ns));
                std::thread::sleep(std::time::Duration::from_millis(1));
            }
        });
        imu.next_reading().unwrap().unwrap();
        let allocated = allocation_counter::measure(|| {
            for _ in 0..200 {
                imu.next_reading().unwrap().unwrap();
            }
        });
        is_enough.store(true, Ordering::Relaxed);
        assert_eq!(allocated.count_total, 0);
    });
}

/// Real time: the stamps of a device that has a clock of its own are learnt.
mod realtime {
    use super::*;

    #[test]
    fn stamps_of_a_devices_own_clock_are_brought_to_the_hosts() {
        let kernel = Kernel::new();
        let chip = both(&kernel);
        let end = chip.kernel_end();
        let mut imu = kernel.open("iio://bmi270").unwrap();
        let start_ns = monotonic_ns() + 10 * MS;
        let feeder = std::thread::spawn(move || {
            for k in 0..500_i16 {
                let truth_ns = start_ns + i64::from(k) * 5 * MS;
                while monotonic_ns() < truth_ns {
                    let left_ns = (truth_ns - monotonic_ns()).max(0);
                    std::thread::sleep(std::time::Duration::from_nanos((left_ns / 2) as u64));
                }
                let device_ns = 7_000_000_000 + (truth_ns - start_ns);
                send(&end, &scan_of_both([k, 0, 0, 0, 0, 0], device_ns));
            }
            end
        });
        let mut errors_us = Vec::new();
        loop {
            let sample = imu.next_reading().unwrap().unwrap().sample;
            // The mount turns x to -y; the offset is five.
            let k = (-sample.accel.y / 0.01 - 5.0).round() as i64;
            errors_us.push((sample.stamp.as_nanos() - (start_ns + k * 5 * MS)).abs() / 1000);
            if k == 499 {
                break;
            }
        }
        drop(feeder.join().unwrap());
        errors_us.sort_unstable();
        println!("errors of {} stamps: {} us in the median", errors_us.len(), errors_us[errors_us.len() / 2]);
        assert!(errors_us.len() > 250 && errors_us[errors_us.len() / 2] < 200, "{errors_us:?}");
        assert!(imu.figures().clock.is_settled);
    }
}
