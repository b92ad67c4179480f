//! The open table: a row for each sequence, medians over its starts, what others have published beside it, and what is missing.

use super::published::{Knowledge, PublishedFigure, SUITES, Suite};
use super::table::{distinct, markdown, number, quoted, ratio};
use super::{CellFigures, CellResult};
use std::fmt::Write as _;
use std::path::Path;

/// Digits of a digest that are printed.
const DIGEST_DIGITS: usize = 16;

/// Format of the table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// Markdown, with all that is to be said beside the figures.
    Markdown,
    /// Comma-separated values: the rows of the sequences alone, in full precision.
    Csv,
    /// LaTeX: two tables of `tabular`, to be included.
    Latex,
}

impl Format {
    /// The format of a file by its ending.
    #[must_use]
    pub fn of(path: &Path) -> Option<Self> {
        match path.extension()?.to_str()? {
            "md" => Some(Self::Markdown),
            "csv" => Some(Self::Csv),
            "tex" => Some(Self::Latex),
            _ => None,
        }
    }
}

/// A figure of the table.
struct Column {
    head: &'static str,
    csv: &'static str,
    digits: usize,
    of: fn(&CellFigures) -> Option<f64>,
}

/// The figures, in order; each is the median over the starts, but `max`, the largest of all.
const COLUMNS: [Column; 14] = [
    Column { head: "path m", csv: "path_m", digits: 1, of: |f| f.distance_m },
    Column { head: "causal ATE m", csv: "ate_causal_m", digits: 4, of: |f| f.ate_rmse_m },
    Column { head: "final ATE m", csv: "ate_final_m", digits: 4, of: |f| f.ate_final_m },
    Column { head: "coverage %", csv: "coverage_percent", digits: 1, of: |f| Some(100.0 * f.completion) },
    Column { head: "RPE 1 s m", csv: "rpe_1s_m", digits: 4, of: |f| f.rpe_1s_m },
    Column { head: "NEES position", csv: "nees_position", digits: 2, of: |f| ratio(f, |c| &c.estimates, 0) },
    Column { head: "tilt", csv: "nees_tilt", digits: 2, of: |f| ratio(f, |c| &c.estimates, 1) },
    Column { head: "yaw", csv: "nees_yaw", digits: 2, of: |f| ratio(f, |c| &c.estimates, 2) },
    Column { head: "velocity", csv: "nees_velocity", digits: 2, of: |f| ratio(f, |c| &c.estimates, 3) },
    Column { head: "steps", csv: "nees_steps", digits: 2, of: |f| ratio(f, |c| &c.estimates, 4) },
    Column { head: "frame ms p50", csv: "frame_cpu_ms_p50", digits: 1, of: |f| Some(f.frame_cpu_ms_p50) },
    Column { head: "p99", csv: "frame_cpu_ms_p99", digits: 1, of: |f| Some(f.frame_cpu_ms_p99) },
    Column { head: "max", csv: "frame_cpu_ms_max", digits: 1, of: |f| f.frame_cpu_ms_max },
    Column { head: "resets", csv: "resets", digits: 0, of: |f| Some(f64::from(f.resets)) },
];
/// Place of the causal error.
const CAUSAL: usize = 1;
/// Place of the error as known at the end.
const FINAL: usize = 2;
/// Place of the longest frame.
const LONGEST: usize = 12;

/// Frame rate of the sequences of known length, Hz.
const RATE_HZ: f64 = 20.0;
/// Least share of a sequence's length that counts as the whole; the worst of them lacks a sixth of its frames.
const WHOLE: f64 = 0.75;

/// A sequence over all its starts.
struct Row {
    name: String,
    flights: usize,
    /// Fewest and most cameras that were used.
    cameras: Option<[usize; 2]>,
    /// Flights that ended without a pose.
    failed: usize,
    figures: [Option<f64>; COLUMNS.len()],
    /// Smallest and largest causal error of the starts.
    ate_range_m: Option<[f64; 2]>,
    /// Digest of the first start.
    digest: String,
}

