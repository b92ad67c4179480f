//! Where in the map was this frame taken? Precision before recall: what is not certain is not said.
//!
//! Keyframes that look alike are grouped with their neighbours; the features of a group are matched, a pose is found
//! and refined, and then tried: with it, far more points of the map must be where it says than chance allows. What is
//! believed must have enough inliers, spread over the image, of those points that ought to be seen enough must be, and
//! the covariance must say that the pose is well determined.

use super::feature::Feature;
use super::index::Votes;
use super::map::{Keyframe, MAX_NEIGHBOURS, PlaceMap};
use super::matching::{Match, Matcher};
use super::ransac::Ransac;
use super::refine::{Gravity, Problem, Refined};
use nalgebra::{Isometry3, Matrix6};

/// Keyframes of a group at most: the candidate and its neighbours.
const MAX_GROUP: usize = 4;
/// Guided matching accepts descriptors that differ in so many bits: the place already says much.
const MAX_GUIDED_DISTANCE: u32 = 96;
/// Rounds of guided matching.
const GUIDED_ROUNDS: usize = 2;
/// The image is divided into so many columns and rows to tell how widely inliers are spread.
const SPREAD: [usize; 2] = [4, 3];

/// What is asked of a pose before it is believed, and the work that is spent.
#[derive(Clone, Debug, PartialEq)]
pub struct LocatorOptions {
    /// Groups that are verified at most.
    pub max_candidates: usize,
    /// Groups with less than this share of the best score are not verified.
    pub min_relative_score: f32,
    /// Least number of inliers.
    pub min_inliers: usize,
    /// Of the matches before guiding, so many must be inliers.
    pub min_inlier_share: f64,
    /// Inliers before guiding, and a quarter of those after it: least sum. The first were found without knowing where
    /// to look, and prove the more for it.
    pub min_evidence: f64,
    /// Fields of a 4x3 grid over the image that hold inliers, at least.
    pub min_spread: usize,
    /// Largest standard deviation of the position in its worst direction, m.
    pub max_sigma_m: f64,
    /// The same of the attitude, rad.
    pub max_sigma_rad: f64,
    /// Points of the map that a query is matched with, at most.
    pub max_points: usize,
    /// Standard deviation of the keyframes' own positions against each other, m: added to what is found.
    pub map_sigma_m: f64,
    /// The same of their attitudes, rad.
    pub map_sigma_rad: f64,
}

impl Default for LocatorOptions {
    fn default() -> Self {
        Self {
            max_candidates: 6,
            min_relative_score: 0.2,
            min_inliers: 15,
            min_inlier_share: 0.25,
            min_evidence: 15.0,
            min_spread: 4,
            max_sigma_m: 0.08,
            max_sigma_rad: 0.03,
            max_points: 1600,
            // Those of poses by motion capture: see `docs/places.md` for how they were found.
            map_sigma_m: 0.005,
            map_sigma_rad: 0.004,
        }
    }
}

/// A frame to be located.
#[derive(Clone, Copy)]
pub struct Query<'a> {
    /// Its features.
    pub features: &'a [Feature],
    /// Pose of the left camera in the body.
    pub pose_b_c: Isometry3<f64>,
    /// The vertical, where it is known.
    pub gravity: Option<Gravity>,
    /// Seed of the samples: the number of the frame.
    pub seed: u64,
}

/// A pose found.
#[derive(Clone, Debug, PartialEq)]
pub struct Located {
    /// Pose of the body in the map.
    pub pose_m_b: Isometry3<f64>,
    /// Covariance of position (0..3, in `M`) and attitude (3..6, right perturbation, rad).
    pub covariance: Matrix6<f64>,
    /// Number of the keyframe by which it was found.
    pub keyframe_id: u32,
    /// Matches that agree with it.
    pub inliers: usize,
    /// Matches before guiding.
    pub matches: usize,
    /// Of those, inliers.
    pub first_inliers: usize,
    /// Fields of the grid over the image with inliers.
    pub spread: usize,
    /// Mean square of the whitened residuals.
    pub variance: f64,
}

