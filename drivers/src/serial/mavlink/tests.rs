//! Frames of pymavlink 2.4, the MAVLink project's own implementation, and one that was recorded.

use super::*;
use crate::serial::fixture::{contents, hex};
use mavlink::dialects::common::HighresImuUpdatedFlags;
use nalgebra::Vector3;

const HIGHRES_2: &str = "FD 3E 00 00 07 01 01 69 00 00 15 CD 5B 07 00 00 00 00 00 00 80 3E 00 00 00 BF 00 00 1C C1 00 00 \
    00 3E 00 00 80 BD 00 00 00 40 CD CC CC 3D CD CC 4C 3E 9A 99 99 3E 00 40 7D 44 00 00 00 3F 00 00 C8 42 00 00 26 42 FF \
    1F B3 D7";
const HIGHRES_1: &str = "FE 3E 03 01 01 69 15 CD 5B 07 00 00 00 00 00 00 80 3E 00 00 00 BF 00 00 1C C1 00 00 00 3E 00 00 \
    80 BD 00 00 00 40 CD CC CC 3D CD CC 4C 3E 9A 99 99 3E 00 40 7D 44 00 00 00 3F 00 00 C8 42 00 00 26 42 FF 1F 3E E0";
const SCALED_2: &str = "FD 18 00 00 08 01 01 74 00 00 E8 FD 00 00 64 00 38 FF 18 FC DC 05 EC FF 03 00 01 00 02 00 03 00 DE \
    0D 8A 73";
/// All behind the accelerometer is zero, and was left out.
const RAW_CUT: &str = "FD 0E 00 00 09 01 01 1B 00 00 63 00 00 00 00 00 00 00 00 00 00 00 18 FC E5 84";
/// MAVLink 1, recorded (the test data of code-lever/mavlink-log, `raw_imu_spec.rb`).
const RAW_RECORDED: &str = "FE 1A A2 37 01 1B 40 18 A3 27 00 00 00 00 C6 02 7F 01 55 F4 EE 17 F0 17 B4 18 00 00 00 00 00 \
    00 DD 85";
const TIMESYNC: &str = "FD 0E 00 00 09 01 01 6F 00 00 00 F2 05 2A 01 00 00 00 CB 04 FB 71 1F 01 DF E1";

fn samples(message: MavlinkImu, text: &str) -> Vec<DeviceSample> {
    let found = contents(&mut Mavlink::new(message, 200.0), &hex(text));
    found.into_iter().filter_map(|c| if let Content::Sample(s) = c { Some(s) } else { None }).collect()
}

/// The recorded HIGHRES_IMU with a change, from another component.
fn highres_of(component_id: u8, change: impl Fn(&mut HIGHRES_IMU_DATA)) -> Vec<u8> {
    let frame = taken_apart(&hex(HIGHRES_2)).unwrap();
    let message = MavMessage::parse(frame.version(), frame.message_id(), frame.payload()).unwrap();
    let MavMessage::HIGHRES_IMU(mut imu) = message else { panic!("{message:?}") };
    change(&mut imu);
    let header = MavHeader { system_id: 1, component_id, sequence: 0 };
    written(header, &MavMessage::HIGHRES_IMU(imu)).raw_bytes().to_vec()
}

fn near(a: Vector3<f64>, b: [f64; 3]) -> bool {
    (a - Vector3::from(b)).norm() < 1e-9
}

#[test]
fn highres_imu_of_both_versions_is_read_in_si() {
    for text in [HIGHRES_1, HIGHRES_2] {
        let [sample] = samples(MavlinkImu::HighresImu, text)[..] else { panic!("{text}") };
        assert_eq!(sample.ticks, 123_456_789);
        assert!(near(sample.accel, [0.25, -0.5, -9.75]) && near(sample.gyro, [0.125, -0.0625, 2.0]));
    }
}

#[test]
fn scaled_and_raw_imu_are_thousandths_and_what_was_left_out_is_zero() {
    let [scaled] = samples(MavlinkImu::ScaledImu2, SCALED_2)[..] else { panic!() };
    assert_eq!(scaled.ticks, 65_000);
    assert!(near(scaled.accel, [0.980665, -1.96133, -9.80665]) && near(scaled.gyro, [1.5, -0.02, 0.003]));
    let [raw] = samples(MavlinkImu::RawImu, RAW_CUT)[..] else { panic!() };
    assert!(raw.ticks == 99 && near(raw.accel, [0.0, 0.0, -9.80665]) && near(raw.gyro, [0.0; 3]));
    let [recorded] = samples(MavlinkImu::RawImu, RAW_RECORDED)[..] else { panic!() };
    assert_eq!(recorded.ticks, 665_000_000);
    assert!(near(recorded.accel, [710.0, 383.0, -2987.0].map(|mg| mg * 9.80665e-3)));
    assert!(near(recorded.gyro, [6.126, 6.128, 6.324]));
}

