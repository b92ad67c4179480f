//! Bags written here, message by message, in every encoding and compressed or not.

mod ros1;
mod sqlite;

use super::*;
use crate::{ImuSource as _, StereoFrame, StereoSource as _};
use mcap::records::MessageHeader;
use mcap::{Compression, WriteOptions};
use nalgebra::Vector3;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufWriter;

/// The place of a bag in a folder of its own.
fn place(name: &str) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    (folder, path)
}

/// Encoding of the messages that are written.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Order {
    /// CDR, least byte first.
    Little,
    /// CDR, most significant byte first.
    Big,
    /// Serialization of ROS 1: packed, least byte first.
    Ros1,
}

/// Bytes of a message, by the rules of the standards.
struct Encoder {
    bytes: Vec<u8>,
    order: Order,
}

impl Encoder {
    fn new(order: Order) -> Self {
        let bytes =
            if order == Order::Ros1 { vec![] } else { vec![0, u8::from(order == Order::Little), 0, 0] };
        Self { bytes, order }
    }

    fn put<const N: usize>(&mut self, little: [u8; N]) {
        while self.order != Order::Ros1 && !(self.bytes.len() - 4).is_multiple_of(N) {
            self.bytes.push(0xee);
        }
        let mut bytes = little;
        if self.order == Order::Big {
            bytes.reverse();
        }
        self.bytes.extend(bytes);
    }

    fn u32(&mut self, value: u32) {
        self.put(value.to_le_bytes());
    }

    fn f64(&mut self, value: f64) {
        self.put(value.to_le_bytes());
    }

    fn sequence(&mut self, data: &[u8]) {
        self.u32(data.len() as u32);
        self.bytes.extend(data);
    }

    fn text(&mut self, text: &str) {
        let end = if self.order == Order::Ros1 { "" } else { "\0" };
        self.sequence([text, end].concat().as_bytes());
    }

    fn header(&mut self, stamp_ns: i64) {
        if self.order == Order::Ros1 {
            self.u32(77);
        }
        self.u32((stamp_ns / 1_000_000_000) as u32);
        self.u32((stamp_ns % 1_000_000_000) as u32);
        self.text("odd");
    }
}

fn imu_message(stamp_ns: i64, value: f64, order: Order) -> Vec<u8> {
    let mut out = Encoder::new(order);
    out.header(stamp_ns);
    (0..13).for_each(|_| out.f64(-7.0));
    (0..3).for_each(|k| out.f64(value + f64::from(k)));
    (0..9).for_each(|_| out.f64(-7.0));
    (0..3).for_each(|k| out.f64(10.0 * value + f64::from(k)));
    (0..9).for_each(|_| out.f64(-7.0));
    out.bytes
}

fn image_message(stamp_ns: i64, value: u8, order: Order) -> Vec<u8> {
    let mut out = Encoder::new(order);
    out.header(stamp_ns);
    out.u32(2);
    out.u32(4);
    out.text("mono8");
    out.put([0]);
    out.u32(4);
    out.sequence(&[value; 8]);
    out.bytes
}

/// An MCAP file of one chunk, compressed by Zstandard, that holds these records.
fn chunk_of(records: &[u8]) -> Vec<u8> {
    let mut file = mcap::MAGIC.to_vec();
    let compressed = zstd::bulk::compress(records, 1).unwrap();
    let mut chunk = Vec::new();
    for number in [0_u64, 0, records.len() as u64] {
        chunk.extend(number.to_le_bytes());
    }
    // No CRC, and the name of the compression.
    chunk.extend([0; 4]);
    chunk.extend([&4_u32.to_le_bytes()[..], b"zstd"].concat());
    chunk.extend((compressed.len() as u64).to_le_bytes());
    chunk.extend(compressed);
    file.push(mcap::records::op::CHUNK);
    file.extend((chunk.len() as u64).to_le_bytes());
    file.extend(chunk);
    file
}

