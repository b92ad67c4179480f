//! The commented file of all keys, from their declarations.

use super::{Key, Kind, Table, Value, joined};
use crate::Config;

/// Longest line of a comment, characters.
const WIDTH: usize = 120;
/// Line before each part of a file.
const RULE: &str = "\n# ----------------------------------------------------------------------------------------------------";

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
    file.table("", "", Config::keys(), None, true);
    file.text
}

/// Every key with its value in `config`, below the comment `header`.
pub(crate) fn full(config: &Config, header: &str, with_experiments: bool) -> String {
    let mut file = File { text: header.to_owned() + VALUES, with_experiments };
    file.table("", "", Config::keys(), Some(config), true);
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

    /// The keys of a table below its header, then the tables in it.
    fn table(
        &mut self,
        header: &str,
        path: &str,
        keys: &[Key],
        table: Option<&dyn Table>,
        is_commented: bool,
    ) {
        let values = table.map(Table::values);
        let shown = keys.iter().enumerate().filter(|(_, key)| self.is_shown(key));
        let shown = shown.map(|(i, key)| (key, values.as_ref().map(|values| values[i])));
        let (plain, tables): (Vec<_>, Vec<_>) =
            shown.partition(|(key, _)| matches!((key.kind)(), Kind::Value));
        if !plain.is_empty() {
            self.line(&format!("\n{header}"));
        }
        for (key, value) in plain {
            if is_commented {
                self.comment(&format!("{} {} {}", key.text, range_of(key), default_of(key)));
            }
            match value.map(|value| value.text()).or_else(|| key.default.map(|default| default())) {
                Some(value) => self.line(&format!("{} = {value}", key.name)),
                None => self.line(&format!("# {} = ", key.name)),
            }
        }
        for (key, value) in tables {
            let path = joined(path, key.name);
            self.line(if header.is_empty() { RULE } else { "" });
            self.comment(key.text);
            let (keys, header) = match (key.kind)() {
                Kind::Tables(keys) => (keys(), format!("[[{path}]]")),
                Kind::Table(keys) => (keys(), format!("[{path}]")),
                Kind::Value => continue,
            };
            let tables = value.map(Value::tables).unwrap_or_default();
            // The keys of a second table of a list are those of the first.
            for i in 0..tables.len().max(1) {
                self.table(&header, &path, keys, tables.get(i).copied(), i == 0);
            }
        }
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

/// Range and unit, as a sentence.
fn range_of(key: &Key) -> String {
    let unit = key.unit.map_or("", |unit| unit.symbol);
    key.range.map_or_else(String::new, |(low, high)| {
        let sentence = format!("{} to {} {unit}", short(low.to_string()), short(high.to_string()));
        format!("Range {}.", sentence.trim_end())
    })
}

/// A number in the shorter of its forms, as many zeros are hard to count; else the text.
pub(super) fn short(plain: String) -> String {
    let short = plain.parse::<f64>().map_or_else(|_| plain.clone(), |number| format!("{number:e}"));
    if plain.len() > 6 && short.len() < plain.len() { short } else { plain }
}

fn default_of(key: &Key) -> String {
    key.default.map_or_else(|| "Required.".into(), |default| format!("Default {}.", default()))
}
