//! Masks of what stands still in the images while the vehicle moves: legs, struts, cables, dirt on a lens.
//!
//! In the mean of many views the edges of the scene fade, and those of the vehicle stay. So a block of pixels shows the vehicle if the
//! gradients of the mean image are nearly as strong as those of its single images. What such blocks enclose belongs to the vehicle too.
//! A turning rotor is not found: its edges are elsewhere in every image.

use plumbline_config::GrayImage;
use plumbline_config::options::{CameraConfig, PixelMask, image_sizes};
use plumbline_drivers::{DriverError, StereoFrame, StereoSource};
use std::path::Path;

/// Names of the cameras.
pub const SIDES: [&str; 2] = ["left", "right"];
/// Side of a block, px.
const BLOCK_PX: usize = 8;
/// Views are at least this far apart, s, and differ by this many grey levels in a quarter of their blocks.
const APART_S: f64 = 0.2;
const CHANGE_LEVELS: f32 = 4.0;
const CHANGED_SHARE: f64 = 0.25;
/// Fewest views in which the scene fades.
pub const LEAST_VIEWS: usize = 30;
/// Share of the gradients that the mean image of a block keeps where the vehicle is seen, and their least strength, levels/px.
const KEPT_SHARE: f32 = 0.5;
const LEAST_GRADIENT: f32 = 1.5;
/// Blocks between two edges of the vehicle that belong to it.
const CLOSED_BLOCKS: usize = 3;
/// Masks that leave less than this part of an image are none: the scene stood still.
const LEAST_SEEN_SHARE: f64 = 0.5;

/// Why there are no masks.
#[derive(Debug, thiserror::Error)]
pub enum MaskError {
    /// The images cannot be read.
    #[error(transparent)]
    Driver(#[from] DriverError),
    /// The vehicle hardly moves.
    #[error(
        "{views} views differ from each other, and {LEAST_VIEWS} are needed: record a flight, or carry the vehicle through a textured room for half a minute"
    )]
    TooFewViews {
        /// Views that differ.
        views: usize,
    },
    /// Most of the image stands still.
    #[error(
        "most of the {side} image stands still ({hidden_percent:.0} %): record while the vehicle moves through a textured scene"
    )]
    SceneStands {
        /// Name of the camera.
        side: &'static str,
        /// Share that stands still, %.
        hidden_percent: f64,
    },
}

/// Masks that were found.
#[derive(Clone, Debug)]
pub struct FoundMasks {
    /// Mask of each camera, left first.
    pub masks: Vec<PixelMask>,
    /// Number of views from which they were made.
    pub views: usize,
}

/// Looks for what stands still in the images of `stereo`, and adds `margin_px` around it; `progress` is told the frames so far.
///
/// # Errors
/// When images cannot be read, or the vehicle does not move enough.
pub fn find(
    stereo: &mut dyn StereoSource,
    cameras: &[CameraConfig],
    margin_px: usize,
    progress: &mut dyn FnMut(u64),
) -> Result<FoundMasks, MaskError> {
    let sizes_px = image_sizes(cameras);
    let mut frame = StereoFrame::new(sizes_px);
    let present = sizes_px.iter().take(cameras.len());
    let mut views: Vec<Views> = present.map(|(width, height)| Views::new(*width, *height)).collect();
    let mut last = None;
    let mut frames = 0;
    while stereo.next_frame(&mut frame)? {
        frames += 1;
        progress(frames);
        let is_apart = last.is_none_or(|last| frame.stamp.seconds_since(last) >= APART_S);
        let is_whole = frame.valid.iter().take(views.len()).all(|is_valid| *is_valid);
        if is_apart && is_whole && views.first().is_some_and(|left| left.has_changed(&frame.images[0])) {
            views.iter_mut().zip(&frame.images).for_each(|(views, image)| views.add(image));
            last = Some(frame.stamp);
        }
    }
    let count = views.first().map_or(0, |left| left.count);
    if count < LEAST_VIEWS {
        return Err(MaskError::TooFewViews { views: count });
    }
    let masks: Vec<PixelMask> = views.iter().map(|views| views.mask(margin_px)).collect();
    for (mask, side) in masks.iter().zip(SIDES) {
        if mask.seen_share() < LEAST_SEEN_SHARE {
            return Err(MaskError::SceneStands { side, hidden_percent: 100.0 * (1.0 - mask.seen_share()) });
        }
    }
    Ok(FoundMasks { masks, views: count })
}

/// Writes a mask as a picture: black where nothing is to be looked at.
///
/// # Errors
/// When the file cannot be written.
pub fn write(file: &Path, mask: &PixelMask) -> Result<(), png::EncodingError> {
    let (width, height) = mask.size_px();
    let mut encoder = png::Encoder::new(std::fs::File::create(file)?, width as u32, height as u32);
    encoder.set_color(png::ColorType::Grayscale);
    let pixels: Vec<u8> = mask.pixels().map(|is_seen| if is_seen { 255 } else { 0 }).collect();
    encoder.write_header()?.write_image_data(&pixels)
}

/// Sums over the views of a camera.
struct Views {
    width: usize,
    height: usize,
    count: usize,
    /// Sum of the grey levels, and of the strengths of the gradients, of each pixel.
    levels: Vec<f32>,
    gradients: Vec<f32>,
    /// The last view.
    last: Vec<u8>,
}

impl Views {
    fn new(width: usize, height: usize) -> Self {
        let zeros = vec![0.0; width * height];
        Self { width, height, count: 0, levels: zeros.clone(), gradients: zeros, last: Vec::new() }
    }

