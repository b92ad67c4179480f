//! The results of a campaign as Markdown: a row a flight, then the means of each scene.

use super::{CampaignFault, Entry, SCENES};
use crate::evaluate::paired::PairedDifference;
use crate::evaluate::{ConsistencyOutput, FlightConsistency, Nees};
use crate::report::Report;
use crate::report::accuracy::Accuracy;
use crate::report::trust::Trust;
use std::collections::BTreeMap;

/// The head of the table.
pub const TABLE_HEAD: &str = "\
| path | scene | fault | seed | frames | completion % | first pose s | distance m | ATE m | ATE % | yaw deg/min | NEES position / tilt / yaw / velocity / steps | the same of the odometry | resets | frame cpu ms p50 / p99 / max |
|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|";

/// The row of a flight.
#[must_use]
pub fn row(entry: &Entry, report: &Report) -> String {
    let accuracy = report.accuracy.as_ref();
    let cells = [
        entry.path.clone(),
        entry.scene.to_owned(),
        entry.failure(),
        entry.scenario.seed.to_string(),
        report.frames.to_string(),
        format!("{:.1}", 100.0 * report.completion),
        number(report.first_pose_s, 2),
        number(accuracy.map(|a| a.distance_m), 1),
        number(accuracy.map(|a| a.ate_rmse_m), 4),
        number(accuracy.map(|a| a.ate_percent), 3),
        number(accuracy.and_then(|a| a.yaw_drift_deg_per_min), 2),
        nees(report, |c| &c.estimates),
        nees(report, |c| &c.odometry),
        report.resets.to_string(),
        format!(
            "{:.1} / {:.1} / {:.1}",
            report.frame_cpu_ms.p50, report.frame_cpu_ms.p99, report.frame_cpu_ms.max
        ),
    ];
    format!("| {} |", cells.join(" | "))
}

/// The five figures of an output.
fn nees(report: &Report, of: ConsistencyOutput) -> String {
    let ratios = report.consistency.as_ref().map_or([None; 5], |consistency| of(consistency).ratios());
    ratios.map(|ratio| number(ratio, 2)).join(" / ")
}

/// The head of the table of faults.
pub const TRUST_HEAD: &str = "\
| fault | path | scene | seed | NEES during, mean / worst | 5 s after | recovery s | worst m | worst deg | resets | trust |
|---|---|---|---|---|---|---|---|---|---|---|";

/// The row of a flight in which something goes wrong; none where nothing does.
#[must_use]
pub fn trust_row(entry: &Entry, report: &Report) -> Option<String> {
    entry.fault.span_s()?;
    let trust = report.trust.as_ref();
    let deserved = trust.is_some_and(Trust::is_deserved);
    let cells = [
        entry.failure(),
        entry.path.clone(),
        entry.scene.to_owned(),
        entry.scenario.seed.to_string(),
        format!(
            "{} / {}",
            number(trust.and_then(|t| t.nees_during), 2),
            number(trust.and_then(|t| t.worst_nees_during), 1)
        ),
        number(trust.and_then(|t| t.nees_after), 2),
        trust.and_then(|t| t.recovery_s).map_or_else(|| "never".to_owned(), |s| format!("{s:.2}")),
        number(trust.map(|t| t.worst_error_m), 3),
        number(trust.map(|t| t.worst_error_deg), 2),
        report.resets.to_string(),
        if deserved { "deserved" } else { "FALSE" }.to_owned(),
    ];
    Some(format!("| {} |", cells.join(" | ")))
}

/// The head of the table of errors of inertial sensors and of conditions.
pub const RATIO_HEAD: &str = "\
| error or condition | flights | mean ATE % | mean ATE % without | ratio of the means (95 %) | ratio, median / worst | mean NEES position / tilt / yaw / velocity / steps | resets | worst flight |
|---|---|---|---|---|---|---|---|---|";

/// A row for each error of an inertial sensor and each condition: errors of its flights beside those of the same flights
/// without it.
#[must_use]
pub fn ratio_rows<'a>(flights: impl IntoIterator<Item = (&'a Entry, &'a Report)>) -> Vec<String> {
    let flights: Vec<_> = flights.into_iter().collect();
    let mut compared: Vec<CampaignFault> = Vec::new();
    for (entry, _) in &flights {
        if entry.fault.is_compared() && !compared.contains(&entry.fault) {
            compared.push(entry.fault);
        }
    }
    compared.into_iter().filter_map(|fault| ratio_row(fault, &flights)).collect()
}

