//! Nodes of cameras as sysfs tells them, and the cameras on USB that they belong to: what a device says it is, and which of
//! its nodes is which. No device is opened.

use crate::sysfs::{entries, text};
use std::path::{Path, PathBuf};

/// Folder in which the kernel shows its devices.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DeviceTree {
    /// Folder in place of `/`: that of a recorded device tree, or `/` itself.
    pub root: PathBuf,
}

impl Default for DeviceTree {
    fn default() -> Self {
        Self { root: PathBuf::from("/") }
    }
}

/// Node of a camera.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct VideoNode {
    /// Name of the node, such as `video2`.
    pub name: String,
    /// Name that the driver gives it, such as `rp1-cfe-csi2_ch0`.
    pub label: String,
    /// Number of the node among those of its interface.
    pub index: u32,
    /// Folder of the USB device, and number of the interface, of a camera on USB.
    pub usb: Option<(PathBuf, u8)>,
    /// Name by the port, which stays: below `/dev/v4l/by-path`.
    pub stable_path: Option<PathBuf>,
}

/// Camera on USB.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UsbCamera {
    /// Identifier of the manufacturer.
    pub vendor: u16,
    /// Identifier of the product.
    pub product: u16,
    /// Name of the product, as the device states it.
    pub name: String,
    /// Serial number, as the device states it; empty where it has none.
    pub serial: String,
    /// Speed of the connection, Mbit/s, where it is known.
    pub speed_mbit: Option<u32>,
    /// Folder of the device in sysfs.
    pub folder: PathBuf,
    /// Nodes by interface and index.
    pub nodes: Vec<VideoNode>,
}

/// Nodes of cameras, in order of their stable names; those without one come first.
pub fn video_nodes(tree: &DeviceTree) -> Vec<VideoNode> {
    let links = stable_links(&tree.root.join("dev/v4l/by-path"));
    let folders = entries(&tree.root.join("sys/class/video4linux"));
    let mut nodes: Vec<VideoNode> = folders.iter().filter_map(|folder| video_node(folder, &links)).collect();
    nodes.sort_by(|a, b| (&a.stable_path, &a.name).cmp(&(&b.stable_path, &b.name)));
    nodes
}

/// Cameras on USB, in order of their folders.
pub fn usb_cameras(tree: &DeviceTree) -> Vec<UsbCamera> {
    let mut cameras: Vec<UsbCamera> = Vec::new();
    for node in video_nodes(tree) {
        let Some((folder, _)) = node.usb.clone() else { continue };
        match cameras.iter_mut().find(|camera| camera.folder == folder) {
            Some(camera) => camera.nodes.push(node),
            None => cameras.extend(camera(folder, node)),
        }
    }
    cameras.sort_by(|a, b| a.folder.cmp(&b.folder));
    for camera in &mut cameras {
        camera.nodes.sort_by_key(|node| (node.interface(), node.index));
    }
    cameras
}

impl VideoNode {
    /// Number of the USB interface.
    pub fn interface(&self) -> Option<u8> {
        self.usb.as_ref().map(|(_, interface)| *interface)
    }
}

fn video_node(folder: &Path, links: &[(String, PathBuf)]) -> Option<VideoNode> {
    let name = folder.file_name()?.to_str()?.to_owned();
    name.strip_prefix("video")?.parse::<u32>().ok()?;
    Some(VideoNode {
        label: text(&folder.join("name")).unwrap_or_default(),
        index: text(&folder.join("index"))?.parse().ok()?,
        usb: usb_interface(folder),
        stable_path: links.iter().find(|(target, _)| *target == name).map(|(_, link)| link.clone()),
        name,
    })
}

/// Folder of the USB device of a node, and number of its interface; `None` for a node that is not on USB.
fn usb_interface(folder: &Path) -> Option<(PathBuf, u8)> {
    let interface = std::fs::canonicalize(folder.join("device")).ok()?;
    let number = u8::from_str_radix(&text(&interface.join("bInterfaceNumber"))?, 16).ok()?;
    Some((interface.parent()?.to_owned(), number))
}

