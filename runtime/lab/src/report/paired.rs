//! Variants of the estimator over the same flights, figure by figure: Markdown and JSON.

use crate::evaluate::paired::PairedDifference;
use serde::Serialize;
use serde_json::Value;
use std::collections::BTreeMap;

/// Fewer flights than this decide nothing.
pub const MIN_FLIGHTS: usize = 8;

/// Figures that are compared: name, place in the report of a flight, decimals.
const FIGURES: [(&str, &str, usize); 13] = [
    ("ATE mm", "/accuracy/ate_rmse_m", 3),
    ("ATE %", "/accuracy/ate_percent", 5),
    ("NEES position", "/consistency/estimates/position/mean_ratio", 3),
    ("NEES tilt", "/consistency/estimates/tilt/mean_ratio", 3),
    ("NEES yaw", "/consistency/estimates/yaw/mean_ratio", 3),
    ("NEES velocity", "/consistency/estimates/velocity/mean_ratio", 3),
    ("NEES steps", "/consistency/estimates/steps/mean_ratio", 3),
    ("NEES position, odometry", "/consistency/odometry/position/mean_ratio", 3),
    ("NEES tilt, odometry", "/consistency/odometry/tilt/mean_ratio", 3),
    ("NEES yaw, odometry", "/consistency/odometry/yaw/mean_ratio", 3),
    ("NEES velocity, odometry", "/consistency/odometry/velocity/mean_ratio", 3),
    ("NEES steps, odometry", "/consistency/odometry/steps/mean_ratio", 3),
    ("resets", "/resets", 2),
];
/// The first figure is printed in millimetres.
const MM: f64 = 1e3;

/// The reports of a variant, by flight.
#[derive(Clone, Debug)]
pub struct Variant {
    /// Name of the variant.
    pub name: String,
    reports: BTreeMap<String, Value>,
}

impl Variant {
    /// Takes rows, each an object with a `report` and everything that tells its flight from others.
    #[must_use]
    pub fn of_rows(name: String, rows: &[Value]) -> Self {
        let reports = rows.iter().filter_map(|row| {
            let mut flight = row.as_object()?.clone();
            let report = flight.remove("report")?;
            Some((Value::Object(flight).to_string(), report))
        });
        Self { name, reports: reports.collect() }
    }

    /// Number of flights.
    #[must_use]
    pub fn len(&self) -> usize {
        self.reports.len()
    }

    /// True if there is no flight.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.reports.is_empty()
    }
}

/// A variant against another.
#[derive(Clone, Debug, Serialize)]
pub struct PairedComparison {
    /// Variant that it is compared with.
    pub base: String,
    /// The variant.
    pub variant: String,
    /// Number of flights that both have flown.
    pub flights: usize,
    /// Number of flights that only one of them has flown.
    pub unpaired: usize,
    /// Differences by figure.
    pub figures: Vec<(String, PairedDifference)>,
}

impl PairedComparison {
    /// Compares `variant` with `base` over the flights of both.
    #[must_use]
    pub fn of(base: &Variant, variant: &Variant) -> Self {
        let both: Vec<(&Value, &Value)> =
            base.reports.iter().filter_map(|(key, a)| Some((a, variant.reports.get(key)?))).collect();
        let figure = |(name, place, _): &(&str, &str, usize)| {
            let value = |report: &Value| report.pointer(place).and_then(Value::as_f64);
            let pairs: Vec<(f64, f64)> = both.iter().filter_map(|(a, b)| value(a).zip(value(b))).collect();
            Some(((*name).to_owned(), PairedDifference::of(&pairs)?))
        };
        let (base_name, variant_name) = (base.name.clone(), variant.name.clone());
        let unpaired = base.len() + variant.len() - 2 * both.len();
        let figures = FIGURES.iter().filter_map(figure).collect();
        Self { base: base_name, variant: variant_name, flights: both.len(), unpaired, figures }
    }

    /// The comparison as Markdown: a row a figure. Differences whose interval leaves zero out are marked with `*`.
    #[must_use]
    pub fn markdown(&self) -> String {
        let mut lines = vec![format!(
            "{} against {}: {} flights flown by both{}{}",
            self.variant,
            self.base,
            self.flights,
            if self.unpaired > 0 { format!(", {} by one alone", self.unpaired) } else { String::new() },
            if self.flights < MIN_FLIGHTS {
                format!("; {MIN_FLIGHTS} are needed to decide")
            } else {
                String::new()
            },
        )];
        lines.push(String::new());
        lines.push("| figure | flights | mean before | mean after | mean difference | its interval of 95 % | change % | its interval of 95 % |".into());
        lines.push("|---|---:|---:|---:|---:|---:|---:|---:|".into());
        lines.extend(self.figures.iter().map(|(name, difference)| row(name, difference)));
        lines.join("\n")
    }
}

fn row(name: &str, d: &PairedDifference) -> String {
    let digits = FIGURES.iter().find(|(other, ..)| *other == name).map_or(3, |(.., digits)| *digits);
    let unit = if name == "ATE mm" { MM } else { 1.0 };
    let number = |value: f64| format!("{:.digits$}", unit * value);
    let signed = |value: f64| format!("{:+.digits$}", unit * value);
    let percent = |ratio: f64| match ratio.is_finite() {
        true => format!("{:+.1}", 100.0 * (ratio - 1.0)),
        false => "-".to_owned(),
    };
    let mark = if d.is_significant() { "*" } else { "" };
    format!(
        "| {name} | {} | {} | {} | {}{mark} | {} to {} | {} | {} to {} |",
        d.flights,
        number(d.base_mean),
        number(d.mean),
        signed(d.difference),
        signed(d.difference_95[0]),
        signed(d.difference_95[1]),
        percent(d.ratio),
        percent(d.ratio_95[0]),
        percent(d.ratio_95[1]),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn variant(name: &str, ate_m: impl Fn(u32) -> f64, seeds: std::ops::Range<u32>) -> Variant {
        let row = |seed: u32| json!({ "seed": seed, "report": { "resets": 0, "accuracy": { "ate_rmse_m": ate_m(seed) } } });
        Variant::of_rows(name.into(), &seeds.map(row).collect::<Vec<_>>())
    }

    #[test]
    fn flights_are_paired_by_everything_but_their_report() {
        let base = variant("as it was", |seed| 0.01 * f64::from(seed), 1..11);
        let better = variant("better", |seed| 0.009 * f64::from(seed), 2..13);
        let comparison = PairedComparison::of(&base, &better);
        assert_eq!((comparison.flights, comparison.unpaired), (9, 3));
        let (name, difference) = &comparison.figures[0];
        assert_eq!((name.as_str(), difference.flights), ("ATE mm", 9));
        assert!((difference.ratio - 0.9).abs() < 1e-9 && difference.is_significant());
        let text = comparison.markdown();
        assert!(
            text.starts_with("better against as it was: 9 flights flown by both, 3 by one alone\n"),
            "{text}"
        );
        assert!(text.contains("| ATE mm | 9 | 60.000 | 54.000 | -6.000* |"), "{text}");
        // No flight has a reset: nothing to divide by.
        assert!(text.lines().last().unwrap().ends_with("| +0.00 | +0.00 to +0.00 | - | - to - |"), "{text}");
    }

    #[test]
    fn few_flights_decide_nothing() {
        let few = variant("a", f64::from, 1..5);
        assert!(PairedComparison::of(&few, &few).markdown().contains("; 8 are needed to decide"));
    }
}
