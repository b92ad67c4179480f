//! Types that keys have.

use super::{Key, Kind, Table, Value};
use crate::camera::Distortion;
use crate::error::Violation;
use crate::options::{Mask, Mounting};
use std::path::PathBuf;

const COUNT: &str = "choose a count in the range";
const CHOOSE: &str = "choose a value in the range";

/// A number: its type, cure where there is no unit, and text.
macro_rules! numbers {
    ($($number:ty: $cure:expr, $format:literal;)*) => {$(
        impl Value for $number {
            #[cfg(feature = "toml")]
            fn text(&self) -> String {
                format!($format, self)
            }

            fn check(&self, key: &Key, at: &str, found: &mut Vec<Violation>) {
                key.check_number(*self as f64, at, $cure, found);
            }
        }
    )*};
}

numbers! {
    f64: CHOOSE, "{:?}";
    f32: CHOOSE, "{:?}";
    usize: COUNT, "{}";
    u32: COUNT, "{}";
    i64: CHOOSE, "{}";
}

/// Values without a range: type, and what of them is written.
macro_rules! plain {
    ($($plain:ty: |$value:ident| $text:expr;)*) => {$(
        impl Value for $plain {
            #[cfg(feature = "toml")]
            fn text(&self) -> String {
                let $value = self;
                $text
            }
        }
    )*};
}

plain! {
    bool: |value| value.to_string();
    String: |text| super::text_of(text);
    PathBuf: |path| super::text_of(path);
    Option<Mask>: |mask| mask.as_ref().map_or_else(|| "\"\"".into(), super::text_of);
}

impl<T: Value> Value for Vec<T> {
    fn kind() -> Kind {
        match T::kind() {
            Kind::Table(keys) => Kind::Tables(keys),
            _ => Kind::Value,
        }
    }

    #[cfg(feature = "toml")]
    fn text(&self) -> String {
        listed(self)
    }

    fn check(&self, key: &Key, at: &str, found: &mut Vec<Violation>) {
        check_elements(self, key, at, found);
    }

    #[cfg(feature = "toml")]
    fn tables(&self) -> Vec<&dyn Table> {
        self.iter().flat_map(Value::tables).collect()
    }
}

impl<T: Value, const N: usize> Value for [T; N] {
    fn kind() -> Kind {
        Kind::Row
    }

    #[cfg(feature = "toml")]
    fn text(&self) -> String {
        match T::kind() {
            Kind::Row => {
                self.iter().fold("[\n".into(), |text, row| format!("{text}    {},\n", row.text())) + "]"
            }
            _ => listed(self),
        }
    }

    fn check(&self, key: &Key, at: &str, found: &mut Vec<Violation>) {
        check_elements(self, key, at, found);
    }
}

#[cfg(feature = "toml")]
fn listed<T: Value>(values: &[T]) -> String {
    format!("[{}]", values.iter().map(Value::text).collect::<Vec<_>>().join(", "))
}

fn check_elements<T: Value>(values: &[T], key: &Key, at: &str, found: &mut Vec<Violation>) {
    for (i, value) in values.iter().enumerate() {
        value.check(key, &format!("{at}[{i}]"), found);
    }
}

impl<T: Table> Value for T {
    fn kind() -> Kind {
        Kind::Table(T::keys)
    }

    /// Nothing: a table is written key by key.
    #[cfg(feature = "toml")]
    fn text(&self) -> String {
        String::new()
    }

    fn check(&self, _: &Key, at: &str, found: &mut Vec<Violation>) {
        super::check(self, at, found);
    }

    #[cfg(feature = "toml")]
    fn tables(&self) -> Vec<&dyn Table> {
        vec![self]
    }
}

impl Value for Mounting {
    #[cfg(feature = "toml")]
    fn text(&self) -> String {
        super::text_of(self)
    }

    fn check(&self, key: &Key, at: &str, found: &mut Vec<Violation>) {
        if let Some(degrees) = self.degrees() {
            degrees.check(key, at, found);
        }
    }
}

impl Value for Distortion {
    fn kind() -> Kind {
        Kind::Variants
    }

    /// The lines of the table.
    #[cfg(feature = "toml")]
    fn text(&self) -> String {
        let mut text = format!("model = {:?}\n", self.model());
        for (name, value) in self.coefficients() {
            match name {
                "k1" => text += "# Radial coefficients.\n",
                "p1" => text += "# Tangential coefficients.\n",
                // Of the rational model: they stand behind the tangential ones.
                "k3" if text.contains("p1") => text += "# Further radial coefficients.\n",
                _ => {}
            }
            text += &format!("{name} = {value:?}\n");
        }
        text
    }
}
