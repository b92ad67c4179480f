//! The inertial samples that are handed out: those among the frames.

use super::defects::{Defect, uncovered};
use super::frames::{Frames, frames_span};
use super::imu::{EurocImu, ImuRecord};
use super::table::Table;
use crate::DriverError;
use plumbline_config::{ImuSample, Timestamp};
use std::path::Path;

/// Inertial samples are handed out from this long before the first frame, s: enough to level the IMU by.
const IMU_BEFORE_S: f64 = 1.0;
/// Inertial samples are handed out until this long after the last frame, s: well above any time offset
/// between camera and IMU.
const IMU_AFTER_S: f64 = 0.1;

/// A ratio of stamps within this share of a thousand or a million is that of their units.
const UNIT_TOLERANCE: f64 = 0.2;

/// The part of the inertial stream that belongs to the frames to be handed out, and where it does not cover all frames; `file`
/// names it in messages.
///
/// # Errors
/// When there is none.
pub(crate) fn imu_of<F: Clone>(
    file: &Path,
    table: Table<ImuSample>,
    frames: &Frames<F>,
) -> Result<(EurocImu, Vec<Defect>), DriverError> {
    let imu = ImuRecord::new(table);
    let (first, last) = frames_span(frames.rest());
    if imu.range(first, last).is_empty() {
        let (imu_first, imu_last) = imu.span().unwrap_or_default();
        let advice = other_unit(imu_last, last).unwrap_or_else(|| "do the files belong together?".into());
        let message = format!(
            "the IMU was recorded from {imu_first} to {imu_last} s, the images from {first} to {last} s: no \
             sample among them; {advice}"
        );
        return Err(DriverError::refused(file, message));
    }
    let defects = uncovered(file, &imu, frames.all());
    let range = imu.range(first.plus_seconds(-IMU_BEFORE_S), last.plus_seconds(IMU_AFTER_S));
    Ok((EurocImu::new(imu, range), defects))
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