impl Located {
    /// Standard deviation of the position in its worst direction, m.
    #[must_use]
    pub fn sigma_m(&self) -> f64 {
        self.covariance.fixed_view::<3, 3>(0, 0).symmetric_eigenvalues().max().max(0.0).sqrt()
    }

    /// Standard deviation of the attitude about its worst axis, rad.
    #[must_use]
    pub fn sigma_rad(&self) -> f64 {
        self.covariance.fixed_view::<3, 3>(3, 3).symmetric_eigenvalues().max().max(0.0).sqrt()
    }
}

/// Locates frames. Everything is allocated at construction.
#[derive(Clone, Debug)]
pub struct Locator {
    options: LocatorOptions,
    votes: Votes,
    matcher: Matcher,
    ransac: Ransac,
    guided: Vec<Match>,
    query_taken: Vec<(u32, u32)>,
    groups: heapless::Vec<Group, 32>,
}

#[derive(Clone, Copy, Debug)]
struct Group {
    slot: usize,
    score: f32,
}

impl Locator {
    /// For maps of up to `keyframes` and frames of up to `features`.
    #[must_use]
    pub fn new(options: &LocatorOptions, keyframes: usize, features: usize) -> Self {
        Self {
            options: options.clone(),
            votes: Votes::new(keyframes),
            matcher: Matcher::new(features, options.max_points),
            ransac: Ransac::new(features.max(options.max_points)),
            guided: Vec::with_capacity(options.max_points),
            query_taken: Vec::with_capacity(features),
            groups: heapless::Vec::new(),
        }
    }

    /// Locates a frame among the keyframes that are `allowed`; `None` when no pose is certain.
    pub fn locate(
        &mut self,
        map: &PlaceMap,
        query: &Query<'_>,
        allowed: impl Fn(&Keyframe) -> bool,
    ) -> Option<Located> {
        self.rank(map, query, &allowed);
        for index in 0..self.groups.len() {
            let found = self.try_group(map, query, self.groups[index].slot, &allowed);
            if found.as_ref().is_some_and(|f| self.believes(f)) {
                return found;
            }
        }
        None
    }

    /// The groups to be verified: those whose keyframes look most like the query together.
    fn rank(&mut self, map: &PlaceMap, query: &Query<'_>, allowed: &impl Fn(&Keyframe) -> bool) {
        let candidates = map.query(query.features, allowed, &mut self.votes);
        self.groups.clear();
        let best = candidates.first().map_or(0.0, |c| c.score);
        for candidate in candidates.iter().take(self.groups.capacity()) {
            if candidate.score < self.options.min_relative_score * best {
                break;
            }
            let Some(keyframe) = map.keyframe(candidate.slot) else { continue };
            let of_neighbours = candidates
                .iter()
                .take(4 * self.groups.capacity())
                .filter(|c| keyframe.neighbours.contains(&(c.slot as u16)))
                .map(|c| c.score);
            let score = candidate.score + 0.5 * of_neighbours.sum::<f32>();
            let _ = self.groups.push(Group { slot: candidate.slot, score });
        }
        self.groups.sort_unstable_by(|a, b| b.score.total_cmp(&a.score).then(a.slot.cmp(&b.slot)));
        self.groups.truncate(self.options.max_candidates);
    }

    fn try_group(
        &mut self,
        map: &PlaceMap,
        query: &Query<'_>,
        slot: usize,
        allowed: &impl Fn(&Keyframe) -> bool,
    ) -> Option<Located> {
        let keyframe = map.keyframe(slot)?;
        let mut slots: heapless::Vec<usize, { MAX_NEIGHBOURS + 1 }> = heapless::Vec::new();
        let _ = slots.push(slot);
        for &other in &keyframe.neighbours {
            if slots.len() < MAX_GROUP && map.keyframe(usize::from(other)).is_some_and(allowed) {
                let _ = slots.push(usize::from(other));
            }
        }
        self.matcher.gather(map, &slots);
        self.matcher.match_features(map, query.features);
        let matches = self.matcher.matches();
        let problem = Problem {
            query: query.features,
            points: self.matcher.points(),
            pose_b_c: query.pose_b_c,
            gravity: query.gravity,
        };
        let first = self.ransac.find(&problem, matches, query.seed)?;
        let (matches, first_inliers) = (matches.len(), self.ransac.inliers().len());
        let refined = self.guide(map, query, &first)?;
        Some(Located {
            pose_m_b: refined.pose_m_b,
            covariance: self.with_map_errors(&refined),
            keyframe_id: keyframe.id,
            inliers: self.guided.len(),
            matches,
            first_inliers,
            spread: spread(query.features, &self.guided),
            variance: refined.variance,
        })
    }

