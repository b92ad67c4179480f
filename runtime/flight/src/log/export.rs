//! A flight log as a file that Foxglove draws whole: what the log holds for people to look at, and beside it the scene
//! (keyframes, landmarks, lines) and the path.
//!
//! The scene is not recorded in flight: it would cost the window's thread a copy and the disk as much as all samples. The
//! execution of the log has the same window, bit for bit, and is where it is taken from.

use super::LogError;
use super::channel::Channel;
use super::known::KnownMap;
use super::part_header::PartHeader;
use super::reader::LogReader;
use super::verify::{Verification, verify_before};
use crate::pipeline::listener::{Listener, ListenerView, Producer, Solved, Subscriber};
use mcap::records::MessageHeader;
use mcap::{Compression, McapError, WriteOptions};
use nalgebra::Isometry3;
use parking_lot::Mutex;
use plumbline_config::Timestamp;
use plumbline_drivers::StereoSource;
use plumbline_estimator::MapSnapshot;
use plumbline_record::Said;
use plumbline_scene::messages::{SceneEntity, SceneUpdate};
use plumbline_scene::{self as scene, Landmarks, SceneContent, log_time};
use prost::Message;
use std::collections::BTreeMap;
use std::fs::{File, OpenOptions};
use std::io::BufWriter;
use std::path::Path;
use std::sync::Arc;

/// Topic of the scene, and of the path.
pub const SCENE: &str = "/scene";
/// Topic of the path.
pub const PATH: &str = "/path";
/// The window is drawn this often, ns of data.
const WINDOW_NS: i64 = 500_000_000;
/// Poses of the path are this far apart, ns.
const POSE_NS: i64 = 200_000_000;

/// Result of an export.
#[derive(Clone, Debug)]
pub struct Exported {
    /// Keyframes in the scene.
    pub keyframes: u64,
    /// Messages in the file.
    pub messages: u64,
    /// Verification by the execution from which the scene was taken.
    pub verification: Verification,
}

/// Writes the log at `path` to `out`. Images and map as for [`verify`](super::verify::verify).
///
/// # Errors
/// When there is a file of that name, it cannot be written, or the log cannot be read or executed.
pub fn export(
    path: &Path,
    out: &Path,
    images: Option<Box<dyn StereoSource>>,
    known: Option<KnownMap>,
    progress: &mut dyn FnMut(f64),
) -> Result<Exported, LogError> {
    let about = LogReader::open(path)?.about().clone();
    let file = OpenOptions::new().write(true).create_new(true).open(out).map_err(|e| match e.kind() {
        std::io::ErrorKind::AlreadyExists => LogError::Exists { path: out.to_owned() },
        _ => LogError::io(out, e),
    })?;
    let exported = write(path, out, file, &about, |drawing| {
        verify_before(path, images, known, &mut Witness(drawing), progress)
    });
    if exported.is_err() {
        // Half a file would be in the way of the next attempt.
        let _ = std::fs::remove_file(out);
    }
    exported
}

fn write(
    path: &Path,
    out: &Path,
    file: File,
    about: &PartHeader,
    execute: impl FnOnce(Arc<Mutex<Drawing>>) -> Result<Verification, LogError>,
) -> Result<Exported, LogError> {
    let failed = |error: McapError| LogError::unusable(out, format!("cannot be written: {error}"));
    let drawing = Arc::new(Mutex::new(Drawing::new(file, about).map_err(failed)?));
    let verification = execute(Arc::clone(&drawing))?;
    let mut drawing = drawing.lock();
    let mut log = LogReader::open(path)?;
    loop {
        match log.next_message() {
            Ok(Some(message)) if message.channel.is_drawn() => {
                drawing.put(message.channel.channel(), message.time_ns, message.payload);
            }
            Ok(Some(_)) => {}
            Ok(None) => break,
            // What the execution says of it is said.
            Err(_) if verification.damage.is_some() => break,
            Err(error) => return Err(error),
        }
    }
    drawing.finish().map_err(failed)?;
    Ok(Exported { keyframes: drawing.keyframes, messages: drawing.messages, verification })
}

/// The file that is being written.
struct Drawing {
    writer: mcap::Writer<BufWriter<File>>,
    channels: BTreeMap<&'static str, u16>,
    /// The first thing that went wrong; nothing is written after it.
    failure: Option<McapError>,
    frame: String,
    /// The window of the frame before.
    last: Option<MapSnapshot>,
    snapshot: MapSnapshot,
    window_due: Timestamp,
    /// Poses since the last reset, and the time of the first.
    poses: Vec<Isometry3<f64>>,
    since: Timestamp,
    pose_due: Timestamp,
    resets: u32,
    keyframes: u64,
    messages: u64,
}

impl Drawing {
    fn new(file: File, about: &PartHeader) -> Result<Self, McapError> {
        let options = WriteOptions::new()
            .library(format!("plumbline {}", about.build.version))
            .compression(Some(Compression::Lz4));
        let mut writer = options.create(BufWriter::new(file))?;
        let mut channels = BTreeMap::new();
        let drawn = Channel::LOGGED.into_iter().filter(|channel| channel.is_drawn());
        let own = [(SCENE, "foxglove.SceneUpdate"), (PATH, "foxglove.PosesInFrame")];
        for (topic, schema) in
            drawn.map(|channel| (channel.channel(), channel.schema(about.images))).chain(own)
        {
            let descriptors = scene::descriptors(schema).unwrap_or_default();
            let schema = writer.add_schema(schema, "protobuf", &descriptors)?;
            channels.insert(topic, writer.add_channel(schema, topic, "protobuf", &BTreeMap::new())?);
        }
        Ok(Self {
            writer,
            channels,
            failure: None,
            frame: about.config.ros.odom_frame.clone(),
            last: None,
            snapshot: MapSnapshot::new(about.config.setup()),
            window_due: Timestamp::MIN,
            poses: Vec::new(),
            since: Timestamp::MIN,
            pose_due: Timestamp::MIN,
            resets: about.first_reset_counter,
            keyframes: 0,
            messages: 0,
        })
    }

