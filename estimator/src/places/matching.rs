//! One feature to one, between a frame and a few keyframes of the map.
//!
//! A pair counts when each is the other's nearest by descriptor, and no feature *of another place* is nearly as near
//! (Lowe's ratio test). The same corner may stand in several of the keyframes: those are one place, and no rivals.

use super::descriptor::{BITS, Descriptor};
use super::feature::Feature;
use super::index::NONE;
use super::map::PlaceMap;
use nalgebra::{Matrix3, Vector3};

/// Descriptors that differ in more bits are not the same corner.
const MAX_DISTANCE: u32 = 84;
/// The nearest must differ in fewer than this share of the bits of the nearest of another place.
const MAX_RATIO: f32 = 0.88;
/// Points within this share of their distance from the camera are one place, ...
const SAME_PLACE: f64 = 0.05;
/// ... and those that the errors of their depths may have set apart, standard deviations.
const DEPTH_DEVIATIONS: f64 = 2.5;

/// A point of the map as a query sees it.
#[derive(Clone, Copy, Debug)]
pub struct MapPoint {
    /// Standard deviation of its place in the keyframe's image, normalized coordinates.
    pub sigma_xy: f32,
    /// Position in the map, m.
    pub position_m: Vector3<f64>,
    /// Covariance, m².
    pub covariance_m: Matrix3<f64>,
    /// Displacement for one standard deviation of the inverse depth, m.
    pub by_depth_m: Vector3<f64>,
    /// Distance from the keyframe's camera, m.
    pub range_m: f64,
    /// Unit vector in which that camera saw it, in the map.
    pub ray_m: Vector3<f64>,
}

/// A feature of the query and a point of the map.
#[derive(Clone, Copy, Debug)]
pub struct Match {
    /// Number of the query's feature.
    pub query: u32,
    /// Number of the point among those gathered.
    pub point: u32,
    /// Ratio of the distance to that of the nearest point of another place.
    pub ratio: f32,
}

/// Points that are compared with a feature at a time: a register of AVX2, two of NEON.
const LANES: usize = 32;
/// Bytes of a descriptor.
const BYTES: usize = BITS / 8;

/// Some points, byte by byte of their descriptors, so that the compiler compares all of them with a feature at once.
#[derive(Clone, Copy, Debug)]
struct Block {
    bytes: [[u8; LANES]; BYTES],
    /// Bits in which each differs from the feature of the query that is nearest to it so far, and that feature.
    nearest_distance: [u8; LANES],
    nearest_query: [u32; LANES],
}

impl Block {
    /// The points of some descriptors; where there are fewer than it has room for, the rest is never near.
    fn of(descriptors: &[Descriptor]) -> Self {
        let mut block =
            Self { bytes: [[0; LANES]; BYTES], nearest_distance: [0; LANES], nearest_query: [NONE; LANES] };
        for (lane, descriptor) in descriptors.iter().enumerate() {
            block.nearest_distance[lane] = u8::MAX;
            for (byte, value) in descriptor.bytes().into_iter().enumerate() {
                block.bytes[byte][lane] = value;
            }
        }
        block
    }

    /// Bits in which each point differs; all 256 of them count as 255.
    // Plain loops become the same instructions with debug assertions as without; iterators do not.
    #[allow(clippy::needless_range_loop)]
    #[inline]
    fn distances(&self, descriptor: &[u8; BYTES]) -> [u8; LANES] {
        let mut distances = [0_u8; LANES];
        for byte in 0..BYTES {
            for lane in 0..LANES {
                let differing = (self.bytes[byte][lane] ^ descriptor[byte]).count_ones() as u8;
                distances[lane] = distances[lane].saturating_add(differing);
            }
        }
        distances
    }

    /// True if a point is nearer than one of two limits: one for all, and its own.
    #[allow(clippy::needless_range_loop)]
    #[inline]
    fn is_any_nearer(&self, distances: &[u8; LANES], limit: u8) -> bool {
        let mut any = false;
        for lane in 0..LANES {
            any |= (distances[lane] < limit) | (distances[lane] < self.nearest_distance[lane]);
        }
        any
    }
}

#[derive(Clone, Copy, Debug)]
struct Nearest {
    point: u32,
    distance: u32,
    second: u32,
}

/// Gathers points and matches them. Allocated once.
#[derive(Clone, Debug)]
pub struct Matcher {
    /// The points gathered.
    pub(super) points: Vec<MapPoint>,
    /// Their descriptors.
    pub(super) descriptors: Vec<Descriptor>,
    blocks: Vec<Block>,
    nearest: Vec<Nearest>,
    /// The matches, those first that differ least from their point against its rivals (ties: by number).
    pub(super) matches: Vec<Match>,
}

