//! Seeds of segments: ridges, strongest first, and whether one looks like a straight edge.
//!
//! The order is that of LSD's pseudo-ordering: by gradient in whole grey levels per pixel, and row by row
//! where it is equal. Of an image with too many ridges only the strongest are seeds. Who grows segments probes
//! a seed when its turn comes: by then a segment has taken most of those along an edge.

use super::gradient::{Gradients, SCALE, of_word};
use super::segment::REDUCTION;
use crate::image::mask::ImageMask;
use crate::image::patch::whole;
use nalgebra::Vector2;
use plumbline_config::{ImageView, Portable};
use std::ops::Range;

/// Seeds are ordered by their gradient in whole grey levels per pixel, as far as this.
const BUCKETS: usize = 256;
/// Places ahead of and behind a seed that are probed, px of the halved image.
const PROBES_PX: [f32; PROBES] = [1.5, -1.5, 3.0, -3.0, 4.5, -4.5, 6.0, -6.0];
const PROBES: usize = 8;
/// Probes that must find a gradient like the seed's: near the end of a segment one looks beyond it.
const MIN_ALIKE: u32 = 6;
/// Squared cosine of the largest angle between the gradients of seed and probe (30 degrees).
const MIN_PROBE_COS2: f32 = 0.75;
/// Smallest gradient of a probe, as a share of the threshold.
const MIN_PROBE_SHARE: f32 = 0.5;

/// A ridge.
#[derive(Clone, Copy, Debug, Default)]
pub struct Seed {
    x: u16,
    y: u16,
    magnitude: i16,
}

impl Seed {
    fn bucket(self) -> usize {
        (self.magnitude as usize / SCALE as usize).min(BUCKETS - 1)
    }

    /// Column and row.
    pub fn place(self) -> (usize, usize) {
        (usize::from(self.x), usize::from(self.y))
    }

    /// True if the gradients around a seed are those of a straight edge, above a share of `threshold` steps. This is far cheaper than
    /// growing, and most seeds have none. All probes are made at once, in the lanes of the vector unit: that costs less than
    /// the mispredicted branches of stopping early.
    pub fn is_promising(self, gradients: &Gradients, threshold: i16) -> bool {
        let (width, height) = (gradients.width, gradients.height);
        let [right, bottom] = [width, height].map(|side| (side as i32 - 1) as f32);
        let pixels = &gradients.pixels;
        let gradient = pixels[usize::from(self.y) * width + usize::from(self.x)].vector();
        let squared_norm = gradient.norm_squared();
        let direction =
            Vector2::new(gradient.y, -gradient.x) / squared_norm.sqrt().at_least(f32::MIN_POSITIVE);
        let (x, y) = (f32::from(self.x) + 0.5, f32::from(self.y) + 0.5);
        let mut places = [0; PROBES];
        probe_places((x, direction.x, right), (y, direction.y, bottom), width as u32, &mut places);
        let probes = places.map(|place| pixels[place as usize].word());
        alike(&gradient, &probes, threshold) >= MIN_ALIKE
    }
}

/// The seeds of one image. Everything is allocated at construction.
#[derive(Clone, Debug)]
pub struct Seeds {
    found: Vec<Seed>,
    /// The seeds, strongest first.
    pub(super) ordered: Vec<Seed>,
    /// True if the last image had more ridges than seeds.
    pub(super) is_cut_short: bool,
}

impl Seeds {
    /// For images of `width` x `height`.
    pub fn new(width: usize, height: usize) -> Self {
        // Of two neighbours across the gradient at most one is a ridge of the halved image.
        let room = width * height / (2 * REDUCTION * REDUCTION) + 1;
        Self { found: Vec::with_capacity(room), ordered: Vec::with_capacity(room), is_cut_short: false }
    }

    /// Computes the gradients of an image and finds its seeds in `rows`, with gradients above `threshold` steps, at most `max_seeds`. What
    /// `mask` hides, at half the resolution, has none.
    pub fn find(
        &mut self,
        gradients: &mut Gradients,
        image: &ImageView<'_>,
        (rows, max_seeds): (Range<usize>, usize),
        threshold: i16,
        mask: Option<&ImageMask>,
    ) {
        let mut counts = [0; BUCKETS];
        self.found.clear();
        gradients.compute(image, rows, threshold, |x, y, magnitude| {
            if mask.is_some_and(|mask| mask.hides(x, y)) {
                return;
            }
            let seed = Seed { x: x as u16, y: y as u16, magnitude };
            counts[seed.bucket()] += 1;
            self.found.push(seed);
        });
        mask.iter().for_each(|mask| gradients.hide(mask));
        self.order(&counts, max_seeds);
    }

    /// Counting sort, strongest first, of as many as there may be; in a bucket the first count.
    fn order(&mut self, counts: &[usize; BUCKETS], max_seeds: usize) {
        let (mut next, mut ends, mut sum) = ([0; BUCKETS], [0; BUCKETS], 0);
        for k in (0..BUCKETS).rev() {
            next[k] = sum;
            sum = (sum + counts[k]).min(max_seeds);
            ends[k] = sum;
        }
        self.is_cut_short = self.found.len() > max_seeds;
        self.ordered.resize(sum, Seed::default());
        for seed in &self.found {
            let (next, end) = (&mut next[seed.bucket()], ends[seed.bucket()]);
            if *next < end {
                self.ordered[*next] = *seed;
                *next += 1;
            }
        }
    }
}

// The steps of a probe, all lanes at once. They are functions of their own, whose results lie in memory: where they are many
// values in registers, the compiler takes them one by one.

/// Indices of the probes in an image of `width`, by start, direction and last coordinate along both axes.
#[inline(never)]
fn probe_places(x: (f32, f32, f32), y: (f32, f32, f32), width: u32, out: &mut [u32; PROBES]) {
    let at = |(start, direction, last): (f32, f32, f32), k: usize| {
        whole((start + direction * PROBES_PX[k]).at_least(0.0).at_most(last)) as u32
    };
    for (k, out) in out.iter_mut().enumerate() {
        *out = at(y, k) * width + at(x, k);
    }
}

/// Probes, by their words, that have a gradient like that of the seed.
#[inline(never)]
fn alike(seed: &Vector2<f32>, words: &[u32; PROBES], threshold: i16) -> u32 {
    let least = (MIN_PROBE_SHARE * f32::from(threshold)).squared();
    let limit = MIN_PROBE_COS2 * seed.norm_squared();
    let mut count = 0;
    for word in words {
        let [gx, gy] = of_word(*word);
        let (dot, squared) = (seed.x * gx + seed.y * gy, gx * gx + gy * gy);
        count += u32::from((dot > 0.0) & (squared > least) & (dot * dot > limit * squared));
    }
    count
}
