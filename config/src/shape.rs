//! The shape of a configuration text: which keys it may have, must have, and of what type, by their declarations
//! ([`crate::keys`]).

use crate::error::{ConfigError, Violation};
use crate::keys::{Key, Kind, Table as _, Variant};
use crate::text::{Lines, line_and_column};
use crate::{Config, cures};
use std::borrow::Cow;
use toml::de::{DeTable, DeValue};
use toml::{Spanned, Table, Value};

/// The key that selects a variant of a table (the distortion model).
const VARIANT_KEY: &str = "model";

/// The key that names what a file starts from.
pub(crate) const BASE_KEY: &str = "base";

/// Keys that stand elsewhere now: where they were, and where they are.
const MOVED: &[(&str, &str)] = &[("autopilot.imu_to_vehicle_deg", "vehicle.imu_to_vehicle_deg")];

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
            let cure = cures::of_syntax(text.lines().nth(line - 1).unwrap_or_default());
            ConfigError::Syntax { origin: origin.to_owned(), line, column, message, cure }
        })?;
        Ok(Self { lines: Lines::of(text), root })
    }

    /// The name of what the file starts from, with its line.
    pub fn base(&self) -> Option<(&str, usize)> {
        let (key, value) = self.root.get_ref().get_key_value(BASE_KEY)?;
        Some((value.get_ref().as_str()?, self.lines.at(key.span().start)))
    }

    /// Unknown, missing and mistyped keys, in the order of the file. What `base` has may be missing.
    pub fn violations(&self, base: &Table) -> Vec<Violation> {
        let root = self.root.get_ref();
        let has_base = root.contains_key(BASE_KEY);
        let mut check = Check { lines: &self.lines, has_base, found: Vec::new() };
        if let Some((key, value)) = root.get_key_value(BASE_KEY) {
            let at = At::root().child(BASE_KEY, self.lines.at(key.span().start));
            check.value(&at, value, &Kind::Text, None);
        }
        check.table(&At::root(), root, &Shape::plain(Config::keys()), Some(base));
        check.found.sort_by_key(|violation| violation.line);
        check.found
    }

    /// The line of a key such as `camera[1].pose_b_c`, or of the innermost of its tables that is there.
    pub fn line_of(&self, key: &str) -> Option<usize> {
        self.find(key).0
    }

    /// The line of a key that is there itself.
    pub fn exact_line_of(&self, key: &str) -> Option<usize> {
        Some(self.find(key)).filter(|(_, is_there)| *is_there).and_then(|(line, _)| line)
    }

    fn find(&self, key: &str) -> (Option<usize>, bool) {
        let mut table = Some(self.root.get_ref());
        let mut line = None;
        for part in key.split('.') {
            let (name, index) = split_index(part);
            let Some((found, mut value)) = table.and_then(|t| t.get_key_value(name)) else {
                return (line, false);
            };
            line = Some(self.lines.at(found.span().start));
            if let Some(element) = index.and_then(|i| value.get_ref().get(i)) {
                value = element;
                line = Some(self.lines.at(value.span().start));
            }
            table = value.get_ref().as_table();
        }
        (line, true)
    }
}

/// `camera[1]` as `("camera", Some(1))`.
fn split_index(part: &str) -> (&str, Option<usize>) {
    match part.split_once('[') {
        Some((name, index)) => (name, index.trim_end_matches(']').parse().ok()),
        None => (part, None),
    }
}

/// Place of the check: the key as the user wrote it, and its line.
struct At {
    key: String,
    line: usize,
}

impl At {
    fn root() -> Self {
        Self { key: String::new(), line: 1 }
    }

    fn child(&self, name: &str, line: usize) -> Self {
        let dot = if self.key.is_empty() { "" } else { "." };
        Self { key: format!("{}{dot}{name}", self.key), line }
    }

    fn element(&self, index: usize, line: usize) -> Self {
        Self { key: format!("{}[{index}]", self.key), line }
    }
}

/// The keys of a table, each with its kind, and whether it must be there.
struct Shape(Vec<(&'static str, Kind, bool)>);

impl Shape {
    fn plain(keys: &'static [Key]) -> Self {
        Self(keys.iter().map(|key| (key.name, (key.kind)(), key.is_required)).collect())
    }

    fn variant(variant: &'static Variant) -> Self {
        let numbers = variant.numbers.iter().map(|name| (*name, Kind::Number, true));
        Self(std::iter::once((VARIANT_KEY, Kind::Text, true)).chain(numbers).collect())
    }

    fn kind(&self, name: &str) -> Option<&Kind> {
        self.0.iter().find(|(known, ..)| *known == name).map(|(_, kind, _)| kind)
    }

    fn names(&self) -> Vec<&'static str> {
        let mut names: Vec<&str> = self.0.iter().map(|(name, ..)| *name).collect();
        names.sort_unstable();
        names
    }
}

/// Compares a text with the declarations.
struct Check<'a> {
    lines: &'a Lines,
    /// True if the file has a base.
    has_base: bool,
    found: Vec<Violation>,
}

