//! Exposure: images too dark or burnt out, and the blur of a turn.

use crate::statistics::{median, quantile};
use crate::thumbnail::Thumbnail;
use crate::verdict::{Fitness, Measure};
use plumbline_config::{Config, ImuSample};

/// Grey level of the brightest twentieth of a well exposed image is at least this, of one that can be used the other.
const DARK: (f64, f64) = (70.0, 30.0);
/// A pixel from this level on is burnt out, and this share of them is minded, or too much.
const BURNT: (u8, f64, f64) = (250, 0.05, 0.5);
/// Left and right differ by this factor in their median.
const UNEQUAL: f64 = 1.6;
/// Blur by rotation, px.
const BLUR_PX: (f64, f64) = (1.5, 6.0);
/// Rates that are hardly ever exceeded.
const RATE_QUANTILE: f64 = 0.95;
/// Below this nothing can be said of blur, rad/s.
const LEAST_RATE: f64 = 0.05;

/// Brightness of the images of both cameras.
#[derive(Clone, Debug, Default)]
pub struct Brightness {
    /// Levels of each image: brightest twentieth, median, and share of saturated pixels.
    seen: [Vec<[f64; 3]>; 2],
}

impl Brightness {
    /// Takes a shrunken image of a camera.
    pub fn add(&mut self, camera: usize, image: &Thumbnail) {
        let mut counts = [0_u32; 256];
        image.pixels.iter().for_each(|grey| counts[usize::from(*grey as u8)] += 1);
        let all: u32 = counts.iter().sum();
        let level = |share: f64| {
            let mut below = 0;
            let at = counts.iter().position(|count| {
                below += count;
                f64::from(below) >= share * f64::from(all)
            });
            at.unwrap_or(0) as f64
        };
        let burnt: u32 = counts[usize::from(BURNT.0)..].iter().sum();
        self.seen[camera].push([level(0.95), level(0.5), f64::from(burnt) / f64::from(all.max(1))]);
    }

    /// Frames of the left camera that were taken.
    #[must_use]
    pub fn frames(&self) -> usize {
        self.seen[0].len()
    }

    /// Judges what was seen.
    #[must_use]
    pub fn judge(&self) -> Measure {
        const NAME: &str = "exposure";
        if self.seen.iter().all(Vec::is_empty) {
            return Measure::missing(NAME, "no image arrived", "check the cameras");
        }
        let column = |camera: usize, k: usize| {
            median(&self.seen[camera].iter().map(|figures| figures[k]).collect::<Vec<_>>())
        };
        let cameras: Vec<usize> = (0..2).filter(|camera| !self.seen[*camera].is_empty()).collect();
        let brightest = cameras.iter().map(|c| column(*c, 0)).fold(f64::INFINITY, f64::min);
        let burnt = cameras.iter().map(|c| column(*c, 2)).fold(0.0, f64::max);
        let medians: Vec<f64> = cameras.iter().map(|c| column(*c, 1).max(1.0)).collect();
        let unequal = match medians[..] {
            [left, right] => (left / right).max(right / left),
            _ => 1.0,
        };
        let verdicts = [
            (
                Fitness::within(-brightest, -DARK.0, -DARK.1),
                "dark: more light, a faster lens, more gain, or a longer exposure as far as blur allows",
            ),
            (
                Fitness::within(burnt, BURNT.1, BURNT.2),
                "burnt out: shorten the exposure, or let the camera choose it (`driver.v4l2.exposure_us = 0`)",
            ),
            (
                if unequal > UNEQUAL { Fitness::Mind } else { Fitness::Good },
                "left and right differ in brightness: give both the same fixed exposure and gain, clean the lenses",
            ),
        ];
        let worst = verdicts.into_iter().rev().max_by_key(|(verdict, _)| *verdict);
        let (verdict, cure) = worst.unwrap_or((Fitness::Good, ""));
        let value = format!(
            "brightest twentieth at {brightest:.0} of 255, {:.1} % burnt out, left and right differ by {unequal:.2}",
            100.0 * burnt
        );
        let figures = [("brightest", brightest), ("burnt_share", burnt), ("left_right_factor", unequal)];
        Measure::new(NAME, verdict, value, cure, &figures)
    }
}

/// Blur by the rotation rates of the data, for the exposure that was told, s, or the configured one; or the exposure that they
/// allow.
#[must_use]
pub fn blur(samples: &[ImuSample], config: &Config, told_s: Option<f64>) -> Measure {
    const NAME: &str = "blur";
    let rates: Vec<f64> = samples.iter().map(|sample| sample.gyro.norm()).collect();
    let rate = quantile(&rates, RATE_QUANTILE);
    let focal_px = config.camera.first().map_or(0.0, |c| 0.5 * (c.focal_px[0] + c.focal_px[1]));
    let turns = rate >= LEAST_RATE;
    if !turns {
        return Measure::missing(NAME, "the vehicle did not turn", "turn it by hand as fast as it will fly");
    }
    let allowed_ms = 1e3 * BLUR_PX.0 / (rate * focal_px);
    let exposure_s = told_s.unwrap_or(1e-6 * config.driver.v4l2.exposure_us);
    if exposure_s <= 0.0 {
        let value = format!(
            "exposure neither reported nor configured; at {rate:.2} rad/s up to {allowed_ms:.1} ms keep it below {} px",
            BLUR_PX.0
        );
        let cure = "set `driver.v4l2.exposure_us` for a known blur";
        let figures = [("rate_rad_s", rate), ("allowed_exposure_ms", allowed_ms)];
        return Measure::new(NAME, Fitness::NotMeasured, value, cure, &figures);
    }
    let px = exposure_s * rate * focal_px;
    Measure::new(
        NAME,
        Fitness::within(px, BLUR_PX.0, BLUR_PX.1),
        format!("{px:.1} px at {rate:.2} rad/s and {:.1} ms of exposure", 1e3 * exposure_s),
        format!("expose for at most {allowed_ms:.1} ms, with more light or gain; or turn more slowly"),
        &[("blur_px", px), ("rate_rad_s", rate), ("allowed_exposure_ms", allowed_ms)],
    )
}
