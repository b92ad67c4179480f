//! From light to grey levels: what optics and sensor do to an image.
//!
//! Every draw is a pure function of the seed, the frame, the camera and the pixel, so frames may be
//! rendered in any order and on any thread.

use super::noise::{NOISE_RUN, NoiseTable};
use crate::random::{Draws, Purpose};
use nalgebra::Vector2;
use plumbline_config::{CameraModel, Portable};
use std::f64::consts::TAU;

/// Period of the slow change of exposure, s.
const DRIFT_PERIOD_S: f64 = 7.0;

/// Effects on images and frames. Times are seconds since the first frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Effects {
    /// Standard deviation of the noise of a black pixel, grey levels.
    pub read_noise: f64,
    /// Variance of the photon noise per grey level of brightness, grey levels.
    pub shot_noise: f64,
    /// Share of the light lost in the farthest corner of the image.
    pub vignetting: f64,
    /// Standard deviation of the blur of the lens, px (0 to 0.7).
    pub lens_blur_px: f64,
    /// Exposure time, s, centred on the measurement time; 0 for no motion blur.
    pub exposure_s: f64,
    /// Images rendered and averaged over the exposure.
    pub sub_exposures: usize,
    /// Gain of all images.
    pub gain: f64,
    /// Standard deviation of the gain from frame to frame, relative.
    pub flicker: f64,
    /// Amplitude of a slow change of exposure, relative.
    pub exposure_drift: f64,
    /// Both images are black, noise aside, from the first to the second time, s.
    pub blackout: Option<(f64, f64)>,
    /// `t_imu = t_camera + time_offset_s`: stamps of images are early by this much.
    pub time_offset_s: f64,
    /// Time from the exposure of the first row to that of the last, s; 0 for a global shutter. The middle row is exposed at the
    /// measurement time.
    pub readout_s: f64,
}

impl Default for Effects {
    /// A good industrial camera in good light.
    fn default() -> Self {
        Self {
            read_noise: 1.0,
            shot_noise: 0.01,
            vignetting: 0.25,
            lens_blur_px: 0.45,
            exposure_s: 0.0,
            sub_exposures: 4,
            gain: 1.0,
            flicker: 0.01,
            exposure_drift: 0.05,
            blackout: None,
            time_offset_s: 0.0,
            readout_s: 0.0,
        }
    }
}

impl Effects {
    /// A perfect camera.
    pub fn none() -> Self {
        Self {
            read_noise: 0.0,
            shot_noise: 0.0,
            vignetting: 0.0,
            lens_blur_px: 0.0,
            flicker: 0.0,
            exposure_drift: 0.0,
            ..Self::default()
        }
    }

    /// Gain of frame `index`, `time_s` after the first.
    pub(super) fn gain_at(&self, seed: u64, index: u64, time_s: f64) -> f64 {
        if self.blackout.is_some_and(|(from, to)| (from..to).contains(&time_s)) {
            return 0.0;
        }
        let flicker = self.flicker * Draws::new(seed, Purpose::Flicker, index).normal();
        let drift = self.exposure_drift * libm::sin(TAU * time_s / DRIFT_PERIOD_S);
        self.gain * (1.0 + flicker + drift).at_least(0.05)
    }
}

/// The sensor behind one lens, tabulated.
#[derive(Clone, Debug)]
pub(super) struct Sensor {
    width: usize,
    vignette: Vec<f32>,
    noise: NoiseTable,
    read_variance: f32,
    shot_noise: f32,
    /// Weight of each neighbour in the blur of the lens.
    blur: f32,
}

impl Sensor {
    /// Tables for one camera.
    pub(super) fn new(effects: &Effects, model: &CameraModel, seed: u64) -> Self {
        Self {
            width: model.width_px,
            vignette: vignette(model, effects.vignetting),
            noise: NoiseTable::new(seed),
            read_variance: effects.read_noise.squared() as f32,
            shot_noise: effects.shot_noise as f32,
            blur: (0.5 * effects.lens_blur_px.clamp(0.0, 0.7).squared()) as f32,
        }
    }

    /// Turns light (grey levels, overwritten) into the pixels of `camera` in frame `sequence`.
    pub(super) fn develop(
        &self,
        light: &mut [f32],
        rows: &mut [f32],
        gain: f64,
        (sequence, camera): (u64, usize),
        out: &mut [u8],
    ) {
        if self.blur > 0.0 {
            blur(light, rows, self.width, self.blur);
        }
        let gain = gain as f32;
        let noisy = self.read_variance > 0.0 || self.shot_noise > 0.0;
        let runs = light.chunks(NOISE_RUN).zip(self.vignette.chunks(NOISE_RUN));
        let runs = runs.zip(self.noise.runs(sequence, camera));
        for (((light, vignette), noise), out) in runs.zip(out.chunks_mut(NOISE_RUN)) {
            for (((pixel, light), vignette), noise) in out.iter_mut().zip(light).zip(vignette).zip(noise) {
                let level = light * vignette * gain;
                let noise =
                    if noisy { noise * (self.read_variance + self.shot_noise * level).sqrt() } else { 0.0 };
                *pixel = truncated(level + noise + 0.5);
            }
        }
    }
}

