//! MTData2 of Xsens (Movella): MTi 1, 10, 100, 600 and so on.
//!
//! ```text
//! FA | FF | 36 | length: u8 | (number: u16, length: u8, value) ... | checksum
//! ```
//!
//! Big-endian; the bytes after `FA` sum up to 0. A length of 255 is followed by one of 16 bits. The last digit of a number
//! says how values are written, and in which frame orientations are, which does not concern us. Needed are SampleTimeFine,
//! RateOfTurn and Acceleration (or their HR variants); PacketCounter tells losses, StatusWord a range that was exceeded.
//! Stamps have a resolution of 0.1 ms.
//!
//! Source: *MT Low-Level Communication Protocol Documentation* (MT0101P).

use super::framing::{Scan, before_any};
use super::protocol::{Content, DeviceSample, Protocol, TimeUnit, vector};

const PREAMBLE: u8 = 0xFA;
/// Bus identifier of the host on a line with one device.
const BUS: u8 = 0xFF;
const MT_DATA_2: u8 = 0x36;
const EXTENDED: u8 = 0xFF;
const CHECKSUM: usize = 1;
/// Longest message that is taken, bytes: one with all there is of an IMU has 150.
const LONGEST: usize = 600;
/// A number without the digit that says how its values are written.
const WHAT: u16 = 0xFFF0;

/// StatusWord: an axis of accelerometer (bits 8 to 10) or gyroscope (11 to 13) is at the end of its range.
const CLIPPED: u32 = 0b11_1111 << 8;

/// A sensor of Xsens.
#[derive(Clone, Copy, Debug, Default)]
pub struct Xsens;

/// Beginning and length of a message's content, once both are there.
fn content_place(bytes: &[u8]) -> Option<(usize, usize)> {
    match *bytes.get(3)? {
        EXTENDED => {
            let length = u16::from_be_bytes([*bytes.get(4)?, *bytes.get(5)?]);
            Some((6, usize::from(length)))
        }
        length => Some((4, usize::from(length))),
    }
}

/// Fields of a message that we use.
#[derive(Default)]
struct Values {
    counter: Option<u64>,
    ticks: Option<u64>,
    gyro: Option<[f64; 3]>,
    accel: Option<[f64; 3]>,
    status: u32,
}

impl Values {
    /// Takes an item; false when its length is not that of its kind.
    fn take(&mut self, number: u16, value: &[u8]) -> bool {
        let exact = |bytes: &[u8]| bytes.iter().fold(0_u64, |sum, byte| sum << 8 | u64::from(*byte));
        let has = |length: usize| value.len() == length;
        match number & WHAT {
            0x1020 if has(2) => self.counter = Some(exact(value)),
            0x1060 if has(4) => self.ticks = Some(exact(value)),
            0xE020 if has(4) => self.status = exact(value) as u32,
            // RateOfTurn, RateOfTurnHR; Acceleration, AccelerationHR.
            0x8020 | 0x8040 => return put(&mut self.gyro, reals(number, value)),
            0x4020 | 0x4040 => return put(&mut self.accel, reals(number, value)),
            0x1020 | 0x1060 | 0xE020 => return false,
            _ => {}
        }
        true
    }

    fn into_content(self) -> Content {
        let Some(ticks) = self.ticks else {
            return Content::Lacking("the output lacks SampleTimeFine (0x1060): add it with MT Manager");
        };
        let (Some(gyro), Some(accel)) = (self.gyro, self.accel) else {
            return Content::Lacking(
                "the output lacks RateOfTurn (0x8020) or Acceleration (0x4020): add both with MT Manager, at one rate",
            );
        };
        let (Some(gyro), Some(accel)) = (vector(gyro), vector(accel)) else { return Content::Malformed };
        Content::Sample(DeviceSample {
            ticks,
            counter: self.counter,
            gyro,
            accel,
            is_saturated: self.status & CLIPPED != 0,
            is_failed: false,
        })
    }
}

