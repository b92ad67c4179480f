//! The commented file of all keys, from their declarations.

use super::{Key, Kind, Value};
use crate::Config;
use crate::keys::Table as _;

/// Longest line of a comment, characters.
const WIDTH: usize = 120;
/// Line before each part of a file.
const RULE: &str =
    "# ----------------------------------------------------------------------------------------------------";

const DEFAULTS: &str = "\
# Every key of a configuration, with its default.
#
# Keys that are marked as required must be set; all others may be omitted. Unknown keys are errors. The names of keys contain
# the units.
# base = \"euroc\" at the top of a file takes what the file does not set from that preset; a list, such as that of the cameras,
# is taken as a whole. `plumbline config --help` names the presets. Default \"defaults\".
# Frames: B is the body, which is the IMU; C0 and C1 are the left and right camera.
";

const VALUES: &str = "
# The names of keys contain the units. Keys with a \"Default\" in their comment may be omitted. Unknown keys are errors.
";

/// Every key with its default; those for experiments too where it is said.
pub(crate) fn defaults(with_experiments: bool) -> String {
    let mut file = File { text: DEFAULTS.to_owned(), with_experiments };
    file.tables("", Config::keys(), None);
    file.text
}

/// Every key with its value in `config`, below the comment `header`.
pub(crate) fn full(config: &Config, header: &str, with_experiments: bool) -> String {
    let mut file = File { text: header.to_owned() + VALUES, with_experiments };
    file.tables("", Config::keys(), Some(&config.values()));
    file.text
}

struct File {
    text: String,
    with_experiments: bool,
}

impl File {
    fn is_shown(&self, key: &Key) -> bool {
        let inner = match (key.kind)() {
            Kind::Table(keys) => keys(),
            _ => &[],
        };
        (self.with_experiments || !key.is_experiment)
            && (inner.is_empty() || inner.iter().any(|key| self.is_shown(key)))
    }

    /// The keys of a table that are no tables.
    fn keys(&mut self, keys: &[Key], values: Option<&[&dyn Value]>, is_commented: bool) {
        for (i, key) in keys.iter().enumerate().filter(|(_, key)| !is_table(key)) {
            if !self.is_shown(key) {
                continue;
            }
            if is_commented {
                self.comment(&format!("{} {} {}", key.text, range_of(key), default_of(key)));
            }
            match values.map(|values| values[i].text()).or_else(|| key.default.map(|default| default())) {
                Some(value) => self.line(&format!("{} = {value}", key.name)),
                None => self.line(&format!("# {} = ", key.name)),
            }
        }
    }

    /// The tables of a table.
    fn tables(&mut self, path: &str, keys: &[Key], values: Option<&[&dyn Value]>) {
        for (i, key) in keys.iter().enumerate().filter(|(_, key)| is_table(key)) {
            if !self.is_shown(key) {
                continue;
            }
            let inner_path =
                if path.is_empty() { key.name.to_owned() } else { format!("{path}.{}", key.name) };
            let value = values.map(|values| values[i]);
            if path.is_empty() {
                self.line(&format!("\n{RULE}"));
            } else {
                self.line("");
            }
            self.comment(key.text);
            match (key.kind)() {
                Kind::Table(inner) => self.table(&inner_path, inner(), value),
                Kind::Tables(inner) => self.list(&inner_path, inner(), value),
                _ => self.variants(&inner_path, value),
            }
        }
    }

    fn table(&mut self, path: &str, keys: &[Key], value: Option<&dyn Value>) {
        let tables = value.map(Value::tables);
        let values = tables.as_ref().and_then(|tables| tables.first()).map(|table| table.values());
        if keys.iter().any(|key| !is_table(key) && self.is_shown(key)) {
            self.line(&format!("\n[{path}]"));
            self.keys(keys, values.as_deref(), true);
        }
        self.tables(path, keys, values.as_deref());
    }

    /// A list of tables: the first with comments.
    fn list(&mut self, path: &str, keys: &[Key], value: Option<&dyn Value>) {
        let tables = value.map(Value::tables).unwrap_or_default();
        for i in 0..tables.len().max(1) {
            let values = tables.get(i).map(|table| table.values());
            self.line(&format!("\n[[{path}]]"));
            if i > 0 {
                self.line("# The keys are those of the first.");
            }
            self.keys(keys, values.as_deref(), i == 0);
            for (k, key) in keys.iter().enumerate().filter(|(_, key)| is_table(key)) {
                self.line("");
                if i == 0 {
                    self.comment(key.text);
                }
                self.variants(&format!("{path}.{}", key.name), values.as_ref().map(|values| values[k]));
            }
        }
    }

    fn variants(&mut self, path: &str, value: Option<&dyn Value>) {
        let lines = value.map_or_else(|| "# model = \n".to_owned(), Value::text);
        self.text += &format!("[{path}]\n{lines}");
    }

    fn line(&mut self, line: &str) {
        self.text += line;
        self.text.push('\n');
    }

    fn comment(&mut self, text: &str) {
        let mut line = "#".to_owned();
        for word in text.split_whitespace() {
            if line.chars().count() + 1 + word.chars().count() > WIDTH {
                self.line(&std::mem::replace(&mut line, "#".to_owned()));
            }
            line = line + " " + word;
        }
        self.line(&line);
    }
}

/// True for a table, and for a list of them.
pub(super) fn is_table(key: &Key) -> bool {
    matches!((key.kind)(), Kind::Table(_) | Kind::Tables(_) | Kind::Variants)
}

/// Range and unit, as a sentence.
fn range_of(key: &Key) -> String {
    key.range_with_unit().map_or_else(String::new, |range| format!("Range {range}."))
}

fn default_of(key: &Key) -> String {
    key.default.map_or_else(|| "Required.".into(), |default| format!("Default {}.", default()))
}
