//! Samples and images that are bit for bit those before: no sensor measures the same twice.

use crate::verdict::{Fitness, Measure};
use plumbline_config::{ImageView, ImuSample};

/// Name of the measure.
pub const NAME: &str = "repeated data";
/// Share of samples or images that repeat.
const SHARE: (f64, f64) = (0.005, 0.1);

/// Counts of images.
#[derive(Clone, Debug, Default)]
pub(crate) struct Repeats {
    last: [Vec<u8>; 2],
    seen: [u64; 2],
    repeated: [u64; 2],
}

impl Repeats {
    /// Takes the images of a frame.
    pub(crate) fn add(&mut self, images: &[Option<ImageView<'_>>; 2]) {
        for (camera, image) in images.iter().enumerate() {
            let Some(image) = image else { continue };
            let last = &mut self.last[camera];
            let width = image.width().max(1);
            let is_same = self.seen[camera] > 0
                && last.len() == width * image.height()
                && last.chunks_exact(width).zip(image.rows()).all(|(before, now)| before == now);
            self.seen[camera] += 1;
            self.repeated[camera] += u64::from(is_same);
            if !is_same {
                last.clear();
                image.rows().for_each(|row| last.extend_from_slice(row));
            }
        }
    }

    /// Repeats without so many of each camera, which are explained otherwise.
    pub(crate) fn without(&self, explained: [usize; 2]) -> Self {
        let left = |camera: usize| self.repeated[camera].saturating_sub(explained[camera] as u64);
        Self { repeated: [left(0), left(1)], seen: self.seen, last: Default::default() }
    }

    /// True if so many images repeat that motion cannot be measured.
    pub(crate) fn is_grave(&self) -> bool {
        self.share() > SHARE.1
    }

    /// Share of the worse camera.
    fn share(&self) -> f64 {
        let of = |camera: usize| self.repeated[camera] as f64 / self.seen[camera].max(1) as f64;
        of(0).max(of(1))
    }

    /// Judges images and samples; `None` where nothing repeats that is worth a line.
    pub(crate) fn judge(&self, samples: &[ImuSample]) -> Option<Measure> {
        let is_same = |pair: &&[ImuSample]| pair[0].gyro == pair[1].gyro && pair[0].accel == pair[1].accel;
        let of_samples = samples.windows(2).filter(is_same).count();
        let share_of_samples = of_samples as f64 / samples.len().max(1) as f64;
        let worst = Fitness::within(self.share(), SHARE.0, SHARE.1).max(Fitness::within(
            share_of_samples,
            SHARE.0,
            SHARE.1,
        ));
        if worst <= Fitness::Good {
            return None;
        }
        let [left, right] = self.repeated;
        let value = format!(
            "bit for bit the one before: {left} of {} left images, {right} of {} right images, {of_samples} of {} samples",
            self.seen[0],
            self.seen[1],
            samples.len()
        );
        let figures = [
            ("left_repeated", left as f64),
            ("right_repeated", right as f64),
            ("samples_repeated", of_samples as f64),
        ];
        let mut cures = Vec::new();
        if self.share() > SHARE.0 {
            cures.push(
                "the driver hands out images twice: hand out each image once, with its own stamp; for a simulator without noise set \
                 `estimator.health.refuse_repeated_images = false`",
            );
        }
        if share_of_samples > SHARE.0 {
            cures.push(
                "the driver hands out samples twice, or at a rate above that of the sensor: read the sensor at its own rate; for a \
                 simulator without noise set `imu.stuck_after_s = 0`",
            );
        }
        Some(Measure::new(NAME, worst, value, cures.join("; "), &figures))
    }
}
