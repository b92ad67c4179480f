//! The topics that RViz 2 draws. Each is computed at a bounded rate of data time, and only while it has subscribers.

use super::frames::Frames;
use super::interface::{Interface, InterfaceType};
use super::messages::{CompressedImage, Header, Image, MarkerArray, Path, PointCloud2, Time};
use super::names::RosTopic;
use super::picture::Drawing;
use super::scene::Scene;
use super::topic::{Declaring, TopicPublisher};
use super::views;
use crate::net::NetError;
use crate::net::pace::{Pace, Rates};
use plumbline_config::Timestamp;
use plumbline_config::options::{RosConfig, RosPictures};
use plumbline_flight::local::Shot;
use plumbline_record::topics;
use zenoh::qos::Priority;

/// Messages that a subscriber is advised to hold: each replaces the one before.
const DEPTH: u32 = 1;

/// Publishers of the views, as far as the configuration has them.
pub struct ViewTopics {
    path: Option<TopicPublisher>,
    window: Option<Window>,
    map: Option<Map>,
    tracks: Option<TopicPublisher>,
    pictures: RosPictures,
    rates: Rates,
    path_pace: Pace,
    window_pace: Pace,
    map_pace: Pace,
    picture_pace: Pace,
}

/// Content of the window.
struct Window {
    landmarks: TopicPublisher,
    lines: TopicPublisher,
}

/// The map.
struct Map {
    path: TopicPublisher,
    landmarks: TopicPublisher,
    markers: TopicPublisher,
}

/// Stamps of one publication: as headers have them, and the present time, ns since 1970.
pub struct Clock<F> {
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
        let path = match options.path {
            true => Some(declare::<Path<'_>>(declaring, "path", Priority::Data).await?),
            false => None,
        };
        let window = match options.landmarks {
            true => Some(Window {
                landmarks: declare::<PointCloud2<'_>>(declaring, "landmarks", Priority::DataLow).await?,
                lines: declare::<MarkerArray<'_>>(declaring, "lines", Priority::DataLow).await?,
            }),
            false => None,
        };
        let map = match options.map && has_map {
            true => Some(Map {
                path: declare::<Path<'_>>(declaring, "map/path", Priority::Data).await?,
                landmarks: declare::<PointCloud2<'_>>(declaring, "map/landmarks", Priority::DataLow).await?,
                markers: declare::<MarkerArray<'_>>(declaring, "map/markers", Priority::DataLow).await?,
            }),
            false => None,
        };
        let priority = Priority::Background;
        let tracks = match options.tracks {
            RosPictures::Off => None,
            RosPictures::Compressed => {
                Some(declare::<CompressedImage<'_>>(declaring, "tracks/compressed", priority).await?)
            }
            RosPictures::Raw => Some(declare::<Image<'_>>(declaring, "tracks", priority).await?),
        };
        Ok(Self {
            path,
            window,
            map,
            tracks,
            pictures: options.tracks,
            rates,
            path_pace: Pace::new(rates.hz(topics::Topic::Path)),
            window_pace: Pace::new(rates.hz(topics::Topic::Window)),
            map_pace: Pace::new(rates.hz(topics::Topic::Path)),
            picture_pace: Pace::new(rates.hz(topics::Topic::Picture)),
        })
    }

    /// Publishes what is due at `stamp`.
    pub async fn send<F: Fn(Timestamp) -> Time>(
        &mut self,
        scene: &Scene,
        frames: &Frames<'_>,
        stamp: Timestamp,
        clock: &Clock<F>,
    ) {
        if self.path_pace.admits(stamp) {
            self.send_path(scene, frames, clock).await;
        }
        if self.window_pace.admits(stamp) {
            self.send_window(scene, frames, clock).await;
        }
        if self.map_pace.admits(stamp) {
            self.send_map(scene, frames, clock).await;
        }
    }

    async fn send_path<F: Fn(Timestamp) -> Time>(
        &mut self,
        scene: &Scene,
        frames: &Frames<'_>,
        clock: &Clock<F>,
    ) {
        if let Some(path) = &mut self.path
            && path.has_subscribers().await
        {
            let poses = scene.path.poses().iter().copied();
            path.put(&views::path(frames, frames.odom, poses, &clock.time), clock.now_ns).await;
        }
    }

    async fn send_window<F: Fn(Timestamp) -> Time>(
        &mut self,
        scene: &Scene,
        frames: &Frames<'_>,
        clock: &Clock<F>,
    ) {
        let (Some(window), Some(snapshot)) = (&mut self.window, scene.landmarks.window()) else { return };
        let header = frames.header((clock.time)(snapshot.stamp));
        if window.landmarks.has_subscribers().await {
            let points = snapshot.points.iter().map(|point| point.p_o.cast());
            window.landmarks.put(&views::cloud(header.clone(), points), clock.now_ns).await;
        }
        if window.lines.has_subscribers().await {
            let lines = snapshot.lines.iter().map(|line| line.ends_o);
            window.lines.put(&views::lines(&header, lines), clock.now_ns).await;
        }
    }

    async fn send_map<F: Fn(Timestamp) -> Time>(
        &mut self,
        scene: &Scene,
        frames: &Frames<'_>,
        clock: &Clock<F>,
    ) {
        let (Some(map), Some(newest)) = (&mut self.map, scene.corrected.poses.last()) else { return };
        let header = Header { stamp: (clock.time)(newest.stamp), frame_id: frames.map };
        if map.path.has_subscribers().await {
            let poses = scene.corrected.poses.iter().map(|at| (at.stamp, at.pose_m_b));
            map.path.put(&views::path(frames, frames.map, poses, &clock.time), clock.now_ns).await;
        }
        let (cloud, markers) = (map.landmarks.has_subscribers().await, map.markers.has_subscribers().await);
        if !cloud && !markers {
            return;
        }
        let landmarks = scene.landmarks.corrected(&scene.corrected, scene.estimate.as_ref());
        if markers {
            map.markers.put(&views::map(&header, &scene.corrected, &landmarks), clock.now_ns).await;
        }
        if cloud {
            map.landmarks.put(&views::cloud(header, landmarks.points), clock.now_ns).await;
        }
    }

    /// Rate of pictures that is wanted now, Hz.
    pub async fn pictures_hz(&self) -> f64 {
        match &self.tracks {
            Some(tracks) if tracks.has_subscribers().await => self.rates.hz(topics::Topic::Picture),
            _ => 0.0,
        }
    }

    /// Publishes a picture, if it is due.
    pub async fn send_picture<F: Fn(Timestamp) -> Time>(
        &mut self,
        shot: &Shot,
        frames: &Frames<'_>,
        clock: &Clock<F>,
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
async fn declare<T: Interface>(
    declaring: &mut Declaring<'_>,
    name: &str,
    priority: Priority,
) -> Result<TopicPublisher, NetError> {
    let name = declaring.node().qualified(name);
    let topic = RosTopic { name, interface: InterfaceType::of::<T>(), depth: DEPTH };
    TopicPublisher::declare(declaring, topic, priority).await
}