/// A flight with something, its error and that of the same flight without.
struct Pair<'a> {
    entry: &'a Entry,
    report: &'a Report,
    ate: f64,
    without: f64,
}

impl Pair<'_> {
    fn ratio(&self) -> f64 {
        self.ate / self.without
    }
}

fn ratio_row(fault: CampaignFault, flights: &[(&Entry, &Report)]) -> Option<String> {
    let ate = |report: &Report| report.accuracy.as_ref().map(|a| a.ate_percent);
    let sound = |entry: &Entry| {
        let is_same = |other: &Entry| {
            let of = |e: &Entry| (e.path.clone(), e.scene, e.scenario.seed);
            other.fault == CampaignFault::None && of(other) == of(entry)
        };
        flights.iter().find(|(other, _)| is_same(other)).and_then(|(_, report)| ate(report))
    };
    let with_it = flights.iter().filter(|(entry, _)| entry.fault == fault);
    let mut pairs: Vec<Pair<'_>> = with_it
        .filter_map(|(entry, report)| Some(Pair { entry, report, ate: ate(report)?, without: sound(entry)? }))
        .collect();
    pairs.sort_by(|a, b| a.ratio().total_cmp(&b.ratio()));
    let (worst, median) = (pairs.last()?, &pairs[pairs.len() / 2]);
    let [with, without] = [mean(pairs.iter().map(|p| p.ate)), mean(pairs.iter().map(|p| p.without))];
    let errors: Vec<(f64, f64)> = pairs.iter().map(|p| (p.without, p.ate)).collect();
    let interval = PairedDifference::of(&errors)
        .map_or_else(String::new, |d| format!(" ({:.2} to {:.2})", d.ratio_95[0], d.ratio_95[1]));
    let nees = (0..Nees::NAMES.len()).map(|k| {
        let consistencies = pairs.iter().filter_map(|p| p.report.consistency.as_ref());
        number(mean(consistencies.filter_map(|c| c.estimates.ratios()[k])), 2)
    });
    let cells = [
        fault.name(),
        pairs.len().to_string(),
        number(with, 4),
        number(without, 4),
        number(with.zip(without).map(|(with, without)| with / without), 2) + &interval,
        format!("{:.2} / {:.2}", median.ratio(), worst.ratio()),
        nees.collect::<Vec<_>>().join(" / "),
        pairs.iter().map(|p| p.report.resets).sum::<u32>().to_string(),
        format!("{} {} {}", worst.entry.path, worst.entry.scene, worst.entry.scenario.seed),
    ];
    Some(format!("| {} |", cells.join(" | ")))
}

/// The head of the table of health bits.
pub const HEALTH_HEAD: &str = "\
| health bit, flights without a fault | flights | frames |
|---|---|---|";

/// A row for each health bit that was set in a flight without a fault: in how many of them, and in how many frames.
#[must_use]
pub fn health_rows<'a>(flights: impl IntoIterator<Item = (&'a Entry, &'a Report)>) -> Vec<String> {
    let mut rows: BTreeMap<&str, (u64, u64)> = BTreeMap::new();
    for (_, report) in flights.into_iter().filter(|(entry, _)| entry.fault == CampaignFault::None) {
        for (name, frames) in &report.health_frames {
            let (flights, sum) = rows.entry(name).or_default();
            (*flights, *sum) = (*flights + 1, *sum + frames);
        }
    }
    rows.into_iter().map(|(name, (flights, frames))| format!("| {name} | {flights} | {frames} |")).collect()
}

/// The head of the table of sensors that fail in silence.
pub const SILENCE_HEAD: &str = "\
| fault | path | scene | seed | named after s | usable % | worst of these, sigma | m | worst of all, m | honest |
|---|---|---|---|---|---|---|---|---|---|";

/// The row of a flight in which a sensor fails in silence; none of another.
#[must_use]
pub fn silence_row(entry: &Entry, report: &Report) -> Option<String> {
    if !entry.fault.is_silent() {
        return None;
    }
    let silence = report.silence.as_ref();
    let named: Vec<String> = silence.map_or_else(Vec::new, |silence| {
        silence.named_s.iter().map(|(name, s)| format!("{name} {s:.2}")).collect()
    });
    let cells = [
        entry.failure(),
        entry.path.clone(),
        entry.scene.to_owned(),
        entry.scenario.seed.to_string(),
        if named.is_empty() { "never".to_owned() } else { named.join(", ") },
        number(silence.map(|s| 100.0 * s.usable), 0),
        number(silence.map(|s| s.worst_sigmas), 1),
        number(silence.map(|s| s.worst_usable_m), 3),
        number(silence.map(|s| s.worst_m), 3),
        if entry.is_honest_of_silence(report) { "yes" } else { "NO" }.to_owned(),
    ];
    Some(format!("| {} |", cells.join(" | ")))
}

