//! The file under a part: counts what is written, and can be cut back to what is complete.

use super::complete_parts::CompleteParts;
use std::fs::{File, OpenOptions};
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;

/// Period of retries after a failure for want of descriptors or of room.
const RETRY: Duration = Duration::from_millis(100);

/// Medium of a part.
pub trait Medium: Write + Send {
    /// Shortens it to `bytes`.
    ///
    /// # Errors
    /// When the system refuses.
    fn cut(&mut self, bytes: u64) -> io::Result<()>;
    /// Syncer which waits, on another thread, until everything written before is on the medium, the name of the file included.
    ///
    /// # Errors
    /// When the system refuses.
    fn syncer(&self) -> io::Result<Box<dyn Syncer>>;
}

/// Waits for a medium.
pub trait Syncer: Send {
    /// Waits until everything that was written before is on the medium itself.
    ///
    /// # Errors
    /// When the medium fails.
    fn sync(&mut self) -> io::Result<()>;
}

/// A file and the folder that it is in.
struct FileOnDisk {
    file: File,
    folder: PathBuf,
}

impl Write for FileOnDisk {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.file.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

impl Medium for FileOnDisk {
    fn cut(&mut self, bytes: u64) -> io::Result<()> {
        self.file.set_len(bytes)
    }

    fn syncer(&self) -> io::Result<Box<dyn Syncer>> {
        Ok(Box::new(FileSyncer { file: self.file.try_clone()?, folder: Some(self.folder.clone()) }))
    }
}

/// Syncs a file, and the folder that holds its name with it the first time.
struct FileSyncer {
    file: File,
    folder: Option<PathBuf>,
}

impl Syncer for FileSyncer {
    fn sync(&mut self) -> io::Result<()> {
        self.file.sync_data()?;
        if let Some(folder) = &self.folder {
            match File::open(folder) {
                // Removed or moved: the writer notices, and begins another part.
                Err(error) if error.kind() == io::ErrorKind::NotFound => {}
                opened => opened?.sync_all()?,
            }
            self.folder = None;
        }
        Ok(())
    }
}

/// Makes the medium of a path.
type Open = Box<dyn FnMut(&Path) -> io::Result<Box<dyn Medium>> + Send>;

/// Resource that is lacking and that others may give back.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Lack {
    Descriptors,
    Room,
}

impl Lack {
    fn of(error: &io::Error) -> Option<Self> {
        use rustix::io::Errno;
        match (Errno::from_io_error(error), error.kind()) {
            (Some(Errno::MFILE | Errno::NFILE), _) => Some(Self::Descriptors),
            (_, io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded) => Some(Self::Room),
            _ => None,
        }
    }

    fn words(self) -> &'static str {
        match self {
            Self::Descriptors => "there are descriptors again",
            Self::Room => "there is room again",
        }
    }
}

/// Waits until there are descriptors or room again, unless the flight is over: what others have open or have written is no
/// failure of the disk. Where the newest parts are kept, the oldest one makes room first.
#[derive(Clone, Debug, Default)]
pub struct Patience {
    is_over: Arc<AtomicBool>,
    /// A producer that waits for the recorder would wait for room forever.
    waits_for_room: Arc<AtomicBool>,
    room: Option<CompleteParts>,
}

impl Patience {
    /// Ends all waiting, from now on too.
    pub fn end(&self) {
        self.is_over.store(true, Ordering::Relaxed);
    }

    /// From now on a full disk is waited for.
    pub fn wait_for_room(&self) {
        self.waits_for_room.store(true, Ordering::Relaxed);
    }

    fn may_wait_for(&self, lack: Lack) -> bool {
        !self.is_over.load(Ordering::Relaxed)
            && (lack == Lack::Descriptors || self.waits_for_room.load(Ordering::Relaxed))
    }

    /// Deletes the oldest part to make room, and returns true if there was one.
    fn makes_room(&self) -> io::Result<bool> {
        self.room.as_ref().map_or(Ok(false), |room| room.delete_oldest().map_err(|(_, error)| error))
    }

