//! Result of a sweep: a row a setting, the best first and marked, and everything as CSV.

use super::{CellFigures, CellResult};
use crate::evaluate::{ConsistencyOutput, FlightConsistency, Nees};
use std::collections::BTreeMap;
use std::fmt::Write as _;

/// The means of a setting over flights.
#[derive(Clone, Debug, Default, PartialEq)]
struct Means {
    flights: usize,
    failed: usize,
    ate_rmse_m: Option<f64>,
    ate_percent: Option<f64>,
    worst_percent: Option<f64>,
    completion: f64,
    resets: u64,
    yaw_drift_deg_per_min: Option<f64>,
    estimates: [Option<f64>; 5],
    odometry: [Option<f64>; 5],
    frame_cpu_ms_p50: Option<f64>,
}

impl Means {
    fn of<'a>(results: impl Iterator<Item = &'a CellResult>) -> Self {
        let results: Vec<&CellResult> = results.collect();
        let figures: Vec<&CellFigures> = results.iter().filter_map(|r| r.figures.as_ref()).collect();
        let mean_of = |of: &dyn Fn(&CellFigures) -> Option<f64>| mean(figures.iter().filter_map(|f| of(f)));
        Self {
            flights: results.len(),
            failed: results.len() - figures.iter().filter(|f| f.completion > 0.0).count(),
            ate_rmse_m: mean_of(&|f| f.ate_rmse_m),
            ate_percent: mean_of(&|f| f.ate_percent),
            worst_percent: figures.iter().filter_map(|f| f.ate_percent).reduce(f64::max),
            completion: mean_of(&|f| Some(f.completion)).unwrap_or(0.0),
            resets: figures.iter().map(|f| u64::from(f.resets)).sum(),
            yaw_drift_deg_per_min: mean_of(&|f| f.yaw_drift_deg_per_min.map(f64::abs)),
            estimates: std::array::from_fn(|k| mean_of(&|f| ratio(f, |c| &c.estimates, k))),
            odometry: std::array::from_fn(|k| mean_of(&|f| ratio(f, |c| &c.odometry, k))),
            frame_cpu_ms_p50: mean_of(&|f| Some(f.frame_cpu_ms_p50)),
        }
    }

    /// Orders settings: those that fly all flights first, then by error, then by completion.
    fn order(&self, other: &Self) -> std::cmp::Ordering {
        let error = |means: &Self| means.ate_percent.unwrap_or(f64::INFINITY);
        self.failed
            .cmp(&other.failed)
            .then(error(self).total_cmp(&error(other)))
            .then(other.completion.total_cmp(&self.completion))
    }
}

/// The figure `k` of [`Nees::NAMES`].
pub(super) fn ratio(figures: &CellFigures, of: ConsistencyOutput, k: usize) -> Option<f64> {
    figures.consistency.as_ref().and_then(|consistency| of(consistency).ratios()[k])
}

fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, count) = values.fold((0.0, 0.0), |(sum, count), value| (sum + value, count + 1.0));
    (count > 0.0).then(|| sum / count)
}

/// The sweep as Markdown: the settings in the order of their mean error over all flights, the best marked with `*`;
/// with several data sets a second table has the mean error on each.
#[must_use]
pub fn table(results: &[CellResult]) -> String {
    let mut settings: Vec<(&[String], Means)> = distinct(results.iter().map(|r| r.setting.as_slice()))
        .into_iter()
        .map(|setting| (setting, Means::of(results.iter().filter(|r| r.setting == setting))))
        .collect();
    // Stable: settings that are equally good stay in the order of the sweep.
    settings.sort_by(|(_, a), (_, b)| a.order(b));
    let keys = keys(results);
    let mut text = overview(&keys, &settings);
    let subjects = distinct(results.iter().map(|r| r.subject.as_str()));
    if subjects.len() > 1 {
        text += "\n\n";
        text += &by_subject(&keys, &settings, &subjects, results);
    }
    text
}

fn overview(keys: &[&str], settings: &[(&[String], Means)]) -> String {
    const COLUMNS: [&str; 10] = [
        "flights",
        "failed",
        "ATE %",
        "worst ATE %",
        "ATE m",
        "yaw deg/min",
        "NEES position / tilt / yaw / velocity / steps",
        "the same of the odometry",
        "resets",
        "frame cpu ms p50",
    ];
    let is_best = |means: &Means| {
        let best = settings.first().map(|(_, best)| best);
        settings.len() > 1
            && best.is_some_and(|best| means.ate_percent.is_some() && means.order(best).is_eq())
    };
    let rows = settings.iter().map(|(setting, m)| {
        let mark = if is_best(m) { "*" } else { "" };
        let figures = [
            m.flights.to_string(),
            m.failed.to_string(),
            number(m.ate_percent, 4) + mark,
            number(m.worst_percent, 4),
            number(m.ate_rmse_m, 4),
            number(m.yaw_drift_deg_per_min, 2),
            m.estimates.map(|ratio| number(ratio, 2)).join(" / "),
            m.odometry.map(|ratio| number(ratio, 2)).join(" / "),
            m.resets.to_string(),
            number(m.frame_cpu_ms_p50, 1),
        ];
        values(setting).chain(figures).collect()
    });
    let head: Vec<String> = keys.iter().copied().chain(COLUMNS).map(str::to_owned).collect();
    markdown(&head, keys.len(), rows)
}

