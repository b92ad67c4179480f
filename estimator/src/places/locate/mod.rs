//! Localization of a frame in the map. Precision before recall: what is not certain is not reported.
//!
//! Keyframes that look alike are grouped with their neighbours; the features of a group are matched, a pose is found
//! and refined, and then tried: with it, far more points of the map must be where it says than chance allows. What is
//! believed must have enough inliers, spread over the image, and the covariance must say that the pose is well
//! determined. Of groups that speak for different places the one with the most evidence is believed, if none other comes
//! near it: a map may hold two places that look alike.

mod found;
mod options;

pub use found::{Attempt, Doubt, Located};
pub use options::LocatorOptions;
use plumbline_config::Portable;

use super::feature::Feature;
use super::guide::Guide;
use super::index::{Candidate, Votes};
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
    /// The vertical, where it is known.
    pub gravity: Option<Gravity>,
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
    groups: heapless::Vec<Group, MAX_GROUPS>,
    attempts: heapless::Vec<Attempt, MAX_GROUPS>,
}

/// A keyframe and those of its neighbours that share most with it, as slots.
#[derive(Clone, Debug)]
struct Group {
    slots: heapless::Vec<usize, MAX_GROUP>,
    score: f32,
}

impl Group {
    fn of(map: &PlaceMap, candidate: &Candidate, allowed: &impl Fn(&Keyframe) -> bool) -> Self {
        let mut slots = heapless::Vec::new();
        let _ = slots.push(candidate.slot);
        let neighbours = map.keyframe(candidate.slot).map_or(&[][..], |k| k.neighbours.as_slice());
        let neighbours = neighbours.iter().map(|n| usize::from(*n));
        slots.extend(neighbours.filter(|n| map.keyframe(*n).is_some_and(allowed)).take(MAX_GROUP - 1));
        Self { slots, score: candidate.score }
    }

