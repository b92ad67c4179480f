//! The map format, version 2, to and from bytes; described in `docs/map-format.md`.
//!
//! Reading is bounded: every length is checked against the bytes that are there before anything is allocated for it,
//! and every number against what a map can hold. A map that passes has finite poses, unit rotations and sane features.

mod numbers;

use nalgebra::Isometry3;
use numbers::{Reader, Writer};
use plumbline_config::Timestamp;
use plumbline_estimator::places::map::MAX_LINES;
use plumbline_estimator::places::{Feature, Keyframe, MapLimits, MapLine, PlaceMap};
use xxhash_rust::xxh3::xxh3_64;

/// First bytes of a map. The line ends show a file that was damaged in a transfer as text.
pub const MAGIC: [u8; 8] = *b"PLBMAP\r\n";
/// Version of the format.
pub const VERSION: u32 = 2;
/// Kind of the descriptors: 256 comparisons of the fixed pattern.
pub const DESCRIPTOR_KIND: u32 = 1;
/// Keyframes of a map at most.
pub const MAX_KEYFRAMES: u32 = 20_000;
/// Features of a keyframe at most.
pub const MAX_FEATURES: u32 = 4_096;
/// Bytes before the keyframes.
const HEADER_BYTES: usize = 32;
/// Bytes of a keyframe without its features and lines.
const KEYFRAME_BYTES: usize = 4 + 8 + 2 * 56 + 4 + 4;
/// Bytes of a feature.
const FEATURE_BYTES: usize = 32 + 5 * 4;
/// Bytes of a line.
const LINE_BYTES: usize = 6 * 4;
/// Bytes of the checksum at the end.
const CHECKSUM_BYTES: usize = 8;
/// Defects of the bytes of a map.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum MapDefect {
    /// It does not begin as a map does.
    #[error("not a map; give a file that `--save-map` of a flight wrote")]
    Foreign,
    /// Another format version.
    #[error(
        "is a map of format {found}, and this program reads format {VERSION}; build it again, or use the program that wrote it"
    )]
    Version {
        /// Version in the file.
        found: u32,
    },
    /// Shorter or longer than it says.
    #[error(
        "has {found} bytes and should have {expected}: it is truncated or has extra bytes; copy it again"
    )]
    Length {
        /// Bytes there are.
        found: u64,
        /// Bytes there should be.
        expected: u64,
    },
    /// The checksum differs.
    #[error("is damaged: its checksum differs; copy it again")]
    Checksum,
    /// Sound by its checksum, and yet holds what cannot be.
    #[error("contains {0}; it was not written by this program")]
    Impossible(&'static str),
}

/// A keyframe with its features, as they stand in a file.
#[derive(Clone, Debug, PartialEq)]
pub struct StoredKeyframe {
    /// Flight it comes from.
    pub session: u32,
    /// Time of the keyframe.
    pub stamp: Timestamp,
    /// Pose of the body in the map.
    pub pose_m_b: Isometry3<f64>,
    /// Pose of the left camera in the body.
    pub pose_b_c: Isometry3<f64>,
    /// Features.
    pub features: Vec<Feature>,
    /// Lines.
    pub lines: Vec<MapLine>,
}

/// Contents of a map file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MapContents {
    /// Keyframes in the order in which they were added.
    pub keyframes: Vec<StoredKeyframe>,
}

impl MapContents {
    /// The contents of a map.
    pub fn of(map: &PlaceMap) -> Self {
        let mut keyframes: Vec<_> = map.keyframes().collect();
        keyframes.sort_unstable_by_key(|(_, k)| k.id);
        let stored = |(slot, k): (usize, &Keyframe)| StoredKeyframe {
            session: k.session,
            stamp: k.stamp,
            pose_m_b: k.pose_m_b,
            pose_b_c: k.pose_b_c,
            features: map.features(slot).to_vec(),
            lines: map.lines(slot).to_vec(),
        };
        Self { keyframes: keyframes.into_iter().map(stored).collect() }
    }

    /// Features in all.
    pub fn feature_count(&self) -> usize {
        self.keyframes.iter().map(|k| k.features.len()).sum()
    }

    /// Lines in all.
    pub fn line_count(&self) -> usize {
        self.keyframes.iter().map(|k| k.lines.len()).sum()
    }

    /// Limits of a map that holds these.
    pub fn limits(&self) -> MapLimits {
        let features = self.keyframes.iter().map(|k| k.features.len()).max().unwrap_or(0);
        MapLimits { keyframes: self.keyframes.len(), features }
    }

    /// A map of them; more than `limits` allow are forgotten by the map's rule.
    #[must_use]
    pub fn into_map(self, limits: MapLimits) -> PlaceMap {
        let mut map = PlaceMap::new(limits);
        for k in &self.keyframes {
            let keyframe = Keyframe::new(k.session, k.stamp, k.pose_m_b, k.pose_b_c);
            if let Some(slot) = map.add(keyframe, &k.features) {
                map.set_lines(slot, k.lines.iter().copied());
            }
        }
        map
    }
}