/// The median; of an even number the mean of the middle two. `None` of none.
fn median(values: impl IntoIterator<Item = f64>) -> Option<f64> {
    let mut values: Vec<f64> = values.into_iter().collect();
    values.sort_by(f64::total_cmp);
    let upper = *values.get(values.len() / 2)?;
    let lower = values[(values.len() - 1) / 2];
    Some(lower + 0.5 * (upper - lower))
}

/// Smallest and largest number.
fn span(numbers: impl Iterator<Item = usize> + Clone) -> Option<[usize; 2]> {
    numbers.clone().min().zip(numbers.max()).map(|(least, most)| [least, most])
}

impl Row {
    fn of(name: String, results: &[&CellResult]) -> Self {
        let figures = results.iter().filter_map(|r| r.figures.as_ref());
        let flown: Vec<&CellFigures> = figures.filter(|f| f.completion > 0.0).collect();
        let figures = std::array::from_fn(|k| {
            let values = flown.iter().filter_map(|f| (COLUMNS[k].of)(f));
            if k == LONGEST { values.reduce(f64::max) } else { median(values) }
        });
        let ates = || flown.iter().filter_map(|f| f.ate_rmse_m);
        let digest = flown.first().map_or("", |f| &f.estimate_digest);
        let whole_s = Suite::of(&name).and_then(|suite| suite.find(&name)?.1.length_s);
        let flown_s =
            |r: &&CellResult| Some(r.figures.as_ref()?.frames as f64 / RATE_HZ + r.start_s.unwrap_or(0.0));
        let flown_s = results.iter().filter_map(flown_s).reduce(f64::max);
        let part_s = flown_s.filter(|flown_s| whole_s.is_some_and(|whole_s| *flown_s < WHOLE * whole_s));
        Self {
            name: part_s.map_or_else(|| name.clone(), |part_s| format!("{name} (part of {part_s:.0} s)")),
            flights: results.len(),
            cameras: span(flown.iter().filter_map(|f| f.cameras)),
            failed: results.len() - flown.len(),
            figures,
            ate_range_m: ates().reduce(f64::min).zip(ates().reduce(f64::max)).map(|(low, high)| [low, high]),
            digest: digest.get(..DIGEST_DIGITS).unwrap_or(digest).to_owned(),
        }
    }

    /// Number of cameras; empty where it is unknown.
    fn cameras(&self) -> String {
        match self.cameras {
            None => String::new(),
            Some([least, most]) if least == most => most.to_string(),
            Some([least, most]) => format!("{least} to {most}"),
        }
    }

    /// Name, flights, cameras, figures, digest.
    fn cells(&self) -> Vec<String> {
        let flights = match self.failed {
            0 => self.flights.to_string(),
            failed => format!("{} of {}", self.flights - failed, self.flights),
        };
        let figures =
            self.figures.iter().zip(&COLUMNS).map(|(figure, column)| number(*figure, column.digits));
        [self.name.clone(), flights, self.cameras()]
            .into_iter()
            .chain(figures)
            .chain([self.digest.clone()])
            .collect()
    }
}

/// The table of one setting.
pub struct OpenTable {
    rows: Vec<Row>,
    /// Suites of which there is a sequence, else all.
    suites: Vec<&'static Suite>,
    footer: Vec<String>,
}

/// Last name of a path that is no `mav0`: data sets are called so.
fn name_of(subject: &str) -> String {
    if subject.starts_with("sim:") {
        return subject.to_owned();
    }
    let names = Path::new(subject).iter().rev().map(|name| name.to_string_lossy().into_owned());
    names.into_iter().find(|name| name != "mav0").unwrap_or_else(|| subject.to_owned())
}

impl OpenTable {
    /// The table of `results`, which are of one setting. Sequences of a suite come in its order.
    #[must_use]
    pub fn new(results: &[CellResult]) -> Self {
        let subjects = distinct(results.iter().map(|r| r.subject.as_str()));
        let mut rows: Vec<Row> = subjects
            .iter()
            .map(|subject| {
                let of: Vec<&CellResult> = results.iter().filter(|r| r.subject == *subject).collect();
                Row::of(name_of(subject), &of)
            })
            .collect();
        let order = |row: &Row| {
            let place = |(k, suite): (usize, &Suite)| Some((k, suite.find(&row.name)?.0));
            SUITES.iter().enumerate().find_map(place).unwrap_or((SUITES.len(), 0))
        };
        rows.sort_by(|a, b| order(a).cmp(&order(b)).then_with(|| a.name.cmp(&b.name)));
        let present = SUITES.iter().filter(|s| rows.iter().any(|row| s.find(&row.name).is_some()));
        let mut suites: Vec<&Suite> = present.collect();
        if suites.is_empty() {
            suites = SUITES.iter().collect();
        }
        let footer = footer(results);
        Self { rows, suites, footer }
    }

