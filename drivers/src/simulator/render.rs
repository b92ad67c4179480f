//! The renderer: which surface each pixel sees, and how bright it is there.
//!
//! 1. Each pixel finds its nearest facet (see [`super::cover`]).
//! 2. Pixels whose neighbourhood sees one facet are shaded once with an anisotropic texture look-up;
//!    the others share themselves between their facets by 16 rays (see [`super::shade`]).

use super::cover::Cover;
use super::lens::Lens;
use super::shade::{Shader, View};
use super::world::World;
use nalgebra::Isometry3;

/// Working memory of one rendering thread.
#[derive(Clone, Debug)]
pub(super) struct Renderer {
    cover: Cover,
    shader: Shader,
}

impl Renderer {
    /// Memory for images up to `size_px` of a world with `surfaces`.
    pub(super) fn new(surfaces: usize, size_px: (usize, usize)) -> Self {
        Self { cover: Cover::new(surfaces, size_px), shader: Shader::new(surfaces) }
    }

    /// Renders what the camera at `pose_w_c` sees, in grey levels before the sensor, into `out`.
    pub(super) fn render(&mut self, world: &World, lens: &Lens, pose_w_c: &Isometry3<f64>, out: &mut [f32]) {
        self.cover.find(world, lens, pose_w_c);
        let view = View { world, lens, cover: &self.cover };
        for tile in 0..lens.tiles.len() {
            self.shader.shade_tile(&view, tile, out);
        }
    }

    /// The surface that the last image shows at a pixel.
    #[cfg(test)]
    pub(super) fn surface_at(&self, lens: &Lens, u: usize, v: usize) -> Option<usize> {
        let id = self.cover.row(lens, v + 1)[u + 1];
        self.cover.facets.get(id as usize).map(|f| f.surface as usize)
    }
}
