//! `KEY=VALUE`: single keys of a configuration changed.

use super::FlightError;
use plumbline_config::{Config, ConfigError, ValidConfig};
use std::path::Path;
use toml::{Table, Value};

/// `config` with every `key=value` of `changes` in place, validated. Keys are dotted paths of the TOML
/// file, values are TOML; what is no TOML value is taken for a string.
///
/// # Errors
/// When a change is not of that form, or the changed configuration is refused.
pub fn with_overrides(config: &ValidConfig, changes: &[String]) -> Result<ValidConfig, FlightError> {
    if changes.is_empty() {
        return Ok(config.clone());
    }
    let unwritable = |reason: String| FlightError::Invalid(format!("--set: {reason}"));
    let mut table: Table =
        toml::from_str(&config.to_toml()?).map_err(|error| unwritable(error.to_string()))?;
    for change in changes {
        if change.split('=').next().is_some_and(|key| key.trim() == "base") {
            return Err(unwritable(
                "`base` belongs into the first line of a file: begin with it by --config PRESET".into(),
            ));
        }
        set(&mut table, change)?;
    }
    let text = toml::to_string(&table).map_err(|error| unwritable(error.to_string()))?;
    // A picture that is named on the command line is looked for from the working directory on.
    Config::from_toml_in(&text, &format!("--set {}", changes.join(" ")), Path::new(""))
        .map(|changed| changed.in_place_of(config))
        .map_err(|error| without_lines(error).into())
}

/// Removes the line numbers of a refusal: the file that they refer to exists in memory only.
fn without_lines(error: ConfigError) -> ConfigError {
    match error {
        ConfigError::Invalid { origin, violations } => {
            let violations = violations.into_iter().map(|violation| violation.at_line(None)).collect();
            ConfigError::Invalid { origin, violations }
        }
        other => other,
    }
}

fn set(table: &mut Table, change: &str) -> Result<(), FlightError> {
    let (path, value) = change.split_once('=').ok_or_else(|| {
        FlightError::Invalid(format!("--set: '{change}' is not of the form section.key=value"))
    })?;
    // camera[0].focal_px is camera.0.focal_px.
    let path = path.trim().replace('[', ".").replace(']', "");
    let no_section = |name: &str| {
        FlightError::Invalid(format!("--set: '{change}': no section '{name}'; camera.0 is the left camera"))
    };
    let (sections, key) = path.rsplit_once('.').unwrap_or(("", &path));
    let mut section = table;
    let mut names = sections.split('.').filter(|name| !name.is_empty());
    while let Some(name) = names.next() {
        // A section that does not exist is refused with its neighbour, as an unknown key.
        section = match section.entry(name).or_insert_with(|| Value::Table(Table::new())) {
            Value::Table(table) => table,
            Value::Array(entries) => {
                let index = names.next().unwrap_or_default();
                let entry = index.parse().ok().and_then(|index: usize| entries.get_mut(index));
                entry.and_then(Value::as_table_mut).ok_or_else(|| no_section(&format!("{name}.{index}")))?
            }
            _ => return Err(no_section(name)),
        };
    }
    section.insert(key.to_owned(), parsed(value.trim()));
    Ok(())
}

fn parsed(value: &str) -> Value {
    toml::from_str::<Table>(&format!("value = {value}"))
        .ok()
        .and_then(|mut table| table.remove("value"))
        .unwrap_or_else(|| Value::String(value.to_owned()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn changed(change: &str) -> Result<ValidConfig, FlightError> {
        with_overrides(&Config::preset("sim").unwrap(), &[change.to_owned()])
    }

    #[test]
    fn a_key_is_changed_and_nothing_else() {
        let expected = Config::preset("sim").unwrap();
        let expected = expected.with("test", |c| c.estimator.points.sigma_px = 0.3).unwrap();
        assert_eq!(changed("estimator.points.sigma_px=0.3").unwrap(), expected);
        assert_eq!(changed("network.vehicle=hawk").unwrap().network.vehicle, "hawk");
    }

    #[test]
    fn a_camera_is_named_by_its_number() {
        for change in ["camera[1].focal_px=[300.0, 301.0]", "camera.1.focal_px=[300.0, 301.0]"] {
            assert_eq!(changed(change).unwrap().camera[1].focal_px, [300.0, 301.0], "{change}");
        }
        let error = changed("camera[2].focal_px=[300.0, 301.0]").unwrap_err().to_string();
        assert!(error.contains("camera.2"), "{error}");
    }

    #[test]
    fn a_refusal_names_the_change_and_no_line_of_a_file_that_nobody_has() {
        let error = changed("estimator.points.sigma_px=-1").unwrap_err().to_string();
        assert!(error.contains("--set estimator.points.sigma_px=-1") && !error.contains("line"), "{error}");
    }

    #[test]
    fn a_key_or_section_that_is_meant_is_named() {
        for (change, meant) in [
            ("max_points=200", "did you mean `estimator.points.max_points`?"),
            ("estimator.max_points=200", "did you mean `estimator.points.max_points`?"),
            ("points.max_points=200", "did you mean `estimator.points`?"),
            ("estimator.point.enabled=true", "did you mean `points`?"),
        ] {
            let error = changed(change).unwrap_err().to_string();
            assert!(error.contains(meant), "{change}: {error}");
        }
    }

    #[test]
    fn what_is_no_key_or_value_is_refused_by_name() {
        for (change, named) in [
            ("estimator.points.sigma_px", "section.key=value"),
            ("estimator.pints.sigma_px=1", "`estimator.pints`: unknown key; did you mean `points`?"),
            ("estimator.points.sigma=1", "sigma"),
            ("estimator.points.sigma_px=-1", "sigma_px"),
        ] {
            let error = changed(change).unwrap_err().to_string();
            assert!(error.contains(named), "{change}: {error}");
        }
    }
}
