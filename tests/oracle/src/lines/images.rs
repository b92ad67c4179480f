//! Images to find segments in: real ones, marked ones, and such as are hard on a detector.

use super::Line;
use opencv::imgcodecs::{IMREAD_GRAYSCALE, imread};
use opencv::prelude::*;
use plumbline_config::{GrayImage, Random};
use plumbline_drivers::{DriverError, EurocDataset, EurocOptions, StereoSource};
use std::path::{Path, PathBuf};

/// The left images of a data set in the ASL format.
///
/// # Errors
/// When it cannot be read.
pub fn left_images(dataset: &Path) -> Result<Vec<GrayImage>, DriverError> {
    let dataset = EurocDataset::open(dataset, &EurocOptions::default())?;
    let (mut stereo, mut frame) = (dataset.stereo(), dataset.new_frame());
    let mut images = Vec::new();
    while stereo.next_frame(&mut frame)? {
        if frame.valid[0] {
            images.push(frame.images[0].clone());
        }
    }
    Ok(images)
}

/// An image whose segments were marked by hand.
#[derive(Clone, Debug)]
pub struct MarkedImage {
    /// Name of the image.
    pub name: String,
    /// Pixels.
    pub image: GrayImage,
    /// Marked segments.
    pub marked: Vec<Line>,
}

/// York Urban's coordinates are Matlab's, whose first pixel is 1: the segments of ours and of OpenCV's LSD
/// agree best with the marks when both are moved by one pixel right and down.
const FIRST_PIXEL: f64 = 1.0;

/// The images of `folder`, each `NAME.jpg` beside `NAME.csv` (a heading, then `x1,y1,x2,y2`), by name.
///
/// # Errors
/// When one cannot be read.
pub fn marked_images(folder: &Path) -> Result<Vec<MarkedImage>, Box<dyn std::error::Error>> {
    let mut tables = Vec::<PathBuf>::new();
    for entry in folder.read_dir()? {
        let path = entry?.path();
        if path.extension().is_some_and(|e| e == "csv") && path.with_extension("jpg").exists() {
            tables.push(path);
        }
    }
    tables.sort();
    tables.iter().map(|table| marked_image(table)).collect()
}

fn marked_image(table: &Path) -> Result<MarkedImage, Box<dyn std::error::Error>> {
    let pixels = imread(table.with_extension("jpg"), IMREAD_GRAYSCALE)?;
    let bytes = pixels.data_bytes()?.to_vec();
    let image = GrayImage::from_pixels(pixels.cols() as usize, pixels.rows() as usize, bytes)
        .ok_or_else(|| format!("{}: no image beside it", table.display()))?;
    let mut marked = Vec::new();
    for row in std::fs::read_to_string(table)?.lines().skip(1) {
        let values: Vec<f64> = row.split(',').map(|v| v.trim().parse()).collect::<Result<_, _>>()?;
        let ends = <[f64; 4]>::try_from(values).map_err(|_| format!("{}: {row}", table.display()))?;
        marked.push(Line::new(ends.map(|v| v - FIRST_PIXEL)));
    }
    let name = table.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    Ok(MarkedImage { name, image, marked })
}

/// An image that is hard on a detector; lengths in pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Adversary {
    /// One grey level.
    Flat(u8),
    /// White noise of this standard deviation about mid-grey, clipped.
    Noise(f64),
    /// White noise, smoothed by a box of this side: blobs with edges in all directions.
    Blobs(usize),
    /// Squares of this side, turned by an angle (rad).
    Checkerboard(f64, f64),
    /// Stripes of this period at an angle (rad).
    Grating(f64, f64),
    /// Rings of this period: edges that are never straight.
    Rings(f64),
    /// Number of random segments, one pixel wide.
    Lines(usize),
    /// Number of random discs and rectangles, one over the other.
    Shapes(usize),
    /// This share of the pixels black or white, the others mid-grey.
    SaltAndPepper(f64),
}

impl Adversary {
    /// One of all kinds with parameters at random.
    pub fn drawn(seed: u64) -> Self {
        let mut draws = Draws::new(seed);
        let mut range = |low: f64, high: f64| low + (high - low) * draws.unit();
        let angle = range(0.0, std::f64::consts::PI);
        match seed % 10 {
            0 => Self::Flat(range(0.0, 256.0) as u8),
            1 => Self::Noise(range(2.0, 130.0)),
            2 => Self::Blobs(range(2.0, 12.0) as usize),
            3 => Self::Checkerboard(range(2.0, 40.0), 0.0),
            4 => Self::Checkerboard(range(2.0, 40.0), angle),
            5 => Self::Grating(range(3.0, 40.0), angle),
            6 => Self::Rings(range(4.0, 40.0)),
            7 => Self::Lines(range(50.0, 3000.0) as usize),
            8 => Self::Shapes(range(50.0, 3000.0) as usize),
            _ => Self::SaltAndPepper(range(0.001, 0.5)),
        }
    }

