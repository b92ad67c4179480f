//! One feature to one, between a frame and a few keyframes of the map.
//!
//! A pair counts when each is the other's nearest by descriptor, and no feature *of another place* is nearly as near
//! (Lowe's ratio test). The same corner may stand in several of the keyframes: those are one place, and no rivals.

use super::feature::Feature;
use super::map::PlaceMap;
use nalgebra::{Matrix3, Vector3};

/// Descriptors that differ in more bits are not the same corner.
const MAX_DISTANCE: u32 = 84;
/// The nearest must differ in fewer than this share of the bits of the nearest of another place.
const MAX_RATIO: f32 = 0.88;
/// Points within this share of their distance from the camera are one place.
const SAME_PLACE: f64 = 0.05;
/// No feature.
const NONE: u32 = u32::MAX;

/// A point of the map as a query sees it.
#[derive(Clone, Copy, Debug)]
pub struct MapPoint {
    /// Slot of its keyframe.
    pub slot: u32,
    /// Number within the keyframe.
    pub feature: u32,
    /// Position in the map, m.
    pub position_m: Vector3<f64>,
    /// Its covariance, m².
    pub covariance_m: Matrix3<f64>,
    /// Where it moves when its inverse depth is out by a standard deviation, m.
    pub by_depth_m: Vector3<f64>,
    /// Distance from the keyframe's camera, m.
    pub range_m: f64,
}

/// A feature of the query and a point of the map.
#[derive(Clone, Copy, Debug)]
pub struct Match {
    /// Number of the query's feature.
    pub query: u32,
    /// Number of the point among those gathered.
    pub point: u32,
    /// Bits in which they differ.
    pub distance: u32,
    /// That over the distance to the nearest of another place.
    pub ratio: f32,
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
    points: Vec<MapPoint>,
    nearest: Vec<Nearest>,
    nearest_query: Vec<(u32, u32)>,
    matches: Vec<Match>,
}

impl Matcher {
    /// For queries of `query_features` against up to `points` of the map.
    #[must_use]
    pub fn new(query_features: usize, points: usize) -> Self {
        Self {
            points: Vec::with_capacity(points),
            nearest: Vec::with_capacity(query_features),
            nearest_query: Vec::with_capacity(points),
            matches: Vec::with_capacity(query_features),
        }
    }

    /// The points gathered.
    #[must_use]
    pub fn points(&self) -> &[MapPoint] {
        &self.points
    }

    /// The matches, those first that differ least from their point against its rivals (ties: by number).
    #[must_use]
    pub fn matches(&self) -> &[Match] {
        &self.matches
    }

    /// Gathers the points of some keyframes, as many as there is room for.
    pub fn gather(&mut self, map: &PlaceMap, slots: &[usize]) {
        self.points.clear();
        for &slot in slots {
            let Some(keyframe) = map.keyframe(slot) else { continue };
            let pose_m_c = keyframe.pose_m_c();
            let rot = pose_m_c.rotation.to_rotation_matrix();
            for (i, feature) in map.features(slot).iter().enumerate().filter(|(_, f)| f.is_point()) {
                if self.points.len() == self.points.capacity() {
                    return;
                }
                let position_c = feature.position_c();
                self.points.push(MapPoint {
                    slot: slot as u32,
                    feature: i as u32,
                    position_m: (pose_m_c * nalgebra::Point3::from(position_c)).coords,
                    covariance_m: rot.matrix() * feature.covariance_c() * rot.matrix().transpose(),
                    by_depth_m: rot
                        * position_c
                        * f64::from(feature.sigma_inverse_depth / feature.inverse_depth),
                    range_m: position_c.norm(),
                });
            }
        }
    }

    /// Matches the features of a query with the points gathered.
    pub fn match_features(&mut self, map: &PlaceMap, query: &[Feature]) {
        self.find_nearest(map, query);
        self.matches.clear();
        for (i, nearest) in self.nearest.iter().enumerate() {
            let ratio = nearest.distance as f32 / nearest.second.max(1) as f32;
            let mutual = nearest.point != NONE && self.nearest_query[nearest.point as usize].0 == i as u32;
            if mutual && nearest.distance <= MAX_DISTANCE && ratio <= MAX_RATIO {
                let (query, point) = (i as u32, nearest.point);
                self.matches.push(Match { query, point, distance: nearest.distance, ratio });
            }
        }
        self.matches.sort_unstable_by(|a, b| a.ratio.total_cmp(&b.ratio).then(a.query.cmp(&b.query)));
    }

    fn find_nearest(&mut self, map: &PlaceMap, query: &[Feature]) {
        self.nearest.clear();
        self.nearest_query.clear();
        self.nearest_query.resize(self.points.len(), (NONE, u32::MAX));
        for (i, feature) in query.iter().enumerate().take(self.nearest.capacity()) {
            let mut nearest = Nearest { point: NONE, distance: u32::MAX, second: u32::MAX };
            for (p, point) in self.points.iter().enumerate() {
                let stored = &map.features(point.slot as usize)[point.feature as usize];
                let distance = feature.descriptor.distance(&stored.descriptor);
                let of_point = &mut self.nearest_query[p];
                if distance < of_point.1 {
                    *of_point = (i as u32, distance);
                }
                if distance < nearest.second {
                    let same =
                        nearest.point != NONE && is_same_place(point, &self.points[nearest.point as usize]);
                    if distance < nearest.distance {
                        if !same {
                            nearest.second = nearest.distance;
                        }
                        (nearest.point, nearest.distance) = (p as u32, distance);
                    } else if !same {
                        nearest.second = distance;
                    }
                }
            }
            self.nearest.push(nearest);
        }
    }
}

fn is_same_place(a: &MapPoint, b: &MapPoint) -> bool {
    (a.position_m - b.position_m).norm() <= SAME_PLACE * a.range_m.max(b.range_m)
}
