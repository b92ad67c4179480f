//! Hardware that plays a recording in real time: a microcontroller at a pseudo-terminal that speaks our serial protocol,
//! on a clock of its own, and a program that sends frames to a socket.

use nalgebra::Vector3;
use plumbline_config::{GrayImage, ImuSample, Random, Timestamp};
use plumbline_drivers::clock::monotonic_ns;
use plumbline_drivers::frame_socket::FrameHeader;
use plumbline_drivers::{
    EurocDataset, EurocOptions, ImuReading, ImuSource as _, StereoFrame, StereoSource as _,
};
use plumbline_protocol::{Imu, MAX_FRAME, Message, Receiver, Time, encode};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fd::OwnedFd;
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use std::io::Write as _;
use std::ops::Range;
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::time::{Duration, Instant};

const MS: i64 = 1_000_000;
/// From the middle of the exposure to when a frame is sent, ns.
const READOUT_NS: i64 = 12 * MS;
/// The crystal of the microcontroller runs faster than the host's by this share.
const SKEW: f64 = 45e-6;

/// A recording in memory.
pub struct Recording {
    /// All inertial samples.
    pub readings: Vec<ImuReading>,
    /// All frames.
    pub frames: Vec<StereoFrame>,
    /// Sizes of the images, px.
    pub sizes_px: [(usize, usize); 2],
}

impl Recording {
    /// Reads the recording of a data set.
    pub fn read(path: &Path) -> Self {
        let dataset = EurocDataset::open(path, &EurocOptions::default()).unwrap();
        let (mut imu, mut stereo) = (dataset.imu(), dataset.stereo());
        let mut readings = Vec::new();
        while let Some(reading) = imu.next_reading().unwrap() {
            readings.push(reading);
        }
        let (mut frames, mut frame) = (Vec::new(), dataset.new_frame());
        while stereo.next_frame(&mut frame).unwrap() {
            frames.push(frame.clone());
        }
        Self { readings, frames, sizes_px: dataset.sizes_px() }
    }
}

impl Recording {
    /// An IMU that lies still for so long, without cameras.
    pub fn at_rest(rate_hz: i64, seconds: i64) -> Self {
        let mut draws = Draws(Random::new(7));
        let reading = |k: i64| {
            let mut noise = || (draws.below(2001) as f64 - 1000.0) * 1e-6;
            ImuReading {
                sequence: k as u64,
                sample: ImuSample {
                    stamp: Timestamp::from_nanos(k * 1_000_000_000 / rate_hz),
                    gyro: Vector3::new(noise(), noise(), noise()),
                    accel: Vector3::new(noise(), noise(), 9.81 + noise()),
                },
            }
        };
        let readings = (0..seconds * rate_hz).map(reading).collect();
        Self { readings, frames: Vec::new(), sizes_px: [(0, 0); 2] }
    }
}

/// A recording of a vehicle that flies the same round again and again, without an end.
pub struct Endless {
    recording: Recording,
    period_ns: i64,
    /// Samples and frames of a period.
    counts: [usize; 2],
}

impl Endless {
    /// Repeats the first `period_s` of the recording, which ends where it began.
    pub fn new(recording: Recording, period_s: f64) -> Self {
        let period_ns = (period_s * 1e9).round() as i64;
        let within = |stamp: Timestamp, first: Timestamp| stamp.nanos_since(first) < period_ns - MS / 2;
        let (first_reading, first_frame) = (recording.readings[0].sample.stamp, recording.frames[0].stamp);
        let samples = recording.readings.partition_point(|r| within(r.sample.stamp, first_reading));
        let frames = recording.frames.partition_point(|f| within(f.stamp, first_frame));
        Self { recording, period_ns, counts: [samples, frames] }
    }

    /// Recording that is repeated.
    pub fn recording(&self) -> &Recording {
        &self.recording
    }

    /// Sample `k` since the start.
    pub fn reading(&self, k: usize) -> ImuReading {
        let mut reading = self.recording.readings[k % self.counts[0]];
        reading.sequence = k as u64;
        reading.sample.stamp = reading.sample.stamp.plus_nanos(self.rounds_ns(k, 0));
        reading
    }

