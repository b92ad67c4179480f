//! Live frames and samples with wrong stamps, what a flight and `doctor --live` say of them, and what a flight says of itself: a program sends frames to the socket, an inertial
//! sensor speaks at a pseudo-terminal.

use super::dataset::Folder;
use super::vehicle::{PLUMBLINE, Running, eventually};
use plumbline_drivers::clock::monotonic_ns;
use plumbline_drivers::frame_socket::FrameHeader;
use plumbline_protocol::{Imu, MAX_FRAME, Message, encode};
use rustix::fd::OwnedFd;
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use std::io::Write as _;
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

/// Longest wait.
const PATIENCE: Duration = Duration::from_secs(20);
/// Size of the images of the preset `sim`, px.
const SIZE: (u32, u32) = (752, 480);

/// A flight with the socket for frames and the terminal of the IMU in `folder`.
fn flight(folder: &Path) -> (Running, PathBuf) {
    let frames = folder.join("frames");
    let mut command = Command::new(PLUMBLINE);
    command.args(["fly", "--config", "sim", "--duration", "60", "--report"]).arg(folder.join("report.json"));
    command.args(sensors(folder));
    command.args(["--set", &format!("local.path=\"{}\"", folder.join("local").display())]);
    (Running::start(command), frames)
}

/// Options for the socket and the terminal in `folder`.
fn sensors(folder: &Path) -> Vec<String> {
    let (frames, imu) = (folder.join("frames"), folder.join("imu"));
    let keys = [
        format!("driver.frames.listen=\"{}\"", frames.display()),
        format!("driver.imu.connect=\"serial://{}:921600\"", imu.display()),
        "driver.imu.protocol=\"plumbline\"".to_owned(),
    ];
    keys.into_iter().flat_map(|key| ["--set".to_owned(), key]).collect()
}

/// Output, log and exit status of `doctor --live`, while `start` makes the sensors in the folder.
fn doctor<S>(start: impl FnOnce(&Path) -> S) -> (Option<i32>, String, String) {
    let folder = tempfile::tempdir().unwrap();
    let mut command = Command::new(PLUMBLINE);
    command.args(["doctor", "--config", "sim", "--live", "--seconds", "3", "--watch", "0.1"]);
    command.args(sensors(folder.path())).stdout(Stdio::piped()).stderr(Stdio::piped());
    let running = command.spawn().unwrap();
    let sending = start(folder.path());
    let output = running.wait_with_output().unwrap();
    drop(sending);
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    (output.status.code(), text(&output.stdout), text(&output.stderr))
}

