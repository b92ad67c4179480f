//! Localization of a frame in the map. Precision before recall: what is not certain is not reported.
//!
//! Keyframes that look alike are grouped with their neighbours; the features of a group are matched, a pose is found
//! and refined, and then tried: with it, far more points of the map must be where it says than chance allows. What is
//! believed must have enough inliers, spread over the image, and the covariance must say that the pose is well
//! determined. Of groups that speak for different places the one with the most evidence is believed, if none other comes
//! near it: a map may hold two places that look alike.

mod found;
mod options;

pub use found::Located;
pub use options::LocatorOptions;
use plumbline_config::Portable;

use super::feature::Feature;
use super::guide::Guide;
use super::index::Votes;
use super::map::{Keyframe, MAX_NEIGHBOUR_DISTANCE, PlaceMap, view_distance_within};
use super::matching::{Match, Matcher};
use super::ransac::Ransac;
use super::refine::{Gravity, PoseProblem, Refined};
use nalgebra::{Isometry3, Matrix6};

/// Keyframes of a group at most: the candidate and its neighbours.
const MAX_GROUP: usize = 4;
/// Groups that can be verified at most, whatever the options say.
const MAX_GROUPS: usize = 32;
/// The image is divided into so many columns and rows to tell how widely inliers are spread.
const SPREAD: [usize; 2] = [4, 3];

/// A frame to be located.
#[derive(Clone, Copy)]
pub struct Query<'a> {
    /// Features.
    pub features: &'a [Feature],
    /// Pose of the left camera in the body.
    pub pose_b_c: Isometry3<f64>,
    /// The vertical.
    pub gravity: Gravity,
    /// Seed of the samples: the number of the frame.
    pub seed: u64,
}

/// Locates frames. Everything is allocated at construction.
#[derive(Clone, Debug)]
pub struct Locator {
    options: LocatorOptions,
    max_features: usize,
    votes: Votes,
    matcher: Matcher,
    ransac: Ransac,
    guide: Guide,
    /// Poses of the present frame that are certain by themselves.
    found: heapless::Vec<Located, MAX_GROUPS>,
}

/// Slots of a keyframe and of those of its neighbours that share most with it.
type Group = heapless::Vec<usize, MAX_GROUP>;

impl Locator {
    /// For maps of up to `keyframes` and frames of up to `features`; what a frame has more is not looked at.
    #[must_use]
    pub fn new(options: &LocatorOptions, keyframes: usize, features: usize) -> Self {
        Self {
            options: options.clone(),
            max_features: features,
            votes: Votes::new(keyframes),
            matcher: Matcher::new(features, options.max_points),
            ransac: Ransac::new(features),
            guide: Guide::new(features),
            found: heapless::Vec::new(),
        }
    }

    /// Locates a frame among the keyframes that are `allowed`; `None` when no pose is certain.
    pub fn locate(
        &mut self,
        map: &PlaceMap,
        query: &Query<'_>,
        allowed: impl Fn(&Keyframe) -> bool,
    ) -> Option<Located> {
        let features = &query.features[..query.features.len().min(self.max_features)];
        let query = Query { features, ..*query };
        self.found.clear();
        self.guide.begin(features);
        let groups = self.rank(map, &query, &allowed);
        let mut put_off = heapless::Vec::<&Group, MAX_GROUPS>::new();
        for group in &groups {
            if self.best().is_some_and(|best| shows_view(map, group, &(best.pose_m_b * query.pose_b_c))) {
                let _ = put_off.push(group);
            } else {
                self.verify(map, &query, group);
            }
        }
        // Where places contradict each other, all that speaks for each is heard.
        if self.best().is_some_and(|best| self.has_rival(best, 0.0)) {
            put_off.iter().for_each(|group| self.verify(map, &query, group));
        }
        self.best().filter(|best| !self.has_rival(best, self.options.max_rival_share)).cloned()
    }

    /// The pose with the most evidence.
    fn best(&self) -> Option<&Located> {
        self.found.iter().reduce(|a, b| if b.evidence() > a.evidence() { b } else { a })
    }

    /// True if a group speaks for another place, with at least this share of the evidence of the best.
    fn has_rival(&self, best: &Located, share: f64) -> bool {
        let limit = share * best.evidence();
        self.found.iter().any(|found| !found.agrees_with(best) && found.evidence() >= limit)
    }

    /// The groups to be verified: those of the keyframes that look most like the query, the most alike first. A keyframe
    /// that is in the group of a better one has no group of its own.
    fn rank(
        &mut self,
        map: &PlaceMap,
        query: &Query<'_>,
        allowed: &impl Fn(&Keyframe) -> bool,
    ) -> heapless::Vec<Group, MAX_GROUPS> {
        let candidates = map.query(query.features, allowed, &mut self.votes);
        let mut groups = heapless::Vec::<Group, MAX_GROUPS>::new();
        let best = candidates.first().map_or(0.0, |c| c.score);
        let alike = candidates.iter().take_while(|c| c.score >= self.options.min_relative_score * best);
        for candidate in alike {
            if groups.len() >= self.options.max_candidates || groups.is_full() {
                break;
            }
            if !groups.iter().any(|group| group.contains(&candidate.slot)) {
                let _ = groups.push(group_of(map, candidate.slot, allowed));
            }
        }
        groups
    }

