//! The standard load: one built-in flight in every scene, and images made to be hard. What it costs on this
//! machine, stage by stage, and whether that is more than it was.

mod adversary;

use crate::campaign::SCENES;
use crate::report::Report;
use adversary::Adversary;
use plumbline_flight::flight::{FlightError, Truth, fly, open_simulation};
use plumbline_flight::pipeline::{Control, RunOptions};
use plumbline_flight::schedule::times::Percentiles;
use plumbline_simulator::{Scenario, Scene};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;

/// In full flight from here on, s.
const START_S: f64 = 3.0;
/// The load of images made to be hard.
const ADVERSARIAL: &str = "adversarial";

/// Cost of the standard load: processor time in ms.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Bench {
    /// Each load, each stage of it, with the percentiles of its time.
    pub loads: BTreeMap<String, BTreeMap<String, Percentiles>>,
    /// Worst frame of all loads over the median frame of the simulated scenes.
    pub worst_over_median: f64,
    /// Largest number of allocations in the hot path of a load.
    pub hot_path_allocations: u64,
}

/// Runs the standard load of `duration_s` a scene, with rendered frames in `cache`; `tell` hears what is next.
///
/// # Errors
/// When a flight cannot be simulated, or the cache cannot be used.
pub fn run(duration_s: f64, cache: &Path, mut tell: impl FnMut(&str)) -> Result<Bench, FlightError> {
    let mut bench = Bench { loads: BTreeMap::new(), worst_over_median: 0.0, hot_path_allocations: 0 };
    let mut medians = Vec::new();
    for (name, scene) in SCENES {
        tell(name);
        let report = load(scene, duration_s, cache, false)?;
        medians.push(report.frame_cpu_ms.p50);
        bench.add(name, &report);
    }
    tell(ADVERSARIAL);
    bench.add(ADVERSARIAL, &load(Scene::Room, duration_s, cache, true)?);
    let worst =
        bench.loads.values().filter_map(|stages| stages.get("frame")).map(|p| p.max).fold(0.0, f64::max);
    medians.sort_by(f64::total_cmp);
    bench.worst_over_median = worst / medians.get(medians.len() / 2).copied().unwrap_or(f64::NAN);
    Ok(bench)
}

fn load(scene: Scene, duration_s: f64, cache: &Path, is_adversarial: bool) -> Result<Report, FlightError> {
    let scenario = Scenario { scene, start_s: START_S, duration_s, ..Scenario::default() };
    let rendered = (!is_adversarial).then_some(cache);
    let mut flight = open_simulation(None, &scenario, false, 0.0, rendered)?;
    if let (true, Truth::Simulated(simulator)) = (is_adversarial, &flight.truth) {
        let stamps = (0..simulator.frame_count()).map(|k| simulator.frame_stamp(k)).collect();
        flight.stereo = Box::new(Adversary::new(simulator.image_sizes(), stamps, scenario.seed));
    }
    let options = RunOptions { speed: None, threads: 1 };
    Ok(Report::new(&fly(flight, &options, &Control::default(), vec![])?))
}

impl Bench {
    fn add(&mut self, name: &str, report: &Report) {
        let stages = report.stage_ms.iter().map(|(stage, p)| ((*stage).to_owned(), *p));
        let whole = [("frame".to_owned(), report.frame_cpu_ms), ("frame (wall)".to_owned(), report.frame_ms)];
        self.loads.insert(name.to_owned(), stages.chain(whole).collect());
        self.hot_path_allocations = self.hot_path_allocations.max(report.hot_path_allocations);
    }

    /// The table, beside `baseline` where there is one.
    #[must_use]
    pub fn table(&self, baseline: Option<&Self>) -> String {
        let mut text = format!(
            "{:<12} {:<15} {:>8} {:>8} {:>8} {:>8}{}\n",
            "load",
            "stage (ms)",
            "p50",
            "p95",
            "p99",
            "max",
            if baseline.is_some() { "   p50 now/then  p99 now/then" } else { "" }
        );
        for (load, stages) in &self.loads {
            for (stage, p) in stages {
                let _ = write!(
                    text,
                    "{load:<12} {stage:<15} {:>8.3} {:>8.3} {:>8.3} {:>8.3}",
                    p.p50, p.p95, p.p99, p.max
                );
                if let Some(then) = baseline.and_then(|b| b.loads.get(load)?.get(stage)) {
                    let _ = write!(text, "{:>14.2} {:>13.2}", p.p50 / then.p50, p.p99 / then.p99);
                }
                text.push('\n');
            }
        }
        let _ = write!(
            text,
            "worst frame over the median frame of the scenes: {:.2} (processor time); {} allocations in the hot path",
            self.worst_over_median, self.hot_path_allocations
        );
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_stands_beside_its_baseline() {
        let of = |ms: f64| {
            let p = Percentiles { p50: ms, p95: ms, p99: ms, max: ms, mean: ms };
            let stages: BTreeMap<_, _> = [("frame".to_owned(), p)].into();
            Bench {
                loads: [("room".to_owned(), stages)].into(),
                worst_over_median: 1.0,
                hot_path_allocations: 0,
            }
        };
        let table = of(3.0).table(Some(&of(2.0)));
        assert!(table.lines().nth(1).unwrap().contains("1.50"), "{table}");
        assert!(!of(3.0).table(None).contains("now/then"));
    }
}