    /// Sequences of `suite` that were not flown.
    fn missing(&self, suite: &Suite) -> Vec<&'static str> {
        let is_here = |name: &&str| self.rows.iter().any(|row| row.name == **name);
        suite.sequences.iter().map(|sequence| sequence.name).filter(|name| !is_here(name)).collect()
    }

    /// A row with the means of `suite` over the sequences that are there; `None` without any.
    fn mean(&self, suite: &Suite) -> Option<Row> {
        let rows: Vec<&Row> = self.rows.iter().filter(|row| suite.find(&row.name).is_some()).collect();
        let figures = std::array::from_fn(|k| {
            let values: Vec<f64> = rows.iter().filter_map(|row| row.figures[k]).collect();
            match k {
                // A mean of some sequences is no mean of the suite.
                CAUSAL | FINAL if values.len() < rows.len() => None,
                LONGEST => values.into_iter().reduce(f64::max),
                _ => (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64),
            }
        });
        (!rows.is_empty()).then(|| Row {
            name: format!("mean of {} of {}", rows.len(), suite.sequences.len()),
            flights: rows.iter().map(|row| row.flights).sum(),
            cameras: span(rows.iter().filter_map(|row| row.cameras).flatten()),
            failed: rows.iter().map(|row| row.failed).sum(),
            figures,
            ate_range_m: None,
            digest: String::new(),
        })
    }

    /// Rows of all sequences and the means of the suites.
    fn all_rows(&self) -> Vec<Vec<String>> {
        let means = self.suites.iter().filter_map(|suite| self.mean(suite));
        self.rows.iter().map(Row::cells).chain(means.map(|row| row.cells())).collect()
    }

    /// The table as text.
    #[must_use]
    pub fn text(&self, format: Format) -> String {
        match format {
            Format::Markdown => self.markdown(),
            Format::Csv => self.csv(),
            Format::Latex => self.latex(),
        }
    }

    fn markdown(&self) -> String {
        let mut text = markdown(&head(), 1, self.all_rows().into_iter());
        for line in &self.footer {
            let _ = write!(text, "\n\n{line}");
        }
        for suite in &self.suites {
            let _ = write!(text, "\n\n## {}: published by others, mean of {}\n\n", suite.name, suite.mean_of);
            let rows = suite.published.iter().map(|figure| published_cells(figure).to_vec());
            text += &markdown(&PUBLISHED_HEAD.map(str::to_owned), PUBLISHED_HEAD.len(), rows);
            if let Some(line) = self.missing_line(suite) {
                let _ = write!(text, "\n\n{line}");
            }
        }
        text
    }

    /// Line with the missing sequences of a suite and their source; `None` if none is missing.
    #[must_use]
    fn missing_line(&self, suite: &Suite) -> Option<String> {
        let missing = self.missing(suite);
        let list = if missing.len() == suite.sequences.len() { "all".to_owned() } else { missing.join(", ") };
        (!missing.is_empty()).then(|| {
            format!(
                "Missing of {}: {list} ({} of {}). To be had at: {}.",
                suite.name,
                missing.len(),
                suite.sequences.len(),
                suite.available_at
            )
        })
    }

    fn csv(&self) -> String {
        let first = ["sequence", "flights", "failed", "cameras"];
        let last = ["ate_causal_min_m", "ate_causal_max_m", "digest"];
        let head = first.into_iter().chain(COLUMNS.iter().map(|column| column.csv)).chain(last);
        let mut text = head.collect::<Vec<_>>().join(",") + "\n";
        for row in &self.rows {
            let value = |value: Option<f64>| value.map_or_else(String::new, |v| v.to_string());
            let mut cells =
                vec![quoted(&row.name), row.flights.to_string(), row.failed.to_string(), row.cameras()];
            cells.extend(row.figures.iter().map(|figure| value(*figure)));
            cells.extend([0, 1].map(|k| value(row.ate_range_m.map(|range| range[k]))));
            cells.push(row.digest.clone());
            text += &cells.join(",");
            text.push('\n');
        }
        text
    }

    fn latex(&self) -> String {
        let mut text = tabular(&head(), 1, &self.all_rows());
        self.footer.iter().for_each(|line| text += &format!("% {line}\n"));
        for suite in &self.suites {
            let _ = write!(text, "\n% {}: published by others, mean of {}\n", suite.name, suite.mean_of);
            let rows: Vec<Vec<String>> =
                suite.published.iter().map(|figure| published_cells(figure).to_vec()).collect();
            text += &tabular(&PUBLISHED_HEAD.map(str::to_owned), PUBLISHED_HEAD.len(), &rows);
            self.missing_line(suite).iter().for_each(|line| text += &format!("% {line}\n"));
        }
        text
    }
}

