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
pub(crate) struct Key {
    pub name: &'static str,
    /// Comment of the key in a file.
    pub text: &'static str,
    pub kind: fn() -> Kind,
    /// The default, as it is written.
    #[cfg(feature = "toml")]
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
    /// Row of values.
    Row,
    Table(fn() -> &'static [Key]),
    /// List of tables.
    Tables(fn() -> &'static [Key]),
    /// Table whose keys depend on the word of one of them.
    Variants,
}

/// A value that a key can have.
pub(crate) trait Value {
    fn kind() -> Kind
    where
        Self: Sized,
    {
        Kind::Value
    }

    /// The value as it is written in a file.
    #[cfg(feature = "toml")]
    fn text(&self) -> String;

    /// Refuses what is out of the key's range; `at` is the key's path.
    fn check(&self, _key: &Key, _at: &str, _found: &mut Vec<Violation>) {}

    /// The tables that this value consists of.
    #[cfg(feature = "toml")]
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

/// Every number of the table out of its range; `at` is the table's path.
pub(crate) fn check<T: Table>(table: &T, at: &str, found: &mut Vec<Violation>) {
    for (key, value) in T::keys().iter().zip(table.values()) {
        value.check(key, &format!("{at}.{}", key.name), found);
    }
}

impl Key {
    /// `0.05 to 100 s`, where there is a range.
    #[cfg(feature = "toml")]
    fn range_with_unit(&self) -> Option<String> {
        // Many zeros are hard to count.
        let written = |x: f64| {
            let (plain, short) = (x.to_string(), format!("{x:e}"));
            if plain.len() > 6 && short.len() < plain.len() { short } else { plain }
        };
        let unit = self.unit.map(|unit| unit.symbol).filter(|symbol| !symbol.is_empty());
        let unit = unit.map_or_else(String::new, |symbol| format!(" {symbol}"));
        self.range.map(|(low, high)| format!("{} to {}{unit}", written(low), written(high)))
    }

    /// Refuses a number out of the range, by the key's cure, that of its unit, or `otherwise`.
    fn check_number(&self, value: f64, at: &str, otherwise: &'static str, found: &mut Vec<Violation>) {
        let Some((low, high)) = self.range else { return };
        // NaN lies in no range.
        if !(low..=high).contains(&value) {
            let cure = self.cure.or(self.unit.map(|unit| unit.cure)).unwrap_or(otherwise);
            found.push(Violation::new(at, format!("{value} is outside {low} to {high}"), cure));
        }
    }
}

/// A value as TOML.
#[cfg(feature = "toml")]
pub(crate) fn text_of<T: serde::Serialize>(value: &T) -> String {
    toml::Value::try_from(value).map_or_else(|_| String::new(), |value| value.to_string())
}