/// The mean error of each setting on each data set, over the seeds; the best on each is marked.
fn by_subject(
    keys: &[&str],
    settings: &[(&[String], Means)],
    subjects: &[&str],
    results: &[CellResult],
) -> String {
    let means_of = |setting: &[String], subject: &str| {
        Means::of(results.iter().filter(|r| r.setting == setting && r.subject == subject))
    };
    let best: BTreeMap<&str, Means> = subjects
        .iter()
        .filter_map(|subject| {
            let all = settings.iter().map(|(setting, _)| means_of(setting, subject));
            Some((*subject, all.min_by(Means::order)?))
        })
        .collect();
    let cell = |setting: &[String], subject: &&str| {
        let means = means_of(setting, subject);
        let is_best = means.ate_percent.is_some() && means.order(&best[subject]).is_eq();
        number(means.ate_rmse_m, 4) + if is_best && settings.len() > 1 { "*" } else { "" }
    };
    let rows = settings
        .iter()
        .map(|(setting, _)| values(setting).chain(subjects.iter().map(|s| cell(setting, s))).collect());
    let head: Vec<String> =
        keys.iter().map(ToString::to_string).chain(subjects.iter().map(|s| format!("ATE m, {s}"))).collect();
    markdown(&head, keys.len(), rows)
}

/// A table whose first `words` columns are set to the left, the others to the right, in columns of even width.
pub(super) fn markdown(head: &[String], words: usize, rows: impl Iterator<Item = Vec<String>>) -> String {
    let rows: Vec<Vec<String>> = rows.collect();
    let width = |column: usize| {
        let cells = rows.iter().map(|row| row[column].chars().count());
        cells.chain([head[column].chars().count(), 3]).max().unwrap_or(3)
    };
    let widths: Vec<usize> = (0..head.len()).map(width).collect();
    let line = |cells: &[String]| {
        let mut line = String::from("|");
        for (column, (cell, width)) in cells.iter().zip(&widths).enumerate() {
            let _ = if column < words {
                write!(line, " {cell:<width$} |")
            } else {
                write!(line, " {cell:>width$} |")
            };
        }
        line
    };
    let rule = |column: usize| {
        let dashes = "-".repeat(widths[column] + 1);
        if column < words { format!("{dashes}-|") } else { format!("{dashes}:|") }
    };
    let mut lines =
        vec![line(head), (0..head.len()).fold(String::from("|"), |text, column| text + &rule(column))];
    lines.extend(rows.iter().map(|row| line(row)));
    lines.join("\n")
}

/// Everything as CSV: a row a cell, in the order of their numbers.
#[must_use]
pub fn csv(results: &[CellResult]) -> String {
    const COLUMNS: [&str; 14] = [
        "data_set",
        "seed",
        "start_s",
        "frames",
        "completion",
        "resets",
        "first_pose_s",
        "ate_rmse_m",
        "ate_percent",
        "yaw_drift_deg_per_min",
        "frame_cpu_ms_p50",
        "frame_cpu_ms_p99",
        "estimate_digest",
        "error",
    ];
    let keys = keys(results);
    let nees = FlightConsistency::OUTPUTS
        .iter()
        .flat_map(|(output, _)| Nees::NAMES.map(|name| format!("nees_{name}_{output}")));
    let head = ["cell"].into_iter().chain(keys).chain(COLUMNS).map(str::to_owned).chain(nees);
    let head: Vec<String> = head.map(|name| quoted(&name)).collect();
    let mut text = head.join(",") + "\n";
    for result in results {
        let number = |value: Option<f64>| value.map_or_else(String::new, |v| v.to_string());
        let figure = |of: fn(&CellFigures) -> Option<f64>| number(result.figures.as_ref().and_then(of));
        let cells = [
            result.subject.clone(),
            result.seed.map_or_else(String::new, |seed| seed.to_string()),
            number(result.start_s),
            figure(|f| Some(f.frames as f64)),
            figure(|f| Some(f.completion)),
            figure(|f| Some(f64::from(f.resets))),
            figure(|f| f.first_pose_s),
            figure(|f| f.ate_rmse_m),
            figure(|f| f.ate_percent),
            figure(|f| f.yaw_drift_deg_per_min),
            figure(|f| Some(f.frame_cpu_ms_p50)),
            figure(|f| Some(f.frame_cpu_ms_p99)),
            result.figures.as_ref().map_or_else(String::new, |f| f.estimate_digest.clone()),
            result.error.clone().unwrap_or_default(),
        ];
        let nees = FlightConsistency::OUTPUTS.iter().flat_map(|(_, of)| {
            let of_cell = move |k: usize| number(result.figures.as_ref().and_then(|f| ratio(f, *of, k)));
            (0..Nees::NAMES.len()).map(of_cell)
        });
        let values = values(&result.setting);
        let row: Vec<String> =
            [result.cell.to_string()].into_iter().chain(values).chain(cells).chain(nees).collect();
        text += &row.iter().map(|cell| quoted(cell)).collect::<Vec<_>>().join(",");
        text.push('\n');
    }
    text
}

