//! The shape of a configuration text: which keys it may have, must have, and of what type.
//!
//! The shape is not written down a second time: it is read off a sample configuration that has every
//! key, and a key is required when the sample without it is refused.

use crate::camera::Distortion;
use crate::error::{ConfigError, Violation};
use crate::options::{CameraConfig, Mask, Mounting};
use crate::text::{Lines, line_and_column};
use crate::{Config, presets};
use serde::Deserialize;
use toml::de::{DeTable, DeValue};
use toml::{Spanned, Table, Value};

/// The key that selects a variant of a table (the distortion model).
const VARIANT_KEY: &str = "model";

/// Keys that stand elsewhere now: where they were, and where they are.
const MOVED: &[(&str, &str)] = &[("autopilot.imu_to_vehicle_deg", "vehicle.imu_to_vehicle_deg")];

/// Keys whose list of numbers may be a word instead, and that word.
const WORDS: &[(&str, &str)] = &[("vehicle.imu_to_vehicle_deg", Mounting::UNKNOWN)];

/// Keys whose whole number may be negative; all others are counts.
const SIGNED: &[&str] = &["runtime.idle_latency_us"];

/// True if a text that is not TOML is YAML: its first line that is no comment is a directive, a mark, or a key with a colon.
fn is_yaml(text: &str) -> bool {
    let lines = text.lines().map(str::trim).filter(|line| !line.is_empty() && !line.starts_with('#'));
    lines.take(1).any(|line| {
        let key = line.split_once(':').filter(|(_, rest)| rest.is_empty() || rest.starts_with(' '));
        let is_word = |key: &str| key.chars().all(|c| c.is_alphanumeric() || "_-.\"'".contains(c));
        line.starts_with("%YAML") || line == "---" || key.is_some_and(|(key, _)| is_word(key))
    })
}

/// A parsed text that still knows the lines of its keys.
pub(crate) struct Document<'a> {
    lines: Lines,
    root: Spanned<DeTable<'a>>,
}

impl<'a> Document<'a> {
    /// Parses TOML text.
    pub fn parse(text: &'a str, origin: &str) -> Result<Self, ConfigError> {
        let root = DeTable::parse(text).map_err(|error| {
            let offset = error.span().map_or(0, |span| span.start);
            let (line, column) = line_and_column(text, offset);
            if is_yaml(text) {
                return ConfigError::Yaml { origin: origin.to_owned() };
            }
            let message = error.message().trim().replace('\n', " ");
            ConfigError::Syntax { origin: origin.to_owned(), line, column, message }
        })?;
        Ok(Self { lines: Lines::of(text), root })
    }

    /// Unknown, missing and mistyped keys, in the order of the file.
    pub fn violations(&self) -> Vec<Violation> {
        let sample = sample();
        let mut check = Check { lines: &self.lines, sample: &sample, found: Vec::new() };
        check.table(&At::root(), self.root.get_ref(), &[&sample]);
        check.found.sort_by_key(|violation| violation.line);
        check.found
    }

    /// The line of a key such as `camera[1].pose_b_c`, or of the innermost of its tables that is there.
    pub fn line_of(&self, key: &str) -> Option<usize> {
        let mut table = Some(self.root.get_ref());
        let mut line = None;
        for part in key.split('.') {
            let (name, index) = split_index(part);
            let Some((found, mut value)) = table.and_then(|t| t.get_key_value(name)) else { break };
            line = Some(self.lines.at(found.span().start));
            if let Some(element) = index.and_then(|i| value.get_ref().get(i)) {
                value = element;
                line = Some(self.lines.at(value.span().start));
            }
            table = value.get_ref().as_table();
        }
        line
    }
}

/// `camera[1]` as `("camera", Some(1))`.
fn split_index(part: &str) -> (&str, Option<usize>) {
    match part.split_once('[') {
        Some((name, index)) => (name, index.trim_end_matches(']').parse().ok()),
        None => (part, None),
    }
}

/// Place of the check: the key as the user wrote it, and with every index left out (`camera[].focal_px`).
struct At {
    key: String,
    general: String,
    line: usize,
}

impl At {
    fn root() -> Self {
        Self { key: String::new(), general: String::new(), line: 1 }
    }

    fn child(&self, name: &str, line: usize) -> Self {
        let dot = if self.key.is_empty() { "" } else { "." };
        Self {
            key: format!("{}{dot}{name}", self.key),
            general: format!("{}{dot}{name}", self.general),
            line,
        }
    }

    fn element(&self, index: usize, line: usize) -> Self {
        Self { key: format!("{}[{index}]", self.key), general: format!("{}[]", self.general), line }
    }
}

/// Compares a text with the sample. Where the sample has several shapes of a table (the elements of a list
/// of tables), all of them come along as candidates.
struct Check<'a> {
    lines: &'a Lines,
    sample: &'a Table,
    found: Vec<Violation>,
}

