use super::*;
use std::io::Write as _;
use std::path::PathBuf;

const SIZES: [(usize, usize); 2] = [(64, 48), (32, 24)];
const BYTES: usize = 64 * 48 + 32 * 24;

struct Rig {
    _folder: tempfile::TempDir,
    path: PathBuf,
    stop: StopFlag,
    source: SocketStereo,
    frame: StereoFrame,
}

fn rig() -> Rig {
    let folder = tempfile::tempdir().unwrap();
    let (path, stop) = (folder.path().join("frames"), StopFlag::new());
    let source = SocketStereo::open(&path, SIZES, 20.0, stop.clone()).unwrap();
    Rig { _folder: folder, path, stop, source, frame: StereoFrame::new(SIZES) }
}

/// A frame whose pixels are all `grey`, measured `age_ms` ago.
fn frame(sequence: u64, grey: u8, age_ms: i64) -> Vec<u8> {
    let sizes_px = SIZES.map(|(width, height)| (width as u32, height as u32));
    let header = FrameHeader { sequence, stamp_ns: monotonic_ns() - age_ms * 1_000_000, sizes_px };
    [&header.encode()[..], &[grey; BYTES]].concat()
}

impl Rig {
    fn next(&mut self) -> (u64, [u8; 2], [bool; 2]) {
        assert!(self.source.next_frame(&mut self.frame).unwrap());
        let grey = |k: usize| self.frame.images[k].pixels()[7];
        (self.frame.sequence, [grey(0), grey(1)], self.frame.valid)
    }
}

#[test]
fn frames_come_in_pieces_of_any_size_and_say_how_many_were_lost() {
    let mut rig = rig();
    let mut sender = UnixStream::connect(&rig.path).unwrap();
    let bytes = [frame(7, 10, 30), frame(8, 20, 20), frame(11, 30, 10)].concat();
    let writer = std::thread::spawn(move || {
        for piece in bytes.chunks(997) {
            sender.write_all(piece).unwrap();
            std::thread::sleep(Duration::from_micros(200));
        }
        sender
    });
    assert_eq!(rig.next(), (0, [10, 10], [true; 2]));
    assert_eq!(rig.next(), (1, [20, 20], [true; 2]));
    assert_eq!(rig.next(), (4, [30, 30], [true; 2]));
    assert_eq!(rig.source.faults().missing, 2);
    let age_ms = (monotonic_ns() - rig.frame.stamp.as_nanos()) / 1_000_000;
    assert!((10..5000).contains(&age_ms), "{age_ms} ms");
    let mut sender = writer.join().unwrap();
    // The left image alone.
    let header = FrameHeader { sequence: 12, stamp_ns: monotonic_ns(), sizes_px: [(64, 48), (0, 0)] };
    sender.write_all(&header.encode()).unwrap();
    sender.write_all(&[40; 64 * 48]).unwrap();
    let (number, [left, _], valid) = rig.next();
    assert_eq!((number, left, valid), (5, 40, [true, false]));
    assert_eq!((rig.source.faults().unpaired, rig.source.monitor().trouble()), (1, None));
}

#[test]
fn numbers_that_wrap_or_begin_anew_lose_no_frame() {
    let mut rig = rig();
    let mut sender = UnixStream::connect(&rig.path).unwrap();
    // The last one begins anew, 50 ms after the one before it.
    let numbers = [u64::MAX - 1, u64::MAX, 0, 2, 0];
    for (k, number) in (0..).zip(numbers) {
        sender.write_all(&frame(number, 1, 250 - 50 * k)).unwrap();
    }
    let taken = numbers.map(|_| rig.next().0);
    assert_eq!(taken, [0, 1, 2, 4, 5], "one is missing between 0 and 2");
    assert_eq!(rig.source.faults().missing, 1);
}

#[test]
fn nothing_is_allocated_for_a_frame() {
    let mut rig = rig();
    let mut sender = UnixStream::connect(&rig.path).unwrap();
    sender.write_all(&[frame(1, 1, 30), frame(2, 2, 20), frame(3, 3, 10)].concat()).unwrap();
    rig.next();
    let counted = allocation_counter::measure(|| {
        rig.source.next_frame(&mut rig.frame).unwrap();
        rig.source.next_frame(&mut rig.frame).unwrap();
    });
    assert_eq!((counted.count_total, rig.frame.sequence), (0, 2));
}

#[test]
fn a_program_may_go_within_a_frame_and_another_goes_on() {
    let mut rig = rig();
    let path = rig.path.clone();
    let programs = std::thread::spawn(move || {
        let mut first = UnixStream::connect(&path).unwrap();
        first.write_all(&frame(90, 1, 200)).unwrap();
        first.write_all(&frame(91, 2, 150)[..BYTES / 2]).unwrap();
        drop(first);
        let mut second = UnixStream::connect(&path).unwrap();
        // Its numbers begin anew: time says how many are missing.
        second.write_all(&frame(0, 3, 0)).unwrap();
        second
    });
    assert_eq!(rig.next(), (0, [1, 1], [true; 2]));
    let (number, grey, _) = rig.next();
    assert_eq!((number >= 4, grey), (true, [3, 3]), "{number}");
    let figures = rig.source.monitor().figures();
    assert_eq!((figures.connected, figures.lost, figures.refused), (2, 1, 0));
    drop(programs.join().unwrap());
}

