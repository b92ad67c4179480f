//! Layouts of the local socket's records, as the header has them: the tables of docs/local-socket.md are made of its
//! structures, and the examples without a library are held against them. `make messages` writes the tables.

use std::fmt::Write as _;
use std::path::Path;

/// A field of a structure of the header.
#[derive(Clone, PartialEq)]
struct Field {
    at: usize,
    /// Type as the document calls it: `f64`.
    kind: String,
    count: usize,
    name: String,
    about: String,
}

impl Field {
    fn each(&self) -> usize {
        self.kind[1..].parse::<usize>().unwrap() / 8
    }

    fn end(&self) -> usize {
        self.at + self.count * self.each()
    }

    /// Count and type, as the document has them.
    fn typed(&self) -> String {
        if self.count == 1 { self.kind.clone() } else { format!("{} {}", self.count, self.kind) }
    }

    fn is_alike(&self, other: &Self) -> bool {
        (self.typed(), &self.name, &self.about) == (other.typed(), &other.name, &other.about)
    }

    fn is_same(&self, other: &Self) -> bool {
        (self.at, self.typed(), &self.name) == (other.at, other.typed(), &other.name)
    }
}

/// Fields of the lines of a structure in C, whose names may share a line, with the comments above them.
fn fields(lines: &str) -> Vec<Field> {
    let (mut fields, mut about) = (Vec::<Field>::new(), String::new());
    for line in lines.lines().map(str::trim) {
        if let Some(comment) = line.strip_prefix("// ") {
            about += comment;
            about.push(' ');
            continue;
        }
        let Some((kind, names)) = line.split_once(' ').filter(|_| line.ends_with(';')) else { continue };
        let kind = match kind.strip_suffix("_t") {
            Some(whole) => whole.replace("uint", "u").replace("int", "i"),
            None => kind.replace("double", "f64"),
        };
        for name in names.trim_end_matches(';').split(',').map(str::trim) {
            let (name, count) = name.split_once('[').map_or((name, 1), |(name, count)| {
                (name, count.trim_end_matches(']').parse().expect("a number of elements"))
            });
            let at = fields.last().map_or(0, Field::end);
            let about = std::mem::take(&mut about).trim_end().trim_end_matches('.').to_owned();
            fields.push(Field { at, kind: kind.clone(), count, name: name.to_owned(), about });
        }
    }
    fields
}

fn read(path: &str) -> String {
    std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").join(path)).unwrap()
}

/// Text between two others.
fn between<'a>(text: &'a str, begin: &str, end: &str) -> &'a str {
    let from = text.find(begin).unwrap_or_else(|| panic!("{begin} is missing")) + begin.len();
    &text[from..from + text[from..].find(end).unwrap()]
}

fn structure(name: &str) -> Vec<Field> {
    fields(between(&read("runtime/capi/include/plumbline.h"), &format!("typedef struct {name} {{"), "}"))
}

/// Rows of a record; where several fields in a row are as in `like`, one row stands for them.
fn table(record: &[Field], like: &[Field]) -> String {
    let mut rows = String::new();
    let mut rest = record;
    while let Some(field) = rest.first() {
        let same = rest.iter().take_while(|field| like.iter().any(|other| other.is_same(field))).count();
        let taken = if same < 4 { 1 } else { same };
        let (from, to) = (field.at, rest[taken - 1].end());
        let bytes = if to == from + 1 { from.to_string() } else { format!("{from}..{to}") };
        let (kind, about) = match field {
            _ if taken > 1 => (String::new(), "as in odometry".to_owned()),
            Field { name, about, .. } if name == "reserved" => (String::new(), about.to_lowercase()),
            field if like.iter().any(|other| other.is_alike(field)) => {
                (field.typed(), format!("{}, as in odometry", field.name))
            }
            field => (field.typed(), field.about.clone()),
        };
        writeln!(rows, "    {bytes:<9} {kind:<7} {about}").unwrap();
        rest = &rest[taken..];
    }
    rows
}

/// Text with the rows of the table under a heading exchanged.
fn with_rows(text: &str, heading: &str, rows: &str) -> String {
    let section = text.find(&format!("\n### {heading}\n")).expect("the document has the heading");
    let head = "    bytes     type    field\n";
    let begin = section + text[section..].find(head).expect("the section has a table") + head.len();
    let end = begin + text[begin..].find("\n\n").expect("the table has an end") + 1;
    [&text[..begin], rows, &text[end..]].concat()
}

#[test]
fn the_document_has_the_layouts_of_the_header() {
    let path = "docs/local-socket.md";
    let (kept, odometry) = (read(path), structure("plumbline_odometry"));
    let mut made = with_rows(&kept, "Odometry", &table(&odometry, &[]));
    made = with_rows(&made, "Estimate", &table(&structure("plumbline_estimate"), &odometry));
    made = with_rows(&made, "State at an instant", &table(&structure("plumbline_instant"), &odometry));
    if std::env::var_os("PLUMBLINE_WRITE_MESSAGES").is_some() {
        std::fs::write(Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").join(path), &made).unwrap();
    } else {
        assert!(kept == made, "{path} is not what the header says; `make messages` writes it");
    }
}

#[test]
fn the_examples_without_a_library_read_the_layout_of_the_header() {
    let odometry = structure("plumbline_odometry");
    let in_c = fields(between(&read("examples/read_local.c"), "struct odometry {", "\n}"));
    let shapes = |fields: &[Field]| -> Vec<_> {
        fields.iter().map(|f| (f.name.clone(), f.at, f.end(), f.kind.clone())).collect()
    };
    // The last bytes are one number there.
    let known = odometry.len() - 1;
    assert!(shapes(&in_c)[..known] == shapes(&odometry)[..known]);
    assert_eq!(in_c.last().map(Field::end), odometry.last().map(Field::end));
    let letter = |field: &Field| {
        let letter = match field.kind.as_str() {
            "i64" => "q",
            "u64" => "Q",
            "u32" => "I",
            "u8" => "B",
            "i8" => "b",
            _ => "d",
        };
        if field.count == 1 { letter.to_owned() } else { format!("{}{letter}", field.count) }
    };
    let format: String = odometry[..known].iter().map(letter).collect();
    let python = read("examples/read_local.py");
    assert_eq!(between(&python, "ODOMETRY = struct.Struct(\"", "\")"), format!("<{format}H"));
}
