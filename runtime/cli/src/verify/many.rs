//! Several logs: a row each, in the order in which they were named, so many at a time.

use super::{VerifyArgs, objection};
use crate::simulated::check_recorded;
use crate::{Usage, say, stop_on_signal};
use anyhow::{Result, bail};
use indicatif::{ProgressBar, ProgressStyle};
use plumbline_flight::log::parts::existing_parts;
use plumbline_flight::log::verify::{Verification, verify};
use serde::Serialize;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

/// Result for one log.
#[derive(Debug, Serialize)]
struct Row {
    log: PathBuf,
    /// Identical, and complete or accepted as it is.
    ok: bool,
    /// Objection to it.
    #[serde(skip_serializing_if = "Option::is_none")]
    objection: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    verification: Option<Verification>,
    /// Time of the execution, s.
    seconds: f64,
}

/// Verifies all logs of `args`.
///
/// # Errors
/// When any cannot be executed, is not bit-identical, or is not complete.
pub(super) fn run(args: &VerifyArgs) -> Result<()> {
    let logs = whole_logs(&args.logs);
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let jobs = args.jobs.map_or(cores, usize::from).min(logs.len());
    // A terminal gets its cursor back, and what was verified so far is told.
    let stop = stop_on_signal()?;
    let bar = ProgressBar::new(logs.len() as u64);
    let template = "{bar:32} {pos}/{len} logs  {elapsed} (eta {eta})";
    bar.set_style(ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar()));
    let (next, rows) = (AtomicUsize::new(0), Mutex::new(Vec::new()));
    let work = || {
        while !stop.load(Ordering::Relaxed) {
            let index = next.fetch_add(1, Ordering::Relaxed);
            let Some(log) = logs.get(index) else { return };
            let row = verified(log, args.allow_incomplete);
            rows.lock().unwrap_or_else(PoisonError::into_inner).push((index, row));
            bar.inc(1);
        }
    };
    std::thread::scope(|scope| (0..jobs).for_each(|_| _ = scope.spawn(work)));
    bar.finish_and_clear();
    let mut rows = rows.into_inner().unwrap_or_else(PoisonError::into_inner);
    rows.sort_by_key(|(index, _)| *index);
    let rows: Vec<Row> = rows.into_iter().map(|(_, row)| row).collect();
    say(if args.json { serde_json::to_string_pretty(&rows)? } else { table(&rows) });
    if rows.len() < logs.len() {
        bail!("stopped: {} of {} logs were verified", rows.len(), logs.len());
    }
    let bad: Vec<&Row> = rows.iter().filter(|row| !row.ok).collect();
    match bad.first() {
        None => Ok(()),
        Some(first) => {
            let objection = first.objection.as_deref().unwrap_or_default();
            bail!("{} of {} logs do not pass; {}: {objection}", bad.len(), rows.len(), first.log.display())
        }
    }
}

/// Refuses a list that names a log which is not there, before any is executed.
pub(super) fn check_there(logs: &[PathBuf]) -> Result<(), Usage> {
    logs.iter().try_for_each(|log| check_recorded(log))?;
    match logs.iter().find(|log| !log.exists()) {
        Some(log) => {
            Err(Usage(format!("{}: does not exist; nothing was verified; check the path", log.display())))
        }
        None => Ok(()),
    }
}

fn verified(log: &Path, allow_incomplete: bool) -> Row {
    let start = Instant::now();
    let (objection, verification) = match verify(log, None, None, &mut |_| {}) {
        Ok(verification) => (objection(&verification, allow_incomplete), Some(verification)),
        // The log's name stands before it already.
        Err(error) => (Some(error.to_string().replacen(&format!("{}: ", log.display()), "", 1)), None),
    };
    let seconds = start.elapsed().as_secs_f64();
    Row { log: log.to_owned(), ok: objection.is_none(), objection, verification, seconds }
}

/// The logs without those files that are further parts of others among them, each once.
fn whole_logs(named: &[PathBuf]) -> Vec<PathBuf> {
    let parts: BTreeSet<PathBuf> = named
        .iter()
        .flat_map(|log| existing_parts(log).into_iter().filter(|(part, _)| *part > 0).map(|(_, path)| path))
        .collect();
    let mut seen = BTreeSet::new();
    named.iter().filter(|log| !parts.contains(*log) && seen.insert(*log)).cloned().collect()
}

fn table(rows: &[Row]) -> String {
    let width =
        rows.iter().map(|row| row.log.display().to_string().chars().count()).max().unwrap_or(3).max(3);
    let mut lines =
        vec![format!("{:<width$}  verdict    estimates  odometry       s  estimate digest", "log")];
    for row in rows {
        let verdict = if row.ok { "identical" } else { "FAILED" };
        let figures = match &row.verification {
            Some(v) => {
                let digest = if v.difference.is_none() { &v.estimate_digest[..16] } else { "-" };
                let (estimates, odometry) = (v.estimates_identical, v.odometry_identical);
                format!("{estimates:>9}  {odometry:>8}  {:>6.1}  {digest}", row.seconds)
            }
            None => format!("{:>9}  {:>8}  {:>6.1}  -", "-", "-", row.seconds),
        };
        lines.push(format!("{:<width$}  {verdict:<9}  {figures}", row.log.display()));
        lines.extend(row.objection.as_ref().map(|objection| format!("{:width$}  {objection}", "")));
    }
    let passed = rows.iter().filter(|row| row.ok).count();
    lines.push(format!("{passed} of {} logs are bit-identical", rows.len()));
    lines.join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn further_parts_and_doubles_are_passed_over() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        for name in ["a.mcap", "a.1.mcap", "a.2.mcap", "b.mcap", "c.1.mcap"] {
            std::fs::write(at(name), "").unwrap();
        }
        let named = ["a.1.mcap", "a.2.mcap", "a.mcap", "b.mcap", "a.mcap", "c.1.mcap"].map(at);
        // The beginning of c is not there: that is told of it, not hidden.
        assert_eq!(whole_logs(&named), ["a.mcap", "b.mcap", "c.1.mcap"].map(at));
    }

    #[test]
    fn a_list_with_a_log_that_is_not_there_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let there = folder.path().join("a.mcap");
        std::fs::write(&there, "").unwrap();
        assert!(check_there(std::slice::from_ref(&there)).is_ok());
        let message = check_there(&[there, folder.path().join("b.mcap")]).unwrap_err().to_string();
        assert!(message.contains("b.mcap: does not exist"), "{message}");
    }

    #[test]
    fn a_log_that_cannot_be_executed_has_its_row() {
        let rows = [verified(Path::new("/nowhere/at/all.mcap"), false)];
        let text = table(&rows);
        assert!(!rows[0].ok && text.contains("FAILED") && text.contains("0 of 1 logs"), "{text}");
    }
}
