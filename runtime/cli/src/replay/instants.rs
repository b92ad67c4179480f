//! `--at`: the states at the instants of a list.

use super::ReplayArgs;
use anyhow::{Context as _, Result, ensure};
use plumbline_config::Timestamp;
use plumbline_flight::flight::PublishedState;
use plumbline_record::InstantAnswer;
use plumbline_record::columns::instants;
use std::path::{Path, PathBuf};

/// File for the states at instants, if there are any. Default: beside the list, with the ending `_states.csv`.
pub(super) fn file(args: &ReplayArgs) -> Option<PathBuf> {
    let at = args.at.as_deref()?;
    let beside = || {
        let name = at.file_stem().unwrap_or_default().to_string_lossy();
        at.with_file_name(format!("{name}_states.csv"))
    };
    Some(args.at_out.clone().unwrap_or_else(beside))
}

/// Writes the states at instants of a flight with these `poses`, and logs how many instants have none.
///
/// # Errors
/// When the file cannot be written, or no instant has a state.
pub(super) fn write(path: &Path, rows: &[InstantAnswer], poses: &[PublishedState]) -> Result<()> {
    instants::write(path, rows).with_context(|| format!("{}", path.display()))?;
    let refused = || rows.iter().filter_map(|row| Some((row, row.outcome.refusal()?)));
    let count = refused().count();
    ensure!(
        count == 0 || count < rows.len(),
        "--at: none of {count} instants has a state: the list is {}, the flight {}; give nanoseconds on the clock of the inertial samples",
        span(rows.iter().map(|row| row.instant.stamp)),
        span(poses.iter().map(|pose| pose.stamp))
    );
    if let Some((first, why)) = refused().next() {
        let stamp = first.instant.stamp.as_nanos();
        tracing::warn!("--at: {count} of {} instants have no state; the first, {stamp}: {why}", rows.len());
    }
    tracing::info!("--at: states written to {}", path.display());
    Ok(())
}

/// Earliest and latest stamp in words.
fn span(stamps: impl Iterator<Item = Timestamp> + Clone) -> String {
    let ends = [stamps.clone().min(), stamps.max()].map(|end| end.map_or(0, Timestamp::as_nanos));
    format!("{} to {} ns", ends[0], ends[1])
}

#[cfg(test)]
mod tests {
    use super::*;
    use plumbline_record::InstantOutcome;

    #[test]
    fn a_list_of_which_no_instant_is_answered_is_refused_with_both_spans() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("states.csv");
        let answer = |ms: i64, outcome| {
            let mut answer = InstantAnswer { outcome, ..InstantAnswer::default() };
            answer.instant.stamp = Timestamp::from_nanos(ms);
            answer
        };
        let refused = [10_500, 12_000].map(|ms| answer(ms, InstantOutcome::NoPose));
        let message = write(&path, &refused, &[]).unwrap_err().to_string();
        assert!(message.contains("10500 to 12000 ns") && message.contains("nanoseconds"), "{message}");
        let one = [refused[0].clone(), answer(11_000, InstantOutcome::Answered)];
        write(&path, &one, &[]).unwrap();
        write(&path, &[], &[]).unwrap();
    }
}
