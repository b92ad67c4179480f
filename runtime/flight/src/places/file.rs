//! Map files: read within bounds, written so that there is always a whole one.
//!
//! A map is written beside the old one, brought to the disk, and then takes its name in one step. Whoever is killed
//! in between leaves the old map, and at most a `.partial` file, which the next save replaces.

use super::codec::{MapContents, MapDefect, check_start, decode, encode};
use crate::log::KnownMap;
use plumbline_drivers::open_regular;
use plumbline_estimator::places::MapLimits;
use rustix::fs::{Mode, OFlags};
use sha2::{Digest as _, Sha256};
use std::fs::File;
use std::io::{self, Read as _, Write as _};
use std::path::{Path, PathBuf};

/// Files longer than this are not read, bytes: twice the largest map.
const MAX_FILE_BYTES: u64 = 8 << 30;
/// Length of the header, read first, bytes: it gives the length of the map.
const START_BYTES: u64 = 32;

/// Errors of a map that cannot be read or written.
#[derive(Debug, thiserror::Error)]
pub enum MapFileError {
    /// The file cannot be read.
    #[error("{}: cannot be read ({source}); check the path and its permissions", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// Error of the system.
        source: io::Error,
    },
    /// The file cannot be written.
    #[error("{}: cannot be written ({source}); the previous map is unchanged", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// Error of the system.
        source: io::Error,
    },
    /// The file is no map, or a damaged one.
    #[error("{}: {defect}", path.display())]
    Defect {
        /// The file.
        path: PathBuf,
        /// Defect.
        defect: MapDefect,
    },
}

/// Reads a map.
///
/// # Errors
/// When the file cannot be read, or is no whole, undamaged map.
pub fn read_map(path: &Path) -> Result<MapContents, MapFileError> {
    let bytes = read_bounded(path)?;
    decode(&bytes).map_err(|defect| MapFileError::Defect { path: path.into(), defect })
}

/// The bytes of a file that has the length that its header says: one that claims gigabytes is not read.
fn read_bounded(path: &Path) -> Result<Vec<u8>, MapFileError> {
    let read = |source| MapFileError::Read { path: path.into(), source };
    let file = open_regular(path).map_err(read)?;
    let length = file.metadata().map_err(read)?.len();
    if length > MAX_FILE_BYTES {
        return Err(read(io::Error::new(io::ErrorKind::InvalidInput, "not a file of the size of a map")));
    }
    let mut bytes = Vec::new();
    (&file).take(START_BYTES).read_to_end(&mut bytes).map_err(read)?;
    check_start(&bytes, length).map_err(|defect| MapFileError::Defect { path: path.into(), defect })?;
    bytes.reserve_exact((length as usize).saturating_sub(bytes.len()));
    file.take(length.saturating_sub(START_BYTES)).read_to_end(&mut bytes).map_err(read)?;
    Ok(bytes)
}

/// Reads a map that a flight goes on with, into one of these limits.
///
/// # Errors
/// As [`read_map`].
pub fn read_known_map(path: &Path, limits: MapLimits) -> Result<KnownMap, MapFileError> {
    let bytes = read_bounded(path)?;
    let contents = decode(&bytes).map_err(|defect| MapFileError::Defect { path: path.into(), defect })?;
    let sha256 = Sha256::digest(&bytes).iter().map(|b| format!("{b:02x}")).collect();
    Ok(KnownMap { map: contents.into_map(limits), sha256 })
}

/// Writes a map, replacing one of that name only when it is whole and on the disk.
///
/// # Errors
/// When it cannot be written; the old file is left as it was.
pub fn write_map(path: &Path, map: &MapContents) -> Result<(), MapFileError> {
    let bytes = encode(map);
    write_atomically(path, &bytes).map_err(|source| MapFileError::Write { path: path.into(), source })
}

/// Writes a file, replacing one of that name only when it is whole and on the disk.
///
/// # Errors
/// When it cannot be written; the old file is left as it was.
pub fn write_atomically(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let mut name = path.file_name().ok_or(io::ErrorKind::InvalidInput)?.to_owned();
    name.push(".partial");
    let partial = path.with_file_name(name);
    // A link that somebody has put there is not followed: it is replaced, or in the way.
    let _ = std::fs::remove_file(&partial);
    let mut file = File::create_new(&partial)?;
    file.write_all(bytes)?;
    file.sync_all()?;
    std::fs::rename(&partial, path)?;
    // The new name is on the disk when the directory is.
    let folder = path.parent().filter(|f| !f.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let folder = rustix::fs::open(folder, OFlags::RDONLY | OFlags::DIRECTORY, Mode::empty())?;
    rustix::fs::fsync(folder)?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_save_that_fails_leaves_the_old_map() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("room.map");
        write_map(&path, &MapContents::default()).unwrap();
        // Something else stands where the new map would be written first.
        std::fs::create_dir(folder.path().join("room.map.partial")).unwrap();
        let error = write_map(&path, &MapContents::default()).unwrap_err();
        assert!(error.to_string().contains("room.map"), "{error}");
        assert_eq!(read_map(&path).unwrap(), MapContents::default());
    }

    #[test]
    fn what_is_left_of_a_save_that_was_killed_is_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("room.map");
        std::fs::write(folder.path().join("room.map.partial"), b"PLBMAP\r\nhalf").unwrap();
        write_map(&path, &MapContents::default()).unwrap();
        assert_eq!(read_map(&path).unwrap(), MapContents::default());
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn a_link_in_place_of_the_partial_file_is_not_followed() {
        let folder = tempfile::tempdir().unwrap();
        let (path, other) = (folder.path().join("room.map"), folder.path().join("other"));
        std::fs::write(&other, "kept").unwrap();
        std::os::unix::fs::symlink(&other, folder.path().join("room.map.partial")).unwrap();
        write_map(&path, &MapContents::default()).unwrap();
        assert_eq!(std::fs::read_to_string(&other).unwrap(), "kept");
        assert!(path.symlink_metadata().unwrap().is_file());
    }

    #[test]
    fn a_file_that_claims_gigabytes_is_refused_by_its_header() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("sparse.map");
        let mut file = File::create(&path).unwrap();
        file.write_all(&encode(&MapContents::default())).unwrap();
        // Sparse: it takes no room on the disk, and six gigabytes once it is read.
        file.set_len(6 << 30).unwrap();
        let error = read_map(&path).unwrap_err();
        let is_length = matches!(
            error,
            MapFileError::Defect { defect: MapDefect::Length { found: 6_442_450_944, .. }, .. }
        );
        assert!(is_length, "{error}");
    }

    #[test]
    fn a_folder_and_a_missing_file_are_refused_by_name() {
        let folder = tempfile::tempdir().unwrap();
        for path in [folder.path().to_owned(), folder.path().join("none.map")] {
            let error = read_map(&path).unwrap_err();
            assert!(error.to_string().starts_with(&path.display().to_string()), "{error}");
        }
    }
}
