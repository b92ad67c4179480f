//! Records as messages of the log, and back. Nothing is rounded; what does not fit is refused with a reason.

use crate::fields::{About, NO_MESSAGE, Parts, Record, Shape, Value};
use prost::bytes::Buf;
use prost::encoding::{
    DecodeContext, WireType, decode_key, decode_varint, encode_key, encode_varint, skip_field,
};

/// Numbers of a field at most: a covariance.
const MAX_NUMBERS: usize = 81;
/// Rows and columns of a covariance.
const ROWS: usize = 9;

/// Message of `record`.
pub fn encode(record: &dyn Parts) -> Vec<u8> {
    let mut bytes = Vec::new();
    append(record, &mut bytes);
    bytes
}

/// Appends the message of `record`: its fields in the order of their numbers, without those that are 0.
pub fn append(record: &dyn Parts, to: &mut Vec<u8>) {
    for (tag, (about, value)) in numbered(record) {
        append_value(tag, about.shape, value, to);
    }
}

/// Message of `record` with no more of a covariance than its diagonal.
pub fn encode_brief(record: &dyn Parts) -> Vec<u8> {
    let mut bytes = Vec::new();
    for (tag, (about, value)) in numbered(record) {
        match (about.shape, value) {
            (Shape::Covariance, Value::Floats([numbers, _])) => {
                let diagonal: heapless::Vec<f64, ROWS> = numbers.iter().step_by(ROWS + 1).copied().collect();
                append_value(tag, Shape::Floats, Value::floats(&diagonal), &mut bytes);
            }
            (shape, value) => append_value(tag, shape, value, &mut bytes),
        }
    }
    bytes
}

/// Fields of a record in the order of their numbers.
fn numbered(record: &dyn Parts) -> impl Iterator<Item = (u32, (&'static About, Value<'_>))> {
    (1..=record.last_tag()).filter_map(|tag| Some((tag, record.field(tag)?)))
}

fn append_value(tag: u32, shape: Shape, value: Value<'_>, to: &mut Vec<u8>) {
    match value {
        Value::Whole(number) => {
            let number = match shape {
                Shape::Sint32 => ((number << 1) ^ (number >> 63)) as u32 as u64,
                Shape::Enumerator(of) => (number + of.first) as u64,
                _ => number as u64,
            };
            if number != 0 {
                encode_key(tag, WireType::Varint, to);
                encode_varint(number, to);
            }
        }
        Value::Floats([[number], []]) if shape == Shape::Double => {
            if *number != 0.0 {
                encode_key(tag, WireType::SixtyFourBit, to);
                to.extend(number.to_le_bytes());
            }
        }
        Value::Floats([[], []])
        | Value::Bytes([])
        | Value::Singles([])
        | Value::Text("")
        | Value::Missing => {}
        Value::Floats([first, second]) if shape == Shape::Singles => {
            encode_key(tag, WireType::LengthDelimited, to);
            encode_varint(4 * (first.len() + second.len()) as u64, to);
            first.iter().chain(second).for_each(|number| to.extend((*number as f32).to_le_bytes()));
        }
        Value::Singles(numbers) => {
            encode_key(tag, WireType::LengthDelimited, to);
            encode_varint(4 * numbers.len() as u64, to);
            numbers.iter().for_each(|number| to.extend(number.to_le_bytes()));
        }
        Value::Text(text) => append_bytes(tag, text.as_bytes(), to),
        Value::Items(items) => (0..items.count()).for_each(|at| append_item(tag, items.item(at), to)),
        Value::Floats([first, second]) => {
            encode_key(tag, WireType::LengthDelimited, to);
            encode_varint(8 * (first.len() + second.len()) as u64, to);
            first.iter().chain(second).for_each(|number| to.extend(number.to_le_bytes()));
        }
        Value::Bytes(bytes) => append_bytes(tag, bytes, to),
        Value::Part(part) => append_bytes(tag, &encode(part), to),
    }
}

/// Appends an item of a list, which is there also where it is empty.
fn append_item(tag: u32, item: Value<'_>, to: &mut Vec<u8>) {
    match item {
        Value::Text(text) => append_bytes(tag, text.as_bytes(), to),
        Value::Part(part) => append_bytes(tag, &encode(part), to),
        _ => {}
    }
}

fn append_bytes(tag: u32, bytes: &[u8], to: &mut Vec<u8>) {
    encode_key(tag, WireType::LengthDelimited, to);
    encode_varint(bytes.len() as u64, to);
    to.extend(bytes);
}

