//! Lines of a text file that may hold anything: bounded in length, any bytes, any line ends.

use std::io::{self, BufRead};

/// Longest line that is still looked at; a row of any known format is below 500 bytes.
const MAX_LINE_BYTES: usize = 4096;
/// A line that is longer than this has no end: a gzip of some megabytes may hold one of gigabytes.
const MAX_SKIPPED_BYTES: usize = 16 << 20;

/// One line of the file, without its end.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum Line<'a> {
    /// Text, trimmed of white space on both sides (and of a byte order mark).
    Text(&'a str),
    /// Longer than any row can be, or not UTF-8.
    Unreadable,
}

/// Reads line by line into one buffer of bounded size.
pub(crate) struct Lines<R> {
    reader: R,
    buffer: Vec<u8>,
}

impl<R: BufRead> Lines<R> {
    /// Lines of `reader`.
    pub(crate) fn new(reader: R) -> Self {
        Self { reader, buffer: Vec::with_capacity(MAX_LINE_BYTES) }
    }

    /// The next line, or `None` at the end of the file.
    pub(crate) fn next_line(&mut self) -> io::Result<Option<Line<'_>>> {
        self.buffer.clear();
        let (mut read_any, mut overflow, mut skipped) = (false, false, 0_usize);
        loop {
            let chunk = match self.reader.fill_buf() {
                Ok(chunk) => chunk,
                Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
                Err(error) => return Err(error),
            };
            if chunk.is_empty() {
                break;
            }
            read_any = true;
            let end = chunk.iter().position(|&byte| byte == b'\n');
            let body = &chunk[..end.unwrap_or(chunk.len())];
            let room = MAX_LINE_BYTES - self.buffer.len();
            overflow |= body.len() > room;
            self.buffer.extend_from_slice(&body[..body.len().min(room)]);
            let used = end.map_or(chunk.len(), |at| at + 1);
            self.reader.consume(used);
            skipped += used;
            if end.is_some() {
                break;
            }
            if skipped > MAX_SKIPPED_BYTES {
                return Err(io::Error::new(
                    io::ErrorKind::InvalidData,
                    "a line has no end; is it a text file?",
                ));
            }
        }
        if !read_any {
            return Ok(None);
        }
        Ok(Some(match std::str::from_utf8(&self.buffer) {
            Ok(text) if !overflow => Line::Text(text.trim_start_matches('\u{feff}').trim()),
            _ => Line::Unreadable,
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn any_line_end_will_do() {
        let mut lines = Lines::new(&b"\xef\xbb\xbfa,b \r\n\n  c"[..]);
        assert_eq!(lines.next_line().unwrap(), Some(Line::Text("a,b")));
        assert_eq!(lines.next_line().unwrap(), Some(Line::Text("")));
        assert_eq!(lines.next_line().unwrap(), Some(Line::Text("c")));
        assert_eq!(lines.next_line().unwrap(), None);
    }

    #[test]
    fn huge_and_binary_lines_are_skipped_in_bounded_memory() {
        let mut bytes = vec![b'x'; 10 * MAX_LINE_BYTES];
        bytes.extend_from_slice(b"\nok\n\xff\xfe\n");
        let mut lines = Lines::new(&bytes[..]);
        assert_eq!(lines.next_line().unwrap(), Some(Line::Unreadable));
        assert_eq!(lines.next_line().unwrap(), Some(Line::Text("ok")));
        assert_eq!(lines.next_line().unwrap(), Some(Line::Unreadable));
        assert_eq!(lines.next_line().unwrap(), None);
        assert_eq!(lines.buffer.capacity(), MAX_LINE_BYTES);
    }

    #[test]
    fn a_line_without_end_is_given_up() {
        let mut lines = Lines::new(io::BufReader::new(io::repeat(0)));
        let error = lines.next_line().unwrap_err();
        assert!(error.to_string().contains("no end"), "{error}");
    }
}
