//! A first pose from matches of which many are wrong: random samples, the best first (PROSAC, Chum and Matas 2005), a
//! solution of each, and a local refinement of whatever is best so far (LO-RANSAC, Chum et al. 2003).
//!
//! Samples are drawn from a seed, and their number is bounded.

use super::matching::Match;
use super::refine::{PoseProblem, Refined, Viewpoint};
use super::{p3p, upright};
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use plumbline_config::Random;

/// Samples at most, of three points and of two.
const MAX_SAMPLES: [usize; 2] = [400, 150];
/// The first samples are drawn from so many of the best matches.
const FIRST_POOL: usize = 10;
/// The pool grows by one match after so many samples.
const SAMPLES_PER_MATCH: usize = 4;
/// Probability that one sample was without an outlier.
const CONFIDENCE: f64 = 0.999;
/// Local refinements a run at most.
const MAX_REFINEMENTS: usize = 8;
/// Fewer inliers than this are no beginning.
const MIN_INLIERS: usize = 6;

/// Finds poses. Allocated once.
#[derive(Clone, Debug)]
pub struct Ransac {
    candidates: Vec<Match>,
    inliers: Vec<Match>,
}

impl Ransac {
    /// For so many matches at most.
    #[must_use]
    pub fn new(matches: usize) -> Self {
        Self { candidates: Vec::with_capacity(matches), inliers: Vec::with_capacity(matches) }
    }

    /// The inliers of the pose found last.
    #[must_use]
    pub fn inliers(&self) -> &[Match] {
        &self.inliers
    }

    /// The pose that most matches agree with.
    pub fn find(&mut self, problem: &PoseProblem<'_>, matches: &[Match], seed: u64) -> Option<Refined> {
        self.inliers.clear();
        let sample_size = if problem.gravity.is_some() { 2 } else { 3 };
        if matches.len() < MIN_INLIERS {
            return None;
        }
        let level = match &problem.gravity {
            Some(gravity) => Some(UnitQuaternion::rotation_between(&gravity.up_b, &Vector3::z())?),
            None => None,
        };
        let mut random = Random::new(seed);
        let mut best: Option<(f64, Refined)> = None;
        // With fewer inliers than are a beginning the pose is of no use, so samples for those are not drawn.
        let needed = samples_needed(MIN_INLIERS, matches.len(), sample_size);
        let (mut needed, mut refinements, mut sample) = (needed.min(MAX_SAMPLES[3 - sample_size]), 0, 0);
        while sample < needed {
            let pool = (FIRST_POOL + sample / SAMPLES_PER_MATCH).min(matches.len());
            sample += 1;
            let Some(chosen) = draw(&mut random, pool, sample_size) else { continue };
            for pose_m_b in solutions(problem, matches, level.as_ref(), &chosen[..sample_size]) {
                let least = best.as_ref().map_or(f64::INFINITY, |(least, _)| *least);
                let cost = self.judge(problem, matches, &pose_m_b, least);
                let better = cost < least;
                if !better || self.candidates.len() < MIN_INLIERS || refinements >= MAX_REFINEMENTS {
                    continue;
                }
                refinements += 1;
                let Some((cost, refined)) = self.improve(problem, matches, &pose_m_b) else { continue };
                if best.as_ref().is_none_or(|(least, _)| cost < *least) {
                    best = Some((cost, refined));
                    self.inliers.clone_from(&self.candidates);
                    needed = needed.min(samples_needed(self.inliers.len(), matches.len(), sample_size));
                }
            }
        }
        best.map(|(_, refined)| refined)
    }

    /// Refines over the inliers of a pose, twice, since a better pose has more of them.
    fn improve(
        &mut self,
        problem: &PoseProblem<'_>,
        matches: &[Match],
        start: &Isometry3<f64>,
    ) -> Option<(f64, Refined)> {
        let first = problem.refine(start, &self.candidates)?;
        self.judge(problem, matches, &first.pose_m_b, f64::INFINITY);
        if self.candidates.len() < MIN_INLIERS {
            return None;
        }
        let refined = problem.refine(&first.pose_m_b, &self.candidates)?;
        let cost = self.judge(problem, matches, &refined.pose_m_b, f64::INFINITY);
        Some((cost, refined))
    }

    /// Sum of the gated distances, each at most 1 (MSAC); the inliers are left in `candidates`. Once the sum reaches
    /// `limit` the rest is not looked at.
    fn judge(
        &mut self,
        problem: &PoseProblem<'_>,
        matches: &[Match],
        pose_m_b: &Isometry3<f64>,
        limit: f64,
    ) -> f64 {
        self.candidates.clear();
        let here = Viewpoint::new(problem, pose_m_b);
        let mut cost = 0.0;
        for item in matches {
            match here.gated_distance(item) {
                Some(distance) if distance <= 1.0 => {
                    cost += distance;
                    self.candidates.push(*item);
                }
                _ => cost += 1.0,
            }
            if cost >= limit {
                break;
            }
        }
        cost
    }
}

/// Different matches out of the first `pool`.
fn draw(random: &mut Random, pool: usize, size: usize) -> Option<[usize; 3]> {
    let chosen = [random.below(pool), random.below(pool), random.below(pool)];
    let different =
        chosen[0] != chosen[1] && (size < 3 || (chosen[0] != chosen[2] && chosen[1] != chosen[2]));
    different.then_some(chosen)
}

/// Poses of the body that a sample allows; `level` turns the body until its z axis points up, where gravity is known.
fn solutions(
    problem: &PoseProblem<'_>,
    matches: &[Match],
    level: Option<&UnitQuaternion<f64>>,
    chosen: &[usize],
) -> p3p::Solutions {
    let point = |i: usize| problem.points[matches[chosen[i]].point as usize].position_m;
    let ray = |i: usize| problem.query[matches[chosen[i]].query as usize].ray_c();
    let pose_c_b = problem.pose_b_c.inverse();
    let mut poses = p3p::Solutions::new();
    let mut add = |pose_c_m: &Isometry3<f64>| {
        let _ = poses.push(pose_c_m.inverse() * pose_c_b);
    };
    match level {
        Some(rot_l_b) => {
            let rot_l_c = rot_l_b * problem.pose_b_c.rotation;
            upright::solve(&[point(0), point(1)], &[ray(0), ray(1)], &rot_l_c).iter().for_each(&mut add);
        }
        None => {
            p3p::solve(&[point(0), point(1), point(2)], &[ray(0), ray(1), ray(2)]).iter().for_each(&mut add);
        }
    }
    poses
}

/// Samples after which one without an outlier is as good as certain.
fn samples_needed(inliers: usize, matches: usize, size: usize) -> usize {
    let share = inliers as f64 / matches.max(1) as f64;
    let sound = (0..size).fold(1.0, |p, _| p * share);
    if sound >= 1.0 {
        return 1;
    }
    (libm::log(1.0 - CONFIDENCE) / libm::log(1.0 - sound)).ceil() as usize
}