impl Check<'_> {
    fn refuse(&mut self, at: &At, reason: String, cure: impl Into<String>) {
        self.found.push(Violation::new(&at.key, reason, cure).at_line(Some(at.line)));
    }

    fn table(&mut self, at: &At, table: &DeTable<'_>, shape: &Shape, base: Option<&Table>) {
        for (name, value) in table {
            let name_text: &str = name.get_ref();
            let child = at.child(name_text, self.lines.at(name.span().start));
            match shape.kind(name_text) {
                Some(kind) => self.value(&child, value, kind, base.and_then(|base| base.get(name_text))),
                None if child.key == BASE_KEY => {}
                None => self.unknown(&child, name_text, shape),
            }
        }
        let is_there =
            |name: &str| table.contains_key(name) || base.is_some_and(|base| base.contains_key(name));
        for (name, kind, _) in shape.0.iter().filter(|(name, _, is_required)| *is_required && !is_there(name))
        {
            let hint = match at.key.as_str() {
                "" => ", or begin the file with `base = \"euroc\"` or another preset",
                key if key.starts_with("camera[") && self.has_base => {
                    " (a base gives no keys of a list: copy the cameras whole)"
                }
                _ => "",
            };
            let cure = format!("add it: {}{hint}", wanted(kind));
            self.refuse(&at.child(name, at.line), "missing".into(), cure);
        }
    }

    fn unknown(&mut self, at: &At, name: &str, shape: &Shape) {
        match MOVED.iter().find(|(old, _)| *old == at.key) {
            Some((_, new)) => {
                let cure = format!("write `{new}` with the same value in its place");
                self.refuse(at, "the key has moved".into(), cure);
            }
            None if name == BASE_KEY => {
                let cure = "move it to the first line of the file, before any table";
                self.refuse(at, "belongs to the whole file".into(), cure);
            }
            None => self.refuse(at, "unknown key".into(), suggestion(name, &shape.names())),
        }
    }

    /// A table whose keys depend on its model; one without a model is compared with the first.
    fn variants(&mut self, at: &At, table: &DeTable<'_>, variants: &'static [Variant]) {
        let model = table.get(VARIANT_KEY).and_then(|model| model.get_ref().as_str());
        let variant = match model {
            Some(model) => variants.iter().find(|variant| variant.word == model),
            None => variants.first(),
        };
        match variant {
            Some(variant) => self.table(at, table, &Shape::variant(variant), None),
            None => {
                let known: Vec<&str> = variants.iter().map(|variant| variant.word).collect();
                let reason = format!("there is no model {:?}", model.unwrap_or_default());
                let cure = format!("choose one of {}", known.join(", "));
                self.refuse(&at.child(VARIANT_KEY, at.line), reason, cure);
            }
        }
    }

    fn value(&mut self, at: &At, value: &Spanned<DeValue<'_>>, kind: &Kind, base: Option<&Value>) {
        match (value.get_ref(), kind) {
            (DeValue::String(text), Kind::WordOr(word, _)) if *word == *text => {}
            (DeValue::Array(_), Kind::WordOr(_, other)) => self.value(at, value, &other(), base),
            (DeValue::Table(table), Kind::Table(keys)) => {
                self.table(at, table, &Shape::plain(keys()), base.and_then(Value::as_table));
            }
            (DeValue::Table(table), Kind::Variants(variants)) => self.variants(at, table, variants),
            (DeValue::Array(_), Kind::List(element)) => self.array(at, value, &element()),
            (DeValue::Array(list), Kind::Array(length, element)) => {
                if list.len() != *length {
                    let reason = format!("has {} elements instead of {length}", list.len());
                    let cure = match element() {
                        Kind::Array(numbers, _) => {
                            format!("give {length} rows, each of {numbers} numbers in brackets")
                        }
                        _ => "give exactly that many".into(),
                    };
                    return self.refuse(at, reason, cure);
                }
                self.array(at, value, &element());
            }
            (DeValue::Float(_) | DeValue::Integer(_), Kind::Number)
            | (DeValue::String(_), Kind::Text)
            | (DeValue::Boolean(_), Kind::Switch) => {}
            (DeValue::String(text), Kind::Word(words)) => {
                let words = words();
                if !words.all.contains(&&**text) {
                    let cure = format!("choose one of {}", words.current.join(", "));
                    self.refuse(at, format!("there is no {text:?} here"), cure);
                }
            }
            (DeValue::Integer(integer), Kind::Count | Kind::Integer) => {
                let digits = integer.as_str().replace('_', "");
                let is_negative =
                    matches!(kind, Kind::Integer) && i32::from_str_radix(&digits, integer.radix()).is_ok();
                if !is_negative && u32::from_str_radix(&digits, integer.radix()).is_err() {
                    let reason = format!("{} is not a whole number from 0 to {}", integer.as_str(), u32::MAX);
                    self.refuse(at, reason, "write a count, without sign or unit");
                }
            }
            (other, kind) => {
                let reason = format!("is {} where {} is expected", article(other.type_str()), wanted(kind));
                self.refuse(at, reason, cures::of_type(&at.key, other, kind));
            }
        }
    }

    fn array(&mut self, at: &At, value: &Spanned<DeValue<'_>>, kind: &Kind) {
        for (i, element) in value.get_ref().as_array().into_iter().flatten().enumerate() {
            let line = self.lines.at(element.span().start);
            self.value(&at.element(i, line), element, kind, None);
        }
    }
}

