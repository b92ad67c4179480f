//! The map: keyframes with their features, bounded.
//!
//! Features live in one array with a fixed number of places a keyframe; a keyframe is known by its slot while it
//! lives and by its number for ever. When the map is full the keyframe goes whose view another one covers best, so
//! that what is left still covers what was seen.
//!
//! Landmarks hang on their keyframe (direction and inverse depth in its left camera), so a corrected pose moves them
//! along.

mod links;

use super::feature::Feature;
use super::index::{Candidate, Index, Votes};
use super::line::MapLine;
use links::UNCOVERED;
use nalgebra::{Isometry3, Vector3};
use plumbline_config::Timestamp;

/// Neighbours that a keyframe remembers.
pub const MAX_NEIGHBOURS: usize = 6;
/// Lines of a keyframe that are kept, at most.
pub const MAX_LINES: usize = 48;
/// A turn of this angle changes a view as much as a metre does: 30 degrees, as its cosine would be too slow, rad/m.
const TURN_PER_METRE: f64 = 0.52;
/// Keyframes further than this from each other, by [`view_distance_within`], share nothing that could be matched, m.
pub(super) const MAX_NEIGHBOUR_DISTANCE: f64 = 2.0;

/// Limits of a map.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MapLimits {
    /// Keyframes at most.
    pub keyframes: usize,
    /// Features of a keyframe at most.
    pub features: usize,
}

/// A keyframe, without its features.
#[derive(Clone, Debug, PartialEq)]
pub struct Keyframe {
    /// Number, unique in the map, ascending.
    pub id: u32,
    /// Flight it comes from.
    pub session: u32,
    /// Time of the keyframe.
    pub stamp: Timestamp,
    /// Pose of the body in the map.
    pub pose_m_b: Isometry3<f64>,
    /// Pose of the left camera in the body.
    pub pose_b_c: Isometry3<f64>,
    /// Slots of the keyframes that share most with it, most first.
    pub neighbours: heapless::Vec<u16, MAX_NEIGHBOURS>,
    /// Largest normalized coordinates of its features.
    field: [f32; 2],
}

impl Keyframe {
    /// A keyframe as it is handed to [`PlaceMap::add`].
    #[must_use]
    pub fn new(session: u32, stamp: Timestamp, pose_m_b: Isometry3<f64>, pose_b_c: Isometry3<f64>) -> Self {
        let neighbours = heapless::Vec::new();
        Self { id: 0, session, stamp, pose_m_b, pose_b_c, neighbours, field: [0.0; 2] }
    }

    /// Pose of the left camera in the map.
    pub fn pose_m_c(&self) -> Isometry3<f64> {
        self.pose_m_b * self.pose_b_c
    }

    /// Direction of up in the left camera.
    pub fn up_c(&self) -> Vector3<f64> {
        self.pose_m_c().rotation.inverse() * Vector3::z()
    }
}

/// Distance between the views of two left cameras, if it is less than `limit`: translation and rotation, as a length in
/// metres.
pub(super) fn view_distance_within(a: &Isometry3<f64>, b: &Isometry3<f64>, limit: f64) -> Option<f64> {
    let moved = (a.translation.vector - b.translation.vector).norm();
    // The turn only adds to it, and is the slower to find.
    if moved >= limit {
        return None;
    }
    let distance = moved + a.rotation.angle_to(&b.rotation) / TURN_PER_METRE;
    (distance < limit).then_some(distance)
}

/// Keyframes, their features, and the index over them.
#[derive(Clone, Debug)]
pub struct PlaceMap {
    limits: MapLimits,
    keyframes: Vec<Option<Keyframe>>,
    /// Poses of their left cameras in the map.
    poses_m_c: Vec<Isometry3<f64>>,
    counts: Vec<u16>,
    features: Vec<Feature>,
    line_counts: Vec<u8>,
    lines: Vec<MapLine>,
    index: Index,
    /// Distance to the most similar other keyframe, and its slot, for the rule of forgetting.
    covered: Vec<(f64, usize)>,
    /// Poses of the left cameras in the map at which cover and neighbours were computed.
    linked_at: Vec<Isometry3<f64>>,
    /// Next keyframe to be checked for having moved.
    next_tended: usize,
    next_id: u32,
    len: usize,
}

impl PlaceMap {
    /// An empty map; its whole memory is allocated here.
    #[must_use]
    pub fn new(limits: MapLimits) -> Self {
        let keyframes = limits.keyframes.min(usize::from(u16::MAX));
        let features = limits.features.min(usize::from(u16::MAX));
        let empty = Feature {
            descriptor: super::descriptor::Descriptor::default(),
            xy: nalgebra::Vector2::zeros(),
            sigma_xy: 0.0,
            inverse_depth: 0.0,
            sigma_inverse_depth: f32::INFINITY,
        };
        Self {
            limits: MapLimits { keyframes, features },
            keyframes: vec![None; keyframes],
            poses_m_c: vec![Isometry3::identity(); keyframes],
            counts: vec![0; keyframes],
            features: vec![empty; keyframes * features],
            line_counts: vec![0; keyframes],
            lines: vec![MapLine::default(); keyframes * MAX_LINES],
            index: Index::new(keyframes, features),
            covered: vec![UNCOVERED; keyframes],
            linked_at: vec![Isometry3::identity(); keyframes],
            next_tended: 0,
            next_id: 0,
            len: 0,
        }
    }