    /// The outcome of `attempt`, as soon as it is not a lack that may pass.
    fn attempt<T>(&self, mut attempt: impl FnMut() -> io::Result<T>) -> io::Result<T> {
        let mut is_told = false;
        loop {
            let outcome = attempt();
            let lack = outcome.as_ref().err().and_then(Lack::of);
            let (Err(error), Some(lack)) = (&outcome, lack) else {
                if is_told && outcome.is_ok() {
                    tracing::warn!("recording resumes");
                }
                return outcome;
            };
            if lack == Lack::Room && self.makes_room()? {
                continue;
            }
            if !self.may_wait_for(lack) {
                return outcome;
            }
            if !std::mem::replace(&mut is_told, true) {
                tracing::warn!("recording is interrupted ({error}); it resumes when {}", lack.words());
            }
            std::thread::sleep(RETRY);
        }
    }
}

/// A medium that is waited for when it is full.
struct Patient {
    medium: Box<dyn Medium>,
    patience: Patience,
}

impl Write for Patient {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let medium = &mut self.medium;
        self.patience.attempt(|| medium.write(bytes))
    }

    fn flush(&mut self) -> io::Result<()> {
        self.medium.flush()
    }
}

/// Opens the parts of a log, one after the other.
pub struct OpenPart {
    open: Open,
    patience: Patience,
    /// Syncer of the part that was opened last, until it is taken.
    newest: Option<Box<dyn Syncer>>,
    position: Arc<AtomicU64>,
}

impl OpenPart {
    /// Opens files, which must not exist.
    pub fn files() -> Self {
        Self::with(|path| {
            let file = OpenOptions::new().write(true).create_new(true).open(path)?;
            let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
            Ok(Box::new(FileOnDisk { file, folder: folder.unwrap_or(Path::new(".")).to_owned() }))
        })
    }

    /// Opens whatever `open` makes of a path.
    pub fn with(open: impl FnMut(&Path) -> io::Result<Box<dyn Medium>> + Send + 'static) -> Self {
        Self { open: Box::new(open), patience: Patience::default(), newest: None, position: Arc::default() }
    }

    /// The parts of this log may make room for what is written.
    pub fn set_room(&mut self, room: CompleteParts) {
        self.patience.room = Some(room);
    }

    /// Opens the part at `path`.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn open(&mut self, path: &Path) -> io::Result<PartFile> {
        let medium = self.patience.attempt(|| (self.open)(path))?;
        self.newest = Some(self.patience.attempt(|| medium.syncer())?);
        let medium = Patient { medium, patience: self.patience.clone() };
        let medium = BufWriter::with_capacity(1 << 16, medium);
        self.position.store(0, Ordering::Relaxed);
        Ok(PartFile { medium, position: Arc::clone(&self.position) })
    }

    /// The patience of this and of all parts.
    pub fn patience(&self) -> Patience {
        self.patience.clone()
    }

    /// Syncer of the part that was opened last; once for each part.
    pub fn take_syncer(&mut self) -> Option<Box<dyn Syncer>> {
        self.newest.take()
    }

    /// Bytes written to the part that was opened last.
    pub fn position(&self) -> u64 {
        self.position.load(Ordering::Relaxed)
    }
}

/// A part on its medium, written from the beginning to the end.
pub struct PartFile {
    medium: BufWriter<Patient>,
    position: Arc<AtomicU64>,
}

impl PartFile {
    /// Writes what is buffered; that it gets to the medium is waited for elsewhere ([`super::sync`]).
    ///
    /// # Errors
    /// When the medium fails.
    pub fn close(mut self) -> io::Result<()> {
        self.medium.flush()
    }

    /// Drops what is buffered and shortens the file to `bytes`; a medium that refuses keeps its length.
    pub fn cut(self, bytes: u64) {
        let (mut medium, _unwritten) = self.medium.into_parts();
        let _ = medium.medium.cut(bytes);
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