/// The cure for an unknown key: the nearest known one, or all of them.
fn suggestion(name: &str, known: &[&str]) -> String {
    // What is longer is no slip of a key.
    let start: String = name.chars().take(64).collect();
    let limit = (start.chars().count() / 3).max(1);
    let nearest = known.iter().map(|key| (strsim::levenshtein(&start, key), key)).min();
    match nearest.filter(|(edits, key)| *edits <= limit || key.contains(name) || name.contains(**key)) {
        Some((_, key)) => format!("did you mean `{key}`?"),
        None => format!("remove it; known here: {}", known.join(", ")),
    }
}

fn wanted(kind: &Kind) -> Cow<'static, str> {
    match kind {
        Kind::Number => "a number".into(),
        Kind::Count | Kind::Integer => "a whole number".into(),
        Kind::Switch => "a boolean".into(),
        Kind::Text | Kind::Word(_) => "a string".into(),
        Kind::WordOr(word, other) => format!("{} or {word:?}", wanted(&other())).into(),
        Kind::Table(_) | Kind::Variants(_) => "a table".into(),
        Kind::List(element) => match element() {
            Kind::Table(_) => "a list of tables (`[[...]]`)".into(),
            Kind::Text => "a list of texts".into(),
            _ => "a list of whole numbers".into(),
        },
        Kind::Array(rows, element) => match element() {
            Kind::Array(numbers, _) => format!("{rows} rows of {numbers} numbers").into(),
            _ => format!("a list of {rows} numbers").into(),
        },
    }
}

fn article(kind: &str) -> String {
    let an = matches!(kind.as_bytes().first(), Some(b'a' | b'e' | b'i' | b'o' | b'u'));
    format!("{} {kind}", if an { "an" } else { "a" })
}

/// A configuration with every key that has numbers: a camera of each lens model, no list of numbers empty.
#[cfg(test)]
pub(crate) fn sample_for_tests() -> Table {
    use crate::camera::Distortion;
    let mut config = Config::preset("euroc").expect("the preset exists").into_inner();
    config.camera[1].distortion = Distortion::Equidistant { k1: 0.0, k2: 0.0, k3: 0.0, k4: 0.0 };
    for distortion in [
        Distortion::Rational { k1: 0.0, k2: 0.0, p1: 0.0, p2: 0.0, k3: 0.0, k4: 0.0, k5: 0.0, k6: 0.0 },
        Distortion::Omni { xi: 0.0, k1: 0.0, k2: 0.0, p1: 0.0, p2: 0.0 },
        Distortion::Eucm { alpha: 0.5, beta: 1.0 },
        Distortion::DoubleSphere { xi: 0.0, alpha: 0.5 },
    ] {
        config.camera.push(crate::options::CameraConfig { distortion, ..config.camera[1].clone() });
    }
    for camera in &mut config.camera {
        camera.exposure_s = 0.005;
        camera.mask = Some(crate::options::Mask::Picture("mask.png".into()));
    }
    (config.runtime.tick_cpus, config.runtime.work_cpus) = (vec![0], vec![0]);
    Table::try_from(&config).expect("the sample is plain data")
}