    /// True if the group shows the view from a pose that was found: it would say the same, and is no rival.
    fn is_near(&self, map: &PlaceMap, found: &Located, query: &Query<'_>) -> bool {
        let pose_m_c = found.pose_m_b * query.pose_b_c;
        let keyframe = self.slots.first().and_then(|slot| map.keyframe(*slot));
        keyframe
            .is_some_and(|k| view_distance_within(&k.pose_m_c(), &pose_m_c, MAX_NEIGHBOUR_DISTANCE).is_some())
    }
}

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
            groups: heapless::Vec::new(),
            attempts: heapless::Vec::new(),
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
        self.attempts.clear();
        self.rank(map, &query, &allowed);
        self.guide.begin(features);
        let mut best = None;
        let mut put_off: heapless::Vec<usize, MAX_GROUPS> = heapless::Vec::new();
        for index in 0..self.groups.len() {
            if best.as_ref().is_some_and(|best| self.groups[index].is_near(map, best, &query)) {
                let _ = put_off.push(index);
            } else {
                best = self.try_for_better(map, &query, index, best);
            }
        }
        // Where places contradict each other, all that speaks for each is heard.
        if best.as_ref().is_some_and(|best| self.has_rival(best, 0.0)) {
            for &index in &put_off {
                best = self.try_for_better(map, &query, index, best);
            }
        }
        let best = best?;
        if self.has_rival(&best, self.options.max_rival_share) {
            self.attempts.iter_mut().filter(|a| a.doubt.is_none()).for_each(|a| a.doubt = Some(Doubt::Rival));
            return None;
        }
        Some(best)
    }

    /// Verifies a group: what it says, or what was found before, whichever has more evidence.
    fn try_for_better(
        &mut self,
        map: &PlaceMap,
        query: &Query<'_>,
        index: usize,
        best: Option<Located>,
    ) -> Option<Located> {
        let group = self.groups[index].clone();
        match (best, self.try_group(map, query, &group)) {
            (Some(a), Some(b)) => Some(if b.evidence() > a.evidence() { b } else { a }),
            (a, b) => a.or(b),
        }
    }

    /// True if a group speaks for another place, with at least this share of the evidence of the best.
    fn has_rival(&self, best: &Located, share: f64) -> bool {
        let limit = share * best.evidence();
        self.attempts.iter().any(|a| a.doubt.is_none() && !a.agrees_with(best) && a.evidence() >= limit)
    }

    /// The groups that were verified in the last call, the most alike first, and what became of them.
    #[must_use]
    pub fn attempts(&self) -> &[Attempt] {
        &self.attempts
    }

    /// The groups to be verified: those of the keyframes that look most like the query. A keyframe that is in the
    /// group of a better one has no group of its own.
    fn rank(&mut self, map: &PlaceMap, query: &Query<'_>, allowed: &impl Fn(&Keyframe) -> bool) {
        let candidates = map.query(query.features, allowed, &mut self.votes);
        self.groups.clear();
        let best = candidates.first().map_or(0.0, |c| c.score);
        let alike = candidates.iter().take_while(|c| c.score >= self.options.min_relative_score * best);
        for candidate in alike {
            if self.groups.len() >= self.options.max_candidates || self.groups.is_full() {
                break;
            }
            if !self.groups.iter().any(|g| g.slots.contains(&candidate.slot)) {
                let _ = self.groups.push(Group::of(map, candidate, allowed));
            }
        }
    }

    /// Verifies a group, and writes down what became of it.
    fn try_group(&mut self, map: &PlaceMap, query: &Query<'_>, group: &Group) -> Option<Located> {
        let keyframe = map.keyframe(*group.slots.first()?)?;
        self.matcher.gather(map, &group.slots);
        let found = self.verify(query, keyframe.id);
        let doubt = found.as_ref().map_or_else(|doubt| Some(*doubt), |located| self.doubt(located));
        let _ = self.attempts.push(Attempt {
            keyframe_id: keyframe.id,
            score: group.score,
            matches: self.matcher.matches().len(),
            first_inliers: self.ransac.inliers().len(),
            inliers: found.as_ref().map_or(0, |l| l.inliers),
            pose_m_b: found.as_ref().ok().map(|l| l.pose_m_b),
            doubt,
        });
        found.ok().filter(|_| doubt.is_none())
    }

    /// A pose from the points gathered.
    fn verify(&mut self, query: &Query<'_>, keyframe_id: u32) -> Result<Located, Doubt> {
        self.matcher.match_features(query.features);
        let matches = self.matcher.matches();
        let problem = PoseProblem {
            query: query.features,
            points: self.matcher.points(),
            pose_b_c: query.pose_b_c,
            gravity: query.gravity,
        };
        let first = self.ransac.find(&problem, matches, query.seed).ok_or(Doubt::NoPose)?;
        let refined = self.guide.refine(&problem, self.matcher.descriptors(), &first);
        let refined = refined.ok_or(Doubt::Undetermined)?;
        let inliers = self.guide.matches();
        Ok(Located {
            pose_m_b: refined.pose_m_b,
            covariance: self.with_map_errors(&refined),
            keyframe_id,
            inliers: inliers.len(),
            matches: matches.len(),
            first_inliers: self.ransac.inliers().len(),
            spread: spread(query.features, inliers),
            variance: refined.variance,
        })
    }

    /// The covariance of what was found, the errors of the map itself included. Residuals larger than they should be
    /// say that the noise is; smaller ones are luck.
    fn with_map_errors(&self, refined: &Refined) -> Matrix6<f64> {
        let larger = if refined.variance > 1.0 { refined.variance } else { 1.0 };
        let many = self.guide.matches().len() as f64 / self.options.max_independent;
        let mut covariance = refined.covariance * larger * if many > 1.0 { many } else { 1.0 };
        for i in 0..3 {
            covariance[(i, i)] += self.options.map_sigma_m.squared();
            covariance[(i + 3, i + 3)] += self.options.map_sigma_rad.squared();
        }
        covariance
    }

    /// Doubt about the pose, if any.
    fn doubt(&self, found: &Located) -> Option<Doubt> {
        let options = &self.options;
        // Written so that a NaN is doubted.
        let held = [
            (found.inliers >= options.min_inliers, Doubt::Inliers),
            (
                found.first_inliers as f64 >= options.min_inlier_share * found.matches as f64,
                Doubt::InlierShare,
            ),
            (found.evidence() >= options.min_evidence, Doubt::Evidence),
            (found.spread >= options.min_spread, Doubt::Spread),
            (found.sigma_m() <= options.max_sigma_m, Doubt::Position),
            (found.sigma_rad() <= options.max_sigma_rad, Doubt::Attitude),
        ];
        held.iter().find(|(holds, _)| !holds).map(|(_, doubt)| *doubt)
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
            let cell = (xy[axis] - low) / (high - low).at_least(1e-6) * SPREAD[axis] as f32;
            (cell as usize).min(SPREAD[axis] - 1)
        };
        fields |= 1 << (place(1) * SPREAD[0] + place(0));
    }
    fields.count_ones() as usize
}
