//! A first pose from matches of which many are wrong: random samples, the best first (PROSAC, Chum and Matas 2005), a
//! solution of each, and a local refinement of whatever is best so far (LO-RANSAC, Chum et al. 2003).
//!
//! Samples are drawn from a seed, and their number is bounded.

use super::matching::Match;
use super::refine::{PoseProblem, Refined, Viewpoint};
use super::upright;
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use plumbline_config::Random;

/// Samples of two points at most.
const MAX_SAMPLES: usize = 150;
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
    /// The inliers of the pose found last.
    pub(super) inliers: Vec<Match>,
}

impl Ransac {
    /// For so many matches at most.
    pub fn new(matches: usize) -> Self {
        Self { candidates: Vec::with_capacity(matches), inliers: Vec::with_capacity(matches) }
    }

    /// The pose that most matches agree with.
    pub fn find(&mut self, problem: &PoseProblem<'_>, matches: &[Match], seed: u64) -> Option<Refined> {
        self.inliers.clear();
        if matches.len() < MIN_INLIERS {
            return None;
        }
        let rot_l_b = UnitQuaternion::rotation_between(&problem.gravity.up_b, &Vector3::z())?;
        let mut random = Random::new(seed);
        let mut best: Option<(f64, Refined)> = None;
        // With fewer inliers than are a beginning the pose is of no use, so samples for those are not drawn.
        let needed = samples_needed(MIN_INLIERS, matches.len());
        let (mut needed, mut refinements, mut sample) = (needed.min(MAX_SAMPLES), 0, 0);
        while sample < needed {
            let pool = (FIRST_POOL + sample / SAMPLES_PER_MATCH).min(matches.len());
            sample += 1;
            let Some(chosen) = draw(&mut random, pool) else { continue };
            for pose_m_b in solutions(problem, chosen.map(|i| &matches[i]), &rot_l_b) {
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
                    needed = needed.min(samples_needed(self.inliers.len(), matches.len()));
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

/// Two different matches out of the first `pool`.
fn draw(random: &mut Random, pool: usize) -> Option<[usize; 2]> {
    // A third number is drawn and left: recorded flights hold the samples that follow.
    let [a, b, _] = [random.below(pool), random.below(pool), random.below(pool)];
    (a != b).then_some([a, b])
}

/// Poses of the body that two matches allow; `rot_l_b` turns the body until its z axis points up.
fn solutions(
    problem: &PoseProblem<'_>,
    chosen: [&Match; 2],
    rot_l_b: &UnitQuaternion<f64>,
) -> impl Iterator<Item = Isometry3<f64>> {
    let points = chosen.map(|m| problem.points[m.point as usize].position_m);
    let rays = chosen.map(|m| problem.query[m.query as usize].ray_c());
    let pose_c_b = problem.pose_b_c.inverse();
    let poses_c_m = upright::solve(&points, &rays, &(rot_l_b * problem.pose_b_c.rotation));
    poses_c_m.into_iter().map(move |pose_c_m| pose_c_m.inverse() * pose_c_b)
}

/// Samples of two matches after which one without an outlier is as good as certain.
fn samples_needed(inliers: usize, matches: usize) -> usize {
    let share = inliers as f64 / matches.max(1) as f64;
    let sound = share * share;
    if sound >= 1.0 {
        return 1;
    }
    (libm::log(1.0 - CONFIDENCE) / libm::log(1.0 - sound)).ceil() as usize
}
