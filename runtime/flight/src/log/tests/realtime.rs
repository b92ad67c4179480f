//! Log after a power failure: the file as far as it had been brought to the medium.

use super::super::inventory;
use super::super::part_file::{Medium, Syncer};
use super::*;
use crate::log::LogEntry;
use nalgebra::Vector3;
use plumbline_config::{ImuSample, Timestamp};
use plumbline_drivers::ImuReading;
use plumbline_record::Said;
use std::fs::OpenOptions;
use std::io::{self, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// Age from which everything must be there, s.
const OLD_S: f64 = 2.0;

/// A file that remembers how much of it a power failure would leave.
struct Volatile {
    file: File,
    written: Arc<AtomicU64>,
    synced: Arc<AtomicU64>,
}

impl Write for Volatile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let count = self.file.write(bytes)?;
        self.written.fetch_add(count as u64, Ordering::SeqCst);
        Ok(count)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

impl Medium for Volatile {
    fn cut(&mut self, bytes: u64) -> io::Result<()> {
        self.file.set_len(bytes)
    }

    fn syncer(&self) -> io::Result<Box<dyn Syncer>> {
        Ok(Box::new(SlowCard(Arc::clone(&self.written), Arc::clone(&self.synced))))
    }
}

struct SlowCard(Arc<AtomicU64>, Arc<AtomicU64>);

impl Syncer for SlowCard {
    fn sync(&mut self) -> io::Result<()> {
        let written = self.0.load(Ordering::SeqCst);
        std::thread::sleep(Duration::from_millis(200));
        self.1.store(written, Ordering::SeqCst);
        Ok(())
    }
}

fn reading(k: u64) -> ImuReading {
    let stamp = Timestamp::from_nanos(1_000_000_000 + k as i64 * 5_000_000);
    ImuReading { sequence: k, sample: ImuSample { stamp, gyro: Vector3::zeros(), accel: Vector3::zeros() } }
}

#[test]
fn what_is_older_than_two_seconds_survives_a_power_failure() {
    let folder = tempfile::tempdir().unwrap();
    let [path, left] = ["flight.mcap", "left.mcap"].map(|name| folder.path().join(name));
    let (written, synced) = (Arc::new(AtomicU64::new(0)), Arc::new(AtomicU64::new(0)));
    let counts = (Arc::clone(&written), Arc::clone(&synced));
    let open = OpenPart::with(move |path| {
        let file = OpenOptions::new().write(true).create_new(true).open(path)?;
        let (written, synced) = (Arc::clone(&counts.0), Arc::clone(&counts.1));
        Ok(Box::new(Volatile { file, written, synced }))
    });
    let recorder = Recorder::start_on(open, NO_LIMITS, &path, &config(), WhenFull::Drop).unwrap();
    let (handle, begun, mut offered, mut oldest_s) = (recorder.handle(), Instant::now(), 0, 0.0f64);
    for look in 1..=16 {
        while begun.elapsed() < Duration::from_millis(250 * look) {
            assert!(handle.offer(LogEntry::Said(Said::Imu(reading(offered)))));
            offered += 1;
            std::thread::sleep(Duration::from_millis(5));
        }
        let whole = synced.load(Ordering::SeqCst);
        std::fs::write(&left, &std::fs::read(&path).unwrap()[..whole as usize]).unwrap();
        let there = match LogReader::open(&left) {
            Ok(mut log) => inventory::take(&mut log).unwrap().contents[Channel::Imu as usize].messages,
            Err(_) => 0,
        };
        // Offered at their pace, so their places are their ages.
        oldest_s = oldest_s.max(begun.elapsed().as_secs_f64() * (offered - there) as f64 / offered as f64);
    }
    assert_eq!(recorder.finish().not_recorded, 0);
    println!("{offered} samples; a power failure would have cost {oldest_s:.2} s at most");
    assert!(oldest_s < OLD_S, "{oldest_s} s");
}
