//! Binary output of VectorNav's sensors (VN-100, -200, -300, -110 and so on).
//!
//! A frame names groups of fields and fields of each group, and lays the values end to end:
//!
//! ```text
//! FA | groups: u8 | fields of each group: u16 ... | values | CRC-16/XMODEM, high byte first
//! ```
//!
//! The CRC covers all after `FA`, itself included it is 0. Any output will do that has TimeStartup, a gyroscope and an
//! accelerometer: what the onboard filter has not touched is taken where it is there (Imu, UncompGyro and UncompAccel),
//! since the estimator finds the biases itself. Such as
//! `$VNWRG,75,2,4,01,0201*XX`: TimeStartup and Imu on port 2 at 800 / 4 = 200 Hz.
//!
//! Source: VN-100 User Manual (UM001), *Binary Output Messages*. Lengths of fields stand in the same place.

use super::framing::{Scan, before_any};
use super::protocol::{Content, DeviceSample, Protocol, TimeUnit, vector};
use crc::{CRC_16_XMODEM, Crc};
use nalgebra::Vector3;

const SYNC: u8 = 0xFA;
const CHECKSUM: usize = 2;
/// Longest frame that is taken, bytes: an IMU's is below a hundred.
const LONGEST: usize = 600;

static CRC: Crc<u16> = Crc::<u16>::new(&CRC_16_XMODEM);

/// Groups that frames of seven bits can name; the eighth announces groups that no IMU output needs.
const GROUPS: usize = 7;
/// Fields of a group; the sixteenth bit announces more.
const FIELDS: usize = 15;

/// Length of every field, bytes, by group and bit; 0 where there is none, or where it varies.
#[rustfmt::skip]
const LENGTHS: [[u8; FIELDS]; GROUPS] = [
    // Common.
    [8, 8, 8, 12, 16, 12, 24, 12, 12, 24, 20, 28, 2, 4, 8],
    // Time.
    [8, 8, 8, 2, 8, 8, 8, 4, 4, 1, 0, 0, 0, 0, 0],
    // IMU.
    [2, 12, 12, 12, 4, 4, 16, 12, 12, 12, 12, 2, 40, 0, 0],
    // GNSS 1.
    [8, 8, 2, 1, 1, 24, 24, 12, 12, 12, 4, 4, 2, 28, 0],
    // Attitude.
    [2, 12, 16, 36, 12, 12, 12, 12, 12, 12, 28, 24, 12, 0, 0],
    // INS.
    [2, 24, 24, 12, 12, 12, 12, 12, 12, 4, 4, 68, 64, 0, 0],
    // GNSS 2.
    [8, 8, 2, 1, 1, 24, 24, 12, 12, 12, 4, 4, 2, 28, 0],
];

/// Bits of SensSat: the axes of accelerometer and gyroscope.
const SATURATED: u16 = 0b1_1111_1000;

/// A sensor of VectorNav.
#[derive(Clone, Copy, Debug, Default)]
pub struct VectorNav;

/// The header of a frame.
struct Header {
    groups: u8,
    /// Bytes up to the values.
    length: usize,
    /// Bytes of the values.
    payload: usize,
}

enum Seen {
    Header(Header),
    Incomplete,
    Impossible,
}

fn header(bytes: &[u8]) -> Seen {
    let Some(groups) = bytes.get(1) else { return Seen::Incomplete };
    if *groups == 0 || *groups & 0x80 != 0 {
        return Seen::Impossible;
    }
    let mut length = 2;
    let mut payload = 0;
    for group in (0..GROUPS).filter(|group| groups & 1 << group != 0) {
        let Some(fields) = word(bytes, length) else { return Seen::Incomplete };
        length += 2;
        // A group without fields, or fields that are not known.
        if fields == 0 || fields & 0x8000 != 0 || present(group, fields).any(|(_, bytes)| bytes == 0) {
            return Seen::Impossible;
        }
        payload += present(group, fields).map(|(_, bytes)| bytes).sum::<usize>();
    }
    match length + payload + CHECKSUM <= LONGEST {
        true => Seen::Header(Header { groups: *groups, length, payload }),
        false => Seen::Impossible,
    }
}

fn word(bytes: &[u8], place: usize) -> Option<u16> {
    Some(u16::from_le_bytes([*bytes.get(place)?, *bytes.get(place + 1)?]))
}

/// Bits and lengths of the fields of a group that are there.
fn present(group: usize, fields: u16) -> impl Iterator<Item = (usize, usize)> {
    let is_there = move |bit: &usize| fields & 1 << bit != 0;
    (0..FIELDS).filter(is_there).map(move |bit| (bit, usize::from(LENGTHS[group][bit])))
}

