//! The topics that RViz 2 and others draw: a row of a table each. A view is drawn at a bounded rate of data time, and only while it has
//! subscribers.

use super::cdr;
use super::frames::RosFrames;
use super::interface::{Interface, InterfaceType};
use super::messages::{CompressedImage, Header, Image, MarkerArray, Path, PointCloud2, Time};
use super::names::RosTopic;
use super::picture::Drawing;
use super::scene::RosScene;
use super::topic::{Declaring, TopicPublisher};
use super::views;
use crate::net::NetError;
use crate::net::pace::{Pace, Rates};
use plumbline_config::Timestamp;
use plumbline_config::options::{RosConfig, RosPictures};
use plumbline_record::local::picture::Shot;
use plumbline_record::topics::Topic;
use serde::Serialize;
use zenoh::qos::Priority;

/// Messages that a subscriber is advised to hold: each replaces the one before.
const DEPTH: u32 = 1;

/// A view: name of its topic, topic of the flight whose rate it has, whether the configuration has it (with a map or without), and its
/// message of what the flight has said so far, if there is one.
struct View {
    name: &'static str,
    priority: Priority,
    rate: Topic,
    is_on: fn(&RosConfig, bool) -> bool,
    interface: fn() -> InterfaceType,
    draw: fn(&RosScene, &Drawn<'_>) -> Option<Vec<u8>>,
}

/// Frames and times as headers have them.
struct Drawn<'a> {
    frames: &'a RosFrames<'a>,
    time: &'a dyn Fn(Timestamp) -> Time,
}

impl<'a> Drawn<'a> {
    /// Header in the frame of the corrected path; none while there is no such path.
    fn in_map(&self, scene: &RosScene) -> Option<Header<'a>> {
        let newest = scene.corrected.poses.last()?;
        Some(Header { stamp: (self.time)(newest.stamp), frame_id: self.frames.map })
    }
}

/// All views. What the flight says besides is in the scene too ([`RosScene::newest`]).
const VIEWS: &[View] = &[
    View {
        name: "path",
        priority: Priority::Data,
        rate: Topic::Path,
        is_on: |options, _| options.path,
        interface: InterfaceType::of::<Path<'_>>,
        draw: |scene, at| {
            encoded(&views::path(at.frames, at.frames.odom, scene.path.poses().iter().copied(), at.time))
        },
    },
    View {
        name: "landmarks",
        priority: Priority::DataLow,
        rate: Topic::Window,
        is_on: |options, _| options.landmarks,
        interface: InterfaceType::of::<PointCloud2<'_>>,
        draw: |scene, at| {
            let window = scene.landmarks.window()?;
            let points = window.points.iter().map(|point| point.p_o.cast());
            encoded(&views::cloud(at.frames.header((at.time)(window.stamp)), points))
        },
    },
    View {
        name: "lines",
        priority: Priority::DataLow,
        rate: Topic::Window,
        is_on: |options, _| options.landmarks,
        interface: InterfaceType::of::<MarkerArray<'_>>,
        draw: |scene, at| {
            let window = scene.landmarks.window()?;
            let lines = window.lines.iter().map(|line| line.ends_o);
            encoded(&views::lines(&at.frames.header((at.time)(window.stamp)), lines))
        },
    },
    View {
        name: "map/path",
        priority: Priority::Data,
        rate: Topic::Path,
        is_on: |options, has_map| options.map && has_map,
        interface: InterfaceType::of::<Path<'_>>,
        draw: |scene, at| {
            at.in_map(scene)?;
            let poses = scene.corrected.poses.iter().map(|at| (at.stamp, at.pose_m_b));
            encoded(&views::path(at.frames, at.frames.map, poses, at.time))
        },
    },
    View {
        name: "map/landmarks",
        priority: Priority::DataLow,
        rate: Topic::Path,
        is_on: |options, has_map| options.map && has_map,
        interface: InterfaceType::of::<PointCloud2<'_>>,
        draw: |scene, at| {
            let header = at.in_map(scene)?;
            let landmarks = scene.landmarks.corrected(&scene.corrected, scene.estimate.as_ref());
            encoded(&views::cloud(header, landmarks.points))
        },
    },
    View {
        name: "map/markers",
        priority: Priority::DataLow,
        rate: Topic::Path,
        is_on: |options, has_map| options.map && has_map,
        interface: InterfaceType::of::<MarkerArray<'_>>,
        draw: |scene, at| {
            let header = at.in_map(scene)?;
            let landmarks = scene.landmarks.corrected(&scene.corrected, scene.estimate.as_ref());
            encoded(&views::map(&header, &scene.corrected, &landmarks))
        },
    },
];

