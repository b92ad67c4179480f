//! Beginnings of many tests, such as rendered frames, made by the first of them and kept in files: each test is a process of its
//! own. Files belong to one build of the tests; those of the build before are deleted.

use std::fs::File;
use std::hash::{DefaultHasher, Hash as _, Hasher as _};
use std::path::{Path, PathBuf};
use std::time::UNIX_EPOCH;

/// Folder of the files of this build of the tests that run.
///
/// # Panics
/// When it cannot be made.
pub fn folder() -> PathBuf {
    let tests = std::env::current_exe().expect("the tests have a path");
    let built = tests.metadata().and_then(|data| data.modified()).expect("the tests have a date");
    let built_ns = built.duration_since(UNIX_EPOCH).map_or(0, |since| since.as_nanos());
    let name = tests.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default();
    folder_of(&tests.with_file_name("../tmp/kept"), &name, &built_ns.to_string())
}

/// Folder below `root` of a build of the tests called `name`; those of other builds are deleted when it is made.
fn folder_of(root: &Path, name: &str, build: &str) -> PathBuf {
    let tests = root.join(name);
    let folder = tests.join(build);
    if !folder.is_dir() {
        for before in std::fs::read_dir(&tests).into_iter().flatten().flatten() {
            let _ = std::fs::remove_dir_all(before.path());
        }
        std::fs::create_dir_all(&folder).unwrap_or_else(|error| panic!("{}: {error}", folder.display()));
    }
    folder
}

/// File of what is called `what`, without an ending.
fn file(folder: &Path, what: &str) -> PathBuf {
    let mut hasher = DefaultHasher::new();
    what.hash(&mut hasher);
    folder.join(format!("{:016x}", hasher.finish()))
}

/// Waits until no other test holds the lock called `what`, and holds it until it is dropped.
///
/// # Panics
/// When there can be no such lock.
pub fn alone(what: &str) -> File {
    let lock = File::create(file(&folder(), what).with_extension("lock")).expect("a file for the lock");
    lock.lock().expect("a lock");
    lock
}

/// Bytes called `what`, which `make` makes for the first test that asks.
///
/// # Panics
/// When they cannot be kept.
pub fn once(what: &str, make: impl FnOnce() -> Vec<u8>) -> Vec<u8> {
    let _alone = alone(what);
    let file = file(&folder(), what);
    if let Ok(bytes) = std::fs::read(&file) {
        return bytes;
    }
    let bytes = make();
    let partial = file.with_extension("partial");
    std::fs::write(&partial, &bytes).and_then(|()| std::fs::rename(&partial, &file)).expect("a file is kept");
    bytes
}

/// Does `make` for the first test that calls it `what`.
pub fn done_once(what: &str, make: impl FnOnce()) {
    once(what, || {
        make();
        Vec::new()
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_are_made_once_for_each_name() {
        let name = format!("bytes of {:?}", std::time::SystemTime::now());
        assert_eq!(once(&name, || vec![1, 2, 3]), [1, 2, 3]);
        assert_eq!(once(&name, || panic!("they are there")), [1, 2, 3]);
        assert_eq!(once(&format!("other {name}"), || vec![4]), [4]);
    }

    #[test]
    fn files_of_another_build_are_deleted() {
        let root = tempfile::tempdir().unwrap();
        let first = folder_of(root.path(), "tests-1", "1");
        std::fs::write(first.join("frames"), "old").unwrap();
        let other = folder_of(root.path(), "tests-2", "1");
        let second = folder_of(root.path(), "tests-1", "2");
        assert!(second.is_dir() && other.is_dir() && !first.exists());
        assert_eq!(folder_of(root.path(), "tests-1", "2"), second);
    }
}
