//! Against the drivers of a flight: its frame socket and its serial line. The local socket of a real flight is read by
//! `tests/process`.

use super::*;
use nalgebra::Vector3;
use plumbline_config::options::{ImuConfig, ImuDriverConfig, ImuProtocol, SerialLine};
use plumbline_config::{GrayImage, ImageView, ImuSample, Timestamp};
use plumbline_drivers::{ImuSource as _, SerialImu, SocketStereo, StereoFrame, StereoSource as _, StopFlag};
use plumbline_estimator::{Odometry, ResetKind};
use plumbline_record::layout;
use plumbline_record::local::record::{Kind, Kinds, MAGIC, encoded};
use plumbline_record::local::request::{Answer, Inbox, Request, RequestStatus};
use std::io::{Read as _, Write as _};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::Path;
use std::thread;
use std::time::Duration;

const PATIENCE: Duration = Duration::from_secs(10);
const SIZE: (usize, usize) = (64, 48);

fn grey(level: u8) -> GrayImage {
    GrayImage::from_pixels(SIZE.0, SIZE.1, vec![level; SIZE.0 * SIZE.1]).unwrap()
}

#[test]
fn frames_arrive_with_padded_rows_and_missing_images() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("frames");
    let mut source = SocketStereo::open(&path, [SIZE; 2], 20.0, StopFlag::new()).unwrap();
    let mut sender = FrameSender::connect(&path, PATIENCE).unwrap();
    let padded: Vec<u8> =
        (0..SIZE.1).flat_map(|y| [[y as u8; SIZE.0].as_slice(), &[255; 16]].concat()).collect();
    let left = ImageView::new(SIZE.0, SIZE.1, SIZE.0 + 16, &padded).unwrap();
    let stamp = |back_ms: i64| Timestamp::from_nanos(monotonic_ns() - back_ms * 1_000_000);
    let right = grey(7);
    sender.send(5, stamp(100), [Some(left), Some(right.view())]).unwrap();
    sender.send(6, stamp(50), [None, Some(right.view())]).unwrap();
    assert!(matches!(sender.send(7, stamp(0), [None, None]), Err(ClientError::NoImage)));
    let mut frame = StereoFrame::new([SIZE; 2]);
    assert!(source.next_frame(&mut frame).unwrap());
    assert_eq!(frame.valid, [true; 2]);
    assert!((0..SIZE.1).all(|y| frame.images[0].view().row(y).iter().all(|level| *level == y as u8)));
    assert_eq!(frame.images[1], right);
    assert!(source.next_frame(&mut frame).unwrap());
    assert_eq!((frame.sequence, frame.valid), (1, [false, true]));
}

#[test]
fn a_sender_stays_closed_after_the_flight_has_gone() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("frames");
    let missing = FrameSender::connect(&path, Duration::from_millis(30)).unwrap_err();
    assert!(matches!(missing, ClientError::Connect { .. }), "{missing}");
    let listener = UnixListener::bind(&path).unwrap();
    let mut sender = FrameSender::connect(&path, PATIENCE).unwrap();
    drop(listener.accept().unwrap());
    let image = grey(1);
    for _ in 0..2 {
        let error = sender.send(0, Timestamp::default(), [Some(image.view()), None]).unwrap_err();
        assert!(matches!(error, ClientError::Closed), "{error}");
    }
}

#[test]
fn the_serial_driver_of_a_flight_reads_the_line() {
    let folder = tempfile::tempdir().unwrap();
    let name = folder.path().join("imu");
    let about = SensorAbout { rate_hz: 200.0, gyro_range_rad_s: 17.4, accel_range_m_s2: 156.9 };
    let mut line = ImuLine::open(&name, about).unwrap();
    let not_finite =
        ImuSample { stamp: Timestamp::default(), gyro: Vector3::zeros(), accel: Vector3::repeat(f64::NAN) };
    assert!(matches!(line.send(&not_finite), Err(ClientError::NotFinite)));
    let stop = StopFlag::new();
    let serial = SerialLine { device: name.to_str().unwrap().to_owned(), baud: 921_600 };
    let driver = ImuDriverConfig { protocol: ImuProtocol::Plumbline, ..ImuDriverConfig::default() };
    let imu = ImuConfig::with_noise(200.0, (1e-3, 1e-5), (1e-2, 1e-3));
    let mut source = SerialImu::at(&serial, &driver, &imu, 20.0, stop.clone()).unwrap();
    let reader = thread::spawn(move || source.next_reading().unwrap().map(|reading| reading.sample));
    let accel = Vector3::new(0.25, 0.5, 9.75);
    while !reader.is_finished() {
        line.send(&ImuSample { stamp: Timestamp::from_nanos(monotonic_ns()), gyro: Vector3::zeros(), accel })
            .unwrap();
        thread::sleep(Duration::from_millis(5));
    }
    let sample = reader.join().unwrap().unwrap();
    assert_eq!(sample.accel, accel);
    stop.stop();
    drop(line);
    assert!(!name.is_symlink());
}