fn put<T>(place: &mut Option<T>, value: Option<T>) -> bool {
    let is_there = value.is_some();
    *place = value;
    is_there
}

/// A number as the last digit of its item's number says: f32, fixed point 12.20 or 16.32, or f64. None for another length.
fn real(number: u16, bytes: &[u8]) -> Option<f64> {
    Some(match number & 0x3 {
        0 => f64::from(f32::from_be_bytes(bytes.try_into().ok()?)),
        1 => f64::from(i32::from_be_bytes(bytes.try_into().ok()?)) / f64::from(1 << 20),
        2 => {
            // The fraction comes before the whole.
            let [a, b, c, d, e, f]: [u8; 6] = bytes.try_into().ok()?;
            let whole = i16::from_be_bytes([e, f]);
            f64::from(whole) + f64::from(u32::from_be_bytes([a, b, c, d])) / 4_294_967_296.0
        }
        _ => f64::from_be_bytes(bytes.try_into().ok()?),
    })
}

fn reals(number: u16, bytes: &[u8]) -> Option<[f64; 3]> {
    let each = bytes.len() / 3;
    let at = |k: usize| real(number, bytes.get(k * each..(k + 1) * each)?);
    bytes.len().is_multiple_of(3).then_some(())?;
    Some([at(0)?, at(1)?, at(2)?])
}

impl Protocol for Xsens {
    fn scan(&self, bytes: &[u8]) -> Scan {
        match *bytes {
            [PREAMBLE] | [PREAMBLE, BUS] | [PREAMBLE, BUS, _] => return Scan::More,
            [PREAMBLE, BUS, ..] => {}
            _ => return Scan::Noise(1 + before_any(&bytes[1..], &[PREAMBLE])),
        }
        let Some((place, length)) = content_place(bytes) else { return Scan::More };
        let whole = place + length + CHECKSUM;
        if whole > LONGEST {
            return Scan::BadLength(1);
        }
        match bytes.get(1..whole) {
            None => Scan::More,
            Some(covered) if covered.iter().fold(0_u8, |sum, byte| sum.wrapping_add(*byte)) == 0 => {
                Scan::Frame(whole)
            }
            Some(_) => Scan::BadChecksum(1),
        }
    }

    fn decode(&mut self, frame: &[u8]) -> Content {
        if frame.get(2) != Some(&MT_DATA_2) {
            return Content::Other;
        }
        let content = content_place(frame).and_then(|(place, length)| frame.get(place..place + length));
        let Some(mut rest) = content else { return Content::Malformed };
        let mut values = Values::default();
        while let [a, b, length, items @ ..] = rest {
            let Some((value, after)) = items.split_at_checked(usize::from(*length)) else {
                return Content::Malformed;
            };
            if !values.take(u16::from_be_bytes([*a, *b]), value) {
                return Content::Malformed;
            }
            rest = after;
        }
        if rest.is_empty() { values.into_content() } else { Content::Malformed }
    }

    fn time_unit(&self) -> TimeUnit {
        TimeUnit { bits: 32, tick_ns: 100_000 }
    }

    fn counter_bits(&self) -> u32 {
        16
    }
}

#[cfg(test)]
mod tests {
    use super::super::fixture::{contents, hex};
    use super::*;
    use crate::serial::fuzzing::xsens_message as message;
    use nalgebra::Vector3;

