//! The stereo pairs of a recording, one by one, with their features.

use nalgebra::Vector3;
use plumbline_config::import::euroc_cameras_into;
use plumbline_config::options::image_sizes;
use plumbline_config::{Config, Timestamp};
use plumbline_drivers::{DriverError, EurocDataset, EurocOptions, StereoFrame, StereoSource};
use plumbline_estimator::image::Pyramid;
use plumbline_estimator::places::Feature;
use plumbline_estimator::places::extractor::{Extractor, View};
use plumbline_estimator::points::rig::RigCamera;
use std::path::Path;

/// Pyramid levels of an image: patches of 48 px radius need the third.
const LEVELS: usize = 3;

/// The frames of a recording.
pub struct RecordedFrames {
    stereo: Box<dyn StereoSource>,
    frame: StereoFrame,
    pyramids: [Pyramid; 2],
    built: [bool; 2],
    rig: Vec<RigCamera>,
    extractor: Extractor,
    every: usize,
    offset: usize,
    number: usize,
}

impl RecordedFrames {
    /// Every `every`th frame of a EuRoC data set without an IMU, from number `offset` on.
    pub fn open(path: &Path, every: usize, offset: usize, max_features: usize) -> Result<Self, DriverError> {
        let config = euroc_cameras_into(Config::preset("euroc").unwrap(), path).unwrap();
        let dataset =
            EurocDataset::open(path, &EurocOptions { with_imu: false, ..EurocOptions::for_config(&config) })?;
        let cameras = &config.camera[..dataset.cameras()];
        let sizes = image_sizes(cameras);
        let rig = cameras.iter().map(|c| {
            let mut camera = RigCamera::new(c.model());
            camera.pose_b_c = c.pose_b_c();
            camera
        });
        Ok(Self {
            stereo: Box::new(dataset.stereo()),
            frame: StereoFrame::new(sizes),
            pyramids: sizes.map(|(width, height)| Pyramid::new(width, height, LEVELS)),
            built: [false; 2],
            rig: rig.collect(),
            extractor: Extractor::new(sizes[0].0, sizes[0].1, max_features),
            every,
            offset,
            number: 0,
        })
    }

    /// The left camera.
    pub fn left(&self) -> &RigCamera {
        &self.rig[0]
    }

    /// Goes to the next frame that has a left image; its stamp, or `None` at the end.
    pub fn advance(&mut self) -> Result<Option<Timestamp>, DriverError> {
        while self.stereo.next_frame(&mut self.frame)? {
            self.number += 1;
            if self.number <= self.offset || !(self.number - 1 - self.offset).is_multiple_of(self.every) {
                continue;
            }
            for (camera, pyramid) in self.pyramids.iter_mut().enumerate() {
                self.built[camera] = self.frame.image(camera).is_some_and(|image| pyramid.build(&image));
            }
            if self.built[0] {
                return Ok(Some(self.frame.stamp));
            }
        }
        Ok(None)
    }

    /// The features of this frame; patches are turned by `up_c`, the direction of up in the left camera.
    pub fn features(&mut self, up_c: Vector3<f64>) -> &[Feature] {
        let right = self.rig.get(1).filter(|_| self.built[1]).map(|camera| (camera, &self.pyramids[1]));
        self.extractor.extract(&View { left: (&self.rig[0], &self.pyramids[0]), right, up_c })
    }
}
