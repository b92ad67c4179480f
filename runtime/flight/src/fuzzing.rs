//! Entry points of the fuzzers (`fuzz/`): each function takes any bytes, and a panic is a finding.
//!
//! The tests of this crate run these functions over the checked-in seeds, and over seeded mutations of them.

use crate::autopilot::inbox::{MavlinkInbox, Received};
use crate::autopilot::timesync::TimeSync;
use crate::local::record::TooLong;
use crate::local::request::{self, Numbered, Request};
use crate::log::channel::Channel;
use crate::log::source::{LogImu, LogStereo};
use crate::log::{LogReader, image};
use crate::places::codec;
use crate::schedule::ticker::Monotonic;
use plumbline_config::GrayImage;
use plumbline_config::options::ImageRecording;
use plumbline_drivers::{ImuSource as _, StereoFrame, StereoSource as _};
use plumbline_record::local::content::LocalRecord;
use plumbline_record::local::incoming::Incoming;
use plumbline_record::parts::ImageAbout;
use plumbline_record::protobuf::encode;
use plumbline_record::topics::Decode;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use xxhash_rust::xxh3::xxh3_64;

/// A flight log: read to its end, and as the sensors of a flight.
///
/// # Panics
/// When more is read than there is, or a message does not come back as it was.
pub fn mcap_log(data: &[u8]) {
    let path = scratch_file();
    std::fs::write(path, data).expect("there is room for a temporary file");
    let Ok(mut reader) = LogReader::open(path) else { return };
    while let Ok(Some(message)) = reader.next_message() {
        log_message(message.channel, message.payload);
    }
    assert!(reader.read_bytes() <= reader.total_bytes());
    if let Ok(mut imu) = LogImu::open(path) {
        while let Ok(Some(_)) = imu.next_reading() {}
    }
    if let Ok(mut stereo) = LogStereo::open(path, None, false) {
        let mut frame = StereoFrame::new([(8, 8); 2]);
        while let Ok(true) = stereo.next_frame(&mut frame) {}
    }
}

/// A map.
///
/// # Panics
/// When what was read is not written again as the same bytes.
pub fn map_file(data: &[u8]) {
    if let Ok(map) = codec::decode(data) {
        assert_eq!(codec::encode(&map), data);
    }
    // Past the checksum, which hides the rest from anything but whole maps.
    let _ = codec::decode(&sealed(data));
}

/// Bytes of a map with a checksum that fits, in place of the last eight: what looks past the checksum.
pub(crate) fn sealed(bytes: &[u8]) -> Vec<u8> {
    let body = &bytes[..bytes.len().saturating_sub(size_of::<u64>())];
    [body, &xxh3_64(body).to_le_bytes()].concat()
}

/// A file of this process in memory, where the system has such.
fn scratch_file() -> &'static Path {
    static FILE: OnceLock<PathBuf> = OnceLock::new();
    FILE.get_or_init(|| {
        let memory = PathBuf::from("/dev/shm");
        let parent = if memory.is_dir() { memory } else { std::env::temp_dir() };
        let folder = parent.join(format!("plumbline-fuzz-{}", std::process::id()));
        std::fs::create_dir_all(&folder).expect("a temporary folder can be made");
        folder.join("flight.mcap")
    })
}

/// A message of a log: the number of its channel, and its bytes.
///
/// # Panics
/// When it does not come back as it was once it is written again.
pub fn log_messages(data: &[u8]) {
    let Some((channel, payload)) = data.split_first() else { return };
    log_message(Channel::LOGGED[usize::from(*channel) % Channel::LOGGED.len()], payload);
}

fn log_message(channel: Channel, payload: &[u8]) {
    if channel.is_image() {
        let description = ImageAbout { width_px: 8, height_px: 6, sha256: Vec::new() };
        for images in [ImageRecording::Raw, ImageRecording::Png] {
            let _ = image::decode(payload, images, &description, &mut GrayImage::new(8, 6));
        }
    }
    if let Some(decode) = channel.row().decode {
        again(decode, payload);
    }
}

/// Asserts that a decoded message is the same after encoding and decoding it once more.
fn again(decode: Decode, payload: &[u8]) {
    let Ok(value) = decode(payload) else { return };
    let first = encode(&*value);
    let Ok(back) = decode(&first) else { panic!("what was written is refused: {first:?}") };
    assert_eq!(encode(&*back), first);
}

