//! Types that records keep: numbers, vectors, poses, covariances, texts and lists as fields.

use crate::{FieldContent, Outline, Parts, Record, Shape, Value};
use nalgebra::{Isometry3, Quaternion, SMatrix, SVector, UnitQuaternion, Vector3};
use plumbline_config::Timestamp;
use std::slice::from_ref;

/// Items of a list, at most.
const MAX_ITEMS: usize = 65_536;

/// Implements [`FieldContent`] for whole numbers. One that is absent is 0, as in proto3.
macro_rules! whole {
    ($($type:ty, $shape:ident, $get:expr, $set:expr;)*) => {$(
        impl FieldContent for $type {
            const SHAPE: Shape = Shape::$shape;

            fn get(&self) -> Value<'_> {
                let get: fn(&Self) -> i64 = $get;
                Value::Whole(get(self))
            }

            fn set(&mut self, value: Value<'_>) -> Result<(), &'static str> {
                let set: fn(i64) -> Result<Self, &'static str> = $set;
                *self = set(value.whole())?;
                Ok(())
            }
        }
    )*};
}

whole! {
    u64, Uint64, |v| *v as i64, |v| Ok(v as u64);
    u32, Uint32, |v| i64::from(*v), |v| Ok(v as u32);
    i64, Int64, |v| *v, Ok;
    i8, Sint32, |v| i64::from(*v), |v| i8::try_from(v).map_err(|_| "a quality out of range");
    bool, Flag, |v| i64::from(*v), |v| Ok(v != 0);
    Timestamp, Int64, |v| v.as_nanos(), |v| Ok(Timestamp::from_nanos(v));
}

