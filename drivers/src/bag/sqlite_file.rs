//! Messages of a bag in a database of SQLite, the storage of ROS 2 up to Humble.
//!
//! The tables are `topics` (id, name, type, serialization_format) and `messages` (topic_id, timestamp, data). Messages are
//! read by their rows, which is the order in which they were recorded. A file may be anybody's: nothing in it is executed (no
//! views, no triggers, no functions of the schema), rows are bounded, and may not hold more than the file does. It is
//! opened read-only and, unless its recorder left a journal beside it, as one that does not change, so that nothing is
//! written beside it.

use super::container::{MAX_RECORD_BYTES, MAX_TOPICS, Step, Topic, number_of};
use super::messages::Format;
use crate::DriverError;
use rusqlite::config::DbConfig;
use rusqlite::limits::Limit;
use rusqlite::types::ValueRef;
use rusqlite::{Connection, Error, ErrorCode, OpenFlags};
use std::collections::{BTreeMap, VecDeque};
use std::ffi::OsString;
use std::os::unix::ffi::OsStrExt;
use std::path::{Path, PathBuf};

/// First bytes of a database.
const MAGIC: &[u8] = b"SQLite format 3\0";
/// Rows, and bytes of their messages, that are fetched at once.
const BATCH_ROWS: usize = 256;
const BATCH_BYTES: usize = 8 << 20;
/// Cure for a damaged database.
const RECOVER: &str = "copy it again, or save what can be with `sqlite3 FILE .recover | sqlite3 NEW.db3`";

/// One database of a bag.
pub(crate) struct SqliteFile {
    /// Name in messages.
    path: PathBuf,
    database: Connection,
    /// Topics by their numbers in the file; `None` before they are read.
    topics: Option<BTreeMap<i64, usize>>,
    batch: VecDeque<(usize, Format, Vec<u8>)>,
    last_row: i64,
    content_bytes: u64,
    file_bytes: u64,
    /// True if its recorder did not close it.
    is_unfinished: bool,
    is_done: bool,
}

impl SqliteFile {
    /// True if a file with this beginning is an SQLite database.
    pub(crate) fn is_begun_by(magic: &[u8]) -> bool {
        magic.starts_with(MAGIC)
    }

    /// Opens the database at `path`.
    ///
    /// # Errors
    /// When it cannot be read.
    pub(crate) fn open(path: &Path) -> Result<Self, DriverError> {
        let journal_bytes = ["-wal", "-journal"].map(|ending| {
            let mut name = OsString::from(path);
            name.push(ending);
            Path::new(&name).metadata().map_or(0, |metadata| metadata.len())
        });
        let is_unfinished = journal_bytes.iter().any(|bytes| *bytes > 0);
        let length = path.metadata().map_err(|e| DriverError::io(path, e))?.len();
        let database = connect(path, is_unfinished).map_err(|error| in_words(path, &error, is_unfinished))?;
        Ok(Self {
            path: path.to_owned(),
            database,
            topics: None,
            batch: VecDeque::new(),
            last_row: i64::MIN,
            content_bytes: 0,
            file_bytes: journal_bytes.iter().fold(length, |sum, bytes| sum.saturating_add(*bytes)),
            is_unfinished,
            is_done: false,
        })
    }

    /// The next message of a topic that can be flown with, into `payload`; the topics of the file are added to `topics`.
    pub(crate) fn next(
        &mut self,
        topics: &mut Vec<Topic>,
        payload: &mut Vec<u8>,
    ) -> Result<Step, DriverError> {
        if self.topics.is_none() {
            let known = self.read_topics(topics).map_err(|e| in_words(&self.path, &e, self.is_unfinished))?;
            self.topics = Some(known);
        }
        while self.batch.is_empty() && !self.is_done {
            self.fetch(topics)?;
        }
        if let Some((topic, format, content)) = self.batch.pop_front() {
            *payload = content;
            return Ok(Step::Message(topic, format));
        }
        Ok(if self.is_unfinished { Step::Truncated } else { Step::End })
    }

    fn read_topics(&self, topics: &mut Vec<Topic>) -> Result<BTreeMap<i64, usize>, Error> {
        let mut known = BTreeMap::new();
        let tables = "SELECT count(*) FROM sqlite_schema WHERE type = 'table' AND rootpage > 0 AND name IN ('topics', 'messages')";
        if self.database.query_row(tables, [], |row| row.get::<_, i64>(0))? != 2 {
            return Err(Error::InvalidQuery);
        }
        let mut statement =
            self.database.prepare("SELECT id, name, type, serialization_format FROM topics")?;
        let mut rows = statement.query([])?;
        while let Some(row) = rows.next()? {
            let text = |column| row.get::<_, String>(column);
            if known.len() < MAX_TOPICS
                && let Some(topic) = number_of(topics, &text(1)?, &text(2)?, &text(3)?)
            {
                known.insert(row.get(0)?, topic);
            }
        }
        Ok(known)
    }

    /// Fetches the next rows into the batch.
    fn fetch(&mut self, topics: &[Topic]) -> Result<(), DriverError> {
        let known = self.topics.as_ref();
        let wanted: BTreeMap<i64, (usize, Format)> = known
            .into_iter()
            .flatten()
            .filter_map(|(id, topic)| Some((*id, (*topic, topics.get(*topic)?.format?))))
            .collect();
        let rows = match wanted.is_empty() {
            true => Ok(0),
            false => self.fetch_of(&wanted),
        };
        match rows {
            Ok(count) => self.is_done = count == 0,
            Err(Fault::Bomb) => {
                let message = format!("holds more than its own length; {RECOVER}");
                return Err(DriverError::refused(&self.path, message));
            }
            Err(Fault::Sqlite(error)) => return Err(in_words(&self.path, &error, self.is_unfinished)),
        }
        Ok(())
    }

