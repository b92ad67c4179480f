//! Test images with a known truth: a texture given by a formula, seen through any map of the plane.

use nalgebra::Vector2;
use plumbline_config::{GrayImage, Random};

/// A smooth random texture: a sum of plane waves of 7 to 80 px length, about 128 +- 35 grey levels.
#[derive(Clone)]
pub(crate) struct Texture {
    /// Turns per pixel along x and y, and turns at the origin.
    waves: Vec<[f64; 3]>,
    /// One turn of a wave, in grey levels.
    turn: Vec<f64>,
}

/// Steps of a turn: a wave is off by 0.0014 grey levels at most. 48 sines for each pixel would take twelve times as long.
const STEPS: usize = 1 << 14;
const AMPLITUDE: f64 = 7.0;

impl Texture {
    pub(crate) fn new(seed: u64) -> Self {
        const WAVES: usize = 48;
        let mut random = Random::new(seed);
        let waves = (0..WAVES)
            .map(|_| {
                let per_px = 1.0 / (7.0 * (80.0f64 / 7.0).powf(random.unit()));
                let direction = random.range(0.0, std::f64::consts::TAU);
                [per_px * direction.cos(), per_px * direction.sin(), random.unit()]
            })
            .collect();
        let angle = |step: usize| std::f64::consts::TAU * step as f64 / STEPS as f64;
        Self { waves, turn: (0..STEPS).map(|step| AMPLITUDE * angle(step).sin()).collect() }
    }

    /// Grey level at a point.
    pub(crate) fn at(&self, x: f64, y: f64) -> f64 {
        // Added to a number, it leaves steps of a turn as the last bits, of a negative one too.
        const WHOLE: f64 = (3u64 << 51) as f64 / STEPS as f64;
        let wave = |[kx, ky, phase]: &[f64; 3]| {
            let turns = kx * x + ky * y + phase + WHOLE;
            self.turn[turns.to_bits() as usize % STEPS]
        };
        128.0 + self.waves.iter().map(wave).sum::<f64>()
    }

    /// The texture itself.
    pub(crate) fn render(&self, width: usize, height: usize) -> GrayImage {
        self.render_through(width, height, |p| p, |g| g)
    }

    /// The texture seen through `to_texture` (pixel to texture point), its grey levels through `tone`.
    pub(crate) fn render_through(
        &self,
        width: usize,
        height: usize,
        to_texture: impl Fn(Vector2<f64>) -> Vector2<f64>,
        mut tone: impl FnMut(f64) -> f64,
    ) -> GrayImage {
        let mut image = GrayImage::new(width, height);
        for (i, pixel) in image.pixels_mut().iter_mut().enumerate() {
            let p = to_texture(Vector2::new((i % width) as f64, (i / width) as f64));
            *pixel = tone(self.at(p.x, p.y)).round().clamp(0.0, 255.0) as u8;
        }
        image
    }
}
