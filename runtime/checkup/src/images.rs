//! Tests on the images alone: black, interlaced, with marks that stay.
//!
//! Black and interlaced ones are a share of the frames, by camera; where only even or only odd frames have it, that is reported. A row
//! of one half-frame differs more from its neighbours than from the rows two away; a mark keeps its gradient while the scene changes
//! below it. Images that are missing or repeat are told by the health bits of the flight.

use crate::verdict::{Fitness, Measure};
use plumbline_config::{ImageView, Timestamp};

/// Share of frames with a fault that a flight bears.
const BORNE: f64 = 0.01;
/// Brightest twentieth of an image that is dark, grey level.
const DARK: f64 = 30.0;
/// Every pixel so far from the next is looked at.
const STRIDE: usize = 3;
/// Rows differ from their neighbours by so much more than from those two away where half-frames are of two times.
const COMB: f64 = 1.1;
/// Images are compared for marks where they have changed by this share of their contrast, and so many of them at least: by chance
/// 1 in 2000 pixels then keeps its gradient.
const CHANGED: f64 = 0.5;
const LEAST_COMPARED: f64 = 16.0;
/// Gradient of a mark, grey levels; share of it that stays; share of the pixels.
const MARK: (f32, f32, f64) = (6.0, 0.75, 0.005);

/// One camera's images.
#[derive(Default)]
struct Eye {
    /// Frames that are black, and that are interlaced.
    black: Vec<usize>,
    combed: Vec<usize>,
    /// Image that was compared last, with the sums of the gradients of all, and of their squares.
    compared: Vec<u8>,
    sums: Vec<(f32, f32)>,
    count: f64,
}

/// Images of both cameras.
#[derive(Default)]
pub(crate) struct ImageTests {
    eyes: [Eye; 2],
    stamps: Vec<Timestamp>,
}

impl Eye {
    fn add(&mut self, frame: usize, image: &ImageView<'_>) {
        let (width, height) = (image.width(), image.height());
        let (mut counts, mut pixels) = ([0_u32; 256], Vec::with_capacity(width * height / STRIDE));
        let (mut comb, mut smooth) = (0_u64, 0_u64);
        for y in 0..height {
            let row = image.row(y);
            let near = [1, 2].map(|d| (image.row(y.saturating_sub(d)), image.row((y + d).min(height - 1))));
            for x in (y % STRIDE..width).step_by(STRIDE) {
                let grey = row[x];
                counts[usize::from(grey)] += 1;
                pixels.push(grey);
                let bend = |(a, b): (&[u8], &[u8])| {
                    (2 * i64::from(grey) - i64::from(a[x]) - i64::from(b[x])).unsigned_abs()
                };
                comb += bend(near[0]);
                smooth += bend(near[1]);
            }
        }
        let level = |share: f64| {
            let mut below = 0;
            let at = counts.iter().position(|count| {
                below += count;
                f64::from(below) >= share * pixels.len() as f64
            });
            at.unwrap_or(0) as f64
        };
        self.black.extend((level(0.95) < DARK).then_some(frame));
        self.combed.extend((comb as f64 > COMB * smooth as f64).then_some(frame));
        let contrast = level(0.9) - level(0.1);
        if self.compared.is_empty() || change(&self.compared, &pixels) > CHANGED * 0.5 * contrast {
            self.compare(image);
            self.compared = pixels;
        }
    }

    /// Adds the gradients along the rows.
    fn compare(&mut self, image: &ImageView<'_>) {
        let columns = image.width() / 2 - 1;
        self.sums.resize(columns * (image.height() / 2), (0.0, 0.0));
        for (k, (sum, square)) in self.sums.iter_mut().enumerate() {
            let (x, row) = (2 * (k % columns), image.row(2 * (k / columns)));
            let gradient = f32::from(row[x + 2]) - f32::from(row[x]);
            *sum += gradient;
            *square += gradient * gradient;
        }
        self.count += 1.0;
    }

    /// Share of the pixels that hold marks.
    fn marks(&self) -> f64 {
        if self.count < LEAST_COMPARED {
            return 0.0;
        }
        let n = self.count as f32;
        let is_mark = |(sum, square): &&(f32, f32)| {
            *square > n * MARK.0 * MARK.0 && sum * sum > MARK.1 * MARK.1 * n * square
        };
        self.sums.iter().filter(is_mark).count() as f64 / self.sums.len().max(1) as f64
    }
}

/// Mean difference of two images, grey levels; nothing where there is no first one.
fn change(before: &[u8], now: &[u8]) -> f64 {
    let sum: u64 = before.iter().zip(now).map(|(a, b)| u64::from(a.abs_diff(*b))).sum();
    sum as f64 / before.len().max(1) as f64
}

impl ImageTests {
    /// Takes the images of a frame.
    pub(crate) fn add(&mut self, stamp: Timestamp, images: &[Option<ImageView<'_>>; 2]) {
        for (eye, image) in self.eyes.iter_mut().zip(images) {
            image.iter().for_each(|image| eye.add(self.stamps.len(), image));
        }
        self.stamps.push(stamp);
    }

    /// Faults of the images of so many cameras.
    pub(crate) fn judge(&self, cameras: usize) -> Vec<Measure> {
        let mut measures = Vec::new();
        for (eye, side) in self.eyes.iter().zip(["left", "right"]).take(cameras) {
            let kinds = [
                ("black images", &eye.black, "look at light, exposure, strobe, lens cap and cable"),
                (
                    "interlaced images",
                    &eye.combed,
                    "odd and even lines are half-frames of two times: use a progressive mode, or every second line alone",
                ),
            ];
            let found = kinds.into_iter().filter(|(_, frames, _)| !frames.is_empty());
            measures.extend(found.map(|(name, frames, cure)| self.measure(name, side, frames, cure)));
            let marks = eye.marks();
            if marks > MARK.2 {
                let value = format!(
                    "{:.1} % of the {side} image stay at the same place while the scene moves",
                    100.0 * marks
                );
                let cure =
                    "clean the lens, switch the overlay off, or mask what stays (`plumbline-lab mask`)";
                let figures = [("share", marks)];
                measures.push(Measure::new("marks in the image", Fitness::NotFit, value, cure, &figures));
            }
        }
        measures
    }

    fn measure(&self, name: &'static str, side: &str, frames: &[usize], cure: &str) -> Measure {
        let share = frames.len() as f64 / self.stamps.len().max(1) as f64;
        let odd = frames.iter().filter(|k| *k % 2 == 1).count() as f64 / frames.len() as f64;
        let turn = if !(0.1..=0.9).contains(&odd) && share > 0.2 { ", every second frame" } else { "" };
        let at = |k: usize| self.stamps[k].seconds_since(self.stamps[0]);
        let (from, to) = (at(frames[0]), at(frames[frames.len() - 1]));
        let verdict = if share > BORNE { Fitness::NotFit } else { Fitness::Mind };
        let value = format!(
            "{side}: {} of {} frames{turn} ({from:.1} to {to:.1} s)",
            frames.len(),
            self.stamps.len()
        );
        Measure::new(name, verdict, value, cure, &[("share", share), ("from_s", from), ("to_s", to)])
    }
}
