//! The line to the autopilot: a UDP socket or a serial device, never waited for.
//!
//! The transports of the MAVLink library block, and hide their descriptors: a thread that must send at a
//! constant rate, and answer at once, needs to wait for both at a time. So the library reads and writes
//! messages, and the line is a descriptor that `poll` can wait for.

mod serial;
mod udp;

use super::awaited::Awaited;
use super::inbox::CHUNK;
use super::words::News;
use crate::schedule::ticker::Monotonic;
use plumbline_config::options::AutopilotEndpoint;
use rustix::event::{PollFd, PollFlags, poll};
use rustix::time::Timespec;
use serial::SerialLink;
use std::os::fd::BorrowedFd;
use thiserror::Error;
use udp::UdpLink;

/// Why there is no line to the autopilot: the address or device, what is wrong with it, and the cure.
#[derive(Debug, Error)]
#[error("autopilot at {at}: {reason}")]
pub struct LinkError {
    at: String,
    reason: String,
}

/// The line to the autopilot.
#[derive(Debug)]
pub enum AutopilotLink {
    /// Datagrams.
    Udp(UdpLink),
    /// A serial device.
    Serial(SerialLink),
    /// Line that is not to be had yet.
    Awaited(Awaited<Box<AutopilotLink>>),
}

impl AutopilotLink {
    /// Opens the line.
    ///
    /// # Errors
    /// When the address or the device cannot be used.
    pub fn open(endpoint: &AutopilotEndpoint) -> Result<Self, LinkError> {
        match endpoint {
            AutopilotEndpoint::Udp(address) => UdpLink::to(address).map(Self::Udp),
            AutopilotEndpoint::UdpIn { at, from } => UdpLink::at(at, *from).map(Self::Udp),
            AutopilotEndpoint::Serial(line) => SerialLink::open(&line.device, line.baud).map(Self::Serial),
        }
    }

    /// Opens the line, now or as soon as that can be done.
    pub fn open_patiently(endpoint: &AutopilotEndpoint) -> Self {
        Self::open(endpoint).unwrap_or_else(|error| {
            tracing::warn!("{error}; retrying until it is available");
            let endpoint = endpoint.clone();
            Self::Awaited(Awaited::search(move || {
                let link = Self::open(&endpoint).ok()?;
                tracing::info!("autopilot: the serial device is available");
                Some(Box::new(link))
            }))
        })
    }

    /// Waits for bytes until `until`; whether there are any.
    pub fn wait(&self, until: Monotonic) -> bool {
        let Some(descriptor) = self.descriptor() else {
            until.sleep_until();
            return false;
        };
        let left_ns = until.0.saturating_sub(Monotonic::now().0).max(0);
        let left = Timespec { tv_sec: left_ns / 1_000_000_000, tv_nsec: left_ns % 1_000_000_000 };
        let mut descriptors = [PollFd::new(&descriptor, PollFlags::IN)];
        // An interrupted wait is one that found nothing: the caller looks at its clock again.
        poll(&mut descriptors, Some(&left)).is_ok_and(|ready| ready > 0)
    }

