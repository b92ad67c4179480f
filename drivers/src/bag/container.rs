//! Common ground of the containers of messages: topics, bounds, and the way in which a file is handed to
//! them.

use super::messages::Format;
use crate::DriverError;
use std::io::{self, Cursor, Read};
use std::path::Path;

/// Longest record, chunk or message that is read, bytes: four images of 8192 x 8192 grey pixels.
pub(crate) const MAX_RECORD_BYTES: usize = 256 << 20;
/// Bound on the expansion of compressed data, as a multiple of its length. Images that are not black
/// throughout are far below.
pub(crate) const MAX_EXPANSION: u64 = 1_000;
/// Topics that a bag may have.
pub(crate) const MAX_TOPICS: usize = 4096;
/// Bytes that tell the container of a file.
const MAGIC_BYTES: usize = 16;

/// Description of a topic in a bag.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Topic {
    /// Name, such as /cam0/image_raw.
    pub(crate) name: String,
    /// The type of its messages.
    pub(crate) type_name: String,
    /// Format of its messages; `None` where they cannot be flown with.
    pub(crate) format: Option<Format>,
}

/// Number of a topic among `topics`, to which it is added if it is new: the same topic again in another file has another
/// number there. `None` beyond the bound.
pub(crate) fn number_of(
    topics: &mut Vec<Topic>,
    name: &str,
    type_name: &str,
    encoding: &str,
) -> Option<usize> {
    let format = Format::of(type_name, encoding);
    let known = topics.iter().position(|topic| topic.name == name && topic.format == format);
    if known.is_none() && topics.len() < MAX_TOPICS {
        topics.push(Topic { name: name.to_owned(), type_name: type_name.to_owned(), format });
        return Some(topics.len() - 1);
    }
    known
}

/// Result of reading one step further in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Step {
    /// A message of the topic of this number, in the payload.
    Message(usize, Format),
    End,
    Truncated,
}

/// Bytes of a file from its beginning.
pub(crate) type Input = Box<dyn Read + Send>;

/// First bytes of `input`, and all of it.
pub(crate) fn peeked(path: &Path, mut input: Input) -> Result<(Vec<u8>, Input), DriverError> {
    let mut magic = Vec::new();
    let read = input.by_ref().take(MAGIC_BYTES as u64).read_to_end(&mut magic);
    read.map_err(|e| unreadable(path, e))?;
    Ok((magic.clone(), Box::new(Cursor::new(magic).chain(input))))
}

/// Error for the rest of the file at `path`: its compressed data are damaged, or the system refuses.
pub(crate) fn unreadable(path: &Path, error: io::Error) -> DriverError {
    match error.kind() {
        io::ErrorKind::InvalidData => DriverError::refused(path, error.to_string()),
        _ => DriverError::io(path, error),
    }
}
