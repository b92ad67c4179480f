//! Images made to cost as much as they can: noise, checkerboards, stripes, and nothing at all.
//!
//! No two frames go together, so that every track is lost and every cell looks for a corner anew.

use plumbline_config::{GrayImage, Timestamp};
use plumbline_drivers::{DriverError, Faults, StereoFrame, StereoSource};

/// Frames of one kind in a row.
const RUN: u64 = 20;

/// Subject of an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Pattern {
    Noise,
    FineNoise,
    Checkerboard,
    Stripes,
    Blank,
    Saturated,
}

const PATTERNS: [Pattern; 6] = [
    Pattern::Noise,
    Pattern::FineNoise,
    Pattern::Checkerboard,
    Pattern::Stripes,
    Pattern::Blank,
    Pattern::Saturated,
];

/// Hostile frames at the stamps of a simulated flight.
pub struct Adversary {
    sizes_px: [(usize, usize); 2],
    stamps: Vec<Timestamp>,
    next: usize,
    state: u64,
}

impl Adversary {
    /// A frame for each of `stamps`.
    #[must_use]
    pub fn new(sizes_px: [(usize, usize); 2], stamps: Vec<Timestamp>, seed: u64) -> Self {
        Self { sizes_px, stamps, next: 0, state: seed | 1 }
    }

    /// xorshift64*, Vigna 2016.
    fn random(&mut self) -> u64 {
        self.state ^= self.state >> 12;
        self.state ^= self.state << 25;
        self.state ^= self.state >> 27;
        self.state.wrapping_mul(0x2545_f491_4f6c_dd1d)
    }

    fn paint(&mut self, image: &mut GrayImage, pattern: Pattern) {
        let width = image.width();
        let (side, phase) = (3 + self.random() as usize % 14, self.random() as usize % 64);
        let bright = |on: bool| if on { 230u8 } else { 20 };
        let mut row_noise = 0u64;
        for k in 0..width * image.height() {
            let (x, y) = (k % width, k / width);
            image.pixels_mut()[k] = match pattern {
                Pattern::FineNoise => self.random() as u8,
                Pattern::Noise => {
                    if x % 4 == 0 && y % 4 == 0 {
                        row_noise = self.random();
                    }
                    if y % 4 == 0 { row_noise as u8 } else { image.pixels()[k - width] }
                }
                Pattern::Checkerboard => bright(((x + phase) / side + (y + phase) / side).is_multiple_of(2)),
                Pattern::Stripes => bright(((x + y / 7 + phase) / side).is_multiple_of(2)),
                Pattern::Blank => 0,
                Pattern::Saturated => 255,
            };
        }
    }
}

impl StereoSource for Adversary {
    fn next_frame(&mut self, frame: &mut StereoFrame) -> Result<bool, DriverError> {
        let Some(stamp) = self.stamps.get(self.next).copied() else { return Ok(false) };
        frame.sequence = self.next as u64;
        frame.stamp = stamp;
        let pattern = PATTERNS[(frame.sequence / RUN) as usize % PATTERNS.len()];
        for camera in 0..2 {
            let (width, height) = self.sizes_px[camera];
            frame.valid[camera] = width > 0;
            if (frame.images[camera].width(), frame.images[camera].height()) != (width, height) {
                frame.images[camera] = GrayImage::new(width, height);
            }
            self.paint(&mut frame.images[camera], pattern);
        }
        self.next += 1;
        Ok(true)
    }

    fn expected_frames(&self) -> Option<u64> {
        Some(self.stamps.len() as u64)
    }

    fn faults(&self) -> Faults {
        Faults::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_pattern_comes_up_and_a_seed_repeats_it() {
        let stamps: Vec<_> = (0..120).map(|k| Timestamp::from_nanos(k * 50_000_000)).collect();
        let sizes = [(32, 24), (32, 24)];
        let frames = |seed| {
            let mut source = Adversary::new(sizes, stamps.clone(), seed);
            let mut frame = StereoFrame::new(sizes);
            let mut all = Vec::new();
            while source.next_frame(&mut frame).unwrap() {
                all.push(frame.images[0].pixels().to_vec());
            }
            all
        };
        let first = frames(3);
        assert_eq!(first.len(), 120);
        assert_eq!(first, frames(3));
        assert_ne!(first[0], first[1]);
        assert!(first[80].iter().all(|p| *p == 0) && first[100].iter().all(|p| *p == 255));
    }
}
