//! Entry points of the fuzzers (`fuzz/`): each function takes any bytes, and a panic is a finding.
//!
//! The tests of this crate run these functions over the checked-in seeds, and over seeded mutations of them.

use crate::BagTopics;
use crate::DriverError;
use crate::bag::container::{Step, Topic};
use crate::bag::holds::Holds;
use crate::bag::mcap_file::McapFile;
use crate::bag::messages::{self, Format, Kind};
use crate::bag::pixels::{self, ImageDecoder};
use crate::bag::ros1_file::Ros1File;
use crate::bag::sqlite_file::SqliteFile;
use crate::bag::topics as bag_topics;
use crate::bag::wire::Encoding;
use crate::euroc::depth::Depth;
use crate::euroc::image::gray_png;
use crate::euroc::imu::{IMU_COLUMNS, ImuRecord, is_possible, parse_imu_row};
use crate::euroc::pairing::{self, IMAGE_COLUMNS, ImageRow, parse_image_row};
use crate::euroc::table::{Stamped, Table, read_rows};
use crate::euroc::truth::{TRUTH_COLUMNS, parse_truth_row};
use crate::frame_socket::FrameHeader;
use crate::iio::layout::{Storage, parse_matrix};
use crate::inertial::{FramingFigures, LinkFigures};
use crate::serial::Stream;
use crate::serial::framing::{Deframer, LONGEST};
use crate::serial::fuzzing::{Device, imu_config, opened};
use crate::serial::protocol::{Content, DeviceSample};
use crate::tum::{read_tum_from, write_pose};
use crate::v4l2::fuzzing as camera;
use plumbline_config::options::ImuProtocol;
use plumbline_config::{GrayImage, Timestamp};
use std::path::Path;

/// Largest image, px: larger ones make the fuzzer slow and show nothing more.
const MAX_SIDE_PX: usize = 256;
/// Difference of stamps within a stereo pair, ns: two milliseconds.
const PAIR_TOLERANCE_NS: i64 = 2_000_000;

fn no_file() -> &'static Path {
    Path::new("fuzz")
}

/// An image: what is read has the size that its header says.
///
/// # Panics
/// When it has not.
pub fn png(data: &[u8]) {
    if let Ok(image) = gray_png(no_file(), data, 1..=MAX_SIDE_PX) {
        assert_eq!(image.pixels().len(), image.width() * image.height());
    }
}

/// The tables of a EuRoC data set: images, paired, inertial samples, ground truth.
///
/// # Panics
/// When rows come back out of order, or with what is no number.
pub fn euroc_csv(data: &[u8]) {
    if let Ok(table) = read_rows(no_file(), IMU_COLUMNS, data, parse_imu_row) {
        check_order(&table);
        assert!(table.rows.iter().all(|s| s.gyro.iter().chain(&s.accel).all(|x| x.is_finite())));
        assert!(ImuRecord::new(table).span().is_some());
    }
    if let Ok(table) = read_rows(no_file(), TRUTH_COLUMNS, data, parse_truth_row) {
        check_order(&table);
        assert!(table.rows.iter().all(|s| (s.pose_w_b.rotation.norm() - 1.0).abs() < 1e-9));
    }
    if let Ok(table) = read_rows(no_file(), IMAGE_COLUMNS, data, parse_image_row) {
        check_order(&table);
        pair(&table.rows);
    }
}

fn check_order<T: Stamped>(table: &Table<T>) {
    assert!(!table.rows.is_empty());
    assert!(table.rows.is_sorted_by(|a, b| a.stamp() < b.stamp()));
}

