//! Guided matching: with a pose found, each point of the map is looked for where it must be seen, and the pose is
//! refined over what fits there. A place says much about a descriptor, so more points are found than without a pose.

use super::descriptor::Descriptor;
use super::feature::Feature;
use super::matching::Match;
use super::refine::{MIN_DEPTH_M, PoseProblem, Refined, Viewpoint};
use nalgebra::{Point3, Vector2};
use std::ops::Range;

/// Descriptors that differ in so many bits are accepted: the place already says much.
const MAX_DISTANCE: u32 = 96;
/// Rounds: a better pose finds more.
const ROUNDS: usize = 2;
/// A feature is looked at when it lies within so many standard deviations, of both sides in sum.
const REACH: f32 = 8.0;

/// Matches anew and refines. Allocated once.
#[derive(Clone, Debug)]
pub struct Guide {
    /// Features of the query by their first coordinate: few of them are near a point.
    by_x: Vec<(f32, u32)>,
    /// Largest standard deviation of a feature's place.
    largest_sigma: f32,
    /// The point that each feature was given, and the bits in which they differ.
    taken: Vec<Option<(u32, u32)>>,
    /// The matches over which the pose was refined last.
    pub(super) matches: Vec<Match>,
}

impl Guide {
    /// For frames of up to `features`.
    pub fn new(features: usize) -> Self {
        Self {
            by_x: Vec::with_capacity(features),
            largest_sigma: 0.0,
            taken: Vec::with_capacity(features),
            matches: Vec::with_capacity(features),
        }
    }

    /// Takes the features of a frame.
    pub fn begin(&mut self, query: &[Feature]) {
        self.by_x.clear();
        self.by_x.extend(query.iter().enumerate().map(|(i, f)| (f.xy.x, i as u32)));
        self.by_x.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let larger = |a: f32, b: f32| if b > a { b } else { a };
        self.largest_sigma = query.iter().fold(0.0, |largest, f| larger(largest, f.sigma_xy));
    }

    /// Matches where the pose says that points are, and refines over what fits; `descriptors` are those of the points.
    /// `None` when too little fits.
    pub fn refine(
        &mut self,
        problem: &PoseProblem<'_>,
        descriptors: &[Descriptor],
        first: &Refined,
    ) -> Option<Refined> {
        let mut refined = *first;
        for _ in 0..ROUNDS {
            self.match_anew(problem, descriptors, &refined);
            refined = problem.refine(&refined.pose_m_b, &self.matches)?;
        }
        Some(refined)
    }

    fn match_anew(&mut self, problem: &PoseProblem<'_>, descriptors: &[Descriptor], refined: &Refined) {
        self.taken.clear();
        self.taken.resize(problem.query.len(), None);
        let pose_c_m = (refined.pose_m_b * problem.pose_b_c).inverse();
        let here = Viewpoint::new(problem, &refined.pose_m_b);
        for (p, (point, stored)) in problem.points.iter().zip(descriptors).enumerate() {
            let q = pose_c_m * Point3::from(point.position_m);
            if q.z < MIN_DEPTH_M {
                continue;
            }
            let xy = Vector2::new((q.x / q.z) as f32, (q.y / q.z) as f32);
            for at in self.near(xy.x, point.sigma_xy) {
                let i = self.by_x[at].1;
                let feature = &problem.query[i as usize];
                if (feature.xy - xy).amax() > REACH * (feature.sigma_xy + point.sigma_xy) {
                    continue;
                }
                let distance = feature.descriptor.distance(stored);
                let is_nearest = self.taken[i as usize].is_none_or(|(_, nearest)| distance < nearest);
                if !is_nearest || distance > MAX_DISTANCE {
                    continue;
                }
                let item = Match { query: i, point: p as u32, ratio: 0.0 };
                if here.gated_distance(&item).is_some_and(|d| d <= 1.0) {
                    self.taken[i as usize] = Some((p as u32, distance));
                }
            }
        }
        let chosen =
            self.taken.iter().enumerate().filter_map(|(i, taken)| Some((i as u32, taken.as_ref()?.0)));
        self.matches.clear();
        self.matches.extend(chosen.map(|(query, point)| Match { query, point, ratio: 0.0 }));
    }

    /// Range of the features that may lie within reach of a point, by their first coordinate.
    fn near(&self, x: f32, sigma_xy: f32) -> Range<usize> {
        // Somewhat wider than the exact test, whose rounding is another.
        let reach = 1.001 * REACH * (self.largest_sigma + sigma_xy) + 1e-5;
        let from = self.by_x.partition_point(|f| f.0 < x - reach);
        let count = self.by_x[from..].partition_point(|f| f.0 <= x + reach);
        from..from + count
    }
}