    fn descriptor(&self) -> Option<BorrowedFd<'_>> {
        match self {
            Self::Udp(udp) => Some(udp.descriptor()),
            Self::Serial(serial) => serial.descriptor(),
            Self::Awaited(_) => None,
        }
    }

    /// Takes what is there, as many bytes as fit; 0 when there is nothing more.
    pub fn read(&mut self, into: &mut [u8; CHUNK], now: Monotonic) -> usize {
        match self {
            Self::Udp(udp) => udp.read(into, now),
            Self::Serial(serial) => serial.read(into),
            Self::Awaited(_) => 0,
        }
    }

    /// Takes the sender of the bytes that were read last, which held a good message, for the autopilot.
    pub fn confirm(&mut self, now: Monotonic) {
        if let Self::Udp(udp) = self {
            udp.confirm(now);
        }
    }

    /// News of the line since the last time.
    pub fn news(&mut self) -> Option<News> {
        match self {
            Self::Serial(serial) => serial.news(),
            Self::Udp(udp) => udp.news(),
            Self::Awaited(_) => None,
        }
    }

    /// Sends a message; whether it was handed to the system, whole.
    pub fn send(&mut self, message: &[u8], now: Monotonic) -> bool {
        if let Self::Awaited(awaited) = self
            && let Some(link) = awaited.take()
        {
            *self = *link;
        }
        match self {
            Self::Udp(udp) => udp.send(message),
            Self::Serial(serial) => serial.send(message, now),
            Self::Awaited(_) => false,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::udp::SILENCE_NS;
    use super::*;
    use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
    use std::fs::File;
    use std::io::{Read as _, Write as _};
    use std::net::UdpSocket;
    use std::time::{Duration, Instant};

    fn open(text: &str) -> Result<AutopilotLink, LinkError> {
        AutopilotLink::open(&AutopilotEndpoint::parse(text).unwrap())
    }

    fn soon() -> Monotonic {
        Monotonic::now().plus_nanos(2_000_000_000)
    }

    fn read(link: &mut AutopilotLink) -> Vec<u8> {
        assert!(link.wait(soon()), "nothing came");
        let mut bytes = [0; CHUNK];
        let count = link.read(&mut bytes, Monotonic::now());
        bytes[..count].to_vec()
    }

    #[test]
    fn datagrams_go_where_the_autopilot_listens_and_come_back() {
        let autopilot = UdpSocket::bind("127.0.0.1:0").unwrap();
        let mut link = open(&format!("udp://{}", autopilot.local_addr().unwrap())).unwrap();
        assert!(link.send(b"odometry", Monotonic::now()));
        let mut bytes = [0; 64];
        let (count, from) = autopilot.recv_from(&mut bytes).unwrap();
        assert_eq!(&bytes[..count], b"odometry");
        autopilot.send_to(b"time", from).unwrap();
        assert_eq!(read(&mut link), b"time");
    }

    #[test]
    fn where_nobody_listens_sending_goes_on() {
        let gone = UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
        let mut link = open(&format!("udp://{gone}")).unwrap();
        for _ in 0..10 {
            link.send(b"odometry", Monotonic::now());
            link.wait(Monotonic::now().plus_nanos(1_000_000));
            assert_eq!(link.read(&mut [0; CHUNK], Monotonic::now()), 0);
        }
    }

    #[test]
    fn who_sends_good_messages_first_is_the_autopilot_until_it_is_silent() {
        let free = UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
        let mut link = open(&format!("udpin://{free}")).unwrap();
        assert!(!link.send(b"odometry", Monotonic::now()), "nobody has come yet");
        let [first, second] = [0, 1].map(|_| UdpSocket::bind("127.0.0.1:0").unwrap());
        first.set_read_timeout(Some(Duration::from_secs(2))).unwrap();
        first.send_to(b"hello", free).unwrap();
        assert_eq!(read(&mut link), b"hello");
        link.confirm(Monotonic::now());
        assert!(link.send(b"odometry", Monotonic::now()));
        assert_eq!(first.recv(&mut [0; 64]).unwrap(), 8);
        second.send_to(b"me too", free).unwrap();
        assert!(read(&mut link).is_empty(), "the place is taken");
        second.send_to(b"me again", free).unwrap();
        assert!(link.wait(soon()));
        let later = Monotonic::now().plus_nanos(SILENCE_NS + 1);
        assert_eq!(link.read(&mut [0; CHUNK], later), 8);
        assert_eq!(link.news(), None, "whether it is the autopilot is not known yet");
        link.confirm(later);
        let [by, other] = [&second, &first].map(|socket| socket.local_addr().unwrap());
        assert_eq!(link.news(), Some(News::Replaced { by, other }));
        assert_eq!(link.news(), None, "that is told once");
    }

    #[test]
    fn a_pinned_link_hears_that_host_alone_however_long_it_is_silent() {
        let free = UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
        let mut link = open(&format!("udpin://{free}?from=127.0.0.2")).unwrap();
        let (autopilot, other) =
            (UdpSocket::bind("127.0.0.2:0").unwrap(), UdpSocket::bind("127.0.0.3:0").unwrap());
        other.send_to(b"forged", free).unwrap();
        assert!(read(&mut link).is_empty(), "not even the first");
        autopilot.send_to(b"hello", free).unwrap();
        assert_eq!(read(&mut link), b"hello");
        link.confirm(Monotonic::now());
        other.send_to(b"forged", free).unwrap();
        assert!(link.wait(soon()));
        let later = Monotonic::now().plus_nanos(10 * SILENCE_NS);
        assert_eq!(link.read(&mut [0; CHUNK], later), 0);
    }

    #[test]
    fn a_serial_line_carries_bytes_both_ways_untouched_and_is_ours_alone() {
        let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
        grantpt(&master).unwrap();
        unlockpt(&master).unwrap();
        let device = ptsname(&master, Vec::new()).unwrap().into_string().unwrap();
        let mut autopilot = File::from(master);
        let mut link = open(&format!("serial://{device}:921600")).unwrap();
        // What a terminal would turn into something else.
        let bytes = [0xFD, 0, 10, 13, 3, 4, 17, 19, 26, 127, 255];
        assert!(link.send(&bytes, Monotonic::now()));
        let mut there = [0; 11];
        autopilot.read_exact(&mut there).unwrap();
        assert_eq!(there, bytes);
        autopilot.write_all(&bytes).unwrap();
        assert_eq!(read(&mut link), bytes);
        // Nobody reads: the line fills up, and sending neither waits nor breaks off within a message.
        let began = Instant::now();
        let sent = (0..10_000).filter(|_| link.send(&[7; 245], Monotonic::now())).count();
        assert!(sent < 10_000 && began.elapsed() < Duration::from_secs(2));
        drop(autopilot);
        while link.wait(Monotonic::now().plus_nanos(10_000_000)) {
            link.read(&mut [0; CHUNK], Monotonic::now());
        }
        assert!(!link.send(&bytes, Monotonic::now()), "the device is gone");
        assert!(matches!(link.news(), Some(News::Gone(_))) && link.news().is_none(), "that is told once");
    }

    #[test]
    fn a_line_that_comes_late_is_taken() {
        let folder = tempfile::tempdir().unwrap();
        let device = folder.path().join("autopilot");
        let endpoint = AutopilotEndpoint::parse(&format!("serial://{}:921600", device.display())).unwrap();
        let mut link = AutopilotLink::open_patiently(&endpoint);
        assert!(!link.send(b"odometry", Monotonic::now()), "it is not there yet");
        let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
        grantpt(&master).unwrap();
        unlockpt(&master).unwrap();
        let name = ptsname(&master, Vec::new()).unwrap().into_string().unwrap();
        std::os::unix::fs::symlink(name, &device).unwrap();
        let end = Instant::now() + Duration::from_secs(10);
        while !link.send(b"odometry", Monotonic::now()) {
            assert!(Instant::now() < end, "it never came");
            link.wait(Monotonic::now().plus_nanos(10_000_000));
        }
        let mut there = [0; 8];
        File::from(master).read_exact(&mut there).unwrap();
        assert_eq!(&there, b"odometry");
    }

    #[test]
    fn what_cannot_be_opened_is_named() {
        let error = open("serial:///dev/nowhere-at-all:921600").unwrap_err().to_string();
        assert!(error.contains("/dev/nowhere-at-all") && error.contains("permissions"), "{error}");
        let taken = UdpSocket::bind("127.0.0.1:0").unwrap();
        let error = open(&format!("udpin://{}", taken.local_addr().unwrap())).unwrap_err().to_string();
        assert!(error.contains("the port is free"), "{error}");
        let error = open("udp://no.such.host.invalid:1").unwrap_err().to_string();
        assert!(error.contains("no.such.host.invalid"), "{error}");
        let error = open("serial:///dev/null:921600").unwrap_err().to_string();
        assert!(error.contains("/dev/null"), "{error}");
    }
}
