//! ROS bags: images and inertial samples as they were recorded elsewhere. ROS 2 records MCAP files or databases of SQLite, ROS
//! 1 files of its own.
//!
//! [`BagDataset::open`] reads the whole bag once for the stamps of its messages: those of their headers, which are times of
//! measurement, and not those of their arrival. Which topics are flown is in `topics`. From there on a bag is treated as a
//! EuRoC data set is: paired by time, ordered, cut, with gaps numbered and what is wrong counted in [`Faults`]; gyroscope and
//! accelerometer on topics of their own are joined (`inertial`). The images are read when they are asked for (`stereo`). `files` finds the files, `stream` the messages in them, whose
//! containers are in `mcap_file`, `sqlite_file` and `ros1_file`; `wire`, `messages` and `pixels` understand messages.

pub(crate) mod container;
mod files;
pub(crate) mod holds;
mod inertial;
pub(crate) mod mcap_file;
pub(crate) mod messages;
pub(crate) mod pixels;
pub(crate) mod ros1_file;
pub(crate) mod sqlite_file;
mod stereo;
mod stream;
#[cfg(test)]
mod tests;
pub(crate) mod topics;
pub(crate) mod wire;

pub use stereo::BagStereo;

use crate::euroc::defects::of_stamps;
use crate::euroc::depth::Depth;
use crate::euroc::frames::{Frames, frames_span};
use crate::euroc::imu::EurocImu;
use crate::euroc::order::{Order, not_stamped};
use crate::euroc::pairing::ImageRow;
use crate::euroc::span::imu_of;
use crate::euroc::table::Table;
use crate::euroc::{Defect, EurocOptions};
use crate::{BagTopics, DriverError, Faults};
use container::Topic;
use files::bag_files;
use holds::Holds;
use inertial::Samples;
use messages::{Format, ImageMessage, ImuMessage, Kind};
use plumbline_config::{ImuSample, Timestamp};
use std::path::{Path, PathBuf};
use stream::Messages;

/// Messages that are looked at, at most: days of an IMU at 1 kHz.
const MAX_MESSAGES: u64 = 200_000_000;
/// Images that are looked at for the bits in use: the first ones, and then one in this many.
const LOOKED_AT_EVERY: u64 = 64;

/// Fewest messages whose headers tell microseconds: by chance all of them lie in the first thousandth of a second once in 10^60.
const FEW_HEADERS: u64 = 20;

/// An opened bag: stamps and inertial samples in memory, images on disk.
#[derive(Debug)]
pub struct BagDataset {
    path: PathBuf,
    files: Vec<PathBuf>,
    sizes_px: Vec<(usize, usize)>,
    /// Numbers of the cameras' topics.
    cameras: Vec<usize>,
    names: Vec<String>,
    imu_names: Vec<String>,
    frames: Frames<u64>,
    depth: Depth,
    imu: EurocImu,
    defects: Vec<Defect>,
    is_truncated: bool,
}

/// Content of one topic.
#[derive(Debug, Default)]
struct Content {
    /// Messages so far, readable or not.
    count: u64,
    images: Vec<ImageRow<u64>>,
    inertial: Vec<ImuMessage>,
    size_px: Option<(usize, usize)>,
    /// The encoding or format that cannot be read, in words.
    unknown: Option<String>,
    /// Largest value of the images of 16 bits that were looked at.
    largest: Option<u16>,
    corrupt: u64,
    headers: Headers,
}

/// The fields of the nanoseconds in the headers of a topic.
#[derive(Clone, Copy, Debug, Default)]
struct Headers {
    /// Those beyond a second, and the largest of the others.
    beyond: u64,
    largest_ns: i64,
}

impl Headers {
    fn add(&mut self, nanos: i64) {
        let is_beyond = nanos >= 1_000_000_000;
        self.beyond += u64::from(is_beyond);
        self.largest_ns = self.largest_ns.max(if is_beyond { 0 } else { nanos });
    }

    /// A defect of the headers of a topic with so many messages.
    fn defect(self, topic: &str, messages: u64) -> Option<Defect> {
        let largest = self.largest_ns;
        let (what, evidence, cause) = if self.beyond > 0 {
            (
                "the headers hold nanoseconds of 1000000000 and more, so that their times are not known",
                format!("{topic}: {} of {messages} messages", self.beyond),
                "a driver that writes all nanoseconds, cut to 32 bits, into the field of those within the second",
            )
        } else if messages >= FEW_HEADERS && (1..1_000_000).contains(&largest) {
            (
                "the headers hold microseconds where nanoseconds belong",
                format!("{topic}: none of {messages} is above {largest}"),
                "a driver that writes microseconds within the second",
            )
        } else {
            return None;
        };
        let cure = "mend the driver: `sec` is whole seconds, `nanosec` what is left, below 1000000000; then record again";
        Some(Defect { what: what.into(), evidence, cause: cause.into(), cure: cure.into(), is_grave: true })
    }
}

