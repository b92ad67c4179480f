//! `plumbline setup` on recorded device trees, made by the layout of sysfs: no device is here.

use super::{fails, plumbline, stderr, succeeds};
use rustix::fs::OFlags;
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use std::fs::File;
use std::io::{Read as _, Write as _};
use std::os::unix::fs::{OpenOptionsExt as _, symlink};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use tempfile::TempDir;

/// Identity of a device.
struct Device {
    port: &'static str,
    vendor: &'static str,
    product: &'static str,
    name: &'static str,
    serial: &'static str,
    speed: &'static str,
}

const D435I: Device = Device {
    port: "2-1",
    vendor: "8086",
    product: "0b3a",
    name: "Intel(R) RealSense(TM) Depth Camera 435i",
    serial: "840412060123",
    speed: "5000",
};

/// A recorded tree below a temporary folder.
struct Tree {
    folder: TempDir,
}

fn put(folder: &Path, attributes: &[(&str, &str)]) {
    std::fs::create_dir_all(folder).unwrap();
    for (name, text) in attributes {
        let file = folder.join(name);
        std::fs::create_dir_all(file.parent().unwrap()).unwrap();
        std::fs::write(file, format!("{text}\n")).unwrap();
    }
}

fn link(target: &Path, link: &Path) {
    std::fs::create_dir_all(link.parent().unwrap()).unwrap();
    symlink(target, link).unwrap();
}

impl Tree {
    fn new() -> Self {
        Self { folder: tempfile::tempdir().unwrap() }
    }

    fn at(&self, path: &str) -> PathBuf {
        self.folder.path().join(path)
    }

    fn root(&self) -> String {
        self.folder.path().to_str().unwrap().to_owned()
    }

    fn out(&self) -> String {
        self.at("drone.toml").to_str().unwrap().to_owned()
    }

    fn device_folder(&self, device: &Device) -> PathBuf {
        self.at(&format!("sys/devices/pci0000:00/0000:00:14.0/usb2/{}", device.port))
    }

    /// A USB device with nodes: interface, number and index of each.
    fn plug(&self, device: &Device, nodes: &[(u8, u32, u32)]) {
        let attributes = [
            ("idVendor", device.vendor),
            ("idProduct", device.product),
            ("product", device.name),
            ("serial", device.serial),
            ("speed", device.speed),
        ];
        put(&self.device_folder(device), &attributes);
        for (interface, number, index) in nodes {
            let folder = self.device_folder(device).join(format!("{}:1.{interface}", device.port));
            put(&folder, &[("bInterfaceNumber", &format!("{interface:02x}"))]);
            let name = format!("pci-0000:00:14.0-usb-0:{}:1.{interface}-video-index{index}", device.port);
            self.put_node(&folder.join("video4linux"), *number, (*index, device.name), &name);
        }
    }

    /// A node below `folder`, in the class of cameras, with udev's link to it.
    fn put_node(&self, folder: &Path, number: u32, (index, name): (u32, &str), by_path: &str) {
        let node = format!("video{number}");
        let folder = folder.join(&node);
        put(&folder, &[("index", &index.to_string()), ("name", name)]);
        symlink("../..", folder.join("device")).unwrap();
        link(&folder, &self.at("sys/class/video4linux").join(&node));
        link(Path::new(&format!("../../{node}")), &self.at("dev/v4l/by-path").join(by_path));
    }

    /// The inertial sensors of a camera, as the kernel's HID drivers show them.
    fn put_imu(&self, device: &Device) {
        for (k, name, channel, rates) in
            [(0, "gyro_3d", "in_anglvel", "200 400"), (1, "accel_3d", "in_accel", "100 200")]
        {
            let hid = format!("{}:1.5/0003:8086:0B3A.0001/iio:device{k}", device.port);
            let folder = self.device_folder(device).join(hid);
            let enable = format!("scan_elements/{channel}_x_en");
            let offered = format!("{channel}_sampling_frequency_available");
            put(&folder, &[("name", name), (&enable, "0"), (&offered, rates)]);
            link(&folder, &self.at("sys/bus/iio/devices").join(format!("iio:device{k}")));
        }
    }

