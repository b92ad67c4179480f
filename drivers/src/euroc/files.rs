//! The image files of a camera: where they are, how large they are, and why they cannot be read.

use super::depth::Depth;
use super::image::{MAX_FILE_BYTES, png_largest, read_start};
use super::pairing::ImageRow;
use super::picture::{CONVERT, picture_size};
use std::collections::{BTreeMap, BTreeSet};
use std::ffi::OsString;
use std::path::Path;

/// Endings of the pictures that are read, in the order in which they are taken where several have one name.
const ENDINGS: [&str; 3] = ["png", "jpg", "jpeg"];
/// Images of a camera whose values are looked at for the bits in use, spread over the recording.
const LOOKED_AT: usize = 32;
/// Beginning of a file that says its format and size, bytes: EXIF data of a JPEG fit.
const HEAD_BYTES: u64 = 1 << 18;

/// The name of a file without its ending, and the ending, in lower case.
fn parts(name: &str) -> (&str, String) {
    let (stem, ending) = name.rsplit_once('.').unwrap_or((name, ""));
    (stem, ending.to_ascii_lowercase())
}

/// Gives rows whose file is not in `folder` the picture of that name with another ending: tables are often left as they were
/// when the images are converted.
pub(super) fn find_files(folder: &Path, rows: &mut [ImageRow]) {
    let Ok(entries) = std::fs::read_dir(folder) else { return };
    let names: Vec<OsString> = entries.flatten().map(|entry| entry.file_name()).collect();
    let mut files: BTreeMap<&str, (usize, &str)> = BTreeMap::new();
    let mut there: Vec<&str> = names.iter().filter_map(|name| name.to_str()).collect();
    there.sort_unstable();
    for name in &there {
        let (stem, ending) = parts(name);
        let Some(rank) = ENDINGS.iter().position(|known| *known == ending) else { continue };
        files.entry(stem).and_modify(|best| *best = (*best).min((rank, name))).or_insert((rank, name));
    }
    for row in rows {
        if there.binary_search(&row.file.as_str()).is_err()
            && let Some((_, name)) = files.get(parts(&row.file).0).or_else(|| files.get(row.file.as_str()))
        {
            row.file = (*name).to_owned();
        }
    }
}

/// Size of the first image that can be read, px.
pub(super) fn size_px(folder: &Path, rows: &[ImageRow]) -> Option<(usize, usize)> {
    rows.iter().find_map(|row| picture_size(&read_start(&folder.join(&row.file), HEAD_BYTES).ok()?))
}

/// Reason why no image of a camera can be read, and the cure.
pub(super) fn unreadable(folder: &Path, rows: &[ImageRow]) -> String {
    let count = rows.len();
    if rows.iter().any(|row| folder.join(&row.file).is_file()) {
        return format!("none of the {count} images of data.csv is a whole PNG or JPEG; {CONVERT}");
    }
    let stems: BTreeSet<&str> = rows.iter().map(|row| parts(&row.file).0).collect();
    let is_image = |name: &String| stems.contains(parts(name).0);
    let names = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let other = names.filter_map(|entry| entry.file_name().into_string().ok()).filter(is_image).min();
    match other {
        Some(name) => format!("none of the {count} images of data.csv is there, but {name}; {CONVERT}"),
        None => format!("none of the {count} images of data.csv is there as a PNG or JPEG; copy them here"),
    }
}

/// Largest value of 16-bit images, over some that are spread over all `rows`; `None` for images of 8 bits.
pub(super) fn largest_value(folder: &Path, rows: &[ImageRow]) -> Option<u16> {
    let count = rows.len().min(LOOKED_AT);
    let mut largest = None;
    for k in 0..count {
        let row = &rows[k * (rows.len() - 1) / (count - 1).max(1)];
        let Ok(bytes) = read_start(&folder.join(&row.file), MAX_FILE_BYTES) else { continue };
        // A picture of 8 bits among others of 16 is none of these cameras.
        let Some(value) = png_largest(&bytes) else {
            if picture_size(&bytes).is_some() {
                return None;
            }
            continue;
        };
        largest = largest.max(Some(value));
        if Depth::of_largest(value) == Depth::FULL && value > 0 {
            break;
        }
    }
    largest
}
