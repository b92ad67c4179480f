//! Records of a flight on their way to the tasks that send them. Nothing blocks; who is slow forgets the oldest.

use super::pace::Pace;
use plumbline_estimator::Odometry;
use plumbline_record::local::content::LocalRecord;
use plumbline_record::local::picture::Shot;
use plumbline_rings::lane::{LaneLosses, LaneReader, LaneWriter, lane};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use tokio::sync::Notify;

/// Odometry that waits for the network: a quarter of a second.
const ODOMETRY: usize = 50;
/// Other records that wait: two seconds of estimates, poses in the map, windows and paths.
const RECORDS: usize = 100;
/// Pictures that wait: only the newest counts.
const PICTURES: usize = 2;

/// A record with its message as the flight has sent it.
#[derive(Clone, Debug)]
pub struct Relayed {
    /// The record.
    pub record: LocalRecord,
    /// Message.
    pub message: Vec<u8>,
}

/// Takes the records of a flight.
#[derive(Debug)]
pub struct Feed {
    shared: Arc<RelayState>,
    odometry: LaneWriter<(Odometry, i64)>,
    records: LaneWriter<Relayed>,
    pictures: LaneWriter<Shot>,
    /// Rate of pictures: the flight makes as many as its fastest watcher wants.
    picture_pace: Pace,
}

/// Reading ends of a [`Feed`].
#[derive(Debug)]
pub struct FeedReaders {
    /// Odometry, with the time it was handed over, ns since 1970; taken by the task that sends it.
    pub odometry: LaneReader<(Odometry, i64)>,
    /// Other records.
    pub records: LaneReader<Relayed>,
    /// Pictures, taken by the task that compresses them.
    pub pictures: LaneReader<Shot>,
}

/// State that feed and tasks share.
#[derive(Debug)]
pub struct RelayState {
    /// Wakes the task that sends odometry.
    pub odometry_bell: Notify,
    /// Wakes the task that sends other records.
    pub bell: Notify,
    /// Wakes the task that sends pictures.
    pub picture_bell: Notify,
    /// The flight is over.
    pub stop: AtomicBool,
    /// Records that the flight dropped since this process was too slow.
    lost_before: AtomicU64,
    losses: [LaneLosses; 2],
}

impl Feed {
    /// A feed with pictures at this rate, and its other end.
    pub fn new(pictures_hz: f64) -> (Self, FeedReaders, Arc<RelayState>) {
        let (odometry_in, odometry, odometry_losses) = lane(ODOMETRY);
        let (records_in, records, record_losses) = lane(RECORDS);
        let (pictures_in, pictures, _) = lane(PICTURES);
        let shared = Arc::new(RelayState {
            odometry_bell: Notify::new(),
            bell: Notify::new(),
            picture_bell: Notify::new(),
            stop: AtomicBool::new(false),
            lost_before: AtomicU64::new(0),
            losses: [odometry_losses, record_losses],
        });
        let feed = Self {
            shared: Arc::clone(&shared),
            odometry: odometry_in,
            records: records_in,
            pictures: pictures_in,
            picture_pace: Pace::new(pictures_hz),
        };
        (feed, FeedReaders { odometry, records, pictures }, shared)
    }

    /// Takes a record with its message.
    pub fn take(&mut self, record: LocalRecord, message: &[u8]) {
        match record {
            LocalRecord::Odometry(odometry, handed_over_ns) => self.odometry(*odometry, handed_over_ns),
            LocalRecord::Picture(shot) if self.picture_pace.admits(shot.stamp) => {
                self.pictures.push(shot);
                self.shared.picture_bell.notify_one();
            }
            LocalRecord::Lost(count) => self.shared.lost_before.store(count, Ordering::Relaxed),
            LocalRecord::Picture(_)
            | LocalRecord::Hello(_)
            | LocalRecord::Answer(_)
            | LocalRecord::Instant(..)
            | LocalRecord::Trail(_)
            | LocalRecord::Configuration(_)
            | LocalRecord::End => {}
            record => {
                self.records.push(Relayed { record, message: message.to_vec() });
                self.shared.bell.notify_one();
            }
        }
    }

    /// Takes odometry that the run handed over at this time, ns since 1970.
    pub fn odometry(&mut self, odometry: Odometry, handed_over_ns: i64) {
        self.odometry.push((odometry, handed_over_ns));
        self.shared.odometry_bell.notify_one();
    }
}

impl RelayState {
    /// Ends the flight: the tasks send what is left, and end.
    pub fn end(&self) {
        self.stop.store(true, Ordering::Relaxed);
        self.odometry_bell.notify_one();
        self.bell.notify_one();
    }

    /// Records dropped because the network was slower than the vehicle.
    pub fn dropped(&self) -> u64 {
        let here: u64 = self.losses.iter().map(LaneLosses::count).sum();
        here + self.lost_before.load(Ordering::Relaxed)
    }
}