impl Check<'_> {
    fn refuse(&mut self, at: &At, reason: String, cure: impl Into<String>) {
        self.found.push(Violation::new(&at.key, reason, cure).at_line(Some(at.line)));
    }

    fn table(&mut self, at: &At, table: &DeTable<'_>, candidates: &[&Table]) {
        let Some(candidates) = self.variant(at, table, candidates) else { return };
        let shape = candidates[0];
        for (name, value) in table {
            let name_text: &str = name.get_ref();
            let child = at.child(name_text, self.lines.at(name.span().start));
            let shapes: Vec<&Value> = candidates.iter().filter_map(|c| c.get(name_text)).collect();
            if shapes.is_empty() {
                match MOVED.iter().find(|(old, _)| *old == child.general) {
                    Some((_, new)) => {
                        let cure = format!("write `{new}` with the same value in its place");
                        self.refuse(&child, "the key has moved".into(), cure);
                    }
                    None => self.refuse(&child, "unknown key".into(), suggestion(name_text, shape)),
                }
            } else {
                self.value(&child, value, &shapes);
            }
        }
        for name in shape.keys().filter(|name| table.get(name.as_str()).is_none()) {
            let child = at.child(name, at.line);
            if is_required(self.sample, &child.general) {
                self.refuse(&child, "missing".into(), format!("add it: {}", wanted(&shape[name])));
            }
        }
    }

    /// The candidates that a table is to be compared with: of tables with variants those of its variant.
    fn variant<'c>(
        &mut self,
        at: &At,
        table: &DeTable<'_>,
        candidates: &[&'c Table],
    ) -> Option<Vec<&'c Table>> {
        let name_of = |candidate: &'c Table| candidate.get(VARIANT_KEY).and_then(Value::as_str);
        let known: Vec<&str> = candidates.iter().filter_map(|c| name_of(c)).collect();
        let Some(model) =
            table.get(VARIANT_KEY).and_then(|v| v.get_ref().as_str()).filter(|_| !known.is_empty())
        else {
            return Some(candidates.to_vec());
        };
        let matching: Vec<&Table> =
            candidates.iter().copied().filter(|c| name_of(c) == Some(model)).collect();
        if matching.is_empty() {
            let cure = format!("choose one of {}", known.join(", "));
            self.refuse(&at.child(VARIANT_KEY, at.line), format!("there is no model {model:?}"), cure);
            return None;
        }
        Some(matching)
    }

    fn value(&mut self, at: &At, value: &Spanned<DeValue<'_>>, shapes: &[&Value]) {
        let word = WORDS.iter().find(|(key, _)| *key == at.general).map(|(_, word)| *word);
        match (value.get_ref(), shapes[0]) {
            (DeValue::String(text), Value::Array(_)) if word.is_some_and(|word| word == text) => {}
            (DeValue::Table(table), Value::Table(_)) => {
                let tables: Vec<&Table> = shapes.iter().filter_map(|s| s.as_table()).collect();
                self.table(at, table, &tables);
            }
            (DeValue::Array(_), Value::Array(shape)) => self.array(at, value, shape),
            (DeValue::Float(_) | DeValue::Integer(_), Value::Float(_))
            | (DeValue::String(_), Value::String(_))
            | (DeValue::Boolean(_), Value::Boolean(_)) => {}
            (DeValue::Integer(integer), Value::Integer(_)) => {
                let digits = integer.as_str().replace('_', "");
                let is_signed = SIGNED.contains(&at.general.as_str());
                let is_negative = is_signed && i32::from_str_radix(&digits, integer.radix()).is_ok();
                if !is_negative && u32::from_str_radix(&digits, integer.radix()).is_err() {
                    let reason = format!("{} is not a whole number from 0 to {}", integer.as_str(), u32::MAX);
                    self.refuse(at, reason, "write a count, without sign or unit");
                }
            }
            (other, shape) => {
                let or = word.map_or_else(String::new, |word| format!(" or {word:?}"));
                let reason =
                    format!("is {} where {}{or} is expected", article(other.type_str()), wanted(shape));
                self.refuse(at, reason, "correct the value");
            }
        }
    }

    fn array(&mut self, at: &At, value: &Spanned<DeValue<'_>>, shape: &[Value]) {
        let elements = value.get_ref().as_array().map_or(0, |array| array.len());
        // Lists of real numbers are vectors and matrices, of fixed size; lists of anything else are free.
        let is_fixed = matches!(shape.first(), Some(Value::Float(_) | Value::Array(_)));
        if is_fixed && elements != shape.len() {
            let reason = format!("has {elements} elements instead of {}", shape.len());
            return self.refuse(at, reason, "give exactly that many");
        }
        let shapes: Vec<&Value> = shape.iter().collect();
        for (i, element) in value.get_ref().as_array().into_iter().flatten().enumerate() {
            let line = self.lines.at(element.span().start);
            self.value(&at.element(i, line), element, &shapes);
        }
    }
}

