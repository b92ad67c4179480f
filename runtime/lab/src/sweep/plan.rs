//! Which cells a sweep has: its settings, times its data sets, times the seeds.

use super::subject::{Common, Subject};
use super::{Cell, SweepError};
use std::sync::Arc;

/// A key of the configuration and the values that it takes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SweepAxis {
    /// Dotted path of the key.
    pub key: String,
    /// Its values as TOML.
    pub values: Vec<String>,
}

impl SweepAxis {
    /// Parses `key=value,value`; commas within brackets and quotes belong to a value.
    ///
    /// # Errors
    /// When it is not of that form.
    pub fn parse(text: &str) -> Result<Self, SweepError> {
        let bad = || SweepError::BadAxis(text.to_owned());
        let (key, values) = text.split_once('=').ok_or_else(bad)?;
        let values: Vec<String> = split_values(values).into_iter().map(|v| v.trim().to_owned()).collect();
        let key = key.trim().to_owned();
        if key.is_empty() || values.iter().any(String::is_empty) {
            return Err(bad());
        }
        Ok(Self { key, values })
    }
}

fn split_values(text: &str) -> Vec<&str> {
    let (mut values, mut start, mut depth, mut quote) = (Vec::new(), 0, 0_i32, None);
    for (at, c) in text.char_indices() {
        match (quote, c) {
            (Some(open), _) if c == open => quote = None,
            (Some(_), _) => {}
            (None, '"' | '\'') => quote = Some(c),
            (None, '[' | '{') => depth += 1,
            (None, ']' | '}') => depth -= 1,
            (None, ',') if depth == 0 => {
                values.push(&text[start..at]);
                start = at + 1;
            }
            (None, _) => {}
        }
    }
    values.push(&text[start..]);
    values
}

/// Every setting of some axes; the last axis turns fastest.
fn settings(axes: &[SweepAxis]) -> Vec<Vec<String>> {
    axes.iter().fold(vec![Vec::new()], |settings, axis| {
        let with = |setting: &Vec<String>, value: &String| {
            let change = format!("{}={value}", axis.key);
            setting.iter().cloned().chain([change]).collect()
        };
        settings.iter().flat_map(|s| axis.values.iter().map(move |v| with(s, v))).collect()
    })
}

/// A sweep.
#[derive(Clone, Debug)]
pub struct Plan {
    /// Changes `key=value` of the configuration.
    settings: Vec<Vec<String>>,
    subjects: Vec<Subject>,
    /// Seeds of simulated flights; each one's own if there are none.
    seeds: Vec<u64>,
    /// Starts in the data set or path, s; each one's own if there are none.
    starts: Vec<f64>,
    common: Arc<Common>,
}

impl Plan {
    /// A sweep over all settings of `axes`; without any it has one setting, the configuration as it is.
    ///
    /// # Errors
    /// When a key is swept twice.
    pub fn new(
        axes: Vec<SweepAxis>,
        subjects: Vec<Subject>,
        seeds: Vec<u64>,
        common: Common,
    ) -> Result<Self, SweepError> {
        for (index, axis) in axes.iter().enumerate() {
            if axes[..index].iter().any(|earlier| earlier.key == axis.key) {
                return Err(SweepError::DoubleAxis(axis.key.clone()));
            }
        }
        Ok(Self { seeds, ..Self::of_settings(settings(&axes), subjects, common) })
    }

    /// A sweep over settings that need not be those of axes.
    #[must_use]
    pub fn of_settings(settings: Vec<Vec<String>>, subjects: Vec<Subject>, common: Common) -> Self {
        Self { settings, subjects, seeds: Vec::new(), starts: Vec::new(), common: Arc::new(common) }
    }

    /// The sweep with every flight begun at each of `starts`, s into the data set or path.
    #[must_use]
    pub fn from_starts(self, starts: Vec<f64>) -> Self {
        Self { starts, ..self }
    }

    /// Every setting, as changes `key=value` of the configuration.
    #[must_use]
    pub fn settings(&self) -> &[Vec<String>] {
        &self.settings
    }

