//! What a source delivers, given to the checkup: samples and frames are read on threads of their own.

use super::super::scenario::parse_scene;
use anyhow::{Result, anyhow};
use plumbline_checkup::plausibility::Finding;
use plumbline_checkup::{Checkup, CheckupReport, Fitness, Frame, Measure};
use plumbline_config::options::image_sizes;
use plumbline_config::{GrayImage, ImuSample, Timestamp, ValidConfig};
use plumbline_drivers::euroc::FileDefects;
use plumbline_drivers::simulator::Scenario;
use plumbline_drivers::{
    BagTopics, CameraMonitor, DriverError, ImuSource, StereoFrame, StereoSource, StopFlag,
};
use plumbline_flight::flight::{Cut, Flight, open_recording, open_sensors, open_simulation};
use std::path::Path;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::thread::{ScopedJoinHandle, scope};
use std::time::{Duration, Instant};

/// Name of the measure of the files of a recording.
const RECORDING: &str = "recording";
/// Name of the measure of frames with both images.
const PAIRS: &str = "stereo pairs";
/// Share of images that may be unreadable.
const MAX_UNREAD: f64 = 0.02;
/// Frames that wait to be looked at.
const QUEUE: usize = 4;
/// Samples and frames that are taken in, at most.
const MAX_SAMPLES: usize = 4_000_000;
const MAX_FRAMES: usize = 400_000;

/// Opens the beginning of a recording or of a simulated flight. Without a configuration its own calibration is in force.
///
/// # Errors
/// When it cannot be used.
pub(super) fn open(
    source: &str,
    config: Option<ValidConfig>,
    topics: &BagTopics,
    seconds: f64,
) -> Result<Flight> {
    if let Some(scene) = source.strip_prefix("sim:") {
        let scenario = Scenario { scene: parse_scene(scene)?, duration_s: seconds, ..Scenario::default() };
        return Ok(open_simulation(config, &scenario, false, 0.0, None)?);
    }
    let cut = Cut { frames: None, seconds: 0.0..seconds };
    Ok(open_recording(Path::new(source), config, topics, cut, false)?)
}

/// What is examined.
pub(super) struct Streams {
    config: ValidConfig,
    imu: Box<dyn ImuSource>,
    stereo: Box<dyn StereoSource>,
    /// Live ones: for how long they are read, and what ends them.
    live: Option<(Duration, StopFlag)>,
    /// What knows the exposure of live cameras.
    monitor: Option<CameraMonitor>,
    /// What is wrong with the recording as a whole.
    findings: Vec<Finding>,
    /// Rows and images that cannot be read.
    file_defects: FileDefects,
}

impl From<Flight> for Streams {
    fn from(Flight { config, imu, stereo, findings, file_defects, .. }: Flight) -> Self {
        Self { config, imu, stereo, live: None, monitor: None, findings, file_defects }
    }
}

/// The sensors that a configuration names, to be read for so many seconds.
///
/// # Errors
/// When it names none, or one that is there cannot do what is asked of it.
pub(super) fn open_live(config: &ValidConfig, seconds: f64) -> Result<Streams> {
    let stop = StopFlag::new();
    let (flight, sensors) = open_sensors(config, &stop)?;
    let live = Some((Duration::from_secs_f64(seconds), stop));
    Ok(Streams { live, monitor: Some(sensors.cameras.monitor), ..Streams::from(flight) })
}

/// A frame whose images are to be looked at.
struct Seen {
    sequence: u64,
    stamp: Timestamp,
    images: [Option<GrayImage>; 2],
}

/// That a frame came, and which of its images.
type Note = (u64, Timestamp, [bool; 2]);