/// The bytes of a map.
pub fn encode(map: &MapContents) -> Vec<u8> {
    let counts =
        Counts { keyframes: map.keyframes.len(), features: map.feature_count(), lines: map.line_count() };
    let mut out = Writer(Vec::with_capacity(counts.encoded_bytes()));
    out.0.extend(MAGIC);
    out.u32(VERSION);
    out.u32(DESCRIPTOR_KIND);
    out.u32(map.keyframes.len() as u32);
    out.u32(map.line_count() as u32);
    out.0.extend((map.feature_count() as u64).to_le_bytes());
    for keyframe in &map.keyframes {
        out.u32(keyframe.session);
        out.0.extend(keyframe.stamp.as_nanos().to_le_bytes());
        out.pose(&keyframe.pose_m_b);
        out.pose(&keyframe.pose_b_c);
        out.u32(keyframe.features.len() as u32);
        for feature in &keyframe.features {
            feature.descriptor.0.iter().for_each(|w| out.0.extend(w.to_le_bytes()));
            let [x, y] = [feature.xy.x, feature.xy.y];
            for v in [x, y, feature.sigma_xy, feature.inverse_depth, feature.sigma_inverse_depth] {
                out.0.extend(v.to_le_bytes());
            }
        }
        out.u32(keyframe.lines.len() as u32);
        for end in keyframe.lines.iter().flat_map(|line| &line.ends_c) {
            end.iter().for_each(|v| out.0.extend(v.to_le_bytes()));
        }
    }
    let checksum = xxh3_64(&out.0);
    out.0.extend(checksum.to_le_bytes());
    out.0
}

/// Checks what a file of `length` bytes that begins with `start` says of its length, before the rest is read.
///
/// # Errors
/// When it is no map of this version, or has another length than it says.
pub fn check_start(start: &[u8], length: u64) -> Result<(), MapDefect> {
    read_header(start, length).map(|_| ())
}

/// Kind of the descriptors, and counts of a map of `length` bytes that begins with `start`; `None` in place of counts
/// that are more than a map can hold.
fn read_header(start: &[u8], length: u64) -> Result<(u32, Option<Counts>), MapDefect> {
    if start.get(..MAGIC.len()) != Some(MAGIC.as_slice()) {
        return Err(MapDefect::Foreign);
    }
    let expected = |expected: usize| MapDefect::Length { found: length, expected: expected as u64 };
    let least = HEADER_BYTES + CHECKSUM_BYTES;
    let Some(header) = start.get(MAGIC.len()..HEADER_BYTES).filter(|_| length >= least as u64) else {
        return Err(expected(least));
    };
    let mut header = Reader(header);
    let version = header.u32();
    if version != VERSION {
        return Err(MapDefect::Version { found: version });
    }
    let kind = header.u32();
    let (keyframes, lines, features) = (header.u32(), header.u32(), header.u64());
    let possible = keyframes <= MAX_KEYFRAMES
        && features <= u64::from(keyframes) * u64::from(MAX_FEATURES)
        && u64::from(lines) <= u64::from(keyframes) * MAX_LINES as u64;
    if !possible {
        return Ok((kind, None));
    }
    let counts = Counts { keyframes: keyframes as usize, features: features as usize, lines: lines as usize };
    match counts.encoded_bytes() {
        bytes if bytes as u64 == length => Ok((kind, Some(counts))),
        bytes => Err(expected(bytes)),
    }
}

/// The map that bytes hold.
///
/// # Errors
/// When they are no whole, undamaged map of this version.
pub fn decode(bytes: &[u8]) -> Result<MapContents, MapDefect> {
    let (kind, counts) = read_header(bytes, bytes.len() as u64)?;
    let (body, checksum) = bytes.split_at(bytes.len() - CHECKSUM_BYTES);
    if Reader(checksum).u64() != xxh3_64(body) {
        return Err(MapDefect::Checksum);
    }
    let counts = counts.ok_or(MapDefect::Impossible("more than a map can hold"))?;
    if kind != DESCRIPTOR_KIND {
        return Err(MapDefect::Impossible("descriptors of an unknown kind"));
    }
    decode_keyframes(Reader(&body[HEADER_BYTES..]), counts)
}

fn decode_keyframes(mut reader: Reader<'_>, counts: Counts) -> Result<MapContents, MapDefect> {
    let mut keyframes = Vec::with_capacity(counts.keyframes);
    let mut left = counts;
    for _ in 0..counts.keyframes {
        let (session, stamp) = (reader.u32(), Timestamp::from_nanos(reader.u64() as i64));
        let (pose_m_b, pose_b_c) = (reader.pose()?, reader.pose()?);
        // The sums of these are the length of the file, so they bound the allocations too.
        let features = reader.u32();
        left.features = take(left.features, features, MAX_FEATURES as usize)
            .ok_or(MapDefect::Impossible("keyframes with more features than it has"))?;
        let features = (0..features).map(|_| reader.feature()).collect::<Result<_, _>>()?;
        let lines = reader.u32();
        left.lines = take(left.lines, lines, MAX_LINES)
            .ok_or(MapDefect::Impossible("keyframes with more lines than it has"))?;
        let lines = (0..lines).map(|_| reader.line()).collect::<Result<_, _>>()?;
        keyframes.push(StoredKeyframe { session, stamp, pose_m_b, pose_b_c, features, lines });
    }
    if left.features > 0 || left.lines > 0 {
        return Err(MapDefect::Impossible("features or lines of no keyframe"));
    }
    Ok(MapContents { keyframes })
}

