//! Small images: what is left of a frame for a look at whether the calibration can be right.

use nalgebra::{Matrix3, Rotation3, SVector, UnitQuaternion, Vector2, Vector3};
use plumbline_config::{CameraModel, GrayImage, ImageView};

/// Width of a thumbnail, about: a quarter of the images of EuRoC.
const WIDTH: usize = 188;
/// A thumbnail is compared with its surroundings of so many pixels to each side: brightness and vignetting go.
const SURROUNDINGS: usize = 4;

/// A shrunken image.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Thumbnail {
    /// Width, thumbnail pixels.
    pub width: usize,
    /// Height, thumbnail pixels.
    pub height: usize,
    /// Pixels of the image on a side of one pixel of this.
    pub shrink: usize,
    /// Rows of means over squares of `shrink` pixels.
    pub pixels: Vec<f32>,
}

impl Thumbnail {
    /// A black one for images of that size.
    #[must_use]
    pub fn new((width_px, height_px): (usize, usize)) -> Self {
        let shrink = (width_px / WIDTH).max(1);
        let (width, height) = (width_px / shrink, height_px / shrink);
        Self { width, height, shrink, pixels: vec![0.0; width * height] }
    }

    /// Takes the content of an image of its size; allocates nothing.
    pub fn take(&mut self, image: &GrayImage) {
        self.take_view(&image.view());
    }

    /// Takes the content of an image of its size, which may be a part of another; returns whether it is of that size.
    pub fn take_view(&mut self, image: &ImageView<'_>) -> bool {
        let shrink = self.shrink;
        if (image.width() / shrink, image.height() / shrink) != (self.width, self.height) {
            return false;
        }
        for (row, out) in self.pixels.chunks_exact_mut(self.width.max(1)).enumerate() {
            for (column, mean) in out.iter_mut().enumerate() {
                let (start, mut sum) = (column * shrink, 0u32);
                for line in 0..shrink {
                    let pixels = &image.row(row * shrink + line)[start..start + shrink];
                    sum += pixels.iter().map(|&p| u32::from(p)).sum::<u32>();
                }
                *mean = sum as f32 / (shrink * shrink) as f32;
            }
        }
        true
    }

    /// Half its size.
    #[must_use]
    pub fn halved(&self) -> Self {
        let (width, height) = (self.width / 2, self.height / 2);
        let at = |x: usize, y: usize| self.pixels[y * self.width + x];
        let mean = |x: usize, y: usize| 0.25 * (at(x, y) + at(x + 1, y) + at(x, y + 1) + at(x + 1, y + 1));
        let pixels = (0..width * height).map(|i| mean(i % width * 2, i / width * 2)).collect();
        Self { width, height, shrink: 2 * self.shrink, pixels }
    }

    /// Returns the thumbnail less the mean of the surroundings of each pixel.
    #[must_use]
    pub fn detail(&self) -> Self {
        let (w, h, reach) = (self.width, self.height, SURROUNDINGS);
        let mut sums = vec![0.0f64; (w + 1) * (h + 1)];
        for y in 0..h {
            let mut row = 0.0;
            for x in 0..w {
                row += f64::from(self.pixels[y * w + x]);
                sums[(y + 1) * (w + 1) + x + 1] = sums[y * (w + 1) + x + 1] + row;
            }
        }
        let detail = |i: usize| {
            let (x, y) = (i % w, i / w);
            let (x0, x1) = (x.saturating_sub(reach), (x + reach + 1).min(w));
            let (y0, y1) = (y.saturating_sub(reach), (y + reach + 1).min(h));
            let at = |x: usize, y: usize| sums[y * (w + 1) + x];
            let mean = (at(x1, y1) - at(x0, y1) - at(x1, y0) + at(x0, y0)) / ((x1 - x0) * (y1 - y0)) as f64;
            self.pixels[i] - mean as f32
        };
        Self { pixels: (0..w * h).map(detail).collect(), ..*self }
    }

    /// The value between pixels; `None` outside.
    #[must_use]
    pub fn sample(&self, at: &Vector2<f64>) -> Option<f64> {
        if !(at.x >= 0.0 && at.y >= 0.0 && at.x < self.width as f64 - 1.0 && at.y < self.height as f64 - 1.0)
        {
            return None;
        }
        let (x, y) = (at.x as usize, at.y as usize);
        let (fx, fy) = (at.x - x as f64, at.y - y as f64);
        let value = |x: usize, y: usize| f64::from(self.pixels[y * self.width + x]);
        let top = value(x, y) * (1.0 - fx) + value(x + 1, y) * fx;
        let bottom = value(x, y + 1) * (1.0 - fx) + value(x + 1, y + 1) * fx;
        Some(top * (1.0 - fy) + bottom * fy)
    }
}

/// The place in an image of a place in its thumbnail, which was shrunk by `shrink`, px.
#[must_use]
pub fn to_image(at: &Vector2<f64>, shrink: usize) -> Vector2<f64> {
    at.map(|x| (x + 0.5) * shrink as f64 - 0.5)
}

/// The place in a thumbnail of a place in its image.
#[must_use]
pub fn to_thumbnail(px: &Vector2<f64>, shrink: usize) -> Vector2<f64> {
    px.map(|x| (x + 0.5) / shrink as f64 - 0.5)
}

