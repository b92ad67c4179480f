//! Files of the repository that are made of declarations: schema, tables of the documents, names in Python. `make messages`
//! writes them.

use crate::fields::{Enumeration, Outline, Shape};
use crate::messages::Envelope;
use crate::schema::{PACKAGE, add_topics, enumerations, is_repeated, kind, messages};
use crate::topics::{Row, Topic};
use plumbline_estimator::HealthBits;
use plumbline_estimator::health::HealthBit;
use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::path::Path;

#[test]
fn made_files_are_what_the_declarations_say() {
    made("runtime/record/proto/plumbline/v1/log.proto", |_| log_proto());
    made("runtime/record/proto/plumbline/v1/plumbline.proto", |_| plumbline_proto());
    made("runtime/python/package/plumbline/health.py", |_| health_py());
    made("docs/health.md", |kept| with_table(kept, "| bit |", &health_table()));
    made("docs/guide.md", |kept| with_table(kept, "| content | message |", &topics_table()));
}

/// Holds a file against what is made of it, or writes it.
fn made(path: &str, make: impl FnOnce(&str) -> String) {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").join(path);
    let kept = std::fs::read_to_string(&file).unwrap_or_default();
    let made = make(&kept);
    if std::env::var_os("PLUMBLINE_WRITE_MESSAGES").is_some() {
        std::fs::write(&file, &made).unwrap();
    } else {
        assert!(kept == made, "{path}: is not what the declarations say; `make messages` writes it");
    }
}

/// Text with the table whose head begins like this exchanged.
fn with_table(text: &str, head: &str, table: &str) -> String {
    let begin = text.find(&format!("\n{head}")).map_or(text.len(), |at| at + 1);
    let rows = text[begin..].split_inclusive('\n').take_while(|line| line.starts_with('|'));
    let end = begin + rows.map(str::len).sum::<usize>();
    [&text[..begin], table, &text[end..]].concat()
}

fn health_table() -> String {
    let row = |(at, about): (usize, &HealthBit)| {
        let HealthBit { bit, name, meaning, mut causes, mut cure, .. } = *about;
        if at > 0
            && !cure.is_empty()
            && HealthBits::ABOUT[at - 1].cure == cure
            && HealthBits::ABOUT[at - 1].causes == causes
        {
            (causes, cure) = ("as above", "as above");
        }
        let meaning = meaning.trim_end_matches('.');
        format!("| {} | {name} | {meaning} | {causes} | {cure} |\n", bit.0.trailing_zeros())
    };
    let head = "| bit | name | meaning | probable causes | what to do |\n|---:|---|---|---|---|\n";
    head.to_owned() + &HealthBits::ABOUT.iter().enumerate().map(row).collect::<String>()
}

/// Every message that log, local socket or network carry.
fn topics_table() -> String {
    let row = |topic: Topic| {
        let Row { about, message, log, kind, key, question, .. } = *topic.row();
        // The channels of the log alone are in notes/flight-log.md.
        if kind == 0 && key.is_none() && question.is_none() {
            return None;
        }
        let code = |name: &str| format!("`{name}`");
        let message = message.strip_prefix("plumbline.v1.")?;
        let (log, kind) =
            (log.map_or_else(String::new, code), if kind > 0 { kind.to_string() } else { String::new() });
        let published = key.map_or_else(String::new, |key| {
            let hz =
                key.rates_hz.map(|hz| if hz.is_finite() { hz.to_string() } else { "all".into() }).join(", ");
            format!("`{}`, {}: {hz} Hz", key.name, words(&format!("{:?}", key.priority)))
        });
        let asked = question.map_or_else(String::new, |question| code(question.name));
        let about = about.trim_end_matches('.');
        Some(format!("| {about} | `{message}` | {log} | {kind} | {published} | {asked} |\n"))
    };
    let head = "| content | message | log | local socket | network, Hz over lan, wifi, radio | question |\n|---|---|---|---|---|---|\n";
    head.to_owned() + &Topic::ALL.into_iter().filter_map(row).collect::<String>()
}

/// `RealTime` as "real time".
fn words(name: &str) -> String {
    let spaced: String =
        name.chars().flat_map(|c| [' ', c].into_iter().skip(usize::from(!c.is_uppercase()))).collect();
    spaced.trim_start().to_lowercase()
}

fn health_py() -> String {
    let member = |(bit, name): &(HealthBits, &str)| {
        format!("    {} = 1 << {}\n", name.to_uppercase().replace(' ', "_"), bit.0.trailing_zeros())
    };
    let members: String = HealthBits::NAMES.iter().map(member).collect();
    format!(
        "\"\"\"The bits of `Estimate.health`. Made by `make messages`, of estimator/src/health.rs.\"\"\"\n\n\
         from enum import IntFlag\n\n\
         from plumbline._native import health_bits\n\n\n\
         class Health(IntFlag):\n    \
             \"\"\"Errors and warnings of an estimate. `Health(estimate.health)` names the bits of one.\"\"\"\n\n\
         {members}\n\n\
         _KNOWN = {{bit: name.upper().replace(\" \", \"_\") for bit, name in health_bits()}}\n\
         if _KNOWN != {{bit.value: bit.name for bit in Health}}:\n    \
             raise ImportError(\"plumbline: the native module is of another version than the package; install plumbline again\")\n"
    )
}

