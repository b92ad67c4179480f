//! The files of a bag in their order: one MCAP file, or the directory that `ros2 bag record` makes.

use crate::DriverError;
use std::ffi::OsStr;
use std::path::{Component, Path, PathBuf};

/// What describes a bag of several files.
const METADATA: &str = "metadata.yaml";
/// Longest description that is read, bytes.
const MAX_METADATA_BYTES: u64 = 4 << 20;
/// How a bag of SQLite becomes one that can be read.
const CONVERT: &str = "convert it: write `output_bags: [{uri: NEW, storage_id: mcap, all: true}]` into convert.yaml, then \
                       `ros2 bag convert -i OLD -o convert.yaml`, and give NEW";

/// Whether there may be a bag at `path`: an .mcap file, or a directory with a description or such files.
#[must_use]
pub fn is_bag(path: &Path) -> bool {
    if path.is_dir() {
        return path.join(METADATA).is_file() || !listed(path).is_empty();
    }
    let names = ["mcap", "db3", "bag", "zstd"];
    path.extension().and_then(OsStr::to_str).is_some_and(|ending| names.contains(&ending))
}

/// The files of the bag at `path`.
///
/// # Errors
/// When there are none, or they are of another kind; the message says how to convert them.
pub(crate) fn bag_files(path: &Path) -> Result<Vec<PathBuf>, DriverError> {
    if !path.exists() {
        return Err(DriverError::missing(
            path,
            "does not exist; give a ROS 2 bag, an .mcap file or its directory",
        ));
    }
    let files = if path.is_dir() { files_of_directory(path)? } else { vec![path.to_owned()] };
    for file in &files {
        check_kind(file)?;
    }
    Ok(files)
}

fn check_kind(file: &Path) -> Result<(), DriverError> {
    let message = match file.extension().and_then(OsStr::to_str) {
        Some("db3") => format!("is a bag of SQLite, which is not read; {CONVERT}"),
        Some("bag") => {
            "is a bag of ROS 1, which is not read; convert it: `rosbags-convert --src OLD.bag --dst NEW --dst-storage mcap`, and \
             give NEW"
                .to_owned()
        }
        Some("zstd") => "is compressed as a whole file; unpack it first: `zstd -d FILE.mcap.zstd`".to_owned(),
        _ if !file.is_file() => "is named in metadata.yaml and is not there; copy the whole bag".to_owned(),
        _ => return Ok(()),
    };
    Err(DriverError::refused(file, message))
}

fn files_of_directory(path: &Path) -> Result<Vec<PathBuf>, DriverError> {
    let metadata = path.join(METADATA);
    let named = match metadata.is_file() {
        true => described(&metadata, &read_bounded(&metadata)?)?,
        false => Vec::new(),
    };
    let files: Vec<PathBuf> = match named.is_empty() {
        true => listed(path),
        false => named.iter().map(|name| path.join(name)).collect(),
    };
    if files.is_empty() {
        return Err(DriverError::missing(path, "holds no .mcap file; give the directory of a ROS 2 bag"));
    }
    Ok(files)
}

fn read_bounded(path: &Path) -> Result<String, DriverError> {
    let length = path.metadata().map_err(|e| DriverError::io(path, e))?.len();
    if length > MAX_METADATA_BYTES {
        return Err(DriverError::malformed(
            path,
            "is far too long for the description of a bag; take it away",
        ));
    }
    std::fs::read_to_string(path).map_err(|e| DriverError::io(path, e))
}

/// The files that a description names, in its order. It is written by one program, whose lines are those of the list;
/// where it looks otherwise nothing is found, and the names in the directory tell the order.
fn described(path: &Path, text: &str) -> Result<Vec<String>, DriverError> {
    let value = |line: &str| line.split_once(':').map(|(_, value)| unquoted(value).to_owned());
    let find = |key: &str| text.lines().find(|line| line.trim_start().starts_with(key)).and_then(value);
    if find("storage_identifier").as_deref() == Some("sqlite3") {
        return Err(DriverError::refused(
            path,
            format!("describes a bag of SQLite, which is not read; {CONVERT}"),
        ));
    }
    if find("compression_mode").is_some_and(|mode| mode.eq_ignore_ascii_case("message")) {
        let message = "describes a bag whose messages are compressed one by one, which is not read; convert it with \
                       `ros2 bag convert` and no compression_mode";
        return Err(DriverError::refused(path, message));
    }
    let lines = text.lines().skip_while(|line| !line.trim_start().starts_with("relative_file_paths")).skip(1);
    let names =
        lines.map_while(|line| line.trim_start().strip_prefix("- ")).map(|name| unquoted(name).to_owned());
    let names: Vec<String> = names.collect();
    if let Some(name) = names.iter().find(|name| !is_plain_name(name)) {
        let message = format!("names '{name}', which leads out of the bag; name files beside it");
        return Err(DriverError::malformed(path, message));
    }
    Ok(names)
}

