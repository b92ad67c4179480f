//! Docstrings in the stubs of the Python module: those of the module itself, which are its documentation in Rust.

use std::collections::BTreeMap;
use std::path::Path;

/// Longest line of the stubs, characters.
const WIDTH: usize = 130;

/// Documentation by class and member; that of a class under an empty name of a member.
type Docs = BTreeMap<(String, String), Vec<String>>;

/// The stubs with every docstring as the sources in `folder` have it.
pub fn with_docstrings(stubs: &str, folder: &Path) -> String {
    let docs = docs(folder);
    let (mut out, mut class, mut member) = (String::new(), String::new(), String::new());
    let mut lines = stubs.lines();
    while let Some(line) = lines.next() {
        let text = line.trim_start();
        if let Some(name) = text.strip_prefix("class ") {
            (class, member) = (name.trim_end_matches(':').to_owned(), String::new());
        } else if let Some((name, _)) = text.strip_prefix("def ").and_then(|text| text.split_once('(')) {
            name.clone_into(&mut member);
        }
        let Some(begun) = text.strip_prefix("\"\"\"").filter(|_| !class.is_empty()) else {
            out += &format!("{line}\n");
            continue;
        };
        let mut last = begun;
        while !last.ends_with("\"\"\"") {
            last = lines.next().expect("a docstring has an end");
        }
        let of = (class.clone(), member.clone());
        let paragraphs = docs.get(&of).unwrap_or_else(|| panic!("{of:?} is documented in no source"));
        out += &docstring(paragraphs, &line[..line.len() - text.len()]);
    }
    out
}

fn docstring(paragraphs: &[String], indent: &str) -> String {
    let wrapped = |paragraph: &String| {
        let (mut text, mut column) = (String::new(), 0);
        for word in paragraph.split_whitespace() {
            // The quotes before and behind have three characters each.
            if column > 0 && indent.len() + 3 + column + 1 + word.len() > WIDTH {
                text += &format!("\n{indent}");
                column = 0;
            } else if column > 0 {
                text.push(' ');
            }
            column += word.len() + 1;
            text += word;
        }
        text
    };
    let paragraphs: Vec<String> = paragraphs.iter().map(wrapped).collect();
    format!("{indent}\"\"\"{}\"\"\"\n", paragraphs.join(&format!("\n\n{indent}")))
}

/// Comments above classes and their methods in all sources.
fn docs(folder: &Path) -> Docs {
    let mut docs = Docs::new();
    for file in std::fs::read_dir(folder).unwrap() {
        let source = std::fs::read_to_string(file.unwrap().path()).unwrap();
        let (mut class, mut named, mut above) = (String::new(), BTreeMap::new(), Vec::new());
        let (mut python_name, mut holder) = (None, String::new());
        for line in source.lines().map(str::trim_start) {
            if let Some(text) = line.strip_prefix("///") {
                above.push(text.trim().to_owned());
                continue;
            }
            if line.starts_with("#[") {
                python_name =
                    line.split_once("name = \"").and_then(|(_, rest)| rest.split('"').next()).or(python_name);
                continue;
            }
            let text = line.trim_start_matches("pub ").trim_start_matches("pub(crate) ");
            let name = |text: &str| {
                text.split(|c: char| !(c.is_alphanumeric() || c == '_')).next().unwrap_or_default().to_owned()
            };
            if let Some(rest) = text.strip_prefix("struct ") {
                let (rust, python) = (name(rest), python_name.map_or_else(|| name(rest), str::to_owned));
                docs.insert((python.clone(), String::new()), paragraphs(&above));
                holder.clone_from(&python);
                named.insert(rust, python);
            } else if let Some((field, _)) =
                text.split_once(": ").filter(|_| !holder.is_empty() && !above.is_empty())
            {
                docs.insert((holder.clone(), field.to_owned()), paragraphs(&above));
            } else if let Some(rest) = text.strip_prefix("impl ") {
                holder.clear();
                class = named.get(&name(rest)).cloned().unwrap_or_default();
            } else if let Some(rest) =
                text.strip_prefix("fn ").filter(|_| !above.is_empty() && !class.is_empty())
            {
                docs.insert((class.clone(), name(rest)), paragraphs(&above));
            }
            (above, python_name) = (Vec::new(), None);
        }
    }
    docs
}

/// Lines put together, an empty one between two paragraphs.
fn paragraphs(lines: &[String]) -> Vec<String> {
    lines.split(String::is_empty).map(|lines| lines.join(" ")).collect()
}