    /// Fetches rows, of `wanted` topics with their content; how many there were.
    fn fetch_of(&mut self, wanted: &BTreeMap<i64, (usize, Format)>) -> Result<usize, Fault> {
        let numbers = wanted.keys().map(i64::to_string).collect::<Vec<_>>().join(",");
        // Contents of other topics are not read.
        let query = format!(
            "SELECT rowid, topic_id, CASE WHEN topic_id IN ({numbers}) THEN data END FROM messages WHERE rowid > ?1 ORDER BY \
             rowid LIMIT {BATCH_ROWS}"
        );
        let mut statement = self.database.prepare(&query)?;
        let mut rows = statement.query([self.last_row])?;
        let (mut count, mut bytes) = (0, 0);
        while bytes < BATCH_BYTES
            && let Some(row) = rows.next()?
        {
            let number = row.get(0)?;
            // Pages that hold each other would go on for ever.
            if number <= self.last_row {
                return Err(Fault::Bomb);
            }
            (self.last_row, count) = (number, count + 1);
            let of = row.get_ref(1)?.as_i64().ok().and_then(|topic| wanted.get(&topic));
            if let Some((topic, format)) = of {
                let content = match row.get_ref(2)? {
                    ValueRef::Blob(content) => content,
                    // Not readable, and counted as such.
                    _ => &[],
                };
                bytes += content.len();
                self.content_bytes += content.len() as u64;
                self.batch.push_back((*topic, *format, content.to_vec()));
            }
            if self.content_bytes > self.file_bytes {
                return Err(Fault::Bomb);
            }
        }
        Ok(count)
    }
}

/// Reason why rows cannot be fetched.
enum Fault {
    Sqlite(Error),
    /// The rows hold more than the file.
    Bomb,
}

impl From<Error> for Fault {
    fn from(error: Error) -> Self {
        Self::Sqlite(error)
    }
}

/// Opens the database at `place` read-only, with all that a schema could do turned off.
fn connect(place: &Path, is_unfinished: bool) -> Result<Connection, Error> {
    let escaped: String = place.as_os_str().as_bytes().iter().map(|byte| escaped(*byte)).collect();
    let constant = if is_unfinished { "" } else { "?immutable=1" };
    let flags =
        OpenFlags::SQLITE_OPEN_READ_ONLY | OpenFlags::SQLITE_OPEN_URI | OpenFlags::SQLITE_OPEN_NO_MUTEX;
    let database = Connection::open_with_flags(format!("file:{escaped}{constant}"), flags)?;
    for (limit, most) in [
        (Limit::SQLITE_LIMIT_LENGTH, MAX_RECORD_BYTES as i32),
        (Limit::SQLITE_LIMIT_SQL_LENGTH, 1 << 17),
        (Limit::SQLITE_LIMIT_COLUMN, 64),
        (Limit::SQLITE_LIMIT_EXPR_DEPTH, 32),
        (Limit::SQLITE_LIMIT_ATTACHED, 0),
        (Limit::SQLITE_LIMIT_WORKER_THREADS, 0),
    ] {
        database.set_limit(limit, most)?;
    }
    for config in [
        DbConfig::SQLITE_DBCONFIG_TRUSTED_SCHEMA,
        DbConfig::SQLITE_DBCONFIG_ENABLE_VIEW,
        DbConfig::SQLITE_DBCONFIG_ENABLE_TRIGGER,
    ] {
        database.set_db_config(config, false)?;
    }
    database.execute_batch("PRAGMA cell_size_check = ON; PRAGMA mmap_size = 0")?;
    Ok(database)
}

/// A byte of a path as it stands in a URI.
fn escaped(byte: u8) -> String {
    match byte {
        b'/' | b'.' | b'-' | b'_' | b'0'..=b'9' | b'a'..=b'z' | b'A'..=b'Z' => char::from(byte).to_string(),
        byte => format!("%{byte:02x}"),
    }
}

/// Error of SQLite as ours, with the cure.
fn in_words(path: &Path, error: &Error, is_unfinished: bool) -> DriverError {
    match error.sqlite_error_code() {
        None if matches!(error, Error::InvalidQuery) => DriverError::refused(
            path,
            "is a database, but no bag: it has no tables `topics` and `messages`; give the .db3 file of `ros2 bag record`",
        ),
        Some(ErrorCode::TooBig) => {
            let message =
                format!("holds a message longer than {} MB; it is no image", MAX_RECORD_BYTES >> 20);
            DriverError::refused(path, message)
        }
        Some(ErrorCode::CannotOpen | ErrorCode::ReadOnly | ErrorCode::DatabaseBusy) if is_unfinished => {
            let message = format!(
                "was not closed by its recorder, and what stands beside it cannot be read: {error}; close the recorder, or open it \
                 once with `sqlite3 FILE 'PRAGMA wal_checkpoint'` in a folder that can be written"
            );
            DriverError::refused(path, message)
        }
        _ => DriverError::refused(path, format!("is a damaged database: {error}; {RECOVER}")),
    }
}
