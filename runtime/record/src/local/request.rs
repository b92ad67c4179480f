//! Requests of a reader, and their answers.

use super::record::{Header, Kind, Kinds, TooLong, encoded};
use plumbline_config::Timestamp;
use plumbline_estimator::ResetKind;

/// Longest content of a request, bytes.
pub const MAX_REQUEST_BYTES: usize = 512;
/// Longest text of an answer or report, bytes.
pub const MAX_WORDS: usize = 400;

/// Longest wait for an instant, ms.
pub const MAX_PATIENCE_MS: u32 = 2_000;

/// Numbers of the requests.
mod number {
    pub const SUBSCRIBE: u16 = 1;
    pub const RESET: u16 = 2;
    pub const SAVE_MAP: u16 = 3;
    pub const WATCH: u16 = 4;
    pub const AT: u16 = 5;
    pub const READY: u16 = 16;
    pub const FAILED: u16 = 17;
    pub const ALIVE: u16 = 18;
}

/// Request of a reader.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Request {
    /// Kinds of records to send from now on.
    Subscribe(Kinds),
    /// Reset of the estimator, before the next frame.
    Reset(ResetKind),
    /// Map to be written to its file.
    SaveMap,
    /// Camera pictures at this rate, mHz; zero for none any more.
    Watch(u32),
    /// State at an instant.
    At(At),
    /// Network process only: others can reach the vehicle.
    Ready,
    /// Network process only: it cannot start.
    Failed(Failure),
    /// Network process only: sign of life.
    Alive,
}

/// Request of the state at an instant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct At {
    /// The instant, on the clock of the odometry.
    pub stamp: Timestamp,
    /// Longest time that the flight may wait for the instant, ms, at most [`MAX_PATIENCE_MS`].
    pub patience_ms: u32,
    /// True if the flight is to wait up to `patience_ms` for the estimate after the instant.
    pub is_settled: bool,
}

/// Why the network process cannot start.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Failure {
    /// True if another attempt with the same configuration cannot succeed.
    pub is_usage: bool,
    /// Reason, as text.
    pub words: String,
}

/// A request as it came.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Numbered {
    /// Number that the reader gave it.
    pub number: u64,
    /// Request; `None` where the kind is unknown or the content does not fit it.
    pub request: Option<Request>,
}

impl Request {
    /// Bytes of the request under this number.
    pub fn encode(&self, number: u64) -> Vec<u8> {
        let kind = match self {
            Self::Subscribe(_) => number::SUBSCRIBE,
            Self::Reset(_) => number::RESET,
            Self::SaveMap => number::SAVE_MAP,
            Self::Watch(_) => number::WATCH,
            Self::At(_) => number::AT,
            Self::Ready => number::READY,
            Self::Failed(_) => number::FAILED,
            Self::Alive => number::ALIVE,
        };
        encoded(kind, number, |to| match self {
            Self::Subscribe(kinds) => to.extend(kinds.mask().to_le_bytes()),
            Self::Reset(ResetKind::Soft) => to.extend(1u32.to_le_bytes()),
            Self::Reset(ResetKind::Hard) => to.extend(2u32.to_le_bytes()),
            Self::Watch(mhz) => to.extend(mhz.to_le_bytes()),
            Self::At(at) => {
                to.extend(at.stamp.as_nanos().to_le_bytes());
                to.extend(at.patience_ms.to_le_bytes());
                to.extend(u32::from(at.is_settled).to_le_bytes());
            }
            Self::Failed(failure) => {
                to.extend(u32::from(failure.is_usage).to_le_bytes());
                to.extend(shortened(&failure.words).bytes());
            }
            Self::SaveMap | Self::Ready | Self::Alive => {}
        })
    }

