//! Images of a frame on their way from the tracker to the map: pyramids that go round, and are never copied.

use crate::image::Pyramid;
use plumbline_config::ValidSetup;

/// The pyramids of a frame.
#[derive(Clone, Debug)]
pub struct FrameImages {
    pyramids: Vec<Pyramid>,
    is_there: [bool; 2],
}

impl FrameImages {
    /// Empty ones, of the sizes that the tracker of this setup has.
    pub fn new(setup: &ValidSetup) -> Self {
        let levels = setup.estimator.points.pyramid_levels;
        let pyramids = setup.camera.iter().map(|c| Pyramid::new(c.width_px, c.height_px, levels)).collect();
        Self { pyramids, is_there: [false; 2] }
    }

    /// The image of a camera, if it is there.
    pub fn image(&self, camera: usize) -> Option<&Pyramid> {
        self.pyramids.get(camera).filter(|_| self.is_there[camera])
    }

    /// Lets `exchange` put other pyramids in the place of these, and say which cameras' those are.
    pub(crate) fn exchange(&mut self, exchange: impl FnOnce(&mut [Pyramid]) -> [bool; 2]) {
        self.is_there = exchange(&mut self.pyramids);
    }
}