impl Content {
    fn add(&mut self, format: Format, bytes: &[u8]) {
        let number = self.count;
        self.count += 1;
        messages::nanoseconds(format.encoding, bytes).into_iter().for_each(|nanos| self.headers.add(nanos));
        if format.kind == Kind::Imu {
            match messages::imu(format.encoding, bytes) {
                Some(message) => self.inertial.push(message),
                None => self.corrupt += 1,
            }
            return;
        }
        let Some(stamp) = messages::stamp(format.encoding, bytes) else {
            self.corrupt += 1;
            return;
        };
        let is_looked_at =
            self.size_px.is_none() || number.is_power_of_two() || number.is_multiple_of(LOOKED_AT_EVERY);
        if is_looked_at && let Some(image) = messages::image(format, bytes) {
            self.look_at(&image);
        }
        self.images.push(ImageRow { stamp, file: number });
    }
}

impl Content {
    fn look_at(&mut self, image: &ImageMessage<'_>) {
        if self.size_px.is_none() {
            self.size_px = pixels::size_px(image);
            self.unknown = match image {
                ImageMessage::Raw { encoding, .. } => (!pixels::is_known(encoding))
                    .then(|| format!("encoding '{}'", topics::printable(encoding))),
                ImageMessage::File(_) => self.size_px.is_none().then(|| "another format".to_owned()),
            };
        }
        // One that fills its bits says all there is to say.
        let is_full = |largest| Depth::of_largest(largest) == Depth::FULL && largest > 0;
        if !self.largest.is_some_and(is_full) {
            self.largest = self.largest.max(pixels::largest_value(image));
        }
    }
}

/// A bag read once.
struct Index {
    topics: Vec<Topic>,
    contents: Vec<Content>,
    is_truncated: bool,
}

impl Index {
    fn read(path: &Path, files: &[PathBuf]) -> Result<Self, DriverError> {
        let mut messages = Messages::new(files);
        let mut contents: Vec<Content> = Vec::new();
        let mut count = 0;
        while let Some(message) = messages.next()? {
            if contents.len() <= message.topic {
                contents.resize_with(message.topic + 1, Content::default);
            }
            contents[message.topic].add(message.format, message.bytes);
            count += 1;
            if count > MAX_MESSAGES {
                return Err(DriverError::refused(path, "holds more messages than are read; split it"));
            }
        }
        let topics = messages.topics().to_vec();
        contents.resize_with(topics.len(), Content::default);
        Ok(Self { topics, contents, is_truncated: messages.is_truncated })
    }
}

impl BagDataset {
    /// Opens the bag at `path`, a file or the directory of a recording; of `options` those of frames, times, sizes and
    /// pairing hold as for a EuRoC data set.
    ///
    /// # Errors
    /// When it is no such bag, is damaged, lacks a topic that is needed, or its images are not those of the configuration.
    pub fn open(path: &Path, topics: &BagTopics, options: &EurocOptions) -> Result<Self, DriverError> {
        let files = bag_files(path)?;
        let Index { topics: all, mut contents, is_truncated } = Index::read(path, &files)?;
        let headers: Vec<Defect> = all
            .iter()
            .zip(&contents)
            .filter_map(|(topic, content)| content.headers.defect(&topic.name, content.count))
            .collect();
        let refuse = |message: String| DriverError::refused(path, message);
        let wanted = if options.sizes_px.is_empty() { 2 } else { options.sizes_px.len() };
        let cameras = topics::cameras(&all, topics, wanted).map_err(refuse)?;
        let Images { rows, sizes_px, faults, mut orders, largest } =
            images(path, &all, &mut contents, &cameras, options)?;
        let depth = largest.map_or(Depth::FULL, Depth::of_largest);
        let cure = "are the cameras triggered together?";
        let frames = Frames::new(path, rows, options, cure, faults)?;
        let mut imu_names = Vec::new();
        let (imu, mut defects) = if options.with_imu {
            let samples = inertial_samples(path, &all, &mut contents, topics)?;
            imu_names.extend(samples.orders.iter().map(|(name, _)| name.clone()));
            orders.extend(samples.orders);
            imu_of(path, samples.table, &frames)?
        } else {
            (EurocImu::default(), Vec::new())
        };
        defects.extend(of_stamps(path, &orders, "messages", frames_span(frames.all()).0));
        defects.extend(headers);
        Ok(Self {
            path: path.to_owned(),
            files,
            sizes_px,
            names: cameras.iter().map(|topic| all[*topic].name.clone()).collect(),
            cameras,
            imu_names,
            frames,
            depth,
            imu,
            defects,
            is_truncated,
        })
    }

    /// Defects of the bag as a whole.
    pub fn defects(&self) -> &[Defect] {
        &self.defects
    }

    /// Cameras in use: 1 or 2.
    pub fn cameras(&self) -> usize {
        self.cameras.len()
    }