#[test]
fn a_program_that_drips_its_bytes_gives_way() {
    let mut rig = rig();
    let mut slow = UnixStream::connect(&rig.path).unwrap();
    slow.write_all(&frame(1, 1, 0)[..100]).unwrap();
    let path = rig.path.clone();
    let programs = std::thread::spawn(move || {
        let mut drops = 0;
        while slow.write_all(&[0]).is_ok() {
            drops += 1;
            std::thread::sleep(Duration::from_millis(200));
        }
        let mut next = UnixStream::connect(&path).unwrap();
        next.write_all(&frame(0, 3, 0)).unwrap();
        (drops, next)
    });
    assert_eq!(rig.next().1, [3, 3]);
    let (drops, _next) = programs.join().unwrap();
    assert!(drops > 1, "it was sent away for its bytes, not for silence");
    assert_eq!(rig.source.monitor().figures().lost, 1);
}

#[test]
fn a_program_that_cannot_be_accepted_is_reported_and_taken_later() {
    use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
    let mut rig = rig();
    let mut sender = UnixStream::connect(&rig.path).unwrap();
    sender.write_all(&frame(1, 7, 0)).unwrap();
    let limit = getrlimit(Resource::Nofile);
    // No descriptor is free below the highest in use.
    setrlimit(Resource::Nofile, Rlimit { current: Some(3), ..limit }).unwrap();
    let (monitor, stop) = (rig.source.monitor(), rig.stop.clone());
    let watcher = std::thread::spawn(move || {
        loop {
            let trouble = monitor.trouble().unwrap_or_default();
            if trouble.contains("cannot be accepted") || stop.is_stopped() {
                setrlimit(Resource::Nofile, limit).unwrap();
                return trouble;
            }
            std::thread::sleep(Duration::from_millis(5));
        }
    });
    assert_eq!(rig.next().1, [7, 7]);
    assert!(watcher.join().unwrap().contains("os error 24"));
    assert_eq!(rig.source.monitor().trouble(), None);
}

#[test]
fn what_is_no_frame_of_this_rig_is_sent_away_with_the_reason() {
    for (bytes, says) in [
        (vec![b'x'; 64], "docs/own-sensors.md"),
        (
            FrameHeader { sequence: 1, stamp_ns: 1, sizes_px: [(640, 480), (0, 0)] }.encode().to_vec(),
            "640 x 480 px was sent, and camera[0] has 64 x 48",
        ),
    ] {
        let mut rig = rig();
        let (path, stop, monitor) = (rig.path.clone(), rig.stop.clone(), rig.source.monitor());
        let sender = std::thread::spawn(move || {
            let mut sender = UnixStream::connect(&path).unwrap();
            sender.write_all(&bytes).unwrap();
            // It is told by the end of its connection.
            let _ = sender.read(&mut [0; 1]);
            stop.stop();
        });
        assert!(!rig.source.next_frame(&mut rig.frame).unwrap());
        sender.join().unwrap();
        assert_eq!(monitor.figures().refused, 1);
        let trouble = monitor.trouble().unwrap();
        assert!(trouble.contains(says) && trouble.contains("driver.frames.listen"), "{trouble}");
    }
}

#[test]
fn stamps_that_make_no_sense_are_replaced_and_those_that_go_back_refused() {
    let mut rig = rig();
    let mut sender = UnixStream::connect(&rig.path).unwrap();
    let mut nonsense = frame(1, 1, 0);
    nonsense[16..24].copy_from_slice(&5_i64.to_le_bytes());
    sender.write_all(&nonsense).unwrap();
    assert_eq!(rig.next().1, [1, 1]);
    sender.write_all(&[frame(2, 2, 5000), frame(3, 3, 0)].concat()).unwrap();
    assert_eq!(rig.next(), (2, [3, 3], [true; 2]));
    let figures = rig.source.monitor().figures();
    assert_eq!((figures.restamped, figures.disordered, rig.source.faults().missing), (1, 1, 1));
}

#[test]
fn frames_that_are_sent_again_long_after_do_not_set_the_clock() {
    let mut rig = rig();
    let mut sender = UnixStream::connect(&rig.path).unwrap();
    sender.write_all(&frame(1, 1, 15)).unwrap();
    assert_eq!(rig.next().1, [1, 1]);
    // A second of frames that are older than any on their way, over and over.
    for k in 0..20 {
        sender.write_all(&frame(k, 9, 11_000 - 50 * k as i64)).unwrap();
    }
    sender.write_all(&frame(2, 3, 0)).unwrap();
    assert_eq!(rig.next().1, [3, 3]);
    let figures = rig.source.monitor().figures();
    assert_eq!((figures.restamped, figures.disordered), (0, 20));
}

#[test]
fn a_socket_that_was_left_behind_is_taken_and_one_in_use_is_not() {
    let rig = rig();
    let again = SocketStereo::open(&rig.path, SIZES, 20.0, StopFlag::new()).unwrap_err().to_string();
    assert!(again.contains("another process listens"), "{again}");
    let left = rig.path.with_file_name("left");
    drop(UnixListener::bind(&left).unwrap());
    drop(SocketStereo::open(&left, SIZES, 20.0, StopFlag::new()).unwrap());
    assert!(!left.exists());
    std::fs::write(&left, "text").unwrap();
    let other = SocketStereo::open(&left, SIZES, 20.0, StopFlag::new()).unwrap_err().to_string();
    assert!(other.contains("not a socket"), "{other}");
    let nowhere = SocketStereo::open(Path::new("/nowhere/at/all"), SIZES, 20.0, StopFlag::new());
    assert!(nowhere.unwrap_err().to_string().contains("driver.frames.listen"));
}
