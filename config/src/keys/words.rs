//! Words of an enum, as serde knows them.

use serde::Serialize;
#[cfg(feature = "toml")]
use serde::de::IntoDeserializer as _;
use serde::de::{Deserialize, Deserializer, Error, Visitor};
use std::fmt;

/// Words that a value is read from.
pub(crate) struct Words {
    pub all: &'static [&'static str],
    /// Without old spellings.
    #[cfg(feature = "toml")]
    pub current: Vec<&'static str>,
}

/// The words that a value of `T` is read from.
pub(crate) fn words<T: Deserialize<'static> + Serialize>() -> Words {
    let all = T::deserialize(Question).err().map_or(&[][..], |Asked(words)| words);
    #[cfg(feature = "toml")]
    let is_current = |word: &&'static str| {
        let value: Result<T, Asked> = T::deserialize(word.into_deserializer());
        value.is_ok_and(|value| super::text_of(&value) == format!("{word:?}"))
    };
    Words {
        all,
        #[cfg(feature = "toml")]
        current: all.iter().copied().filter(is_current).collect(),
    }
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