    fn decode(kind: u16, content: &[u8]) -> Option<Self> {
        let word = || content.try_into().ok().map(u32::from_le_bytes);
        let is_empty = content.is_empty();
        match kind {
            number::SUBSCRIBE => {
                let mask = u64::from_le_bytes(content.try_into().ok()?);
                Some(Self::Subscribe(Kinds::of_mask(mask)))
            }
            number::RESET => match word()? {
                1 => Some(Self::Reset(ResetKind::Soft)),
                2 => Some(Self::Reset(ResetKind::Hard)),
                _ => None,
            },
            number::SAVE_MAP => is_empty.then_some(Self::SaveMap),
            number::WATCH => word().map(Self::Watch),
            number::AT => {
                let (stamp, rest) = content.split_first_chunk::<8>()?;
                let (patience, flags) = rest.split_first_chunk::<4>()?;
                let is_settled = match u32::from_le_bytes(flags.try_into().ok()?) {
                    0 => false,
                    1 => true,
                    _ => return None,
                };
                let patience_ms = u32::from_le_bytes(*patience);
                let stamp = Timestamp::from_nanos(i64::from_le_bytes(*stamp));
                (patience_ms <= MAX_PATIENCE_MS).then_some(Self::At(At { stamp, patience_ms, is_settled }))
            }
            number::READY => is_empty.then_some(Self::Ready),
            number::ALIVE => is_empty.then_some(Self::Alive),
            number::FAILED => {
                let (is_usage, words) = content.split_first_chunk::<4>()?;
                let words = String::from_utf8_lossy(words).into_owned();
                Some(Self::Failed(Failure { is_usage: *is_usage != [0; 4], words }))
            }
            _ => None,
        }
    }
}

/// Text cut to [`MAX_WORDS`], at a boundary of characters.
fn shortened(words: &str) -> &str {
    &words[..words.floor_char_boundary(MAX_WORDS)]
}

/// Bytes of a reader on their way to requests, in memory of fixed size.
#[derive(Debug)]
pub struct Inbox {
    bytes: [u8; Header::BYTES + MAX_REQUEST_BYTES],
    filled: usize,
}

impl Default for Inbox {
    fn default() -> Self {
        Self { bytes: [0; Header::BYTES + MAX_REQUEST_BYTES], filled: 0 }
    }
}

impl Inbox {
    /// Memory for the next bytes; never empty after [`Self::next_request`] has given all that is there.
    pub fn room(&mut self) -> &mut [u8] {
        &mut self.bytes[self.filled..]
    }

    /// The first `count` bytes of the room were filled.
    pub fn add(&mut self, count: usize) {
        self.filled = (self.filled + count).min(self.bytes.len());
    }

    /// Takes the next whole request.
    ///
    /// # Errors
    /// When its length is beyond bounds: nothing after it can be understood.
    pub fn next_request(&mut self) -> Result<Option<Numbered>, TooLong> {
        let Some((header, rest)) = self.bytes[..self.filled].split_first_chunk() else { return Ok(None) };
        let header = Header::decode(header);
        let length = header.length as usize;
        if length > MAX_REQUEST_BYTES {
            return Err(TooLong);
        }
        let Some(content) = rest.get(..length) else { return Ok(None) };
        let request = Request::decode(header.kind, content);
        let end = Header::BYTES + length;
        self.bytes.copy_within(end..self.filled, 0);
        self.filled -= end;
        Ok(Some(Numbered { number: header.sequence, request }))
    }
}

/// Outcome of a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum RequestStatus {
    /// It was done, or takes effect with the next frame.
    Done = 0,
    /// The reader has no right to it.
    Refused = 1,
    /// It could not be done.
    Failed = 2,
    /// It was not understood.
    Malformed = 3,
}

/// Answer to a request.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Answer {
    /// Number of the request.
    pub number: u64,
    /// Outcome.
    pub status: RequestStatus,
    /// Keyframes that were saved; else zero.
    pub value: u32,
    /// Outcome as text.
    pub words: String,
}

impl Answer {
    /// Bytes of the record.
    pub fn encode(&self) -> Vec<u8> {
        encoded(Kind::Result.kind(), self.number, |to| {
            to.extend((self.status as u32).to_le_bytes());
            to.extend(self.value.to_le_bytes());
            to.extend(shortened(&self.words).bytes());
        })
    }

