//! Types that keys have.

use super::{Key, Kind, Table, Value};
use crate::camera::Distortion;
use crate::error::Violation;
use crate::options::{Mask, Mounting};
use serde::Serialize;
use std::path::PathBuf;

/// Values without a range.
macro_rules! plain {
    ($($plain:ty),*) => {$(impl Value for $plain {})*};
}

plain!(bool, String, PathBuf, Option<Mask>, Distortion);

macro_rules! numbers {
    ($($number:ty),*) => {$(
        impl Value for $number {
            fn check(&self, key: &Key, at: &str, found: &mut Vec<Violation>) {
                key.check_number(*self as f64, at, found);
            }
        }
    )*};
}

numbers!(f64, f32, usize, u32, i64);

impl<T: Value + Serialize> Value for Vec<T> {
    fn kind() -> Kind {
        match T::kind() {
            Kind::Table(keys) => Kind::Tables(keys),
            _ => Kind::Value,
        }
    }

    fn check(&self, key: &Key, at: &str, found: &mut Vec<Violation>) {
        check_elements(self, key, at, found);
    }

    fn tables(&self) -> Vec<&dyn Table> {
        self.iter().flat_map(Value::tables).collect()
    }
}

impl<T: Value, const N: usize> Value for [T; N]
where
    Self: Serialize,
{
    fn check(&self, key: &Key, at: &str, found: &mut Vec<Violation>) {
        check_elements(self, key, at, found);
    }
}

fn check_elements<T: Value>(values: &[T], key: &Key, at: &str, found: &mut Vec<Violation>) {
    for (i, value) in values.iter().enumerate() {
        value.check(key, &format!("{at}[{i}]"), found);
    }
}

impl<T: Table + Serialize> Value for T {
    fn kind() -> Kind {
        Kind::Table(T::keys)
    }

    fn check(&self, _: &Key, at: &str, found: &mut Vec<Violation>) {
        super::check(self, at, found);
    }

    fn tables(&self) -> Vec<&dyn Table> {
        vec![self]
    }
}

impl Value for Mounting {
    fn check(&self, key: &Key, at: &str, found: &mut Vec<Violation>) {
        if let Some(degrees) = self.degrees() {
            degrees.check(key, at, found);
        }
    }
}
