//! Fixed layouts of odometry and of the main part of an estimate on the local socket (`docs/local-socket.md`). Numbers are
//! little endian; what no field has is zero.

use crate::fields::{About, Parts, Record, Shape, Value};
use crate::orders::{InstantAnswer, InstantSource};
use plumbline_estimator::{Estimate, NavCovariance, Odometry};

/// Bytes of odometry.
pub const ODOMETRY_BYTES: usize = 504;
/// Bytes of the main part of an estimate.
pub const ESTIMATE_BYTES: usize = 536;
/// Bytes of a state at an instant.
pub const INSTANT_BYTES: usize = 512;
/// First byte of the time of the hand-over, ns since 1970 (i64).
const HANDED_OVER: usize = 8;
/// First byte of the health bits of the newest estimate in odometry (u32).
const HEALTH_OF_ODOMETRY: usize = 488;
/// Byte of the source in a state at an instant.
const SOURCE: usize = 504;
/// Rows and columns of a covariance: position, attitude, velocity.
const ROWS: usize = 9;

/// Appends odometry that was handed over at `handed_over_ns` (since 1970), with the health bits of the newest estimate.
pub fn put_odometry(o: &Odometry, handed_over_ns: i64, health_bits: u32, to: &mut Vec<u8>) {
    let mut bytes = [0; ODOMETRY_BYTES];
    put(o, &mut bytes);
    write(&mut bytes, HANDED_OVER, &handed_over_ns.to_le_bytes());
    write(&mut bytes, HEALTH_OF_ODOMETRY, &health_bits.to_le_bytes());
    to.extend(bytes);
}

/// Appends the main part of an estimate that was handed over at `handed_over_ns` (since 1970).
pub fn put_estimate(e: &Estimate, handed_over_ns: i64, to: &mut Vec<u8>) {
    let mut bytes = [0; ESTIMATE_BYTES];
    put(e, &mut bytes);
    write(&mut bytes, HANDED_OVER, &handed_over_ns.to_le_bytes());
    to.extend(bytes);
}

/// Appends a state at an instant that was handed over at `handed_over_ns` (since 1970).
pub fn put_instant(answer: &InstantAnswer, handed_over_ns: i64, to: &mut Vec<u8>) {
    let mut bytes = [0; INSTANT_BYTES];
    put(answer, &mut bytes);
    write(&mut bytes, HANDED_OVER, &handed_over_ns.to_le_bytes());
    bytes[SOURCE] = answer.source as u8;
    to.extend(bytes);
}

/// State at an instant and the time it was handed over, ns since 1970. Bytes beyond the layout belong to a later version.
///
/// # Errors
/// When the bytes are no state at an instant.
pub fn instant(bytes: &[u8]) -> Result<(InstantAnswer, i64), &'static str> {
    let bytes = bytes.first_chunk::<INSTANT_BYTES>().ok_or("a state at an instant is too short")?;
    let mut answer: InstantAnswer = taken(bytes)?;
    let sources = [InstantSource::Request, InstantSource::Trigger, InstantSource::List];
    answer.source = *sources.get(usize::from(bytes[SOURCE])).ok_or("an unknown source")?;
    Ok((answer, i64::from_le_bytes(read(bytes, HANDED_OVER))))
}

/// Writes every field that has a byte.
fn put(record: &dyn Parts, to: &mut [u8]) {
    record.visit(&mut |about, value| match (value, about.at) {
        (Value::Part(part), _) => put(part, to),
        (value, Some(at)) => put_value(about, value, &mut to[at..]),
        (_, None) => {}
    });
}

fn put_value(about: &About, value: Value<'_>, to: &mut [u8]) {
    match (about.shape, value) {
        (Shape::Covariance, Value::Floats([numbers, _])) => {
            let covariance = NavCovariance::from_column_slice(numbers);
            for (k, at) in upper_triangle().enumerate() {
                write(to, 8 * k, &covariance[at].to_le_bytes());
            }
        }
        // Of two numbers that are one field the layout has the first.
        (Shape::Floats, Value::Floats([[number], [_]])) => write(to, 0, &number.to_le_bytes()),
        (_, Value::Floats([first, second])) => {
            for (k, number) in first.iter().chain(second).enumerate() {
                write(to, 8 * k, &number.to_le_bytes());
            }
        }
        (shape, value) => write(to, 0, &value.whole().to_le_bytes()[..width(shape)]),
    }
}

fn write(to: &mut [u8], at: usize, bytes: &[u8]) {
    to[at..at + bytes.len()].copy_from_slice(bytes);
}

/// Bytes of a whole number.
const fn width(shape: Shape) -> usize {
    match shape {
        Shape::Uint64 | Shape::Int64 => 8,
        Shape::Uint32 => 4,
        _ => 1,
    }
}

/// Places of a covariance that are sent: the upper triangle by rows.
fn upper_triangle() -> impl Iterator<Item = (usize, usize)> {
    (0..ROWS).flat_map(|row| (row..ROWS).map(move |column| (row, column)))
}

/// Odometry and the time it was handed over, ns since 1970. Bytes beyond the layout belong to a later version.
///
/// # Errors
/// When the bytes are none.
pub fn odometry(bytes: &[u8]) -> Result<(Odometry, i64), &'static str> {
    let bytes = bytes.first_chunk::<ODOMETRY_BYTES>().ok_or("odometry is too short")?;
    let odometry = taken(bytes)?;
    Ok((odometry, i64::from_le_bytes(read(bytes, HANDED_OVER))))
}

/// Reads every field that has a byte.
fn taken<T: Record>(bytes: &[u8]) -> Result<T, &'static str> {
    let mut record = T::default();
    for field in T::FIELDS {
        let Some(at) = field.about.at else { continue };
        let from = &bytes[at..];
        match field.about.shape {
            Shape::Covariance => {
                let mut covariance = NavCovariance::zeros();
                for (k, (row, column)) in upper_triangle().enumerate() {
                    let value = f64::from_le_bytes(read(from, 8 * k));
                    (covariance[(row, column)], covariance[(column, row)]) = (value, value);
                }
                (field.set)(&mut record, Value::floats(covariance.as_slice()))?;
            }
            Shape::Floats => {
                let count = match (field.get)(&record) {
                    Value::Floats([first, second]) => first.len() + second.len(),
                    _ => 0,
                };
                let numbers: heapless::Vec<f64, ROWS> =
                    (0..count).map(|k| f64::from_le_bytes(read(from, 8 * k))).collect();
                (field.set)(&mut record, Value::floats(&numbers))?;
            }
            shape => {
                let mut number = [0; 8];
                number[..width(shape)].copy_from_slice(&from[..width(shape)]);
                let number = match shape {
                    Shape::Sint32 => i64::from(number[0] as i8),
                    _ => i64::from_le_bytes(number),
                };
                (field.set)(&mut record, Value::Whole(number))?;
            }
        }
    }
    Ok(record)
}

fn read(from: &[u8], at: usize) -> [u8; 8] {
    from[at..].first_chunk().copied().unwrap_or_default()
}
