//! Masks: which pixels of a camera are looked at.
//!
//! A configuration file names a picture; once it is loaded, the mask is lengths of runs, row by row, and is written as such wherever
//! the configuration is: in a flight log, which must have everything that an estimate depends on.

use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// Beginning of the text of a loaded mask.
const RUNS: &str = "runs ";
/// Most runs of a mask: what outlines of a vehicle have stays far below, and noise is above.
pub const MAX_MASK_RUNS: usize = 20_000;

/// Part of a camera's image that is ignored: parts of the vehicle, say, or the rim of the lens.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub enum Mask {
    /// A picture that has not been read yet.
    Picture(PathBuf),
    /// The pixels.
    Pixels(PixelMask),
}

impl Mask {
    /// The pixels; `None` while the picture has not been read.
    pub fn pixels(&self) -> Option<&PixelMask> {
        match self {
            Self::Picture(_) => None,
            Self::Pixels(pixels) => Some(pixels),
        }
    }
}

/// A mask as lengths of runs, row by row: the first is looked at, the second ignored, and so on.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PixelMask {
    width_px: usize,
    height_px: usize,
    runs: Vec<u32>,
}

impl PixelMask {
    /// The mask of a size, by a function that says of column and row whether they are looked at.
    pub fn of(width_px: usize, height_px: usize, is_seen: impl Fn(usize, usize) -> bool) -> Self {
        let (mut runs, mut seen, mut length) = (Vec::new(), true, 0);
        for pixel in (0..height_px).flat_map(|v| (0..width_px).map(move |u| (u, v))) {
            if is_seen(pixel.0, pixel.1) != seen {
                runs.push(length);
                (seen, length) = (!seen, 0);
            }
            length += 1;
        }
        runs.push(length);
        Self { width_px, height_px, runs }
    }

    /// Width and height, px.
    pub fn size_px(&self) -> (usize, usize) {
        (self.width_px, self.height_px)
    }

    /// Number of runs.
    pub fn run_count(&self) -> usize {
        self.runs.len()
    }

    /// Flags of the pixels, row by row: true for one that is looked at.
    pub fn pixels(&self) -> impl Iterator<Item = bool> {
        let runs = self.runs.iter().enumerate();
        runs.flat_map(|(k, length)| std::iter::repeat_n(k % 2 == 0, *length as usize))
    }

    /// Share of the pixels that is looked at.
    pub fn seen_share(&self) -> f64 {
        let seen: u64 = self.runs.iter().step_by(2).map(|length| u64::from(*length)).sum();
        seen as f64 / (self.width_px * self.height_px).max(1) as f64
    }

    /// This mask for images of another size, by the nearest pixel.
    pub fn resized(&self, width_px: usize, height_px: usize) -> Self {
        let pixels: Vec<bool> = self.pixels().collect();
        let at = |k: usize, to: usize, from: usize| ((2 * k + 1) * from / (2 * to)).min(from - 1);
        Self::of(width_px, height_px, |u, v| {
            pixels[at(v, height_px, self.height_px) * self.width_px + at(u, width_px, self.width_px)]
        })
    }

    /// A mask of the text behind [`RUNS`]; the reason where it is none.
    fn parse(text: &str) -> Result<Self, String> {
        let mut words = text.split_ascii_whitespace();
        let size = words.next().and_then(|size| size.split_once('x'));
        let number = |text: &str| text.parse::<u32>().ok().filter(|n| (1..=4096).contains(n));
        let size = size.and_then(|(width, height)| Some((number(width)?, number(height)?)));
        let Some((width, height)) = size else {
            return Err("a mask begins with its size, as 752x480".into());
        };
        let length = |word: &str| word.parse().map_err(|_| format!("`{word}` is no length of a run"));
        let runs = words.map(length).collect::<Result<Vec<u32>, String>>()?;
        if runs.len() > MAX_MASK_RUNS {
            return Err(format!("a mask has at most {MAX_MASK_RUNS} runs"));
        }
        let sum: u64 = runs.iter().map(|length| u64::from(*length)).sum();
        if sum != u64::from(width) * u64::from(height) {
            return Err(format!("the runs of the mask have {sum} pixels, and its size is {width}x{height}"));
        }
        Ok(Self { width_px: width as usize, height_px: height as usize, runs })
    }
}

impl TryFrom<String> for Mask {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        match text.strip_prefix(RUNS) {
            Some(runs) => PixelMask::parse(runs).map(Self::Pixels),
            None => Ok(Self::Picture(text.into())),
        }
    }
}

impl From<Mask> for String {
    fn from(mask: Mask) -> Self {
        match mask {
            Mask::Picture(path) => path.to_string_lossy().into_owned(),
            Mask::Pixels(mask) => {
                let size = format!("{RUNS}{}x{}", mask.width_px, mask.height_px);
                mask.runs.iter().fold(size, |text, length| text + " " + &length.to_string())
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A corner and a bar of 80 x 64 px are ignored.
    fn corner_and_bar() -> PixelMask {
        PixelMask::of(80, 64, |u, v| !((30..40).contains(&v) || u < 10 && v < 5))
    }

    #[test]
    fn a_mask_is_read_as_it_was_written() {
        for mask in
            [corner_and_bar(), PixelMask::of(64, 64, |_, _| false), PixelMask::of(64, 65, |_, _| true)]
        {
            let text = String::from(Mask::Pixels(mask.clone()));
            assert_eq!(Mask::try_from(text), Ok(Mask::Pixels(mask)));
        }
    }

    #[test]
    fn what_is_no_mask_is_refused_with_a_reason() {
        let refused = |text: &str| Mask::try_from(text.to_owned()).expect_err("is refused");
        assert!(refused("runs 64").contains("its size"));
        assert!(refused("runs 64x64 4095").contains("4095 pixels"));
        assert!(refused("runs 64x64 4000 x").contains("`x`"));
        assert!(refused(&format!("runs 64x64 {}", "0 ".repeat(MAX_MASK_RUNS + 1))).contains("at most"));
        assert_eq!(Mask::try_from("left.png".to_owned()), Ok(Mask::Picture("left.png".into())));
    }

    #[test]
    fn pixels_and_share_are_those_of_the_picture() {
        let mask = corner_and_bar();
        let pixels: Vec<bool> = mask.pixels().collect();
        assert_eq!(pixels.len(), 80 * 64);
        assert!(!pixels[9] && pixels[10] && !pixels[35 * 80 + 79] && pixels[40 * 80]);
        assert_eq!(mask.seen_share(), 1.0 - (50.0 + 800.0) / (80.0 * 64.0));
    }

    #[test]
    fn half_the_size_is_the_same_mask() {
        let half = PixelMask::of(40, 32, |u, v| !((15..20).contains(&v) || u < 5 && v < 2));
        let resized = corner_and_bar().resized(40, 32);
        let different = resized.pixels().zip(half.pixels()).filter(|(a, b)| a != b).count();
        assert!(different <= 5, "{different}");
    }
}
