//! Frames of a recording on their way out: which there are, which are wanted, and which are missing.

use super::EurocOptions;
use super::pairing::{FrameEntry, ImageRow, Pairing, paired};
use crate::{DriverError, Faults, StereoFrame};
use plumbline_config::Timestamp;
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

/// Frames of a recording. Each copy hands out those that are wanted.
#[derive(Clone, Debug)]
pub(crate) struct Frames<F = String> {
    all: Arc<[FrameEntry<F>]>,
    rest: Range<usize>,
    is_stereo: bool,
    last_sequence: Option<u64>,
    /// Frames that are handed out in all.
    pub(crate) expected: u64,
    /// Faults of images and stamps so far.
    pub(crate) faults: Faults,
}

impl<F: Clone> Frames<F> {
    /// The frames of `rows`, those of each camera, as far as `options` asks for them; `cure` says what to do where no images
    /// belong together.
    ///
    /// # Errors
    /// When there are none of them.
    pub(crate) fn new(
        path: &Path,
        rows: Vec<Vec<ImageRow<F>>>,
        options: &EurocOptions,
        cure: &str,
        mut faults: Faults,
    ) -> Result<Self, DriverError> {
        let is_stereo = rows.len() == 2;
        let Pairing { frames, outside } = paired(path, rows, options.pair_tolerance_s, cure)?;
        faults.unpaired += outside;
        let rest = chosen_frames(path, options, &frames)?;
        let expected = rest.len() as u64;
        Ok(Self { all: frames.into(), rest, is_stereo, last_sequence: None, expected, faults })
    }

    /// All frames of the recording.
    pub(crate) fn all(&self) -> &[FrameEntry<F>] {
        &self.all
    }

    /// Frames that are still to be handed out.
    pub(crate) fn rest(&self) -> &[FrameEntry<F>] {
        &self.all[self.rest.clone()]
    }

    /// Begins the next frame, whose images are to be read into `frame`; `None` at the end.
    pub(crate) fn begin(&mut self, frame: &mut StereoFrame) -> Option<FrameEntry<F>> {
        let entry = self.all[self.rest.next()?].clone();
        if let Some(last) = self.last_sequence.replace(entry.sequence) {
            self.faults.missing += entry.sequence - last - 1;
        }
        self.faults.unpaired += u64::from(self.is_stereo && entry.files.iter().any(Option::is_none));
        (frame.sequence, frame.stamp, frame.valid) = (entry.sequence, entry.stamp, [false; 2]);
        Some(entry)
    }
}

/// The frames within both bounds of `options`; never none.
fn chosen_frames<F>(
    root: &Path,
    options: &EurocOptions,
    frames: &[FrameEntry<F>],
) -> Result<Range<usize>, DriverError> {
    let (first, last) = frames_span(frames);
    let count_before = |s: f64| frames.partition_point(|f| f.stamp.seconds_since(first) < s);
    let within_s = count_before(options.seconds.start)..count_before(options.seconds.end);
    if within_s.is_empty() {
        let Range { start, end } = options.seconds;
        let part = match end.is_finite() {
            true => format!("{start} to {end} s"),
            false => format!("what comes after {start} s"),
        };
        let length_s = last.seconds_since(first);
        let message = format!("has {length_s:.3} s of frames, of which {part} holds none; choose others");
        return Err(DriverError::refused(root, message));
    }
    let wanted = options.frames.clone().unwrap_or(within_s.clone());
    let chosen = wanted.start.max(within_s.start)..wanted.end.min(within_s.end);
    if chosen.is_empty() {
        let message = format!(
            "has frames 0..{}, of which {}..{} holds none; choose others",
            frames.len(),
            wanted.start,
            if wanted.end == usize::MAX { String::new() } else { wanted.end.to_string() }
        );
        return Err(DriverError::refused(root, message));
    }
    Ok(chosen)
}

/// First and last stamp of `frames`.
pub(crate) fn frames_span<F>(frames: &[FrameEntry<F>]) -> (Timestamp, Timestamp) {
    let stamp = |frame: Option<&FrameEntry<F>>| frame.map_or(Timestamp::default(), |f| f.stamp);
    (stamp(frames.first()), stamp(frames.last()))
}