fn head() -> Vec<String> {
    let columns = COLUMNS.iter().map(|column| column.head);
    ["sequence", "flights", "cameras"]
        .into_iter()
        .chain(columns)
        .chain(["digest"])
        .map(str::to_owned)
        .collect()
}

const PUBLISHED_HEAD: [&str; 5] = ["system", "ATE m", "trajectory", "conditions", "source"];

fn published_cells(figure: &PublishedFigure) -> [String; 5] {
    let knowledge = match figure.knowledge {
        Knowledge::Causal => "causal",
        Knowledge::Final => "final",
        Knowledge::NotStated => "not stated",
    };
    let ate = format!("{:.3}", figure.ate_m);
    [
        figure.system.to_owned(),
        ate,
        knowledge.to_owned(),
        figure.conditions.to_owned(),
        figure.source.to_owned(),
    ]
}

/// Conditions of the flights, and meaning of the figures.
fn footer(results: &[CellResult]) -> Vec<String> {
    let starts = distinct(results.iter().filter_map(|r| r.start_s));
    let starts: Vec<String> = starts.iter().map(ToString::to_string).collect();
    let from = match starts.is_empty() {
        true => "from the first frame".to_owned(),
        false => format!("from {} s", starts.join(", ")),
    };
    let executable =
        results.first().map_or("", |r| r.executable.get(..DIGEST_DIGITS).unwrap_or(&r.executable));
    let setting = results.first().map_or(&[][..], |r| &r.setting);
    let setting = if setting.is_empty() { "as configured".to_owned() } else { setting.join(" ") };
    vec![format!(
        "Medians over flights {from} (the longest frame: of all), {setting}, by Plumbline {}, executable {executable}. ATE: root \
             mean square position error after SE(3) alignment; causal: each pose when its frame came, without loops; final: as known \
             at the end, with loops. Coverage: frames with a pose. RPE: over each second. NEES over its expectation: 1 is honest. \
             Frames: processor time of one thread. Digest: of all estimates from the first start.",
        env!("CARGO_PKG_VERSION")
    )]
}

/// A LaTeX table whose first `words` columns are words.
fn tabular(head: &[String], words: usize, rows: &[Vec<String>]) -> String {
    let line = |cells: &[String]| {
        let cells: Vec<String> = cells.iter().map(|cell| escaped(cell)).collect();
        format!("{} \\\\\n", cells.join(" & "))
    };
    let kinds = "l".repeat(words) + &"r".repeat(head.len() - words);
    let rows: String = rows.iter().map(|row| line(row)).collect();
    format!(
        "\\begin{{tabular}}{{{kinds}}}\n\\hline\n{}\\hline\n{rows}\\hline\n\\end{{tabular}}\n",
        line(head)
    )
}

/// Text with the characters that mean something to LaTeX escaped.
fn escaped(text: &str) -> String {
    let mut out = String::new();
    for c in text.chars() {
        if matches!(c, '_' | '%' | '&' | '#' | '$' | '{' | '}') {
            out.push('\\');
        }
        out.push(c);
    }
    out
}

#[cfg(test)]
mod tests;