    /// Answer in the content of a record.
    ///
    /// # Errors
    /// When there is none in it.
    pub fn decode(number: u64, content: &[u8]) -> Result<Self, &'static str> {
        let Some(([a, b, c, d, value @ ..], words)) = content.split_first_chunk::<8>() else {
            return Err("an answer is too short");
        };
        let status = match u32::from_le_bytes([*a, *b, *c, *d]) {
            0 => RequestStatus::Done,
            1 => RequestStatus::Refused,
            2 => RequestStatus::Failed,
            3 => RequestStatus::Malformed,
            _ => return Err("an unknown status"),
        };
        let words = String::from_utf8_lossy(&words[..words.len().min(MAX_WORDS)]).into_owned();
        Ok(Self { number, status, value: u32::from_le_bytes(*value), words })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn received(bytes: &[u8], piece: usize) -> Result<Vec<Numbered>, TooLong> {
        let (mut inbox, mut got) = (Inbox::default(), Vec::new());
        for piece in bytes.chunks(piece) {
            inbox.room()[..piece.len()].copy_from_slice(piece);
            inbox.add(piece.len());
            while let Some(request) = inbox.next_request()? {
                got.push(request);
            }
        }
        Ok(got)
    }

    #[test]
    fn requests_come_back_as_they_were_however_they_are_cut() {
        let sent = [
            Request::Subscribe(Kinds::SUBSCRIBABLE),
            Request::Reset(ResetKind::Soft),
            Request::Reset(ResetKind::Hard),
            Request::SaveMap,
            Request::Watch(5_000),
            Request::At(At { stamp: Timestamp::from_nanos(-7), patience_ms: 20, is_settled: true }),
            Request::At(At { stamp: Timestamp::MIN, patience_ms: MAX_PATIENCE_MS, is_settled: false }),
            Request::Ready,
            Request::Failed(Failure { is_usage: true, words: "port already in use".into() }),
            Request::Alive,
        ];
        let bytes: Vec<u8> = (1..).zip(&sent).flat_map(|(number, request)| request.encode(number)).collect();
        let expected: Vec<_> =
            (1..).zip(sent).map(|(number, request)| Numbered { number, request: Some(request) }).collect();
        for piece in [1, 7, 300] {
            assert_eq!(received(&bytes, piece), Ok(expected.clone()), "{piece}");
        }
    }

    #[test]
    fn requests_that_are_malformed_are_told_from_those_that_are_too_long() {
        let unknown = encoded(999, 4, |_| {});
        let short = encoded(number::SUBSCRIBE, 5, |to| to.push(1));
        let odd = encoded(number::RESET, 6, |to| to.extend(3u32.to_le_bytes()));
        let at = |number, patience: u32, flags: u32, rest: &[u8]| {
            encoded(number::AT, number, |to| {
                to.extend(0i64.to_le_bytes());
                to.extend([patience.to_le_bytes(), flags.to_le_bytes()].concat());
                to.extend(rest);
            })
        };
        let instants = [at(7, MAX_PATIENCE_MS + 1, 0, &[]), at(8, 0, 2, &[]), at(9, 0, 0, &[0])].concat();
        let got = received(&[unknown, short, odd, instants].concat(), 11).unwrap();
        let expected: Vec<_> = [4, 5, 6, 7, 8, 9].map(|number| Numbered { number, request: None }).into();
        assert_eq!(got, expected);
        let long = Header { kind: 1, length: 513, ..Header::default() }.encode();
        assert_eq!(received(&long, 16), Err(TooLong));
    }

    #[test]
    fn an_answer_comes_back_and_its_text_is_bounded() {
        let sent =
            Answer { number: 9, status: RequestStatus::Refused, value: 3, words: "ä".repeat(MAX_WORDS) };
        let bytes = sent.encode();
        let back = Answer::decode(9, &bytes[Header::BYTES..]).unwrap();
        assert_eq!((back.status, back.value, back.words.len()), (RequestStatus::Refused, 3, MAX_WORDS));
        assert!(Answer::decode(9, &[0; 7]).is_err());
    }
}
