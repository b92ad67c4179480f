//! Keys that a preset leaves to the user: their values hold [`MARK`] until they are set.

use crate::error::{ConfigError, Violation};
use crate::keys::joined;
use crate::{Config, ValidConfig};
use toml::{Table, Value};

/// Part of every value that is to be replaced.
pub const MARK: &str = "CHANGE-ME";

impl Config {
    /// Keys that still hold the placeholder of a preset. Such a configuration is valid, and can be completed, but no sensor
    /// can be opened by it.
    pub fn unset_keys(&self) -> Vec<Violation> {
        let mut found = Vec::new();
        if let Ok(table) = Table::try_from(self) {
            collect(&Value::Table(table), "", &mut found);
        }
        found
    }
}

impl ValidConfig {
    /// Refuses a configuration with [`Config::unset_keys`].
    ///
    /// # Errors
    /// When there are such keys; the message names the file.
    pub fn refuse_unset_keys(&self) -> Result<(), ConfigError> {
        ConfigError::if_any(self.origin(), self.unset_keys())
    }
}

fn collect(value: &Value, key: &str, found: &mut Vec<Violation>) {
    match value {
        Value::Table(table) => {
            table.iter().for_each(|(name, inner)| collect(inner, &joined(key, name), found))
        }
        Value::Array(list) => {
            list.iter().enumerate().for_each(|(k, inner)| collect(inner, &format!("{key}[{k}]"), found));
        }
        Value::String(text) if text.contains(MARK) => {
            let reason = format!("{text:?} still holds {MARK}");
            found.push(Violation::new(key, reason, "give the name that `plumbline devices` lists"));
        }
        _ => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn placeholders_of_a_preset_are_named_by_their_keys() {
        let config = Config::preset("mipi-stereo").unwrap();
        let keys: Vec<String> = config.unset_keys().into_iter().map(|violation| violation.key).collect();
        assert_eq!(keys, ["driver.v4l2.left", "driver.v4l2.right"]);
        let error = config.refuse_unset_keys().unwrap_err().to_string();
        assert!(error.contains("preset mipi-stereo") && error.contains("plumbline devices"), "{error}");
        assert!(Config::preset("euroc").unwrap().refuse_unset_keys().is_ok());
    }

    #[test]
    fn a_changed_configuration_is_still_that_of_its_file() {
        let text = "base = \"mipi-stereo\"\n[driver.v4l2]\nleft = \"/dev/CHANGE-ME\"\n";
        let config = Config::from_toml_str(text, "drone.toml").unwrap();
        assert!(config.refuse_unset_keys().unwrap_err().to_string().starts_with("drone.toml: 2 keys"));
        let changed = config.with("--set", |config| config.driver.v4l2.right = "/dev/video1".into()).unwrap();
        let error = changed.refuse_unset_keys().unwrap_err().to_string();
        assert!(error.starts_with("drone.toml: `driver.v4l2.left`: "), "{error}");
    }
}
