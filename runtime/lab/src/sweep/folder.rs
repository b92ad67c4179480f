//! The data sets of a folder.

use super::SweepError;
use super::published::Suite;
use std::path::{Path, PathBuf};

/// Largest depth of data sets: archives of EuRoC unpack into `machine_hall/MH_01_easy/MH_01_easy/mav0`.
const DEPTH: usize = 4;

/// Data sets below a folder.
#[derive(Debug, Default, PartialEq, Eq)]
pub struct FoundDataSets {
    /// Folders of data sets that can be flown, sorted by name.
    pub data_sets: Vec<PathBuf>,
    /// Folders that are left out, each with the reason.
    pub left_out: Vec<(PathBuf, &'static str)>,
}

/// Looks for data sets in ASL format (EuRoC, TUM-VI) in `folder` and below.
///
/// # Errors
/// When a folder cannot be read, or there is no data set.
pub fn data_sets(folder: &Path) -> Result<FoundDataSets, SweepError> {
    let mut found = FoundDataSets::default();
    search(folder, DEPTH, &mut found)?;
    if found.data_sets.is_empty() {
        return Err(SweepError::NoDataSets { path: folder.to_owned() });
    }
    found.data_sets.sort();
    // A sequence may lie there twice, as a copy in another archive.
    let mut names = Vec::new();
    let (kept, twice): (Vec<PathBuf>, Vec<PathBuf>) = found.data_sets.into_iter().partition(|path| {
        let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default().to_owned();
        let is_new = Suite::of(&name).is_none() || !names.contains(&name);
        names.push(name);
        is_new
    });
    found.data_sets = kept;
    found.left_out.extend(twice.into_iter().map(|path| (path, "a sequence of this name is there already")));
    Ok(found)
}

fn search(folder: &Path, depth: usize, found: &mut FoundDataSets) -> Result<(), SweepError> {
    let holds = |name: &str| folder.join("mav0").join(name).is_dir();
    if folder.join("mav0").is_dir() {
        match (holds("cam0"), holds("imu0")) {
            (true, true) => found.data_sets.push(folder.to_owned()),
            (false, _) => found.left_out.push((folder.to_owned(), "it has no mav0/cam0")),
            (_, false) => found.left_out.push((folder.to_owned(), "it has no mav0/imu0")),
        }
        return Ok(());
    }
    if depth == 0 {
        return Ok(());
    }
    let io = |source| SweepError::Io { path: folder.to_owned(), source };
    for entry in std::fs::read_dir(folder).map_err(io)? {
        let path = entry.map_err(io)?.path();
        if path.is_dir() {
            search(&path, depth - 1, found)?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn data_sets_are_found_however_they_were_unpacked() {
        let folder = tempfile::tempdir().unwrap();
        let make = |path: &str| std::fs::create_dir_all(folder.path().join(path)).unwrap();
        assert!(matches!(data_sets(folder.path()), Err(SweepError::NoDataSets { .. })));
        for set in ["V1_01_easy", "machine_hall/MH_01_easy/MH_01_easy", "copy/V1_01_easy", "a/clip", "b/clip"]
        {
            make(&format!("{set}/mav0/cam0"));
            make(&format!("{set}/mav0/imu0"));
        }
        make("places/mav0/cam0");
        make("notes");
        let found = data_sets(folder.path()).unwrap();
        let names: Vec<&Path> =
            found.data_sets.iter().map(|path| path.strip_prefix(folder.path()).unwrap()).collect();
        let expected =
            ["V1_01_easy", "a/clip", "b/clip", "copy/V1_01_easy", "machine_hall/MH_01_easy/MH_01_easy"];
        let expected: Vec<&Path> =
            expected.iter().filter(|name| **name != "copy/V1_01_easy").map(Path::new).collect();
        assert_eq!(names, expected);
        let left_out: Vec<&str> = found.left_out.iter().map(|(_, why)| *why).collect();
        assert_eq!(left_out, ["it has no mav0/imu0", "a sequence of this name is there already"]);
    }
}
