//! Data of a source for the checkup: samples and frames are read on threads of their own.

use super::super::simulated::simulated;
use anyhow::{Result, anyhow};
use plumbline_checkup::timing::Sensor;
use plumbline_checkup::{Checkup, Fitness, FrameInput, Measure};
use plumbline_config::options::image_sizes;
use plumbline_config::{GrayImage, ImuSample, Timestamp, ValidConfig};
use plumbline_drivers::euroc::FileDefects;
use plumbline_drivers::{BagTopics, DriverError, Faults, ImuSource, StereoFrame, StereoSource, StopFlag};
use plumbline_flight::flight::sensor_watch::{SensorTrouble, SensorWatch};
use plumbline_flight::flight::{Cut, Flight, LiveSensors, open_recording, open_sensors};
use std::path::Path;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, SyncSender, channel, sync_channel};
use std::thread::{ScopedJoinHandle, scope};
use std::time::{Duration, Instant};

/// Name of the measure of the files of a recording.
const RECORDING: &str = "recording";
/// Share of images that may be unreadable.
const MAX_UNREAD: f64 = 0.02;
/// Frames that wait to be looked at.
const QUEUE: usize = 4;
/// Samples and frames that are taken in, at most.
const MAX_SAMPLES: usize = 4_000_000;
const MAX_FRAMES: usize = 400_000;
/// Time that a live frame waits for inertial samples.
const PATIENCE: Duration = Duration::from_millis(100);

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
    if let Some(mut flight) = simulated(source)? {
        flight.options.duration.get_or_insert(seconds);
        return flight.open(config, None);
    }
    let cut = Cut { frames: None, seconds: 0.0..seconds };
    Ok(open_recording(Path::new(source), config, topics, cut, false)?)
}

/// Parts of live sensors only.
pub(super) struct Live {
    /// For how long they are read.
    length: Duration,
    /// Flag that stops them.
    stop: StopFlag,
    sensors: LiveSensors,
    /// Logs what is wrong with them as soon as it shows, as a flight does, until they are stopped.
    watch: Option<SensorWatch>,
}

/// The sensors that a configuration names, to be read for so many seconds.
///
/// # Errors
/// When it names none, or one that is there cannot do what is asked of it.
pub(super) fn open_live(config: &ValidConfig, seconds: f64) -> Result<(Flight, Live)> {
    let stop = StopFlag::new();
    let (flight, sensors) = open_sensors(config, &stop)?;
    let watch = SensorWatch::start(&sensors, None)?;
    tracing::info!("listening to the sensors for {seconds} s");
    let live = Live { length: Duration::from_secs_f64(seconds), stop, sensors, watch: Some(watch) };
    Ok((flight, live))
}

/// A frame whose images are to be looked at.
struct Seen {
    sequence: u64,
    stamp: Timestamp,
    images: [Option<GrayImage>; 2],
}

/// Reads streams to their end, and says how fit their sensors are. Live ones are read at their pace: a frame that comes while
/// others wait to be looked at is taken note of alone.
///
/// # Errors
/// When a stream breaks off.
pub(super) fn examine(flight: Flight, mut live: Option<Live>) -> Result<Vec<Measure>> {
    let Flight { config, imu, stereo, findings, file_defects, .. } = flight;
    let mut checkup = Checkup::new(&config);
    let (send, receive) = sync_channel(QUEUE);
    let (frame, is_live) = (StereoFrame::new(image_sizes(&config.camera)), live.is_some());
    let (send_sample, samples) = channel();
    let mut measures = scope(|threads| {
        let imu = threads.spawn(move || read_samples(imu, &send_sample));
        let notes = threads.spawn(move || read_frames(stereo, frame, &send, is_live));
        let troubles = look(&mut checkup, &receive, &samples, live.as_mut());
        samples.iter().for_each(|(sequence, sample)| checkup.add_sample(sequence, &sample));
        let ((notes, frame_faults), (count, sample_faults)) = (ended(notes)?, ended(imu)?);
        let came = [count, notes.len()];
        notes.into_iter().for_each(|(sequence, stamp)| checkup.note_frame(sequence, stamp));
        checkup.arrivals(Sensor::Imu).disordered = sample_faults.disordered;
        checkup.arrivals(Sensor::Cameras).disordered = frame_faults.disordered;
        if let Some(live) = &live {
            tell_of_drivers(&mut checkup, live, troubles, came);
        }
        anyhow::Ok(checkup.report())
    })?;
    let found = findings.into_iter().map(|finding| finding.into_measure_of(RECORDING));
    measures.splice(0..0, found.chain(unread(&file_defects, checkup.frames())));
    Ok(measures)
}

