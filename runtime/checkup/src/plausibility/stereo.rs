//! On which side of a pair near things are shifted: to the other one where left and right are swapped, and to none where both are one
//! image.

use super::Finding;
use crate::thumbnail::{Thumbnail, to_image, to_thumbnail};
use nalgebra::{Isometry3, Vector2, Vector3};
use plumbline_config::{CameraModel, Config, Timestamp};

/// Every so many pairs one is looked at, and so many in all.
const EVERY: u64 = 10;
const MAX_LOOKED_AT: u64 = 14;
/// Patches of a pair: the most distinct one of each cell of a grid.
const CELLS: (usize, usize) = (8, 6);
/// Pixels of a patch to each side of its middle, in the thumbnail.
const REACH: usize = 3;
/// Distances that are tried, 1/m.
const STEP_PER_M: f64 = 0.02;
const STEPS: i32 = 30;
/// From here on a shift is one, in these steps: beyond 16 m both sides are alike.
const NEAREST_STEP: i32 = 3;
/// Correlation of patches that show the same, and how much better than the other way round.
const SAME: f64 = 0.85;
const BETTER: f64 = 0.1;
/// Spread of a patch that is distinct, grey levels.
const MIN_SPREAD: f64 = 4.0;
/// Votes that count, and how many more on the wrong side.
const MIN_VOTES: u32 = 30;
const MAJORITY: u32 = 3;

/// Pixels differ by at least this, grey levels, where two sensors see the same.
const EQUAL: f32 = 0.01;
/// Share of such pixels in a pair of one image.
const MAX_DIFFERENT: f64 = 0.01;
/// Pairs of one image that are told.
const MIN_EQUAL: usize = 3;

/// Cause for exchanged cameras.
pub const SWAPPED: &str = "that left and right camera are swapped";
/// See [`SWAPPED`].
pub const CURE: &str =
    "exchange cam0 and cam1, `driver.v4l2.left` and `right`, or camera[0] and camera[1] of the configuration";

/// Votes of patches.
#[derive(Clone, Debug)]
pub struct Sides {
    models: [CameraModel; 2],
    pose_c1_c0: Isometry3<f64>,
    pairs: u64,
    /// Votes of the pairs that were looked at.
    votes: Vec<Votes>,
}

/// Votes of the patches of one pair.
#[derive(Clone, Copy, Debug)]
struct Votes {
    stamp: Timestamp,
    right: u32,
    wrong: u32,
    /// True if both images are equal.
    are_equal: bool,
}

/// A square of a thumbnail.
struct Patch {
    values: [f64; (2 * REACH + 1) * (2 * REACH + 1)],
    spread: f64,
}

impl Patch {
    /// Around a place; `None` where it leaves the thumbnail.
    fn around(image: &Thumbnail, middle: &Vector2<f64>) -> Option<Self> {
        const SIDE: usize = 2 * REACH + 1;
        let mut values = [0.0; SIDE * SIDE];
        for (i, value) in values.iter_mut().enumerate() {
            let offset = Vector2::new((i % SIDE) as f64, (i / SIDE) as f64).add_scalar(-(REACH as f64));
            *value = image.sample(&(middle + offset))?;
        }
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        values.iter_mut().for_each(|value| *value -= mean);
        let spread = values.iter().map(|value| value * value).sum::<f64>().sqrt();
        Some(Self { values, spread })
    }

    fn correlation(&self, other: &Self) -> f64 {
        let product: f64 = self.values.iter().zip(&other.values).map(|(a, b)| a * b).sum();
        product / (self.spread * other.spread).max(1e-9)
    }
}

impl Sides {
    /// For a rig; `None` with one camera.
    #[must_use]
    pub fn new(config: &Config) -> Option<Self> {
        let [left, right] = config.camera.get(..2)? else { return None };
        let pose_c1_c0 = right.pose_b_c().inverse() * left.pose_b_c();
        Some(Self {
            models: [left.model(), right.model()],
            pose_c1_c0,
            pairs: 0,
            votes: Vec::with_capacity(MAX_LOOKED_AT as usize),
        })
    }

    /// Takes the pair of a frame.
    pub fn add(&mut self, stamp: Timestamp, images: &[Thumbnail; 2]) {
        self.pairs += 1;
        if self.pairs % EVERY != 1 || self.pairs > EVERY * MAX_LOOKED_AT {
            return;
        }
        let [left, right] = images;
        let mut votes = Votes { stamp, right: 0, wrong: 0, are_equal: are_equal(left, right) };
        let (width, height) = (left.width / CELLS.0, left.height / CELLS.1);
        for cell in 0..CELLS.0 * CELLS.1 {
            let corner = (cell % CELLS.0 * width, cell / CELLS.0 * height);
            if let Some((at, patch)) = most_distinct(left, corner, (width, height)) {
                self.vote(&mut votes, &to_image(&at, left.shrink), &patch, right);
            }
        }
        self.votes.push(votes);
    }