    fn put(&mut self, topic: &'static str, time_ns: u64, payload: &[u8]) {
        let Some(channel_id) = self.channels.get(topic).copied().filter(|_| self.failure.is_none()) else {
            return;
        };
        let sequence = u32::try_from(self.messages).unwrap_or(u32::MAX);
        let header = MessageHeader { channel_id, sequence, log_time: time_ns, publish_time: time_ns };
        match self.writer.write_to_known_channel(&header, payload) {
            Ok(()) => self.messages += 1,
            Err(error) => self.failure = Some(error),
        }
    }

    fn put_scene(&mut self, stamp: Timestamp, update: &SceneUpdate) {
        self.put(SCENE, log_time(stamp), &update.encode_to_vec());
    }

    /// Draws the window after an estimate, and what has left it.
    fn solved(&mut self, solved: &Solved<'_>) {
        let mut now = std::mem::take(&mut self.snapshot);
        solved.copy_to(&mut now);
        if let Some(last) = self.last.take() {
            let is_gone = |stamp| now.keyframes.iter().all(|keyframe| keyframe.stamp != stamp);
            let gone = last.keyframes.iter().filter(|keyframe| is_gone(keyframe.stamp));
            let entities: Vec<_> = gone.map(|keyframe| self.kept(&last, keyframe.stamp)).collect();
            if now.reset_counter == last.reset_counter && !entities.is_empty() {
                self.keyframes += entities.len() as u64;
                self.put_scene(now.stamp, &scene::update(entities));
            }
            self.snapshot = last;
        }
        if now.stamp >= self.window_due {
            self.window_due = now.stamp.plus_nanos(WINDOW_NS);
            let content = window(&now);
            let entity = scene::entity(now.stamp, &self.frame, "window", &content, Landmarks::InWindow);
            self.put_scene(now.stamp, &scene::update(vec![entity]));
        }
        self.last = Some(now);
    }

    fn kept(&self, last: &MapSnapshot, stamp: Timestamp) -> SceneEntity {
        let id = format!("keyframe {}", stamp.as_nanos());
        scene::entity(stamp, &self.frame, &id, &keyframe(last, stamp), Landmarks::Kept)
    }

    /// Takes a pose of the path. After a reset there is another one, in an empty scene.
    fn said(&mut self, said: &Said) {
        let Said::Estimate(full) = said else { return };
        let estimate = &full.estimate;
        if estimate.reset_counter != self.resets {
            self.write_path();
            self.resets = estimate.reset_counter;
            self.last = None;
            self.put_scene(estimate.stamp, &scene::cleared(estimate.stamp));
        }
        if !estimate.has_pose() || estimate.stamp < self.pose_due {
            return;
        }
        if self.poses.is_empty() {
            self.since = estimate.stamp;
        }
        self.pose_due = estimate.stamp.plus_nanos(POSE_NS);
        self.poses.push(estimate.pose_o_b);
    }

    /// Writes a path to where it begins: a file is looked at as a whole.
    fn write_path(&mut self) {
        let poses = std::mem::take(&mut self.poses);
        if !poses.is_empty() {
            let path = scene::poses(self.since, &self.frame, &poses);
            self.put(PATH, log_time(self.since), &path.encode_to_vec());
        }
    }

    fn finish(&mut self) -> Result<(), McapError> {
        self.write_path();
        if let Some(failure) = self.failure.take() {
            return Err(failure);
        }
        self.writer.finish().map(|_| ())
    }
}

/// All of a window.
fn window(of: &MapSnapshot) -> SceneContent {
    SceneContent {
        points: of.points.iter().map(|point| point.p_o).collect(),
        lines: of.lines.iter().map(|line| line.ends_o).collect(),
        keyframes: of.keyframes.iter().map(|keyframe| keyframe.pose_o_b).collect(),
    }
}

/// The keyframe of a window that was taken at `stamp`, with the landmarks that it hosts.
fn keyframe(of: &MapSnapshot, stamp: Timestamp) -> SceneContent {
    let mut of = of.clone();
    of.points.retain(|point| point.host == stamp);
    of.lines.retain(|line| line.host == stamp);
    of.keyframes.retain(|keyframe| keyframe.stamp == stamp);
    window(&of)
}

/// Listens to the execution.
struct Witness(Arc<Mutex<Drawing>>);

impl Subscriber for Witness {
    fn listener(&mut self, producer: Producer) -> Box<dyn Listener> {
        match producer {
            Producer::Window => Box::new(WindowListener(Arc::clone(&self.0))),
            _ => Box::new(()),
        }
    }
}

struct WindowListener(Arc<Mutex<Drawing>>);

impl Listener for WindowListener {
    fn said(&mut self, said: &Said) {
        self.0.lock().said(said);
    }

    fn shown(&mut self, view: ListenerView<'_>) {
        if let ListenerView::Solved(solved) = view {
            self.0.lock().solved(solved);
        }
    }
}