/// Sends something at a rate until it is dropped.
struct Sender {
    is_over: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Sender {
    fn start(period: Duration, mut send: impl FnMut(u64) + Send + 'static) -> Self {
        let is_over = Arc::new(AtomicBool::new(false));
        let theirs = Arc::clone(&is_over);
        let thread = std::thread::spawn(move || {
            let mut number = 0;
            while !theirs.load(Ordering::Relaxed) {
                send(number);
                number += 1;
                std::thread::sleep(period);
            }
        });
        Self { is_over, thread: Some(thread) }
    }
}

impl Drop for Sender {
    fn drop(&mut self) {
        self.is_over.store(true, Ordering::Relaxed);
        let _ = self.thread.take().map(JoinHandle::join);
    }
}

/// Frames at 20 Hz, stamped by a function of the host's clock, ns.
fn frames(socket: &Path, stamp: fn(i64) -> i64) -> Sender {
    eventually("the socket is there", PATIENCE, || socket.exists());
    let mut stream = UnixStream::connect(socket).unwrap();
    let pixels = vec![90; (2 * SIZE.0 * SIZE.1) as usize];
    Sender::start(Duration::from_millis(50), move |sequence| {
        let header = FrameHeader { sequence, stamp_ns: stamp(monotonic_ns()), sizes_px: [SIZE; 2] };
        // The flight may have ended.
        let _ = stream.write_all(&header.encode()).and_then(|()| stream.write_all(&pixels));
    })
}

/// A terminal whose other end is at `link`.
fn terminal(link: &Path) -> OwnedFd {
    let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
    rustix::io::ioctl_fionbio(&master, true).unwrap();
    grantpt(&master).unwrap();
    unlockpt(&master).unwrap();
    let name = ptsname(&master, Vec::new()).unwrap().into_string().unwrap();
    std::os::unix::fs::symlink(name, link).unwrap();
    master
}

/// An IMU at rest at 200 Hz, whose samples are stamped by a function of the host's clock, ns.
fn imu(link: &Path, stamp: fn(i64) -> i64) -> Sender {
    let master = terminal(link);
    Sender::start(Duration::from_millis(5), move |number| {
        let noise = (number % 7) as f32 * 1e-4;
        let sample = Imu {
            sequence: number as u32,
            time_ns: stamp(monotonic_ns()) as u64,
            gyro_rad_s: [noise, -noise, 2.0 * noise],
            accel_m_s2: [9.8 + noise, 0.3, noise],
            ..Imu::default()
        };
        // What the host asks is not read; what finds no room is lost.
        let _ = rustix::io::write(&master, encode(&Message::Imu(sample), &mut [0; MAX_FRAME]));
    })
}

/// Output of a flight, once it contains `words`.
fn said(running: &Running, words: &str) -> String {
    eventually(words, PATIENCE, || running.words().contains(words));
    running.words()
}

#[test]
fn wrong_stamps_of_live_frames_are_named_with_the_clock_seen_and_expected() {
    let of = |stamp: fn(i64) -> i64, words: &str| {
        let folder = tempfile::tempdir().unwrap();
        let (running, socket) = flight(folder.path());
        let sender = frames(&socket, stamp);
        let text = said(&running, words);
        assert!(text.contains("ns of CLOCK_MONOTONIC is expected"), "{text}");
        assert!(text.contains("time.monotonic_ns()"), "{text}");
        drop(sender);
    };
    of(|_| 0, "stamps are 0");
    of(|now| now / 1000, "are in microseconds");
    of(|now| now / 1_000_000, "are in milliseconds");
    of(|now| now + 3_600_000_000_000, "are of another clock");
}

#[test]
fn repeated_stamps_of_live_frames_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let (running, socket) = flight(folder.path());
    // Ten frames have one stamp.
    let sender = frames(&socket, |now| now / 500_000_000 * 500_000_000);
    let text = said(&running, "are not after the ones before");
    assert!(text.contains("such frames are dropped"), "{text}");
    drop(sender);
}

#[test]
fn wrong_stamps_of_live_samples_are_named_and_good_news_are_no_warnings() {
    for (stamp, words) in [
        ((|now| now / 1000) as fn(i64) -> i64, "are in microseconds"),
        (|now| now / 1_000_000, "are in milliseconds"),
        (|_| 0, "stamps are 0"),
        (|_| 77_000, "are not after the ones before"),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let sensor = imu(&folder.path().join("imu"), stamp);
        let (running, _) = flight(folder.path());
        let text = said(&running, words);
        let line = text.lines().find(|line| line.contains(words)).unwrap();
        assert!(line.contains("WARN") && line.contains("driver.imu"), "{line}");
        assert!(!text.contains("the IMU is available") || text.contains("INFO"), "{text}");
        drop(sensor);
    }
}

#[test]
fn doctor_names_wrong_stamps_of_frames_as_a_flight_does() {
    let (status, said, logged) = doctor(|folder| {
        let sensor = imu(&folder.join("imu"), |now| now);
        (sensor, frames(&folder.join("frames"), |now| now / 1_000_000))
    });
    assert_eq!(status, Some(1), "{said}{logged}");
    let line = said.lines().find(|line| line.contains("are in milliseconds")).expect(&said);
    assert!(
        line.contains("time.monotonic_ns()") && line.contains("ns of CLOCK_MONOTONIC is expected"),
        "{line}"
    );
    assert!(logged.contains("WARN") && logged.contains("are in milliseconds"), "{logged}");
    assert!(logged.contains("not fit to fly") && logged.contains("camera timing"), "{logged}");
}

#[test]
fn doctor_names_samples_in_another_unit_and_the_program_that_is_missing() {
    let (status, said, logged) = doctor(|folder| imu(&folder.join("imu"), |now| now / 1_000_000));
    assert_eq!(status, Some(1), "{said}{logged}");
    for words in [
        "are in milliseconds, where the time of measurement in nanoseconds is expected",
        "no program sends frames yet (driver.frames.listen)",
    ] {
        assert!(said.contains(words) && logged.contains(words), "{words}: {said}{logged}");
    }
    assert!(!said.contains("plumbline devices"), "{said}");
    // What follows from it is one line.
    let lines = said.lines().filter(|line| line.starts_with("not measured")).count();
    assert_eq!(lines, 1, "{said}");
}

