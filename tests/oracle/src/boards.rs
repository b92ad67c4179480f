//! Images of calibration boards, rendered exactly: each pixel is the mean of what a few rays through it meet.

use nalgebra::{Isometry3, UnitQuaternion, Vector2, Vector3};
use plumbline_boards::marker_bits;
use plumbline_config::{CameraModel, GrayImage};
use plumbline_lab::calibrate::camera::Target;
use std::f64::consts::PI;

/// Rays to each side of a pixel, and how wide they are spread, px: a lens is not quite sharp.
const SAMPLES: usize = 3;
const SPREAD_PX: f64 = 1.1;
const BLACK: f32 = 30.0;
const WHITE: f32 = 215.0;
const WALL: f32 = 120.0;
/// Noise of a pixel, up to, grey levels.
const NOISE: f32 = 3.0;
/// Border of the tags of an AprilGrid, and of the markers of ChArUco boards, bits.
const TAG_BORDER: i32 = 2;
const MARKER_BORDER: i32 = 1;

/// A board as it is printed.
pub struct Board {
    target: Target,
    /// For each marker its bits, row by row from the upper left one.
    markers: Vec<(usize, Vec<u8>)>,
    /// True if the first square of a ChArUco board is black.
    black_first: bool,
}

impl Board {
    /// Prints a board.
    ///
    /// # Panics
    /// When OpenCV does not know its code.
    pub fn print(target: Target, black_first: bool) -> Self {
        let border = if matches!(target, Target::AprilGrid { .. }) { TAG_BORDER } else { MARKER_BORDER };
        let draw = |n: usize| marker_bits(target.dictionary().unwrap(), n as u32, border).unwrap();
        Self { target, markers: (0..target.marker_count()).map(draw).collect(), black_first }
    }

    /// The middle of its corners, m.
    fn middle(&self) -> Vector2<f64> {
        let corners = self.target.corners_m();
        corners.iter().sum::<Vector2<f64>>() / corners.len() as f64
    }

    /// The turn that shows its face to a camera: y is up on an AprilGrid, and down on the others.
    fn face(&self) -> UnitQuaternion<f64> {
        let is_up = matches!(self.target, Target::AprilGrid { .. });
        UnitQuaternion::from_scaled_axis(Vector3::x() * if is_up { PI } else { 0.0 })
    }

    /// The light of a point of its plane.
    fn light(&self, p: &Vector2<f64>) -> f32 {
        match self.target {
            Target::Chessboard { columns, rows, square_m } => {
                let (x, y) = ((p.x / square_m).floor() as i64, (p.y / square_m).floor() as i64);
                let (right, bottom) = (columns as i64, rows as i64);
                if (-1..right).contains(&x) && (-1..bottom).contains(&y) {
                    return if (x + y) % 2 == 0 { BLACK } else { WHITE };
                }
                paper((-2..right + 1).contains(&x) && (-2..bottom + 1).contains(&y))
            }
            Target::Charuco { columns, rows, square_m, marker_m, .. } => {
                let (x, y) = ((p.x / square_m).floor() as i64, (p.y / square_m).floor() as i64);
                let (right, bottom) = (columns as i64, rows as i64);
                if !(0..right).contains(&x) || !(0..bottom).contains(&y) {
                    return paper((-1..right + 1).contains(&x) && (-1..bottom + 1).contains(&y));
                }
                if ((x + y) % 2 == 0) == self.black_first {
                    return BLACK;
                }
                let before =
                    (0..y * right + x).filter(|k| ((k % right + k / right) % 2 == 0) != self.black_first);
                let corner = Vector2::new(x as f64, y as f64) * square_m;
                let inside = (p - corner - Vector2::repeat(0.5 * (square_m - marker_m))) / marker_m;
                self.bit(before.count(), &inside).unwrap_or(WHITE)
            }
            Target::AprilGrid { columns, rows, tag_m, spacing } => {
                let (pitch, gap) = (tag_m * (1.0 + spacing), tag_m * spacing);
                let (x, y) = ((p.x / pitch).floor() as i64, (p.y / pitch).floor() as i64);
                let (u, v) = (p.x - x as f64 * pitch, p.y - y as f64 * pitch);
                let (right, top) = (columns as i64, rows as i64);
                if u > tag_m && v > tag_m && (-1..right).contains(&x) && (-1..top).contains(&y) {
                    return BLACK;
                }
                if (0..right).contains(&x) && (0..top).contains(&y) && u < tag_m && v < tag_m {
                    // Kalibr prints OpenCV's tags upside down; y is up on its board.
                    let inside = Vector2::new(1.0 - u / tag_m, v / tag_m);
                    return self.bit((y * right + x) as usize, &inside).unwrap_or(WHITE);
                }
                let margin = 2.0 * gap;
                let is_paper = |at: f64, count: i64| (-margin..count as f64 * pitch + gap).contains(&at);
                paper(is_paper(p.x, right) && is_paper(p.y, top))
            }
        }
    }