fn camera(folder: PathBuf, node: VideoNode) -> Option<UsbCamera> {
    let identifier = |name| u16::from_str_radix(&text(&folder.join(name))?, 16).ok();
    Some(UsbCamera {
        vendor: identifier("idVendor")?,
        product: identifier("idProduct")?,
        name: text(&folder.join("product")).unwrap_or_default(),
        serial: text(&folder.join("serial")).unwrap_or_default(),
        speed_mbit: text(&folder.join("speed")).and_then(|speed| speed.parse().ok()),
        nodes: vec![node],
        folder,
    })
}

/// Names of nodes with the links of udev to them, as a configuration has them.
fn stable_links(folder: &Path) -> Vec<(String, PathBuf)> {
    let link = |path: PathBuf| {
        let target = std::fs::read_link(&path).ok()?.file_name()?.to_str()?.to_owned();
        Some((target, Path::new("/dev/v4l/by-path").join(path.file_name()?)))
    };
    entries(folder).into_iter().filter_map(link).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::symlink;

    fn put(folder: &Path, attributes: &[(&str, &str)]) {
        std::fs::create_dir_all(folder).unwrap();
        for (name, text) in attributes {
            std::fs::write(folder.join(name), format!("{text}\n")).unwrap();
        }
    }

    /// Puts a node of an interface of the device at `2-1`.
    fn put_node(root: &Path, (interface, number, index): (&str, u32, u32)) {
        let interface_folder = root.join(format!("sys/devices/usb2/2-1/2-1:1.{interface}"));
        let node = format!("video{number}");
        put(&interface_folder, &[("bInterfaceNumber", &format!("{interface:0>2}"))]);
        let folder = interface_folder.join("video4linux").join(&node);
        put(&folder, &[("index", &index.to_string()), ("name", "Depth")]);
        symlink("../..", folder.join("device")).unwrap();
        let class = root.join("sys/class/video4linux");
        std::fs::create_dir_all(&class).unwrap();
        symlink(&folder, class.join(&node)).unwrap();
        let by_path = root.join("dev/v4l/by-path");
        std::fs::create_dir_all(&by_path).unwrap();
        let name = format!("pci-0000:00:14.0-usb-0:1:1.{interface}-video-index{index}");
        symlink(format!("../../{node}"), by_path.join(name)).unwrap();
    }

    #[test]
    fn nodes_of_one_device_belong_together() {
        let root = tempfile::tempdir().unwrap();
        let device = root.path().join("sys/devices/usb2/2-1");
        let attributes = [
            ("idVendor", "8086"),
            ("idProduct", "0b3a"),
            ("product", "Intel(R) RealSense(TM) Depth Camera 435i"),
            ("serial", "123"),
            ("speed", "5000"),
        ];
        put(&device, &attributes);
        for node in [("3", 4, 0), ("0", 2, 2), ("0", 0, 0)] {
            put_node(root.path(), node);
        }
        // A camera that is no USB device has no interface.
        put(
            &root.path().join("sys/class/video4linux/video9"),
            &[("index", "0"), ("name", "rp1-cfe-csi2_ch0")],
        );
        let tree = DeviceTree { root: root.path().into() };
        let cameras = usb_cameras(&tree);
        let [camera] = &cameras[..] else { panic!("{cameras:?}") };
        assert_eq!((camera.vendor, camera.product, camera.speed_mbit), (0x8086, 0x0b3a, Some(5000)));
        assert_eq!(camera.folder, device.canonicalize().unwrap());
        let nodes: Vec<_> = camera.nodes.iter().map(|n| (n.name.as_str(), n.interface(), n.index)).collect();
        assert_eq!(nodes, [("video0", Some(0), 0), ("video2", Some(0), 2), ("video4", Some(3), 0)]);
        let stable = Path::new("/dev/v4l/by-path/pci-0000:00:14.0-usb-0:1:1.0-video-index2");
        assert_eq!(camera.nodes[1].stable_path.as_deref(), Some(stable));
        let nodes = video_nodes(&tree);
        assert!(usb_cameras(&DeviceTree { root: root.path().join("nothing") }).is_empty());
        assert_eq!(
            (nodes.len(), nodes[0].label.as_str(), nodes[0].interface()),
            (4, "rp1-cfe-csi2_ch0", None)
        );
    }
}
