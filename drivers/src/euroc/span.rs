//! Parts of a recording that are handed out: frames within the bounds that were asked for, and the inertial samples among them.

use super::EurocOptions;
use super::imu::ImuRecord;
use super::pairing::FrameEntry;
use crate::DriverError;
use plumbline_config::Timestamp;
use std::ops::Range;
use std::path::Path;

/// Inertial samples are handed out from this long before the first frame, s: enough to level the IMU by.
const IMU_BEFORE_S: f64 = 1.0;
/// Inertial samples are handed out until this long after the last frame, s: well above any time offset
/// between camera and IMU.
const IMU_AFTER_S: f64 = 0.1;

/// A ratio of stamps within this share of a thousand or a million is that of their units.
const UNIT_TOLERANCE: f64 = 0.2;

/// The frames within both bounds of `options`; never none.
pub(crate) fn chosen_frames<F>(
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

pub(crate) fn frames_span<F>(frames: &[FrameEntry<F>]) -> (Timestamp, Timestamp) {
    let stamp = |frame: Option<&FrameEntry<F>>| frame.map_or(Timestamp::default(), |f| f.stamp);
    (stamp(frames.first()), stamp(frames.last()))
}

/// The part of the inertial stream that belongs to `frames`; `file` names it in messages.
pub(crate) fn imu_range<F>(
    file: &Path,
    imu: &ImuRecord,
    frames: &[FrameEntry<F>],
) -> Result<Range<usize>, DriverError> {
    let (first, last) = frames_span(frames);
    if !imu.range(first, last).is_empty() {
        return Ok(imu.range(first.plus_seconds(-IMU_BEFORE_S), last.plus_seconds(IMU_AFTER_S)));
    }
    let (imu_first, imu_last) = imu.span().unwrap_or_default();
    let advice = other_unit(imu_last, last).unwrap_or_else(|| "do the files belong together?".into());
    let message = format!(
        "the IMU was recorded from {imu_first} to {imu_last} s, the images from {first} to {last} s: no \
         sample among them; {advice}"
    );
    Err(DriverError::malformed(file, message))
}

/// Advice where the stamps of one sensor are in another unit than those of the other.
fn other_unit(imu: Timestamp, images: Timestamp) -> Option<String> {
    let ratio = imu.as_nanos() as f64 / images.as_nanos() as f64;
    let names = ["images", "IMU"];
    let [small, large] = if ratio > 1.0 { names } else { [names[1], names[0]] };
    let factor = if ratio > 1.0 { ratio } else { 1.0 / ratio };
    let is_near = |unit: f64| (factor / unit - 1.0).abs() < UNIT_TOLERANCE;
    let (unit, times) =
        [("microseconds", 1e3), ("milliseconds", 1e6)].into_iter().find(|(_, t)| is_near(*t))?;
    Some(format!(
        "the stamps of the {small} are {times:.0} times smaller than those of the {large}: are they in {unit}? \
         Nanoseconds are expected; multiply them by {times:.0}"
    ))
}