    /// The light of a marker at a place of 0 to 1 from its upper left corner; `None` outside.
    fn bit(&self, number: usize, inside: &Vector2<f64>) -> Option<f32> {
        let (side, bits) = &self.markers[number];
        if !inside.iter().all(|at| (0.0..1.0).contains(at)) {
            return None;
        }
        let cell = |at: f64| (at * *side as f64) as usize;
        Some(if bits[cell(inside.y) * side + cell(inside.x)] > 127 { WHITE } else { BLACK })
    }
}

fn paper(is_inside: bool) -> f32 {
    if is_inside { WHITE } else { WALL }
}

/// A camera that takes pictures of boards.
pub struct BoardCamera {
    model: CameraModel,
    /// Directions of the corners of all pixels at depth 1, row by row.
    rays: Vec<Option<Vector2<f64>>>,
}

impl BoardCamera {
    /// A camera.
    pub fn new(model: CameraModel) -> Self {
        let corner = |k: usize| {
            let width = model.width_px + 1;
            model.unproject(&Vector2::new((k % width) as f64 - 0.5, (k / width) as f64 - 0.5))
        };
        Self { model, rays: (0..(model.width_px + 1) * (model.height_px + 1)).map(corner).collect() }
    }

    /// Takes a picture of a board at the pose `T_CT`; what is random in it is a function of `seed`.
    pub fn take(&self, board: &Board, pose_c_t: &Isometry3<f64>, seed: u64) -> GrayImage {
        let (width, height) = (self.model.width_px, self.model.height_px);
        let inverse = pose_c_t.inverse();
        let (rot_t_c, origin_t) = (inverse.rotation.to_rotation_matrix(), inverse.translation.vector);
        let light = |xy: Vector2<f64>| {
            let way = rot_t_c * Vector3::new(xy.x, xy.y, 1.0);
            let depth = -origin_t.z / way.z;
            let p_t = origin_t + way * depth;
            if depth > 0.0 { board.light(&p_t.xy()) } else { WALL }
        };
        let mut draw = seed | 1;
        let pixel = |k: usize| {
            draw = draw.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            let noise = ((draw >> 40) as f32 / (1 << 23) as f32 - 1.0) * NOISE;
            let mut sum = 0.0;
            for sample in 0..SAMPLES * SAMPLES {
                sum += self.ray(k % width, k / width, sample).map_or(WALL, light);
            }
            (sum / (SAMPLES * SAMPLES) as f32 + noise).round() as u8
        };
        GrayImage::from_pixels(width, height, (0..width * height).map(pixel).collect()).unwrap()
    }

    /// The direction of a sample of a pixel, between those of the pixel's corners.
    fn ray(&self, x: usize, y: usize, sample: usize) -> Option<Vector2<f64>> {
        let at = |k: usize| 0.5 + SPREAD_PX * ((k as f64 + 0.5) / SAMPLES as f64 - 0.5);
        let (u, v) = (at(sample % SAMPLES), at(sample / SAMPLES));
        let first = y * (self.model.width_px + 1) + x;
        let below = first + self.model.width_px + 1;
        let upper = self.rays[first]? * (1.0 - u) + self.rays[first + 1]? * u;
        let lower = self.rays[below]? * (1.0 - u) + self.rays[below + 1]? * u;
        Some(upper * (1.0 - v) + lower * v)
    }
}

/// Poses `T_CT` of a board whose middle comes to all parts of a camera's image, at about this distance, tilted by
/// `tilt_rad` in all directions.
///
/// # Panics
/// When the camera cannot see there.
pub fn poses(
    camera: &CameraModel,
    board: &Board,
    distance_m: f64,
    tilt_rad: f64,
    count: usize,
) -> Vec<Isometry3<f64>> {
    let pose = |k: usize| {
        // Multiples of such numbers come everywhere evenly (Roberts 2018).
        let place = |ratio: f64| (0.5 + ratio * (k + 1) as f64).fract();
        let across = camera.width_px as f64 * (0.2 + 0.6 * place(0.754_877_666));
        let down = camera.height_px as f64 * (0.2 + 0.6 * place(0.569_840_291));
        let depth = distance_m * (0.85 + 0.4 * place(0.382));
        let direction = camera.unproject(&Vector2::new(across, down)).unwrap();
        let [x, y] = [[1.0, 0.3], [-0.4, 1.0], [-1.0, -0.2], [0.3, -1.0], [0.2, 0.1]][k % 5];
        let turn = 0.4 * (place(0.21) - 0.5) + if k % 3 == 2 { 0.5 * PI } else { 0.0 };
        let tilt = UnitQuaternion::from_scaled_axis(Vector3::new(x, y, 0.0) * tilt_rad);
        let rotation = tilt * UnitQuaternion::from_scaled_axis(Vector3::z() * turn) * board.face();
        let middle = rotation * board.middle().push(0.0);
        Isometry3::from_parts((direction.push(1.0) * depth - middle).into(), rotation)
    };
    (0..count).map(pose).collect()
}