    /// Frame `k` since the start, and its stamp.
    pub fn frame(&self, k: usize) -> (Timestamp, &StereoFrame) {
        let frame = &self.recording.frames[k % self.counts[1]];
        (frame.stamp.plus_nanos(self.rounds_ns(k, 1)), frame)
    }

    /// Time of the whole rounds before sample or frame `k`, ns.
    fn rounds_ns(&self, k: usize, kind: usize) -> i64 {
        (k / self.counts[kind]) as i64 * self.period_ns
    }
}

/// Relation of the recording's time to that of the host.
#[derive(Clone, Copy, Debug)]
pub struct Epoch {
    /// Time of the recording, ns.
    data_ns: i64,
    /// Time of the host, ns.
    host_ns: i64,
}

impl Epoch {
    /// The first sample of `recording` is measured `ms` from now.
    pub fn in_ms(recording: &Recording, ms: i64) -> Self {
        let data_ns = recording.readings[0].sample.stamp.as_nanos();
        Self { data_ns, host_ns: monotonic_ns() + ms * MS }
    }

    /// A time of the recording by the host's clock.
    pub fn host(self, data_ns: i64) -> i64 {
        data_ns - self.data_ns + self.host_ns
    }

    /// A time of the host in the recording.
    pub fn data(self, host_ns: i64) -> i64 {
        host_ns - self.host_ns + self.data_ns
    }

    /// By the clock of the microcontroller, which was started three seconds before the recording, ns.
    fn device(self, host_ns: i64) -> u64 {
        let since = host_ns - self.host_ns;
        (3_000 * MS + since + (since as f64 * SKEW).round() as i64) as u64
    }
}

/// Draws that are the same every time.
struct Draws(Random);

impl Draws {
    fn bits(&mut self) -> u64 {
        self.0.next_bits()
    }

    fn below(&mut self, count: usize) -> usize {
        (self.bits() % count as u64) as usize
    }

    /// In so many of a thousand cases.
    fn per_mille(&mut self, count: u64) -> bool {
        self.bits() % 1000 < count
    }
}

/// Troubles of the bytes on the way; times in s of the recording.
#[derive(Clone, Debug)]
pub struct Trouble {
    /// Frames of a thousand with noise before them.
    pub noise_per_mille: u64,
    /// Frames of a thousand that are changed or cut off.
    pub hit_per_mille: u64,
    /// Frames of a thousand that arrive in two pieces.
    pub split_per_mille: u64,
    /// Every tenth of a second's worth is sent at once.
    pub bursts_s: Range<f64>,
    /// Nothing leaves.
    pub stall_s: Range<f64>,
}

impl Trouble {
    /// None.
    pub fn none() -> Self {
        Self {
            noise_per_mille: 0,
            hit_per_mille: 0,
            split_per_mille: 0,
            bursts_s: 0.0..0.0,
            stall_s: 0.0..0.0,
        }
    }
}

/// A microcontroller at the end of a pseudo-terminal.
pub struct Microcontroller {
    master: OwnedFd,
    receiver: Receiver,
    /// Set once the other end has asked for the time.
    is_heard: bool,
}

impl Microcontroller {
    /// Plugged in; `link` names the terminal's other end, as udev would.
    pub fn plugged_in(link: &Path) -> Self {
        let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
        rustix::io::ioctl_fionbio(&master, true).unwrap();
        grantpt(&master).unwrap();
        unlockpt(&master).unwrap();
        let name = ptsname(&master, Vec::new()).unwrap().into_string().unwrap();
        let _ = std::fs::remove_file(link);
        std::os::unix::fs::symlink(name, link).unwrap();
        Self { master, receiver: Receiver::new(), is_heard: false }
    }

