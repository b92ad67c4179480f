use super::super::inventory;
use super::super::parts::existing_parts;
use super::super::reader::Ending;
use super::*;

/// Raw images of the small flight: some 65 kB a frame, more than a megabyte in all.
fn recorded_within(limits: Limits) -> (TempDir, PathBuf, RecorderSummary) {
    let (folder, path) = place();
    let (_, summary) = record_on(OpenPart::files(), limits, &path, ImageRecording::Raw);
    (folder, path, summary)
}

fn bytes_on_disk(path: &Path) -> u64 {
    existing_parts(path).iter().map(|(_, path)| path.metadata().unwrap().len()).sum()
}

#[test]
fn a_log_in_parts_is_read_as_one() {
    let limits = Limits { part_bytes: 600_000, ..NO_LIMITS };
    let (_folder, path, summary) = recorded_within(limits);
    assert!(summary.parts > 2, "{summary:?}");
    assert_eq!(summary.bytes, bytes_on_disk(&path));
    for (_, part) in existing_parts(&path) {
        assert!(part.metadata().unwrap().len() <= limits.part_bytes, "{}", part.display());
    }
    let v = verified(&path).unwrap();
    assert!(v.identical && v.complete, "{v:?}");
    let second = path.with_extension("1.mcap");
    std::fs::remove_file(second).unwrap();
    let error = verified(&path).unwrap_err().to_string();
    assert!(error.contains("part 1 is missing"), "{error}");
}

#[test]
fn the_beginning_of_the_flight_is_kept_within_the_limit() {
    let limits = Limits { part_bytes: 600_000, total_bytes: 1_000_000, keep: KeepPolicy::Beginning };
    let (_folder, path, summary) = recorded_within(limits);
    assert!(bytes_on_disk(&path) <= limits.total_bytes, "{summary:?}");
    assert!(summary.ended_early.unwrap().contains("recorder.max_total_mb"));
    assert!(summary.not_recorded > 0);
    let v = verified(&path).unwrap();
    assert!(v.identical && !v.complete && v.ended_for_room && v.estimates_identical > 3, "{v:?}");
}

#[test]
fn the_newest_of_the_flight_is_kept_within_the_limit() {
    let limits = Limits { part_bytes: 400_000, total_bytes: 900_000, keep: KeepPolicy::Newest };
    let (_folder, path, summary) = recorded_within(limits);
    assert!(bytes_on_disk(&path) <= limits.total_bytes, "{summary:?}");
    assert!(summary.deleted_bytes > 0 && summary.ended_early.is_none(), "{summary:?}");
    assert_eq!(summary.bytes, bytes_on_disk(&path));
    let mut reader = LogReader::open(&path).unwrap();
    assert!(reader.about().part > 0);
    let inventory = inventory::take(&mut reader).unwrap();
    assert_eq!((inventory.ending, inventory.inputs_changed), (Ending::Flight, false));
    assert!(verified(&path).unwrap_err().to_string().contains("beginning was deleted"));
}

#[test]
fn a_log_is_never_overwritten() {
    let (_folder, path, _) = recorded_within(Limits { part_bytes: 600_000, ..NO_LIMITS });
    let start = || Recorder::start(&path, &config(), (None, 0), WhenFull::Drop).err().unwrap();
    assert!(matches!(start(), LogError::Exists { .. }));
    std::fs::remove_file(&path).unwrap();
    assert!(start().to_string().contains("flight.1.mcap: exists"));
}

#[test]
fn parts_of_another_flight_are_not_read() {
    let (_folder, path, _) = recorded_within(NO_LIMITS);
    let (_other, other, _) = recorded_within(Limits { part_bytes: 600_000, ..NO_LIMITS });
    std::fs::copy(other.with_extension("1.mcap"), path.with_extension("1.mcap")).unwrap();
    assert_eq!(LogReader::open(&path).unwrap().parts(), 1);
    assert!(verified(&path).unwrap().complete);
}
