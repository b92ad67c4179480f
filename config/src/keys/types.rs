//! Types that keys have.

use super::{Key, Kind, Table, Value, Variant};
use crate::camera::Distortion;
use crate::error::Violation;
use crate::options::{Mask, Mounting};
use std::path::PathBuf;

const COUNT: &str = "choose a count in the range";
const CHOOSE: &str = "choose a value in the range";

/// A number: its type, kind, cure where there is no unit, and text.
macro_rules! numbers {
    ($($number:ty: $kind:ident, $cure:expr, $format:literal;)*) => {$(
        impl Value for $number {
            fn kind() -> Kind {
                Kind::$kind
            }

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
    f64: Number, CHOOSE, "{:?}";
    f32: Number, CHOOSE, "{:?}";
    usize: Count, COUNT, "{}";
    u32: Count, COUNT, "{}";
    i64: Integer, CHOOSE, "{}";
}

/// Values without a range: type, kind, and what of them is written.
macro_rules! plain {
    ($($plain:ty: $kind:ident, |$value:ident| $text:expr;)*) => {$(
        impl Value for $plain {
            fn kind() -> Kind {
                Kind::$kind
            }

            #[cfg(feature = "toml")]
            fn text(&self) -> String {
                let $value = self;
                $text
            }
        }
    )*};
}

plain! {
    bool: Switch, |value| value.to_string();
    String: Text, |text| super::text_of(text);
    PathBuf: Text, |path| super::text_of(path);
    Option<Mask>: Text, |mask| mask.as_ref().map_or_else(|| "\"\"".into(), super::text_of);
}

impl<T: Value> Value for Vec<T> {
    fn kind() -> Kind {
        Kind::List(T::kind)
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
        Kind::Array(N, T::kind)
    }

    #[cfg(feature = "toml")]
    fn text(&self) -> String {
        match T::kind() {
            Kind::Array(..) => {
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
    fn kind() -> Kind {
        Kind::WordOr(Self::UNKNOWN, <[f64; 3]>::kind)
    }

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
        const fn variant(word: &'static str, numbers: &'static [&'static str]) -> Variant {
            Variant { word, numbers }
        }
        const VARIANTS: &[Variant] = &[
            variant(Distortion::MODELS[0], &["k1", "k2", "p1", "p2"]),
            variant(Distortion::MODELS[1], &["k1", "k2", "k3", "k4"]),
            variant(Distortion::MODELS[2], &["k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"]),
            variant(Distortion::MODELS[3], &["xi", "k1", "k2", "p1", "p2"]),
            variant(Distortion::MODELS[4], &["alpha", "beta"]),
            variant(Distortion::MODELS[5], &["xi", "alpha"]),
        ];
        Kind::Variants(VARIANTS)
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
