//! Identity of the build that wrote a log: bits are promised for the same sources, on x86-64 and aarch64.

use sha2::{Digest as _, Sha256};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::Read;
use std::sync::OnceLock;

const UNKNOWN: &str = "unknown";
/// Place of a field.
type FieldOf = fn(&mut BuildId) -> &mut String;
/// The fields, by their keys in the metadata of a log.
const FIELDS: [(&str, FieldOf); 7] = [
    ("build.version", |build| &mut build.version),
    ("build.commit", |build| &mut build.commit),
    ("build.target", |build| &mut build.target),
    ("build.features", |build| &mut build.features),
    ("build.rustc", |build| &mut build.rustc),
    ("build.executable_sha256", |build| &mut build.executable),
    ("build.processor", |build| &mut build.processor),
];

/// A build, and the machine it runs on.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct BuildId {
    /// Version of the package.
    pub version: String,
    /// Commit of the sources, where it was known.
    pub commit: String,
    /// Target triple.
    pub target: String,
    /// Target features.
    pub features: String,
    /// Version of the compiler.
    pub rustc: String,
    /// SHA-256 of the executable file.
    pub executable: String,
    /// Model of the processor.
    pub processor: String,
}

impl BuildId {
    /// Returns the build of this process. The first call reads the executable.
    pub fn current() -> &'static Self {
        static CURRENT: OnceLock<BuildId> = OnceLock::new();
        CURRENT.get_or_init(|| Self {
            version: env!("CARGO_PKG_VERSION").into(),
            commit: env!("PLUMBLINE_COMMIT").into(),
            target: env!("PLUMBLINE_TARGET").into(),
            features: env!("PLUMBLINE_TARGET_FEATURES").into(),
            rustc: env!("PLUMBLINE_RUSTC").into(),
            executable: executable_hash().unwrap_or_else(|| UNKNOWN.into()),
            processor: processor().unwrap_or_else(|| UNKNOWN.into()),
        })
    }

    /// True if both are the same executable; false if either is unknown.
    pub fn is_same_executable(&self, other: &Self) -> bool {
        self.executable == other.executable && self.executable != UNKNOWN
    }

    /// Adds it to the metadata of a log.
    pub fn write(&self, into: &mut BTreeMap<String, String>) {
        let mut build = self.clone();
        into.extend(FIELDS.map(|(key, field)| (key.to_owned(), std::mem::take(field(&mut build)))));
    }

    /// From the metadata of a log; what is missing is unknown.
    pub fn read(from: &BTreeMap<String, String>) -> Self {
        let mut build = Self::default();
        for (key, field) in FIELDS {
            *field(&mut build) = from.get(key).cloned().unwrap_or_else(|| UNKNOWN.into());
        }
        build
    }
}

fn executable_hash() -> Option<String> {
    let mut file = File::open("/proc/self/exe").ok()?;
    let (mut hash, mut block) = (Sha256::new(), vec![0; 1 << 20]);
    loop {
        match file.read(&mut block).ok()? {
            0 => break,
            read => hash.update(&block[..read]),
        }
    }
    Some(hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect())
}

fn processor() -> Option<String> {
    let text = std::fs::read_to_string("/proc/cpuinfo").ok()?;
    let line = text.lines().find(|line| line.starts_with("model name") || line.starts_with("Model"))?;
    Some(line.split_once(':')?.1.trim().to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_build_comes_back_from_the_metadata() {
        let mut metadata = BTreeMap::new();
        BuildId::current().write(&mut metadata);
        let back = BuildId::read(&metadata);
        assert_eq!(&back, BuildId::current());
        assert!(back.is_same_executable(BuildId::current()));
        assert!(back.rustc.starts_with("rustc ") && back.executable.len() == 64, "{back:?}");
        let unknown = BuildId::read(&BTreeMap::new());
        assert!(!unknown.is_same_executable(&unknown));
    }
}
