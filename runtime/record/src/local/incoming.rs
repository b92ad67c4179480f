//! Bytes of a flight on their way to records, however they are cut.

use super::record::{Header, MAX_RECORD_BYTES, TooLong};

/// Bytes that there is room for before the first record.
const FIRST_BYTES: usize = 64 * 1024;

/// Records in the bytes that a flight sends. Memory grows with what came, not with what was announced.
#[derive(Debug)]
pub struct Incoming {
    bytes: Vec<u8>,
    /// Bytes of records that were handed out.
    taken: usize,
    filled: usize,
    /// Content of the record that was handed out last.
    content: std::ops::Range<usize>,
}

impl Default for Incoming {
    fn default() -> Self {
        Self { bytes: vec![0; FIRST_BYTES], taken: 0, filled: 0, content: 0..0 }
    }
}

impl Incoming {
    /// Memory for the next bytes; never empty. The content of the last record is lost.
    pub fn room(&mut self) -> &mut [u8] {
        if self.taken > 0 {
            self.bytes.copy_within(self.taken..self.filled, 0);
            self.filled -= self.taken;
        }
        (self.taken, self.content) = (0, 0..0);
        if self.filled == self.bytes.len() {
            self.bytes.resize(2 * self.filled, 0);
        }
        &mut self.bytes[self.filled..]
    }

    /// Counts the first `count` bytes of the room as filled.
    pub fn add(&mut self, count: usize) {
        self.filled = (self.filled + count).min(self.bytes.len());
    }

    /// Takes the next whole record; `None` until more bytes came. Its content is that of [`Self::content`].
    ///
    /// # Errors
    /// When its length is beyond bounds: nothing after it can be understood.
    pub fn next_header(&mut self) -> Result<Option<Header>, TooLong> {
        let begin = self.taken + Header::BYTES;
        let Some((header, rest)) = self.bytes[self.taken..self.filled].split_first_chunk() else {
            return Ok(None);
        };
        let header = Header::decode(header);
        let length = header.length as usize;
        if length > MAX_RECORD_BYTES {
            return Err(TooLong);
        }
        if rest.len() < length {
            return Ok(None);
        }
        self.content = begin..begin + length;
        self.taken = self.content.end;
        Ok(Some(header))
    }

    /// Content of the record that [`Self::next_header`] took last, until the next call for room.
    pub fn content(&self) -> &[u8] {
        &self.bytes[self.content.clone()]
    }
}

#[cfg(test)]
mod tests {
    use super::super::record::encoded;
    use super::*;

    fn received(bytes: &[u8], piece: usize) -> Result<Vec<(Header, Vec<u8>)>, TooLong> {
        let (mut incoming, mut got) = (Incoming::default(), Vec::new());
        for mut piece in bytes.chunks(piece) {
            while !piece.is_empty() {
                let room = incoming.room();
                let count = room.len().min(piece.len());
                room[..count].copy_from_slice(&piece[..count]);
                incoming.add(count);
                piece = &piece[count..];
                while let Some(header) = incoming.next_header()? {
                    got.push((header, incoming.content().to_vec()));
                }
            }
        }
        Ok(got)
    }

    #[test]
    fn records_come_back_however_they_are_cut_and_however_long_they_are() {
        let contents = [0usize, 7, 504, 3 * FIRST_BYTES, 1];
        let bytes: Vec<u8> = (1..)
            .zip(contents)
            .flat_map(|(k, length)| encoded(16, k, |to| to.resize(16 + length, 5)))
            .collect();
        for piece in [1, 33, 70_000] {
            let got = received(&bytes, piece).unwrap();
            let lengths: Vec<usize> = got.iter().map(|(_, content)| content.len()).collect();
            assert_eq!(lengths, contents);
            assert!(got.iter().all(|(header, content)| header.length as usize == content.len()));
            assert!(got.iter().flat_map(|(_, content)| content).all(|byte| *byte == 5));
        }
    }

    #[test]
    fn a_record_longer_than_any_is_refused_before_its_content_comes() {
        let header = Header { kind: 16, version: 1, length: MAX_RECORD_BYTES as u32 + 1, sequence: 1 };
        assert_eq!(received(&header.encode(), 16), Err(TooLong));
    }
}