    /// A D435i as it is plugged in: depth and infrared on one interface, colour on another.
    fn realsense(&self, device: &Device) {
        self.plug(device, &[(0, 0, 0), (0, 1, 1), (0, 2, 2), (0, 3, 3), (3, 4, 0), (3, 5, 1)]);
        self.put_imu(device);
    }
}

/// Intrinsics of the rectified images and baseline, as librealsense prints them.
const INTRINSICS: [&str; 2] = ["--intrinsics", "423.9,424.1,420.7,241.3,0.04987"];

fn setup(arguments: &[&str]) -> Output {
    plumbline(&[&["setup"], arguments].concat())
}

fn stdout(output: &Output) -> String {
    assert!(output.status.success(), "{}", stderr(output));
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// The configuration that was written.
fn written(tree: &Tree) -> toml::Table {
    succeeds(&["config", &tree.out()]);
    std::fs::read_to_string(tree.out()).unwrap().parse().unwrap()
}

fn numbers(value: &toml::Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|number| number.as_float().unwrap()).collect()
}

#[test]
fn a_realsense_becomes_a_configuration() {
    let tree = Tree::new();
    tree.realsense(&D435I);
    let arguments = ["--imu-to-vehicle", "-90,0,90", "--recorded", &tree.root()];
    let told = stdout(&setup(&[&["realsense", "--out", &tree.out()], &arguments[..], &INTRINSICS].concat()));
    assert!(told.contains("435i 840412060123") && told.contains("baseline    0.0499"), "{told}");
    let config = written(&tree);
    let camera = config["camera"].as_array().unwrap();
    for camera in camera {
        assert_eq!(numbers(&camera["focal_px"]), [423.9, 424.1]);
        assert_eq!(numbers(&camera["centre_px"]), [420.7, 241.3]);
    }
    let v4l2 = &config["driver"]["v4l2"];
    let node = "/dev/v4l/by-path/pci-0000:00:14.0-usb-0:2-1:1.0-video-index2";
    assert_eq!((v4l2["left"].as_str(), v4l2["format"].as_str()), (Some(node), Some("Y8I")));
    let controls: Vec<_> = v4l2["controls"].as_array().unwrap().iter().map(|c| c.as_str().unwrap()).collect();
    assert_eq!(controls, ["xu:3:2:1=0", "xu:3:11:1=1"]);
    assert_eq!(config["driver"]["imu"]["connect"].as_str(), Some("iio://gyro_3d,accel_3d"));
    assert_eq!(numbers(&config["vehicle"]["imu_to_vehicle_deg"]), [-90.0, 0.0, 90.0]);
}

#[test]
fn a_dry_run_shows_what_it_would_write_and_set_and_does_neither() {
    let tree = Tree::new();
    tree.realsense(&D435I);
    let arguments = ["--dry-run", "--exposure-us", "5000", "--emitter", "--recorded", &tree.root()];
    let intrinsics = ["--intrinsics", "426,426,423.5,239.5,0.05", "--imu-to-vehicle", "unknown"];
    let told = stdout(&setup(&[&["realsense", "--out", &tree.out()], &arguments[..], &intrinsics].concat()));
    for part in [
        "would write",
        "imu_to_vehicle_deg = \"unknown\"",
        "would set   emitter on, exposure 5000 us",
        "xu:3:3:4=5000",
    ] {
        assert!(told.contains(part), "{part}: {told}");
    }
    assert!(!tree.at("drone.toml").exists());
}

