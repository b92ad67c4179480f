//! Tests on the images alone: black, burnt out, frozen, interlaced, with marks that stay or bars.
//!
//! Each is a share of the frames, by camera; where only even or only odd frames have it, that is reported. A row of one half-frame
//! differs more from its neighbours than from the rows two away; a mark keeps its gradient while the scene changes below it.

use crate::statistics::quantile;
use crate::verdict::{Fitness, Measure};
use plumbline_config::{ImageView, Timestamp};
use plumbline_estimator::HealthBits;

/// Share of frames with a fault that a flight bears.
const BORNE: f64 = 0.01;
/// Brightest twentieth of an image that is dark, grey level.
const DARK: f64 = 30.0;
/// Level from which a pixel is burnt out, and share of such pixels of an image that is.
const BURNT: (u8, f64) = (250, 0.5);
/// Every pixel so far from the next is looked at.
const STRIDE: usize = 3;
/// Rows differ from their neighbours by so much more than from those two away where half-frames are of two times.
const COMB: f64 = 1.1;
/// An image stands still where it changes by this share of what it usually does, and frames in a row that it takes.
const STILL: (f64, usize) = (0.3, 5);
/// Images are compared for marks where they have changed by this share of their contrast, and so many of them at least: by chance
/// 1 in 2000 pixels then keeps its gradient.
const CHANGED: f64 = 0.5;
const LEAST_COMPARED: f64 = 16.0;
/// Gradient of a mark, grey levels; share of it that stays; share of the pixels.
const MARK: (f32, f32, f64) = (6.0, 0.75, 0.005);
/// Rows and columns at the edge that never change are bars from this share of the image on, grey levels.
const BARS: (f64, u8) = (0.03, 6);

/// Bits of a flight of images that repeat, left and right.
pub(crate) const FROZEN: [HealthBits; 2] = [HealthBits::LEFT_FROZEN, HealthBits::RIGHT_FROZEN];

/// Faults of an image, with their cures.
const FAULTS: [(&str, &str); 4] = [
    ("black images", "look at light, exposure, strobe, lens cap and cable"),
    ("burnt-out images", "shorten the exposure"),
    ("frozen images", "look at cable, driver and load of the camera, and restart it"),
    (
        "interlaced images",
        "odd and even lines are half-frames of two times: use a progressive mode, or every second line alone",
    ),
];

/// Place of the fault that a camera shows too which stands still while the other one changes.
const REPEATED: usize = 2;

/// What is found of a frame of one camera: difference from the frame before, not a number without an image, and faults.
#[derive(Clone, Copy, Debug)]
struct Look {
    change: f64,
    has: [bool; FAULTS.len()],
}

/// One camera's images.
#[derive(Default)]
struct Eye {
    looks: Vec<Look>,
    last: Vec<u8>,
    /// Image that was compared last, with the sums of the gradients of all, and of their squares.
    compared: Vec<u8>,
    sums: Vec<(f32, f32)>,
    count: f64,
    /// Least and largest level of each row and column.
    rows: Vec<(u8, u8)>,
    columns: Vec<(u8, u8)>,
}

/// Images of both cameras.
#[derive(Default)]
pub(crate) struct ImageTests {
    eyes: [Eye; 2],
    stamps: Vec<Timestamp>,
}

