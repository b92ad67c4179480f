//! Zstandard around or within a bag, as `ros2 bag record --compression-mode file` or `message` writes it.
//!
//! MCAP files and ROS 1 bags are unpacked while they are read. A database is read at any place, and so is unpacked into a
//! temporary file, which is deleted with the last reader.

use super::container::{Input, MAX_EXPANSION, MAX_RECORD_BYTES, peeked};
use crate::DriverError;
use std::fs::File;
use std::io::{self, Read, Write};
use std::path::Path;
use std::sync::Arc;
use tempfile::TempPath;
use zstd::stream::read::Decoder;

/// First bytes of a frame of Zstandard.
const ZSTD: [u8; 4] = [0x28, 0xb5, 0x2f, 0xfd];
/// Bytes that any message may expand to, however short it is.
const LEAST_BOUND_BYTES: u64 = 1 << 20;

/// True if a file with this beginning is compressed.
pub(crate) fn is_zstd(magic: &[u8]) -> bool {
    magic.starts_with(&ZSTD)
}

/// First bytes of what is compressed in `input`, and all of it.
pub(crate) fn begun_inside(path: &Path, input: Input) -> Result<(Vec<u8>, Input), DriverError> {
    let decoder = Decoder::new(input).map_err(|e| DriverError::io(path, e))?;
    peeked(path, Box::new(Content { inner: decoder, left: bound_bytes(path)? }))
}

/// Replaces a compressed message by its content; by nothing where it is damaged or far too long.
pub(crate) fn unpack_message(payload: &mut Vec<u8>) {
    if !is_zstd(payload) {
        return;
    }
    let bound = LEAST_BOUND_BYTES + (payload.len() as u64).saturating_mul(MAX_EXPANSION);
    let bound = bound.min(MAX_RECORD_BYTES as u64);
    let mut content = Vec::new();
    let unpacked = Decoder::new(payload.as_slice())
        .and_then(|decoder| decoder.take(bound + 1).read_to_end(&mut content));
    if unpacked.is_err() || content.len() as u64 > bound {
        content.clear();
    }
    *payload = content;
}

/// A file that was unpacked; it is deleted when nobody reads it any more.
#[derive(Clone, Debug)]
pub(crate) struct Unpacked(Arc<TempPath>);

impl Unpacked {
    /// Unpacks the file at `path`.
    ///
    /// # Errors
    /// When it is damaged, or there is no room for its content.
    pub(crate) fn of(path: &Path) -> Result<Self, DriverError> {
        let input = File::open(path).map_err(|e| DriverError::io(path, e))?;
        let decoder = Decoder::new(input).map_err(|e| DriverError::io(path, e))?;
        let no_room = |error: &io::Error| {
            let folder = std::env::temp_dir();
            let message = format!(
                "cannot be unpacked into {}: {error}; name a folder with more room in TMPDIR, or unpack it yourself: `zstd -d FILE`",
                folder.display()
            );
            DriverError::missing(path, message)
        };
        let mut file = tempfile::NamedTempFile::with_prefix("plumbline-bag-").map_err(|e| no_room(&e))?;
        let mut content = Content { inner: decoder, left: bound_bytes(path)? };
        let mut buffer = vec![0; 1 << 20];
        loop {
            let count = content.read(&mut buffer).map_err(|e| DriverError::malformed(path, e.to_string()))?;
            if count == 0 {
                break;
            }
            file.write_all(&buffer[..count]).map_err(|e| no_room(&e))?;
        }
        Ok(Self(Arc::new(file.into_temp_path())))
    }

    /// Path of the unpacked content.
    pub(crate) fn path(&self) -> &Path {
        &self.0
    }
}

/// Bound on the expanded size of the file at `path`, bytes.
fn bound_bytes(path: &Path) -> Result<u64, DriverError> {
    let length = path.metadata().map_err(|e| DriverError::io(path, e))?.len();
    Ok((MAX_RECORD_BYTES as u64).saturating_add(length.saturating_mul(MAX_EXPANSION)))
}

/// Content of a compressed file, up to where that breaks off.
struct Content<R> {
    inner: R,
    /// Bytes that may still come.
    left: u64,
}

impl<R: Read> Read for Content<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let refused = |why: &str| {
            let message = format!("cannot be unpacked: {why}; copy it again, or try `zstd -d FILE`");
            io::Error::new(io::ErrorKind::InvalidData, message)
        };
        let count = match self.inner.read(buffer) {
            Err(e) if e.kind() == io::ErrorKind::UnexpectedEof => 0,
            read => read.map_err(|e| refused(&e.to_string()))?,
        };
        let left = self.left.checked_sub(count as u64);
        self.left = left.ok_or_else(|| refused("it expands to far more than a recording has"))?;
        Ok(count)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn packed(bytes: &[u8]) -> Vec<u8> {
        zstd::stream::encode_all(bytes, 3).unwrap()
    }

    #[test]
    fn messages_are_unpacked_and_bombs_and_damage_are_empty() {
        let mut message = packed(b"\0\x01\0\0content");
        unpack_message(&mut message);
        assert_eq!(message, b"\0\x01\0\0content");
        let mut plain = b"\0\x01\0\0content".to_vec();
        unpack_message(&mut plain);
        assert_eq!(plain, b"\0\x01\0\0content");
        let mut bomb = packed(&vec![0; 64 << 20]);
        assert!(bomb.len() < 1 << 14);
        unpack_message(&mut bomb);
        assert!(bomb.is_empty());
        let mut cut = packed(&(0..999).map(|k| (k % 251) as u8).collect::<Vec<_>>());
        cut.truncate(cut.len() / 2);
        unpack_message(&mut cut);
        assert!(cut.is_empty());
    }

    #[test]
    fn a_file_is_unpacked_once_deleted_after_use_and_bounded() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.db3.zstd");
        std::fs::write(&path, packed(b"content")).unwrap();
        let unpacked = Unpacked::of(&path).unwrap();
        let place = unpacked.path().to_owned();
        let other = unpacked.clone();
        drop(unpacked);
        assert_eq!(std::fs::read(&place).unwrap(), b"content");
        drop(other);
        assert!(!place.exists());
        let mut content = Content { inner: &[0_u8; 9][..], left: 8 };
        assert!(content.read_to_end(&mut Vec::new()).unwrap_err().to_string().contains("far more"));
        std::fs::write(&path, [&ZSTD[..], b"no frame"].concat()).unwrap();
        assert!(Unpacked::of(&path).unwrap_err().to_string().contains("a.db3.zstd: cannot be unpacked"));
    }
}