#[test]
fn a_few_kilobytes_that_expand_to_millions_of_records_are_refused() {
    let (_folder, path) = place("bomb.mcap");
    // Empty records of an unknown kind.
    let record = [&[0xf0][..], &[0; 8]].concat();
    let one = chunk_of(&record.repeat(1 << 20));
    let chunk = &one[mcap::MAGIC.len()..];
    std::fs::write(&path, [&one[..], chunk, chunk].concat()).unwrap();
    assert!(path.metadata().unwrap().len() < 65_000);
    let error = Messages::new(std::slice::from_ref(&path)).next().unwrap_err().to_string();
    assert!(error.contains("expand to far more records"), "{error}");
}

const MS: i64 = 1_000_000;
/// Far from zero, as stamps are.
const BEGIN: i64 = 1_403_715_273 * 1000 * MS;

/// Writes messages of (topic, type, content) in this order.
fn write(path: &Path, compression: Option<Compression>, messages: &[(&str, &str, Vec<u8>)]) {
    let options = WriteOptions::new().compression(compression).chunk_size(Some(600)).profile("ros2");
    let mut writer = options.create(BufWriter::new(File::create(path).unwrap())).unwrap();
    let mut channels = BTreeMap::new();
    for (sequence, (topic, type_name, content)) in (0..).zip(messages) {
        let channel_id = *channels.entry(*topic).or_insert_with(|| {
            let schema = writer.add_schema(type_name, "ros2msg", b"").unwrap();
            let encoding = if type_name.contains("/msg/") { "cdr" } else { "ros1" };
            writer.add_channel(schema, topic, encoding, &BTreeMap::new()).unwrap()
        });
        // Times of arrival are those of nobody.
        let header = MessageHeader { channel_id, sequence, log_time: 5, publish_time: 5 };
        writer.write_to_known_channel(&header, content).unwrap();
    }
    writer.finish().unwrap();
}

const IMAGE: &str = "sensor_msgs/msg/Image";
const IMU: &str = "sensor_msgs/msg/Imu";

/// Ten stereo pairs at 20 Hz and their samples at 200 Hz; the right images come late, one pair is missing, and two left
/// images are out of order.
fn messages(order: Order) -> Vec<(&'static str, &'static str, Vec<u8>)> {
    let (image_type, imu_type) =
        if order == Order::Ros1 { ("sensor_msgs/Image", "sensor_msgs/Imu") } else { (IMAGE, IMU) };
    let mut all = vec![("/rosout", "rcl_interfaces/msg/Log", vec![1, 2, 3])];
    let mut late = Vec::new();
    for k in (0..10_i64).filter(|k| *k != 4) {
        for i in 0..10 {
            let at = BEGIN + 50 * MS * k + 5 * MS * i;
            all.push(("/imu0", imu_type, imu_message(at, 0.01 * (10 * k + i) as f64, order)));
        }
        let k = if k == 7 {
            8
        } else if k == 8 {
            7
        } else {
            k
        };
        let image =
            |side: i64| image_message(BEGIN + 50 * MS * k + 1000 * side, (10 * k + side) as u8, order);
        all.push(("/cam0/image_raw", image_type, image(0)));
        late.push(("/cam1/image_raw", image_type, image(1)));
        if late.len() > 2 {
            all.push(late.remove(0));
        }
    }
    all.extend(late);
    all
}

fn options() -> EurocOptions {
    EurocOptions { sizes_px: vec![(4, 2); 2], ..EurocOptions::default() }
}

/// The frames of [`messages`], as [`frames`] has them.
fn expected_frames() -> Vec<(i64, u64, [Option<u8>; 2])> {
    let images = |k: i64| [Some((10 * k) as u8), Some((10 * k + 1) as u8)];
    (0..10_i64).filter(|k| *k != 4).map(|k| (50 * k, k as u64, images(k))).collect()
}