#[test]
fn what_is_missing_is_named_with_its_cure() {
    let tree = Tree::new();
    let recorded = tree.root();
    let known = ["setup", "realsense", "--dry-run", "--recorded", &recorded];
    fails(
        &[&known[..], &["--imu-to-vehicle", "0,0,0"]].concat(),
        1,
        &["RealSense", "not found on USB", "USB 3"],
    );
    tree.realsense(&D435I);
    let calibrated = [&known[..], &INTRINSICS].concat();
    // Without a terminal nothing is asked.
    fails(&calibrated, 2, &["--imu-to-vehicle", "without a terminal"]);
    fails(&[&known[..], &["--imu-to-vehicle", "0,0,0"]].concat(), 2, &["--intrinsics", "without a terminal"]);
    let mounted = [&calibrated[..], &["--imu-to-vehicle", "0,0,0"]].concat();
    tree.plug(&Device { port: "2-2", serial: "999", ..D435I }, &[(0, 6, 0), (0, 8, 2)]);
    fails(&mounted, 2, &["several", "--serial", "840412060123", "999"]);
    fails(&[&mounted[..], &["--serial", "1"]].concat(), 1, &["--serial", "999"]);
}

#[test]
fn a_file_that_is_there_is_replaced_only_if_told() {
    let tree = Tree::new();
    tree.realsense(&D435I);
    std::fs::write(tree.at("drone.toml"), "mine").unwrap();
    let (out, recorded) = (tree.out(), tree.root());
    let arguments = ["setup", "realsense", "--out", &out, "--recorded", &recorded];
    let mounted = [&arguments[..], &INTRINSICS, &["--imu-to-vehicle", "unknown"]].concat();
    fails(&mounted, 2, &["drone.toml", "--overwrite"]);
    assert_eq!(std::fs::read_to_string(&out).unwrap(), "mine");
    succeeds(&[&mounted[..], &["--overwrite"]].concat());
    written(&tree);
}

#[test]
fn a_camera_at_usb_2_and_without_its_imu_is_told_of() {
    let tree = Tree::new();
    let slow = Device { speed: "480", ..D435I };
    tree.plug(&slow, &[(0, 0, 0), (0, 2, 2)]);
    let arguments = ["--imu-to-vehicle", "unknown", "--recorded", &tree.root()];
    let told = stdout(&setup(&[&["realsense", "--dry-run"], &arguments[..], &INTRINSICS].concat()));
    assert!(told.contains("USB 2") && told.contains("HID_SENSOR_GYRO_3D"), "{told}");
}

#[test]
fn a_terminal_is_asked_for_the_mounting() {
    let tree = Tree::new();
    tree.realsense(&D435I);
    let controller = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC).unwrap();
    grantpt(&controller).unwrap();
    unlockpt(&controller).unwrap();
    let path = ptsname(&controller, Vec::new()).unwrap().into_string().unwrap();
    let no_control = OFlags::NOCTTY.bits() as i32;
    let end =
        || Stdio::from(File::options().read(true).write(true).custom_flags(no_control).open(&path).unwrap());
    let mut controller = File::from(controller);
    let mut command = Command::new(env!("CARGO_BIN_EXE_plumbline"));
    command.args(["setup", "realsense", "--out", &tree.out(), "--recorded", &tree.root()]).args(INTRINSICS);
    let mut running = command.stdin(end()).stdout(Stdio::piped()).stderr(end()).spawn().unwrap();
    drop(command);
    // Typed ahead: the first answer is not understood.
    controller.write_all(b"level\n-90,0,90\n").unwrap();
    let mut told = String::new();
    running.stdout.take().unwrap().read_to_string(&mut told).unwrap();
    assert!(running.wait().unwrap().success(), "{told}");
    let mut asked = vec![0; 4096];
    let length = controller.read(&mut asked).unwrap();
    let asked = String::from_utf8_lossy(&asked[..length]).into_owned();
    assert!(asked.contains("Mounting of the IMU") && asked.contains("write three angles"), "{asked}");
    assert_eq!(numbers(&written(&tree)["vehicle"]["imu_to_vehicle_deg"]), [-90.0, 0.0, 90.0]);
}

const ZED: Device = Device {
    port: "2-3",
    vendor: "2b03",
    product: "f682",
    name: "ZED-M",
    serial: "0x00012345",
    speed: "5000",
};

