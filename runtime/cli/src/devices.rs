//! `plumbline devices`: the sensors of this computer, by the names that a configuration takes.

use super::say;
use anyhow::Result;
use clap::Args;
use plumbline_drivers::iio::{IioDeviceInfo, iio_devices};
use plumbline_drivers::serial::{SerialPortInfo, serial_ports};
use plumbline_drivers::v4l2::{CameraInfo, ControlInfo, FormatInfo, cameras};
use serde_json::{Value, json};
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
struct Found {
    cameras: Vec<CameraInfo>,
    /// Nodes of cameras that this user may not open.
    closed: Vec<PathBuf>,
    ports: Vec<SerialPortInfo>,
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
        true => say(serde_json::to_string_pretty(&found.json())?),
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
            let _ = writeln!(text, "\n  {:?}", camera_name(camera).display().to_string());
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

    fn json(&self) -> Value {
        json!({
            "cameras": self.cameras.iter().map(camera_json).collect::<Vec<_>>(),
            "cameras_not_to_be_opened": self.closed,
            "serial_ports": self.ports.iter().map(port_json).collect::<Vec<_>>(),
            "iio_devices": self.iio.iter().map(iio_json).collect::<Vec<_>>(),
        })
    }
}

/// The name that stays, where there is one.
fn camera_name(camera: &CameraInfo) -> &Path {
    camera.stable_paths.first().unwrap_or(&camera.path)
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

fn camera_json(camera: &CameraInfo) -> Value {
    json!({
        "name": camera_name(camera),
        "path": camera.path,
        "stable_paths": camera.stable_paths,
        "card": camera.card,
        "driver": camera.driver,
        "bus": camera.bus,
        "formats": camera.formats.iter().map(format_json).collect::<Vec<_>>(),
        "controls": camera.controls.iter().map(control_json).collect::<Vec<_>>(),
    })
}

fn format_json(format: &FormatInfo) -> Value {
    let sizes = format.sizes.iter().map(|size| {
        json!({
            "size_px": size.size_px,
            "largest_px": size.largest_px,
            "rates_hz": size.rates.listed_hz(),
            "rate_range_hz": size.rates.range_hz(),
        })
    });
    json!({
        "code": format.code,
        "is_read": format.format.is_some(),
        "sizes": sizes.collect::<Vec<_>>(),
    })
}

fn control_json(control: &ControlInfo) -> Value {
    let (least, most, step) = control.range;
    json!({
        "name": control.name,
        "is_button": control.is_button,
        "value": control.value,
        "least": least,
        "most": most,
        "step": step,
        "default": control.default,
        "is_writable": control.is_writable,
        "is_inactive": control.is_inactive,
    })
}

fn port_json(port: &SerialPortInfo) -> Value {
    json!({
        "name": port.name,
        "device": port.device,
        "by_id": port.by_id,
        "by_path": port.by_path,
        "driver": port.driver,
        "product": port.product,
    })
}

fn iio_json(device: &IioDeviceInfo) -> Value {
    json!({
        "name": format!("iio://{}", device.name),
        "device": device.device,
        "folder": device.folder,
        "driver_name": device.driver_name,
        "label": device.label,
        "has_gyro": device.has_gyro,
        "has_accel": device.has_accel,
        "rate_hz": device.rate_hz,
        "rates_hz": device.rates_hz,
    })
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
        let json = found().json();
        assert_eq!(json["serial_ports"][0]["name"], "/dev/serial/by-id/usb-ACME");
        assert_eq!(json["iio_devices"][0]["name"], "iio://bmi270");
    }

    #[test]
    fn nodes_are_only_those_of_cameras() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("video0"), "").unwrap();
        std::fs::write(folder.path().join("videotape"), "").unwrap();
        assert_eq!(closed_nodes(folder.path()), Vec::<PathBuf>::new());
    }
}