    /// Looks for a patch of the left image in the right one, along its epipolar line in front of the cameras: as
    /// configured, and as if the left image were the right camera's.
    fn vote(&self, votes: &mut Votes, px: &Vector2<f64>, patch: &Patch, right: &Thumbnail) {
        let best = |from: &CameraModel, to: &CameraModel, pose_to_from: &Isometry3<f64>| {
            let Some(xy) = from.unproject(px) else { return -1.0 };
            let bearing = pose_to_from.rotation * Vector3::new(xy.x, xy.y, 1.0);
            let correlation = |step: i32| {
                let inverse_depth = f64::from(step) * STEP_PER_M;
                let px = to.project(&(bearing + pose_to_from.translation.vector * inverse_depth))?;
                let other = Patch::around(right, &to_thumbnail(&px, right.shrink))?;
                Some(patch.correlation(&other))
            };
            (NEAREST_STEP..=STEPS).filter_map(correlation).fold(-1.0, f64::max)
        };
        let [left_model, right_model] = &self.models;
        let configured = best(left_model, right_model, &self.pose_c1_c0);
        let swapped = best(right_model, left_model, &self.pose_c1_c0.inverse());
        votes.right += u32::from(configured > SAME && configured > swapped + BETTER);
        votes.wrong += u32::from(swapped > SAME && swapped > configured + BETTER);
    }

    /// Finding: left and right are one image, or swapped, by frames whose images are not frozen.
    #[must_use]
    pub fn finding(&self, is_frozen: &dyn Fn(Timestamp) -> bool) -> Option<Finding> {
        let votes = || self.votes.iter().filter(|votes| !is_frozen(votes.stamp));
        let (looked_at, equal) = (votes().count(), votes().filter(|votes| votes.are_equal).count());
        let right: u32 = votes().map(|votes| votes.right).sum();
        let wrong: u32 = votes().map(|votes| votes.wrong).sum();
        if equal >= MIN_EQUAL && 2 * equal > looked_at {
            return Some(Finding::new(
                "left and right images are the same",
                format!("in {equal} of {looked_at} pairs"),
                "one camera, topic or folder that is used for both sides",
                "name the other camera: `driver.v4l2.right`, `plumbline replay --topic right=NAME`, or copy the folder cam1 again",
            ));
        }
        (wrong >= MIN_VOTES && wrong > MAJORITY * right).then(|| {
            Finding::new(
                "near objects are shifted to the wrong side between the images of a pair",
                format!("{wrong} patches match with left and right swapped, {right} as configured"),
                SWAPPED,
                CURE,
            )
        })
    }
}

/// True for images with something in them that differ in hardly a pixel.
fn are_equal(left: &Thumbnail, right: &Thumbnail) -> bool {
    let pixels = left.pixels.len().max(1) as f64;
    let mean = left.pixels.iter().map(|p| f64::from(*p)).sum::<f64>() / pixels;
    let variance = left.pixels.iter().map(|p| (f64::from(*p) - mean).powi(2)).sum::<f64>() / pixels;
    let different = left.pixels.iter().zip(&right.pixels).filter(|(a, b)| (*a - *b).abs() > EQUAL).count();
    left.pixels.len() == right.pixels.len()
        && variance > MIN_SPREAD * MIN_SPREAD
        && different as f64 <= MAX_DIFFERENT * pixels
}

/// The middle of the most distinct patch of a cell.
fn most_distinct(
    image: &Thumbnail,
    (x0, y0): (usize, usize),
    (width, height): (usize, usize),
) -> Option<(Vector2<f64>, Patch)> {
    let places = (y0..y0 + height).step_by(2).flat_map(|y| (x0..x0 + width).step_by(2).map(move |x| (x, y)));
    let patches = places.filter_map(|(x, y)| {
        let at = Vector2::new(x as f64, y as f64);
        Patch::around(image, &at).map(|patch| (at, patch))
    });
    let best = patches.max_by(|a, b| a.1.spread.total_cmp(&b.1.spread))?;
    let per_pixel = best.1.spread / (best.1.values.len() as f64).sqrt();
    (per_pixel > MIN_SPREAD).then_some(best)
}
