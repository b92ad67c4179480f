//! Runs of pixels that are shaded together.
//!
//! Batch of runs to be shaded. The texture of a run is mostly not in the cache, so all runs of a batch first
//! compute and prefetch the places that they read; by the time the last one has, the data of the first are
//! there.

use super::facet::{Facet, RUN};
use super::texture::{Plan, TexelPlaces};
use super::world::World;

/// Runs of a batch: enough that nothing is waited for, and few enough for the nearest cache.
pub(super) const BATCH: usize = 16;

/// Destination of the brightness of a run.
#[derive(Clone, Copy, Debug)]
pub(super) enum Target {
    /// Pixels side by side, from this one on.
    Pixels(u32),
    /// Samples here and there; lanes beyond their number stand for nothing.
    Samples([u16; RUN], usize),
}

/// A run on its way.
#[derive(Clone, Copy, Debug)]
struct Job {
    facet: u16,
    target: Target,
    x: [f32; RUN],
    y: [f32; RUN],
    plan: Plan<RUN>,
    light: [f32; RUN],
    places: TexelPlaces<RUN>,
}

/// Working memory of a batch.
#[derive(Clone, Debug)]
pub(super) struct Batch {
    jobs: Vec<Job>,
    count: usize,
}

impl Batch {
    /// For [`BATCH`] runs and `more`.
    pub(super) fn new(more: usize) -> Self {
        let job = Job {
            facet: 0,
            target: Target::Pixels(0),
            x: [0.0; RUN],
            y: [0.0; RUN],
            plan: Plan::NONE,
            light: [0.0; RUN],
            places: TexelPlaces::default(),
        };
        Self { jobs: vec![job; BATCH + more], count: 0 }
    }

    /// True if the batch must be shaded before more is added.
    #[inline]
    pub(super) fn is_full(&self) -> bool {
        self.count >= BATCH
    }

    /// Adds a run of bearings that all see `facet`.
    #[inline]
    pub(super) fn add(&mut self, facet: u16, x: &[f32; RUN], y: &[f32; RUN], target: Target) {
        let job = &mut self.jobs[self.count];
        (job.facet, job.x, job.y, job.target) = (facet, *x, *y, target);
        self.count += 1;
    }

    /// Shades what was added, in a tile of `step` (see [`Lens::steps`]), hands it to `take`, and is empty.
    ///
    /// [`Lens::steps`]: super::lens::Lens::steps
    pub(super) fn shade(
        &mut self,
        world: &World,
        facets: &[Facet],
        step: &[f32; 4],
        mut take: impl FnMut(&Target, &[f32; RUN]),
    ) {
        let jobs = &mut self.jobs[..self.count];
        for job in jobs.iter_mut() {
            let facet = &facets[job.facet as usize];
            let (plan, on_surface) = facet.plan(world, [&job.x, &job.y], step);
            job.plan = plan;
            facet.texture(world).locate(&job.plan, &mut job.places);
            job.light = match job.target {
                Target::Pixels(_) => facet.light_along(world, &on_surface),
                Target::Samples(..) => facet.light_at(world, &on_surface),
            };
        }
        for job in jobs.iter() {
            let facet = &facets[job.facet as usize];
            let means = facet.texture(world).means(&job.plan, &job.places);
            take(&job.target, &facet.lit(world, &means, &job.light));
        }
        self.count = 0;
    }
}
