//! Trajectories in the TUM format: one pose a line, `t[s] x y z qx qy qz qw`.
//!
//! Times are decimal seconds in the file and integer nanoseconds here; the digits are taken as they
//! stand, never by way of a floating-point number (which has steps of 240 ns at today's Unix time).
//! Quaternions are Hamilton, scalar last.

use crate::DriverError;
use crate::text_lines::{BoundedLines, unpacked};
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};
use plumbline_config::Timestamp;
use std::fs::File;
use std::io::{BufRead, BufReader, BufWriter, Write};
use std::path::Path;

/// Digits of a time that are looked at; nine before and nine after the point are in use today.
const MAX_TIME_DIGITS: usize = 30;
/// Poses that are read: five hours at 200 Hz. A gzip of two megabytes may hold ten times as many.
const MAX_POSES: usize = 4_000_000;
/// Lines that are read, comments included.
const MAX_LINES: usize = 2 * MAX_POSES;
/// A position further away than this is none, m: figures and sums of squares stay finite.
const MAX_POSITION_M: f64 = 1e12;
/// A quaternion printed with three decimals is still normal to this.
const QUATERNION_NORM_TOLERANCE: f64 = 0.01;

/// A pose at a time: body `B` in `O`, `M` or `W`, as its holder says.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StampedPose {
    /// Measurement time.
    pub stamp: Timestamp,
    /// The pose; position in metres.
    pub pose: Isometry3<f64>,
}

/// Reads a trajectory, plain or gzip; `#` begins a comment line.
///
/// # Errors
/// When the file cannot be read, holds no pose, or has a line that is not one; the line is named.
pub fn read_tum(path: &Path) -> Result<Vec<StampedPose>, DriverError> {
    let file = File::open(path).map_err(|e| DriverError::io(path, e))?;
    read_tum_from(path, BufReader::new(file))
}

/// Reads a trajectory from `reader`; `path` names it in messages.
pub(crate) fn read_tum_from(path: &Path, reader: impl BufRead) -> Result<Vec<StampedPose>, DriverError> {
    let text = unpacked(reader).map_err(|e| DriverError::io(path, e))?;
    let mut poses = Vec::new();
    for (index, line) in BufReader::new(BoundedLines::new(text)).split(b'\n').enumerate() {
        let line = line.map_err(|e| DriverError::io(path, e))?;
        if poses.len() == MAX_POSES || index >= MAX_LINES {
            let message = format!("holds more than {MAX_POSES} poses; cut it into shorter pieces");
            return Err(DriverError::refused(path, message));
        }
        let text = str::from_utf8(&line).map(|text| text.trim_start_matches('\u{feff}').trim());
        let pose = match text {
            Ok(text) if text.is_empty() || text.starts_with('#') => continue,
            Ok(text) => parse_pose(text),
            Err(_) => Err("not text (`replay LOG --trajectory OUT.tum` writes that of a log)"),
        };
        poses.push(pose.map_err(|why| {
            let message = format!("line {}: {why}; expected `t x y z qx qy qz qw`", index + 1);
            DriverError::refused(path, message)
        })?);
    }
    if poses.is_empty() {
        return Err(DriverError::refused(path, "holds no pose; was the run that wrote it complete?"));
    }
    Ok(poses)
}

fn parse_pose(text: &str) -> Result<StampedPose, &'static str> {
    let mut fields = text.split(|c: char| c.is_whitespace() || c == ',').filter(|f| !f.is_empty());
    let stamp = fields.next().and_then(parse_seconds).ok_or("the time is not a number of seconds")?;
    let mut values = [0.0_f64; 7];
    for value in &mut values {
        let field = fields.next().ok_or("fewer than 8 columns")?;
        *value = field.parse().map_err(|_| "a column is not a number")?;
        if !value.is_finite() {
            return Err("a column is not finite");
        }
    }
    if fields.next().is_some() {
        return Err("more than 8 columns");
    }
    let [x, y, z, qx, qy, qz, qw] = values;
    if [x, y, z].iter().any(|metres| metres.abs() > MAX_POSITION_M) {
        return Err("the position is further away than 1e12 m");
    }
    let rotation = unit_quaternion(qw, qx, qy, qz).ok_or("the quaternion is not of length 1")?;
    Ok(StampedPose { stamp, pose: Isometry3::from_parts(Translation3::new(x, y, z), rotation) })
}

/// The rotation of a quaternion that is of length 1 up to the decimals of a file.
pub(crate) fn unit_quaternion(w: f64, x: f64, y: f64, z: f64) -> Option<UnitQuaternion<f64>> {
    let q = Quaternion::new(w, x, y, z);
    ((q.norm() - 1.0).abs() < QUATERNION_NORM_TOLERANCE).then(|| UnitQuaternion::new_normalize(q))
}

/// Decimal seconds as nanoseconds, exactly; further decimals are rounded half away from zero.
/// Understands `1403638538.577829376`, fewer decimals, and `1.403638538577829e+09`.
pub fn parse_seconds(text: &str) -> Option<Timestamp> {
    let (mantissa, exponent) = match text.find(['e', 'E']) {
        Some(at) => (&text[..at], text[at + 1..].parse::<i32>().ok()?),
        None => (text, 0),
    };
    let (negative, digits) = match mantissa.strip_prefix('-') {
        Some(rest) => (true, rest),
        None => (false, mantissa.strip_prefix('+').unwrap_or(mantissa)),
    };
    let (whole, fraction) = digits.split_once('.').unwrap_or((digits, ""));
    let count = whole.len() + fraction.len();
    if count == 0 || count > MAX_TIME_DIGITS {
        return None;
    }
    let mut value: i128 = 0;
    for byte in whole.bytes().chain(fraction.bytes()) {
        value = value * 10 + i128::from(char::from(byte).to_digit(10)?);
    }
    let power = exponent.checked_add(9)?.checked_sub(i32::try_from(fraction.len()).ok()?)?;
    let nanos = scale_by_power_of_ten(value, power)?;
    let nanos = i64::try_from(if negative { -nanos } else { nanos }).ok()?;
    Some(Timestamp::from_nanos(nanos))
}

/// `value * 10^power` for `value >= 0`, rounded half up.
fn scale_by_power_of_ten(value: i128, power: i32) -> Option<i128> {
    if value == 0 {
        return Some(0);
    }
    if power >= 0 {
        return value.checked_mul(10_i128.checked_pow(power.unsigned_abs())?);
    }
    match 10_i128.checked_pow(power.unsigned_abs()) {
        Some(divisor) => Some((value + divisor / 2) / divisor),
        None => Some(0),
    }
}

pub(crate) fn write_pose(out: &mut impl Write, item: &StampedPose) -> std::io::Result<()> {
    let p = item.pose.translation.vector;
    let q = item.pose.rotation.coords;
    writeln!(
        out,
        "{} {:.9} {:.9} {:.9} {:.9} {:.9} {:.9} {:.9}",
        item.stamp, p.x, p.y, p.z, q.x, q.y, q.z, q.w
    )
}

/// Writes a whole trajectory, replacing a file of that name.
///
/// # Errors
/// When the file cannot be written.
pub fn write_tum<'a>(
    path: &Path,
    poses: impl IntoIterator<Item = &'a StampedPose>,
) -> Result<(), DriverError> {
    let write = || {
        let mut file = BufWriter::new(File::create(path)?);
        poses.into_iter().try_for_each(|pose| write_pose(&mut file, pose))?;
        file.flush()
    };
    write().map_err(|e| DriverError::io(path, e))
}

#[cfg(test)]
#[path = "tum_tests.rs"]
mod tests;
