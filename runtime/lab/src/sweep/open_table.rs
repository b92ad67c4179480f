//! The open table: a row for each sequence, medians over its starts, what others have published beside it, and what is missing.

use super::published::{Knowledge, PublishedFigure, SUITES, Suite};
use super::table::{distinct, markdown, number, quoted, ratio};
use super::{CellResult, Figures};
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
    of: fn(&Figures) -> Option<f64>,
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

/// Lengths of the sequences of EuRoC, s: a data set of that name that is much shorter is a part of it.
const LENGTHS_S: [(&str, f64); 11] = [
    ("MH_01_easy", 181.9),
    ("MH_02_easy", 150.0),
    ("MH_03_medium", 131.5),
    ("MH_04_difficult", 98.8),
    ("MH_05_difficult", 111.1),
    ("V1_01_easy", 144.7),
    ("V1_02_medium", 83.5),
    ("V1_03_difficult", 104.7),
    ("V2_01_easy", 112.0),
    ("V2_02_medium", 115.4),
    ("V2_03_difficult", 114.8),
];
/// Frame rate of these sequences, Hz.
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
        let flown: Vec<&Figures> = figures.filter(|f| f.completion > 0.0).collect();
        let figures = std::array::from_fn(|k| {
            let values = flown.iter().filter_map(|f| (COLUMNS[k].of)(f));
            if k == LONGEST { values.reduce(f64::max) } else { median(values) }
        });
        let ates = || flown.iter().filter_map(|f| f.ate_rmse_m);
        let digest = flown.first().map_or("", |f| &f.estimate_digest);
        let whole_s = LENGTHS_S.iter().find(|(known, _)| *known == name).map(|(_, length_s)| *length_s);
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
            let place = |(k, suite): (usize, &Suite)| {
                Some((k, suite.sequences.iter().position(|s| **s == row.name)?))
            };
            SUITES.iter().enumerate().find_map(place).unwrap_or((SUITES.len(), 0))
        };
        rows.sort_by(|a, b| order(a).cmp(&order(b)).then_with(|| a.name.cmp(&b.name)));
        let present =
            SUITES.iter().filter(|s| rows.iter().any(|row| s.sequences.contains(&row.name.as_str())));
        let mut suites: Vec<&Suite> = present.collect();
        if suites.is_empty() {
            suites = SUITES.iter().collect();
        }
        let footer = footer(results);
        Self { rows, suites, footer }
    }

    /// Sequences of `suite` that were not flown.
    fn missing(&self, suite: &Suite) -> Vec<&'static str> {
        let is_here = |name: &&&str| self.rows.iter().any(|row| row.name == **name);
        suite.sequences.iter().filter(|name| !is_here(name)).copied().collect()
    }

    /// A row with the means of `suite` over the sequences that are there; `None` without any.
    fn mean(&self, suite: &Suite) -> Option<Row> {
        let rows: Vec<&Row> =
            self.rows.iter().filter(|row| suite.sequences.contains(&row.name.as_str())).collect();
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

    /// Lines with the missing sequences, one for each incomplete suite.
    #[must_use]
    pub fn missing_lines(&self) -> Vec<String> {
        self.suites.iter().filter_map(|suite| self.missing_line(suite)).collect()
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
mod tests {
    use super::*;
    use crate::sweep::cell::tests::result;
    use crate::sweep::{Common, Plan, Subject};

    /// Sequences with starts at 0, 1 and 2 s, whose errors are 0.1, 0.2 and 0.3 m.
    fn results(paths: &[&str]) -> Vec<CellResult> {
        let subjects = paths.iter().map(|path| Subject::Recorded { path: path.into() }).collect();
        let plan = Plan::new(Vec::new(), subjects, Vec::new(), Common::default()).unwrap();
        let cells = plan.from_starts(vec![2.0, 0.0, 1.0]).cells();
        cells.iter().map(|cell| result(cell, 0.1 * (1.0 + cell.start_s.unwrap()))).collect()
    }

    #[test]
    fn a_sequence_has_the_median_of_its_starts_in_the_order_of_the_suite() {
        let table = OpenTable::new(&results(&["/data/V1_01_easy", "/data/MH_01_easy/mav0", "/data/clip"]));
        let text = table.text(Format::Markdown);
        let rows: Vec<&str> = text.lines().skip(2).collect();
        assert!(rows[0].starts_with("| MH_01_easy") && rows[1].starts_with("| V1_01_easy"), "{text}");
        assert!(rows[2].starts_with("| clip") && rows[3].starts_with("| mean of 2 of 11"), "{text}");
        assert!(rows[0].contains(" 0.2000 ") && rows[0].contains(" ab |"), "{text}");
        assert!(text.contains("from 2, 0, 1 s"), "{text}");
        let csv = table.text(Format::Csv);
        assert!(csv.lines().nth(1).unwrap().starts_with("MH_01_easy,3,0,2,"), "{csv}");
        assert!(csv.lines().nth(1).unwrap().contains(",0.1,0.3") && csv.lines().count() == 4, "{csv}");
    }

    #[test]
    fn the_median_of_an_even_number_is_the_mean_of_the_middle() {
        assert_eq!(median([4.0, 1.0, 3.0, 2.0]), Some(2.5));
        assert_eq!((median([1.0, 3.0]), median([9.0, 1.0, 5.0]), median([])), (Some(2.0), Some(5.0), None));
        let mut results = results(&["MH_01_easy"]);
        results[0].figures = None;
        let kept: Vec<f64> = results.iter().filter_map(|r| r.figures.as_ref()?.ate_rmse_m).collect();
        let row = Row::of("MH_01_easy".into(), &results.iter().collect::<Vec<_>>());
        assert!((row.figures[CAUSAL].unwrap() - 0.5 * (kept[0] + kept[1])).abs() < 1e-12, "{kept:?}");
    }

    #[test]
    fn a_part_of_a_sequence_is_no_sequence_and_cameras_are_counted() {
        let mut results = results(&["MH_01_easy", "V1_01_easy"]);
        // 17 s of 145 s, and one flight of the other with a single camera.
        for result in results.iter_mut().filter(|r| r.subject == "V1_01_easy") {
            result.figures.as_mut().unwrap().frames = 300;
        }
        results[0].figures.as_mut().unwrap().cameras = Some(1);
        let table = OpenTable::new(&results);
        let text = table.text(Format::Markdown);
        assert!(
            text.contains("| V1_01_easy (part of 17 s) ") && text.contains("| mean of 1 of 11 "),
            "{text}"
        );
        assert!(text.contains(" 1 to 2 |") && table.missing_lines()[0].contains("V1_01_easy"), "{text}");
    }

    #[test]
    fn what_is_missing_is_named_with_where_it_is_to_be_had() {
        let ten: Vec<&str> =
            SUITES[0].sequences.iter().copied().filter(|name| *name != "V2_03_difficult").collect();
        let lines = OpenTable::new(&results(&ten)).missing_lines();
        assert_eq!(lines.len(), 1);
        assert!(
            lines[0].contains("V2_03_difficult (1 of 11)") && lines[0].contains("10.3929/ethz-b-000690084"),
            "{lines:?}"
        );
        assert!(OpenTable::new(&results(SUITES[0].sequences)).missing_lines().is_empty());
        assert_eq!(OpenTable::new(&results(&["clip"])).missing_lines().len(), 2);
        // A clip is no sequence, whatever it is a part of.
        assert!(OpenTable::new(&results(&["MH_05_mono_clip"])).missing_lines()[0].contains("all (11 of 11)"));
    }

    #[test]
    fn a_failed_flight_is_counted_and_leaves_the_medians_alone() {
        let mut results = results(&["MH_01_easy", "MH_02_easy"]);
        results[0].figures = None;
        let text = OpenTable::new(&results).text(Format::Markdown);
        assert!(text.lines().nth(2).unwrap().contains(" 2 of 3 |"), "{text}");
        results.iter_mut().filter(|r| r.subject == "MH_01_easy").for_each(|r| r.figures = None);
        let text = OpenTable::new(&results).text(Format::Markdown);
        // The mean of a suite whose sequence failed is unknown.
        let mean = text.lines().find(|line| line.starts_with("| mean of 2 of 11")).unwrap();
        assert!(!mean.contains("0.2000"), "{text}");
    }

    #[test]
    fn every_published_figure_has_its_source_and_says_what_it_knew() {
        for suite in &SUITES {
            assert!(
                suite.published.iter().all(|figure| figure.source.contains("arXiv:") && figure.ate_m > 0.0)
            );
        }
        let text = OpenTable::new(&results(&["MH_01_easy"])).text(Format::Markdown);
        assert!(
            text.contains("| causal ") && text.contains("| final ") && text.contains("arXiv:2510.04612"),
            "{text}"
        );
    }

    #[test]
    fn latex_has_its_special_characters_escaped_and_equal_columns() {
        let text = OpenTable::new(&results(&["MH_01_easy"])).text(Format::Latex);
        let rows: Vec<&str> = text.lines().filter(|line| line.ends_with("\\\\")).collect();
        assert!(rows[1].starts_with("MH\\_01\\_easy & 3 & 2 & "), "{text}");
        assert!(rows[0].contains("coverage \\%"), "{text}");
        assert!(
            rows[..3].iter().all(|row| row.matches(" & ").count() == rows[0].matches(" & ").count()),
            "{text}"
        );
    }
}