    /// Looks for the pose of the frame among the points of a group, and keeps it if it is certain.
    fn verify(&mut self, map: &PlaceMap, query: &Query<'_>, group: &Group) {
        self.matcher.gather(map, group);
        self.matcher.match_features(query.features);
        let keyframe = group.first().and_then(|slot| map.keyframe(*slot));
        if let Some(located) = keyframe.and_then(|keyframe| self.pose(query, keyframe.id)) {
            let _ = self.found.push(located);
        }
    }

    /// A pose from the matches; `None` if it is not certain.
    fn pose(&mut self, query: &Query<'_>, keyframe_id: u32) -> Option<Located> {
        let matches = &self.matcher.matches;
        let problem = PoseProblem {
            query: query.features,
            points: &self.matcher.points,
            pose_b_c: query.pose_b_c,
            gravity: query.gravity,
        };
        let first = self.ransac.find(&problem, matches, query.seed)?;
        let refined = self.guide.refine(&problem, &self.matcher.descriptors, &first)?;
        let (first_inliers, inliers) = (&self.ransac.inliers, &self.guide.matches);
        let found = Located {
            pose_m_b: refined.pose_m_b,
            covariance: self.with_map_errors(&refined),
            keyframe_id,
            inliers: inliers.len(),
            first_inliers: first_inliers.len(),
        };
        let options = &self.options;
        // Written so that a NaN is doubted.
        let is_certain = inliers.len() >= options.min_inliers
            && first_inliers.len() as f64 >= options.min_inlier_share * matches.len() as f64
            && found.evidence() >= options.min_evidence
            && spread(query.features, inliers) >= options.min_spread
            && found.sigma_m() <= options.max_sigma_m
            && found.sigma_rad() <= options.max_sigma_rad;
        is_certain.then_some(found)
    }

    /// The covariance of what was found, the errors of the map itself included. Residuals larger than they should be
    /// say that the noise is; smaller ones are luck.
    fn with_map_errors(&self, refined: &Refined) -> Matrix6<f64> {
        let larger = if refined.variance > 1.0 { refined.variance } else { 1.0 };
        let many = self.guide.matches.len() as f64 / self.options.max_independent;
        let mut covariance = refined.covariance * larger * if many > 1.0 { many } else { 1.0 };
        for i in 0..3 {
            covariance[(i, i)] += self.options.map_sigma_m.squared();
            covariance[(i + 3, i + 3)] += self.options.map_sigma_rad.squared();
        }
        covariance
    }
}

/// The group of the keyframe in `slot`.
fn group_of(map: &PlaceMap, slot: usize, allowed: &impl Fn(&Keyframe) -> bool) -> Group {
    let neighbours = map.keyframe(slot).map_or(&[][..], |k| k.neighbours.as_slice());
    let neighbours = neighbours.iter().map(|n| usize::from(*n));
    let allowed = neighbours.filter(|n| map.keyframe(*n).is_some_and(allowed));
    std::iter::once(slot).chain(allowed.take(MAX_GROUP - 1)).collect()
}

/// True if a group shows the view from the pose of a left camera: it would say the same, and is no rival.
fn shows_view(map: &PlaceMap, group: &Group, pose_m_c: &Isometry3<f64>) -> bool {
    let keyframe = group.first().and_then(|slot| map.keyframe(*slot));
    keyframe.is_some_and(|k| view_distance_within(&k.pose_m_c(), pose_m_c, MAX_NEIGHBOUR_DISTANCE).is_some())
}

/// Fields of a grid over the image that hold inliers. The grid spans the features of the frame.
fn spread(features: &[Feature], matches: &[Match]) -> usize {
    let mut span = [[f32::INFINITY, f32::NEG_INFINITY]; 2];
    for feature in features {
        for (axis, [low, high]) in span.iter_mut().enumerate() {
            let v = feature.xy[axis];
            *low = if v < *low { v } else { *low };
            *high = if v > *high { v } else { *high };
        }
    }
    let mut fields = 0u32;
    for item in matches {
        let xy = &features[item.query as usize].xy;
        let place = |axis: usize| {
            let [low, high] = span[axis];
            let cell = (xy[axis] - low) / (high - low).at_least(1e-6) * SPREAD[axis] as f32;
            (cell as usize).min(SPREAD[axis] - 1)
        };
        fields |= 1 << (place(1) * SPREAD[0] + place(0));
    }
    fields.count_ones() as usize
}
