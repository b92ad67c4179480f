//! The serial ports that are there, by names that stay.
//!
//! `/dev/ttyACM0` is whichever device was plugged in first. udev keeps links that stay: `/dev/serial/by-id` names the device,
//! `/dev/serial/by-path` the socket that it is plugged into. Ports of the board itself have no links: their names are fixed.

use crate::sysfs::{entries, text};
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Levels above a port's device where its USB device may be.
const LEVELS: usize = 4;

/// A serial port.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct SerialPortInfo {
    /// The name to configure: the one of these that stays.
    pub name: PathBuf,
    /// The device that it is now.
    pub device: PathBuf,
    /// Link by identity.
    pub by_id: Option<PathBuf>,
    /// Link by the place where it is plugged in.
    pub by_path: Option<PathBuf>,
    /// The kernel's driver.
    pub driver: Option<String>,
    /// Maker and product, of a USB device.
    pub product: Option<String>,
}

/// The serial ports of this host, in order of their names.
pub fn serial_ports() -> Vec<SerialPortInfo> {
    serial_ports_below(Path::new("/dev"), Path::new("/sys"))
}

/// Serial ports below other trees than `/dev` and `/sys`, in order of their names.
fn serial_ports_below(dev: &Path, sys: &Path) -> Vec<SerialPortInfo> {
    let by_id = links(&dev.join("serial/by-id"));
    let by_path = links(&dev.join("serial/by-path"));
    let mut ports: Vec<SerialPortInfo> = entries(&sys.join("class/tty"))
        .into_iter()
        .filter_map(|port| {
            let driver = driver_of(&port)?;
            let device = dev.join(port.file_name()?);
            let (by_id, by_path) = (by_id.get(&device).cloned(), by_path.get(&device).cloned());
            let name = by_id.clone().or(by_path.clone()).unwrap_or_else(|| device.clone());
            let product = product_of(&port);
            Some(SerialPortInfo { name, device, by_id, by_path, driver: Some(driver), product })
        })
        .collect();
    ports.sort_by(|a, b| a.name.cmp(&b.name));
    ports
}

/// The links of a folder by the device that they lead to.
fn links(folder: &Path) -> BTreeMap<PathBuf, PathBuf> {
    entries(folder).into_iter().filter_map(|link| Some((std::fs::canonicalize(&link).ok()?, link))).collect()
}

/// The driver of a port; none where there is no device behind it: consoles, pseudo-terminals, 8250 ports that the board
/// does not have.
fn driver_of(port: &Path) -> Option<String> {
    let driver = std::fs::read_link(port.join("device/driver")).ok()?;
    let is_absent = text(&port.join("type")).as_deref() == Some("0");
    (!is_absent).then(|| driver.file_name().map(|name| name.to_string_lossy().into_owned()))?
}

/// Maker and product of the USB device that a port belongs to.
fn product_of(port: &Path) -> Option<String> {
    let device = std::fs::canonicalize(port.join("device")).ok()?;
    device.ancestors().take(LEVELS).find_map(|folder| {
        let product = text(&folder.join("product"))?;
        let maker = text(&folder.join("manufacturer"));
        Some(maker.map_or(product.clone(), |maker| format!("{maker} {product}")))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;
    use std::os::unix::fs::symlink;

    fn write(path: PathBuf, text: &str) {
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, text).unwrap();
    }

    fn link(to: &Path, from: PathBuf) {
        fs::create_dir_all(from.parent().unwrap()).unwrap();
        fs::create_dir_all(to.parent().unwrap()).unwrap();
        symlink(to, from).unwrap();
    }

    #[test]
    fn ports_are_listed_by_the_names_that_stay() {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path().canonicalize().unwrap();
        let (dev, sys) = (root.join("dev"), root.join("sys"));
        // A USB modem with both links, a port of the board, one that the board does not have, and a console.
        for (port, device) in
            [("ttyACM0", "usb1/1-1/1-1:1.0"), ("ttyAMA0", "soc/serial0"), ("ttyS7", "soc/serial7")]
        {
            write(dev.join(port), "");
            fs::create_dir_all(sys.join("devices").join(device)).unwrap();
            link(&sys.join("devices").join(device), sys.join("class/tty").join(port).join("device"));
        }
        fs::create_dir_all(sys.join("class/tty/console")).unwrap();
        write(sys.join("devices/usb1/1-1/product"), "IMU\n");
        write(sys.join("devices/usb1/1-1/manufacturer"), "ACME\n");
        write(sys.join("class/tty/ttyS7/type"), "0\n");
        for (device, driver) in
            [("usb1/1-1/1-1:1.0", "cdc_acm"), ("soc/serial0", "uart-pl011"), ("soc/serial7", "port")]
        {
            symlink(format!("/drivers/{driver}"), sys.join("devices").join(device).join("driver")).unwrap();
        }
        link(&dev.join("ttyACM0"), dev.join("serial/by-id/usb-ACME_IMU_0001-if00"));
        link(&dev.join("ttyACM0"), dev.join("serial/by-path/pci-0:usb-1:1.0"));
        let ports = serial_ports_below(&dev, &sys);
        let [modem, board] = &ports[..] else { panic!("{ports:?}") };
        let (modem, board) = if modem.by_id.is_some() { (modem, board) } else { (board, modem) };
        assert_eq!(modem.name, dev.join("serial/by-id/usb-ACME_IMU_0001-if00"));
        assert_eq!(modem.by_path, Some(dev.join("serial/by-path/pci-0:usb-1:1.0")));
        assert_eq!((modem.driver.as_deref(), modem.product.as_deref()), (Some("cdc_acm"), Some("ACME IMU")));
        assert_eq!((&board.name, &board.device), (&dev.join("ttyAMA0"), &dev.join("ttyAMA0")));
        assert_eq!((board.driver.as_deref(), &board.product), (Some("uart-pl011"), &None));
    }
}
