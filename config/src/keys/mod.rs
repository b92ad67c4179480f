//! Keys of a configuration as data: what one declaration says ([`plumbline_keys::keys`]), for all that reads it.
//!
//! A struct of options declares its keys beside its fields, with default, range, unit and text. From there come the checks of
//! ranges ([`check`]) and the commented file of all keys ([`file`]).

#![cfg_attr(not(feature = "toml"), allow(dead_code, reason = "read by what reads and writes files"))]

#[cfg(feature = "toml")]
pub(crate) mod file;
#[cfg(all(test, feature = "toml", feature = "yaml"))]
pub(crate) mod tests;
mod types;
mod units;

pub(crate) use units::*;

use crate::error::Violation;

/// One key of a table.
#[derive(Clone, Copy)]
pub(crate) struct Key {
    pub name: &'static str,
    /// Comment of the key in a file.
    pub text: &'static str,
    pub kind: fn() -> Kind,
    /// The default, as it is written.
    pub default: Option<fn() -> String>,
    /// Smallest and largest value that is accepted: beyond it is a mistake (a wrong unit, a lost sign, a slipped digit), or more
    /// memory than a companion computer has. Inside it a value may still be a poor choice.
    pub range: Option<(f64, f64)>,
    pub unit: Option<Unit>,
    /// Cure of a value out of range, where it is not that of the unit.
    pub cure: Option<&'static str>,
    /// For experiments: it can be set, and is in no list.
    pub is_experiment: bool,
}

/// Form in which a key is written.
pub(crate) enum Kind {
    Value,
    Table(fn() -> &'static [Key]),
    /// List of tables.
    Tables(fn() -> &'static [Key]),
}

/// The value of a key as it is written in a file.
pub(crate) trait Text {
    fn text(&self) -> String;
}

impl<T: serde::Serialize> Text for T {
    #[cfg(feature = "toml")]
    fn text(&self) -> String {
        let mut text = String::new();
        if self.serialize(toml::ser::ValueSerializer::new(&mut text)).is_err() {
            return "\"\"".to_owned();
        }
        if text.starts_with("[[") {
            // The rows of a matrix stand below each other.
            return text.replace("[[", "[\n    [").replace("], [", "],\n    [").replace("]]", "],\n]");
        }
        if text.contains('.') { file::short(text) } else { text }
    }

    #[cfg(not(feature = "toml"))]
    fn text(&self) -> String {
        String::new()
    }
}

/// A value that a key can have.
pub(crate) trait Value: Text {
    fn kind() -> Kind
    where
        Self: Sized,
    {
        Kind::Value
    }

    /// Refuses what is out of the key's range; `at` is the key's path.
    fn check(&self, _key: &Key, _at: &str, _found: &mut Vec<Violation>) {}

    /// The tables that this value consists of.
    fn tables(&self) -> Vec<&dyn Table> {
        Vec::new()
    }
}

/// A table of keys: made by `#[keys]`.
pub(crate) trait Table {
    fn keys() -> &'static [Key]
    where
        Self: Sized;

    /// The values, in the order of the keys.
    fn values(&self) -> Vec<&dyn Value>;
}

/// Path of a key in the table at `at`.
pub(crate) fn joined(at: &str, key: &str) -> String {
    if at.is_empty() { key.to_owned() } else { format!("{at}.{key}") }
}

/// Every number of the table out of its range; `at` is the table's path.
pub(crate) fn check<T: Table>(table: &T, at: &str, found: &mut Vec<Violation>) {
    for (key, value) in T::keys().iter().zip(table.values()) {
        value.check(key, &joined(at, key.name), found);
    }
}

impl Key {
    /// A required key of a type, of any value.
    pub const fn of<T: Value>(name: &'static str, text: &'static str) -> Self {
        let kind = T::kind;
        Self { name, text, kind, default: None, range: None, unit: None, cure: None, is_experiment: false }
    }

    /// Refuses a number out of the range, by the key's cure, or that of its unit.
    fn check_number(&self, value: f64, at: &str, found: &mut Vec<Violation>) {
        let Some((low, high)) = self.range else { return };
        // NaN lies in no range.
        if !(low..=high).contains(&value) {
            let cure = self.cure.or(self.unit.map(|unit| unit.cure)).unwrap_or("choose a value in the range");
            found.push(Violation::new(at, format!("{value} is outside {low} to {high}"), cure));
        }
    }
}
