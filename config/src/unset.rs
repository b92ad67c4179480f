//! Keys that a preset leaves to the user: their values hold [`MARK`] until they are set.

use crate::error::{ConfigError, Violation};
use crate::{Config, ValidConfig};
use toml::{Table, Value};

/// Part of every value that is to be replaced.
pub const MARK: &str = "CHANGE-ME";

impl Config {
    /// Keys that still hold the placeholder of a preset. Such a configuration is valid, and can be completed, but no sensor
    /// can be opened by it.
    #[must_use]
    pub fn unset_keys(&self) -> Vec<Violation> {
        let mut found = Vec::new();
        if let Ok(table) = Table::try_from(self) {
            collect(&Value::Table(table), "", &mut found);
        }
        found
    }
}

impl ValidConfig {
    /// As [`Config::unset_keys`], each with its line in the file that the configuration was read from.
    #[must_use]
    pub fn unset_keys(&self) -> Vec<Violation> {
        let source = self.source();
        let located = |violation: Violation| {
            let known = source.unset.iter().find(|(key, _)| *key == violation.key);
            match (known.map(|(_, line)| *line), &source.base) {
                (Some(None), Some(base)) => {
                    let reason = format!("{} (of the base {base:?})", violation.reason);
                    Violation { reason, ..violation }
                }
                (line, _) => violation.at_line(line.flatten()),
            }
        };
        Config::unset_keys(self).into_iter().map(located).collect()
    }

    /// Refuses a configuration with [`Self::unset_keys`].
    ///
    /// # Errors
    /// When there are such keys; the message names the file.
    pub fn refuse_unset_keys(&self) -> Result<(), ConfigError> {
        let origin = match self.source().origin.as_str() {
            "" => "the configuration",
            origin => origin,
        };
        ConfigError::if_any(origin, self.unset_keys())
    }
}

fn collect(value: &Value, key: &str, found: &mut Vec<Violation>) {
    match value {
        Value::Table(table) => {
            let dot = if key.is_empty() { "" } else { "." };
            table.iter().for_each(|(name, inner)| collect(inner, &format!("{key}{dot}{name}"), found));
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
    fn placeholders_have_the_line_of_the_file_or_the_name_of_its_base() {
        let text = "base = \"mipi-stereo\"\n[driver.v4l2]\nleft = \"/dev/CHANGE-ME\"\n";
        let config = Config::from_toml_str(text, "drone.toml").unwrap();
        let error = config.refuse_unset_keys().unwrap_err().to_string();
        assert!(
            error.contains("drone.toml: 2 keys") && error.contains("`driver.v4l2.left` (line 3)"),
            "{error}"
        );
        let of_base = "still holds CHANGE-ME (of the base \"mipi-stereo\")";
        assert!(error.contains(of_base) && !error.contains("`driver.v4l2.right` (line"), "{error}");
        // A change elsewhere leaves the lines what they are, and a key that is set is no longer named.
        let changed = config.with("--set", |config| config.driver.v4l2.right = "/dev/video1".into()).unwrap();
        let error = changed.refuse_unset_keys().unwrap_err().to_string();
        assert!(error.contains("drone.toml: `driver.v4l2.left` (line 3)"), "{error}");
    }
}
