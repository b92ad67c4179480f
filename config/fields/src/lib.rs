//! Records as data: the fields of a type, each declared once beside it, and the value of a field in a form that every reader
//! understands.
//!
//! `#[derive(Record)]` makes the table of a type ([`Record::FIELDS`]) of the attributes of its fields ([`plumbline_keys`] has what they
//! may say). The bytes of logs, local socket and network, their schema, digests, comparisons and the columns of tables are made of these
//! by the crate `plumbline-record`.

// Derived records of this crate name it as others do.
extern crate self as plumbline_fields;

mod kept;
mod sensors;

pub use kept::set_pair;
pub use plumbline_keys::Record;
pub use sensors::{ImuReading, StampFigures};

use plumbline_config::Timestamp;

/// Finding about bytes that are no message.
pub const NO_MESSAGE: &str = "not a message of its schema";

/// Value of a field.
#[derive(Clone, Copy)]
pub enum Value<'a> {
    /// Whole number, flag, or place of an enumerator.
    Whole(i64),
    /// Real numbers in up to two runs, such as position and rotation of a pose.
    Floats([&'a [f64]; 2]),
    /// Bytes.
    Bytes(&'a [u8]),
    /// Real numbers of single precision.
    Singles(&'a [f32]),
    /// Text.
    Text(&'a str),
    /// Record inside the record.
    Part(&'a dyn Parts),
    /// List of records, or of texts.
    Items(&'a dyn Items),
    /// No value: the field is absent.
    Missing,
}

impl<'a> Value<'a> {
    /// Value of real numbers.
    pub const fn floats(numbers: &'a [f64]) -> Self {
        Self::Floats([numbers, &[]])
    }

    /// The whole number; 0 for a value of another form.
    #[must_use]
    pub const fn whole(self) -> i64 {
        match self {
            Self::Whole(number) => number,
            _ => 0,
        }
    }

    /// The real numbers, if there are `N`.
    ///
    /// # Errors
    /// `otherwise` when there is another number of them.
    pub fn numbers<const N: usize>(self, otherwise: &'static str) -> Result<[f64; N], &'static str> {
        let Self::Floats([first, second]) = self else { return Err(otherwise) };
        if first.len() + second.len() != N {
            return Err(otherwise);
        }
        let mut all = first.iter().chain(second);
        Ok(std::array::from_fn(|_| all.next().copied().unwrap_or_default()))
    }
}

/// Form of a field in the messages of the log and in fixed layouts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shape {
    /// `uint64`.
    Uint64,
    /// `int64`.
    Int64,
    /// `uint32`.
    Uint32,
    /// `sint32`; one byte in fixed layouts.
    Sint32,
    /// `bool`.
    Flag,
    /// Enumerator; one byte in fixed layouts.
    Enumerator(&'static Enumeration),
    /// `double`.
    Double,
    /// `repeated double`, which keeps a negative zero where a single field of proto3 does not.
    Floats,
    /// `repeated double`, empty while the value is unknown.
    FloatsIfKnown,
    /// 9x9 `repeated double` by columns; the upper triangle by rows in fixed layouts.
    Covariance,
    /// `repeated float`: real numbers that single precision is enough for.
    Singles,
    /// `bytes`.
    Bytes,
    /// `string`.
    Text,
    /// Message.
    Message(&'static Outline),
    /// List of messages.
    Messages(&'static Outline),
    /// `repeated string`.
    Texts,
}

impl Shape {
    /// True for whole numbers, flags and enumerators.
    #[must_use]
    pub const fn is_whole(self) -> bool {
        use Shape::{Enumerator, Flag, Int64, Sint32, Uint32, Uint64};
        matches!(self, Uint64 | Int64 | Uint32 | Sint32 | Flag | Enumerator(_))
    }
}

/// Message of a record in the schema.
#[derive(Clone, Copy, Debug)]
pub struct Outline {
    /// Its name.
    pub name: &'static str,
    /// Its comment.
    pub about: &'static str,
    /// Its fields.
    pub fields: fn() -> Vec<&'static About>,
}

impl Outline {
    /// Message of a type.
    pub const fn of<T: Record>() -> Self {
        Self {
            name: T::NAME,
            about: T::ABOUT,
            fields: || T::FIELDS.iter().map(|field| &field.about).collect(),
        }
    }
}

impl PartialEq for Outline {
    fn eq(&self, other: &Self) -> bool {
        self.name == other.name
    }
}

impl Eq for Outline {}

/// Enumeration of the schema.
#[derive(Debug, PartialEq, Eq)]
pub struct Enumeration {
    /// Its name in the schema, from the message that holds it on.
    pub name: &'static str,
    /// Number of its first enumerator, before which 0 is "unspecified".
    pub first: i64,
    /// Names in the schema, from 0 on.
    pub names: &'static [&'static str],
    /// Comment of each in the schema.
    pub about: &'static [&'static str],
}

/// Facts about a field.
#[derive(Clone, Copy, Debug)]
pub struct About {
    /// Number in messages.
    pub tag: u32,
    /// Name in the program and in comparisons.
    pub name: &'static str,
    /// Name in the schema.
    pub wire: &'static str,
    /// Comment in the schema.
    pub about: &'static str,
    /// Form.
    pub shape: Shape,
    /// Place in the digest, from 1; 0 for a field that it leaves out.
    pub digest: u8,
    /// First byte in the fixed layout of the local socket.
    pub at: Option<usize>,
    /// Place among the columns of a table, from 1, and their names; none where it is left out.
    pub columns: (u8, &'static [&'static str]),
    /// Items of a list, bytes of a text, or numbers at most, where it comes from the network; 0 for the bound of all.
    pub most: usize,
}

/// A field of `T`.
pub struct Field<T: 'static> {
    /// Facts about it in the tables.
    pub about: About,
    /// Reads it.
    pub get: fn(&T) -> Value<'_>,
    /// Reads what the digest takes in its place.
    pub get_for_digest: fn(&T) -> Value<'_>,
    /// Writes it; the error says what does not fit.
    pub set: fn(&mut T, Value<'_>) -> Result<(), &'static str>,
    /// Begins the record inside the record, or the next of its list, anew.
    pub begin: fn(&mut T) -> Result<&mut dyn Parts, &'static str>,
}

impl<T> Field<T> {
    /// A field of this number, name, and name in the schema.
    pub const fn new(
        (tag, name, wire, about): (u32, &'static str, &'static str, &'static str),
        shape: Shape,
        get: fn(&T) -> Value<'_>,
        set: fn(&mut T, Value<'_>) -> Result<(), &'static str>,
    ) -> Self {
        let about = About { tag, name, wire, about, shape, digest: 0, at: None, columns: (0, &[]), most: 0 };
        Self { about, get, get_for_digest: get, set, begin: |_| Err(NO_MESSAGE) }
    }
}

/// Type of records. Every field is still to be written to its default.
pub trait Record: Default + 'static {
    /// Name of its message in the schema.
    const NAME: &'static str;
    /// Comment in the schema.
    const ABOUT: &'static str;
    /// Its fields, in the order of the schema.
    const FIELDS: &'static [Field<Self>];
}

/// Record whose type is not known to the reader.
pub trait Parts {
    /// Largest number of its fields.
    fn last_tag(&self) -> u32;
    /// Field of this number with its value.
    fn field(&self, tag: u32) -> Option<(&'static About, Value<'_>)>;
    /// Calls `sink` with every field, in the order of the schema.
    fn visit<'a>(&'a self, sink: &mut dyn FnMut(&'static About, Value<'a>));
    /// Writes field `tag`.
    ///
    /// # Errors
    /// When the value does not fit: what is wrong, in words.
    fn put(&mut self, tag: u32, value: Value<'_>) -> Result<(), &'static str>;
    /// Begins the record in field `tag`, or the next of its list, anew.
    ///
    /// # Errors
    /// When the field is none, or the list is too long.
    fn begin_part(&mut self, tag: u32) -> Result<&mut dyn Parts, &'static str>;
}

/// Measurement time of a record: that of its field `stamp_ns`, if it has one.
pub fn stamp_of(record: &dyn Parts) -> Option<Timestamp> {
    let mut stamp = None;
    record.visit(&mut |about, value| match value {
        Value::Whole(ns) if about.wire == "stamp_ns" => stamp = Some(Timestamp::from_nanos(ns)),
        _ => {}
    });
    stamp
}

fn field_of<T: Record>(tag: u32) -> Option<&'static Field<T>> {
    T::FIELDS.iter().find(|field| field.about.tag == tag)
}

impl<T: Record> Parts for T {
    fn last_tag(&self) -> u32 {
        T::FIELDS.iter().map(|field| field.about.tag).max().unwrap_or(0)
    }

    fn field(&self, tag: u32) -> Option<(&'static About, Value<'_>)> {
        field_of::<T>(tag).map(|field| (&field.about, (field.get)(self)))
    }

    fn visit<'a>(&'a self, sink: &mut dyn FnMut(&'static About, Value<'a>)) {
        T::FIELDS.iter().for_each(|field| sink(&field.about, (field.get)(self)));
    }

    fn put(&mut self, tag: u32, value: Value<'_>) -> Result<(), &'static str> {
        field_of::<T>(tag).map_or(Ok(()), |field| (field.set)(self, value))
    }

    fn begin_part(&mut self, tag: u32) -> Result<&mut dyn Parts, &'static str> {
        field_of::<T>(tag).map_or(Err(NO_MESSAGE), |field| (field.begin)(self))
    }
}

/// List inside a record.
pub trait Items {
    /// Number of items.
    fn count(&self) -> usize;
    /// Item `at`, a part or a text.
    fn item(&self, at: usize) -> Value<'_>;
}

impl<T: FieldContent> Items for Vec<T> {
    fn count(&self) -> usize {
        self.len()
    }

    fn item(&self, at: usize) -> Value<'_> {
        self.as_slice().get(at).map_or(Value::Missing, FieldContent::get)
    }
}

/// Type of a field.
pub trait FieldContent {
    /// Its form.
    const SHAPE: Shape;
    /// Reads it.
    fn get(&self) -> Value<'_>;
    /// Writes it.
    ///
    /// # Errors
    /// When the value does not fit: what is wrong, in words.
    fn set(&mut self, _value: Value<'_>) -> Result<(), &'static str> {
        Err("a part is missing")
    }
    /// Begins the record, or the next of a list, anew.
    ///
    /// # Errors
    /// When it is none, or the list is too long.
    fn begin(&mut self) -> Result<&mut dyn Parts, &'static str> {
        Err(NO_MESSAGE)
    }
}

/// Form of what `place` points to.
pub const fn shape_of<T, P: FieldContent>(_place: fn(&T) -> &P) -> Shape {
    P::SHAPE
}