fn encoded<T: Interface + Serialize>(message: &T) -> Option<Vec<u8>> {
    cdr::encode(message).ok()
}

/// Publishers of the views, as far as the configuration has them.
pub struct ViewTopics {
    views: Vec<(&'static View, Pace, TopicPublisher)>,
    tracks: Option<TopicPublisher>,
    pictures: RosPictures,
    rates: Rates,
    picture_pace: Pace,
}

/// Stamps of one publication: as headers have them, and the present time, ns since 1970.
pub struct PublicationTimes<F> {
    /// Converts a time of measurement.
    pub time: F,
    /// Time of publication.
    pub now_ns: i64,
}

impl ViewTopics {
    /// Declares the topics. Without a map (`has_map`) there are none of it.
    ///
    /// # Errors
    /// When Zenoh refuses a key.
    pub async fn declare(
        declaring: &mut Declaring<'_>,
        options: &RosConfig,
        has_map: bool,
    ) -> Result<Self, NetError> {
        let rates = Rates::of(options.link);
        let mut views = Vec::new();
        for view in VIEWS.iter().filter(|view| (view.is_on)(options, has_map)) {
            let publisher = declare(declaring, view.name, (view.interface)(), view.priority).await?;
            views.push((view, Pace::new(rates.hz(view.rate)), publisher));
        }
        let tracks = match options.tracks {
            RosPictures::Off => None,
            RosPictures::Compressed => {
                Some(("tracks/compressed", InterfaceType::of::<CompressedImage<'_>>()))
            }
            RosPictures::Raw => Some(("tracks", InterfaceType::of::<Image<'_>>())),
        };
        let tracks = match tracks {
            Some((name, interface)) => Some(declare(declaring, name, interface, Priority::Background).await?),
            None => None,
        };
        let picture_pace = Pace::new(rates.hz(Topic::Picture));
        Ok(Self { views, tracks, pictures: options.tracks, rates, picture_pace })
    }

    /// Publishes what is due at `stamp`.
    pub async fn send<F: Fn(Timestamp) -> Time>(
        &mut self,
        scene: &RosScene,
        frames: &RosFrames<'_>,
        stamp: Timestamp,
        clock: &PublicationTimes<F>,
    ) {
        for (view, pace, publisher) in &mut self.views {
            if !pace.admits(stamp) || !publisher.has_subscribers().await {
                continue;
            }
            if let Some(message) = (view.draw)(scene, &Drawn { frames, time: &clock.time }) {
                publisher.put_encoded(message, clock.now_ns).await;
            }
        }
    }

    /// Rate of pictures that is wanted now, Hz.
    pub async fn pictures_hz(&self) -> f64 {
        match &self.tracks {
            Some(tracks) if tracks.has_subscribers().await => self.rates.hz(Topic::Picture),
            _ => 0.0,
        }
    }

    /// Publishes a picture, if it is due.
    pub async fn send_picture<F: Fn(Timestamp) -> Time>(
        &mut self,
        shot: &Shot,
        frames: &RosFrames<'_>,
        clock: &PublicationTimes<F>,
    ) {
        let Some(tracks) = &mut self.tracks else { return };
        if !self.picture_pace.admits(shot.stamp) || !tracks.has_subscribers().await {
            return;
        }
        let Some(drawing) = Drawing::new(shot, self.rates.camera_width_px) else { return };
        let header = Header { stamp: (clock.time)(shot.stamp), frame_id: frames.body };
        if self.pictures == RosPictures::Raw {
            tracks.put(&drawing.raw(header), clock.now_ns).await;
        } else if let Ok(message) = drawing.compressed(header, self.rates.camera_quality) {
            tracks.put(&message, clock.now_ns).await;
        }
    }
}

/// Declares the publisher of a topic in the namespace of the node.
async fn declare(
    declaring: &mut Declaring<'_>,
    name: &str,
    interface: InterfaceType,
    priority: Priority,
) -> Result<TopicPublisher, NetError> {
    let topic = RosTopic { name: declaring.node().qualified(name), interface, depth: DEPTH };
    TopicPublisher::declare(declaring, topic, priority).await
}