    /// Topics of the cameras in use.
    pub fn camera_topics(&self) -> &[String] {
        &self.names
    }

    /// Topics of the inertial samples: one, or those of gyroscope and accelerometer where they are apart.
    pub fn imu_topics(&self) -> &[String] {
        &self.imu_names
    }

    /// Image sizes in pixels; 0x0 for a camera that is not in use.
    pub fn sizes_px(&self) -> [(usize, usize); 2] {
        [0, 1].map(|camera| self.sizes_px.get(camera).copied().unwrap_or_default())
    }

    /// Stamps of the first and the last frame that will be handed out.
    pub fn span(&self) -> (Timestamp, Timestamp) {
        frames_span(self.frames.rest())
    }

    /// True if a file of the bag breaks off, as after a crash. The messages before are handed out.
    pub fn is_truncated(&self) -> bool {
        self.is_truncated
    }

    /// The image stream, from its beginning.
    pub fn stereo(&self) -> BagStereo {
        let messages = Messages::new(&self.files);
        BagStereo::new(&self.path, messages, self.names.clone(), self.frames.clone(), self.depth)
    }

    /// The inertial stream, from 1 s before the first frame to 0.1 s after the last.
    pub fn imu(&self) -> EurocImu {
        self.imu.clone()
    }
}

/// The images of all cameras in use.
#[derive(Default)]
struct Images {
    rows: Vec<Vec<ImageRow<u64>>>,
    sizes_px: Vec<(usize, usize)>,
    faults: Faults,
    orders: Vec<(String, Order)>,
    /// Largest value of the images of 16 bits that were looked at.
    largest: Option<u16>,
}

fn images(
    path: &Path,
    all: &[Topic],
    contents: &mut [Content],
    cameras: &[usize],
    options: &EurocOptions,
) -> Result<Images, DriverError> {
    let mut images = Images::default();
    for (camera, topic) in cameras.iter().enumerate() {
        let (content, name) = (std::mem::take(&mut contents[*topic]), &all[*topic].name);
        images.sizes_px.push(check_images(path, name, camera, &content, options)?);
        images.largest = images.largest.max(content.largest);
        let table = Table::of(content.images, content.corrupt);
        if let ([row], true) = (table.rows.as_slice(), table.order.is_constant()) {
            let message = not_stamped(name, "images", table.order.rows, row.stamp);
            return Err(DriverError::refused(path, message));
        }
        images.faults.corrupt += table.corrupt;
        table.order.add_to(&mut images.faults);
        images.orders.push((name.clone(), table.order));
        images.rows.push(table.rows);
    }
    Ok(images)
}

/// All inertial samples of the bag at `path`, in order of time, of the topic that is named or the only one.
///
/// # Errors
/// When it is no bag, or it holds none.
pub fn read_bag_imu(path: &Path, topics: &BagTopics) -> Result<Vec<ImuSample>, DriverError> {
    let Index { topics: all, mut contents, .. } = Index::read(path, &bag_files(path)?)?;
    Ok(inertial_samples(path, &all, &mut contents, topics)?.table.rows)
}

fn inertial_samples(
    path: &Path,
    all: &[Topic],
    contents: &mut [Content],
    named: &BagTopics,
) -> Result<Samples, DriverError> {
    let holds = |topic: usize| Holds::of(&contents[topic].inertial);
    let topics = topics::imu(all, named, holds).map_err(|message| DriverError::refused(path, message))?;
    let take = |topic: usize| {
        let content = std::mem::take(&mut contents[topic]);
        (content.inertial, content.corrupt)
    };
    inertial::samples(topics, |topic| all[topic].name.clone(), take)
        .map_err(|message| DriverError::refused(path, message))
}

fn check_some(path: &Path, topic: &str, is_empty: bool) -> Result<(), DriverError> {
    match is_empty {
        false => Ok(()),
        true => Err(DriverError::refused(
            path,
            format!("{topic} holds no message that can be read; was it being published?"),
        )),
    }
}

/// The size of a camera's images, checked against the expected.
fn check_images(
    path: &Path,
    topic: &str,
    camera: usize,
    content: &Content,
    options: &EurocOptions,
) -> Result<(usize, usize), DriverError> {
    if let Some(unknown) = &content.unknown {
        let message = format!(
            "{topic} has images of {unknown}; republish them in one of {}, or as PNG or baseline JPEG",
            pixels::ENCODINGS
        );
        return Err(DriverError::refused(path, message));
    }
    check_some(path, topic, content.images.is_empty() || content.size_px.is_none())?;
    let found = content.size_px.unwrap_or_default();
    match options.sizes_px.get(camera) {
        Some(&expected) if expected != found => {
            let message = format!(
                "{topic} has images of {}x{}, but the configuration says {}x{} for camera {camera}; give the \
                 configuration of this rig with --config",
                found.0, found.1, expected.0, expected.1
            );
            Err(DriverError::refused(path, message))
        }
        _ => Ok(found),
    }
}
