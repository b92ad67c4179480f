//! Text of a configuration: its keys with their lines, and errors of serde by key, line and cure.

use crate::Config;
use crate::error::{ConfigError, Violation};
use crate::keys::{Key, Kind, Table as _, joined};
use crate::text::{Lines, line_and_column};
use toml::de::{DeTable, DeValue};
use toml::{Table, Value};

/// The key that names what a file starts from.
pub(crate) const BASE_KEY: &str = "base";

/// Likeness, by Jaro and Winkler, from which one name is a slip of another.
const ALIKE: f64 = 0.85;

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
    root: DeValue<'a>,
    written: Table,
}

impl<'a> Document<'a> {
    /// Parses TOML text.
    pub fn parse(text: &'a str, origin: &str) -> Result<Self, ConfigError> {
        let refused = |error: toml::de::Error| {
            let offset = error.span().map_or(0, |span| span.start);
            let (line, column) = line_and_column(text.as_bytes(), offset);
            if is_yaml(text) {
                return ConfigError::unusable(origin, YAML);
            }
            let message = error.message().trim().replace('\n', " ");
            let cure = "correct the syntax there; texts stand in quotation marks, numbers without their unit";
            ConfigError::unusable(origin, format!("line {line}, column {column}: {message}; {cure}"))
        };
        let root = DeValue::Table(DeTable::parse(text).map_err(refused)?.into_inner());
        let written = text.parse().map_err(refused)?;
        Ok(Self { lines: Lines::of(text), root, written })
    }

    /// The name of what the file starts from.
    pub fn base(&self) -> Option<String> {
        self.written.get(BASE_KEY).map(|base| base.as_str().map_or_else(|| base.to_string(), str::to_owned))
    }

    /// Reads what the text says, in place of what its `base` says.
    pub fn read(&self, base: Table, origin: &str) -> Result<Config, ConfigError> {
        let mut written = self.written.clone();
        written.remove(BASE_KEY);
        let mut unknown = Vec::new();
        find_unknown(&written, Config::keys(), "", &mut unknown);
        ConfigError::if_any(origin, unknown).map_err(|error| error.with_lines(|key| self.line_of(key)))?;
        serde_path_to_error::deserialize(Value::Table(merged(base, written))).map_err(|error| {
            let violation = refused(&error.path().to_string(), error.inner().message().trim());
            let line = self.line_of(&violation.key).or(Some(1));
            ConfigError::one(origin, violation.at_line(line))
        })
    }

    /// The line of a key such as `camera[1].pose_b_c`, or of the innermost of its tables that is there.
    pub fn line_of(&self, key: &str) -> Option<usize> {
        let (mut inside, mut line) = (&self.root, None);
        for part in key.split(['.', '[', ']']).filter(|part| !part.is_empty()) {
            let found = match inside {
                DeValue::Table(table) => table.get_key_value(part).map(|(key, value)| (key.span(), value)),
                DeValue::Array(list) => {
                    part.parse().ok().and_then(|i: usize| list.get(i)).map(|value| (value.span(), value))
                }
                _ => None,
            };
            let Some((span, value)) = found else { break };
            (inside, line) = (value.get_ref(), Some(self.lines.at(span.start)));
        }
        line
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
    let message =
        ["usize", "u32"].iter().fold(message.replace("expected f64", "expected a number"), |text, kind| {
            text.replace(&format!("expected {kind}"), "expected a whole number from 0")
        });
    if message.starts_with("missing field") {
        let cure = match path {
            "." => "add it, or begin the file with `base = \"euroc\"` or another preset",
            _ if path.starts_with("camera[") => {
                "add it (a base gives no keys of a list: copy the cameras whole)"
            }
            _ => "add it",
        };
        let name = message.split('`').nth(1).unwrap_or_default();
        return Violation::new(joined(path.trim_matches('.'), name), "missing", cure);
    }
    let cure = match message.starts_with("unknown") {
        true => "choose one of these",
        false => "write a value of that type; numbers have no unit and no quotation marks",
    };
    Violation::new(path, message, cure)
}

/// Finds keys that no declaration has, each with its cure.
fn find_unknown(written: &Table, keys: &[Key], path: &str, found: &mut Vec<Violation>) {
    for (name, value) in written {
        let at = joined(path, name);
        let key = keys.iter().find(|key| key.name == name);
        match (key.map(|key| (key.kind)()), value) {
            (None, _) if name == BASE_KEY => {
                let cure = "name a preset in the first line of the file: base = \"euroc\"";
                found.push(Violation::new(at, "belongs to the whole file", cure));
            }
            (None, _) => found.push(Violation::new(at, "unknown key", suggestion(name, keys))),
            (Some(Kind::Table(inner)), Value::Table(table)) => find_unknown(table, inner(), &at, found),
            (Some(Kind::Tables(inner)), Value::Array(list)) => {
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

/// Adds the paths of all keys of a name.
fn find_paths(name: &str, keys: &[Key], path: &str, found: &mut Vec<String>) {
    for key in keys {
        let at = joined(path, key.name);
        if let Kind::Table(inner) = (key.kind)() {
            find_paths(name, inner(), &at, found);
        }
        if key.name == name {
            found.push(at);
        }
    }
}

/// Name among `known` that is probably meant.
pub(crate) fn alike<'a>(name: &str, known: impl Iterator<Item = &'a str>) -> Option<&'a str> {
    // What is longer is no slip of a name.
    let start: String = name.chars().take(64).collect();
    let likeness = known.map(|known| (strsim::jaro_winkler(&start, known), known));
    likeness
        .filter(|(likeness, _)| *likeness > ALIKE)
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, known)| known)
}

/// Key that is probably meant: one with a similar name among `keys`, or the only one of that name elsewhere.
fn suggestion(name: &str, keys: &[Key]) -> String {
    let mut elsewhere = Vec::new();
    find_paths(name, Config::keys(), "", &mut elsewhere);
    match (alike(name, keys.iter().map(|key| key.name)), &elsewhere[..]) {
        (_, [key]) => format!("did you mean `{key}`?"),
        (Some(key), _) => format!("did you mean `{key}`?"),
        _ => {
            let mut known: Vec<&str> = keys.iter().map(|key| key.name).collect();
            known.sort_unstable();
            format!("remove it; known here: {}", known.join(", "))
        }
    }
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