/// Text of the schema.
fn log_proto() -> String {
    let mut out = String::from(
        "// What a flight log holds beside images, version 1: every input, every order, every output, bit for bit.\n//\n\
         // Made by `make messages`, of the tables of the crate plumbline-record.\n//\n\
         // Numbers that must come back bit for bit are repeated fields, which keep a negative zero; a single field of\n\
         // proto3 does not. Frames and units are those of plumbline.proto; a pose is x y z (m) and the quaternion x y z w, a\n\
         // covariance 9x9 by columns.\n\
         syntax = \"proto3\";\n\n",
    );
    // Writing to a string cannot fail.
    let _ = writeln!(out, "package {PACKAGE};");
    let mut written = BTreeSet::new();
    messages().iter().for_each(|message| write_message(&mut out, message, &mut written));
    out
}

/// Text of the schema of what is in no log.
fn plumbline_proto() -> String {
    let of_log = messages();
    let mut all = of_log.clone();
    all.push(Outline::of::<Envelope>());
    add_topics(&mut all, "plumbline.v1");
    let all = all.split_off(of_log.len());
    let mut out = String::from(
        "// What a flight says on the local socket and over Zenoh beside the messages of its log, version 1.\n//\n\
         // Made by `make messages`, of the tables of the crate plumbline-record.\n//\n\
         // Frames: O odometry (z up along gravity, origin at the first pose), B body (the IMU's), M map (z up; loop-corrected: what\n\
         // lies in it moves), V vehicle (x forward, y left, z up; origin in the IMU). In O the odometry makes no steps while\n\
         // reset_counter and Odometry.jumps stay: a correction enters at no more than 0.2 m/s, 0.1 rad/s and 1 m/s^2, and is in the\n\
         // covariance until it has. Estimates are corrected at once. Units: SI. A pose is x y z (m) and the Hamilton quaternion\n\
         // x y z w, and takes coordinates from B to the frame that it is in. A reader ignores fields that it does not know.\n\
         syntax = \"proto3\";\n\npackage plumbline.v1;\n\nimport \"plumbline/v1/log.proto\";\n",
    );
    // Enumerations are those of the log.
    let mut known: BTreeSet<&str> =
        all.iter().flat_map(|m| enumerations(m, false)).map(|of| of.name).collect();
    all.iter().for_each(|message| write_message(&mut out, message, &mut known));
    for name in of_log.iter().map(|message| message.name).chain(known) {
        out = out.replace(&format!("\n  {name} "), &format!("\n  log.{name} "));
    }
    out
}

/// Writes a message, and enumerations outside it that are not written yet.
fn write_message(out: &mut String, message: &Outline, written: &mut BTreeSet<&'static str>) {
    for of in enumerations(message, false).filter(|of| written.insert(of.name)) {
        out.push('\n');
        write_enumeration(out, of, "");
    }
    out.push('\n');
    let is_of = |row: &&'static Row| row.message.rsplit('.').next() == Some(message.name);
    let channel = Topic::ALL.into_iter().map(Topic::row).find(is_of).and_then(|row| row.log);
    let channel = channel.map_or_else(String::new, |channel| format!("{channel}: "));
    comment(out, &(channel + message.about), "");
    let _ = writeln!(out, "message {} {{", message.name);
    enumerations(message, true).for_each(|of| write_enumeration(out, of, "  "));
    for about in (message.fields)() {
        comment(out, about.about, "  ");
        let repeated = if is_repeated(about.shape) { "repeated " } else { "" };
        let _ = writeln!(out, "  {repeated}{} {} = {};", type_name(about.shape), about.wire, about.tag);
    }
    out.push_str("}\n");
}

/// Type of a field in the text, as it is called inside its message.
fn type_name(shape: Shape) -> String {
    match kind(shape) {
        (_, Some(name)) => name.rsplit('.').next().unwrap_or(name).to_owned(),
        (kind, None) => kind.as_str_name().trim_start_matches("TYPE_").to_lowercase(),
    }
}

fn write_enumeration(out: &mut String, of: &Enumeration, indent: &str) {
    let name = of.name.rsplit('.').next().unwrap_or(of.name);
    let _ = writeln!(out, "{indent}enum {name} {{");
    for (number, (name, about)) in of.names.iter().zip(of.about).enumerate() {
        comment(out, about, &format!("{indent}  "));
        let _ = writeln!(out, "{indent}  {name} = {number};");
    }
    let _ = writeln!(out, "{indent}}}");
}

/// Writes a comment in lines of at most 120 characters.
fn comment(out: &mut String, about: &str, indent: &str) {
    let mut line = String::new();
    // Links of rustdoc are names here.
    let about = about.replace("[`", "`").replace("`]", "`").replace("`Self::", "`");
    for word in about.split_whitespace() {
        if !line.is_empty() && indent.len() + 3 + line.len() + 1 + word.len() > 120 {
            let _ = writeln!(out, "{indent}//{line}");
            line.clear();
        }
        line.push(' ');
        line.push_str(word);
    }
    if !line.is_empty() {
        let _ = writeln!(out, "{indent}//{line}");
    }
}