/// Pairs every other row with the rest: each image is handed out once or counted.
fn pair(rows: &[ImageRow]) {
    let of_camera = |camera: usize| rows.iter().skip(camera).step_by(2).cloned().collect::<Vec<_>>();
    let pairing = pairing::stereo(of_camera(0), of_camera(1), PAIR_TOLERANCE_NS);
    let handed_out = pairing.frames.iter().flat_map(|frame| frame.files.iter().flatten()).count();
    assert_eq!(handed_out as u64 + pairing.outside, rows.len() as u64);
    assert!(pairing.frames.is_sorted_by(|a, b| (a.stamp, a.sequence) <= (b.stamp, b.sequence)));
    assert_eq!(pairing::monocular(rows.to_vec()).frames.len(), rows.len());
}

/// A trajectory: what is read can be written, and has the same stamps when it is read again.
///
/// # Panics
/// When it has not.
pub fn tum(data: &[u8]) {
    let Ok(poses) = read_tum_from(no_file(), data) else { return };
    let mut text = Vec::new();
    for pose in &poses {
        assert!(pose.pose.translation.vector.iter().all(|x| x.is_finite()));
        write_pose(&mut text, pose).expect("memory takes everything");
    }
    let Ok(back) = read_tum_from(no_file(), text.as_slice()) else {
        panic!("what was written is refused: {}", String::from_utf8_lossy(&text));
    };
    let stamps = |poses: &[crate::StampedPose]| poses.iter().map(|p| p.stamp).collect::<Vec<Timestamp>>();
    assert_eq!(stamps(&back), stamps(&poses));
}

/// An image of a camera (JPEG): one that is accepted has all of its rows.
///
/// # Panics
/// When they do not.
pub fn mjpeg(data: &[u8]) {
    camera::mjpeg(data, MAX_SIDE_PX);
}

/// A driver's buffer of any layout, which the first bytes say: it is read within its bounds, or refused.
///
/// # Panics
/// When it is not.
pub fn camera_buffer(data: &[u8]) {
    camera::buffer(data);
}

/// Header of a frame from a program: an accepted header fits the rig, and is written the same.
///
/// # Panics
/// When it does not, or is not.
pub fn frame_header(data: &[u8]) {
    let rig_px = [(752, 480), (640, 400)];
    let mut bytes = [0; FrameHeader::BYTES];
    bytes.iter_mut().zip(data).for_each(|(to, from)| *to = *from);
    if let Ok(header) = FrameHeader::decode(&bytes, rig_px) {
        assert_eq!(header.encode(), bytes);
        let fits = |k: usize| {
            header.sizes_px[k] == (0, 0) || header.sizes_px[k] == (rig_px[k].0 as u32, rig_px[k].1 as u32)
        };
        assert!(fits(0) && fits(1) && header.valid() != [false, false]);
    }
}

/// A serial line. The first byte names its protocol, the second says how the others are cut.
///
/// # Panics
/// When readings depend on how the bytes are cut, are no numbers or go back in time, when more bytes are counted than
/// came, or when a frame behind the bytes is not found.
pub fn imu_serial(data: &[u8]) {
    let [named, piece, bytes @ ..] = data else { return };
    let protocol = ImuProtocol::ALL[usize::from(*named) % ImuProtocol::ALL.len()];
    let (whole, figures) = readings(protocol, bytes, usize::MAX);
    let (cut, cut_figures) = readings(protocol, bytes, 1 + usize::from(*piece));
    assert_eq!(cut, whole);
    assert_eq!(cut_figures, figures);
    assert!(figures.passed_over <= figures.bytes && figures.bytes == bytes.len() as u64);
    assert!(whole.iter().flat_map(|s| s.gyro.iter().chain(&s.accel)).all(|number| number.is_finite()));
    // What only began like a frame ends with these; then a frame is found.
    let device = Device { protocol, rate_hz: 200, start_ns: 0, skew: 0.0 };
    let frame = device.frame(7);
    let (followed, _) = readings(protocol, &[bytes, &[0; LONGEST], &frame, &frame].concat(), usize::MAX);
    assert!(followed.len() > whole.len() || protocol == ImuProtocol::Mavlink);
    flight(&device, bytes, 1 + usize::from(*piece));
}

