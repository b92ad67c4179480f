extern crate std;

use super::*;
use proptest::prelude::*;
use std::vec::Vec;

fn framed(message: &Message) -> Vec<u8> {
    encode(message, &mut [0; MAX_FRAME]).to_vec()
}

fn all_of(receiver: &mut Receiver, bytes: &[u8]) -> Vec<Result<Message, FrameError>> {
    bytes.iter().filter_map(|byte| receiver.push(*byte)).collect()
}

fn sample(sequence: u32) -> Message {
    Message::Imu(Imu {
        sequence,
        time_ns: 1_234_567_890_123,
        gyro_rad_s: [0.1, -0.2, 0.3],
        accel_m_s2: [0.0, 9.81, -1e-3],
        temperature_c: Some(36.62),
        flags: Flags { accel_saturated: true, ..Flags::default() },
    })
}

/// One of each.
fn each() -> [Message; 8] {
    let settings =
        Settings { imu_rate_mhz: 200_000, trigger_rate_mhz: 20_000, trigger_pulse_us: 1500, cameras: 3 };
    [
        sample(7),
        Message::Trigger(Trigger { counter: 9, time_ns: 10, pulse_ns: 11, cameras: 3 }),
        Message::Hello(Hello {
            protocol: VERSION,
            firmware: [1, 2, 3],
            device_id: 0xFEED_0000_0000_BEEF,
            imu_rate_mhz: 1_000_000,
            gyro_range_rad_s: 34.9,
            accel_range_m_s2: 156.9,
        }),
        Message::Time(Time { asked_ns: 1, received_ns: 2, sent_ns: 3 }),
        Message::Settings(settings),
        Message::AskHello,
        Message::AskTime { asked_ns: u64::MAX },
        Message::Set(settings),
    ]
}

/// The frames that `docs/serial-protocol.md` shows: they never change.
#[test]
fn the_bytes_are_those_of_the_document() {
    let document = include_str!("../../../docs/serial-protocol.md");
    let bytes = |message: &Message| {
        let hex: Vec<_> = framed(message).iter().map(|byte| std::format!("{byte:02X}")).collect();
        hex.join(" ")
    };
    let still = Message::Imu(Imu {
        sequence: 258,
        time_ns: 5_000_000_000,
        gyro_rad_s: [0.5, -0.25, 0.0],
        accel_m_s2: [0.0, 0.0, 9.81],
        temperature_c: Some(25.5),
        flags: Flags::default(),
    });
    let trigger =
        Message::Trigger(Trigger { counter: 40, time_ns: 5_000_000_000, pulse_ns: 2_000_000, cameras: 3 });
    for message in [still, trigger, Message::AskTime { asked_ns: 1_000_000_001 }, Message::AskHello] {
        let written: Vec<_> = document.split_whitespace().collect();
        let shown = bytes(&message);
        assert!(written.join(" ").contains(&shown), "the document lacks: {shown}");
    }
}

#[test]
fn every_message_comes_back_as_it_was_whole_and_in_pieces() {
    let stream: Vec<u8> = each().iter().flat_map(framed).collect();
    assert_eq!(all_of(&mut Receiver::new(), &stream), each().map(Ok));
}

#[test]
fn a_zero_stands_only_around_a_frame_and_a_sample_fits_the_line() {
    for message in each() {
        let frame = framed(&message);
        assert_eq!(frame.iter().filter(|byte| **byte == 0).count(), 2);
        assert_eq!((frame[0], frame[frame.len() - 1]), (0, 0));
        assert!(frame.len() <= MAX_FRAME);
    }
    assert_eq!(framed(&sample(1)).len(), 47);
}

#[test]
fn noise_costs_no_frame_that_it_does_not_hit() {
    let mut receiver = Receiver::new();
    let noise: Vec<u8> = (1..=255).collect();
    let stream = [&noise, &framed(&sample(1)), &noise[..9], &framed(&sample(2))].concat();
    let found = all_of(&mut receiver, &stream);
    assert_eq!(found, [Err(FrameError::Length), Ok(sample(1)), Err(FrameError::Encoding), Ok(sample(2))]);
}

#[test]
fn a_changed_byte_spoils_one_message() {
    for place in 1..46 {
        for change in [1, 0x80, 0xFF] {
            let mut bad = framed(&sample(1));
            bad[place] ^= change;
            let stream = [bad, framed(&sample(2))].concat();
            let found = all_of(&mut Receiver::new(), &stream);
            assert!(!found.contains(&Ok(sample(1))) && found.contains(&Ok(sample(2))), "{place} {found:?}");
        }
    }
}