/// Fields of a frame that we use. Values that the onboard filter has touched serve only where there are no
/// raw ones.
#[derive(Default)]
struct Values {
    time_ns: Option<u64>,
    gyro: [Option<[f64; 3]>; 2],
    accel: [Option<[f64; 3]>; 2],
    saturation: u16,
}

impl Values {
    /// Takes a field, `bytes` long as [`LENGTHS`] says.
    fn take(&mut self, field: (usize, usize), bytes: &[u8]) {
        match field {
            // TimeStartup.
            (0 | 1, 0) => self.time_ns = bytes.first_chunk().map(|b| u64::from_le_bytes(*b)),
            // AngularRate; Accel.
            (0, 5) | (2, 10) => self.gyro[1] = reals(bytes, 0),
            (0, 8) | (2, 9) => self.accel[1] = reals(bytes, 0),
            // Imu: accelerometer before gyroscope.
            (0, 9) => (self.accel[0], self.gyro[0]) = (reals(bytes, 0), reals(bytes, 12)),
            // UncompAccel; UncompGyro; SensSat.
            (2, 2) => self.accel[0] = reals(bytes, 0),
            (2, 3) => self.gyro[0] = reals(bytes, 0),
            (2, 11) => self.saturation = word(bytes, 0).unwrap_or(0),
            _ => {}
        }
    }

    fn into_content(self) -> Content {
        let Some(ticks) = self.time_ns else {
            return Content::Lacking("the output lacks TimeStartup: add it (common group, bit 0)");
        };
        let (Some(gyro), Some(accel)) = (self.gyro[0].or(self.gyro[1]), self.accel[0].or(self.accel[1]))
        else {
            return Content::Lacking(
                "the output lacks gyroscope or accelerometer: add Imu (common group, bit 9)",
            );
        };
        let (Some(gyro), Some(accel)): (Option<Vector3<f64>>, _) = (vector(gyro), vector(accel)) else {
            return Content::Malformed;
        };
        Content::Sample(DeviceSample {
            ticks,
            gyro,
            accel,
            is_saturated: self.saturation & SATURATED != 0,
            ..DeviceSample::default()
        })
    }
}

fn real(bytes: &[u8], place: usize) -> Option<f64> {
    Some(f64::from(f32::from_le_bytes(*bytes.get(place..)?.first_chunk()?)))
}

fn reals(bytes: &[u8], place: usize) -> Option<[f64; 3]> {
    Some([real(bytes, place)?, real(bytes, place + 4)?, real(bytes, place + 8)?])
}

impl Protocol for VectorNav {
    fn scan(&self, bytes: &[u8]) -> Scan {
        if bytes[0] != SYNC {
            return Scan::Noise(before_any(bytes, &[SYNC]));
        }
        let header = match header(bytes) {
            Seen::Header(header) => header,
            Seen::Incomplete => return Scan::More,
            Seen::Impossible => return Scan::BadLength(1),
        };
        match bytes.get(1..header.length + header.payload + CHECKSUM) {
            None => Scan::More,
            Some(covered) if CRC.checksum(covered) == 0 => Scan::Frame(covered.len() + 1),
            Some(_) => Scan::BadChecksum(1),
        }
    }

    fn decode(&mut self, frame: &[u8]) -> Content {
        let Seen::Header(header) = header(frame) else { return Content::Malformed };
        let (mut words, mut place) = (2, header.length);
        let mut values = Values::default();
        for group in (0..GROUPS).filter(|group| header.groups & 1 << group != 0) {
            let fields = word(frame, words).unwrap_or(0);
            words += 2;
            for (bit, length) in present(group, fields) {
                let Some(bytes) = frame.get(place..place + length) else { return Content::Malformed };
                values.take((group, bit), bytes);
                place += length;
            }
        }
        values.into_content()
    }

    fn time_unit(&self) -> TimeUnit {
        TimeUnit::NANOS
    }
}

#[cfg(test)]
mod tests {
    use super::super::fixture::{contents, hex};
    use super::*;
    use crate::serial::fuzzing::vectornav_frame as frame;

    /// The manual's example: yaw, pitch and roll of the common group.
    const MANUAL: &str = "FA 01 08 00 93 50 2E 42 83 3E F1 3F 48 B5 04 BB 92 88";

    fn floats(values: &[f32]) -> Vec<u8> {
        values.iter().flat_map(|value| value.to_le_bytes()).collect()
    }

    fn only(stream: &[u8]) -> Content {
        let found = contents(&mut VectorNav, stream);
        assert_eq!(found.len(), 1, "{found:?}");
        found[0]
    }