/// Rest after `count` of at most `most` were taken; `None` if there are fewer.
fn take(left: usize, count: u32, most: usize) -> Option<usize> {
    let count = usize::try_from(count).ok().filter(|count| *count <= most)?;
    left.checked_sub(count)
}

/// Counts in the header of a file.
#[derive(Clone, Copy)]
struct Counts {
    keyframes: usize,
    features: usize,
    lines: usize,
}

impl Counts {
    fn encoded_bytes(self) -> usize {
        HEADER_BYTES
            + self.keyframes * KEYFRAME_BYTES
            + self.features * FEATURE_BYTES
            + self.lines * LINE_BYTES
            + CHECKSUM_BYTES
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Vector2, Vector3};
    use plumbline_estimator::places::Descriptor;

    fn contents() -> MapContents {
        let feature = |i: u64| Feature {
            descriptor: Descriptor([i, !i, i * i, 7]),
            xy: Vector2::new(0.1, -0.2),
            sigma_xy: 0.002,
            inverse_depth: if i.is_multiple_of(2) { 0.5 } else { 0.0 },
            sigma_inverse_depth: if i.is_multiple_of(2) { 0.01 } else { f32::INFINITY },
        };
        let keyframe = |k: i64| StoredKeyframe {
            session: 1,
            stamp: Timestamp::from_nanos(k * 50_000_000),
            pose_m_b: Isometry3::translation(k as f64, 0.5, -1.0),
            pose_b_c: Isometry3::rotation(nalgebra::Vector3::new(0.3, 0.2, 0.1)),
            features: (0..3 + k as u64).map(feature).collect(),
            lines: (0..k).map(|l| MapLine { ends_c: [Vector3::new(l as f32, 0.5, 2.0); 2] }).collect(),
        };
        MapContents { keyframes: (0..4).map(keyframe).collect() }
    }

    /// Changes bytes and puts the checksum right.
    fn forged(change: impl FnOnce(&mut Vec<u8>)) -> Result<MapContents, MapDefect> {
        let mut bytes = encode(&contents());
        change(&mut bytes);
        decode(&crate::fuzzing::sealed(&bytes))
    }

    #[test]
    fn what_is_read_is_what_was_written() {
        assert_eq!(decode(&encode(&contents())), Ok(contents()));
        assert_eq!(decode(&encode(&MapContents::default())), Ok(MapContents::default()));
        let map = contents().into_map(contents().limits());
        assert_eq!(MapContents::of(&map), contents());
    }

    #[test]
    fn a_map_cut_off_anywhere_is_refused() {
        let bytes = encode(&contents());
        for length in 0..bytes.len() {
            let defect = decode(&bytes[..length]).unwrap_err();
            let expected = matches!(defect, MapDefect::Foreign if length < 8)
                || matches!(defect, MapDefect::Length { .. });
            assert!(expected, "{length}: {defect}");
        }
        assert!(matches!(decode(&[bytes, vec![0]].concat()), Err(MapDefect::Length { .. })));
    }

    #[test]
    fn one_flipped_bit_anywhere_is_refused() {
        let bytes = encode(&contents());
        for at in 0..bytes.len() {
            let mut damaged = bytes.clone();
            damaged[at] ^= 1 << (at % 8);
            assert!(decode(&damaged).is_err(), "byte {at}");
        }
    }

    #[test]
    fn another_version_and_other_files_are_named_as_what_they_are() {
        for found in [1, 3] {
            assert_eq!(forged(|b| b[8] = found), Err(MapDefect::Version { found: u32::from(found) }));
        }
        assert_eq!(decode(b"\x89MCAP0\r\n"), Err(MapDefect::Foreign));
    }

    #[test]
    fn impossible_contents_are_refused_though_the_checksum_is_right() {
        let impossible = |change: fn(&mut Vec<u8>)| matches!(forged(change), Err(MapDefect::Impossible(_)));
        // Counts of keyframes and features, a position, a quaternion, a standard deviation.
        assert!(impossible(|b| b[16..20].copy_from_slice(&u32::MAX.to_le_bytes())));
        assert!(impossible(|b| b[24..32].copy_from_slice(&u64::MAX.to_le_bytes())));
        assert!(impossible(|b| b[44..52].copy_from_slice(&f64::NAN.to_le_bytes())));
        assert!(impossible(|b| b[92..100].copy_from_slice(&2.0f64.to_le_bytes())));
        assert!(impossible(|b| b[156..160].copy_from_slice(&9u32.to_le_bytes())));
        assert!(impossible(|b| b[200..204].copy_from_slice(&f32::NAN.to_le_bytes())));
    }
}