/// The whole part of a grey level, kept within 0 to 255. `x as u8` would be made pixel by pixel, since it saturates; the
/// last bits of a number that is added to one whose last bit is worth one are those of the whole number.
#[inline]
fn truncated(level: f32) -> u8 {
    const ONES: f32 = 8_388_608.0;
    (level.at_least(0.0).at_most(255.0).floor() + ONES).to_bits() as u8
}

/// Share of the light per pixel: falls with the fourth power of the distance from the image's centre,
/// as a lens that is stopped down.
fn vignette(model: &CameraModel, loss: f64) -> Vec<f32> {
    let (width, height) = (model.width_px, model.height_px);
    let centre = Vector2::new(width as f64 - 1.0, height as f64 - 1.0) * 0.5;
    let farthest = centre.norm_squared().at_least(1.0);
    let share = |u: usize, v: usize| {
        let r2 = (Vector2::new(u as f64, v as f64) - centre).norm_squared() / farthest;
        (1.0 - loss * r2 * (0.5 + 0.5 * r2)) as f32
    };
    (0..height).flat_map(|v| (0..width).map(move |u| (u, v))).map(|(u, v)| share(u, v)).collect()
}

/// Binomial blur in place: each neighbour weighs `weight` in each direction. `rows` holds two rows.
fn blur(light: &mut [f32], rows: &mut [f32], width: usize, weight: f32) {
    let centre = 1.0 - 2.0 * weight;
    let (previous, current) = rows.split_at_mut(width);
    let height = light.len() / width;
    previous.copy_from_slice(&light[..width]);
    for v in 0..height {
        current.copy_from_slice(&light[v * width..(v + 1) * width]);
        let (head, tail) = light.split_at_mut((v + 1) * width);
        let row = &mut head[v * width..];
        let below: &[f32] = if v + 1 < height { &tail[..width] } else { current };
        for (((out, &above), &at), &under) in row.iter_mut().zip(&*previous).zip(&*current).zip(below) {
            *out = centre * at + weight * (above + under);
        }
        previous.copy_from_slice(current);
    }
    for row in light.chunks_exact_mut(width) {
        current.copy_from_slice(row);
        for (out, near) in row[1..].iter_mut().zip(current.windows(3)) {
            *out = centre * near[1] + weight * (near[0] + near[2]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture;

    fn sensor(effects: &Effects, seed: u64) -> Sensor {
        Sensor::new(effects, &fixture::config().camera[0].model(), seed)
    }

    fn developed(sensor: &Sensor, level: f32, stream: u64) -> Vec<u8> {
        let mut light = vec![level; 752 * 480];
        let mut out = vec![0; light.len()];
        sensor.develop(&mut light, &mut [0.0; 2 * 752], 1.0, (stream, 0), &mut out);
        out
    }

    #[test]
    fn noise_has_the_promised_variance_and_differs_by_frame_and_seed() {
        let effects = Effects { read_noise: 1.0, shot_noise: 0.02, ..Effects::none() };
        let image = developed(&sensor(&effects, 5), 100.0, 1);
        let mean = image.iter().map(|&p| f64::from(p)).sum::<f64>() / image.len() as f64;
        let variance = image.iter().map(|&p| (f64::from(p) - mean).powi(2)).sum::<f64>() / image.len() as f64;
        // Rounding to grey levels adds 1/12.
        assert!((mean - 100.0).abs() < 0.05 && (variance - 3.083).abs() < 0.15, "{mean} {variance}");
        assert_eq!(image, developed(&sensor(&effects, 5), 100.0, 1));
        assert_ne!(image, developed(&sensor(&effects, 5), 100.0, 2));
        assert_ne!(image, developed(&sensor(&effects, 6), 100.0, 1));
    }

    #[test]
    fn noise_is_white_from_row_to_row() {
        let effects = Effects { read_noise: 2.0, ..Effects::none() };
        let image = developed(&sensor(&effects, 5), 100.0, 1);
        let value = |i: usize| f64::from(image[i]) - 100.0;
        for lag in [1, 2, 32, 752, 753] {
            let products: f64 = (0..image.len() - lag).map(|i| value(i) * value(i + lag)).sum();
            let correlation = products / (image.len() as f64 * 4.0);
            assert!(correlation.abs() < 0.02, "lag {lag}: {correlation}");
        }
    }
}