    /// Payloads of an MTi-300, captured with the maker's MT Manager, and what that decoded
    /// (Scottapotamas/xsens-mti, `docs/mtmanager_packets.md`): counter, time, acceleration, rate of turn.
    type Captured = (&'static str, u64, u64, [f64; 3], [f64; 3]);
    const CAPTURED: [Captured; 3] = [
        (
            "10 20 02 A6 55 10 60 04 00 57 47 2E 20 10 10 3F 7F 7D C4 BC 10 10 7D 3B A1 57 70 BD 7E C6 56 40 20 0C BD A2 1A \
             F8 BE 2A 8E 96 41 1D 27 A2 40 10 0C B9 4F C8 00 B9 DA 24 00 3C C9 28 80 40 30 0C 3C 02 C8 9C 3C 35 F6 C8 3C DB \
             0C 00 80 20 0C BB B1 7D 81 BB 96 32 00 3C 01 E8 41 80 30 10 3F 80 00 00 B6 E3 30 01 B6 C0 40 00 37 26 48 00 C0 \
             20 0C BE 99 9C 24 3F B6 1B 56 3F 16 6A EB 30 10 04 00 01 86 DE E0 20 04 00 40 00 03",
            42_581,
            5_719_854,
            [-0.079_153_00, -0.166_559_55, 9.822_175_98],
            [-0.005_416_57, -0.004_583_60, 0.007_928_91],
        ),
        (
            "10 20 02 91 8D 10 60 04 01 36 3F A6 20 10 10 3F 35 E0 42 3F 31 CD 15 BD 9F 49 DB BD A9 38 CF 40 20 0C BD 63 5A \
             90 41 1D 08 D4 3E 5F AA 50 40 10 0C B9 11 68 00 3C C9 01 00 3A 0F 7D 00 40 30 0C BC 3B 29 80 3C 35 FC 00 3C A4 \
             6E 00 80 20 0C 3C AE A2 41 BB 56 D8 00 BA D5 AC 01 80 30 10 3F 80 00 00 37 DF 88 01 B6 89 80 00 B6 08 C0 00 C0 \
             20 0C BE FB FB F2 3F 33 C4 85 BF A0 A2 C1 08 10 04 42 16 80 00 30 10 04 00 01 86 E1 E0 20 04 00 40 00 03",
            37_261,
            20_332_454,
            [-0.055_506_29, 9.814_655_30, 0.218_423_13],
            [0.021_317_60, -0.003_278_26, -0.001_630_19],
        ),
        // Shaken hard: accelerometer and gyroscope at the ends of their ranges.
        (
            "10 20 02 FB 85 10 60 04 01 A4 98 DE 20 10 10 3F 2A 14 63 BE D7 EF A7 3C DE E5 08 3F 1D CE C9 40 20 0C C1 F2 46 \
             C3 C1 EC E0 76 C2 8F 85 3F 40 10 0C BD 93 2C CC BD 92 0A 16 BE 3A 6E EC 40 30 0C 42 51 94 64 C2 7B 5A 5A C1 CC \
             C0 AE 80 20 0C 40 85 4D 6D C1 25 55 9E C0 90 8E 1F 80 30 10 3F 7F F8 98 3B AA 9E E5 BC 53 9E C0 BB B9 06 0C C0 \
             20 0C 3E DC 74 39 BE 75 2B 48 3F AF 9A 3F 30 10 04 00 01 86 DE E0 20 04 00 48 14 01",
            64_389,
            27_564_254,
            [-30.284_551_62, -29.609_600_07, -71.760_246_28],
            [4.165_701_39, -10.333_402_63, -4.517_348_77],
        ),
    ];
    /// Only orientation and status are switched on.
    const ORIENTATION: &str = "10 20 02 46 82 10 60 04 01 C4 FC 3E 20 10 10 3F 71 CE 6C BE A5 6B CF 3C 61 3B D8 BD 69 1D 25 E0 \
        20 04 00 40 00 03";

    fn only(content: &[u8]) -> Content {
        let found = contents(&mut Xsens, &message(MT_DATA_2, content));
        assert_eq!(found.len(), 1, "{found:?}");
        found[0]
    }

    fn sample(content: &[u8]) -> DeviceSample {
        match only(content) {
            Content::Sample(sample) => sample,
            other => panic!("{other:?}"),
        }
    }

    fn near(a: Vector3<f64>, b: [f64; 3]) -> bool {
        (a - Vector3::from(b)).norm() < 1e-7
    }

    #[test]
    fn captured_messages_are_decoded_as_the_maker_decodes_them() {
        for (payload, counter, ticks, accel, gyro) in CAPTURED {
            let sample = sample(&hex(payload));
            assert_eq!((sample.counter, sample.ticks), (Some(counter), ticks));
            assert!(near(sample.accel, accel) && near(sample.gyro, gyro), "{sample:?}");
        }
        let samples = CAPTURED.map(|(payload, ..)| sample(&hex(payload)));
        assert_eq!(samples.map(|s| s.is_saturated), [false, false, true]);
    }

    #[test]
    fn the_commands_of_the_manual_have_the_right_checksum_and_are_no_data() {
        // GoToConfig, GoToMeasurement, and what the device answers to ReqFWRev.
        for text in ["FA FF 30 00 D1", "FA FF 10 00 F1", "FA FF 13 0B 01 08 02 00 00 00 25 00 01 15 34 69"] {
            assert_eq!(contents(&mut Xsens, &hex(text)), [Content::Other], "{text}");
        }
        assert_eq!(contents(&mut Xsens, &hex("FA FF 30 00 D2")), []);
    }

    #[test]
    fn an_output_that_lacks_something_is_told() {
        assert!(matches!(only(&hex(ORIENTATION)), Content::Lacking(what) if what.contains("RateOfTurn")));
        assert!(matches!(only(&[]), Content::Lacking(what) if what.contains("SampleTimeFine")));
    }

    #[test]
    fn numbers_are_read_however_they_are_written() {
        let rate = [1.5, -0.25, 1e-3];
        let fixed = |bits: i32| rate.map(|x: f64| (x * 2_f64.powi(bits)).round() as i64);
        let written: [(u16, Vec<u8>); 4] = [
            (0x8020, rate.iter().flat_map(|x| (*x as f32).to_be_bytes()).collect()),
            (0x8021, fixed(20).iter().flat_map(|x| (*x as i32).to_be_bytes()).collect()),
            (
                0x8022,
                fixed(32)
                    .iter()
                    .flat_map(|x| {
                        [&(*x as u32).to_be_bytes()[..], &((x >> 32) as i16).to_be_bytes()].concat()
                    })
                    .collect(),
            ),
            (0x802F, rate.iter().flat_map(|x| x.to_be_bytes()).collect()),
        ];
        for (number, value) in written {
            let mut content = hex("10 60 04 00 00 00 07 40 20 0C 00 00 00 00 00 00 00 00 41 1D 00 00");
            content.extend(number.to_be_bytes());
            content.push(value.len() as u8);
            content.extend(value);
            let sample = sample(&content);
            assert!((sample.gyro - Vector3::from(rate)).norm() < 1e-6, "{number:x} {sample:?}");
        }
    }

    #[test]
    fn items_that_do_not_fit_and_values_of_another_length_are_malformed() {
        for content in [
            "10 60 05 00 00 00 07",
            "10 60 03 00 00 07",
            "80 20 0B 0 0 0 0 0 0 0 0 0 0 0",
            "10 60",
            "80 20 00",
        ] {
            assert_eq!(only(&hex(content)), Content::Malformed, "{content}");
        }
        let nan = "10 60 04 00 00 00 07 40 20 0C 7F C0 00 00 00 00 00 00 41 1D 00 00 80 20 0C 0 0 0 0 0 0 0 0 0 0 0 0";
        assert_eq!(only(&hex(nan)), Content::Malformed);
    }

    #[test]
    fn long_messages_are_read_and_absurd_lengths_refused() {
        // Items that do not concern us make it longer than 254 bytes.
        let padding = [&[0xC0, 0x20, 0xFA][..], &[7; 0xFA]].concat();
        let content = [&hex(CAPTURED[0].0)[..], &padding].concat();
        assert_eq!(sample(&content).counter, Some(42_581));
        assert_eq!(Xsens.scan(&hex("FA FF 36 FF 08 00")), Scan::BadLength(1));
        assert_eq!(Xsens.scan(&hex("FA FF 36 FF FF")), Scan::More);
    }
}