/// Checks that the bag at `path` holds [`messages`].
fn check_whole(path: &Path) {
    let bag = BagDataset::open(path, &BagTopics::default(), &options()).unwrap();
    assert_eq!(frames(&bag), expected_frames(), "{}", path.display());
    assert_eq!((bag.cameras(), bag.frames.faults.disordered, bag.is_truncated()), (2, 2, false));
    let samples = read_bag_imu(path, &BagTopics::default()).unwrap();
    assert_eq!((samples.len(), samples[0].stamp.as_nanos()), (90, BEGIN));
    assert_eq!(samples[0].gyro, Vector3::new(0.0, 1.0, 2.0));
    assert!((samples[1].accel - Vector3::new(0.1, 1.1, 2.1)).norm() < 1e-12);
}

fn refusal(path: &Path) -> String {
    BagDataset::open(path, &BagTopics::default(), &options()).unwrap_err().to_string()
}

/// Stamps, sequence numbers and grey values of all frames.
fn frames(bag: &BagDataset) -> Vec<(i64, u64, [Option<u8>; 2])> {
    let (mut source, mut frame) = (bag.stereo(), StereoFrame::new(bag.sizes_px()));
    let mut all = Vec::new();
    while source.next_frame(&mut frame).unwrap() {
        let grey = [0, 1].map(|c| frame.valid[c].then(|| frame.images[c].pixels()[7]));
        all.push(((frame.stamp.as_nanos() - BEGIN) / MS, frame.sequence, grey));
    }
    all
}

#[test]
fn a_bag_is_handed_out_in_order_of_measurement_whatever_its_bytes() {
    let (_folder, path) = place("bag.mcap");
    for (order, compression) in [
        (Order::Little, None),
        (Order::Big, None),
        (Order::Little, Some(Compression::Zstd)),
        (Order::Ros1, Some(Compression::Lz4)),
    ] {
        write(&path, compression, &messages(order));
        check_whole(&path);
        let bag = BagDataset::open(&path, &BagTopics::default(), &options()).unwrap();
        let mut imu = bag.imu();
        assert_eq!(std::iter::from_fn(|| imu.next_reading().unwrap()).count(), 90);
    }
}

#[test]
fn a_cut_has_the_frames_of_the_whole() {
    let (_folder, path) = place("bag.mcap");
    write(&path, None, &messages(Order::Little));
    let options = EurocOptions { frames: Some(5..8), ..options() };
    let bag = BagDataset::open(&path, &BagTopics::default(), &options).unwrap();
    assert_eq!(frames(&bag).iter().map(|f| f.1).collect::<Vec<_>>(), [6, 7, 8]);
    assert_eq!(bag.stereo().expected_frames(), Some(3));
    let mono = EurocOptions { sizes_px: vec![(4, 2)], ..EurocOptions::default() };
    let bag = BagDataset::open(&path, &BagTopics::default(), &mono).unwrap();
    assert!(bag.cameras() == 1 && frames(&bag).iter().all(|f| f.2[0].is_some() && f.2[1].is_none()));
}

#[test]
fn files_of_one_recording_follow_each_other() {
    let folder = tempfile::tempdir().unwrap();
    let all = messages(Order::Little);
    let (first, second) = all.split_at(50);
    write(&folder.path().join("b_9.mcap"), None, first);
    write(&folder.path().join("b_10.mcap"), None, second);
    let parts = BagDataset::open(folder.path(), &BagTopics::default(), &options()).unwrap();
    let whole_path = folder.path().join("whole");
    std::fs::create_dir(&whole_path).unwrap();
    write(&whole_path.join("w.mcap"), None, &all);
    let whole = BagDataset::open(&whole_path, &BagTopics::default(), &options()).unwrap();
    assert_eq!(frames(&parts), frames(&whole));
}