    /// Another program in its place, `program` on a board that is this host: it plays the samples of `which` in real time, from a
    /// file in `folder`.
    pub fn played_by(
        &self,
        program: &Path,
        folder: &Path,
        recording: &Recording,
        epoch: Epoch,
        which: Range<usize>,
    ) -> std::process::Child {
        let mut bytes = Vec::new();
        for reading in &recording.readings[which] {
            bytes.extend(epoch.host(reading.sample.stamp.as_nanos()).to_ne_bytes());
            bytes.extend((reading.sequence as u32).to_ne_bytes());
            let values = reading.sample.gyro.iter().chain(reading.sample.accel.iter());
            values.for_each(|value| bytes.extend((*value as f32).to_ne_bytes()));
        }
        let samples = folder.join("samples");
        std::fs::write(&samples, &bytes).unwrap();
        let last_ns =
            recording.readings.last().map_or(0, |reading| epoch.host(reading.sample.stamp.as_nanos()));
        let seconds = (last_ns - monotonic_ns()) as f64 * 1e-9 + 0.1;
        let line = || self.master.try_clone().unwrap();
        let mut command = std::process::Command::new(program);
        command.arg(samples).arg(seconds.to_string()).stdin(line()).stdout(line()).spawn().unwrap()
    }

    /// At the other end of a socket, as a virtual machine's serial port is.
    pub fn at(socket: UnixStream) -> Self {
        socket.set_nonblocking(true).unwrap();
        Self { master: socket.into(), receiver: Receiver::new(), is_heard: false }
    }

    /// Waits until somebody asks it anything; `false` when the other end has gone, or nobody did for so long.
    pub fn is_asked_within(&self, patience: Duration) -> bool {
        let end = Instant::now() + patience;
        while Instant::now() < end {
            match rustix::io::read(&self.master, &mut [0; 64]) {
                Ok(count) => return count > 0,
                Err(_) => std::thread::sleep(Duration::from_millis(5)),
            }
        }
        false
    }

    /// Plays the samples of `which` in real time; those that were hit on the way, by their places in the recording.
    pub fn play(
        &mut self,
        recording: &Recording,
        epoch: Epoch,
        which: Range<usize>,
        trouble: &Trouble,
    ) -> Vec<usize> {
        self.play_all(epoch, which.map(|k| (k, recording.readings[k])), trouble)
    }

    /// Plays numbered samples in real time; returns the numbers of those that were hit on the way.
    pub fn play_all(
        &mut self,
        epoch: Epoch,
        readings: impl Iterator<Item = (usize, ImuReading)>,
        trouble: &Trouble,
    ) -> Vec<usize> {
        let (mut draws, mut waiting, mut hit) = (Draws(Random::new(5)), Vec::new(), Vec::new());
        let mut last_burst = 0;
        for (k, reading) in readings {
            let data_ns = reading.sample.stamp.as_nanos();
            self.answer_until(epoch, epoch.host(data_ns));
            waiting.extend(frame(&reading, epoch.device(epoch.host(data_ns)), trouble, &mut draws, || {
                hit.push(k)
            }));
            let s = (data_ns - epoch.data_ns) as f64 * 1e-9;
            let burst = (s * 10.0) as i64;
            let is_held = trouble.stall_s.contains(&s)
                || trouble.bursts_s.contains(&s) && std::mem::replace(&mut last_burst, burst) == burst;
            if is_held {
                continue;
            }
            if draws.per_mille(trouble.split_per_mille) {
                let rest = waiting.split_off(draws.below(waiting.len()));
                self.send(&waiting);
                waiting = rest;
                std::thread::sleep(Duration::from_micros(150));
            }
            self.send(&waiting);
            waiting.clear();
        }
        hit
    }

    /// Answers questions for the time as they come, until then.
    fn answer_until(&mut self, epoch: Epoch, due_ns: i64) {
        loop {
            let left_ns = due_ns - monotonic_ns();
            if left_ns <= 0 {
                return;
            }
            let timeout = Timespec { tv_sec: left_ns / 1_000_000_000, tv_nsec: left_ns % 1_000_000_000 };
            let ready = poll(&mut [PollFd::new(&self.master, PollFlags::IN)], Some(&timeout)).unwrap_or(0);
            let mut bytes = [0; 64];
            let Ok(count) = rustix::io::read(&self.master, &mut bytes) else {
                // Nobody has the other end open: that is told at once, for ever.
                if ready > 0 {
                    std::thread::sleep(Duration::from_millis(1));
                }
                continue;
            };
            let received_ns = epoch.device(monotonic_ns());
            for byte in &bytes[..count] {
                if let Some(Ok(Message::AskTime { asked_ns })) = self.receiver.push(*byte) {
                    self.is_heard = true;
                    let sent_ns = epoch.device(monotonic_ns());
                    let answer = Message::Time(Time { asked_ns, received_ns, sent_ns });
                    self.send(encode(&answer, &mut [0; MAX_FRAME]));
                }
            }
        }
    }

