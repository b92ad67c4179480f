//! Text files that may hold anything: packed or not, with lines of bounded length.

use flate2::read::MultiGzDecoder;
use std::io::{self, BufRead, Read};

/// First bytes of a gzip file.
const GZIP_MAGIC: [u8; 2] = [0x1f, 0x8b];
/// A line that is longer than this has no end: a gzip of some megabytes may hold one of gigabytes.
const MAX_LINE_BYTES: usize = 16 << 20;

/// The content of a text file, plain or gzip.
pub(crate) fn unpacked<'a>(mut reader: impl BufRead + 'a) -> io::Result<Box<dyn Read + 'a>> {
    let is_packed = reader.fill_buf()?.starts_with(&GZIP_MAGIC);
    Ok(if is_packed { Box::new(MultiGzDecoder::new(reader)) } else { Box::new(reader) })
}

/// Passes text on until a line has no end.
pub(crate) struct BoundedLines<R> {
    reader: R,
    since_end: usize,
}

impl<R: Read> BoundedLines<R> {
    /// Lines of `reader`.
    pub(crate) fn new(reader: R) -> Self {
        Self { reader, since_end: 0 }
    }
}

impl<R: Read> Read for BoundedLines<R> {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        let count = self.reader.read(into)?;
        self.since_end = match into[..count].iter().rposition(|byte| *byte == b'\n') {
            Some(at) => count - at - 1,
            None => self.since_end + count,
        };
        if self.since_end > MAX_LINE_BYTES {
            return Err(io::Error::new(io::ErrorKind::InvalidData, "a line has no end; is it a text file?"));
        }
        Ok(count)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_without_end_is_given_up_and_long_lines_are_not() {
        let error = io::copy(&mut BoundedLines::new(io::repeat(0)), &mut io::sink()).unwrap_err();
        assert!(error.to_string().contains("no end"), "{error}");
        let lines = [vec![b'x'; 1 << 20], vec![b'\n']].concat().repeat(20);
        let copied = io::copy(&mut BoundedLines::new(&lines[..]), &mut io::sink()).unwrap();
        assert_eq!(copied, lines.len() as u64);
    }
}