/// True if the sample without this key is refused.
fn is_required(sample: &Table, general_key: &str) -> bool {
    fn remove(table: &mut Table, key: &str) {
        let Some((first, rest)) = key.split_once('.') else {
            table.remove(key);
            return;
        };
        match table.get_mut(first.trim_end_matches("[]")) {
            Some(Value::Table(inner)) => remove(inner, rest),
            Some(Value::Array(all)) => {
                all.iter_mut().filter_map(Value::as_table_mut).for_each(|t| remove(t, rest))
            }
            _ => {}
        }
    }
    let mut without = sample.clone();
    remove(&mut without, general_key);
    Config::deserialize(without).is_err()
}

/// The cure for an unknown key: the nearest known one, or all of them.
fn suggestion(name: &str, shape: &Table) -> String {
    // What is longer is no slip of a key.
    let start: String = name.chars().take(64).collect();
    let limit = (start.chars().count() / 3).max(1);
    let nearest = shape.keys().map(|key| (strsim::levenshtein(&start, key), key)).min();
    match nearest.filter(|(edits, key)| *edits <= limit || key.contains(name) || name.contains(key.as_str()))
    {
        Some((_, key)) => format!("did you mean `{key}`?"),
        None => format!("remove it; known here: {}", shape.keys().cloned().collect::<Vec<_>>().join(", ")),
    }
}

fn wanted(shape: &Value) -> String {
    match shape {
        Value::Float(_) => "a number".into(),
        Value::Integer(_) => "a whole number".into(),
        Value::Array(elements) => match &elements[0] {
            Value::Table(_) => "a list of tables (`[[...]]`)".into(),
            Value::Array(row) => format!("{} rows of {} numbers", elements.len(), row.len()),
            Value::String(_) => "a list of texts".into(),
            Value::Integer(_) => "a list of whole numbers".into(),
            _ => format!("a list of {} numbers", elements.len()),
        },
        other => article(other.type_str()),
    }
}

fn article(kind: &str) -> String {
    let an = matches!(kind.as_bytes().first(), Some(b'a' | b'e' | b'i' | b'o' | b'u'));
    format!("{} {kind}", if an { "an" } else { "a" })
}

/// A configuration with every key there is: a camera of each distortion model, no list empty.
fn sample() -> Table {
    let text = presets::preset_text("euroc").expect("the preset exists");
    let mut config: Config = toml::from_str(text).expect("the presets are tested");
    config.camera[1].distortion = Distortion::Equidistant { k1: 0.0, k2: 0.0, k3: 0.0, k4: 0.0 };
    for distortion in [
        Distortion::Rational { k1: 0.0, k2: 0.0, p1: 0.0, p2: 0.0, k3: 0.0, k4: 0.0, k5: 0.0, k6: 0.0 },
        Distortion::Omni { xi: 0.0, k1: 0.0, k2: 0.0, p1: 0.0, p2: 0.0 },
        Distortion::Eucm { alpha: 0.5, beta: 1.0 },
        Distortion::DoubleSphere { xi: 0.0, alpha: 0.5 },
    ] {
        let camera = CameraConfig { distortion, ..config.camera[1].clone() };
        config.camera.push(camera);
    }
    for camera in &mut config.camera {
        camera.exposure_s = 0.005;
        camera.mask = Some(Mask::Picture("mask.png".into()));
    }
    let mut sample = Table::try_from(&config).expect("the sample is plain data");
    for path in empty_lists(&sample) {
        for element in [Value::String(String::new()), Value::Float(0.0), Value::Integer(0)] {
            *at_path(&mut sample, &path) = Value::Array(vec![element]);
            if Config::deserialize(sample.clone()).is_ok() {
                break;
            }
        }
    }
    sample
}

/// The empty lists in tables of tables, by the keys that lead to them.
fn empty_lists(table: &Table) -> Vec<Vec<String>> {
    let within = |(key, value): (&String, &Value)| {
        let inner = match value {
            Value::Table(inner) => empty_lists(inner),
            Value::Array(list) if list.is_empty() => vec![Vec::new()],
            _ => Vec::new(),
        };
        inner.into_iter().map(|rest| [vec![key.clone()], rest].concat()).collect::<Vec<_>>()
    };
    table.iter().flat_map(within).collect()
}

fn at_path<'a>(table: &'a mut Table, path: &[String]) -> &'a mut Value {
    let (first, rest) = path.split_first().expect("a list has a key");
    rest.iter().fold(&mut table[first], |value, key| &mut value[key])
}

#[cfg(test)]
pub(crate) fn sample_for_tests() -> Table {
    sample()
}