/// Implements [`FieldContent`] for real numbers: their form, the numbers, and the value of `N` of them.
macro_rules! floats {
    ($($(#[$doc:meta])* $type:ty, $shape:ident, $get:expr, $numbers:pat, $otherwise:literal, $value:expr;)*) => {$(
        $(#[$doc])*
        impl FieldContent for $type {
            const SHAPE: Shape = Shape::$shape;

            fn get(&self) -> Value<'_> {
                let get: fn(&Self) -> Value<'_> = $get;
                get(self)
            }

            fn set(&mut self, value: Value<'_>) -> Result<(), &'static str> {
                let $numbers = value.numbers($otherwise)?;
                *self = $value;
                Ok(())
            }
        }
    )*};
}

floats! {
    f64, Floats, |v| Value::floats(from_ref(v)), [v], "not one number", v;
    Vector3<f64>, Floats, |v| Value::floats(v.as_slice()), [x, y, z], "a vector has not three numbers",
        Self::new(x, y, z);
    // Rotations as they were: normalising would change bits.
    Isometry3<f64>, Floats,
        |v| Value::Floats([v.translation.vector.as_slice(), v.rotation.coords.as_slice()]),
        [x, y, z, qx, qy, qz, qw], "a pose has not seven numbers",
        Self::from_parts(
            Vector3::new(x, y, z).into(),
            UnitQuaternion::new_unchecked(Quaternion::new(qw, qx, qy, qz)),
        );
    UnitQuaternion<f64>, Floats, |v| Value::Floats([&[], v.coords.as_slice()]), [x, y, z, w],
        "a rotation has not four numbers", Self::new_unchecked(Quaternion::new(w, x, y, z));
    /// Both ends of a line.
    [Vector3<f64>; 2], Floats, |v| Value::Floats([v[0].as_slice(), v[1].as_slice()]), [a, b, c, d, e, f],
        "a line has not six numbers", [Vector3::new(a, b, c), Vector3::new(d, e, f)];
}

/// Implements [`FieldContent`] for real numbers that may be unknown.
macro_rules! if_known {
    ($($type:ty, $initial:expr;)*) => {$(
        impl FieldContent for Option<$type> {
            const SHAPE: Shape = Shape::FloatsIfKnown;

            fn get(&self) -> Value<'_> {
                self.as_ref().map_or(Value::Missing, FieldContent::get)
            }

            fn set(&mut self, value: Value<'_>) -> Result<(), &'static str> {
                *self = match value {
                    Value::Missing | Value::Floats([[], []]) => None,
                    value => {
                        let mut known = $initial;
                        FieldContent::set(&mut known, value)?;
                        Some(known)
                    }
                };
                Ok(())
            }
        }
    )*};
}

if_known! {
    Isometry3<f64>, Isometry3::identity();
    UnitQuaternion<f64>, UnitQuaternion::identity();
    f64, 0.0;
}

/// Writes two numbers that are one field.
///
/// # Errors
/// When there are not two.
pub fn set_pair(first: &mut f64, second: &mut f64, value: Value<'_>) -> Result<(), &'static str> {
    [*first, *second] = value.numbers("a time offset has not two numbers")?;
    Ok(())
}

/// A covariance of position, attitude and velocity.
impl FieldContent for SMatrix<f64, 9, 9> {
    const SHAPE: Shape = Shape::Covariance;

    fn get(&self) -> Value<'_> {
        Value::floats(self.as_slice())
    }

    /// Nine numbers are its diagonal: what a brief message has of it.
    fn set(&mut self, value: Value<'_>) -> Result<(), &'static str> {
        *self = match value.numbers::<9>("") {
            Ok(diagonal) => Self::from_diagonal(&SVector::from(diagonal)),
            Err(_) => Self::from_column_slice(&value.numbers::<81>("a covariance has not 81 numbers")?),
        };
        Ok(())
    }
}

/// Variances of biases. Absent in logs from before there were any: those of a sensor whose biases are known.
impl FieldContent for SVector<f64, 6> {
    const SHAPE: Shape = Shape::Floats;

    fn get(&self) -> Value<'_> {
        Value::floats(self.as_slice())
    }

    fn set(&mut self, value: Value<'_>) -> Result<(), &'static str> {
        *self = match value {
            Value::Missing | Value::Floats([[], []]) => Self::zeros(),
            value => SVector::from(value.numbers::<6>("the variances of the biases are not six numbers")?),
        };
        Ok(())
    }
}

impl FieldContent for Vec<u8> {
    const SHAPE: Shape = Shape::Bytes;

    fn get(&self) -> Value<'_> {
        Value::Bytes(self)
    }

    fn set(&mut self, value: Value<'_>) -> Result<(), &'static str> {
        self.clear();
        if let Value::Bytes(bytes) = value {
            self.extend(bytes);
        }
        Ok(())
    }
}

impl FieldContent for String {
    const SHAPE: Shape = Shape::Text;

    fn get(&self) -> Value<'_> {
        Value::Text(self)
    }

    fn set(&mut self, value: Value<'_>) -> Result<(), &'static str> {
        *self = text_of(value)?;
        Ok(())
    }
}

/// Text of bytes; none where the field is absent.
fn text_of(value: Value<'_>) -> Result<String, &'static str> {
    match value {
        Value::Bytes(bytes) => Ok(str::from_utf8(bytes).map_err(|_| "a text is not UTF-8")?.to_owned()),
        _ => Ok(String::new()),
    }
}

/// Texts of a list, at most.
const MAX_TEXTS: usize = 256;

/// A list of texts, which come one by one.
impl FieldContent for Vec<String> {
    const SHAPE: Shape = Shape::Texts;

    fn get(&self) -> Value<'_> {
        Value::Items(self)
    }

    fn set(&mut self, value: Value<'_>) -> Result<(), &'static str> {
        if matches!(value, Value::Missing) {
            return Ok(());
        }
        if self.len() >= MAX_TEXTS {
            return Err("a list is too long");
        }
        self.push(text_of(value)?);
        Ok(())
    }
}

/// A list of groups of numbers, one after the other.
impl<const N: usize> FieldContent for Vec<[f32; N]> {
    const SHAPE: Shape = Shape::Singles;

    fn get(&self) -> Value<'_> {
        Value::Singles(self.as_flattened())
    }

    fn set(&mut self, value: Value<'_>) -> Result<(), &'static str> {
        self.clear();
        if let Value::Bytes(bytes) = value {
            let (numbers, []) = bytes.as_chunks::<4>() else { return Err("a number is cut short") };
            let (groups, []) = numbers.as_chunks::<N>() else {
                return Err("a group of numbers is cut short");
            };
            self.extend(groups.iter().map(|group| group.map(f32::from_le_bytes)));
        }
        Ok(())
    }
}

/// A record inside a record, which cannot be absent.
impl<T: Record> FieldContent for T {
    const SHAPE: Shape = Shape::Message(const { &Outline::of::<T>() });

    fn get(&self) -> Value<'_> {
        Value::Part(self)
    }

    fn begin(&mut self) -> Result<&mut dyn Parts, &'static str> {
        *self = T::default();
        Ok(self)
    }
}

/// A record inside a record, which may be absent.
impl<T: Record> FieldContent for Option<T> {
    const SHAPE: Shape = Shape::Message(const { &Outline::of::<T>() });

    fn get(&self) -> Value<'_> {
        self.as_ref().map_or(Value::Missing, |part| Value::Part(part))
    }

    fn set(&mut self, _: Value<'_>) -> Result<(), &'static str> {
        *self = None;
        Ok(())
    }

    fn begin(&mut self) -> Result<&mut dyn Parts, &'static str> {
        Ok(self.insert(T::default()))
    }
}

/// A list of records, which come one by one.
impl<T: Record> FieldContent for Vec<T> {
    const SHAPE: Shape = Shape::Messages(const { &Outline::of::<T>() });

    fn get(&self) -> Value<'_> {
        Value::Items(self)
    }

    /// Changes nothing: items come one by one, and none where the list is absent.
    fn set(&mut self, _: Value<'_>) -> Result<(), &'static str> {
        Ok(())
    }

    fn begin(&mut self) -> Result<&mut dyn Parts, &'static str> {
        if self.len() >= MAX_ITEMS {
            return Err("a list is too long");
        }
        Ok(self.push_mut(T::default()))
    }
}
