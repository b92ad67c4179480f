//! The inertial messages of MAVLink, as the library of the bridge writes them and as the driver of the IMU reads them, and
//! the other way round: two implementations that share nothing.

use mavlink::dialects::common::{
    HIGHRES_IMU_DATA, HighresImuUpdatedFlags, MavMessage, RAW_IMU_DATA, SCALED_IMU_DATA, SCALED_IMU2_DATA,
    SCALED_IMU3_DATA, TIMESYNC_DATA,
};
use mavlink::{MavHeader, MavlinkReader, MavlinkVersion, Message as _};
use plumbline_config::options::MavlinkImu;
use plumbline_drivers::serial::framing::{Deframer, Scan};
use plumbline_drivers::serial::mavlink::Mavlink;
use plumbline_drivers::serial::protocol::{Content, DeviceSample, Outgoing, Protocol};

fn written(message: &MavMessage, version: MavlinkVersion) -> Vec<u8> {
    let header = MavHeader { system_id: 1, component_id: 1, sequence: 9 };
    let mut bytes = Vec::new();
    mavlink::write_versioned_msg(&mut bytes, version, header, message).unwrap();
    bytes
}

fn read(protocol: &mut Mavlink, bytes: &[u8]) -> Content {
    let mut deframer = Deframer::default();
    deframer.space()[..bytes.len()].copy_from_slice(bytes);
    deframer.advance(bytes.len());
    let frame = deframer.next(|bytes| protocol.scan(bytes)).expect("the frame is found");
    protocol.decode(frame)
}

fn near(sample: &DeviceSample, accel: [f64; 3], gyro: [f64; 3]) {
    let off = |a: &nalgebra::Vector3<f64>, b: [f64; 3]| (a - nalgebra::Vector3::from(b)).norm();
    assert!(off(&sample.accel, accel) < 1e-6 && off(&sample.gyro, gyro) < 1e-6, "{sample:?}");
}

#[test]
fn every_inertial_message_is_read_as_it_was_written_in_both_versions() {
    let g = 9.806_65e-3;
    let highres = MavMessage::HIGHRES_IMU(HIGHRES_IMU_DATA {
        time_usec: 77,
        xacc: 0.5,
        yacc: -1.5,
        zacc: -9.75,
        xgyro: 0.25,
        ygyro: -0.125,
        zgyro: 3.0,
        fields_updated: HighresImuUpdatedFlags::all(),
        ..HIGHRES_IMU_DATA::default()
    });
    let (xacc, yacc, zacc, xgyro, ygyro, zgyro) = (500, -20, -1000, 30, -1500, 7);
    let raw =
        RAW_IMU_DATA { time_usec: 77, xacc, yacc, zacc, xgyro, ygyro, zgyro, ..RAW_IMU_DATA::default() };
    let scaled = SCALED_IMU_DATA {
        time_boot_ms: 77,
        xacc,
        yacc,
        zacc,
        xgyro,
        ygyro,
        zgyro,
        ..SCALED_IMU_DATA::default()
    };
    let scaled2 = SCALED_IMU2_DATA {
        time_boot_ms: 77,
        xacc,
        yacc,
        zacc,
        xgyro,
        ygyro,
        zgyro,
        ..SCALED_IMU2_DATA::default()
    };
    let scaled3 = SCALED_IMU3_DATA {
        time_boot_ms: 77,
        xacc,
        yacc,
        zacc,
        xgyro,
        ygyro,
        zgyro,
        ..SCALED_IMU3_DATA::default()
    };
    let messages = [
        (MavlinkImu::HighresImu, highres),
        (MavlinkImu::RawImu, MavMessage::RAW_IMU(raw)),
        (MavlinkImu::ScaledImu, MavMessage::SCALED_IMU(scaled)),
        (MavlinkImu::ScaledImu2, MavMessage::SCALED_IMU2(scaled2)),
        (MavlinkImu::ScaledImu3, MavMessage::SCALED_IMU3(scaled3)),
    ];
    for (which, message) in messages {
        for version in [MavlinkVersion::V1, MavlinkVersion::V2] {
            let Content::Sample(sample) = read(&mut Mavlink::new(which, 200.0), &written(&message, version))
            else {
                panic!("{which:?} {version:?}");
            };
            assert_eq!(sample.ticks, 77);
            match which {
                MavlinkImu::HighresImu => near(&sample, [0.5, -1.5, -9.75], [0.25, -0.125, 3.0]),
                _ => near(&sample, [500.0 * g, -20.0 * g, -1000.0 * g], [0.03, -1.5, 0.007]),
            }
        }
    }
}

#[test]
fn what_the_driver_asks_is_understood_and_its_answer_too() {
    let mut driver = Mavlink::new(MavlinkImu::HighresImu, 200.0);
    let mut outgoing = Outgoing::default();
    driver.request(123_456_789_012, &mut outgoing);
    let mut reader = MavlinkReader::with_capacity(2048, outgoing.bytes());
    let mut heard = Vec::new();
    while let Ok(message) = reader.read_any_raw_message::<MavMessage>() {
        heard.push(MavMessage::parse(message.version(), message.message_id(), message.payload()).unwrap());
    }
    let [MavMessage::TIMESYNC(asked), MavMessage::COMMAND_LONG(command)] = &heard[..] else {
        panic!("{heard:?}")
    };
    assert_eq!((asked.tc1, asked.ts1), (0, 123_456_789_012));
    assert_eq!((command.command as u32, command.param1, command.param2), (511, 105.0, 5000.0));
    let answer = TIMESYNC_DATA { tc1: 55, ..asked.clone() };
    let answer = read(&mut driver, &written(&MavMessage::TIMESYNC(answer), MavlinkVersion::V2));
    assert!(matches!(answer, Content::Answer(a) if a.asked_ns == 123_456_789_012 && a.device_sent_ns == 55));
}

#[test]
fn messages_of_other_kinds_are_passed_over() {
    let bytes = written(&MavMessage::HEARTBEAT(Default::default()), MavlinkVersion::V2);
    assert!(matches!(Mavlink::new(MavlinkImu::HighresImu, 200.0).scan(&bytes), Scan::Noise(_)));
}