/// The means of each scene over its flights without a fault, and over all of these: a table of its own.
#[must_use]
pub fn means<'a>(flights: impl IntoIterator<Item = (&'a Entry, &'a Report)>) -> String {
    let sound: Vec<_> = flights.into_iter().filter(|(entry, _)| entry.fault == CampaignFault::None).collect();
    let mut lines = vec![
        "| scene | flights | with poses | mean ATE % | worst ATE % | mean yaw deg/min | resets | mean frame cpu ms p50 |"
            .to_owned(),
        "|---|---|---|---|---|---|---|---|".to_owned(),
    ];
    for (name, _) in SCENES {
        lines.extend(mean_row(name, sound.iter().filter(|(e, _)| e.scene == name).map(|(_, r)| *r)));
    }
    lines.extend(mean_row("all", sound.iter().map(|(_, r)| *r)));
    lines.join("\n")
}

fn mean_row<'a>(name: &str, reports: impl Iterator<Item = &'a Report>) -> Option<String> {
    let reports: Vec<&Report> = reports.collect();
    if reports.is_empty() {
        return None;
    }
    let accuracies: Vec<&Accuracy> = reports.iter().filter_map(|r| r.accuracy.as_ref()).collect();
    let mean_of = |of: &dyn Fn(&Accuracy) -> Option<f64>| mean(accuracies.iter().filter_map(|a| of(a)));
    let cells = [
        name.to_owned(),
        reports.len().to_string(),
        accuracies.len().to_string(),
        number(mean_of(&|a| Some(a.ate_percent)), 4),
        number(accuracies.iter().map(|a| a.ate_percent).reduce(f64::max), 4),
        number(mean_of(&|a| a.yaw_drift_deg_per_min.map(f64::abs)), 2),
        reports.iter().map(|r| r.resets).sum::<u32>().to_string(),
        number(mean(reports.iter().map(|r| r.frame_cpu_ms.p50)), 1),
    ];
    Some(format!("| {} |", cells.join(" | ")))
}

/// Mean and worst NEES of each figure over all flights, with a fault or without, and their largest errors: a table of its own.
#[must_use]
pub fn consistency<'a>(reports: impl IntoIterator<Item = &'a Report>) -> String {
    let all: Vec<&FlightConsistency> =
        reports.into_iter().filter_map(|report| report.consistency.as_ref()).collect();
    let mut lines = vec![
        format!(
            "| NEES, mean (worst flight) | flights | {} | velocity, first second | largest tilt deg, later | velocity m/s |",
            Nees::NAMES.join(" | ")
        ),
        format!("|---|---|{}", "---|".repeat(Nees::NAMES.len() + 3)),
    ];
    for (name, of) in FlightConsistency::OUTPUTS {
        let nees = || all.iter().map(|consistency| of(consistency));
        let cell = |ratios: Vec<f64>| {
            let worst = ratios.iter().copied().reduce(f64::max);
            format!("{} ({})", number(mean(ratios.into_iter()), 2), number(worst, 2))
        };
        let figures = (0..Nees::NAMES.len()).map(|k| nees().filter_map(|nees| nees.ratios()[k]).collect());
        let start = nees().filter_map(|nees| Some(nees.velocity_at_start?.mean_ratio)).collect();
        let largest = [|nees: &Nees| Some(nees.largest.tilt_deg), |nees: &Nees| nees.largest.velocity_m_s];
        let largest = largest.map(|of| number(nees().filter_map(of).reduce(f64::max), 3));
        let cells: Vec<_> = figures.chain([start]).map(cell).chain(largest).collect();
        lines.push(format!("| {name} | {} | {} |", all.len(), cells.join(" | ")));
    }
    lines.join("\n")
}

fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, count) = values.fold((0.0, 0.0), |(sum, count), value| (sum + value, count + 1.0));
    (count > 0.0).then(|| sum / count)
}

pub(super) fn number(value: Option<f64>, digits: usize) -> String {
    value.map_or_else(|| "-".to_owned(), |v| format!("{v:.digits$}"))
}
