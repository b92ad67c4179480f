//! The files of a bag in their order: one file, or the directory that `ros2 bag record` makes.

use crate::DriverError;
use crate::bag_name::{METADATA, listed, parts_of};
use crate::euroc::pairing::is_plain_name;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// Longest description that is read, bytes.
const MAX_METADATA_BYTES: u64 = 4 << 20;
/// The files of the bag at `path`.
///
/// # Errors
/// When there are none, or it is not plain which they are.
pub(crate) fn bag_files(path: &Path) -> Result<Vec<PathBuf>, DriverError> {
    if !path.exists() {
        return Err(DriverError::refused(
            path,
            "does not exist; give a ROS bag: a file (.mcap, .db3, .bag) or the directory of a recording",
        ));
    }
    let files = if path.is_dir() { files_of_directory(path)? } else { vec![path.to_owned()] };
    match files.iter().find(|file| !file.is_file()) {
        Some(file) => {
            let message = "is named in metadata.yaml and is not there; copy the whole bag";
            Err(DriverError::refused(file, message))
        }
        None => Ok(files),
    }
}

fn files_of_directory(path: &Path) -> Result<Vec<PathBuf>, DriverError> {
    let metadata = path.join(METADATA);
    let named = match metadata.is_file() {
        true => described(&metadata, &read_bounded(&metadata)?)?,
        false => Vec::new(),
    };
    let files: Vec<PathBuf> = match named.is_empty() {
        true => parts_of_one(path, listed(path))?,
        false => named.iter().map(|name| path.join(name)).collect(),
    };
    if files.is_empty() {
        return Err(DriverError::refused(
            path,
            "holds no file of a bag (.mcap, .db3, .bag); give the directory of a recording",
        ));
    }
    Ok(files)
}

fn read_bounded(path: &Path) -> Result<String, DriverError> {
    let length = path.metadata().map_err(|e| DriverError::io(path, e))?.len();
    if length > MAX_METADATA_BYTES {
        return Err(DriverError::refused(path, "is far too long for the description of a bag; take it away"));
    }
    std::fs::read_to_string(path).map_err(|e| DriverError::io(path, e))
}

/// The files that a description names, in its order. It is written by one program, whose lines are those of the list;
/// where it looks otherwise nothing is found, and the names in the directory tell the order.
fn described(path: &Path, text: &str) -> Result<Vec<String>, DriverError> {
    let lines = text.lines().skip_while(|line| !line.trim_start().starts_with("relative_file_paths")).skip(1);
    let names =
        lines.map_while(|line| line.trim_start().strip_prefix("- ")).map(|name| unquoted(name).to_owned());
    let names: Vec<String> = names.collect();
    if let Some(name) = names.iter().find(|name| !is_plain_name(name)) {
        let message = format!("names '{name}', which leads out of the bag; name files beside it");
        return Err(DriverError::refused(path, message));
    }
    Ok(names)
}

fn unquoted(text: &str) -> &str {
    text.trim().trim_matches(['"', '\''])
}

/// `files`, if they are the parts of one recording: their names differ by a number only.
fn parts_of_one(path: &Path, files: Vec<PathBuf>) -> Result<Vec<PathBuf>, DriverError> {
    let recording =
        |file: &PathBuf| parts_of(file).map(|(base, _, ending)| (base.to_owned(), ending.to_owned()));
    match files.iter().map(recording).collect::<BTreeSet<_>>().len() {
        0 | 1 => Ok(files),
        count => {
            let message = format!("holds {count} bags of different names; name one of them");
            Err(DriverError::refused(path, message))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bag_name::is_bag;

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
        let files = files_of_directory(folder.path()).unwrap();
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
    fn parts_of_any_kind_are_in_order_and_two_recordings_are_refused() {
        for ending in ["db3", "bag", "db3.zstd"] {
            let [tenth, second] = [10, 2].map(|k| format!("r_{k}.{ending}"));
            assert_eq!(names(&directory(&[&tenth, &second], None)), [second.as_str(), &tenth]);
        }
        let folder = directory(&["MH_01_easy.bag", "MH_02_easy.bag"], None);
        let words = bag_files(folder.path()).unwrap_err().to_string();
        assert!(words.contains("2 bags of different names"), "{words}");
        assert!(["a.db3", "b.bag", "c.bag.active", "d.mcap.zstd"].iter().all(|name| is_bag(Path::new(name))));
        assert!(!is_bag(Path::new("a.zstd")));
    }

    #[test]
    fn descriptions_that_lead_elsewhere_are_refused() {
        for (text, cure) in [
            ("relative_file_paths:\n  - ../../etc/passwd\n", "leads out"),
            ("relative_file_paths:\n  - gone_0.mcap\n", "not there"),
        ] {
            let words = bag_files(directory(&[], Some(text)).path()).unwrap_err().to_string();
            assert!(words.contains(cure), "{words}");
        }
        assert!(bag_files(Path::new("/nowhere.mcap")).unwrap_err().to_string().contains("does not exist"));
    }
}