    /// True if enough of `image` differs from the last view.
    fn has_changed(&self, image: &GrayImage) -> bool {
        let differences: Vec<f32> =
            self.last.iter().zip(image.pixels()).map(|(a, b)| f32::from(a.abs_diff(*b))).collect();
        let blocks = self.blocks(&differences);
        let changed = blocks.iter().filter(|mean| **mean >= CHANGE_LEVELS).count();
        self.last.is_empty() || changed as f64 >= CHANGED_SHARE * blocks.len() as f64
    }

    fn add(&mut self, image: &GrayImage) {
        let levels: Vec<f32> = image.pixels().iter().map(|level| f32::from(*level)).collect();
        let strengths = self.strengths(&levels);
        self.levels.iter_mut().zip(&levels).for_each(|(sum, level)| *sum += level);
        self.gradients.iter_mut().zip(&strengths).for_each(|(sum, strength)| *sum += strength);
        self.last.clear();
        self.last.extend_from_slice(image.pixels());
        self.count += 1;
    }

    /// Strength of the gradient of each pixel, levels/px; 0 at the rim.
    fn strengths(&self, levels: &[f32]) -> Vec<f32> {
        let mut strengths = vec![0.0; levels.len()];
        for v in 1..self.height.saturating_sub(1) {
            for u in 1..self.width.saturating_sub(1) {
                let at = v * self.width + u;
                let across = levels[at + 1] - levels[at - 1];
                let down = levels[at + self.width] - levels[at - self.width];
                strengths[at] = 0.5 * (across.abs() + down.abs());
            }
        }
        strengths
    }

    fn columns(&self) -> usize {
        self.width.div_ceil(BLOCK_PX)
    }

    /// Mean of `values` in each block.
    fn blocks(&self, values: &[f32]) -> Vec<f32> {
        let columns = self.columns();
        let mut sums = vec![(0.0, 0.0); columns * self.height.div_ceil(BLOCK_PX)];
        for (at, value) in values.iter().enumerate() {
            let (u, v) = (at % self.width, at / self.width);
            let (sum, count): &mut (f32, f32) = &mut sums[v / BLOCK_PX * columns + u / BLOCK_PX];
            *sum += value;
            *count += 1.0;
        }
        sums.iter().map(|(sum, count)| sum / count.max(1.0)).collect()
    }

    fn mask(&self, margin_px: usize) -> PixelMask {
        let scale = 1.0 / self.count.max(1) as f32;
        let mean: Vec<f32> = self.levels.iter().map(|sum| sum * scale).collect();
        let of_mean = self.blocks(&self.strengths(&mean));
        let each = self.blocks(&self.gradients);
        let stands = |(of_mean, each): (&f32, &f32)| {
            *of_mean >= KEPT_SHARE * each * scale && *of_mean >= LEAST_GRADIENT
        };
        let stands =
            Blocks { columns: self.columns(), are_hidden: of_mean.iter().zip(&each).map(stands).collect() };
        let hidden = stands.grown(CLOSED_BLOCKS).shrunk(CLOSED_BLOCKS).grown(margin_px.div_ceil(BLOCK_PX));
        PixelMask::of(self.width, self.height, |u, v| !hidden.at(u / BLOCK_PX, v / BLOCK_PX))
    }
}

/// Which blocks of an image are hidden, row by row.
struct Blocks {
    columns: usize,
    are_hidden: Vec<bool>,
}

impl Blocks {
    fn at(&self, column: usize, row: usize) -> bool {
        self.are_hidden[row * self.columns + column]
    }

    /// Hides also what is within `reach` blocks of a hidden one.
    fn grown(&self, reach: usize) -> Self {
        self.spread(reach, true)
    }

    /// Shows also what is within `reach` blocks of one that is not hidden; beyond the rim there is nothing to see.
    fn shrunk(&self, reach: usize) -> Self {
        self.spread(reach, false)
    }

    fn spread(&self, reach: usize, what: bool) -> Self {
        let rows = self.are_hidden.len() / self.columns.max(1);
        let around = |at: usize, size: usize| at.saturating_sub(reach)..(at + reach + 1).min(size);
        let mut are_hidden = self.are_hidden.clone();
        for (row, column) in (0..rows).flat_map(|row| (0..self.columns).map(move |column| (row, column))) {
            let mut near = around(row, rows)
                .flat_map(|row| around(column, self.columns).map(move |column| (column, row)));
            if near.any(|(column, row)| self.at(column, row) == what) {
                are_hidden[row * self.columns + column] = what;
            }
        }
        Self { columns: self.columns, are_hidden }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use plumbline_config::Config;
    use plumbline_simulator::{Scenario, Scene, SimulatedCondition, Simulator};

    /// Masks of a flight through a room under `condition`, and the simulator.
    fn learned(condition: &str, duration_s: f64) -> (Result<FoundMasks, MaskError>, Simulator) {
        let mut scenario =
            Scenario { scene: Scene::Room, duration_s, resolution_scale: 0.5, ..Scenario::default() };
        condition.parse::<SimulatedCondition>().unwrap().apply(&mut scenario);
        let simulator = Simulator::new(&Config::preset("sim").unwrap(), &scenario).unwrap();
        let found = find(&mut simulator.stereo(), &simulator.config().camera, 4, &mut |_| ());
        (found, simulator)
    }

    #[test]
    fn without_parts_in_view_nothing_is_masked() {
        let (found, _) = learned("blur:1:1", 2.0);
        assert!(matches!(found, Err(MaskError::TooFewViews { .. })));
        let (found, _) = learned("blur:1:1", 14.0);
        let shares: Vec<f64> = found.unwrap().masks.iter().map(PixelMask::seen_share).collect();
        assert!(shares.len() == 2 && shares.iter().all(|share| *share > 0.98), "{shares:?}");
    }
}
