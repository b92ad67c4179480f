//! Two rooms that look alike, side by side without a wall between them: the first lap goes through the one, the second
//! through the other.

use super::light_map::LightMap;
use super::scenes::{self, Scene, Twin};
use super::solid::Bounds;
use super::trajectory::Trajectory;
use super::world::{Surface, World};
use nalgebra::Vector3;

/// Interval of the positions that the first room is built around, s.
const STEP_S: f64 = 0.05;
/// Distance from a wall of what hangs on it, m, at most.
const WALL_DEPTH_M: f64 = 0.06;
/// The floors of the rooms overlap by this, so that there is no gap, m.
const OVERLAP_M: f64 = 0.01;

/// Positions on a part of a flight: from when, and how long, s.
pub(super) fn positions(flight: &Trajectory, (from_s, lap_s): (f64, f64)) -> Vec<Vector3<f64>> {
    let count = (lap_s / STEP_S) as usize;
    let at = |k: usize| flight.motion_at(from_s + k as f64 * STEP_S).pose_w_b.translation.vector;
    (0..=count).map(at).collect()
}

/// Both rooms.
#[derive(Clone, Debug)]
pub(super) struct Twins {
    kind: Twin,
    /// Around the first lap.
    lap: Bounds,
    /// The first room.
    room: Bounds,
}

impl Twins {
    /// Around a lap through `path` (m, in the world).
    pub(super) fn new(kind: Twin, path: &[Vector3<f64>]) -> Self {
        let lap = Bounds::around(path);
        Self { kind, lap, room: scenes::room_around(&lap) }
    }

    /// From a place in the first room to the like one in a second that repeats it.
    pub(super) fn shift(&self) -> Vector3<f64> {
        Vector3::x() * (self.room.high.x - self.room.low.x - OVERLAP_M)
    }

    /// Both rooms, with furniture that keeps clear of `path` in either.
    pub(super) fn build(&self, seed: u64, path: &[Vector3<f64>]) -> World {
        let folded = path.iter().map(|p| match self.kind {
            Twin::Repeated => p - self.shift(),
            Twin::Mirrored => self.mirrored(p),
        });
        let clear: Vec<_> = path.iter().copied().chain(folded).collect();
        let first = scenes::build_around(Scene::Room, seed, &self.lap, &clear).surfaces;
        let open: Vec<Surface> =
            first.iter().filter(|s| !lies_on_wall(s, self.room.high.x)).cloned().collect();
        let second: Vec<Surface> = match self.kind {
            Twin::Repeated => {
                let kept = first.into_iter().filter(|s| !lies_on_wall(s, self.room.low.x));
                kept.map(|s| Surface { origin: s.origin + self.shift(), ..s }).collect()
            }
            Twin::Mirrored => open.iter().map(|s| self.mirrored_surface(s)).collect(),
        };
        World::new(open.into_iter().chain(second).collect())
    }

    /// A place in the mirror.
    fn mirrored(&self, p: &Vector3<f64>) -> Vector3<f64> {
        Vector3::new(2.0 * self.room.high.x - OVERLAP_M - p.x, p.y, p.z)
    }

    /// A surface in the mirror: its first edge runs the other way, and its pattern with it.
    fn mirrored_surface(&self, s: &Surface) -> Surface {
        let flipped = |v: &Vector3<f64>| Vector3::new(-v.x, v.y, v.z);
        let rows = s.light.values.chunks(s.light.columns);
        let values = rows.flat_map(|row| row.iter().rev().copied()).collect();
        Surface {
            origin: self.mirrored(&(s.origin + s.edge_u)),
            edge_u: -flipped(&s.edge_u),
            edge_v: flipped(&s.edge_v),
            normal: flipped(&s.normal),
            finish: s.finish,
            texel_origin: [s.texel_origin[0] + s.texels[0], s.texel_origin[1]],
            texels: [-s.texels[0], s.texels[1]],
            light: LightMap { values, ..s.light },
        }
    }
}

