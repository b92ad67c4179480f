//! Masks of cameras: pictures beside the configuration.

use super::{plumbline, stderr};
use plumbline_config::Config;
use std::fs::{self, File};
use std::path::Path;

/// Writes a grey PNG picture.
fn picture(file: &Path, width: u32, height: u32, pixel: impl Fn(u32, u32) -> u8) {
    let mut encoder = png::Encoder::new(File::create(file).unwrap(), width, height);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(png::BitDepth::Eight);
    let pixels: Vec<u8> = (0..width * height).map(|k| pixel(k % width, k / width)).collect();
    encoder.write_header().unwrap().write_image_data(&pixels).unwrap();
}

/// Writes the preset `sim` to a file whose left camera has a mask.
fn masked(folder: &Path, mask: &str) -> String {
    let text = plumbline_config::preset_text("sim").unwrap();
    let text = text.replacen("mask = \"\"", &format!("mask = \"{mask}\""), 1);
    let file = folder.join("drone.toml");
    fs::write(&file, text).unwrap();
    file.to_str().unwrap().to_owned()
}

#[test]
fn a_wrong_mask_is_refused_with_file_key_sizes_and_cure() {
    let folder = tempfile::tempdir().unwrap();
    picture(&folder.path().join("small.png"), 376, 240, |_, _| 255);
    picture(&folder.path().join("black.png"), 752, 480, |_, _| 0);
    fs::write(folder.path().join("text.png"), "no picture").unwrap();
    let refused = [
        ("small.png", ["small.png has 376x240 px", "the images have 752x480"]),
        ("black.png", ["leaves 0.0 %", "exchanged?"]),
        ("text.png", ["text.png is no PNG picture", "save the mask as PNG"]),
        ("none.png", ["none.png cannot be read", "give the path of a PNG picture"]),
    ];
    for (mask, words) in refused {
        let config = masked(folder.path(), mask);
        let output = plumbline(&["replay", "sim:room", "--config", &config, "--duration", "1"]);
        let said = stderr(&output);
        assert_eq!(output.status.code(), Some(2), "{said}");
        for word in words.iter().chain(&["drone.toml", "`camera[0].mask` (line "]) {
            assert!(said.contains(word), "{word} is not in: {said}");
        }
    }
}

#[test]
fn a_mask_stands_in_the_log_of_its_flight_and_the_log_verifies_without_the_picture() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("left-mask.png");
    picture(&file, 752, 480, |_, v| if v < 120 { 0 } else { 255 });
    let config = masked(folder.path(), "left-mask.png");
    let log = folder.path().join("log.mcap");
    let log = log.to_str().unwrap();
    let flown = plumbline(&["replay", "sim:room", "--config", &config, "--duration", "2", "--record", log]);
    assert!(flown.status.success(), "{}", stderr(&flown));
    let mask = Config::load(&config).unwrap().camera[0].mask.clone().unwrap();
    assert_eq!(mask.pixels().unwrap().seen_share(), 0.75);
    fs::remove_file(file).unwrap();
    let verified = plumbline(&["verify", log]);
    assert!(verified.status.success(), "{}", stderr(&verified));
}