impl Matcher {
    /// For queries of `query_features` against up to `points` of the map.
    pub fn new(query_features: usize, points: usize) -> Self {
        Self {
            points: Vec::with_capacity(points),
            descriptors: Vec::with_capacity(points),
            blocks: Vec::with_capacity(points.div_ceil(LANES)),
            nearest: Vec::with_capacity(query_features),
            matches: Vec::with_capacity(query_features),
        }
    }

    /// Gathers the points of some keyframes, as many as there is room for.
    pub fn gather(&mut self, map: &PlaceMap, slots: &[usize]) {
        self.points.clear();
        self.descriptors.clear();
        for &slot in slots {
            let Some(keyframe) = map.keyframe(slot) else { continue };
            let pose_m_c = keyframe.pose_m_c();
            let rot = pose_m_c.rotation.to_rotation_matrix();
            for feature in map.features(slot).iter().filter(|f| f.is_point()) {
                if self.points.len() == self.points.capacity() {
                    return;
                }
                let position_c = feature.position_c();
                self.descriptors.push(feature.descriptor);
                self.points.push(MapPoint {
                    sigma_xy: feature.sigma_xy,
                    position_m: (pose_m_c * nalgebra::Point3::from(position_c)).coords,
                    covariance_m: rot.matrix() * feature.covariance_c() * rot.matrix().transpose(),
                    by_depth_m: rot
                        * position_c
                        * f64::from(feature.sigma_inverse_depth / feature.inverse_depth),
                    range_m: position_c.norm(),
                    ray_m: rot * position_c.normalize(),
                });
            }
        }
    }

    /// Matches the features of a query with the points gathered.
    pub fn match_features(&mut self, query: &[Feature]) {
        self.find_nearest(query);
        self.matches.clear();
        for (i, nearest) in self.nearest.iter().enumerate() {
            let ratio = nearest.distance as f32 / nearest.second.max(1) as f32;
            let mutual = nearest.point != NONE && self.nearest_query(nearest.point) == i as u32;
            if mutual && nearest.distance <= MAX_DISTANCE && ratio <= MAX_RATIO {
                self.matches.push(Match { query: i as u32, point: nearest.point, ratio });
            }
        }
        self.matches.sort_unstable_by(|a, b| a.ratio.total_cmp(&b.ratio).then(a.query.cmp(&b.query)));
    }

    /// The feature of the query that is nearest to a point.
    fn nearest_query(&self, point: u32) -> u32 {
        self.blocks[point as usize / LANES].nearest_query[point as usize % LANES]
    }

    fn find_nearest(&mut self, query: &[Feature]) {
        self.blocks.clear();
        self.blocks.extend(self.descriptors.chunks(LANES).map(Block::of));
        self.nearest.clear();
        for (i, feature) in query.iter().enumerate().take(self.nearest.capacity()) {
            let mut nearest = Nearest { point: NONE, distance: u32::MAX, second: u32::MAX };
            let bytes = feature.descriptor.bytes();
            for (b, block) in self.blocks.iter_mut().enumerate() {
                let distances = block.distances(&bytes);
                if !block.is_any_nearer(&distances, u8::try_from(nearest.second).unwrap_or(u8::MAX)) {
                    continue;
                }
                let count = LANES.min(self.points.len() - b * LANES);
                for (lane, &distance) in distances.iter().enumerate().take(count) {
                    if distance < block.nearest_distance[lane] {
                        (block.nearest_distance[lane], block.nearest_query[lane]) = (distance, i as u32);
                    }
                    nearest.consider((b * LANES + lane) as u32, u32::from(distance), &self.points);
                }
            }
            self.nearest.push(nearest);
        }
    }
}

impl Nearest {
    /// Takes note of a point; one at the place of the nearest is no rival of it.
    #[inline]
    fn consider(&mut self, point: u32, distance: u32, points: &[MapPoint]) {
        if distance >= self.second {
            return;
        }
        let same = self.point != NONE && is_same_place(&points[point as usize], &points[self.point as usize]);
        if distance < self.distance {
            if !same {
                self.second = self.distance;
            }
            (self.point, self.distance) = (point, distance);
        } else if !same {
            self.second = distance;
        }
    }
}

fn is_same_place(a: &MapPoint, b: &MapPoint) -> bool {
    let by_depth = (a.by_depth_m.norm_squared() + b.by_depth_m.norm_squared()).sqrt();
    let range = if a.range_m > b.range_m { a.range_m } else { b.range_m };
    (a.position_m - b.position_m).norm() <= SAME_PLACE * range + DEPTH_DEVIATIONS * by_depth
}
