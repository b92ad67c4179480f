//! The file under a part: counts what is written, and can be cut back to what is complete.

use std::fs::{File, OpenOptions};
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// What a part is written to.
pub trait Medium: Write + Send {
    /// Shortens it to `bytes`.
    ///
    /// # Errors
    /// When the system refuses.
    fn cut(&mut self, bytes: u64) -> io::Result<()>;
    /// Waits until everything is on the medium itself.
    ///
    /// # Errors
    /// When the medium fails.
    fn sync(&mut self) -> io::Result<()>;
}

impl Medium for File {
    fn cut(&mut self, bytes: u64) -> io::Result<()> {
        self.set_len(bytes)
    }

    fn sync(&mut self) -> io::Result<()> {
        self.sync_data()
    }
}

/// Makes the medium of a path.
type Open = Box<dyn FnMut(&Path) -> io::Result<Box<dyn Medium>> + Send>;

/// Opens the parts of a log, one after the other.
pub struct OpenPart {
    open: Open,
    position: Arc<AtomicU64>,
}

impl OpenPart {
    /// Opens files, which must not exist.
    #[must_use]
    pub fn files() -> Self {
        Self::with(|path| {
            let file = OpenOptions::new().write(true).create_new(true).open(path)?;
            Ok(Box::new(file))
        })
    }

    /// Opens whatever `open` makes of a path.
    #[must_use]
    pub fn with(open: impl FnMut(&Path) -> io::Result<Box<dyn Medium>> + Send + 'static) -> Self {
        Self { open: Box::new(open), position: Arc::default() }
    }

    /// Opens the part at `path`.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn open(&mut self, path: &Path) -> io::Result<PartFile> {
        let medium = BufWriter::with_capacity(1 << 16, (self.open)(path)?);
        self.position.store(0, Ordering::Relaxed);
        Ok(PartFile { medium, position: Arc::clone(&self.position) })
    }

    /// Bytes written to the part that was opened last.
    #[must_use]
    pub fn position(&self) -> u64 {
        self.position.load(Ordering::Relaxed)
    }
}

/// A part on its medium, written from the beginning to the end.
pub struct PartFile {
    medium: BufWriter<Box<dyn Medium>>,
    position: Arc<AtomicU64>,
}

impl PartFile {
    /// Writes what is buffered, and waits until it is on the medium.
    ///
    /// # Errors
    /// When the medium fails.
    pub fn close(mut self) -> io::Result<()> {
        self.medium.flush()?;
        self.medium.get_mut().sync()
    }

    /// Drops what is buffered and shortens the file to `bytes`; a medium that refuses keeps its length.
    pub fn cut(self, bytes: u64) {
        let (mut medium, _unwritten) = self.medium.into_parts();
        let _ = medium.cut(bytes);
    }
}

impl Write for PartFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = self.medium.write(bytes)?;
        self.position.fetch_add(written as u64, Ordering::Relaxed);
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.medium.flush()
    }
}

impl Seek for PartFile {
    /// Tells the position; it cannot be changed.
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        match to {
            SeekFrom::Current(0) => Ok(self.position.load(Ordering::Relaxed)),
            _ => Err(io::ErrorKind::Unsupported.into()),
        }
    }
}