/// The samples of a line, and what was counted.
fn readings(protocol: ImuProtocol, bytes: &[u8], piece: usize) -> (Vec<DeviceSample>, FramingFigures) {
    let mut protocol = opened(protocol);
    let (mut deframer, mut found) = (Deframer::default(), Vec::new());
    for piece in bytes.chunks(piece) {
        let mut left = piece;
        while !left.is_empty() {
            let space = deframer.space();
            let count = left.len().min(space.len());
            space[..count].copy_from_slice(&left[..count]);
            deframer.advance(count);
            left = &left[count..];
            while let Some(frame) = deframer.next(|bytes| protocol.scan(bytes)) {
                if let Content::Sample(sample) = protocol.decode(frame) {
                    found.push(sample);
                }
            }
        }
    }
    (found, deframer.figures())
}

/// The bytes within a flight: a second and a half of a device, then these, then the device again.
fn flight(device: &Device, bytes: &[u8], piece: usize) {
    let mut stream = Stream::new(opened(device.protocol), &imu_config(200.0), 0);
    let (mut now_ns, mut last) = (0_i64, None);
    let mut take = |stream: &mut Stream, bytes: &[u8], now_ns: i64| {
        stream.space()[..bytes.len()].copy_from_slice(bytes);
        stream.came(bytes.len());
        while let Some(reading) = stream.next(now_ns) {
            assert!(reading.sample.is_finite());
            let place = (reading.sequence, reading.sample.stamp);
            assert!(last.is_none_or(|last: (u64, Timestamp)| last.0 < place.0 && last.1 < place.1));
            last = Some(place);
        }
    };
    for k in 0..300 {
        now_ns = device.truth_ns(k);
        take(&mut stream, &device.frame(k), now_ns);
    }
    for piece in bytes.chunks(piece) {
        now_ns += 1_000_000;
        take(&mut stream, piece, now_ns);
    }
    for k in 300..320 {
        take(&mut stream, &device.frame(k), now_ns.max(device.truth_ns(k)));
    }
    let figures = stream.figures(LinkFigures::default());
    assert!(figures.samples <= figures.framing.frames);
}

/// Buffer layout as the kernel describes it: the type of an element on the first line, a mount matrix on the
/// second, then bytes.
///
/// # Panics
/// When a number has more bits than its type says, or a matrix other numbers than its text.
pub fn iio_layout(data: &[u8]) {
    let mut parts = data.splitn(3, |byte| *byte == b'\n');
    let mut text = || std::str::from_utf8(parts.next().unwrap_or_default()).unwrap_or_default();
    let (kind, matrix) = (text(), text());
    let mut bytes = [0; 8];
    bytes.iter_mut().zip(parts.next().unwrap_or_default()).for_each(|(to, from)| *to = *from);
    if let Some(storage) = Storage::parse(kind) {
        let (value, bits) = (storage.read(&bytes), storage.bits());
        assert!(bits == 64 || (value >> (bits - 1)).abs() <= 1, "{kind}: {value}");
    }
    if let Some(matrix) = parse_matrix(matrix) {
        assert!(matrix.iter().all(|number| number.is_finite()));
    }
}

/// One message of a topic, of ROS 2 and of ROS 1: as an inertial sample and as an image, which is made grey.
///
/// # Panics
/// When a stamp is not that of its message.
pub fn ros_messages(data: &[u8]) {
    ros_message(Encoding::Cdr, data);
    ros_message(Encoding::Ros1, data);
}

fn ros_message(encoding: Encoding, data: &[u8]) {
    let stamp = messages::stamp(encoding, data);
    if let Some(message) = messages::imu(encoding, data) {
        assert_eq!(Some(message.sample.stamp), stamp);
        let _ = (is_possible(&message.sample), Holds::of(&[message]));
    }
    let mut decoder = ImageDecoder::new(Depth::of_largest(1023));
    for kind in [Kind::Image, Kind::Compressed] {
        let Some(message) = messages::image(Format { kind, encoding }, data) else { continue };
        let size = pixels::size_px(&message).filter(|size| size.0 <= MAX_SIDE_PX && size.1 <= MAX_SIDE_PX);
        if let Some((width, height)) = size {
            let _ = pixels::largest_value(&message);
            let _ = decoder.decode(&message, &mut GrayImage::new(width, height));
        }
    }
}