/// Bytes from an autopilot: the first says how long the pieces are that the others come in. Messages are the same
/// however they are cut, and the clock takes whatever they say.
///
/// # Panics
/// When they are not.
pub fn mavlink(data: &[u8]) {
    let Some((piece, bytes)) = data.split_first() else { return };
    let (whole, cut) = (received(bytes, bytes.len().max(1)), received(bytes, 1 + usize::from(*piece)));
    assert_eq!(whole, cut);
    let mut clock = TimeSync::default();
    for (k, timesync) in (1i64..).zip(whole.iter().filter_map(|message| message.timesync.as_ref())) {
        let asked = clock.request(Monotonic(k * 100_000_000));
        let now = Monotonic(k * 100_000_000 + 1_000_000);
        clock.answer(timesync.tc1, timesync.ts1, now);
        clock.answer(timesync.tc1, asked.unwrap_or(timesync.ts1), now);
        let _ = (clock.offset_ns(), clock.round_trip_ns());
    }
}

fn received(bytes: &[u8], piece: usize) -> Vec<Received> {
    let (mut inbox, mut messages) = (MavlinkInbox::default(), Vec::new());
    for piece in bytes.chunks(piece) {
        inbox.put(piece, |message| messages.push(message));
    }
    let figures = inbox.figures();
    assert!(figures.passed_over <= bytes.len() as u64);
    assert_eq!(figures.messages - figures.malformed, messages.len() as u64);
    messages
}

/// Bytes of a reader of the local socket: the first says how long the pieces are that the others come in. Requests are the
/// same however they are cut, and come back as they were.
///
/// # Panics
/// When they are not.
pub fn local_requests(data: &[u8]) {
    let Some((piece, bytes)) = data.split_first() else { return };
    let (whole, cut) = (requests(bytes, usize::MAX), requests(bytes, 1 + usize::from(*piece)));
    assert_eq!(whole, cut);
    for Numbered { number, request } in whole {
        // The text of a failure is shortened, and what is no text replaced.
        if let Some(request) = request.filter(|request| !matches!(request, Request::Failed(_))) {
            let expected = Numbered { number, request: Some(request.clone()) };
            assert_eq!(requests(&request.encode(number), 7), [expected]);
        }
    }
}

/// Requests up to the first that is too long.
fn requests(bytes: &[u8], piece: usize) -> Vec<Numbered> {
    let (mut inbox, mut got, mut left) = (request::Inbox::default(), Vec::new(), bytes);
    while !left.is_empty() {
        let room = inbox.room();
        let count = left.len().min(piece).min(room.len());
        assert!(count > 0, "there is room for a request");
        room[..count].copy_from_slice(&left[..count]);
        inbox.add(count);
        left = &left[count..];
        loop {
            match inbox.next_request() {
                Ok(Some(request)) => got.push(request),
                Ok(None) => break,
                Err(TooLong) => return got,
            }
        }
    }
    got
}

/// Bytes of a flight to a reader of the local socket: read to their end.
pub fn local_records(mut data: &[u8]) {
    let mut incoming = Incoming::default();
    while !data.is_empty() {
        let room = incoming.room();
        let (piece, rest) = data.split_at(room.len().min(data.len()));
        room[..piece.len()].copy_from_slice(piece);
        incoming.add(piece.len());
        data = rest;
        while let Ok(Some(header)) = incoming.next_header() {
            let _ = LocalRecord::decode(&header, incoming.content());
        }
    }
}

#[cfg(test)]
#[path = "../../../fuzz/smoke.rs"]
mod smoke;

#[cfg(test)]
#[path = "../../../fuzz/fixture.rs"]
pub(crate) mod fixture;

#[cfg(test)]
mod seeds;

#[cfg(test)]
mod tests {
    use super::smoke::over_seeds_and_mutations;

    #[test]
    fn fuzz_seeds_of_logs_are_read_to_their_end() {
        for name in ["plain", "chunks"] {
            let seed = format!("{}/../../fuzz/seeds/mcap_log/{name}.mcap", env!("CARGO_MANIFEST_DIR"));
            let mut reader = super::LogReader::open(seed.as_ref()).unwrap();
            let mut channels = Vec::new();
            while let Some(message) = reader.next_message().unwrap() {
                channels.push(message.channel);
            }
            assert_eq!(channels.len(), 15, "{name}: {channels:?}");
        }
    }

    #[test]
    fn fuzz_mcap_log() {
        over_seeds_and_mutations("mcap_log", 300, super::mcap_log);
    }

    #[test]
    fn fuzz_map_file() {
        over_seeds_and_mutations("map_file", 20_000, super::map_file);
    }

    #[test]
    fn fuzz_log_messages() {
        over_seeds_and_mutations("log_messages", 20_000, super::log_messages);
    }

    #[test]
    fn fuzz_mavlink() {
        over_seeds_and_mutations("mavlink", 5000, super::mavlink);
    }

    #[test]
    fn fuzz_local_requests() {
        over_seeds_and_mutations("local_requests", 20_000, super::local_requests);
    }

    #[test]
    fn fuzz_local_records() {
        over_seeds_and_mutations("local_records", 20_000, super::local_records);
    }
}
