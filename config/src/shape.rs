//! Text of a configuration: its keys with their lines, and errors of serde by key, line and cure.

use crate::Config;
use crate::error::{ConfigError, Violation};
use crate::keys::{Key, Kind, Table as _};
use crate::text::{Lines, line_and_column};
use toml::de::DeTable;
use toml::{Spanned, Table, Value};

/// The key that names what a file starts from.
pub(crate) const BASE_KEY: &str = "base";

/// What to do with a text that is YAML.
const YAML: &str = "is YAML, and a configuration is TOML; make one of calibration files with `plumbline config import` (Kalibr: \
    --camchain and --imu; a data set: --euroc; other programs: --rig), and give that";

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
    written: Table,
}

impl<'a> Document<'a> {
    /// Parses TOML text.
    pub fn parse(text: &'a str, origin: &str) -> Result<Self, ConfigError> {
        let refused = |error: toml::de::Error| {
            let offset = error.span().map_or(0, |span| span.start);
            let (line, column) = line_and_column(text, offset);
            if is_yaml(text) {
                return ConfigError::unusable(origin, YAML);
            }
            let message = error.message().trim().replace('\n', " ");
            let cure = "correct the syntax there; texts stand in quotation marks, numbers without their unit";
            ConfigError::unusable(origin, format!("line {line}, column {column}: {message}; {cure}"))
        };
        let root = DeTable::parse(text).map_err(refused)?;
        let written = text.parse().map_err(refused)?;
        Ok(Self { lines: Lines::of(text), root, written })
    }

    /// The name of what the file starts from, with its line.
    pub fn base(&self) -> Option<(&str, usize)> {
        let (key, value) = self.root.get_ref().get_key_value(BASE_KEY)?;
        Some((value.get_ref().as_str()?, self.lines.at(key.span().start)))
    }

    /// Reads what the text says, in place of what its `base` says.
    pub fn read(&self, base: Table, origin: &str) -> Result<Config, ConfigError> {
        let mut written = self.written.clone();
        if self.base().is_some() {
            written.remove(BASE_KEY);
        }
        let mut unknown = Vec::new();
        find_unknown(&written, Config::keys(), "", &mut unknown);
        let unknown =
            unknown.into_iter().map(|(key, cure)| Violation::new(key, "unknown key", cure)).collect();
        ConfigError::if_any(origin, unknown).map_err(|error| error.with_lines(|key| self.line_of(key)))?;
        serde_path_to_error::deserialize(Value::Table(merged(base, written))).map_err(|error| {
            let violation = refused(&error.path().to_string(), error.inner().message().trim());
            let line = self.line_of(&violation.key).or(Some(1));
            ConfigError::one(origin, violation.at_line(line))
        })
    }

    /// The line of a key such as `camera[1].pose_b_c`, or of the innermost of its tables that is there.
    pub fn line_of(&self, key: &str) -> Option<usize> {
        let mut table = Some(self.root.get_ref());
        let mut line = None;
        for part in key.split('.') {
            let (name, index) = split_index(part);
            let Some((found, mut value)) = table.and_then(|t| t.get_key_value(name)) else {
                return line;
            };
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

/// The base with what is written in its place: tables key by key, all else as a whole.
fn merged(mut base: Table, written: Table) -> Table {
    for (key, value) in written {
        let value = match (base.remove(&key), value) {
            (Some(Value::Table(inner)), Value::Table(value)) => Value::Table(merged(inner, value)),
            (_, value) => value,
        };
        base.insert(key, value);
    }
    base
}

/// Violation of the key at `path` that serde refuses with this message.
fn refused(path: &str, message: &str) -> Violation {
    // The names of types are those of the program.
    let message = message.replace("expected usize", "expected a whole number from 0");
    let message = message.replace("expected u32", "expected a whole number from 0");
    let message = message.replace("expected f64", "expected a number");
    let message = message.as_str();
    let names: Vec<&str> = message.split('`').skip(1).step_by(2).collect();
    match names.split_first() {
        Some((name, _)) if message.starts_with("missing field") => {
            let key = if path == "." { (*name).to_owned() } else { format!("{path}.{name}") };
            let cure = match path {
                "." => "add it, or begin the file with `base = \"euroc\"` or another preset",
                path if path.starts_with("camera[") => {
                    "add it (a base gives no keys of a list: copy the cameras whole)"
                }
                _ => "add it",
            };
            Violation::new(key, "missing", cure)
        }
        Some((&BASE_KEY, _)) if message.starts_with("unknown field") => {
            let reason =
                if path == BASE_KEY { "is no name of a preset" } else { "belongs to the whole file" };
            Violation::new(path, reason, "name a preset in the first line of the file: base = \"euroc\"")
        }
        Some((_, known)) if message.starts_with("unknown field") => {
            Violation::new(path, "unknown key", format!("remove it; known here: {}", known.join(", ")))
        }
        Some(_) if message.starts_with("unknown variant") => {
            Violation::new(path, message, "choose one of these")
        }
        _ => Violation::new(
            path,
            message,
            "write a value of that type; numbers have no unit and no quotation marks",
        ),
    }
}

/// Finds keys that no declaration has, each with its cure.
fn find_unknown(written: &Table, keys: &[Key], path: &str, found: &mut Vec<(String, String)>) {
    for (name, value) in written {
        let at = if path.is_empty() { name.clone() } else { format!("{path}.{name}") };
        let Some(key) = keys.iter().find(|key| key.name == name) else {
            if name != BASE_KEY {
                found.push((at, suggestion(name, keys)));
            }
            continue;
        };
        match ((key.kind)(), value) {
            (Kind::Table(inner), Value::Table(table)) => find_unknown(table, inner(), &at, found),
            (Kind::Tables(inner), Value::Array(list)) => {
                for (i, table) in
                    list.iter().enumerate().filter_map(|(i, value)| Some((i, value.as_table()?)))
                {
                    find_unknown(table, inner(), &format!("{at}[{i}]"), found);
                }
            }
            _ => {}
        }
    }
}

/// Paths of all keys.
fn paths(keys: &[Key], path: &str, found: &mut Vec<String>) {
    for key in keys {
        let at = if path.is_empty() { key.name.to_owned() } else { format!("{path}.{}", key.name) };
        if let Kind::Table(inner) = (key.kind)() {
            paths(inner(), &at, found);
        }
        found.push(at);
    }
}

/// Key that is probably meant: one with a similar name among `keys`, or the only one of that name elsewhere.
fn suggestion(name: &str, keys: &[Key]) -> String {
    // What is longer is no slip of a key.
    let start: String = name.chars().take(64).collect();
    let limit = (start.chars().count() / 3).max(1);
    let nearest = keys.iter().map(|key| (strsim::levenshtein(&start, key.name), key.name)).min();
    let slip = nearest.filter(|(edits, _)| *edits <= limit).map(|(_, key)| key.to_owned());
    let elsewhere = || {
        let mut all = Vec::new();
        paths(Config::keys(), "", &mut all);
        all.retain(|path| path.rsplit('.').next() == Some(name));
        <[String; 1]>::try_from(all).ok().map(|[path]| path)
    };
    let part =
        || nearest.filter(|(_, key)| key.contains(name) || name.contains(key)).map(|(_, key)| key.to_owned());
    slip.or_else(elsewhere).or_else(part).map_or_else(
        || {
            let mut known: Vec<&str> = keys.iter().map(|key| key.name).collect();
            known.sort_unstable();
            format!("remove it; known here: {}", known.join(", "))
        },
        |key| format!("did you mean `{key}`?"),
    )
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
