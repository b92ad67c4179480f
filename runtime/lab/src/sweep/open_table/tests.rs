//! Medians, order, means, parts, and what is missing.

use super::*;
use crate::sweep::cell::tests::result;
use crate::sweep::{Common, Plan, Subject};

/// Names of all sequences of EuRoC.
fn all() -> Vec<&'static str> {
    SUITES[0].sequences.iter().map(|sequence| sequence.name).collect()
}

/// Sequences with starts at 0, 1 and 2 s, whose errors are 0.1, 0.2 and 0.3 m.
fn results(paths: &[&str]) -> Vec<CellResult> {
    let subjects = paths.iter().map(|path| Subject::Recorded { path: path.into() }).collect();
    let plan = Plan::new(Vec::new(), subjects, Vec::new(), Common::default()).unwrap();
    let cells = plan.from_starts(vec![2.0, 0.0, 1.0]).cells();
    cells.iter().map(|cell| result(cell, 0.1 * (1.0 + cell.start_s.unwrap()))).collect()
}

impl OpenTable {
    /// Lines with the missing sequences, one for each incomplete suite.
    fn missing_lines(&self) -> Vec<String> {
        self.suites.iter().filter_map(|suite| self.missing_line(suite)).collect()
    }
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
    assert!(text.contains("| V1_01_easy (part of 17 s) ") && text.contains("| mean of 1 of 11 "), "{text}");
    assert!(text.contains(" 1 to 2 |") && table.missing_lines()[0].contains("V1_01_easy"), "{text}");
}

#[test]
fn what_is_missing_is_named_with_where_it_is_to_be_had() {
    let ten: Vec<&str> = all().into_iter().filter(|name| *name != "V2_03_difficult").collect();
    let lines = OpenTable::new(&results(&ten)).missing_lines();
    assert_eq!(lines.len(), 1);
    assert!(
        lines[0].contains("V2_03_difficult (1 of 11)") && lines[0].contains("10.3929/ethz-b-000690084"),
        "{lines:?}"
    );
    assert!(OpenTable::new(&results(&all())).missing_lines().is_empty());
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
        assert!(suite.published.iter().all(|figure| figure.source.contains("arXiv:") && figure.ate_m > 0.0));
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
