//! Tracking figures of data sets side by side, and their ratios to those of the first.

use super::table::{distinct, markdown, number};
use super::{CellFigures, CellResult};
use crate::evaluate::Nees;
use crate::tracking::TrackingFigures;

/// Figures of a data set by name, means over its flights.
type Named = Vec<(String, Option<f64>)>;

/// Table of the tracking figures, errors and NEES of each data set with the ratio to the first; means over all flights.
#[must_use]
pub fn table(results: &[CellResult]) -> String {
    let subjects = distinct(results.iter().map(|r| r.subject.as_str()));
    let columns: Vec<Named> = subjects
        .iter()
        .map(|subject| {
            let flown = results.iter().filter(|r| r.subject == *subject).filter_map(|r| r.figures.as_ref());
            means(&flown.map(figures).collect::<Vec<_>>())
        })
        .collect();
    let Some(first) = columns.first() else { return String::new() };
    let head =
        ["figure".to_owned()].into_iter().chain(subjects.iter().map(ToString::to_string)).collect::<Vec<_>>();
    let rows = first.iter().enumerate().map(|(k, (name, reference))| {
        let cells = columns.iter().enumerate().map(|(column, named)| {
            let value = named.get(k).and_then(|(_, value)| *value);
            let ratio = value.zip(*reference).filter(|(_, reference)| column > 0 && *reference != 0.0);
            let ratio = ratio.map_or_else(String::new, |(value, of)| format!(" ({:.2})", value / of));
            number(value, 3) + &ratio
        });
        [name.clone()].into_iter().chain(cells).collect()
    });
    markdown(&head, 1, rows)
}

/// Figures of a flight by name.
fn figures(flown: &CellFigures) -> Named {
    let tracking = flown.tracking.clone().unwrap_or_default();
    let nees = flown.consistency.as_ref().map_or([None; 5], |consistency| consistency.estimates.ratios());
    let nees = Nees::NAMES.iter().zip(nees).map(|(name, ratio)| (format!("NEES {name}"), ratio));
    let tracking = tracking.named().into_iter().map(|(name, value)| (name.to_owned(), value));
    let ate_mm = flown.ate_rmse_m.map(|m| 1e3 * m);
    let rpe_mm = flown.rpe_1s_m.map(|m| 1e3 * m);
    tracking
        .chain(nees)
        .chain([("error of 1 s, mm".to_owned(), rpe_mm), ("ATE mm".to_owned(), ate_mm)])
        .collect()
}

/// Mean of each figure over the flights that have it.
fn means(flights: &[Named]) -> Named {
    let Some(first) = flights.first() else {
        return TrackingFigures::default().named().into_iter().map(|(n, _)| (n.to_owned(), None)).collect();
    };
    let mean = |k: usize| {
        let values: Vec<f64> = flights.iter().filter_map(|flight| flight[k].1).collect();
        (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
    };
    first.iter().enumerate().map(|(k, (name, _))| (name.clone(), mean(k))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sweep::cell::tests::result;
    use crate::sweep::plan::tests::plan;

    #[test]
    fn each_data_set_is_compared_with_the_first() {
        let cells = plan().cells();
        let with_points = |cell, per_frame| {
            let mut result = result(cell, 0.1);
            if let Some(figures) = &mut result.figures {
                let mut tracking = TrackingFigures::default();
                tracking.points.per_frame = per_frame;
                figures.tracking = Some(tracking);
            }
            result
        };
        let mut results: Vec<CellResult> = cells.iter().map(|cell| with_points(cell, 100.0)).collect();
        let first = results[0].subject.clone();
        for result in results.iter_mut().filter(|r| r.subject != first) {
            result.figures = with_points(&cells[0], 150.0).figures;
        }
        let text = table(&results);
        let row = text.lines().find(|line| line.contains("points in a frame")).unwrap();
        assert!(row.contains("100.000") && row.contains("150.000 (1.50)"), "{text}");
    }
}
