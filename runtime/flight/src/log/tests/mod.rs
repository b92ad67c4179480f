//! Whole logs: recorded, damaged, read and executed again.

mod bounds;
mod damage;
mod execution;
mod failures;
mod realtime;
mod rig;

use super::channel::Channel;
use super::part_file::OpenPart;
use super::part_header::{METADATA_NAME, PartHeader};
use super::recorder::{Recorder, RecorderSummary, WhenFull};
use super::verify::{Verification, verify};
use super::writer::{Limits, LogWriter};
use super::{LogError, LogReader};
use crate::flight::cache;
use crate::pipeline::listener::Subscriber;
use crate::pipeline::{self, Control, RunOptions, RunOutcome, Stamps, Streams};
use mcap::records::Metadata;
use mcap::{MessageStream, WriteOptions};
use plumbline_config::options::{ImageRecording, KeepPolicy};
use plumbline_config::{Config, ValidConfig};
use plumbline_record::digest::config_hash;
use plumbline_simulator::{Scenario, Scene, Simulator};
use plumbline_test_support::kept;
use std::borrow::Cow;
use std::fs::File;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

const OPTIONS: RunOptions = RunOptions { speed: None, threads: 1 };
const NO_LIMITS: Limits =
    Limits { part_bytes: u64::MAX / 4, total_bytes: u64::MAX / 2, keep: KeepPolicy::Beginning };

impl Recorder {
    /// Begins with other limits, in files opened by `open`.
    fn start_on(
        open: OpenPart,
        limits: Limits,
        path: &Path,
        config: &ValidConfig,
        when_full: WhenFull,
    ) -> Result<Self, LogError> {
        let writer = LogWriter::create(path, PartHeader::new(config)?, limits, open)?;
        Self::start_writing(writer, path, config, when_full)
    }
}

/// Streams of a short flight in small images, and what the estimator believes.
struct Flight {
    config: ValidConfig,
    streams: Streams,
}

fn flight() -> Flight {
    flight_of_seed(1)
}

fn flight_of_seed(seed: u64) -> Flight {
    flight_of(seed, 1.0)
}

fn flight_of(seed: u64, duration_s: f64) -> Flight {
    let scenario =
        Scenario { scene: Scene::Room, seed, duration_s, resolution_scale: 0.3, ..Scenario::default() };
    let simulator = Simulator::new(&config(), &scenario).unwrap();
    // Rendered once for all tests.
    let _alone = kept::alone(&format!("{scenario:?}"));
    let streams = Streams {
        imu: Box::new(simulator.imu()),
        stereo: cache::frames(&kept::folder(), &simulator, &scenario).unwrap(),
        map: None,
        stamps: Stamps::Replayed,
        first_reset_counter: 0,
    };
    let mut config = simulator.config().clone();
    config.estimator.points.cell_px = 28;
    Flight { config: config.validated("test").unwrap(), streams }
}

fn fly(flight: Flight, control: &Control, subscriber: &mut dyn Subscriber) -> RunOutcome {
    pipeline::run(&flight.config, flight.streams, &OPTIONS, control, subscriber).unwrap()
}

/// Flies and records; what the flight and the recording came to.
fn record_on(
    open: OpenPart,
    limits: Limits,
    path: &Path,
    images: ImageRecording,
) -> (RunOutcome, RecorderSummary) {
    let mut flight = flight();
    flight.config = flight.config.with("test", |config| config.recorder.images = images).unwrap();
    let mut recorder = Recorder::start_on(open, limits, path, &flight.config, WhenFull::Wait).unwrap();
    (fly(flight, &Control::default(), &mut recorder), recorder.finish())
}

/// The place of a log in a folder of its own.
fn place() -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("flight.mcap");
    (folder, path)
}

/// A log in a folder of its own, and what its flight came to.
fn recorded(images: ImageRecording) -> (TempDir, PathBuf, RunOutcome) {
    let (folder, path) = place();
    let (outcome, summary) = record_on(OpenPart::files(), NO_LIMITS, &path, images);
    assert_eq!((summary.ended_early, summary.not_recorded), (None, 0));
    assert_eq!(summary.bytes, path.metadata().unwrap().len());
    (folder, path, outcome)
}

fn verified(path: &Path) -> Result<Verification, LogError> {
    verify(path, None, None, &mut |_| {})
}

/// Writes the log anew, every CRC right, with the messages of `channel` changed by `edit`, which is told
/// their number.
fn rewritten(path: &Path, channel: Channel, mut edit: impl FnMut(usize, &mut Vec<u8>)) {
    let bytes = std::fs::read(path).unwrap();
    let metadata = LogReader::open(path).unwrap().about().to_metadata().unwrap();
    let mut writer = WriteOptions::new().compression(None).create(File::create(path).unwrap()).unwrap();
    writer.write_metadata(&Metadata { name: METADATA_NAME.into(), metadata }).unwrap();
    let mut number = 0;
    for message in MessageStream::new(&bytes).unwrap() {
        let mut message = message.unwrap();
        if message.channel.topic == channel.channel() {
            let mut data = message.data.into_owned();
            edit(number, &mut data);
            message.data = Cow::Owned(data);
            number += 1;
        }
        writer.write(&message).unwrap();
    }
    writer.finish().unwrap();
}

/// A configuration and nothing that flies.
fn config() -> ValidConfig {
    Config::preset("sim").unwrap()
}
