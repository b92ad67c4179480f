//! `plumbline calibrate rig`.

use super::dataset::Folder;
use super::{fails, succeeds};

#[test]
fn a_rig_that_stands_does_not_show_where_its_cameras_are() {
    let folder = Folder::new();
    let (path, flight, rig) = (folder.at("rest.tum"), folder.at("flight"), folder.at("rig.toml"));
    let poses: String = (0..9).map(|k| format!("{}.0 1 2 1 0 0 0 1\n", 100 + 10 * k)).collect();
    std::fs::write(&path, poses).unwrap();
    let options = ["--path", &path, "--duration", "20", "--scale", "0.3", "--mono"];
    succeeds(&[&["simulate", &flight], &options[..]].concat());
    fails(
        &["calibrate", "rig", &flight, "--out", &rig],
        1,
        &["flight", "does not determine the rig", "turn it about all axes"],
    );
    assert!(!std::path::Path::new(&rig).exists());
    fails(&["calibrate", "rig", "/nowhere", "--out", &rig], 2, &["/nowhere"]);
}