#[test]
fn what_breaks_off_is_read_up_to_there_and_what_is_bent_is_refused() {
    let (_folder, path) = place("bag.mcap");
    write(&path, None, &messages(Order::Little));
    let sound = std::fs::read(&path).unwrap();
    std::fs::write(&path, &sound[..sound.len() * 6 / 10]).unwrap();
    let bag = BagDataset::open(&path, &BagTopics::default(), &options()).unwrap();
    assert!(bag.is_truncated() && (2..9).contains(&frames(&bag).len()));
    let mut bent = sound.clone();
    bent[sound.len() / 2] ^= 0x10;
    std::fs::write(&path, &bent).unwrap();
    let refused = BagDataset::open(&path, &BagTopics::default(), &options()).unwrap_err().to_string();
    assert!(refused.contains("damaged") && refused.contains("bag.mcap"), "{refused}");
    std::fs::write(&path, b"no bag at all, but long enough to be looked at").unwrap();
    let refused = BagDataset::open(&path, &BagTopics::default(), &options()).unwrap_err().to_string();
    assert!(refused.contains("is no bag: neither an MCAP file"), "{refused}");
}

#[test]
fn refusals_name_topics_sizes_and_encodings() {
    let (_folder, path) = place("bag.mcap");
    write(&path, None, &messages(Order::Little));
    let refusal = |topics: &BagTopics, options: &EurocOptions| {
        BagDataset::open(&path, topics, options).unwrap_err().to_string()
    };
    let wrong = BagTopics { left: Some("/cam7/image_raw".into()), ..BagTopics::default() };
    let words = refusal(&wrong, &options());
    assert!(
        words.contains("/cam7/image_raw") && words.contains("/cam0/image_raw (sensor_msgs/msg/Image)"),
        "{words}"
    );
    let large = EurocOptions { sizes_px: vec![(752, 480); 2], ..EurocOptions::default() };
    let words = refusal(&BagTopics::default(), &large);
    assert!(words.contains("4x2") && words.contains("752x480") && words.contains("--config"), "{words}");
    write(&path, None, &[("/imu0", IMU, imu_message(BEGIN, 0.0, Order::Little))]);
    assert!(refusal(&BagTopics::default(), &options()).contains("holds no images"));
    let mut bayer = image_message(BEGIN, 1, Order::Little);
    let at = bayer.windows(5).position(|w| w == b"mono8").unwrap();
    bayer[at..at + 5].copy_from_slice(b"bayer");
    write(&path, None, &[("/image", IMAGE, bayer)]);
    let words = refusal(&BagTopics::default(), &options());
    assert!(words.contains("'bayer'") && words.contains("mono8, mono16"), "{words}");
    let mut webp = Encoder::new(Order::Little);
    webp.header(BEGIN);
    webp.text("webp");
    webp.sequence(b"RIFF\0\0\0\0WEBPVP8 ");
    write(&path, None, &[("/image/compressed", "sensor_msgs/msg/CompressedImage", webp.bytes)]);
    let words = refusal(&BagTopics::default(), &options());
    assert!(words.contains("another format") && words.contains("baseline JPEG"), "{words}");
}

/// A message of one quantity: zeros and -1 in the covariance stand for the other.
fn half_message(stamp_ns: i64, gyro: Option<f64>, accel: Option<f64>, order: Order) -> Vec<u8> {
    let mut out = Encoder::new(order);
    out.header(stamp_ns);
    (0..13).for_each(|_| out.f64(0.0));
    for value in [gyro, accel] {
        (0..3).for_each(|_| out.f64(value.unwrap_or(0.0)));
        out.f64(if value.is_some() { 0.01 } else { -1.0 });
        (1..9).for_each(|_| out.f64(0.0));
    }
    out.bytes
}