/// A bag in MCAP: every message that can be flown with, up to where it breaks off or is damaged.
///
/// # Panics
/// When a message is of no topic.
pub fn ros_bag(data: &[u8]) {
    let mut file = McapFile::new(no_file(), data);
    bag(|topics, payload| file.next(topics, payload));
}

/// A ROS 1 bag; as [`ros_bag`].
pub fn ros1_bag(data: &[u8]) {
    let mut file = Ros1File::new(no_file(), data);
    bag(|topics, payload| file.next(topics, payload));
}

/// A bag in a database of SQLite; as [`ros_bag`].
pub fn sqlite_bag(data: &[u8]) {
    let place = tempfile::NamedTempFile::new().expect("a temporary file");
    std::fs::write(&place, data).expect("room for it");
    let Ok(mut file) = SqliteFile::open(place.path()) else { return };
    bag(|topics, payload| file.next(topics, payload));
}

/// The messages that `next` hands out.
fn bag(mut next: impl FnMut(&mut Vec<Topic>, &mut Vec<u8>) -> Result<Step, DriverError>) {
    let (mut topics, mut payload) = (Vec::new(), Vec::new());
    while let Ok(Step::Message(topic, format)) = next(&mut topics, &mut payload) {
        assert_eq!(topics[topic].format, Some(format));
        ros_messages(&payload);
    }
    let named = BagTopics::default();
    let imu = bag_topics::imu(&topics, &named, |topic| [Holds::Both, Holds::Gyro, Holds::Accel][topic % 3]);
    let _ = (bag_topics::cameras(&topics, &named, 2), imu);
}

#[cfg(test)]
#[path = "../../fuzz/smoke.rs"]
mod smoke;

#[cfg(test)]
mod tests {
    use super::smoke::over_seeds_and_mutations;

    #[test]
    fn fuzz_png() {
        over_seeds_and_mutations("png", 5000, super::png);
    }

    #[test]
    fn fuzz_euroc_csv() {
        over_seeds_and_mutations("euroc_csv", 5000, super::euroc_csv);
    }

    #[test]
    fn fuzz_mjpeg() {
        over_seeds_and_mutations("mjpeg", 5000, super::mjpeg);
    }

    #[test]
    fn fuzz_camera_buffer() {
        over_seeds_and_mutations("camera_buffer", 5000, super::camera_buffer);
    }

    #[test]
    fn fuzz_frame_header() {
        over_seeds_and_mutations("frame_header", 5000, super::frame_header);
    }

    #[test]
    fn fuzz_tum() {
        over_seeds_and_mutations("tum", 5000, super::tum);
    }

    #[test]
    fn fuzz_imu_serial() {
        over_seeds_and_mutations("imu_serial", 5000, super::imu_serial);
    }

    #[test]
    fn fuzz_ros_messages() {
        over_seeds_and_mutations("ros_messages", 5000, super::ros_messages);
    }

    #[test]
    fn fuzz_ros_bag() {
        over_seeds_and_mutations("ros_bag", 2000, super::ros_bag);
    }

    #[test]
    fn fuzz_ros1_bag() {
        over_seeds_and_mutations("ros1_bag", 5000, super::ros1_bag);
    }

    #[test]
    fn fuzz_sqlite_bag() {
        over_seeds_and_mutations("sqlite_bag", 1000, super::sqlite_bag);
    }

    #[test]
    fn fuzz_iio_layout() {
        over_seeds_and_mutations("iio_layout", 5000, super::iio_layout);
    }
}
