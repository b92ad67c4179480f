//! Options that `plumbline replay` and `plumbline fly` share, and the files that they name.

use super::{Usage, check_maps};
use anyhow::{Context, Result};
use clap::Args;
use plumbline_drivers::StampedPose;
use plumbline_drivers::tum::write_tum;
use plumbline_estimator::places::Mapper;
use plumbline_flight::flight::{Flight, Flown, PublishedState, is_log};
use plumbline_flight::places::{MapContents, read_known_map, write_map};
use plumbline_lab::report::Report;
use plumbline_link::process::LinkOptions;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

/// Logs that a folder may hold of one second.
const MAX_LOGS_A_SECOND: usize = 10_000;

/// Options of a run.
// Help texts name tables of the configuration in brackets.
#[allow(rustdoc::broken_intra_doc_links)]
#[derive(Debug, Args)]
pub struct RunArgs {
    /// Change a key, such as estimator.points.sigma_px=0.3; may be repeated. What is simulated stays.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub overrides: Vec<String>,
    /// Record to this file or into this folder; [recorder] sets the contents.
    #[arg(long, value_name = "LOG.mcap|FOLDER")]
    pub record: Option<PathBuf>,
    /// Write the report (JSON) at the end.
    #[arg(long, value_name = "OUT.json")]
    pub report: Option<PathBuf>,
    /// Print the report as JSON instead of the summary.
    #[arg(long)]
    pub json: bool,
    /// Write the causal trajectory (TUM): each pose as its frame arrived.
    #[arg(long, value_name = "OUT.tum")]
    pub trajectory: Option<PathBuf>,
    /// Continue this map; poses come in its frame too, once it is seen.
    #[arg(long, value_name = "IN.map")]
    pub map: Option<PathBuf>,
    /// Write the map, that of --map included, at the end and on `map save`.
    #[arg(long, value_name = "OUT.map")]
    pub save_map: Option<PathBuf>,
    /// Publish over Zenoh, here too: tcp/0.0.0.0:7447; may be repeated.
    #[arg(long, value_name = "ENDPOINT")]
    pub listen: Vec<String>,
    /// Publish over Zenoh: connect to this router or station too; may be repeated.
    #[arg(long, value_name = "ENDPOINT")]
    pub connect: Vec<String>,
}

impl RunArgs {
    /// Files that are written at the end.
    pub fn files(&self) -> impl Iterator<Item = &PathBuf> {
        [&self.trajectory, &self.save_map, &self.report].into_iter().flatten()
    }

    /// File that the flight is recorded to.
    ///
    /// # Errors
    /// When it has another ending, or the folder that is named cannot be made or has no name left.
    pub fn log(&self) -> Result<Option<PathBuf>, Usage> {
        self.record.as_deref().map(|path| log_path(path, SystemTime::now())).transpose()
    }

    /// Gives the flight the map that it goes on with.
    ///
    /// # Errors
    /// When it cannot be read, or the configuration makes no map.
    pub fn take_map(&self, flight: &mut Flight) -> Result<()> {
        check_maps(&flight.config, self.map.is_some(), self.save_map.is_some())?;
        if let Some(path) = &self.map {
            flight.map = Some(read_known_map(path, Mapper::limits(flight.config.setup()))?);
        }
        Ok(())
    }

    /// Endpoints of the network process.
    pub fn link(&self, is_patient: bool) -> LinkOptions {
        let (listen, connect) = (self.listen.clone(), self.connect.clone());
        LinkOptions { listen, connect, publish: false, is_patient }
    }

    /// Writes the files of the end; returns what is printed.
    ///
    /// # Errors
    /// When one cannot be written.
    pub fn write(&self, flown: &Flown, report: &Report) -> Result<String> {
        if let Some(path) = &self.trajectory {
            let pose = |p: &PublishedState| StampedPose { stamp: p.stamp, pose: p.pose_o_b };
            write_tum(path, &flown.poses.iter().map(pose).collect::<Vec<_>>())?;
        }
        if let (Some(path), Some(places)) = (&self.save_map, &flown.outcome.places) {
            write_map(path, &MapContents::of(places.mapper.map()))?;
        }
        let json = serde_json::to_string_pretty(report)?;
        if let Some(path) = &self.report {
            std::fs::write(path, &json).with_context(|| format!("{}", path.display()))?;
        }
        Ok(if self.json { json } else { report.summary() })
    }
}

/// Fails where the recording has failed.
///
/// # Errors
/// When it has.
pub fn check_recording(report: &Report) -> Result<()> {
    let failed = report.recording.as_ref().filter(|recording| recording.has_failed);
    failed.map_or(Ok(()), |recording| Err(anyhow::anyhow!("the recording failed: {recording}")))
}

/// Where the flight is recorded: the file that was named, or a new one in the folder that was. A name that ends in `/` is one of
/// a folder, which is made.
fn log_path(named: &Path, now: SystemTime) -> Result<PathBuf, Usage> {
    let is_folder = named.as_os_str().as_encoded_bytes().ends_with(b"/");
    if is_folder && !named.exists() {
        std::fs::create_dir_all(named).map_err(|error| {
            Usage(format!("{}: the folder cannot be made ({error}); name another", named.display()))
        })?;
    }
    if named.is_dir() {
        let now = time::OffsetDateTime::from(now);
        let (date, time) = (now.date(), now.time());
        let (month, day) = (u8::from(date.month()), date.day());
        let (hour, minute, second) = time.as_hms();
        let year = date.year();
        let name = format!("{year:04}-{month:02}-{day:02}T{hour:02}-{minute:02}-{second:02}Z");
        // A computer without a clock of its own may begin with the same second each time, and must fly all the same.
        let numbered = (2..).map(|k| named.join(format!("{name}-{k}.mcap")));
        let names = std::iter::once(named.join(format!("{name}.mcap"))).chain(numbered);
        return names.take(MAX_LOGS_A_SECOND).find(|path| !path.exists()).ok_or_else(|| {
            Usage(format!("{}: too many logs named {name}; name another folder", named.display()))
        });
    }
    if !is_log(named) {
        let named = named.display();
        return Err(Usage(format!(
            "{named}: name a file with the ending .mcap, an existing folder, or a new one with `/` at its end"
        )));
    }
    Ok(named.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn a_log_is_named_or_gets_the_name_of_its_time() {
        let folder = tempfile::tempdir().unwrap();
        let now = SystemTime::UNIX_EPOCH + Duration::from_secs(1_763_813_106);
        let log = log_path(folder.path(), now).unwrap();
        assert_eq!(log, folder.path().join("2025-11-22T12-05-06Z.mcap"));
        for next in ["2025-11-22T12-05-06Z-2.mcap", "2025-11-22T12-05-06Z-3.mcap"] {
            std::fs::write(log_path(folder.path(), now).unwrap(), "").unwrap();
            assert_eq!(log_path(folder.path(), now).unwrap(), folder.path().join(next));
        }
        assert_eq!(log_path(Path::new("a.mcap"), now).unwrap(), Path::new("a.mcap"));
        let new = folder.path().join("logs/of today/");
        assert_eq!(log_path(&new, now).unwrap(), new.join("2025-11-22T12-05-06Z.mcap"));
        assert!(new.is_dir());
        let in_the_way = folder.path().join("2025-11-22T12-05-06Z.mcap/");
        assert!(log_path(&in_the_way, now).unwrap_err().0.contains("cannot be made"));
        assert!(log_path(Path::new("/nowhere/a"), now).unwrap_err().0.contains("existing folder"));
    }
}