#[test]
fn a_longer_payload_of_a_later_version_is_understood_and_a_shorter_one_is_not() {
    let body = |content: &[u8]| {
        let crc = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC).checksum(content);
        let mut encoded = [0; 128];
        let length = cobs::encode(&[content, &crc.to_le_bytes()[..]].concat(), &mut encoded);
        decode(&encoded[..length])
    };
    let asked = |extra: &[u8]| body(&[&[0x82][..], &7_u64.to_le_bytes(), extra].concat());
    assert_eq!(asked(&[]), Ok(Message::AskTime { asked_ns: 7 }));
    assert_eq!(asked(&[1, 2, 3]), Ok(Message::AskTime { asked_ns: 7 }));
    assert_eq!(body(&[0x82, 7, 0, 0]), Err(FrameError::Unknown));
    assert_eq!(body(&[0x42, 7]), Err(FrameError::Unknown));
    assert_eq!(decode(&[]), Err(FrameError::Length));
    assert_eq!(decode(&[1; MAX_FRAME]), Err(FrameError::Length));
}

#[test]
fn temperatures_keep_to_a_hundredth_and_to_what_can_be_said() {
    let back = |temperature_c: Option<f32>| {
        let frame = framed(&Message::Imu(Imu { temperature_c, ..Imu::default() }));
        match decode(&frame[1..frame.len() - 1]) {
            Ok(Message::Imu(imu)) => imu.temperature_c,
            other => panic!("{other:?}"),
        }
    };
    assert_eq!(back(None), None);
    assert_eq!(back(Some(f32::NAN)), None);
    assert_eq!(back(Some(-12.34)), Some(-12.34));
    assert_eq!(back(Some(1e9)), Some(327.67));
    assert_eq!(back(Some(-1e9)), Some(-327.67));
}

#[test]
fn a_timer_goes_on_when_it_is_full_and_takes_earlier_readings_as_such() {
    let mut timer = Timer::new(1_000_000);
    assert_eq!(timer.nanos(2_000_000_000), 2_000_000_000_000);
    assert_eq!(timer.nanos(4_000_000_000), 4_000_000_000_000);
    assert_eq!(timer.nanos(3_999_999_990), 3_999_999_990_000);
    assert_eq!(timer.nanos(5), (u64::from(u32::MAX) + 6) * 1000);
    let mut fast = Timer::new(170_000_000);
    assert_eq!(fast.nanos(17), 100);
    assert_eq!(Timer::new(0).nanos(3), 3_000_000_000);
}

proptest! {
    #[test]
    fn no_bytes_make_it_panic_and_the_next_frame_is_found(noise in prop::collection::vec(any::<u8>(), 0..400)) {
        let mut receiver = Receiver::new();
        all_of(&mut receiver, &noise);
        prop_assert!(all_of(&mut receiver, &framed(&sample(3))).contains(&Ok(sample(3))));
    }

    #[test]
    fn what_is_decoded_can_be_encoded_and_is_the_same(kind in 0_usize..8, at in 0_usize..90, value in any::<u8>()) {
        let mut frame = framed(&each()[kind]);
        let place = at % frame.len();
        frame[place] = value;
        for message in all_of(&mut Receiver::new(), &frame).into_iter().flatten() {
            prop_assert_eq!(decode(&framed(&message)[1..]).err(), Some(FrameError::Encoding));
            let again = framed(&message);
            prop_assert_eq!(decode(&again[1..again.len() - 1]), Ok(message));
        }
    }

    #[test]
    fn every_sample_comes_back(sequence: u32, time_ns: u64, gyro: [f32; 3], accel: [f32; 3], bits in 0_u8..8) {
        let flags = Flags { gyro_saturated: bits & 1 > 0, accel_saturated: bits & 2 > 0, sensor_failed: bits & 4 > 0 };
        let imu = Imu { sequence, time_ns, gyro_rad_s: gyro, accel_m_s2: accel, temperature_c: None, flags };
        let frame = framed(&Message::Imu(imu));
        let back = decode(&frame[1..frame.len() - 1]);
        let is_nan = gyro.iter().chain(&accel).any(|x| x.is_nan());
        prop_assert!(is_nan || back == Ok(Message::Imu(imu)));
    }
}