/// A cell of a CSV, in quotes where it must be.
pub(super) fn quoted(cell: &str) -> String {
    if cell.contains([',', '"', '\n', '\r']) {
        format!("\"{}\"", cell.replace('"', "\"\""))
    } else {
        cell.to_owned()
    }
}

/// The keys that are swept.
fn keys(results: &[CellResult]) -> Vec<&str> {
    let first = results.first().map_or(&[][..], |result| &result.setting);
    first.iter().map(|change| change.split_once('=').map_or(change.as_str(), |(key, _)| key)).collect()
}

/// The values of a setting, in the order of its keys.
fn values(setting: &[String]) -> impl Iterator<Item = String> {
    setting.iter().map(|change| change.split_once('=').map_or("", |(_, value)| value).to_owned())
}

pub(super) fn distinct<T: PartialEq>(items: impl Iterator<Item = T>) -> Vec<T> {
    items.fold(Vec::new(), |mut found, item| {
        if !found.contains(&item) {
            found.push(item);
        }
        found
    })
}

pub(super) fn number(value: Option<f64>, digits: usize) -> String {
    value.map_or_else(|| "-".to_owned(), |v| format!("{v:.digits$}"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sweep::cell::tests::result;
    use crate::sweep::plan::tests::plan;

    /// The plan of the tests: sigma 0.4 with lines is best in the mean, 0.5 without on the recorded flight.
    fn results() -> Vec<CellResult> {
        let error =
            |setting: &[String], subject: &str| match (setting[0].as_str(), setting[1].as_str(), subject) {
                ("estimator.points.sigma_px=0.5", "estimator.lines.enabled=false", "V1_01") => 0.05,
                ("estimator.points.sigma_px=0.4", "estimator.lines.enabled=true", _) => 0.1,
                _ => 0.3,
            };
        plan().cells().iter().map(|cell| result(cell, error(&cell.setting, &cell.subject.name()))).collect()
    }

    #[test]
    fn the_best_setting_comes_first_and_is_marked() {
        let text = table(&results());
        let rows: Vec<&str> = text.lines().collect();
        assert!(rows[0].contains("estimator.points.sigma_px") && rows[0].contains("ATE %"), "{text}");
        assert!(rows[2].starts_with("| 0.4") && rows[2].contains("1.0000*"), "{text}");
        assert_eq!(text.matches('*').count(), 3, "{text}");
        // On the recorded flight alone another one is best.
        let best_recorded = rows.iter().find(|row| row.contains("0.0500*")).unwrap();
        assert!(best_recorded.starts_with("| 0.5") && best_recorded.contains("| false"), "{text}");
    }

    #[test]
    fn a_setting_that_fails_a_flight_is_not_the_best() {
        let mut results = results();
        let best = results.iter_mut().find(|r| r.setting[0].ends_with("0.4")).unwrap();
        (best.figures, best.error) = (None, Some("no pose".into()));
        let text = table(&results);
        assert!(!text.lines().nth(2).unwrap().starts_with("| 0.4"), "{text}");
    }

    #[test]
    fn the_list_has_a_row_for_every_cell() {
        let mut results = results();
        results[1].error = Some("cannot, \"really\"".into());
        let text = csv(&results);
        assert_eq!(text.lines().count(), 19);
        assert!(
            text.starts_with("cell,estimator.points.sigma_px,estimator.lines.enabled,data_set,seed,start_s,")
        );
        assert!(
            text.lines().nth(1).unwrap().starts_with("0,0.3,true,V1_01,,,4000,0.98,0,0.5,0.3,3,"),
            "{text}"
        );
        assert!(text.lines().nth(2).unwrap().ends_with(",ab,\"cannot, \"\"really\"\"\",,,,,,,,,,"), "{text}");
        assert!(text.lines().next().unwrap().contains(",nees_tilt_estimates,"), "{text}");
    }
}