    /// Hands all bytes to the terminal; while nobody has read yet, what finds no room is lost.
    fn send(&self, mut bytes: &[u8]) {
        let patience = Instant::now() + Duration::from_millis(if self.is_heard { 1000 } else { 20 });
        while !bytes.is_empty() && Instant::now() < patience {
            match rustix::io::write(&self.master, bytes) {
                Ok(count) => bytes = &bytes[count..],
                Err(rustix::io::Errno::AGAIN) => std::thread::sleep(Duration::from_millis(1)),
                // The other end has gone.
                Err(_) => return,
            }
        }
    }
}

/// Bytes sent for a sample; `is_hit` is set if the frame itself was hit.
fn frame(
    reading: &ImuReading,
    time_ns: u64,
    trouble: &Trouble,
    draws: &mut Draws,
    is_hit: impl FnOnce(),
) -> Vec<u8> {
    let single = |v: &Vector3<f64>| [v.x, v.y, v.z].map(|x| x as f32);
    let imu = Imu {
        sequence: reading.sequence as u32,
        time_ns,
        gyro_rad_s: single(&reading.sample.gyro),
        accel_m_s2: single(&reading.sample.accel),
        temperature_c: Some(31.0),
        ..Imu::default()
    };
    let mut buffer = [0; MAX_FRAME];
    let mut frame = encode(&Message::Imu(imu), &mut buffer).to_vec();
    let mut sent = Vec::new();
    if draws.per_mille(trouble.noise_per_mille) {
        sent.extend((0..draws.below(60)).map(|_| draws.bits() as u8));
    }
    if draws.per_mille(trouble.hit_per_mille) {
        is_hit();
        // Within the frame: the zeros around one are shared with its neighbours.
        let place = 1 + draws.below(frame.len() - 2);
        match draws.bits() % 2 {
            0 => frame[place] ^= 1 << draws.below(8),
            _ => frame.truncate(place),
        }
    }
    sent.extend(frame);
    sent
}

/// A program that sends the frames of `which` in real time to the socket at `path`, as soon as that is there.
pub fn send_frames(path: &Path, recording: &Recording, epoch: Epoch, which: Range<usize>) {
    let frames = recording.frames.iter().enumerate().take(which.end).skip(which.start);
    send_all(path, recording.sizes_px, epoch, frames.map(|(k, frame)| (k, frame.stamp, frame)));
}

/// A program that sends numbered frames, each with its stamp in the recording, as [`send_frames`] does.
pub fn send_all<'a>(
    path: &Path,
    sizes_px: [(usize, usize); 2],
    epoch: Epoch,
    frames: impl Iterator<Item = (usize, Timestamp, &'a StereoFrame)>,
) {
    let mut sender = loop {
        match UnixStream::connect(path) {
            Ok(sender) => break sender,
            Err(_) => std::thread::sleep(Duration::from_millis(5)),
        }
    };
    let mut has_begun = false;
    for (k, stamp, frame) in frames {
        let stamp_ns = epoch.host(stamp.as_nanos());
        let left_ns = stamp_ns + READOUT_NS - monotonic_ns();
        // A camera keeps nothing for who comes later.
        if !has_begun && left_ns < -50 * MS {
            continue;
        }
        has_begun = true;
        std::thread::sleep(Duration::from_nanos(u64::try_from(left_ns).unwrap_or(0)));
        let sizes_px = sizes_px.map(|(width, height)| (width as u32, height as u32));
        let header = FrameHeader { sequence: k as u64, stamp_ns, sizes_px };
        let [left, right] = frame.images.each_ref().map(GrayImage::pixels);
        for bytes in [&header.encode()[..], left, right] {
            if sender.write_all(bytes).is_err() {
                return;
            }
        }
    }
}