    /// Limits of the map.
    pub fn limits(&self) -> MapLimits {
        self.limits
    }

    /// Keyframes in it.
    pub fn len(&self) -> usize {
        self.len
    }

    /// True if the map is empty.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// The keyframe in a slot.
    pub fn keyframe(&self, slot: usize) -> Option<&Keyframe> {
        self.keyframes.get(slot).and_then(Option::as_ref)
    }

    /// Slots in use, with their keyframes.
    pub fn keyframes(&self) -> impl Iterator<Item = (usize, &Keyframe)> {
        self.keyframes.iter().enumerate().filter_map(|(slot, k)| k.as_ref().map(|k| (slot, k)))
    }

    /// Features of the keyframe in a slot.
    pub fn features(&self, slot: usize) -> &[Feature] {
        let start = slot * self.limits.features;
        self.features.get(start..start + usize::from(self.counts[slot])).unwrap_or(&[])
    }

    /// Lines of the keyframe in a slot.
    pub fn lines(&self, slot: usize) -> &[MapLine] {
        let start = slot * MAX_LINES;
        self.lines.get(start..start + usize::from(self.line_counts[slot])).unwrap_or(&[])
    }

    /// Gives a keyframe other lines, as many as there is room for.
    pub fn set_lines(&mut self, slot: usize, lines: impl Iterator<Item = MapLine>) {
        if self.keyframe(slot).is_none() {
            return;
        }
        let room = &mut self.lines[slot * MAX_LINES..][..MAX_LINES];
        let mut count = 0;
        for (place, line) in room.iter_mut().zip(lines) {
            *place = line;
            count += 1;
        }
        self.line_counts[slot] = count;
    }

    /// Takes a keyframe, with as many of its features as there is room for, and says in which slot it lives. A full
    /// map forgets another for it. `None` when nothing can be held at all.
    pub fn add(&mut self, mut keyframe: Keyframe, features: &[Feature]) -> Option<usize> {
        if self.len == self.limits.keyframes {
            self.forget_one();
        }
        let slot = self.keyframes.iter().position(Option::is_none)?;
        let count = features.len().min(self.limits.features);
        let start = slot * self.limits.features;
        self.features[start..start + count].copy_from_slice(&features[..count]);
        self.counts[slot] = count as u16;
        self.index.insert(slot, &features[..count]);
        keyframe.id = self.next_id;
        keyframe.field = field_of(&features[..count]);
        keyframe.neighbours.clear();
        self.next_id = self.next_id.wrapping_add(1);
        self.poses_m_c[slot] = keyframe.pose_m_c();
        self.keyframes[slot] = Some(keyframe);
        self.len += 1;
        self.update_cover(slot);
        self.link(slot);
        Some(slot)
    }

    /// Moves a keyframe. What covers it, and its neighbours, are found out anew by [`Self::tend`].
    pub fn set_pose(&mut self, slot: usize, pose_m_b: Isometry3<f64>) {
        if let Some(keyframe) = self.keyframes.get_mut(slot).and_then(Option::as_mut) {
            keyframe.pose_m_b = pose_m_b;
            self.poses_m_c[slot] = keyframe.pose_m_c();
        }
    }

    /// Keyframes that look like a query, best first.
    pub fn query<'a>(
        &self,
        features: &[Feature],
        allowed: impl Fn(&Keyframe) -> bool,
        votes: &'a mut Votes,
    ) -> &'a [Candidate] {
        let allowed = |slot: usize| self.keyframe(slot).is_some_and(&allowed);
        self.index.query(features, &self.features, &self.counts, allowed, votes)
    }

    /// Takes a keyframe out.
    pub fn remove(&mut self, slot: usize) {
        if self.keyframes.get_mut(slot).and_then(Option::take).is_none() {
            return;
        }
        let start = slot * self.limits.features;
        self.index.remove(slot, &self.features[start..start + usize::from(self.counts[slot])]);
        (self.counts[slot], self.line_counts[slot]) = (0, 0);
        self.len -= 1;
        self.unlink(slot);
    }

    /// The keyframe goes that is most like another one; of such a pair the one with fewer features, then the older.
    fn forget_one(&mut self) {
        let worst = (0..self.keyframes.len()).filter(|&s| self.keyframes[s].is_some()).min_by(|&a, &b| {
            let id = |s: usize| self.keyframes[s].as_ref().map_or(0, |k| k.id);
            self.covered[a]
                .0
                .total_cmp(&self.covered[b].0)
                .then(self.counts[a].cmp(&self.counts[b]))
                .then(id(a).cmp(&id(b)))
        });
        if let Some(slot) = worst {
            self.remove(slot);
        }
    }
}

fn field_of(features: &[Feature]) -> [f32; 2] {
    features.iter().fold([0.0, 0.0], |[x, y], f| {
        let larger = |a: f32, b: f32| if b > a { b } else { a };
        [larger(x, f.xy.x.abs()), larger(y, f.xy.y.abs())]
    })
}