/// Every so many pixels of those one is compared.
const GRID: usize = 2;
/// Steps of the alignment from each first guess.
const STEPS: usize = 8;
/// Fewest pixels that must be seen by both frames, of those that are compared.
const LEAST_OVERLAP: f64 = 0.5;

/// Finds the rotation of a camera between two frames from the images alone: the one that brings most pixels of one
/// frame onto the other, by inverse compositional Gauss-Newton (Baker and Matthews, 2004). Translation makes a
/// rotation of its own, by speed over depth, which is not told apart.
#[derive(Debug)]
pub struct RotationFinder {
    model: CameraModel,
    /// Pixels of the grid with their bearings and the derivative of the pixel by a rotation (rows x, y).
    points: Vec<(usize, Vector3<f64>, [Vector3<f64>; 2])>,
    last: Option<Thumbnail>,
    guess: UnitQuaternion<f64>,
}

impl RotationFinder {
    /// For the images of a camera.
    #[must_use]
    pub fn new(model: CameraModel) -> Self {
        let half = Thumbnail::new((model.width_px, model.height_px)).halved();
        let inner = |n: usize| (1..n.saturating_sub(1)).step_by(GRID);
        let mut points = Vec::new();
        for (y, x) in inner(half.height).flat_map(|y| inner(half.width).map(move |x| (y, x))) {
            let px = to_image(&Vector2::new(x as f64, y as f64), half.shrink);
            let Some(xy) = model.unproject(&px) else { continue };
            let bearing = Vector3::new(xy.x, xy.y, 1.0);
            let Some((_, px_by_point)) = model.project_with_jacobian(&bearing) else { continue };
            let by_rotation = px_by_point * -bearing.cross_matrix() / half.shrink as f64;
            let rows = [0, 1].map(|k| Vector3::from_iterator(by_rotation.row(k).iter().copied()));
            points.push((y * half.width + x, bearing, rows));
        }
        Self { model, points, last: None, guess: UnitQuaternion::identity() }
    }

    /// Takes the next frame; the rotation `R_last_now` of the camera since the one before, as far as the images agree
    /// on one, with their correlation.
    pub fn next(&mut self, thumbnail: &Thumbnail) -> Option<(UnitQuaternion<f64>, f64)> {
        let now = thumbnail.halved().detail();
        let last = self.last.replace(now)?;
        let now = self.last.as_ref()?;
        let mut guesses = vec![UnitQuaternion::identity()];
        if self.guess.angle() > 1e-3 {
            guesses.push(self.guess);
        }
        let aligned = guesses.into_iter().filter_map(|guess| self.align(&last, now, guess));
        let (rot_now_last, correlation) = aligned.max_by(|a, b| a.1.total_cmp(&b.1))?;
        self.guess = rot_now_last;
        Some((rot_now_last.inverse(), correlation))
    }

    /// Forgets the last frame: the next one is not its neighbour.
    pub fn forget(&mut self) {
        self.last = None;
        self.guess = UnitQuaternion::identity();
    }

    /// `R_now_last` from a first guess, with the correlation of what both frames see.
    fn align(
        &self,
        last: &Thumbnail,
        now: &Thumbnail,
        guess: UnitQuaternion<f64>,
    ) -> Option<(UnitQuaternion<f64>, f64)> {
        let mut rotation = guess;
        let mut correlation = None;
        for step in 0..=STEPS {
            let matrix = rotation.to_rotation_matrix();
            let (mut hessian, mut gradient) = (Matrix3::zeros(), Vector3::zeros());
            let mut moments = SVector::<f64, 5>::zeros();
            let mut seen = 0;
            for (index, bearing, rows) in &self.points {
                let Some(b) = self.at(now, &matrix, bearing) else { continue };
                let a = f64::from(last.pixels[*index]);
                let dx = 0.5 * f64::from(last.pixels[index + 1] - last.pixels[index - 1]);
                let dy = 0.5 * f64::from(last.pixels[index + last.width] - last.pixels[index - last.width]);
                let row = rows[0] * dx + rows[1] * dy;
                hessian += row * row.transpose();
                gradient += row * (b - a);
                moments += SVector::from([a, b, a * a, b * b, a * b]);
                seen += 1;
            }
            if (seen as f64) < LEAST_OVERLAP * self.points.len() as f64 || seen == 0 {
                return None;
            }
            let [ma, mb, aa, bb, ab] = (moments / f64::from(seen)).into();
            let spread = ((aa - ma * ma) * (bb - mb * mb)).sqrt();
            correlation = (spread > 1e-9).then(|| (ab - ma * mb) / spread);
            if step == STEPS {
                break;
            }
            let delta = hessian.cholesky()?.solve(&gradient);
            rotation *= UnitQuaternion::from_scaled_axis(-delta);
            if delta.norm() < 1e-5 {
                break;
            }
        }
        correlation.map(|correlation| (rotation, correlation))
    }

    fn at(&self, now: &Thumbnail, rotation: &Rotation3<f64>, bearing: &Vector3<f64>) -> Option<f64> {
        let px = self.model.project(&(rotation * bearing))?;
        now.sample(&to_thumbnail(&px, now.shrink))
    }
}
