//! A YAML tree that knows its file and the path of its keys, so that every complaint names both.

use crate::error::{ConfigError, Violation};
use crate::{cures, text};
use serde::Deserialize;
use serde::de::{Deserializer, MapAccess, SeqAccess, Visitor};
use std::fmt;
use std::path::Path;

/// Deepest nesting and most nodes of a calibration file; real ones have 4 levels and some 200 nodes.
const MAX_DEPTH: usize = 32;
const MAX_NODES: usize = 50_000;

/// A parsed YAML file.
pub(super) struct Document {
    origin: String,
    root: Value,
}

#[derive(Debug)]
enum Value {
    Null,
    Bool,
    Number(f64),
    Text(String),
    List(Vec<Value>),
    Map(Vec<(String, Value)>),
}

impl Document {
    pub fn read(path: &Path) -> Result<Self, ConfigError> {
        Self::parse(&text::read_bounded(path)?, &path.display().to_string())
    }

    pub fn parse(text: &str, origin: &str) -> Result<Self, ConfigError> {
        let options = serde_saphyr::options! {
            budget: serde_saphyr::budget! { max_depth: MAX_DEPTH, max_nodes: MAX_NODES, max_documents: 1 },
            with_snippet: false,
        };
        let root =
            serde_saphyr::from_str_with_options(&without_directive(text), options).map_err(|error| {
                let at = error.location();
                ConfigError::Syntax {
                    origin: origin.to_owned(),
                    line: at.map_or(1, |at| at.line() as usize),
                    column: at.map_or(1, |at| at.column() as usize),
                    message: error.to_string().replace('\n', " "),
                    cure: "correct the syntax there".into(),
                }
            })?;
        Ok(Self { origin: origin.to_owned(), root })
    }

    pub fn origin(&self) -> &str {
        &self.origin
    }

    pub fn root(&self) -> Node<'_> {
        Node { document: self, key: String::new(), value: &self.root }
    }
}

/// OpenCV writes `%YAML:1.0`, which is no YAML directive: blanked, so that lines keep their numbers.
fn without_directive(text: &str) -> String {
    let text = text.trim_start_matches('\u{feff}');
    match text.strip_prefix("%YAML") {
        Some(rest) => rest.find('\n').map_or_else(String::new, |end| rest[end..].to_owned()),
        None => text.to_owned(),
    }
}

/// A value within a [`Document`], with the path of its key.
pub(super) struct Node<'a> {
    document: &'a Document,
    key: String,
    value: &'a Value,
}

impl<'a> Node<'a> {
    /// A complaint about this value.
    pub fn refuse(&self, reason: impl Into<String>, cure: impl Into<String>) -> ConfigError {
        let key = if self.key.is_empty() { "(file)" } else { &self.key };
        ConfigError::one(&self.document.origin, Violation::new(key, reason, cure))
    }

    /// A complaint about this value being of another type than wanted.
    fn mistyped(&self, wanted: &str) -> ConfigError {
        let is = match self.value {
            Value::Null => "empty",
            Value::Bool => "true or false",
            Value::Number(_) => "a number",
            Value::Text(_) => "a text",
            Value::List(_) => "a list",
            Value::Map(_) => "a table",
        };
        let cure = match self.value {
            Value::Text(text) if wanted.ends_with("number") => cures::of_text_for_a_number(text.trim()),
            Value::Null => format!("write {wanted} behind it, or below it with blanks before it"),
            _ => format!("write {wanted}"),
        };
        self.refuse(format!("is {is} where {wanted} is expected"), cure)
    }

    /// The last part of its key.
    pub fn name(&self) -> &str {
        self.key.rsplit('.').next().unwrap_or_default()
    }