impl Eye {
    fn add(&mut self, image: Option<&ImageView<'_>>, is_frozen: bool) {
        let Some(image) = image else {
            self.looks.push(Look { change: f64::NAN, has: Default::default() });
            return;
        };
        let (width, height) = (image.width(), image.height());
        let (mut counts, mut pixels) = ([0_u32; 256], Vec::with_capacity(width * height / STRIDE));
        let (mut comb, mut smooth) = (0_u64, 0_u64);
        self.rows.resize(height, (255, 0));
        self.columns.resize(width, (255, 0));
        for y in 0..height {
            let row = image.row(y);
            let near = [1, 2].map(|d| (image.row(y.saturating_sub(d)), image.row((y + d).min(height - 1))));
            for x in (y % STRIDE..width).step_by(STRIDE) {
                let grey = row[x];
                counts[usize::from(grey)] += 1;
                pixels.push(grey);
                for range in [&mut self.rows[y], &mut self.columns[x]] {
                    *range = (range.0.min(grey), range.1.max(grey));
                }
                let bend = |(a, b): (&[u8], &[u8])| {
                    (2 * i64::from(grey) - i64::from(a[x]) - i64::from(b[x])).unsigned_abs()
                };
                comb += bend(near[0]);
                smooth += bend(near[1]);
            }
        }
        let all = f64::from(counts.iter().sum::<u32>());
        let level = |share: f64| {
            let mut below = 0;
            let at = counts.iter().position(|count| {
                below += count;
                f64::from(below) >= share * all
            });
            at.unwrap_or(0) as f64
        };
        let burnt: u32 = counts[usize::from(BURNT.0)..].iter().sum();
        let (is_burnt, is_combed) = (f64::from(burnt) > BURNT.1 * all, comb as f64 > COMB * smooth as f64);
        let has = [level(0.95) < DARK, is_burnt, is_frozen, is_combed];
        self.looks.push(Look { change: change(&self.last, &pixels), has });
        let contrast = level(0.9) - level(0.1);
        if self.compared.is_empty() || change(&self.compared, &pixels) > CHANGED * 0.5 * contrast {
            self.compare(image);
            self.compared.clone_from(&pixels);
        }
        self.last = pixels;
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

    /// Share of the rows and of the columns at the edges that never change.
    fn bars(&self) -> f64 {
        let share = |lines: &[(u8, u8)]| {
            let is_bar = |line: &&(u8, u8)| line.1.saturating_sub(line.0) <= BARS.1;
            let ends =
                lines.iter().take_while(is_bar).count() + lines.iter().rev().take_while(is_bar).count();
            ends as f64 / lines.len().max(1) as f64
        };
        if self.count < LEAST_COMPARED { 0.0 } else { share(&self.rows).max(share(&self.columns)) }
    }
}

/// Mean difference of two images, grey levels; nothing where there is no first one.
fn change(before: &[u8], now: &[u8]) -> f64 {
    let sum: u64 = before.iter().zip(now).map(|(a, b)| u64::from(a.abs_diff(*b))).sum();
    sum as f64 / before.len().max(1) as f64
}

impl ImageTests {
    /// Takes the images of a frame, and what its flight found.
    pub(crate) fn add(&mut self, stamp: Timestamp, images: &[Option<ImageView<'_>>; 2], health: HealthBits) {
        self.stamps.push(stamp);
        for ((eye, image), bit) in self.eyes.iter_mut().zip(images).zip(FROZEN) {
            eye.add(image.as_ref(), health.contains(bit));
        }
    }

    /// Faults of the images.
    pub(crate) fn judge(&self, cameras: usize) -> Vec<Measure> {
        let sides: &[&str] = if cameras > 1 { &["left", "right"] } else { &["camera's"] };
        let mut measures = Vec::new();
        for (k, side) in sides.iter().enumerate() {
            let eye = &self.eyes[k];
            let still = self.still(k);
            for (fault, (name, cure)) in FAULTS.into_iter().enumerate() {
                let is_bad = |at: &usize| eye.looks[*at].has[fault] || fault == REPEATED && still[*at];
                let frames: Vec<usize> = (0..eye.looks.len()).filter(is_bad).collect();
                if !frames.is_empty() {
                    measures.push(self.measure(name, side, &frames, cure));
                }
            }
            let marks = eye.marks();
            if marks > MARK.2 {
                let value = format!(
                    "{:.1} % of the {side} image stay at the same place while the scene moves",
                    100.0 * marks
                );
                let cure =
                    "clean the lens, switch the overlay off, or mask what stays (`plumbline-lab mask`)";
                measures.push(Measure::not_fit("marks in the image", value, cure));
            }
            let bars = eye.bars();
            if bars > BARS.0 {
                let cure = "use a mode without bars; its calibration is that of the image inside of them";
                let value = format!("{:.0} % of the {side} image at its edges never change", 100.0 * bars);
                measures.push(Measure::new("bars in the image", Fitness::Mind, value, cure, &[]));
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

    /// Frames in which an image stands still while the other one changes.
    fn still(&self, camera: usize) -> Vec<bool> {
        let [own, other] = [camera, 1 - camera].map(|k| &self.eyes[k].looks);
        let [least, most] = [own, other]
            .map(|looks| quantile(&looks.iter().map(|look| look.change).collect::<Vec<_>>(), 0.5));
        let stands = own.iter().zip(other);
        let stands = stands.map(|(own, other)| own.change < STILL.0 * least && other.change > 0.5 * most);
        let stands: Vec<bool> = stands.collect();
        let runs = stands.chunk_by(|a, b| a == b);
        runs.flat_map(|run| run.iter().map(|stands| *stands && run.len() >= STILL.1)).collect()
    }
}
