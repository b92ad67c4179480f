use super::super::cursor::Cursor;
use super::super::inventory;
use super::super::reader::Ending;
use super::*;
use proptest::prelude::*;
use std::sync::OnceLock;

/// The bytes of a log, made once.
fn log_bytes() -> &'static [u8] {
    static BYTES: OnceLock<Vec<u8>> = OnceLock::new();
    BYTES.get_or_init(intact)
}

fn written(bytes: &[u8]) -> (TempDir, PathBuf) {
    let (folder, path) = place();
    std::fs::write(&path, bytes).unwrap();
    (folder, path)
}

fn intact() -> Vec<u8> {
    let (_folder, path, _) = recorded(ImageRecording::Png);
    std::fs::read(path).unwrap()
}

#[test]
fn a_flipped_byte_is_found_by_its_crc() {
    let mut bytes = intact();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 0x10;
    let (_folder, path) = written(&bytes);
    let v = verified(&path).unwrap();
    assert!(v.damage.as_ref().unwrap().contains("flight.mcap: damaged after"), "{v:?}");
    assert!(v.identical && !v.complete && v.estimates_identical > 3, "what comes before it is sound: {v:?}");
    assert!((0.2..1.0).contains(&v.executed_s), "{v:?}");
}

#[test]
fn a_file_whose_end_never_came_to_the_disk_is_executed_as_far_as_it_did() {
    // After a power failure a file may have its length and not its content.
    let mut bytes = intact();
    let whole = bytes.len() * 2 / 3;
    bytes[whole..].fill(0);
    let (_folder, path) = written(&bytes);
    let v = verified(&path).unwrap();
    assert!(v.identical && !v.complete && v.damage.is_some() && v.estimates_identical > 5, "{v:?}");
}

#[test]
fn a_log_that_breaks_off_is_read_up_to_its_last_chunk() {
    let bytes = intact();
    let (_folder, path) = written(&bytes[..bytes.len() * 2 / 3]);
    let mut reader = LogReader::open(&path).unwrap();
    let inventory = inventory::take(&mut reader).unwrap();
    assert_eq!((inventory.ending, inventory.inputs_changed), (Ending::Truncated, false));
    assert!(inventory.contents[Channel::Imu as usize].messages > 50, "{inventory:?}");
    let v = verified(&path).unwrap();
    assert!(v.identical && v.truncated && !v.complete && v.estimates_identical > 5, "{v:?}");
}

#[test]
fn a_log_that_breaks_off_in_its_summary_is_complete() {
    let bytes = intact();
    let (_folder, path) = written(&bytes[..bytes.len() - 100]);
    let v = verified(&path).unwrap();
    assert!(v.identical && v.complete, "{v:?}");
}

#[test]
fn bytes_behind_the_end_of_a_log_are_damage() {
    for added in [&b"x"[..], mcap::MAGIC, &[0; 100_000]] {
        let (_folder, path) = written(&[&intact(), added].concat());
        let v = verified(&path).unwrap();
        let damage = v.damage.as_ref().unwrap();
        assert!(v.identical && !v.complete && damage.contains("after"), "{v:?}");
    }
}

#[test]
fn what_is_no_flight_log_is_refused_with_the_cure() {
    for bytes in [&b""[..], b"#timestamp", b"\x89MCAP0\r\n", &[0; 4096]] {
        let (_folder, path) = written(bytes);
        let error = verified(&path).unwrap_err().to_string();
        assert!(error.contains("not a flight log") && error.contains("--record"), "{error}");
    }
    let missing = verified(Path::new("/nonexistent/flight.mcap")).unwrap_err().to_string();
    assert!(missing.starts_with("/nonexistent/flight.mcap: "), "{missing}");
}

/// Reads everything that a log holds, images too.
fn read_all(path: &Path) -> Result<(), LogError> {
    inventory::take(&mut LogReader::open(path)?)?;
    let mut cursor = Cursor::open(path, &[Channel::Left, Channel::Right, Channel::Frame])?;
    let mut frame = plumbline_drivers::StereoFrame::new([(0, 0); 2]);
    while cursor.next_frame(&mut frame)?.is_some() {}
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(100))]

    #[test]
    fn no_damage_makes_the_reader_panic(
        flips in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..6),
        at_start in any::<bool>(),
        cut in any::<prop::sample::Index>(),
    ) {
        let mut bytes = log_bytes().to_vec();
        // The beginning has the metadata, schemas and headers; the rest is mostly images.
        let range = if at_start { bytes.len().min(20_000) } else { bytes.len() };
        for (place, value) in flips {
            let place = place.index(range.max(1)).min(bytes.len().saturating_sub(1));
            if let Some(byte) = bytes.get_mut(place) {
                *byte = value;
            }
        }
        bytes.truncate(cut.index(2 * bytes.len() + 1));
        let (_folder, path) = written(&bytes);
        let _ = read_all(&path);
        let _ = verified(&path);
    }
}
