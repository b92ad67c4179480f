//! Bytes in, frames out: one layer for all protocols.
//!
//! Bytes come in any pieces, with noise between, in and instead of frames. A [`Protocol`](super::protocol::Protocol) says
//! of the bytes at hand whether a frame begins with them; what is none is passed over and counted, one byte at a time
//! where a frame may still begin within. So a frame that was not hit itself is found, whatever stands before it. Memory is
//! of fixed size: a frame longer than [`LONGEST`] is refused before it is there.

use crate::inertial::FramingFigures;

/// The longest frame of any protocol, bytes.
pub const LONGEST: usize = 1024;
/// Bytes that are held: what a line at 4 Mbaud brings in 10 ms, and the rest of a frame.
const CAPACITY: usize = 4096 + LONGEST;

/// Beginning of the bytes at hand.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scan {
    /// Complete frame of this many bytes, with the right checksum.
    Frame(usize),
    /// Possible beginning of a frame: more bytes are needed.
    More,
    /// Number of leading bytes that cannot start a frame.
    Noise(usize),
    /// Number of bytes of a frame with a wrong checksum.
    BadChecksum(usize),
    /// Number of bytes of a header with an impossible length.
    BadLength(usize),
}

/// Puts frames together. Allocates at its construction alone.
#[derive(Debug)]
pub struct Deframer {
    bytes: Box<[u8]>,
    /// Start of the bytes not yet scanned.
    from: usize,
    to: usize,
    figures: FramingFigures,
}

impl Default for Deframer {
    fn default() -> Self {
        Self { bytes: vec![0; CAPACITY].into(), from: 0, to: 0, figures: FramingFigures::default() }
    }
}

impl Deframer {
    /// Forgets bytes of a line that is no more.
    pub fn clear(&mut self) {
        (self.from, self.to) = (0, 0);
    }

    /// Space for the next bytes; never empty once [`Self::next`] has found nothing more.
    pub fn space(&mut self) -> &mut [u8] {
        self.bytes.copy_within(self.from..self.to, 0);
        (self.from, self.to) = (0, self.to - self.from);
        &mut self.bytes[self.to..]
    }

    /// Registers `count` bytes that were written to [`Self::space`].
    pub fn advance(&mut self, count: usize) {
        let count = count.min(self.bytes.len() - self.to);
        self.to += count;
        self.figures.bytes += count as u64;
    }

    /// The next frame, as `scan` sees it.
    pub fn next(&mut self, scan: impl Fn(&[u8]) -> Scan) -> Option<&[u8]> {
        while self.from < self.to {
            let unread = &self.bytes[self.from..self.to];
            let limited = |count: usize| count.clamp(1, unread.len());
            match scan(unread) {
                Scan::Frame(length) => {
                    let frame = self.from..self.from + limited(length);
                    self.from = frame.end;
                    self.figures.frames += 1;
                    return Some(&self.bytes[frame]);
                }
                Scan::More if unread.len() < LONGEST => return None,
                Scan::More => self.pass_over(1),
                Scan::Noise(count) => self.pass_over(limited(count)),
                Scan::BadChecksum(count) => {
                    self.figures.bad_checksums += 1;
                    self.pass_over(limited(count));
                }
                Scan::BadLength(count) => {
                    self.figures.bad_lengths += 1;
                    self.pass_over(limited(count));
                }
            }
        }
        None
    }

    /// Counts of received bytes and frames so far.
    pub fn figures(&self) -> FramingFigures {
        self.figures
    }

    fn pass_over(&mut self, count: usize) {
        self.from += count;
        self.figures.passed_over += count as u64;
    }
}

/// Bytes before the first that is one of `marks`, which frames begin with.
pub(super) fn before_any(bytes: &[u8], marks: &[u8]) -> usize {
    bytes.iter().position(|byte| marks.contains(byte)).unwrap_or(bytes.len())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Frames of `#`, the length of what follows, that many bytes, and their sum.
    fn scan(bytes: &[u8]) -> Scan {
        match bytes {
            [b'#', length, ..] if *length > 100 => Scan::BadLength(1),
            [b'#', length, rest @ ..] => match rest.get(..=usize::from(*length)) {
                None => Scan::More,
                Some(rest) => {
                    let (sum, content) = rest.split_last().unwrap();
                    match content.iter().fold(0_u8, |a, b| a.wrapping_add(*b)) == *sum {
                        true => Scan::Frame(rest.len() + 2),
                        false => Scan::BadChecksum(1),
                    }
                }
            },
            [b'#'] => Scan::More,
            _ => Scan::Noise(before_any(bytes, b"#")),
        }
    }

    fn frame(content: &[u8]) -> Vec<u8> {
        let sum = content.iter().fold(0_u8, |a, b| a.wrapping_add(*b));
        [&[b'#', content.len() as u8], content, &[sum]].concat()
    }

    /// Frames of a stream that comes in pieces of at most `piece` bytes.
    fn all(deframer: &mut Deframer, stream: &[u8], piece: usize) -> Vec<Vec<u8>> {
        let mut found = Vec::new();
        for piece in stream.chunks(piece) {
            let mut left = piece;
            while !left.is_empty() {
                let space = deframer.space();
                let count = left.len().min(space.len());
                space[..count].copy_from_slice(&left[..count]);
                deframer.advance(count);
                left = &left[count..];
                while let Some(frame) = deframer.next(scan) {
                    found.push(frame.to_vec());
                }
            }
        }
        found
    }

    #[test]
    fn a_frame_within_what_only_began_like_one_is_found() {
        let stream = [&b"#\x20"[..], &frame(b"within"), &[0; 64]].concat();
        assert_eq!(all(&mut Deframer::default(), &stream, 7), [frame(b"within")]);
    }

    #[test]
    fn a_protocol_that_always_wants_more_fills_no_memory() {
        let mut deframer = Deframer::default();
        for _ in 0..1000 {
            let count = deframer.space().len();
            assert!(count > 0);
            deframer.advance(count);
            assert!(deframer.next(|_| Scan::More).is_none());
        }
        assert!(deframer.figures().passed_over > 1_000_000);
    }

    proptest! {
        #[test]
        fn frames_are_the_same_however_the_bytes_are_cut(
            parts in prop::collection::vec((any::<bool>(), prop::collection::vec(any::<u8>(), 0..60)), 0..40),
            piece in 1_usize..300,
        ) {
            let stream: Vec<u8> =
                parts.iter().flat_map(|(is_frame, c)| if *is_frame { frame(c) } else { c.clone() }).collect();
            let (mut whole, mut cut) = (Deframer::default(), Deframer::default());
            let found = all(&mut whole, &stream, usize::MAX);
            prop_assert_eq!(&all(&mut cut, &stream, piece), &found);
            prop_assert_eq!(cut.figures(), whole.figures());
            let in_frames: usize = found.iter().map(Vec::len).sum();
            prop_assert!(cut.figures().passed_over + in_frames as u64 <= stream.len() as u64);
        }
    }
}