/// Rows and images that cannot be read, in a recording of which so many frames were looked at.
fn unread(files: &FileDefects, frames: usize) -> Option<Measure> {
    let (words, images) = (files.words(), files.images() as f64);
    let share = images / (2.0 * frames as f64).max(1.0);
    // A row is one of thousands: tables with many are refused.
    let verdict = Fitness::within(share, 0.0, MAX_UNREAD).max(Fitness::Mind);
    let cure = "copy or write these files again";
    (!words.is_empty())
        .then(|| Measure::new(RECORDING, verdict, words.join("; "), cure, &[("unread_images", images)]))
}

/// Gives the checkup what the drivers of live sensors know, of which so many samples and frames came.
fn tell_of_drivers(checkup: &mut Checkup, live: &Live, troubles: [SensorTrouble; 2], came: [usize; 2]) {
    for ((sensor, trouble), came) in [Sensor::Imu, Sensor::Cameras].into_iter().zip(troubles).zip(came) {
        // A program that has sent enough may go.
        let missing = trouble.missing.filter(|_| came == 0);
        let words = trouble.stamps.or(missing).map(|words| words.replace("; waiting for it", ""));
        checkup.arrivals(sensor).trouble = words;
    }
    checkup.arrivals(Sensor::Imu).refused = live.sensors.imu.monitor.read().watch.impossible;
}

/// Looks at what comes until no frame comes any more. Live streams are ended when their time is over; returns what was wrong with
/// their sensors until then.
fn look(
    checkup: &mut Checkup,
    receive: &Receiver<Seen>,
    samples: &Receiver<(u64, ImuSample)>,
    mut live: Option<&mut Live>,
) -> [SensorTrouble; 2] {
    let patience = if live.is_some() { PATIENCE } else { Duration::MAX };
    let begin = Instant::now();
    let mut troubles = <[SensorTrouble; 2]>::default();
    loop {
        let seen = match &live {
            None => receive.recv().map_err(|_| RecvTimeoutError::Disconnected),
            Some(live) => receive.recv_timeout(live.length.saturating_sub(begin.elapsed())),
        };
        if let Ok(seen) = &seen {
            while checkup.needs_samples(seen.stamp) {
                let Ok((sequence, sample)) = samples.recv_timeout(patience) else { break };
                checkup.add_sample(sequence, &sample);
            }
            let [left, right] = &seen.images;
            let images = [left.as_ref().map(GrayImage::view), right.as_ref().map(GrayImage::view)];
            checkup.look_at(&FrameInput { sequence: Some(seen.sequence), stamp: seen.stamp, images });
        }
        let is_over = matches!(seen, Err(RecvTimeoutError::Disconnected));
        if let Some(ended) = live.take_if(|live| is_over || begin.elapsed() >= live.length) {
            // First: sensors that are stopped are missing.
            troubles = ended.watch.take().map(|watch| watch.troubles()).unwrap_or_default();
            ended.stop.stop();
        }
        if is_over {
            return troubles;
        }
    }
}

/// Result of a thread.
fn ended<T>(thread: ScopedJoinHandle<'_, Result<T, DriverError>>) -> Result<T> {
    Ok(thread.join().map_err(|_| anyhow!("a thread that reads a sensor panicked"))??)
}

/// Hands samples on; returns how many came, and what the source survived.
fn read_samples(
    mut source: Box<dyn ImuSource>,
    send: &Sender<(u64, ImuSample)>,
) -> Result<(usize, Faults), DriverError> {
    let mut count = 0;
    while let Some(reading) = source.next_reading()? {
        if count == MAX_SAMPLES || send.send((reading.sequence, reading.sample)).is_err() {
            break;
        }
        count += 1;
    }
    let faults = source.faults();
    Ok((count, faults))
}

/// Hands frames on to be looked at; returns which came, and what the source survived.
fn read_frames(
    mut source: Box<dyn StereoSource>,
    mut frame: StereoFrame,
    send: &SyncSender<Seen>,
    is_live: bool,
) -> Result<(Vec<(u64, Timestamp)>, Faults), DriverError> {
    let mut notes = Vec::new();
    while notes.len() < MAX_FRAMES && source.next_frame(&mut frame)? {
        notes.push((frame.sequence, frame.stamp));
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
    let faults = source.faults();
    Ok((notes, faults))
}
