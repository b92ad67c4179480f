//! Cures of values of the wrong type, and of lines that are no TOML: what to write in their place.

#[cfg(feature = "toml")]
use crate::keys::{Kind, Words};
#[cfg(feature = "toml")]
use toml::de::DeValue;

#[cfg(feature = "toml")]
/// Cure of a `value` that a key of this `kind` cannot have; `key` is its path, such as `camera[0].distortion`.
pub(crate) fn of_type(key: &str, value: &DeValue<'_>, kind: &Kind) -> String {
    match (value, kind) {
        (DeValue::String(text), Kind::Number | Kind::Count | Kind::Integer) => {
            of_text_for_a_number(text.trim())
        }
        (DeValue::Float(float), Kind::Count | Kind::Integer) => match whole(float.as_str()) {
            Some(whole) => format!("write it without a decimal point: {whole}"),
            None => "choose a whole number, and write it without a decimal point".into(),
        },
        (DeValue::String(text), Kind::Switch) => of_text_for_a_switch(&text.trim().to_lowercase()),
        (DeValue::Integer(number), Kind::Switch) if number.as_str() == "1" => "write true".into(),
        (DeValue::Integer(number), Kind::Switch) if number.as_str() == "0" => "write false".into(),
        (DeValue::Array(list), Kind::Number | Kind::Count | Kind::Integer | Kind::Text)
            if list.len() == 1 =>
        {
            "write the value without brackets".into()
        }
        (_, Kind::Number) => "write one number".into(),
        (_, Kind::Count | Kind::Integer) => "write one whole number".into(),
        (_, Kind::Switch) => "write true or false".into(),
        (_, Kind::Word(words)) => format!("choose one of {}", quoted(&words())),
        (value, Kind::Text) => match written(value) {
            Some(text) => format!("write it in quotation marks: \"{text}\""),
            None => "write one text in quotation marks".into(),
        },
        (value, Kind::WordOr(word, other)) => format!("{}, or write {word:?}", of_type(key, value, &other())),
        (DeValue::Table(_), Kind::List(element)) if matches!(element(), Kind::Table(_)) => {
            format!("write its heading with two brackets: [[{}]]", heading(key))
        }
        (value, Kind::List(element)) => match (element(), written(value)) {
            (Kind::Table(_), _) => format!("write its keys below [[{}]]", heading(key)),
            (Kind::Text, Some(text)) => format!("write it in brackets: [\"{text}\"]"),
            (_, Some(text)) => format!("write it in brackets: [{text}]"),
            _ => "write a list in brackets".into(),
        },
        (_, Kind::Array(rows, element)) => match element() {
            Kind::Array(numbers, _) => {
                format!("write {rows} rows in brackets, each of {numbers} numbers in brackets")
            }
            _ => format!("write {rows} numbers in brackets, with commas between them"),
        },
        (_, Kind::Table(_)) => format!("write its keys below a heading of their own: [{}]", heading(key)),
        (_, Kind::Variants(variants)) => {
            let words: Vec<String> = variants.iter().map(|variant| format!("{:?}", variant.word)).collect();
            let heading = heading(key);
            format!("write its keys below [{heading}], first `model`: one of {}", words.join(", "))
        }
    }
}

#[cfg(feature = "toml")]
/// The key's path as it is written in a heading.
fn heading(key: &str) -> String {
    key.split('.').map(|part| part.split('[').next().unwrap_or(part)).collect::<Vec<_>>().join(".")
}

#[cfg(feature = "toml")]
fn quoted(words: &Words) -> String {
    words.current.iter().map(|word| format!("{word:?}")).collect::<Vec<_>>().join(", ")
}

#[cfg(feature = "toml")]
/// A value without parts, as it stands in the file.
fn written(value: &DeValue<'_>) -> Option<String> {
    match value {
        DeValue::String(text) => Some(text.to_string()).filter(|text| !text.contains(['"', '\\', '\n'])),
        DeValue::Integer(number) if number.radix() == 10 => Some(number.as_str().to_owned()),
        DeValue::Float(number) => Some(number.as_str().to_owned()),
        DeValue::Boolean(switch) => Some(switch.to_string()),
        DeValue::Datetime(date) => Some(date.to_string()),
        _ => None,
    }
}

#[cfg(feature = "toml")]
/// A number with a decimal point that is a whole number.
fn whole(float: &str) -> Option<i64> {
    let value: f64 = float.replace('_', "").parse().ok()?;
    let whole = value as i64;
    (whole as f64 == value && whole.unsigned_abs() < 1 << 53).then_some(whole)
}

/// Cure of a text where a number is expected.
pub(crate) fn of_text_for_a_number(text: &str) -> String {
    if text.parse::<f64>().is_ok() {
        return format!("write it without quotation marks: {text}");
    }
    let with_point = text.replace(',', ".");
    if with_point.parse::<f64>().is_ok() {
        return format!("write a decimal point, not a comma: {with_point}");
    }
    match number_and_unit(text) {
        Some((number, _)) => format!("write the number alone, as the name of the key has the unit: {number}"),
        None => "write a number, without quotation marks".into(),
    }
}

#[cfg(feature = "toml")]
fn of_text_for_a_switch(text: &str) -> String {
    match text {
        "true" | "yes" | "on" | "1" => "write true, without quotation marks".into(),
        "false" | "no" | "off" | "0" => "write false, without quotation marks".into(),
        _ => "write true or false, without quotation marks".into(),
    }
}