    /// The image of `width` x `height`; what is random in it is a function of `seed`.
    pub fn render(&self, width: usize, height: usize, seed: u64) -> GrayImage {
        let mut draws = Draws::new(seed ^ 0x5eed);
        let mut image = GrayImage::new(width, height);
        match *self {
            Self::Flat(level) => image.pixels_mut().fill(level),
            Self::Noise(sigma) => image.pixels_mut().iter_mut().for_each(|p| *p = draws.noise(sigma)),
            Self::Blobs(side) => blobs(&mut image, side, &mut draws),
            Self::Checkerboard(side, angle) => paint(&mut image, |x, y| {
                let (u, v) = turned(x, y, angle);
                ((u / side).floor() + (v / side).floor()).rem_euclid(2.0)
            }),
            Self::Grating(period, angle) => {
                paint(&mut image, |x, y| (turned(x, y, angle).0 / period).rem_euclid(1.0).round());
            }
            Self::Rings(period) => {
                let (cx, cy) = (0.5 * width as f64, 0.5 * height as f64);
                paint(&mut image, |x, y| ((x - cx).hypot(y - cy) / period).rem_euclid(1.0).round());
            }
            Self::Lines(count) => (0..count).for_each(|_| draw_line(&mut image, &mut draws)),
            Self::Shapes(count) => (0..count).for_each(|_| draw_shape(&mut image, &mut draws)),
            Self::SaltAndPepper(share) => image.pixels_mut().iter_mut().for_each(|p| {
                let draw = draws.unit() / share;
                *p = if draw < 0.5 {
                    0
                } else if draw < 1.0 {
                    255
                } else {
                    128
                };
            }),
        }
        image
    }
}

/// Black where `value` is 0, white where it is 1.
fn paint(image: &mut GrayImage, value: impl Fn(f64, f64) -> f64) {
    let width = image.width();
    for (k, pixel) in image.pixels_mut().iter_mut().enumerate() {
        *pixel = (255.0 * value((k % width) as f64, (k / width) as f64)) as u8;
    }
}

fn turned(x: f64, y: f64, angle: f64) -> (f64, f64) {
    let (sin, cos) = angle.sin_cos();
    (x * cos + y * sin, y * cos - x * sin)
}

/// Noise of one value per square of `side`, the squares of each row shifted at random.
fn blobs(image: &mut GrayImage, side: usize, draws: &mut Draws) {
    let (width, height) = (image.width(), image.height());
    for y in (0..height).step_by(side) {
        let shift = draws.below(side);
        let values: Vec<u8> = (0..=width / side + 1).map(|_| draws.noise(60.0)).collect();
        for row in image.pixels_mut().chunks_exact_mut(width).skip(y).take(side) {
            row.iter_mut().enumerate().for_each(|(x, pixel)| *pixel = values[(x + shift) / side]);
        }
    }
}

fn draw_line(image: &mut GrayImage, draws: &mut Draws) {
    let (width, height) = (image.width(), image.height());
    let mut point = || (draws.unit() * (width - 1) as f64, draws.unit() * (height - 1) as f64);
    let ((x0, y0), (x1, y1)) = (point(), point());
    let level = draws.below(256) as u8;
    let steps = (x1 - x0).abs().max((y1 - y0).abs()).ceil().max(1.0) as usize;
    for k in 0..=steps {
        let part = k as f64 / steps as f64;
        let (x, y) = ((x0 + (x1 - x0) * part).round(), (y0 + (y1 - y0) * part).round());
        image.pixels_mut()[y as usize * width + x as usize] = level;
    }
}

fn draw_shape(image: &mut GrayImage, draws: &mut Draws) {
    let (width, height) = (image.width(), image.height());
    let (cx, cy) = (draws.below(width) as isize, draws.below(height) as isize);
    let (rx, ry) = (3 + draws.below(60) as isize, 3 + draws.below(60) as isize);
    let (level, is_disc) = (draws.below(256) as u8, draws.below(2) == 0);
    let rows = (cy - ry).max(0)..(cy + ry).min(height as isize);
    for y in rows {
        for x in (cx - rx).max(0)..(cx + rx).min(width as isize) {
            if !is_disc || (x - cx).pow(2) + (y - cy).pow(2) < rx.min(ry).pow(2) {
                image.pixels_mut()[y as usize * width + x as usize] = level;
            }
        }
    }
}

/// Seeded draws.
struct Draws(Random);

impl Draws {
    fn new(seed: u64) -> Self {
        Self(Random::new(seed.wrapping_mul(0x2545_f491_4f6c_dd1d)))
    }

    fn bits(&mut self) -> u64 {
        self.0.next_bits()
    }

    /// Uniform in `[0, 1)`.
    fn unit(&mut self) -> f64 {
        self.0.unit()
    }

    fn below(&mut self, count: usize) -> usize {
        (self.bits() % count as u64) as usize
    }

    /// A grey level, normal about mid-grey: the sum of eight uniform bytes is close to it.
    fn noise(&mut self, sigma: f64) -> u8 {
        let sum: u32 = self.bits().to_ne_bytes().into_iter().map(u32::from).sum();
        // Variance of a byte: (256^2 - 1) / 12.
        let unit = (f64::from(sum) - 8.0 * 127.5) / (8.0_f64 * 5461.25).sqrt();
        (128.0 + sigma * unit).round().clamp(0.0, 255.0) as u8
    }
}