/// Reads streams to their end, and says how fit their sensors are. Live ones are read at their pace: a frame that comes while
/// others wait to be looked at is taken note of alone.
///
/// # Errors
/// When a stream breaks off.
pub(super) fn examine(streams: Streams) -> Result<CheckupReport> {
    let Streams { config, imu, stereo, live, monitor, findings, file_defects } = streams;
    let mut checkup = Checkup::new(&config);
    let (send, receive) = sync_channel(QUEUE);
    let (frame, is_live) = (StereoFrame::new(image_sizes(&config.camera)), live.is_some());
    let mut report = scope(|threads| {
        let samples = threads.spawn(move || read_samples(imu));
        let notes = threads.spawn(move || read_frames(stereo, frame, &send, is_live));
        look(&mut checkup, &receive, live);
        for (sequence, stamp, arrived) in ended(notes)? {
            checkup.note_frame(sequence, stamp, arrived);
        }
        for (sequence, sample) in ended(samples)? {
            checkup.add_sample(sequence, &sample);
        }
        if let Some(exposure_ns) = monitor.and_then(|monitor| monitor.exposure_ns()) {
            checkup.tell_exposure(exposure_ns as f64 * 1e-9);
        }
        anyhow::Ok(checkup.report())
    })?;
    let frames = report.measure(PAIRS).and_then(|pairs| pairs.figure("frames")).unwrap_or(0.0);
    let unread = unread(&file_defects, frames);
    if !is_live && let Some(pairs) = report.measures.iter_mut().find(|m| m.name == PAIRS) {
        if pairs.verdict > Fitness::Good {
            pairs.cure = match &unread {
                Some(_) => "mend the images that are named above".into(),
                None => "see which images the recording lacks (cam0/data.csv and cam1/data.csv)".into(),
            };
        }
    }
    let found = findings.into_iter().map(|finding| finding.into_measure_of(RECORDING));
    report.measures.splice(0..0, found.chain(unread));
    Ok(report)
}

/// Rows and images that cannot be read, in a recording of which so many frames were looked at.
fn unread(files: &FileDefects, frames: f64) -> Option<Measure> {
    let (words, images) = (files.words(), files.images() as f64);
    let share = images / (2.0 * frames).max(1.0);
    // A row is one of thousands: tables with many are refused.
    let verdict = Fitness::within(share, 0.0, MAX_UNREAD).max(Fitness::Mind);
    let cure = "copy or write these files again";
    (!words.is_empty())
        .then(|| Measure::new(RECORDING, verdict, words.join("; "), cure, &[("unread_images", images)]))
}

/// Looks at what comes until nothing comes any more; live streams are ended when their time is over.
fn look(checkup: &mut Checkup, receive: &Receiver<Seen>, mut live: Option<(Duration, StopFlag)>) {
    let begin = Instant::now();
    loop {
        let seen = match &live {
            None => receive.recv().map_err(|_| RecvTimeoutError::Disconnected),
            Some((length, _)) => receive.recv_timeout(length.saturating_sub(begin.elapsed())),
        };
        match seen {
            Ok(seen) => {
                let [left, right] = &seen.images;
                let images = [left.as_ref().map(GrayImage::view), right.as_ref().map(GrayImage::view)];
                checkup.look_at(&Frame { sequence: seen.sequence, stamp: seen.stamp, images });
            }
            Err(RecvTimeoutError::Disconnected) => return,
            Err(RecvTimeoutError::Timeout) => {}
        }
        if live.as_ref().is_some_and(|(length, _)| begin.elapsed() >= *length)
            && let Some((_, stop)) = live.take()
        {
            stop.stop();
        }
    }
}

/// What a thread brought.
fn ended<T>(thread: ScopedJoinHandle<'_, Result<T, DriverError>>) -> Result<T> {
    Ok(thread.join().map_err(|_| anyhow!("a thread that reads a sensor panicked"))??)
}

fn read_samples(mut source: Box<dyn ImuSource>) -> Result<Vec<(u64, ImuSample)>, DriverError> {
    let mut samples = Vec::new();
    while let Some(reading) = source.next_reading()? {
        if samples.len() == MAX_SAMPLES {
            break;
        }
        samples.push((reading.sequence, reading.sample));
    }
    Ok(samples)
}

fn read_frames(
    mut source: Box<dyn StereoSource>,
    mut frame: StereoFrame,
    send: &SyncSender<Seen>,
    is_live: bool,
) -> Result<Vec<Note>, DriverError> {
    let mut notes = Vec::new();
    while notes.len() < MAX_FRAMES && source.next_frame(&mut frame)? {
        notes.push((frame.sequence, frame.stamp, frame.valid));
        let image = |camera: usize| frame.valid[camera].then(|| frame.images[camera].clone());
        let seen = Seen { sequence: frame.sequence, stamp: frame.stamp, images: [image(0), image(1)] };
        if is_live {
            // Full: noted, and not looked at.
            let _ = send.try_send(seen);
        } else if send.send(seen).is_err() {
            // Nobody listens any more when the checkup panicked, which is told where it is joined.
            break;
        }
    }
    Ok(notes)
}