const FACTORY: &str = "[LEFT_CAM_VGA]\nfx=350.494\nfy=350.494\ncx=331.039\ncy=189.714\nk1=-0.174488\nk2=0.027323\n\
    [RIGHT_CAM_VGA]\nfx=349.663\nfy=349.663\ncx=335.323\ncy=189.551\nk1=-0.175561\nk2=0.0269139\n\
    [STEREO]\nBaseline=62.98\nCV_VGA=0.0028\nRX_VGA=0.0032\nRZ_VGA=-0.0003\n";

#[test]
fn a_zed_mini_becomes_a_configuration_by_its_factory_file() {
    let tree = Tree::new();
    tree.plug(&ZED, &[(0, 1, 1), (0, 0, 0)]);
    let factory = tree.at("SN12345.conf");
    std::fs::write(&factory, FACTORY).unwrap();
    let factory = factory.to_str().unwrap();
    let (out, recorded) = (tree.out(), tree.root());
    let arguments = ["zed-mini", "--out", &out, "--recorded", &recorded, "--factory", factory];
    let mounted =
        [&arguments[..], &["--imu-to-vehicle", "180,0,0", "--imu", "serial:///dev/ttyTHS1:921600"]].concat();
    let told = stdout(&setup(&mounted));
    assert!(told.contains("baseline    0.0630"), "{told}");
    let config = written(&tree);
    assert_eq!(numbers(&config["camera"][1]["focal_px"]), [349.663; 2]);
    assert_eq!(config["camera"][0]["distortion"]["k1"].as_float(), Some(-0.174488));
    assert_eq!(config["driver"]["imu"]["connect"].as_str(), Some("serial:///dev/ttyTHS1:921600"));
    let node = "/dev/v4l/by-path/pci-0000:00:14.0-usb-0:2-3:1.0-video-index0";
    assert_eq!(config["driver"]["v4l2"]["left"].as_str(), Some(node));
    std::fs::write(factory, FACTORY.replace("62.98", "x")).unwrap();
    let again = [&["setup"], &mounted[..], &["--overwrite"]].concat();
    fails(&again, 2, &["SN12345.conf", "stereo.baseline", "no number"]);
}

#[test]
fn two_receivers_become_left_and_right() {
    let tree = Tree::new();
    let (out, recorded) = (tree.out(), tree.root());
    let arguments = ["mipi", "--imu-to-vehicle", "180,0,0", "--recorded", &recorded, "--out", &out];
    let all = [&["setup"], &arguments[..]].concat();
    fails(&all, 2, &["rp1-cfe-csi2_ch0", "--left"]);
    for (number, port) in [(8, "1f00128000"), (0, "1f00110000")] {
        let folder = tree.at(&format!("sys/devices/platform/axi/{port}.csi/video4linux"));
        let by_path = format!("platform-{port}.csi-video-index0");
        tree.put_node(&folder, number, (0, "rp1-cfe-csi2_ch0"), &by_path);
    }
    stdout(&setup(&arguments));
    let v4l2 = written(&tree)["driver"]["v4l2"].clone();
    assert_eq!(v4l2["left"].as_str(), Some("/dev/v4l/by-path/platform-1f00110000.csi-video-index0"));
    assert_eq!(v4l2["right"].as_str(), Some("/dev/v4l/by-path/platform-1f00128000.csi-video-index0"));
    stdout(&setup(&[&arguments[..], &["--swap", "--overwrite"]].concat()));
    let swapped = written(&tree)["driver"]["v4l2"].clone();
    assert_eq!((&swapped["left"], &swapped["right"]), (&v4l2["right"], &v4l2["left"]));
}

#[test]
fn help_says_that_no_device_was_tried() {
    for rig in ["realsense", "zed-mini", "mipi"] {
        let told = stdout(&setup(&[rig, "--help"])).split_whitespace().collect::<Vec<_>>().join(" ");
        assert!(told.contains("Not tried on a device"), "{rig}: {told}");
    }
}
