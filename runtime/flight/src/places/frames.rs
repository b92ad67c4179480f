//! The stereo pairs of a recording, one by one, with their features: what maps are built from and located by.

use super::file::MapFileError;
use nalgebra::Vector3;
use plumbline_config::import::euroc_cameras_into;
use plumbline_config::options::image_sizes;
use plumbline_config::{Config, ConfigError, Timestamp, ValidConfig};
use plumbline_drivers::{DriverError, EurocDataset, EurocOptions, StereoFrame, StereoSource};
use plumbline_estimator::image::Pyramid;
use plumbline_estimator::places::Feature;
use plumbline_estimator::places::extractor::{Extractor, ExtractorOptions, View};
use plumbline_estimator::points::rig::RigCamera;
use std::path::Path;

/// Pyramid levels of an image: patches of 48 px radius need the third.
const LEVELS: usize = 3;

/// Reason why no map can be made or searched.
#[derive(Debug, thiserror::Error)]
pub enum PlacesError {
    /// The data set cannot be read.
    #[error(transparent)]
    Driver(#[from] DriverError),
    /// The calibration cannot be used.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The map cannot be read or written.
    #[error(transparent)]
    Map(#[from] MapFileError),
    /// The request yields nothing.
    #[error("{0}")]
    Nothing(String),
}

/// Choice of a data set's frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Choice {
    /// Every so many; at least 1.
    pub every: usize,
    /// The first one, from 0.
    pub offset: usize,
}

impl Choice {
    /// All frames.
    pub const ALL: Self = Self { every: 1, offset: 0 };

    /// True if frame `number` is chosen.
    #[must_use]
    pub fn holds(&self, number: usize) -> bool {
        number.checked_sub(self.offset).is_some_and(|n| n.is_multiple_of(self.every.max(1)))
    }
}

/// The frames of a recording.
pub struct RecordedFrames {
    stereo: Box<dyn StereoSource>,
    frame: StereoFrame,
    pyramids: [Pyramid; 2],
    built: [bool; 2],
    rig: Vec<RigCamera>,
    extractor: Extractor,
    choice: Choice,
    number: usize,
}

impl RecordedFrames {
    /// Opens a EuRoC data set, of which the IMU may be missing. Without a configuration the calibration is that of
    /// the data set.
    ///
    /// # Errors
    /// When the data set or its calibration cannot be used.
    pub fn open(
        path: &Path,
        config: Option<ValidConfig>,
        choice: Choice,
        options: &ExtractorOptions,
    ) -> Result<Self, PlacesError> {
        let config = match config {
            Some(config) => config,
            None => euroc_cameras_into(Config::preset("euroc")?, path)?,
        };
        let dataset =
            EurocDataset::open(path, &EurocOptions { with_imu: false, ..EurocOptions::for_config(&config) })?;
        Ok(Self::of(Box::new(dataset.stereo()), &config, dataset.cameras(), choice, options))
    }

    /// The frames of a source with so many of the cameras of `config`.
    #[must_use]
    pub fn of(
        stereo: Box<dyn StereoSource>,
        config: &Config,
        cameras: usize,
        choice: Choice,
        options: &ExtractorOptions,
    ) -> Self {
        let cameras = &config.camera[..cameras.min(config.camera.len())];
        let sizes = image_sizes(cameras);
        let rig: Vec<_> = cameras
            .iter()
            .map(|c| {
                let mut camera = RigCamera::new(c.model());
                camera.pose_b_c = c.pose_b_c();
                camera
            })
            .collect();
        Self {
            stereo,
            frame: StereoFrame::new(sizes),
            pyramids: sizes.map(|(width, height)| Pyramid::new(width, height, LEVELS)),
            built: [false; 2],
            rig,
            extractor: Extractor::new(sizes[0].0, sizes[0].1, options),
            choice,
            number: 0,
        }
    }

    /// Frames that will be handed out.
    #[must_use]
    pub fn expected(&self) -> usize {
        let all = self.stereo.expected_frames().unwrap_or(0) as usize;
        (0..all).filter(|n| self.choice.holds(*n)).count()
    }

    /// The left camera.
    #[must_use]
    pub fn left(&self) -> &RigCamera {
        &self.rig[0]
    }

    /// True if there are two cameras.
    #[must_use]
    pub fn is_stereo(&self) -> bool {
        self.rig.len() == 2
    }

    /// Goes to the next frame that has a left image; its stamp, or `None` at the end.
    ///
    /// # Errors
    /// When the data set cannot be read on.
    pub fn advance(&mut self) -> Result<Option<Timestamp>, PlacesError> {
        while self.stereo.next_frame(&mut self.frame)? {
            self.number += 1;
            if !self.choice.holds(self.number - 1) {
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
    pub fn features(&mut self, up_c: Option<Vector3<f64>>) -> &[Feature] {
        let right = self.rig.get(1).filter(|_| self.built[1]).map(|camera| (camera, &self.pyramids[1]));
        self.extractor.extract(&View { left: (&self.rig[0], &self.pyramids[0]), right, up_c })
    }
}
