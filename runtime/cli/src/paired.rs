//! Variants of an estimator, compared flight by flight: what `campaign --against` and `sweep --paired` share.

use super::{Usage, say};
use anyhow::{Context, Result, ensure};
use plumbline_config::ValidConfig;
use plumbline_flight::flight::with_overrides;
use plumbline_lab::report::paired::{PairedComparison, Variant};
use plumbline_lab::sweep::{CellResult, SweepAxis};
use serde_json::{Value, json};
use std::path::Path;

/// Reference of a campaign.
pub enum Against {
    /// Flights with these changes `key=value` on top.
    Changes(Vec<String>),
    /// Flights that were flown before.
    File(Variant),
}

impl Against {
    /// Parses `key=value,key=value`, checked on top of `overrides`, or the name of a file of `campaign --json`.
    ///
    /// # Errors
    /// When a change is refused, or the file is none of a campaign.
    pub fn parse(text: &str, config: &ValidConfig, overrides: &[String]) -> Result<Self> {
        if text.ends_with(".json") {
            return Ok(Self::File(read(Path::new(text))?));
        }
        let changes = changes(text)?;
        let all: Vec<String> = overrides.iter().chain(&changes).cloned().collect();
        with_overrides(config, &all)?;
        Ok(Self::Changes(changes))
    }
}

/// `a.b=1,c.d=[2, 3]` as `a.b=1` and `c.d=[2, 3]`.
fn changes(text: &str) -> Result<Vec<String>, Usage> {
    let bad = || {
        Usage(format!(
            "--against: '{text}' is neither key=value,key=value nor the name of a file that ends in .json"
        ))
    };
    let axis = SweepAxis::parse(text).map_err(|_| bad())?;
    let mut changes = vec![format!("{}={}", axis.key, axis.values[0])];
    for value in &axis.values[1..] {
        if !value.contains('=') {
            return Err(bad());
        }
        changes.push(value.clone());
    }
    Ok(changes)
}

fn read(path: &Path) -> Result<Variant> {
    let name = path.display().to_string();
    let text = std::fs::read_to_string(path).with_context(|| format!("--against {name}"))?;
    let rows: Vec<Value> = serde_json::from_str(&text)
        .map_err(|e| Usage(format!("--against {name}: not a file of `campaign --json`: {e}")))?;
    let variant = Variant::of_rows(name.clone(), &rows);
    ensure!(!variant.is_empty(), Usage(format!("--against {name}: contains no report of a flight")));
    Ok(variant)
}

/// Name of a variant with these changes.
#[must_use]
pub fn name(changes: &[String]) -> String {
    if changes.is_empty() { "as configured".into() } else { changes.join(" ") }
}

/// The settings of a sweep as variants, in its order.
#[must_use]
pub fn variants(results: &[CellResult]) -> Vec<Variant> {
    let mut settings: Vec<&[String]> = Vec::new();
    for result in results {
        if !settings.contains(&result.setting.as_slice()) {
            settings.push(&result.setting);
        }
    }
    let of_setting = |setting: &&[String]| {
        let cells = results.iter().filter(|cell| cell.setting == *setting && cell.error.is_none());
        let row = |cell: &CellResult| json!({ "subject": cell.subject, "seed": cell.seed, "start_s": cell.start_s, "report": cell.report });
        Variant::of_rows(name(setting), &cells.map(row).collect::<Vec<_>>())
    };
    settings.iter().map(of_setting).collect()
}

/// Compares every setting of a sweep with the first.
#[must_use]
pub fn with_first(variants: &[Variant]) -> Vec<PairedComparison> {
    match variants {
        [base, others @ ..] => others.iter().map(|other| PairedComparison::of(base, other)).collect(),
        [] => Vec::new(),
    }
}

/// Writes comparisons to `json`, if there are any.
///
/// # Errors
/// When the file cannot be written.
pub fn write(comparisons: &[PairedComparison], json: Option<&Path>) -> Result<()> {
    let Some(path) = json.filter(|_| !comparisons.is_empty()) else { return Ok(()) };
    let text = serde_json::to_string_pretty(comparisons)?;
    std::fs::write(path, text).with_context(|| path.display().to_string())
}

/// Prints comparisons as tables.
///
/// # Errors
/// When there is nothing to compare.
pub fn say_each(comparisons: &[PairedComparison]) -> Result<()> {
    ensure!(!comparisons.is_empty(), Usage("only one variant; give a second one to compare with".into()));
    for comparison in comparisons {
        say(format_args!("\n{}", comparison.markdown()));
    }
    let unpaired = comparisons.iter().find(|comparison| comparison.flights == 0);
    ensure!(
        unpaired.is_none(),
        "no flight was flown by both: paths, scenes, faults, seeds, starts and lengths must agree"
    );
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_variant_is_a_list_of_changes() {
        let listed = changes("a.b=1,c.d=[2, 3],e=\"x,y\"").unwrap();
        assert_eq!(listed, ["a.b=1", "c.d=[2, 3]", "e=\"x,y\""]);
        for bad in ["a.b", "a.b=1,2", "=1"] {
            assert!(changes(bad).unwrap_err().0.contains("--against"), "{bad}");
        }
    }

    #[test]
    fn a_file_must_be_one_of_a_campaign() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("flown.json");
        std::fs::write(&path, "[]").unwrap();
        assert!(read(&path).unwrap_err().to_string().contains("contains no report"));
        std::fs::write(&path, "{}").unwrap();
        assert!(read(&path).unwrap_err().to_string().contains("not a file of `campaign --json`"));
        std::fs::write(&path, r#"[{"path": "a", "seed": 1, "report": {"resets": 0}}]"#).unwrap();
        assert_eq!(read(&path).unwrap().len(), 1);
    }
}