/// [`messages`] with the inertial samples on the topics `names`: gyroscope at 200 Hz, accelerometer at 125 Hz and half a period
/// later, a second more of it at either end.
fn apart(order: Order, names: [&'static str; 2]) -> Vec<(&'static str, &'static str, Vec<u8>)> {
    let mut all = messages(order);
    let imu_type = if order == Order::Ros1 { "sensor_msgs/Imu" } else { IMU };
    all.retain(|(topic, ..)| *topic != "/imu0");
    let gyro =
        |k: i64| (names[0], imu_type, half_message(BEGIN + 5 * MS * k, Some(0.01 * k as f64), None, order));
    let accel =
        |k: i64| (names[1], imu_type, half_message(BEGIN + 8 * MS * k + 4 * MS, None, Some(k as f64), order));
    all.extend((-125..190).map(accel));
    all.extend((0..100).map(gyro));
    all
}

#[test]
fn gyroscope_and_accelerometer_apart_are_flown_together() {
    let (_folder, path) = place("bag.mcap");
    let two = ["/camera/gyro/sample", "/camera/accel/sample"];
    for (order, names) in [(Order::Little, two), (Order::Ros1, two), (Order::Big, ["/imu"; 2])] {
        write(&path, None, &apart(order, names));
        let samples = read_bag_imu(&path, &BagTopics::default()).unwrap();
        assert_eq!(samples.len(), 100, "{names:?}");
        for (k, sample) in samples.iter().enumerate() {
            let at_ms = 5.0 * k as f64;
            assert!((sample.gyro.x - 0.01 * k as f64).abs() < 1e-12);
            assert!((sample.accel.x - (at_ms - 4.0) / 8.0).abs() < 1e-9, "{names:?}: {sample:?}");
        }
        let bag = BagDataset::open(&path, &BagTopics::default(), &options()).unwrap();
        assert_eq!((frames(&bag), bag.defects()), (expected_frames(), &[][..]));
        assert_eq!(bag.imu_topics(), names);
    }
    let gyro_alone: Vec<_> = apart(Order::Little, two).into_iter().filter(|m| m.0 != two[1]).collect();
    write(&path, None, &gyro_alone);
    let words = refusal(&path);
    assert!(words.contains("/camera/gyro/sample holds rates of rotation alone"), "{words}");
}

#[test]
fn topics_without_stamps_are_refused_by_name() {
    let (_folder, path) = place("bag.mcap");
    for (topic, what) in [("/imu0", "messages"), ("/cam0/image_raw", "images"), ("/cam1/image_raw", "images")]
    {
        let unstamped = |(name, kind, content): (&'static str, &'static str, Vec<u8>)| {
            let mut content = content;
            if name == topic {
                content[4..12].fill(0);
            }
            (name, kind, content)
        };
        write(&path, None, &messages(Order::Little).into_iter().map(unstamped).collect::<Vec<_>>());
        let words = refusal(&path);
        assert!(words.contains(&format!("{topic} is not stamped: all ")), "{words}");
        assert!(words.contains(&format!("{what} have the stamp 0; let the driver")), "{words}");
    }
}

#[test]
fn ten_bits_in_sixteen_are_scaled_over_the_whole_bag() {
    let (_folder, path) = place("bag.mcap");
    let wide = |stamp_ns: i64, value: u16| {
        let mut out = Encoder::new(Order::Little);
        out.header(stamp_ns);
        out.u32(2);
        out.u32(4);
        out.text("mono16");
        out.put([0]);
        out.u32(8);
        out.sequence(&value.to_le_bytes().repeat(8));
        out.bytes
    };
    let bag = |brightest: u16| {
        let mut all: Vec<_> = messages(Order::Little).into_iter().filter(|m| m.0 == "/imu0").collect();
        for k in 0..9_i64 {
            let at = BEGIN + 50 * MS * k;
            all.push(("/cam0/image_raw", IMAGE, wide(at, if k == 8 { brightest } else { 100 * k as u16 })));
            all.push(("/cam1/image_raw", IMAGE, wide(at, 64)));
        }
        write(&path, None, &all);
        BagDataset::open(&path, &BagTopics::default(), &options()).unwrap()
    };
    let ten = bag(1023);
    assert_eq!(frames(&ten)[4].2, [Some(100), Some(16)]);
    let all = bag(0x8000);
    assert_eq!((all.defects().len(), frames(&all)[4].2), (0, [Some(1), Some(0)]));
}