#[test]
fn only_the_message_that_was_chosen_counts_and_only_of_the_first_sender() {
    assert_eq!(samples(MavlinkImu::ScaledImu, SCALED_2), []);
    let stream = [hex(HIGHRES_2), highres_of(2, |_| ()), hex(HIGHRES_2)].concat();
    let found = contents(&mut Mavlink::new(MavlinkImu::HighresImu, 200.0), &stream);
    assert_eq!(
        found.iter().map(|c| matches!(c, Content::Sample(_))).collect::<Vec<_>>(),
        [true, false, true]
    );
}

#[test]
fn a_message_without_new_readings_is_passed_over_and_one_without_numbers_is_malformed() {
    let changed = |change: fn(&mut HIGHRES_IMU_DATA)| {
        contents(&mut Mavlink::new(MavlinkImu::HighresImu, 200.0), &highres_of(1, change))[0]
    };
    assert_eq!(
        changed(|imu| imu.fields_updated = HighresImuUpdatedFlags::from_bits_retain(0x0207)),
        Content::Other
    );
    assert_eq!(changed(|imu| imu.xgyro = f32::NAN), Content::Malformed);
    assert!(matches!(
        changed(|imu| imu.fields_updated = HighresImuUpdatedFlags::empty()),
        Content::Sample(_)
    ));
}

#[test]
fn a_question_for_the_time_is_that_of_pymavlink_and_its_answer_counts_once() {
    let mut autopilot = Mavlink::new(MavlinkImu::HighresImu, 200.0);
    let mut outgoing = Outgoing::default();
    autopilot.request(1_000_000_000, &mut outgoing);
    let asked = hex("FD 0C 00 00 00 01 BF 6F 00 00 00 00 00 00 00 00 00 00 00 CA 9A 3B 61 DE");
    assert!(outgoing.bytes().starts_with(&asked), "{:02X?}", outgoing.bytes());
    assert_eq!(contents(&mut autopilot, &hex(TIMESYNC)), [Content::Other]);
    autopilot.request(1_234_567_890_123, &mut outgoing);
    let answer = TimeAnswer {
        asked_ns: 1_234_567_890_123,
        device_received_ns: 5_000_000_000,
        device_sent_ns: 5_000_000_000,
    };
    let twice = [hex(TIMESYNC), hex(TIMESYNC)].concat();
    assert_eq!(contents(&mut autopilot, &twice), [Content::Answer(answer), Content::Other]);
}

#[test]
fn an_autopilot_that_sends_too_little_is_asked_for_more_as_pymavlink_would_ask() {
    let mut autopilot = Mavlink::new(MavlinkImu::HighresImu, 200.0);
    let mut asked_s = Vec::new();
    for k in 0..40_i64 * 200 {
        let now_ns = k * 5_000_000;
        let mut outgoing = Outgoing::default();
        autopilot.request(now_ns, &mut outgoing);
        let commands = outgoing.bytes().windows(3).filter(|w| *w == [76, 0, 0]).count();
        if commands > 0 {
            asked_s.push(now_ns / 1_000_000_000);
            if asked_s.len() == 1 {
                let command = hex(
                    "FD 20 00 00 01 01 BF 4C 00 00 00 00 D2 42 00 40 9C 45 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 \
                     00 00 00 00 00 FF 01 01 01 A5 C4",
                );
                assert!(outgoing.bytes().ends_with(&command), "{:02X?}", outgoing.bytes());
            }
        }
        // 50 Hz for 17 s, then what was asked for.
        if k % 4 == 0 || now_ns > 17_000_000_000 {
            contents(&mut autopilot, &hex(HIGHRES_2));
        }
    }
    assert_eq!(asked_s, [0, 5, 10, 15, 20]);
}

#[test]
fn a_signed_frame_is_read_and_one_with_unknown_flags_is_not() {
    let signed = |flags: u8| {
        let mut bytes = hex(SCALED_2);
        bytes[2] = flags;
        bytes.truncate(bytes.len() - 2);
        let mut digest = crc::Crc::<u16>::new(&crc::CRC_16_MCRF4XX);
        let covered = [&bytes[1..], &[76]].concat();
        bytes.extend(digest_of(&mut digest, &covered).to_le_bytes());
        bytes.extend([0xA5; 13]);
        bytes
    };
    let found = |flags| contents(&mut Mavlink::new(MavlinkImu::ScaledImu2, 200.0), &signed(flags)).len();
    assert_eq!((found(1), found(2)), (1, 0));
}

fn digest_of(crc: &mut crc::Crc<u16>, bytes: &[u8]) -> u16 {
    crc.checksum(bytes)
}
