//! The table of keys for the documents.

use super::file::is_table;
use super::{Key, Kind};
use crate::Config;
use crate::keys::Table as _;

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
            Kind::Table(inner) => add(&name, inner(), rows),
            Kind::List(element) if is_table(key) => {
                if let Kind::Table(inner) = element() {
                    add(&name, inner(), rows);
                }
            }
            _ => *rows += &row(&name, key),
        }
    }
}

fn row(name: &str, key: &Key) -> String {
    let default = key.default.map_or_else(|| "required".into(), |default| format!("`{}`", default()));
    let range = match ((key.kind)(), key.range_with_unit()) {
        (_, Some(range)) => format!(" ({range})"),
        (Kind::Word(words), None) => {
            let words: Vec<_> = words().current.iter().map(|word| format!("`{word}`")).collect();
            format!(" ({})", words.join(", "))
        }
        _ => String::new(),
    };
    format!("| `{name}` | {default}{range} | {} |\n", first_sentence(key.text).replace('|', "\\|"))
}

/// Text before the first full stop, or before the colon of a list of words.
fn first_sentence(text: &str) -> &str {
    let end = [". ", ": \""].iter().filter_map(|end| text.find(end)).min();
    text[..end.unwrap_or(text.len())].trim_end_matches('.')
}