    #[test]
    fn the_frame_of_the_manual_is_found_and_its_values_are_where_they_should_be() {
        let bytes = hex(MANUAL);
        assert_eq!(VectorNav.scan(&bytes), Scan::Frame(bytes.len()));
        let degrees = reals(&bytes, 4).unwrap();
        for (value, expected) in degrees.into_iter().zip([43.5787, 1.8847, -0.0020]) {
            assert!((value - expected).abs() < 5e-5, "{value}");
        }
        assert!(matches!(only(&bytes), Content::Lacking(what) if what.contains("TimeStartup")));
    }

    #[test]
    fn every_change_of_the_frame_of_the_manual_is_refused() {
        for place in 0..18 {
            for bit in 0..8 {
                let mut bytes = hex(MANUAL);
                bytes[place] ^= 1 << bit;
                assert_eq!(contents(&mut VectorNav, &bytes), []);
            }
        }
    }

    #[test]
    fn what_the_filter_has_not_touched_is_preferred() {
        let time = 7_000_000_001_u64.to_le_bytes();
        let imu = floats(&[0.0, 0.1, -9.8, 0.5, 0.6, 0.7]);
        let (rate, accel) = (floats(&[1.0, 2.0, 3.0]), floats(&[4.0, 5.0, 6.0]));
        let both = [&time[..], &rate, &accel, &imu].concat();
        let Content::Sample(sample) = only(&frame(&[(0, 1 | 1 << 5 | 1 << 8 | 1 << 9)], &both)) else {
            panic!()
        };
        assert_eq!(sample.ticks, 7_000_000_001);
        assert!((sample.gyro - Vector3::new(0.5, 0.6, 0.7)).norm() < 1e-6);
        assert!((sample.accel - Vector3::new(0.0, 0.1, -9.8)).norm() < 1e-6);
        let touched = [&time[..], &rate, &accel].concat();
        let Content::Sample(sample) = only(&frame(&[(0, 1 | 1 << 5 | 1 << 8)], &touched)) else { panic!() };
        assert_eq!((sample.gyro.z, sample.accel.x), (3.0, 4.0));
    }

    #[test]
    fn fields_of_several_groups_are_found_behind_those_that_do_not_concern_us() {
        let time = 9_u64.to_le_bytes();
        // Time group, IMU group with pressure between, attitude group.
        let values = [
            &time[..],
            &floats(&[4.0, 5.0, 6.0, 1.0, 2.0, 3.0]),
            &floats(&[36.5, 101.3]),
            &(1_u16 << 7).to_le_bytes(),
            &[7; 12],
        ]
        .concat();
        let fields = [(1, 1), (2, 1 << 2 | 1 << 3 | 1 << 4 | 1 << 5 | 1 << 11), (4, 1 << 1)];
        let Content::Sample(sample) = only(&frame(&fields, &values)) else { panic!() };
        assert_eq!((sample.ticks, sample.accel.y, sample.gyro.y), (9, 5.0, 2.0));
        assert!(sample.is_saturated);
    }

    #[test]
    fn impossible_headers_are_refused_at_once() {
        for bytes in
            ["FA 00", "FA 81", "FA 01 00 80", "FA 01 00 00", "FA 02 00 40", "FA 7F FF 7F FF 03 FF 1F FF 3F"]
        {
            assert!(matches!(VectorNav.scan(&hex(bytes)), Scan::BadLength(1) | Scan::More), "{bytes}");
        }
        assert_eq!(VectorNav.scan(&hex("FA 01 00 80")), Scan::BadLength(1));
        assert_eq!(VectorNav.scan(&hex("FA 01 08")), Scan::More);
    }

    #[test]
    fn numbers_that_are_none_and_outputs_that_lack_something_are_told() {
        let time = 9_u64.to_le_bytes();
        let values = [&time[..], &floats(&[f32::NAN, 0.0, 0.0, 0.0, 0.0, 0.0])].concat();
        assert_eq!(only(&frame(&[(0, 1 | 1 << 9)], &values)), Content::Malformed);
        let values = [&time[..], &floats(&[1.0, 2.0, 3.0])].concat();
        assert!(
            matches!(only(&frame(&[(0, 1 | 1 << 5)], &values)), Content::Lacking(what) if what.contains("Imu"))
        );
    }

    #[test]
    fn ascii_lines_between_do_not_matter() {
        let stream = [&b"$VNYMR,+010.071*60\r\n"[..], &hex(MANUAL), b"$VNERR,12*48\r\n"].concat();
        assert!(matches!(only(&stream), Content::Lacking(_)));
    }
}
