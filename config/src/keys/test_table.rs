//! The table of keys for the documents.

use super::{Key, Kind, text_of};
use crate::Config;
use crate::keys::Table as _;
use serde::Serialize;
use serde::de::{Deserialize, Deserializer, Error, IntoDeserializer as _, Visitor};
use std::fmt;

/// A table in Markdown with a row for each key that a user may have a reason to change.
pub(crate) fn markdown() -> String {
    let mut rows = "| key | default (range) | meaning |\n|---|---|---|\n".to_owned();
    add("", Config::keys(), &mut rows);
    rows
}

fn add(path: &str, keys: &[Key], rows: &mut String) {
    for key in keys.iter().filter(|key| !key.is_experiment) {
        let name = if path.is_empty() { key.name.to_owned() } else { format!("{path}.{}", key.name) };
        match (key.kind)() {
            Kind::Table(inner) | Kind::Tables(inner) => add(&name, inner(), rows),
            _ => *rows += &row(&name, key),
        }
    }
}

fn row(name: &str, key: &Key) -> String {
    let default = key.default.map_or_else(|| "required".into(), |default| format!("`{}`", default()));
    let words: Vec<_> = (key.words)().iter().map(|word| format!("`{word}`")).collect();
    let range = key.range_with_unit().or_else(|| (!words.is_empty()).then(|| words.join(", ")));
    let range = range.map_or_else(String::new, |range| format!(" ({range})"));
    format!("| `{name}` | {default}{range} | {} |\n", first_sentence(key.text).replace('|', "\\|"))
}

/// Text before the first full stop, or before the colon of a list of words.
fn first_sentence(text: &str) -> &str {
    let end = [". ", ": \""].iter().filter_map(|end| text.find(end)).min();
    text[..end.unwrap_or(text.len())].trim_end_matches('.')
}

/// The words that a value of `T` is read from, without old spellings.
pub(crate) fn words<T: Deserialize<'static> + Serialize>() -> Vec<&'static str> {
    let all = T::deserialize(Question).err().map_or(&[][..], |Asked(words)| words);
    let is_current = |word: &&'static str| {
        let value: Result<T, Asked> = T::deserialize(word.into_deserializer());
        value.is_ok_and(|value| text_of(&value) == format!("{word:?}"))
    };
    all.iter().copied().filter(is_current).collect()
}

/// An input that holds nothing, and fails with the words it was asked for.
struct Question;

/// Error that carries the words.
#[derive(Debug)]
struct Asked(&'static [&'static str]);

impl fmt::Display for Asked {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "one of {}", self.0.join(", "))
    }
}

impl std::error::Error for Asked {}

impl Error for Asked {
    fn custom<T: fmt::Display>(_: T) -> Self {
        Self(&[])
    }
}

impl<'de> Deserializer<'de> for Question {
    type Error = Asked;

    fn deserialize_enum<V: Visitor<'de>>(
        self,
        _: &'static str,
        words: &'static [&'static str],
        _: V,
    ) -> Result<V::Value, Asked> {
        Err(Asked(words))
    }

    fn deserialize_any<V: Visitor<'de>>(self, _: V) -> Result<V::Value, Asked> {
        Err(Asked(&[]))
    }

    serde::forward_to_deserialize_any! {
        bool i8 i16 i32 i64 i128 u8 u16 u32 u64 u128 f32 f64 char str string bytes byte_buf option unit unit_struct
        newtype_struct seq tuple tuple_struct map struct identifier ignored_any
    }
}