    /// All cells; the number of a cell is its place here. Data sets that were recorded have no seeds.
    #[must_use]
    pub fn cells(&self) -> Vec<Cell> {
        let flights: Vec<(&Subject, Option<u64>)> = self
            .subjects
            .iter()
            .flat_map(|subject| match subject {
                Subject::Recorded { .. } => vec![(subject, None)],
                Subject::Simulated { scenario, .. } if self.seeds.is_empty() => {
                    vec![(subject, Some(scenario.seed))]
                }
                Subject::Simulated { .. } => self.seeds.iter().map(|s| (subject, Some(*s))).collect(),
            })
            .collect();
        let starts: Vec<Option<f64>> = match self.starts.is_empty() {
            true => vec![None],
            false => self.starts.iter().copied().map(Some).collect(),
        };
        let flights: Vec<_> =
            flights.iter().flat_map(|flight| starts.iter().map(move |start_s| (*flight, *start_s))).collect();
        let of = self.settings.len() * flights.len();
        let pairs = self.settings.iter().flat_map(|s| flights.iter().map(move |flight| (s, flight)));
        pairs
            .enumerate()
            .map(|(index, (setting, ((subject, seed), start_s)))| Cell {
                index,
                of,
                setting: setting.clone(),
                subject: (*subject).clone(),
                seed: *seed,
                start_s: *start_s,
                common: Arc::clone(&self.common),
            })
            .collect()
    }

    /// The cell of that number.
    ///
    /// # Errors
    /// When there is none.
    pub fn cell(&self, cell: usize) -> Result<Cell, SweepError> {
        let mut cells = self.cells();
        if cell >= cells.len() {
            return Err(SweepError::NoSuchCell { cell, last: cells.len().saturating_sub(1) });
        }
        Ok(cells.swap_remove(cell))
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// Two keys of three and two values, over one recorded and one simulated flight with two seeds.
    pub(in crate::sweep) fn plan() -> Plan {
        let axes = ["estimator.points.sigma_px=0.3,0.4,0.5", "estimator.lines.enabled=true,false"];
        let axes = axes.iter().map(|text| SweepAxis::parse(text).unwrap()).collect();
        let simulated = Subject::Simulated {
            name: "sim:room".into(),
            scenario: Box::default(),
            extrinsics_error_deg: 0.0,
            faults: Vec::new(),
        };
        let subjects = vec![Subject::Recorded { path: "V1_01".into() }, simulated];
        Plan::new(axes, subjects, vec![5, 6], Common::default()).unwrap()
    }

    #[test]
    fn every_setting_meets_every_flight_once() {
        let cells = plan().cells();
        assert_eq!(cells.len(), 3 * 2 * (1 + 2));
        assert!(cells.iter().enumerate().all(|(k, cell)| cell.index == k && cell.of == cells.len()));
        let names: std::collections::BTreeSet<String> = cells.iter().map(Cell::describe).collect();
        assert_eq!(names.len(), cells.len());
        assert_eq!(cells[4].setting, ["estimator.points.sigma_px=0.3", "estimator.lines.enabled=false"]);
        assert_eq!((cells[3].seed, cells[4].seed, cells[5].seed), (None, Some(5), Some(6)));
        assert!(plan().cell(17).is_ok());
        assert!(plan().cell(18).unwrap_err().to_string().contains("cells 0 to 17"));
    }

    #[test]
    fn every_flight_is_begun_at_every_start() {
        let cells = plan().from_starts(vec![0.0, 0.5]).cells();
        assert_eq!(cells.len(), 3 * 2 * (1 + 2) * 2);
        assert_eq!((cells[0].start_s, cells[1].start_s, cells[1].seed), (Some(0.0), Some(0.5), None));
        let names: std::collections::BTreeSet<String> = cells.iter().map(Cell::describe).collect();
        assert_eq!(names.len(), cells.len());
    }

    #[test]
    fn commas_within_brackets_and_quotes_do_not_split() {
        let axis = SweepAxis::parse("a.b=[1, 2],[3, 4], \"x,y\"").unwrap();
        assert_eq!(axis.values, ["[1, 2]", "[3, 4]", "\"x,y\""]);
        for bad in ["a.b", "=1", "a=", "a=1,,2"] {
            assert!(SweepAxis::parse(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn a_key_is_swept_once() {
        let axis = SweepAxis::parse("a.b=1").unwrap();
        let twice = Plan::new(vec![axis.clone(), axis], Vec::new(), Vec::new(), Common::default());
        assert!(matches!(twice, Err(SweepError::DoubleAxis(key)) if key == "a.b"));
    }
}
