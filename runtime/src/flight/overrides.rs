//! `KEY=VALUE`: single keys of a configuration changed.

use super::FlightError;
use plumbline_config::{Config, ValidConfig};
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
        set(&mut table, change)?;
    }
    let text = toml::to_string(&table).map_err(|error| unwritable(error.to_string()))?;
    Ok(Config::from_toml_str(&text, "--set")?)
}

fn set(table: &mut Table, change: &str) -> Result<(), FlightError> {
    let (path, value) = change.split_once('=').ok_or_else(|| {
        FlightError::Invalid(format!("--set: '{change}' is not of the form section.key=value"))
    })?;
    let (sections, key) = path.trim().rsplit_once('.').unwrap_or(("", path.trim()));
    let mut section = table;
    for name in sections.split('.').filter(|name| !name.is_empty()) {
        section = section.get_mut(name).and_then(Value::as_table_mut).ok_or_else(|| {
            FlightError::Invalid(format!(
                "--set: '{change}': no section '{name}'; `plumbline config sim` prints all keys"
            ))
        })?;
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
    fn what_is_no_key_or_value_is_refused_by_name() {
        for (change, named) in [
            ("estimator.points.sigma_px", "section.key=value"),
            ("estimator.pints.sigma_px=1", "'pints'"),
            ("estimator.points.sigma=1", "sigma"),
            ("estimator.points.sigma_px=-1", "sigma_px"),
        ] {
            let error = changed(change).unwrap_err().to_string();
            assert!(error.contains(named), "{change}: {error}");
        }
    }
}
