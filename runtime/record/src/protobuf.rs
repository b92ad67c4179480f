//! Records as messages of the log, and back. Nothing is rounded; what does not fit is refused with a reason.

use crate::fields::{About, Field, Part, Parts, Record, Shape, Value};
use prost::bytes::Buf;
use prost::encoding::{
    DecodeContext, WireType, decode_key, decode_varint, encode_key, encode_varint, skip_field,
};

/// Numbers of a field at most: a covariance.
const MAX_NUMBERS: usize = 81;
/// Rows and columns of a covariance.
const ROWS: usize = 9;
const NO_MESSAGE: &str = "not a message of its schema";

/// Message of `record`.
#[must_use]
pub fn encode<T: Record>(record: &T) -> Vec<u8> {
    let mut bytes = Vec::new();
    append(record, &mut bytes);
    bytes
}

/// Appends the message of `record`: its fields in the order of their numbers, without those that are 0.
pub fn append<T: Record>(record: &T, to: &mut Vec<u8>) {
    for tag in 1..=T::FIELDS.len() as u32 {
        if let Some(field) = field_of::<T>(tag) {
            append_value(tag, field.about.shape, (field.get)(record), to);
        }
    }
}

/// Message of `record` with no more of a covariance than its diagonal.
#[must_use]
pub fn encode_brief<T: Record>(record: &T) -> Vec<u8> {
    let mut bytes = Vec::new();
    for tag in 1..=T::FIELDS.len() as u32 {
        let Some(field) = field_of::<T>(tag) else { continue };
        match (field.about.shape, (field.get)(record)) {
            (Shape::Covariance, Value::Floats([numbers, _])) => {
                let diagonal: heapless::Vec<f64, ROWS> = numbers.iter().step_by(ROWS + 1).copied().collect();
                append_value(tag, Shape::Floats, Value::floats(&diagonal), &mut bytes);
            }
            (shape, value) => append_value(tag, shape, value, &mut bytes),
        }
    }
    bytes
}

fn field_of<T: Record>(tag: u32) -> Option<&'static Field<T>> {
    T::FIELDS.iter().find(|field| field.about.tag == tag)
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
        Value::Part(part) => {
            let mut bytes = Vec::new();
            part.append(&mut bytes);
            append_bytes(tag, &bytes, to);
        }
    }
}

/// Appends an item of a list, which is there also where it is empty.
fn append_item(tag: u32, item: Value<'_>, to: &mut Vec<u8>) {
    match item {
        Value::Text(text) => append_bytes(tag, text.as_bytes(), to),
        Value::Part(part) => {
            let mut bytes = Vec::new();
            part.append(&mut bytes);
            append_bytes(tag, &bytes, to);
        }
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
pub fn decode<T: Record>(mut bytes: &[u8]) -> Result<T, &'static str> {
    let (mut record, mut seen) = (T::blank(), 0u64);
    while bytes.has_remaining() {
        let (tag, wire) = decode_key(&mut bytes).map_err(|_| NO_MESSAGE)?;
        match field_of::<T>(tag) {
            Some(field) => {
                set(field, &mut record, wire, &mut bytes)?;
                seen |= 1 << tag;
            }
            // Of a later version.
            None => {
                skip_field(wire, tag, &mut bytes, DecodeContext::default()).map_err(|_| NO_MESSAGE)?;
            }
        }
    }
    for field in T::FIELDS.iter().filter(|field| field.about.tag > 0 && seen & (1 << field.about.tag) == 0) {
        let absent = if field.about.shape == Shape::Double { Value::floats(&[0.0]) } else { Value::Missing };
        (field.set)(&mut record, absent)?;
    }
    Ok(record)
}

/// Reads a field.
fn set<T: Record>(
    field: &Field<T>,
    record: &mut T,
    wire: WireType,
    bytes: &mut &[u8],
) -> Result<(), &'static str> {
    let shape = field.about.shape;
    match (shape, wire) {
        (
            Shape::Bytes | Shape::Text | Shape::Texts | Shape::Message(_) | Shape::Messages(_),
            WireType::LengthDelimited,
        ) => (field.set)(record, Value::Bytes(delimited(bytes)?)),
        (Shape::Singles, WireType::LengthDelimited) => set_singles(field, record, delimited(bytes)?),
        (Shape::Floats | Shape::FloatsIfKnown | Shape::Covariance, WireType::LengthDelimited) => {
            let (numbers, []) = delimited(bytes)?.as_chunks::<8>() else { return Err(NO_MESSAGE) };
            let mut all = heapless::Vec::<f64, MAX_NUMBERS>::new();
            for number in numbers {
                all.push(f64::from_le_bytes(*number)).map_err(|_| "a field has too many numbers")?;
            }
            (field.set)(record, Value::floats(&all))
        }
        (Shape::Double, WireType::SixtyFourBit) => {
            let (number, rest) = bytes.split_first_chunk::<8>().ok_or(NO_MESSAGE)?;
            *bytes = rest;
            (field.set)(record, Value::floats(&[f64::from_le_bytes(*number)]))
        }
        (
            Shape::Bytes
            | Shape::Text
            | Shape::Texts
            | Shape::Double
            | Shape::Singles
            | Shape::Message(_)
            | Shape::Messages(_),
            _,
        )
        | (Shape::Floats | Shape::FloatsIfKnown | Shape::Covariance, _) => Err(NO_MESSAGE),
        (shape, WireType::Varint) => {
            let number = decode_varint(bytes).map_err(|_| NO_MESSAGE)?;
            let number = match shape {
                Shape::Uint32 => i64::from(number as u32),
                Shape::Sint32 => i64::from((number as u32 >> 1) as i32 ^ -(number as i32 & 1)),
                Shape::Enumerator(of) => i64::from(number as i32) - of.first,
                Shape::Flag => i64::from(number != 0),
                _ => number as i64,
            };
            (field.set)(record, Value::Whole(number))
        }
        _ => Err(NO_MESSAGE),
    }
}

