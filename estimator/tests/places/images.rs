//! Features of real stereo pairs.

use super::building::FEATURES;
use nalgebra::Vector3;
use plumbline_config::{Config, import};
use plumbline_drivers::{EurocDataset, EurocOptions, StereoFrame};
use plumbline_estimator::image::Pyramid;
use plumbline_estimator::places::Feature;
use plumbline_estimator::places::extractor::{Extractor, View};
use plumbline_estimator::points::rig::RigCamera;
use std::path::Path;

/// Pyramid levels of an image, as `plumbline map` has them.
const LEVELS: usize = 3;

/// Makes features of images.
pub struct Eyes {
    rig: Vec<RigCamera>,
    pyramids: [Pyramid; 2],
    extractor: Extractor,
}

impl Eyes {
    fn new(config: &Config, sizes_px: [(usize, usize); 2]) -> Self {
        let rig = config.camera.iter().map(|c| {
            let mut camera = RigCamera::new(c.model());
            camera.pose_b_c = c.pose_b_c();
            camera
        });
        let (width, height) = sizes_px[0];
        Self {
            rig: rig.collect(),
            pyramids: sizes_px.map(|(width, height)| Pyramid::new(width, height, LEVELS)),
            extractor: Extractor::new(width, height, FEATURES),
        }
    }

    /// Takes the images of a frame.
    pub fn look(&mut self, frame: &StereoFrame) {
        for (camera, pyramid) in self.pyramids.iter_mut().enumerate().take(self.rig.len()) {
            assert!(pyramid.build(&frame.image(camera).unwrap()));
        }
    }

    /// The features of the frame looked at last.
    pub fn features(&mut self, up_c: Vector3<f64>) -> &[Feature] {
        let right = self.rig.get(1).map(|camera| (camera, &self.pyramids[1]));
        self.extractor.extract(&View { left: (&self.rig[0], &self.pyramids[0]), right, up_c })
    }

    /// Up in the left camera, as the rig of EuRoC is usually held: its x axis points up.
    pub fn usual_up_c(&self) -> Vector3<f64> {
        self.rig[0].pose_b_c.rotation.inverse() * Vector3::x()
    }
}

/// A EuRoC folder without an IMU: its frames, and eyes for them.
pub fn open(folder: &Path) -> (EurocDataset, Eyes) {
    let config: Config = import::euroc_cameras_into(Config::preset("euroc").unwrap(), folder).unwrap().into();
    let euroc = EurocOptions { with_imu: false, ..EurocOptions::for_config(&config) };
    let dataset = EurocDataset::open(folder, &euroc).unwrap();
    let eyes = Eyes::new(&config, dataset.sizes_px());
    (dataset, eyes)
}
