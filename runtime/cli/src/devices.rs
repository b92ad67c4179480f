//! `plumbline devices`: the sensors of this computer, by the names that a configuration takes.

use super::say;
use anyhow::Result;
use clap::Args;
use plumbline_drivers::iio::{IioDeviceInfo, iio_devices};
use plumbline_drivers::serial::{SerialPortInfo, serial_ports};
use plumbline_drivers::v4l2::{CameraInfo, cameras};
use serde::Serialize;
use std::fmt::Write as _;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// Arguments of `plumbline devices`.
#[derive(Debug, Args)]
pub struct DevicesArgs {
    /// Print JSON.
    #[arg(long)]
    pub json: bool,
}

/// Devices found.
#[derive(Serialize)]
struct Found {
    cameras: Vec<CameraInfo>,
    /// Nodes of cameras that this user may not open.
    #[serde(rename = "cameras_not_to_be_opened")]
    closed: Vec<PathBuf>,
    #[serde(rename = "serial_ports")]
    ports: Vec<SerialPortInfo>,
    #[serde(rename = "iio_devices")]
    iio: Vec<IioDeviceInfo>,
}

/// Runs the command. Nothing is changed on any device.
///
/// # Errors
/// Never: what is not there is told.
pub fn run(args: &DevicesArgs) -> Result<()> {
    let found = Found {
        cameras: cameras(),
        closed: closed_nodes(Path::new("/dev")),
        ports: serial_ports(),
        iio: iio_devices(),
    };
    match args.json {
        true => say(serde_json::to_string_pretty(&found)?),
        false => say(found.text().trim_end()),
    }
    Ok(())
}

/// Nodes of cameras that are there and may not be opened.
fn closed_nodes(dev: &Path) -> Vec<PathBuf> {
    let Ok(listed) = std::fs::read_dir(dev) else { return Vec::new() };
    let is_video = |path: &PathBuf| {
        let number = path.file_name().and_then(|name| name.to_str()?.strip_prefix("video"));
        number.is_some_and(|number| !number.is_empty() && number.bytes().all(|b| b.is_ascii_digit()))
    };
    let is_closed = |path: &PathBuf| {
        let opened = std::fs::OpenOptions::new().read(true).write(true).open(path);
        opened.is_err_and(|error| error.kind() == ErrorKind::PermissionDenied)
    };
    let mut nodes: Vec<PathBuf> = listed.flatten().map(|entry| entry.path()).collect();
    nodes.retain(|path| is_video(path) && is_closed(path));
    nodes.sort();
    nodes
}

impl Found {
    /// For people: what to write into a configuration stands first.
    fn text(&self) -> String {
        let mut text = String::from("Cameras (driver.v4l2.left, driver.v4l2.right)\n");
        for camera in &self.cameras {
            let path = camera.stable_paths.first().unwrap_or(&camera.path);
            let _ = writeln!(text, "\n  {:?}", path.display().to_string());
            for line in camera.to_string().lines() {
                let _ = writeln!(text, "    {line}");
            }
        }
        for node in &self.closed {
            let node = node.display();
            let _ = writeln!(text, "\n  {node} may not be opened: add this user to the group `video`");
        }
        if self.cameras.is_empty() && self.closed.is_empty() {
            text += "\n  none\n";
        }
        text += "\nSerial ports (driver.imu.connect, autopilot.connect; BAUD as the device has it)\n\n";
        self.ports.iter().for_each(|port| text += &port_line(port));
        if self.ports.is_empty() {
            text += "  none\n";
        }
        text += "\nInertial sensors of the kernel (driver.imu.connect)\n\n";
        self.iio.iter().for_each(|device| text += &iio_line(device));
        if self.iio.is_empty() {
            text += "  none\n";
        }
        text
    }
}

fn port_line(port: &SerialPortInfo) -> String {
    let mut line = format!("  \"serial://{}:BAUD\"\n    at {}", port.name.display(), port.device.display());
    for words in [&port.driver, &port.product].into_iter().flatten() {
        let _ = write!(line, ", {words}");
    }
    line.push('\n');
    if let Some(by_path) = port.by_path.as_ref().filter(|path| **path != port.name) {
        let _ = writeln!(line, "    {} is its socket", by_path.display());
    }
    line
}

fn iio_line(device: &IioDeviceInfo) -> String {
    let has = match (device.has_gyro, device.has_accel) {
        (true, true) => "gyroscope and accelerometer",
        (true, false) => "gyroscope; its accelerometer is another device: iio://GYROSCOPE,ACCELEROMETER",
        (false, _) => "accelerometer; its gyroscope is another device: iio://GYROSCOPE,ACCELEROMETER",
    };
    let rates: Vec<String> = device.rates_hz.iter().map(ToString::to_string).collect();
    let rates =
        if rates.is_empty() { "rates that it does not tell".into() } else { rates.join(", ") + " Hz" };
    let mut line = format!("  \"iio://{}\"\n    at {}, {has}\n    {rates}", device.name, device.device);
    if let Some(rate_hz) = device.rate_hz {
        let _ = write!(line, "; now {rate_hz} Hz");
    }
    line.push('\n');
    line
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found() -> Found {
        Found {
            cameras: Vec::new(),
            closed: Vec::new(),
            ports: vec![SerialPortInfo {
                name: "/dev/serial/by-id/usb-ACME".into(),
                device: "/dev/ttyACM0".into(),
                by_id: Some("/dev/serial/by-id/usb-ACME".into()),
                by_path: Some("/dev/serial/by-path/pci-0".into()),
                driver: Some("cdc_acm".into()),
                product: Some("ACME IMU".into()),
            }],
            iio: vec![IioDeviceInfo {
                name: "bmi270".into(),
                device: "iio:device0".into(),
                folder: "/sys/bus/iio/devices/iio:device0".into(),
                driver_name: "bmi270".into(),
                label: None,
                has_gyro: true,
                has_accel: true,
                rate_hz: Some(100.0),
                rates_hz: vec![100.0, 200.0],
            }],
        }
    }

    #[test]
    fn devices_are_told_by_what_a_configuration_takes() {
        let text = found().text();
        for part in [
            "driver.v4l2.right)\n\n  none",
            "\"serial:///dev/serial/by-id/usb-ACME:BAUD\"",
            "at /dev/ttyACM0, cdc_acm, ACME IMU",
            "\"iio://bmi270\"",
            "gyroscope and accelerometer\n    100, 200 Hz; now 100 Hz",
        ] {
            assert!(text.contains(part), "'{part}' is missing in {text}");
        }
        let json = serde_json::to_value(found()).unwrap();
        assert_eq!(json["serial_ports"][0]["name"], "/dev/serial/by-id/usb-ACME");
        assert_eq!(json["iio_devices"][0]["name"], "bmi270");
    }

    #[test]
    fn nodes_are_only_those_of_cameras() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("video0"), "").unwrap();
        std::fs::write(folder.path().join("videotape"), "").unwrap();
        assert_eq!(closed_nodes(folder.path()), Vec::<PathBuf>::new());
    }
}