/// Reads numbers of single precision: few that the record has in double precision, or a list as it is.
fn set_singles<T: Record>(field: &Field<T>, record: &mut T, bytes: &[u8]) -> Result<(), &'static str> {
    if matches!((field.get)(record), Value::Singles(_)) {
        return (field.set)(record, Value::Bytes(bytes));
    }
    let (numbers, []) = bytes.as_chunks::<4>() else { return Err(NO_MESSAGE) };
    let mut all = heapless::Vec::<f64, MAX_NUMBERS>::new();
    for number in numbers {
        all.push(f32::from_le_bytes(*number).into()).map_err(|_| "a field has too many numbers")?;
    }
    (field.set)(record, Value::floats(&all))
}

/// Takes bytes behind their length.
fn delimited<'a>(bytes: &mut &'a [u8]) -> Result<&'a [u8], &'static str> {
    let length = decode_varint(bytes).map_err(|_| NO_MESSAGE)?;
    let length = usize::try_from(length).map_err(|_| NO_MESSAGE)?;
    let (field, rest) = bytes.split_at_checked(length).ok_or(NO_MESSAGE)?;
    *bytes = rest;
    Ok(field)
}

impl<T: Record> Parts for T {
    fn visit<'a>(&'a self, sink: &mut dyn FnMut(&'static About, Value<'a>)) {
        T::FIELDS.iter().for_each(|field| sink(&field.about, (field.get)(self)));
    }

    fn put(&mut self, tag: u32, value: Value<'_>) -> Result<(), &'static str> {
        match T::FIELDS.iter().find(|field| field.about.tag == tag) {
            Some(field) => (field.set)(self, value),
            None => Ok(()),
        }
    }

    fn append(&self, to: &mut Vec<u8>) {
        append(self, to);
    }
}

/// A record inside a record, which cannot be absent.
impl<T: Record> Part for T {
    const SHAPE: Shape = Shape::Message(T::NAME);

    fn get(&self) -> Value<'_> {
        Value::Part(self)
    }

    fn set(&mut self, value: Value<'_>) -> Result<(), &'static str> {
        let Value::Bytes(bytes) = value else { return Err("a part is missing") };
        *self = decode(bytes)?;
        Ok(())
    }

    fn open(&mut self) -> Option<&mut dyn Parts> {
        Some(self)
    }
}

/// Items of a list, at most.
const MAX_ITEMS: usize = 65_536;

/// A list of records, which come one by one.
impl<T: Record> Part for Vec<T> {
    const SHAPE: Shape = Shape::Messages(T::NAME);

    fn get(&self) -> Value<'_> {
        Value::Items(self)
    }

    fn set(&mut self, value: Value<'_>) -> Result<(), &'static str> {
        if let Value::Bytes(bytes) = value {
            if self.len() >= MAX_ITEMS {
                return Err("a list is too long");
            }
            self.push(decode(bytes)?);
        }
        Ok(())
    }
}