#[test]
fn readers_of_the_local_socket_hear_of_bad_stamps() {
    use plumbline_client::Local;
    use plumbline_flight::local::record::{Kind, Kinds};
    use plumbline_flight::local::request::Request;
    use plumbline_record::local::content::LocalRecord;

    let folder = tempfile::tempdir().unwrap();
    let sensor = imu(&folder.path().join("imu"), |now| now);
    let (running, socket) = flight(folder.path());
    let sender = frames(&socket, |_| 0);
    said(&running, "stamps are 0");
    let mut client = Local::over(UnixStream::connect(folder.path().join("local")).unwrap());
    client.requests().unwrap().send(&Request::Subscribe(Kinds::of(&[Kind::Sensors]))).unwrap();
    let news = loop {
        if let LocalRecord::Sensors(news) = client.next_record().unwrap() {
            break news;
        }
    };
    assert!(news.frames.restamped > 0, "{news:?}");
    assert!(news.notices.iter().any(|notice| notice.contains("stamps are 0")), "{news:?}");
    drop((sender, sensor));
}

/// A flight that has to keep up with its sensors.
mod realtime {
    use super::*;
    use crate::hardware::Recording;

    /// Waits until a time of the host, ns.
    fn wait_until(host_ns: i64) {
        let left = host_ns - monotonic_ns();
        std::thread::sleep(Duration::from_nanos(left.max(0) as u64));
    }

    #[test]
    fn a_flight_says_since_when_it_tracks_and_no_message_names_an_option_that_fly_lacks() {
        let folder = Folder::new();
        let (data, config) = (folder.at("data"), folder.at("drone.toml"));
        for arguments in [
            vec!["simulate", &data, "--start", "2", "--duration", "8", "--scale", "0.5"],
            vec!["config", "import", "--euroc", &data, "--base", "sim", "--out", &config],
        ] {
            crate::succeeds(&arguments);
        }
        let recording = Recording::read(Path::new(&data));
        let mut command = Command::new(PLUMBLINE);
        let (frames, imu) = (folder.path().join("frames"), folder.path().join("imu"));
        command.args(["fly", "--config", &config, "--duration", "60"]);
        command.args(["--set", &format!("driver.frames.listen=\"{}\"", frames.display())]);
        command.args(["--set", &format!("driver.imu.connect=\"serial://{}:921600\"", imu.display())]);
        command.args(["--set", "driver.imu.protocol=\"plumbline\""]);
        let master = terminal(&imu);
        let running = Running::start(command);
        eventually("the socket is there", PATIENCE, || frames.exists());
        let begin = recording.readings[0].sample.stamp.as_nanos();
        let epoch = monotonic_ns() + 200_000_000 - begin;
        std::thread::scope(|scope| {
            scope.spawn(|| {
                for reading in &recording.readings {
                    let host_ns = reading.sample.stamp.as_nanos() + epoch;
                    wait_until(host_ns);
                    let sample = Imu {
                        sequence: reading.sequence as u32,
                        time_ns: host_ns as u64,
                        gyro_rad_s: <[f64; 3]>::from(reading.sample.gyro).map(|x| x as f32),
                        accel_m_s2: <[f64; 3]>::from(reading.sample.accel).map(|x| x as f32),
                        ..Imu::default()
                    };
                    let _ = rustix::io::write(&master, encode(&Message::Imu(sample), &mut [0; MAX_FRAME]));
                }
            });
            let mut stream = UnixStream::connect(&frames).unwrap();
            for frame in &recording.frames {
                let stamp_ns = frame.stamp.as_nanos() + epoch;
                wait_until(stamp_ns + 5_000_000);
                let size = |k: usize| (frame.images[k].width() as u32, frame.images[k].height() as u32);
                let header = FrameHeader { sequence: frame.sequence, stamp_ns, sizes_px: [size(0), size(1)] };
                stream.write_all(&header.encode()).unwrap();
                frame.images.iter().for_each(|image| stream.write_all(image.pixels()).unwrap());
            }
            let text = said(&running, "tracking since ");
            let line = text.lines().find(|line| line.contains("tracking since ")).unwrap();
            for part in ["INFO", "frames/s", "points", "quality"] {
                assert!(line.contains(part), "{part}: {line}");
            }
            // When frames end it says that too.
            let text = said(&running, "tracking stopped");
            for option in ["--mono", "--cache", "--scale", "--speed"] {
                assert!(!text.contains(option), "{option}: {text}");
            }
        });
    }
}