/// Record of a message.
///
/// # Errors
/// When the bytes are no message that a recorder writes: what is wrong, in words.
pub fn decode<T: Record>(bytes: &[u8]) -> Result<T, &'static str> {
    let mut record = T::default();
    fill(&mut record, bytes)?;
    Ok(record)
}

/// Fills a record that has just begun.
fn fill(record: &mut dyn Parts, mut bytes: &[u8]) -> Result<(), &'static str> {
    let mut seen = 0u64;
    while bytes.has_remaining() {
        let (tag, wire) = decode_key(&mut bytes).map_err(|_| NO_MESSAGE)?;
        if record.field(tag).is_some() {
            set(record, tag, wire, &mut bytes)?;
            seen |= 1 << tag;
        } else {
            // Of a later version.
            skip_field(wire, tag, &mut bytes, DecodeContext::default()).map_err(|_| NO_MESSAGE)?;
        }
    }
    for tag in (1..=record.last_tag()).filter(|tag| seen & (1 << tag) == 0) {
        let is_double = record.field(tag).is_some_and(|(about, _)| about.shape == Shape::Double);
        record.put(tag, if is_double { Value::floats(&[0.0]) } else { Value::Missing })?;
    }
    Ok(())
}

/// Reads a field.
fn set(record: &mut dyn Parts, tag: u32, wire: WireType, bytes: &mut &[u8]) -> Result<(), &'static str> {
    let Some((About { shape, .. }, value)) = record.field(tag) else { return Ok(()) };
    let is_list_of_singles = matches!(value, Value::Singles(_));
    match (*shape, wire) {
        (Shape::Message(_) | Shape::Messages(_), WireType::LengthDelimited) => {
            fill(record.begin_part(tag)?, delimited(bytes)?)
        }
        (Shape::Bytes | Shape::Text | Shape::Texts, WireType::LengthDelimited) => {
            record.put(tag, Value::Bytes(delimited(bytes)?))
        }
        (Shape::Singles, WireType::LengthDelimited) if is_list_of_singles => {
            record.put(tag, Value::Bytes(delimited(bytes)?))
        }
        (Shape::Singles, WireType::LengthDelimited) => {
            let (numbers, []) = delimited(bytes)?.as_chunks::<4>() else { return Err(NO_MESSAGE) };
            put_numbers(record, tag, numbers.iter().map(|number| f32::from_le_bytes(*number).into()))
        }
        (Shape::Floats | Shape::FloatsIfKnown | Shape::Covariance, WireType::LengthDelimited) => {
            let (numbers, []) = delimited(bytes)?.as_chunks::<8>() else { return Err(NO_MESSAGE) };
            put_numbers(record, tag, numbers.iter().map(|number| f64::from_le_bytes(*number)))
        }
        (Shape::Double, WireType::SixtyFourBit) => {
            let (number, rest) = bytes.split_first_chunk::<8>().ok_or(NO_MESSAGE)?;
            *bytes = rest;
            record.put(tag, Value::floats(&[f64::from_le_bytes(*number)]))
        }
        (shape, WireType::Varint) if shape.is_whole() => {
            let number = decode_varint(bytes).map_err(|_| NO_MESSAGE)?;
            let number = match shape {
                Shape::Uint32 => i64::from(number as u32),
                Shape::Sint32 => i64::from((number as u32 >> 1) as i32 ^ -(number as i32 & 1)),
                Shape::Enumerator(of) => i64::from(number as i32) - of.first,
                Shape::Flag => i64::from(number != 0),
                _ => number as i64,
            };
            record.put(tag, Value::Whole(number))
        }
        _ => Err(NO_MESSAGE),
    }
}

/// Writes the few numbers that a field of a record has.
fn put_numbers(
    record: &mut dyn Parts,
    tag: u32,
    numbers: impl Iterator<Item = f64>,
) -> Result<(), &'static str> {
    let mut all = heapless::Vec::<f64, MAX_NUMBERS>::new();
    for number in numbers {
        all.push(number).map_err(|_| "a field has too many numbers")?;
    }
    record.put(tag, Value::floats(&all))
}

/// Takes bytes behind their length.
fn delimited<'a>(bytes: &mut &'a [u8]) -> Result<&'a [u8], &'static str> {
    let length = decode_varint(bytes).map_err(|_| NO_MESSAGE)?;
    let length = usize::try_from(length).map_err(|_| NO_MESSAGE)?;
    let (field, rest) = bytes.split_at_checked(length).ok_or(NO_MESSAGE)?;
    *bytes = rest;
    Ok(field)
}