fn unquoted(text: &str) -> &str {
    text.trim().trim_matches(['"', '\''])
}

fn is_plain_name(name: &str) -> bool {
    let mut parts = Path::new(name).components();
    matches!((parts.next(), parts.next()), (Some(Component::Normal(_)), None))
}

/// The .mcap files of a directory by the numbers at the end of their names, then by name.
fn listed(path: &Path) -> Vec<PathBuf> {
    let Ok(entries) = std::fs::read_dir(path) else { return Vec::new() };
    let mut files: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).collect();
    files.retain(|file| file.extension().is_some_and(|ending| ending == "mcap") && file.is_file());
    files.sort_by_key(|file| (number(file), file.clone()));
    files
}

/// The number at the end of a file's name: bag_10.mcap comes after bag_9.mcap.
fn number(file: &Path) -> u64 {
    let stem = file.file_stem().and_then(OsStr::to_str).unwrap_or_default();
    let digits = stem.len() - stem.trim_end_matches(|c: char| c.is_ascii_digit()).len();
    stem[stem.len() - digits..].parse().unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn directory(files: &[&str], metadata: Option<&str>) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        for file in files {
            std::fs::write(folder.path().join(file), b"").unwrap();
        }
        if let Some(text) = metadata {
            std::fs::write(folder.path().join(METADATA), text).unwrap();
        }
        folder
    }

    fn names(folder: &tempfile::TempDir) -> Vec<String> {
        let files = bag_files(folder.path()).unwrap();
        files.iter().map(|f| f.file_name().unwrap().to_str().unwrap().to_owned()).collect()
    }

    #[test]
    fn the_description_tells_the_order_and_else_the_numbers_do() {
        let text = "rosbag2_bagfile_information:\n  storage_identifier: mcap\n  relative_file_paths:\n    - b_1.mcap\n    - \"b_0.mcap\"\n  duration:\n    nanoseconds: 1\n";
        assert_eq!(names(&directory(&["b_0.mcap", "b_1.mcap"], Some(text))), ["b_1.mcap", "b_0.mcap"]);
        let folder = directory(&["b_10.mcap", "b_9.mcap", "b_0.mcap", "notes.txt"], None);
        assert_eq!(names(&folder), ["b_0.mcap", "b_9.mcap", "b_10.mcap"]);
        assert!(is_bag(folder.path()) && !is_bag(directory(&["a.txt"], None).path()));
    }

    #[test]
    fn bags_of_another_kind_are_refused_with_the_command_that_converts_them() {
        let refusal = |path: &Path| bag_files(path).unwrap_err().to_string();
        let folder = directory(&["a.db3", "b.bag", "c.mcap.zstd"], None);
        for (file, cure) in
            [("a.db3", "ros2 bag convert"), ("b.bag", "rosbags-convert"), ("c.mcap.zstd", "zstd -d")]
        {
            let words = refusal(&folder.path().join(file));
            assert!(words.contains(cure) && words.contains(file), "{words}");
        }
        for (text, cure) in [
            ("storage_identifier: sqlite3\n", "ros2 bag convert"),
            ("compression_mode: MESSAGE\n", "ros2 bag convert"),
            ("relative_file_paths:\n  - ../../etc/passwd\n", "leads out"),
            ("relative_file_paths:\n  - gone_0.mcap\n", "not there"),
            ("relative_file_paths:\n  - old_0.db3\n", "ros2 bag convert"),
        ] {
            let words = refusal(directory(&[], Some(text)).path());
            assert!(words.contains(cure), "{words}");
        }
        assert!(refusal(Path::new("/nowhere.mcap")).contains("does not exist"));
    }
}