/// `200 Hz` as `("200", "Hz")`; also with a decimal comma, which is given back as a point.
fn number_and_unit(text: &str) -> Option<(String, &str)> {
    let end = text.find(|c: char| !(c.is_ascii_digit() || "+-._,".contains(c))).unwrap_or(text.len());
    let number = text[..end].replace(',', ".");
    number.parse::<f64>().ok()?;
    Some((number, text[end..].trim()))
}

#[cfg(feature = "toml")]
/// Cure of a line that is no TOML.
pub(crate) fn of_syntax(line: &str) -> String {
    let otherwise = || "correct the syntax there".to_owned();
    let Some((_, value)) = line.split_once('=') else { return otherwise() };
    let value = value.split('#').next().unwrap_or_default().trim();
    let lower = value.to_lowercase();
    if ["true", "false", "yes", "no", "on", "off"].contains(&lower.as_str()) {
        return "a switch is true or false, in small letters".into();
    }
    let with_point = value.replace(',', ".");
    if value.contains(',') && with_point.parse::<f64>().is_ok() {
        return format!("write a decimal point, not a comma: {with_point}");
    }
    match number_and_unit(value) {
        Some((number, unit)) if unit.starts_with(|c: char| c.is_alphabetic() || c == '°' || c == '%') => {
            format!("write the number alone, as the name of the key has the unit: {number}")
        }
        // A text begins with a letter or as a path does.
        None if value.starts_with(|c: char| c.is_alphabetic() || c == '/' || c == '~') => {
            format!("write a text in quotation marks: \"{}\"", value.trim_matches(['"', '\'']))
        }
        _ => otherwise(),
    }
}

#[cfg(all(test, feature = "toml"))]
mod tests {
    use crate::Config;

    /// Message with which a file with this line in this table is refused.
    fn refused(table: &str, line: &str) -> String {
        let heading = if table.is_empty() { String::new() } else { format!("[{table}]\n") };
        let text = format!("base = \"euroc\"\n{heading}{line}\n");
        Config::from_toml_str(&text, "drone.toml").unwrap_err().to_string()
    }

    #[test]
    fn values_of_a_wrong_type_are_refused_with_what_to_write() {
        for (table, line, cure) in [
            ("imu", "rate_hz = \"200\"", "without quotation marks: 200"),
            ("imu", "rate_hz = \"200 Hz\"", "the name of the key has the unit: 200"),
            ("imu", "rate_hz = \"1,5\"", "not a comma: 1.5"),
            ("imu", "rate_hz = \"2,8e-3\"", "not a comma: 2.8e-3"),
            ("imu", "rate_hz = \"fast\"", "write a number, without quotation marks"),
            ("imu", "rate_hz = true", "write one number"),
            ("imu", "rate_hz = [200]", "write the value without brackets"),
            ("imu", "rate_hz = 2020-01-01", "write one number"),
            ("estimator.window", "keyframes = 7.0", "without a decimal point: 7"),
            ("estimator.window", "keyframes = 7.5", "choose a whole number"),
            ("estimator.lines", "enabled = 1", "; write true"),
            ("estimator.lines", "enabled = 0", "; write false"),
            ("estimator.lines", "enabled = \"Yes\"", "write true, without quotation marks"),
            ("estimator.lines", "enabled = \"maybe\"", "write true or false"),
            ("recorder", "keep = 3", "choose one of \"beginning\", \"newest\""),
            ("network", "vehicle = 7", "write it in quotation marks: \"7\""),
            ("network", "listen = \"tcp/0.0.0.0:7447\"", "write it in brackets: [\"tcp/0.0.0.0:7447\"]"),
            ("runtime", "tick_cpus = 1", "write it in brackets: [1]"),
            (
                "vehicle",
                "imu_to_vehicle_deg = 180",
                "write 3 numbers in brackets, with commas between them, or write \"unknown\"",
            ),
            ("", "imu = 3", "below a heading of their own: [imu]"),
            ("camera", "width_px = 1", "with two brackets: [[camera]]"),
            ("", "camera = 3", "write its keys below [[camera]]"),
            (
                "",
                "[[camera]]\ndistortion = \"radtan\"",
                "below [camera.distortion], first `model`: one of \"radial-tangential\"",
            ),
            ("", "[[camera]]\npose_b_c = [1, 0, 0, 0, 0, 1]", "give 4 rows, each of 4 numbers in brackets"),
            ("", "[[camera]]\npose_b_c = 1", "write 4 rows in brackets, each of 4"),
        ] {
            let message = refused(table, line);
            assert!(message.contains(cure) && !message.contains("correct the value"), "{line}: {message}");
        }
    }

    #[test]
    fn usual_slips_of_syntax_are_refused_with_what_to_write() {
        for (line, cure) in [
            ("rate_hz = 200 Hz", "the unit: 200"),
            ("rate_hz = 200,5", "a decimal point, not a comma: 200.5"),
            ("stuck_after_s = 0,1 # a tenth", "not a comma: 0.1"),
            ("rate_hz = True", "true or false, in small letters"),
            ("rate_hz = fast", "in quotation marks: \"fast\""),
            ("rate_hz = /dev/ttyS0", "in quotation marks: \"/dev/ttyS0\""),
            ("rate_hz = = 3", "correct the syntax there"),
            ("rate_hz", "correct the syntax there"),
        ] {
            let message = refused("imu", line);
            assert!(message.contains("line 3") && message.contains(cure), "{line}: {message}");
        }
    }
}
