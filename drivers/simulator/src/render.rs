//! The renderer: which surface each pixel sees, and how bright it is there.
//!
//! 1. Each pixel finds its nearest facet (see [`super::cover`]).
//! 2. Pixels whose neighbourhood sees one facet are shaded once with an anisotropic texture look-up;
//!    the others share themselves between their facets by 16 rays (see [`super::shade`]).

use super::cover::Cover;
use super::lens::Lens;
use super::shade::{Shader, View};
use super::shot::Shot;
use super::world::World;

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

    /// Renders what a camera sees, in grey levels before the sensor, into `out`: all of it at one instant, or each row of tiles
    /// at its own.
    pub(super) fn render(&mut self, world: &World, lens: &Lens, shots: &[Shot], out: &mut [f32]) {
        self.cover.find(world, lens, shots);
        for row in 0..lens.rows {
            if shots.len() > 1 {
                self.cover.turn_to(world, &shots[row]);
            }
            let view = View { world, lens, cover: &self.cover };
            for column in 0..lens.columns {
                self.shader.shade_tile(&view, row * lens.columns + column, out);
            }
        }
    }

    /// The surface that the last image shows at a pixel.
    #[cfg(test)]
    pub(super) fn surface_at(&self, lens: &Lens, u: usize, v: usize) -> Option<usize> {
        let id = self.cover.row(lens, v + 1)[u + 1];
        self.cover.facets.get(id as usize).map(|f| f.surface as usize)
    }
}
