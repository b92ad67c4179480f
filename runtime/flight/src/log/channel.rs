//! The channels of a log: topic, schema, and what part they have in a re-execution.

use plumbline_config::options::ImageRecording;
use plumbline_record::schema;
use std::sync::OnceLock;

/// Descriptors of the messages that Foxglove draws.
pub const FOXGLOVE: &[u8] = include_bytes!("../../generated/foxglove.descriptors");

/// A channel of the log.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Channel {
    /// Inertial samples.
    Imu,
    /// Left images.
    Left,
    /// Right images.
    Right,
    /// Frames: number, stamp, hashes of the images.
    Frame,
    /// What became of frames.
    FrameOrder,
    /// When estimates took effect.
    CorrectionOrder,
    /// Resets.
    ResetOrder,
    /// What became of frames for the map.
    MapOrder,
    /// Estimates.
    Estimate,
    /// Where the odometry lies in the map.
    MapEstimate,
    /// Odometry.
    Odometry,
    /// Position of the body, to be drawn.
    Transform,
    /// Pose of the body, to be drawn.
    Pose,
    /// Events.
    Event,
    /// State of the recording.
    Recording,
    /// Calibration of the left camera.
    LeftCalibration,
    /// Calibration of the right camera.
    RightCalibration,
    /// Where cameras and vehicle are on the body.
    Mounting,
}

impl Channel {
    /// All channels, in the order of the enumeration. It is that of the seal too: new ones come last.
    pub const ALL: [Self; 18] = [
        Self::Imu,
        Self::Left,
        Self::Right,
        Self::Frame,
        Self::FrameOrder,
        Self::CorrectionOrder,
        Self::ResetOrder,
        Self::MapOrder,
        Self::Estimate,
        Self::MapEstimate,
        Self::Odometry,
        Self::Transform,
        Self::Pose,
        Self::Event,
        Self::Recording,
        Self::LeftCalibration,
        Self::RightCalibration,
        Self::Mounting,
    ];

    /// Its topic.
    #[must_use]
    pub const fn topic(self) -> &'static str {
        match self {
            Self::Imu => "/input/imu",
            Self::Left => "/input/left",
            Self::Right => "/input/right",
            Self::Frame => "/input/frame",
            Self::FrameOrder => "/order/frame",
            Self::CorrectionOrder => "/order/correction",
            Self::ResetOrder => "/order/reset",
            Self::MapOrder => "/order/map",
            Self::Estimate => "/output/estimate",
            Self::MapEstimate => "/output/map",
            Self::Odometry => "/output/odometry",
            Self::Transform => "/tf",
            Self::Pose => "/pose",
            Self::Event => "/event",
            Self::Recording => "/recorder",
            Self::LeftCalibration => "/calibration/left",
            Self::RightCalibration => "/calibration/right",
            Self::Mounting => "/tf_static",
        }
    }

    /// The channel of a topic.
    #[must_use]
    pub fn of_topic(topic: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|channel| channel.topic() == topic)
    }

    /// Name of its schema.
    #[must_use]
    pub const fn schema(self, images: ImageRecording) -> &'static str {
        match self {
            Self::Imu => "plumbline.v1.log.Imu",
            Self::Left | Self::Right => match images {
                ImageRecording::Raw => "foxglove.RawImage",
                ImageRecording::Png | ImageRecording::None => "foxglove.CompressedImage",
            },
            Self::Frame => "plumbline.v1.log.Frame",
            Self::FrameOrder => "plumbline.v1.log.FrameOrder",
            Self::CorrectionOrder => "plumbline.v1.log.CorrectionOrder",
            Self::ResetOrder => "plumbline.v1.log.ResetOrder",
            Self::MapOrder => "plumbline.v1.log.MapOrder",
            Self::Estimate => "plumbline.v1.log.Estimate",
            Self::MapEstimate => "plumbline.v1.log.MapEstimate",
            Self::Odometry => "plumbline.v1.log.Odometry",
            Self::Transform => "foxglove.FrameTransform",
            Self::Pose => "foxglove.PoseInFrame",
            Self::Event => "foxglove.Log",
            Self::Recording => "plumbline.v1.log.Recording",
            Self::LeftCalibration | Self::RightCalibration => "foxglove.CameraCalibration",
            Self::Mounting => "foxglove.FrameTransforms",
        }
    }

    /// Whether people look at it: its schema is one of Foxglove's.
    #[must_use]
    pub fn is_drawn(self) -> bool {
        self.schema(ImageRecording::Png).starts_with("foxglove.")
    }

    /// The `FileDescriptorSet` that its schema is in.
    #[must_use]
    pub fn descriptors(self) -> &'static [u8] {
        static OWN: OnceLock<Vec<u8>> = OnceLock::new();
        if self.is_drawn() { FOXGLOVE } else { OWN.get_or_init(schema::descriptors) }
    }

    /// Whether a re-execution needs it.
    #[must_use]
    pub const fn is_input(self) -> bool {
        self.is_image()
            || matches!(
                self,
                Self::Imu
                    | Self::Frame
                    | Self::FrameOrder
                    | Self::CorrectionOrder
                    | Self::ResetOrder
                    | Self::MapOrder
            )
    }

    /// Whether it holds images.
    #[must_use]
    pub const fn is_image(self) -> bool {
        matches!(self, Self::Left | Self::Right)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use prost::Message as _;
    use prost_types::FileDescriptorSet;

    #[test]
    fn every_topic_names_its_channel() {
        for (index, channel) in Channel::ALL.into_iter().enumerate() {
            assert_eq!(channel as usize, index);
            assert_eq!(Channel::of_topic(channel.topic()), Some(channel));
        }
        assert_eq!(Channel::of_topic("/elsewhere"), None);
    }

    #[test]
    fn every_schema_is_in_its_descriptors() {
        for images in [ImageRecording::Png, ImageRecording::Raw] {
            for channel in Channel::ALL {
                let set = FileDescriptorSet::decode(channel.descriptors()).unwrap();
                let names = set.file.iter().flat_map(|file| {
                    file.message_type.iter().map(move |m| format!("{}.{}", file.package(), m.name()))
                });
                let names: Vec<String> = names.collect();
                assert!(names.iter().any(|name| name == channel.schema(images)), "{channel:?}: {names:?}");
            }
        }
    }
}