    /// Keys of a table; none of anything else.
    pub fn keys(&self) -> Vec<&'a str> {
        match self.value {
            Value::Map(entries) => entries.iter().map(|(key, _)| key.as_str()).collect(),
            _ => Vec::new(),
        }
    }

    pub fn optional(&self, name: &str) -> Option<Node<'a>> {
        let Value::Map(entries) = self.value else { return None };
        let (_, value) = entries.iter().find(|(key, _)| key == name)?;
        Some(Node { document: self.document, key: self.child_key(name), value })
    }

    pub fn get(&self, name: &str) -> Result<Node<'a>, ConfigError> {
        if !matches!(self.value, Value::Map(_)) {
            return Err(self.mistyped("a table"));
        }
        self.optional(name).ok_or_else(|| {
            self.child(name).refuse("missing", "add it, or check that this is the right kind of file")
        })
    }

    /// A value that is missing here.
    pub fn child(&self, name: &str) -> Node<'a> {
        Node { document: self.document, key: self.child_key(name), value: self.value }
    }

    fn child_key(&self, name: &str) -> String {
        if self.key.is_empty() { name.to_owned() } else { format!("{}.{name}", self.key) }
    }

    pub fn text(&self) -> Result<&'a str, ConfigError> {
        match self.value {
            Value::Text(text) => Ok(text),
            _ => Err(self.mistyped("a text")),
        }
    }

    pub fn number(&self) -> Result<f64, ConfigError> {
        match self.value {
            Value::Number(number) if number.is_finite() => Ok(*number),
            _ => Err(self.mistyped("a finite number")),
        }
    }

    /// The elements of a list.
    pub fn elements(&self) -> Result<Vec<Node<'a>>, ConfigError> {
        let Value::List(values) = self.value else { return Err(self.mistyped("a list")) };
        let element = |(i, value)| Node { document: self.document, key: format!("{}[{i}]", self.key), value };
        Ok(values.iter().enumerate().map(element).collect())
    }

    /// Exactly `N` finite numbers.
    pub fn numbers<const N: usize>(&self) -> Result<[f64; N], ConfigError> {
        let all = self.elements()?.iter().map(Node::number).collect::<Result<Vec<f64>, _>>()?;
        <[f64; N]>::try_from(all.as_slice())
            .map_err(|_| self.refuse(format!("has {} numbers", all.len()), format!("give exactly {N}")))
    }

    /// A 4x4 matrix: four rows of four (Kalibr), 16 numbers, or OpenCV's `{rows, cols, data}` (EuRoC).
    pub fn matrix(&self) -> Result<[[f64; 4]; 4], ConfigError> {
        if let Some(data) = self.optional("data") {
            return data.matrix();
        }
        let elements = self.elements()?;
        if elements.len() == 4 {
            let rows = elements.iter().map(Node::numbers).collect::<Result<Vec<[f64; 4]>, _>>()?;
            return Ok([rows[0], rows[1], rows[2], rows[3]]);
        }
        if let Some(Node { value: Value::List(_), .. }) = elements.first() {
            let rows = match elements.len() {
                1 => "1 row".to_owned(),
                n => format!("{n} rows"),
            };
            return Err(self.refuse(format!("has {rows}, 4 expected"), "is the file cut off? copy it again"));
        }
        let flat: [f64; 16] = self.numbers()?;
        Ok(std::array::from_fn(|i| std::array::from_fn(|j| flat[4 * i + j])))
    }
}

impl Node<'_> {
    /// A 3x3 matrix in any of the forms of [`Self::matrix`].
    pub fn matrix3(&self) -> Result<[[f64; 3]; 3], ConfigError> {
        if let Some(data) = self.optional("data") {
            return data.matrix3();
        }
        let elements = self.elements()?;
        if elements.len() == 3 {
            let rows = elements.iter().map(Node::numbers).collect::<Result<Vec<[f64; 3]>, _>>()?;
            return Ok([rows[0], rows[1], rows[2]]);
        }
        let flat: [f64; 9] = self.numbers()?;
        Ok(std::array::from_fn(|i| std::array::from_fn(|j| flat[3 * i + j])))
    }
}

impl<'de> Deserialize<'de> for Value {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(ValueVisitor)
    }
}

struct ValueVisitor;

impl<'de> Visitor<'de> for ValueVisitor {
    type Value = Value;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a YAML value")
    }

    fn visit_bool<E>(self, _: bool) -> Result<Value, E> {
        Ok(Value::Bool)
    }

    fn visit_i64<E>(self, v: i64) -> Result<Value, E> {
        Ok(Value::Number(v as f64))
    }

    fn visit_u64<E>(self, v: u64) -> Result<Value, E> {
        Ok(Value::Number(v as f64))
    }

    fn visit_f64<E>(self, v: f64) -> Result<Value, E> {
        Ok(Value::Number(v))
    }

    fn visit_str<E>(self, v: &str) -> Result<Value, E> {
        Ok(Value::Text(v.to_owned()))
    }

    fn visit_unit<E>(self) -> Result<Value, E> {
        Ok(Value::Null)
    }

    fn visit_none<E>(self) -> Result<Value, E> {
        Ok(Value::Null)
    }

    fn visit_some<D: Deserializer<'de>>(self, deserializer: D) -> Result<Value, D::Error> {
        Value::deserialize(deserializer)
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<Value, A::Error> {
        let mut values = Vec::new();
        while let Some(value) = list.next_element()? {
            values.push(value);
        }
        Ok(Value::List(values))
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Value, A::Error> {
        let mut entries = Vec::new();
        while let Some(entry) = map.next_entry()? {
            entries.push(entry);
        }
        Ok(Value::Map(entries))
    }
}
