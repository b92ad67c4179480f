//! Highlights: lamps that glossy surfaces mirror.
//!
//! A plane shows a lamp where its image behind the plane would be, so that a highlight moves over the surface as the camera moves,
//! and not with its texture. What stands between surface and lamp is left out.

use super::lens::TILE;
use super::shade::View;
use super::world::Surface;
use nalgebra::{Isometry3, Point3, Vector3};

/// Radius of a highlight, rad: lamps are long, and surfaces dented.
const RADIUS_RAD: f32 = 0.1;
/// Brightness of white, grey levels.
const WHITE: f32 = 255.0;
/// Half the angle that a tile is wide at most, rad.
const TILE_RAD: f32 = 0.06;

/// Working memory.
#[derive(Clone, Debug, Default)]
pub(super) struct Highlights {
    /// Directions of mirrored lamps in the camera, with the facet that mirrors them and their brightness.
    mirrored: Vec<(u16, Vector3<f32>, f32)>,
}

impl Highlights {
    /// Adds the highlights of a row of tiles, seen from `pose_w_c`.
    pub(super) fn add_row(
        &mut self,
        view: &View<'_>,
        pose_w_c: &Isometry3<f64>,
        row: usize,
        out: &mut [f32],
    ) {
        for tile in row * view.lens.columns..(row + 1) * view.lens.columns {
            self.mirror(view, pose_w_c, tile);
            if !self.mirrored.is_empty() {
                self.add_tile(view, tile, out);
            }
        }
    }

    /// Finds the mirrored lamps that a tile may show.
    fn mirror(&mut self, view: &View<'_>, pose_w_c: &Isometry3<f64>, tile: usize) {
        self.mirrored.clear();
        let span = &view.lens.tiles[tile];
        let middle = Vector3::new(span.x[0] + span.x[1], span.y[0] + span.y[1], 2.0).normalize();
        let pose_c_w = pose_w_c.inverse();
        for id in view.cover.facets_of(tile) {
            let surface = &view.world.surfaces[view.cover.facets[id as usize].surface as usize];
            if surface.finish.gloss == 0.0 {
                continue;
            }
            for lamp in &view.world.lamps {
                let Some(image_w) = mirrored(surface, lamp) else { continue };
                let direction = (pose_c_w * Point3::from(image_w)).coords.map(|x| x as f32).normalize();
                if (direction - middle).norm() < RADIUS_RAD + TILE_RAD {
                    self.mirrored.push((id, direction, surface.finish.gloss * WHITE));
                }
            }
        }
    }

    fn add_tile(&self, view: &View<'_>, tile: usize, out: &mut [f32]) {
        let (lens, width) = (view.lens, view.lens.model.width_px);
        let (u0, v0) = (tile % lens.columns * TILE, tile / lens.columns * TILE);
        for (v, [x, y]) in (v0..lens.model.height_px).zip(lens.bearings(tile)) {
            let ids = &view.cover.row(lens, v + 1)[1..];
            for (k, u) in (u0..width.min(u0 + TILE)).enumerate() {
                let ray = Vector3::new(x[k], y[k], 1.0).normalize();
                for (_, direction, grey) in self.mirrored.iter().filter(|(id, ..)| *id == ids[u]) {
                    let off = (direction - ray).norm_squared() / (RADIUS_RAD * RADIUS_RAD);
                    if off < 1.0 {
                        out[v * width + u] += grey * (1.0 - off) * (1.0 - off);
                    }
                }
            }
        }
    }
}

/// Image of a lamp in the plane of a surface, in the world; `None` behind it.
fn mirrored(surface: &Surface, lamp: &Vector3<f64>) -> Option<Vector3<f64>> {
    let height = surface.normal.dot(&(lamp - surface.origin));
    (height > 0.0).then(|| lamp - surface.normal * (2.0 * height))
}

#[cfg(test)]
mod tests {
    use super::super::builder::Builder;
    use super::super::fixture;
    use super::super::lens::Lens;
    use super::super::pattern::Material;
    use super::super::render::Renderer;
    use super::super::shot::Shot;
    use super::super::world::{Finish, LightMap, World};
    use super::*;
    use nalgebra::{Translation3, UnitQuaternion};

    /// A black floor at the height 0, seen from 1 m above it, and a lamp 3 m above it.
    fn image(gloss: f32, right_m: f64) -> (Lens, Isometry3<f64>, Vec<f32>) {
        let mut builder = Builder::new(1, &[]);
        let finish = Finish { gloss, ..Finish::of(Material::Paint).toned(0.0, 0.0) };
        let corner = Vector3::new(-20.0, -20.0, 0.0);
        builder.quad(corner, Vector3::x() * 40.0, Vector3::y() * 40.0, finish);
        builder.surfaces[0].light = LightMap::uniform(200.0);
        let mut world = World::new(builder.surfaces);
        world.lamps.push(Vector3::new(0.0, 0.0, 3.0));
        // Looks along y and 45 degrees down.
        let down = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), -0.75 * std::f64::consts::PI);
        let pose_w_c = Isometry3::from_parts(Translation3::new(right_m, -4.0, 1.0), down);
        let lens = Lens::new(fixture::config().camera[0].model(), Isometry3::identity());
        let mut out = vec![0.0; 752 * 480];
        Renderer::new(1, (752, 480)).render(&world, &lens, &[Shot::at(pose_w_c)], &mut out);
        (lens, pose_w_c, out)
    }

    #[test]
    fn a_highlight_lies_where_the_floor_mirrors_the_lamp() {
        for right_m in [0.0, 1.0] {
            let (lens, pose_w_c, out) = image(0.5, right_m);
            let image_c = pose_w_c.inverse() * Point3::new(0.0, 0.0, -3.0);
            let expected = lens.model.project(&image_c.coords).unwrap();
            let brightest = (0..out.len()).max_by(|a, b| out[*a].total_cmp(&out[*b])).unwrap();
            let (u, v) = ((brightest % 752) as f64, (brightest / 752) as f64);
            assert!(
                (u - expected.x).abs() < 2.0 && (v - expected.y).abs() < 2.0,
                "{u} {v}, not at {expected}"
            );
            assert!((out[brightest] - 0.5 * WHITE).abs() < 1.0, "{}", out[brightest]);
        }
    }

    #[test]
    fn a_matt_floor_mirrors_nothing() {
        assert!(image(0.0, 0.0).2.iter().all(|grey| *grey == 0.0));
    }
}