    /// Matches anew where the pose says that points are, and refines over what fits.
    fn guide(&mut self, map: &PlaceMap, query: &Query<'_>, first: &Refined) -> Option<Refined> {
        let mut refined = *first;
        for _ in 0..GUIDED_ROUNDS {
            let problem = Problem {
                query: query.features,
                points: self.matcher.points(),
                pose_b_c: query.pose_b_c,
                gravity: query.gravity,
            };
            self.query_taken.clear();
            self.query_taken.resize(query.features.len(), (u32::MAX, u32::MAX));
            let pose_c_m = (refined.pose_m_b * query.pose_b_c).inverse();
            for (p, point) in problem.points.iter().enumerate() {
                let q = pose_c_m * nalgebra::Point3::from(point.position_m);
                if q.z < 0.1 {
                    continue;
                }
                let xy = nalgebra::Vector2::new((q.x / q.z) as f32, (q.y / q.z) as f32);
                let stored = &map.features(point.slot as usize)[point.feature as usize];
                for (i, feature) in query.features.iter().enumerate() {
                    // Six standard deviations of both, as a quick test before the exact one.
                    let reach = 8.0 * (feature.sigma_xy + stored.sigma_xy);
                    if (feature.xy - xy).amax() > reach {
                        continue;
                    }
                    let distance = feature.descriptor.distance(&stored.descriptor);
                    let taken = &mut self.query_taken[i];
                    if distance >= taken.1 || distance > MAX_GUIDED_DISTANCE {
                        continue;
                    }
                    let item = Match { query: i as u32, point: p as u32, distance, ratio: 0.0 };
                    if problem.gated_distance(&refined.pose_m_b, &item).is_some_and(|d| d <= 1.0) {
                        *taken = (p as u32, distance);
                    }
                }
            }
            self.guided.clear();
            for (i, (point, distance)) in self.query_taken.iter().enumerate().filter(|(_, t)| t.0 != u32::MAX)
            {
                self.guided.push(Match { query: i as u32, point: *point, distance: *distance, ratio: 0.0 });
            }
            refined = problem.refine(&refined.pose_m_b, &self.guided)?;
        }
        Some(refined)
    }

    /// The covariance of what was found, the errors of the map itself included. Residuals larger than they should be
    /// say that the noise is; smaller ones are luck.
    fn with_map_errors(&self, refined: &Refined) -> Matrix6<f64> {
        let mut covariance = refined.covariance * if refined.variance > 1.0 { refined.variance } else { 1.0 };
        for i in 0..3 {
            covariance[(i, i)] += self.options.map_sigma_m.powi(2);
            covariance[(i + 3, i + 3)] += self.options.map_sigma_rad.powi(2);
        }
        covariance
    }

    fn believes(&self, found: &Located) -> bool {
        let options = &self.options;
        found.inliers >= options.min_inliers
            && found.first_inliers as f64 >= options.min_inlier_share * found.matches as f64
            && found.first_inliers as f64 + 0.25 * found.inliers as f64 >= options.min_evidence
            && found.spread >= options.min_spread
            && found.sigma_m() <= options.max_sigma_m
            && found.sigma_rad() <= options.max_sigma_rad
    }
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
            let cell = (xy[axis] - low) / (high - low).max(1e-6) * SPREAD[axis] as f32;
            (cell as usize).min(SPREAD[axis] - 1)
        };
        fields |= 1 << (place(1) * SPREAD[0] + place(0));
    }
    fields.count_ones() as usize
}