/// The flight's end of a connection: greets with these rights, and sends odometry of this many sequence numbers.
fn greet(stream: &mut UnixStream, rights: u8, count: u64) {
    let greeting =
        encoded(Kind::Hello.kind(), 0, |to| to.extend([&MAGIC[..], &[rights, 0, 0, 0, 0, 0, 0, 0]].concat()));
    stream.write_all(&greeting).unwrap();
    for sequence in 0..count {
        let odometry = Odometry { sequence, ..Odometry::default() };
        stream
            .write_all(&encoded(Kind::Odometry.kind(), sequence, |to| {
                layout::put_odometry(&odometry, 9, 3, to)
            }))
            .unwrap();
    }
}

/// Requests that come over a connection until there are `count`.
fn requests(stream: &mut UnixStream, count: usize) -> Vec<(u64, Option<Request>)> {
    let (mut inbox, mut got) = (Inbox::default(), Vec::new());
    while got.len() < count {
        let read = stream.read(inbox.room()).unwrap();
        inbox.add(read);
        got.extend(std::iter::from_fn(|| inbox.next_request().unwrap()).map(|n| (n.number, n.request)));
    }
    got
}

fn connected(path: &Path) -> Result<Local, ClientError> {
    Local::connect(path, PATIENCE)
}

#[test]
fn odometry_is_read_and_a_command_is_answered_beside_it() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("local");
    let listener = UnixListener::bind(&path).unwrap();
    let flight = thread::spawn(move || {
        let (mut reader, _) = listener.accept().unwrap();
        greet(&mut reader, 1, 2);
        let (mut commander, _) = listener.accept().unwrap();
        greet(&mut commander, 1, 1);
        let asked = requests(&mut commander, 2);
        assert_eq!(asked[0].1, Some(Request::Subscribe(Kinds::default())));
        assert_eq!(asked[1].1, Some(Request::Reset(ResetKind::Soft)));
        let answer =
            Answer { number: asked[1].0, status: RequestStatus::Done, value: 0, words: "reset".into() };
        commander.write_all(&answer.encode()).unwrap();
        reader
    });
    let mut local = connected(&path).unwrap();
    assert!(local.may_command());
    let answer = local.command(&Request::Reset(ResetKind::Soft), PATIENCE).unwrap();
    assert_eq!((answer.status, answer.words.as_str()), (RequestStatus::Done, "reset"));
    for sequence in 0..2 {
        let header = local.next_header(Some(PATIENCE)).unwrap().unwrap();
        assert_eq!((header.kind, header.sequence), (Kind::Odometry.kind(), sequence));
        assert_eq!(layout::odometry(local.content()).unwrap().0.sequence, sequence);
    }
    assert_eq!(local.next_header(Some(Duration::from_millis(20))).unwrap(), None);
    drop(flight.join().unwrap());
    assert!(matches!(local.next_header(None), Err(ClientError::Closed)));
}

#[test]
fn a_socket_of_another_program_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("local");
    let listener = UnixListener::bind(&path).unwrap();
    for bytes in [
        vec![255; 64],
        encoded(Kind::Odometry.kind(), 0, |_| {}),
        encoded(Kind::Hello.kind(), 0, |to| to.push(1)),
    ] {
        let connection = path.clone();
        let client = thread::spawn(move || connected(&connection));
        let (mut stream, _) = listener.accept().unwrap();
        stream.write_all(&bytes).unwrap();
        let error = client.join().unwrap().unwrap_err();
        assert!(matches!(error, ClientError::Foreign(_)), "{error}");
    }
}

#[test]
fn the_end_of_an_old_line_leaves_the_name_to_its_successor() {
    let folder = tempfile::tempdir().unwrap();
    let name = folder.path().join("imu");
    let about = SensorAbout { rate_hz: 200.0, gyro_range_rad_s: 17.0, accel_range_m_s2: 150.0 };
    let old = ImuLine::open(&name, about).unwrap();
    let before = std::fs::read_link(&name).unwrap();
    let new = ImuLine::open(&name, about).unwrap();
    let terminal = std::fs::read_link(&name).unwrap();
    assert_ne!(before, terminal);
    drop(old);
    assert_eq!(std::fs::read_link(&name).unwrap(), terminal, "the new program's device");
    // Nor is a file taken away that somebody has put there meanwhile.
    std::fs::remove_file(&name).unwrap();
    std::fs::write(&name, "notes").unwrap();
    drop(new);
    assert_eq!(std::fs::read_to_string(&name).unwrap(), "notes");
    assert!(ImuLine::open(&name, about).is_err(), "a file is not replaced");
    std::fs::remove_file(&name).unwrap();
    drop(ImuLine::open(&name, about).unwrap());
    assert!(!name.is_symlink() && std::fs::read_dir(folder.path()).unwrap().count() == 0);
}
