//! The files of a log: `flight.mcap`, then `flight.1.mcap`, `flight.2.mcap` and so on.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};

/// The file of part `part` of the log at `path`.
pub fn part_path(path: &Path, part: u32) -> PathBuf {
    if part == 0 { path.to_owned() } else { path.with_extension(format!("{part}.mcap")) }
}

/// The parts of the log at `path` that are there, with their numbers, in order.
pub fn existing_parts(path: &Path) -> Vec<(u32, PathBuf)> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    let entries = std::fs::read_dir(folder.unwrap_or(Path::new("."))).into_iter().flatten().flatten();
    let mut parts: Vec<_> = entries
        .filter_map(|entry| part_number(path, &entry.file_name()))
        .map(|part| (part, part_path(path, part)))
        .collect();
    if path.exists() {
        parts.push((0, path.to_owned()));
    }
    parts.sort();
    parts
}

/// The number of the part of `path` that is called `name`, from 1 on.
fn part_number(path: &Path, name: &OsStr) -> Option<u32> {
    let stem = path.file_stem()?.to_str()?;
    let number = name.to_str()?.strip_prefix(stem)?.strip_prefix('.')?.strip_suffix(".mcap")?;
    // The shortest form only: "01" is not the name of a part.
    number.parse().ok().filter(|part: &u32| *part > 0 && part.to_string() == number)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_are_found_in_order_and_nothing_else_is() {
        let folder = tempfile::tempdir().unwrap();
        let first = folder.path().join("a.b.mcap");
        for name in
            ["a.b.mcap", "a.b.10.mcap", "a.b.2.mcap", "a.b.02.mcap", "a.1.mcap", "a.b.x.mcap", "a.b.0.mcap"]
        {
            std::fs::write(folder.path().join(name), "").unwrap();
        }
        let numbers: Vec<u32> = existing_parts(&first).into_iter().map(|(number, _)| number).collect();
        assert_eq!(numbers, [0, 2, 10]);
        assert_eq!(part_path(&first, 10), folder.path().join("a.b.10.mcap"));
    }
}