/// True if a surface is a wall at `x`, or hangs on it.
fn lies_on_wall(surface: &Surface, x: f64) -> bool {
    let corners = [(0.0, 0.0), (0.0, 1.0), (1.0, 0.0), (1.0, 1.0)];
    corners.iter().all(|(s, t)| {
        let corner = surface.origin + surface.edge_u * *s + surface.edge_v * *t;
        (corner.x - x).abs() <= WALL_DEPTH_M
    })
}

#[cfg(test)]
mod tests {
    use super::super::{Scenario, Simulator, fixture};
    use super::*;
    use nalgebra::Isometry3;

    fn simulator(kind: Twin) -> Simulator {
        let scenario = Scenario {
            scene: Scene::Rooms(kind),
            laps: 2,
            start_s: 4.0,
            duration_s: 3.0,
            resolution_scale: 0.2,
            ..Scenario::default()
        };
        Simulator::new(&fixture::config(), &scenario).unwrap()
    }

    fn twins(simulator: &Simulator) -> Twins {
        simulator.scenario().flight(simulator.config()).unwrap().1.unwrap()
    }

    /// True if a ray in the second room sees the counterpart, in place and kind, of what its counterpart in
    /// the first room sees.
    fn looks_alike(simulator: &Simulator, twins: &Twins, from: &Vector3<f64>, ray: &Vector3<f64>) -> bool {
        let (there, turned) = match twins.kind {
            Twin::Repeated => (from + twins.shift(), *ray),
            Twin::Mirrored => (twins.mirrored(from), Vector3::new(-ray.x, ray.y, ray.z)),
        };
        let world = &simulator.inner.world;
        let (a, b) = (world.first_hit(from, ray).unwrap(), world.first_hit(&there, &turned).unwrap());
        let texel = |hit: &super::super::Hit, from: &Vector3<f64>, ray: &Vector3<f64>| {
            let s = &world.surfaces[hit.surface];
            let (_, u, v) = s.hit(from, ray).unwrap();
            [u, v]
                .iter()
                .enumerate()
                .map(|(k, c)| f64::from(s.texel_origin[k]) + c * f64::from(s.texels[k]))
                .sum::<f64>()
        };
        (a.distance - b.distance).abs() < 1e-9
            && (texel(&a, from, ray) - texel(&b, &there, &turned)).abs() < 1e-2
    }

    #[test]
    fn what_is_seen_in_the_one_room_is_seen_in_the_other() {
        for kind in [Twin::Repeated, Twin::Mirrored] {
            let simulator = simulator(kind);
            let twins = twins(&simulator);
            let from = 0.5 * (twins.lap.low + twins.lap.high);
            // Across, where neither side is open.
            let rays = (0..60).map(|k| {
                let aside = 0.04 * f64::from(k / 2) - 0.6;
                let across = if k % 2 == 0 { 1.0 } else { -1.0 };
                Vector3::new(aside, across, -0.3 + 0.01 * f64::from(k))
            });
            let alike = rays.filter(|ray| looks_alike(&simulator, &twins, &from, ray)).count();
            assert!(alike >= 55, "{kind:?}: {alike} of 60 rays");
        }
    }

    #[test]
    fn the_second_lap_goes_through_the_second_room_and_nothing_is_in_the_way() {
        for kind in [Twin::Repeated, Twin::Mirrored] {
            let simulator = simulator(kind);
            let twins = twins(&simulator);
            let flight = simulator.trajectory();
            let end_s = flight.end().seconds_since(flight.begin());
            let at = |t: f64| -> Isometry3<f64> { flight.motion_at(t).pose_w_b };
            assert!(
                (at(end_s - 3.0).translation.vector - at(0.1).translation.vector - twins.shift()).norm()
                    < 0.02
            );
            for k in 0..(end_s * 20.0) as usize {
                let (here, next) = (at(k as f64 * 0.05), at((k + 1) as f64 * 0.05));
                let way = next.translation.vector - here.translation.vector;
                let hit = simulator.inner.world.first_hit(&here.translation.vector, &way);
                assert!(hit.is_none_or(|hit| hit.distance > 1.0), "{kind:?}: something stands in the way");
            }
        }
    }
}
