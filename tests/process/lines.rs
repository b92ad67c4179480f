//! `plumbline lines`: the picture, the list, and what is refused.

use super::{fails, plumbline, stderr};
use png::{BitDepth, ColorType, Encoder};
use std::fs::File;
use std::path::{Path, PathBuf};

/// A PNG with a bright rectangle in its middle.
fn image(folder: &Path, (width, height): (u32, u32), color: ColorType, depth: BitDepth) -> String {
    let path = folder.join(format!("{width}x{height}-{color:?}-{depth:?}.png"));
    let bytes = color.samples() * if depth == BitDepth::Sixteen { 2 } else { 1 };
    let is_inside = |at: u32, size: u32| (size / 4..size - size / 4).contains(&at);
    let mut data = Vec::new();
    for (x, y) in (0..height).flat_map(|y| (0..width).map(move |x| (x, y))) {
        let light = if is_inside(x, width) && is_inside(y, height) { 200 } else { 40 };
        data.extend(std::iter::repeat_n(light, bytes));
    }
    let mut encoder = Encoder::new(File::create(&path).unwrap(), width, height);
    encoder.set_color(color);
    encoder.set_depth(depth);
    encoder.write_header().unwrap().write_image_data(&data).unwrap();
    path.to_str().unwrap().to_owned()
}

fn size(path: &str) -> (u32, u32) {
    let file = std::io::BufReader::new(File::open(path).unwrap());
    png::Decoder::new(file).read_info().unwrap().info().size()
}

#[test]
fn any_image_becomes_a_picture_a_list_and_a_table() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (out, csv) = (at("out.png"), at("out.csv"));
    for (color, depth, size_px) in [
        (ColorType::Grayscale, BitDepth::Eight, (320, 200)),
        (ColorType::Rgba, BitDepth::Sixteen, (64, 64)),
        (ColorType::Rgb, BitDepth::Eight, (65, 401)),
        (ColorType::Grayscale, BitDepth::Sixteen, (4096, 64)),
    ] {
        let image = image(folder.path(), size_px, color, depth);
        let output = plumbline(&["lines", &image, "--out", &out, "--csv", &csv]);
        assert!(output.status.success(), "{image}: {}", stderr(&output));
        let table = String::from_utf8_lossy(&output.stdout).into_owned();
        assert!(table.contains("merged") && table.contains("of the budget"), "{table}");
        let (width, height) = size(&out);
        assert!(width > 3 * size_px.0 && height > size_px.1, "{width}x{height}");
        let rows = std::fs::read_to_string(&csv).unwrap();
        assert!(rows.starts_with("layer,x1,y1,x2,y2,strength\nraw,"), "{image}: {rows}");
        let output = plumbline(&["lines", &image, "--out", &out, "--layer", "merged"]);
        assert!(output.status.success(), "{image}: {}", stderr(&output));
        assert_eq!(size(&out), size_px);
    }
}

#[test]
fn what_cannot_be_read_or_written_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (text, cut, out) = (at("text.png"), at("cut.png"), at("out.png"));
    let good = image(folder.path(), (100, 80), ColorType::Grayscale, BitDepth::Eight);
    std::fs::write(&text, "no picture").unwrap();
    let bytes = std::fs::read(&good).unwrap();
    std::fs::write(&cut, &bytes[..bytes.len() / 2]).unwrap();
    fails(&["lines", &text], 2, &[&text, "convert it to PNG"]);
    fails(&["lines", &cut], 2, &[&cut, "copy or write it again"]);
    fails(&["lines", &at("none.png")], 2, &["none.png", "does not exist"]);
    fails(&["lines", &at("")], 2, &["is a directory"]);
    for size_px in [(63, 64), (64, 4097)] {
        let image = image(folder.path(), size_px, ColorType::Grayscale, BitDepth::Eight);
        fails(&["lines", &image], 2, &[&image, "64 to 4096"]);
    }
    fails(&["lines", &good, "--out", &at("no/out.png")], 2, &["no/out.png", "create it first"]);
    fails(&["lines", &good, "--out", &good], 2, &[&good, "name another file"]);
    fails(&["lines", &good, "--out", &out, "--csv", &out], 2, &[&out, "two outputs"]);
    fails(&["lines", &good, "--set", "estimator.lines.max_raw=1"], 2, &["max_raw"]);
    fails(&["lines", &good, "--config", "nowhere.toml"], 2, &["nowhere.toml"]);
    assert!(!PathBuf::from(&out).exists(), "nothing is written by a command that is refused");
    let usage = plumbline(&["lines", &good, "--layer", "raw"]);
    assert_eq!(usage.status.code(), Some(2), "{}", stderr(&usage));
}
