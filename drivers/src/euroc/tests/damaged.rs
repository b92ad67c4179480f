//! Damage that is survived and counted.

use super::*;
use crate::ImuReading;
use proptest::prelude::*;

fn frames_and_faults(sample: &Sample) -> (Vec<StereoFrame>, Faults) {
    let dataset = sample.open().unwrap();
    let mut stereo = dataset.stereo();
    let frames = all_frames(&mut stereo, dataset.sizes_px());
    (frames, stereo.faults())
}

fn readings_and_faults(sample: &Sample) -> (Vec<ImuReading>, Faults) {
    let dataset = sample.open().unwrap();
    let mut imu = dataset.imu();
    (all_readings(&mut imu), imu.faults())
}

#[test]
fn images_missing_torn_or_of_another_size_leave_a_frame_without_them() {
    let sample = Sample::new();
    std::fs::remove_file(sample.image(0, 2)).unwrap();
    let whole = std::fs::read(sample.image(1, 4)).unwrap();
    std::fs::write(sample.image(1, 4), &whole[..whole.len() / 2]).unwrap();
    std::fs::write(sample.image(0, 6), plain_png((SIZE.1, SIZE.0), 9)).unwrap();
    std::fs::write(sample.image(0, 8), b"").unwrap();
    std::fs::remove_file(sample.image(1, 8)).unwrap();
    let (frames, faults) = frames_and_faults(&sample);
    assert_eq!(frames.len(), FRAMES as usize);
    assert_eq!(frames[2].valid, [false, true]);
    assert_eq!(frames[4].valid, [true, false]);
    assert_eq!(frames[6].valid, [false, true]);
    assert_eq!(frames[8].valid, [false, false]);
    assert_eq!(frames[9].valid, [true, true]);
    assert_eq!(faults, Faults { missing: 2, corrupt: 3, ..Faults::default() });
}

#[test]
fn frames_that_were_never_recorded_show_as_a_gap() {
    let sample = Sample::new();
    for camera in 0..2 {
        sample.edit(&format!("cam{camera}/data.csv"), |lines| drop(lines.drain(5..8)));
    }
    let (frames, faults) = frames_and_faults(&sample);
    let sequences: Vec<u64> = frames.iter().map(|f| f.sequence).collect();
    assert_eq!(sequences, [0, 1, 2, 3, 7, 8, 9, 10, 11]);
    assert_eq!(faults, Faults { missing: 3, ..Faults::default() });
}

#[test]
fn a_side_without_partner_is_handed_out_alone() {
    let sample = Sample::new();
    sample.edit("cam1/data.csv", |lines| drop(lines.drain(4..6))); // frames 3 and 4
    sample.edit("cam0/data.csv", |lines| drop(lines.remove(8))); // frame 7
    let (frames, faults) = frames_and_faults(&sample);
    let valid: Vec<[bool; 2]> = frames.iter().map(|f| f.valid).collect();
    assert_eq!(valid[2..5], [[true, true], [true, false], [true, false]]);
    assert_eq!((valid[7], frames[7].sequence), ([false, true], 7));
    assert_eq!(faults, Faults { unpaired: 3, ..Faults::default() });
}

#[test]
fn right_images_before_and_after_the_left_are_not_handed_out() {
    let sample = Sample::new();
    sample.edit("cam0/data.csv", |lines| {
        lines.truncate(11); // without frames 10, 11
        lines.remove(1); // without frame 0
    });
    let (frames, faults) = frames_and_faults(&sample);
    assert_eq!(frames.len(), 9);
    assert_eq!((frames[0].sequence, frames[0].stamp.as_nanos()), (0, frame_ns(1)));
    assert!(frames.iter().all(|f| f.valid == [true, true]));
    assert_eq!(faults, Faults { unpaired: 3, ..Faults::default() });
}

#[test]
fn disordered_and_repeated_rows_are_put_right() {
    let sample = Sample::new();
    sample.edit("imu0/data.csv", |lines| {
        lines.swap(10, 11);
        lines.insert(50, lines[49].clone());
    });
    sample.edit("cam0/data.csv", |lines| lines.swap(3, 6));
    let (readings, faults) = readings_and_faults(&sample);
    assert_eq!(readings.len(), FRAMES as usize * 10);
    assert!(readings.windows(2).all(|w| w[0].sample.stamp < w[1].sample.stamp));
    assert_eq!(faults, Faults { disordered: 2, repeated: 1, ..Faults::default() });
    let (frames, faults) = frames_and_faults(&sample);
    assert!(frames.windows(2).all(|w| w[0].stamp < w[1].stamp));
    assert_eq!(faults.disordered, 3);
}

#[test]
fn a_clock_that_steps_back_is_named_with_its_tables_and_place() {
    let sample = Sample::new();
    let back = |lines: &mut Vec<String>, from: usize, by_ns: i64| {
        for line in &mut lines[from..] {
            let (stamp, rest) = line.split_once(',').unwrap();
            *line = format!("{},{rest}", stamp.parse::<i64>().unwrap() - by_ns);
        }
    };
    sample.edit("imu0/data.csv", |lines| back(lines, 60, 203_000_000));
    sample.edit("cam0/data.csv", |lines| back(lines, 7, 203_000_000));
    sample.edit("cam1/data.csv", |lines| back(lines, 7, 203_000_000));
    let dataset = sample.open().unwrap();
    let [defect] = dataset.defects() else { panic!("{:?}", dataset.defects()) };
    assert!(defect.is_grave && defect.what.contains("steps back"), "{defect:?}");
    for words in ["cam1/data.csv by 0.203 s after 0.250 s", "imu0/data.csv by 0.203 s after 0.295 s"] {
        assert!(defect.evidence.contains(words), "{defect:?}");
    }
    let faults = dataset.imu().faults();
    assert_eq!((faults.steps_back, faults.longest_step_back_ns), (1, 203_000_000));
    assert_eq!(dataset.stereo().faults().steps_back, 2);
}

#[test]
fn rows_that_repeat_their_stamps_are_told() {
    let sample = Sample::new();
    sample.edit("imu0/data.csv", |lines| {
        *lines = lines.iter().flat_map(|line| [line.clone(), line.clone()]).collect()
    });
    let dataset = sample.open().unwrap();
    let [defect] = dataset.defects() else { panic!("{:?}", dataset.defects()) };
    assert!(!defect.is_grave && defect.evidence.contains("120 of 240 rows of imu0/data.csv"), "{defect:?}");
    assert_eq!(dataset.imu().faults().repeated, 120);
}

#[test]
fn corrupt_inertial_rows_are_skipped_and_leave_a_gap() {
    let sample = Sample::new();
    sample.edit("imu0/data.csv", |lines| {
        lines[20] = lines[20].replace("-0.02", "NaN");
        lines[30] = lines[30].replace("-0.02", "inf");
        lines[40] = lines[40].replace("9.08", "9.0.8");
        lines[50] = lines[50].replace("9.08", "1e30");
        lines[60] = "\u{0}\u{1}binary".into();
        lines[70] = lines[70].replacen("14037", "94037", 1);
        lines.push("14037152".into());
    });
    let (readings, faults) = readings_and_faults(&sample);
    assert_eq!(readings.len(), FRAMES as usize * 10 - 6);
    assert!(readings.iter().all(|r| r.sample.is_finite()));
    assert_eq!(faults, Faults { missing: 6, corrupt: 7, ..Faults::default() });
    assert_eq!(readings[20].sequence, 21);
}

#[test]
fn a_header_without_hash_is_no_fault() {
    let sample = Sample::new();
    sample.edit("imu0/data.csv", |lines| lines.insert(0, "timestamp,wx,wy,wz,ax,ay,az".into()));
    assert_eq!(readings_and_faults(&sample).1, Faults::default());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn garbage_in_any_table_never_panics(
        table in prop::sample::select(vec!["cam0/data.csv", "cam1/data.csv", "imu0/data.csv"]),
        bytes in prop::collection::vec(any::<u8>(), 0..400),
        at in any::<prop::sample::Index>(),
        replace in any::<bool>(),
    ) {
        let sample = Sample::new();
        let mut content = std::fs::read(sample.path(table)).unwrap();
        let at = at.index(content.len());
        if replace { content = bytes } else { content.splice(at..at, bytes); }
        sample.put(table, content);
        if let Ok(dataset) = sample.open() {
            let readings = all_readings(&mut dataset.imu());
            let later = |a: &ImuReading, b: &ImuReading| a.sample.stamp < b.sample.stamp && a.sequence < b.sequence;
            prop_assert!(readings.is_sorted_by(later));
            let frames = all_frames(&mut dataset.stereo(), dataset.sizes_px());
            prop_assert!(frames.is_sorted_by(|a, b| a.stamp <= b.stamp && a.sequence < b.sequence));
        }
    }

    #[test]
    fn any_stamps_are_paired_without_panic(
        left in prop::collection::vec(-2000_i64..2000, 1..40),
        right in prop::collection::vec(-2000_i64..2000, 1..40),
        tolerance in 0_i64..200,
    ) {
        let rows = |mut stamps: Vec<i64>| {
            stamps.sort_unstable();
            stamps.dedup();
            stamps.iter().filter_map(|t| parse_image_row(&table::row(&t.to_string())).ok()).collect::<Vec<_>>()
        };
        let (left, right) = (rows(left), rows(right));
        let (lefts, rights) = (left.len(), right.len());
        let pairing = pairing::stereo(left, right, tolerance);
        let count = |side: usize| pairing.frames.iter().filter(|f| f.files[side].is_some()).count();
        prop_assert_eq!(count(0), lefts);
        prop_assert_eq!(count(1) + pairing.outside as usize, rights);
        prop_assert!(pairing.frames.is_sorted_by(|a, b| a.stamp <= b.stamp && a.sequence < b.sequence));
    }
}

#[test]
fn names_a_right_camera_that_is_missing() {
    let sample = Sample::new();
    assert_eq!(sample.open().unwrap().defects(), []);
    std::fs::rename(sample.path("cam1"), sample.path("cam2")).unwrap();
    let dataset = sample.open().unwrap();
    let [defect] = dataset.defects() else { panic!("{:?}", dataset.defects()) };
    assert!(defect.what.contains("cam1 is missing") && defect.evidence.contains("cam2"), "{defect:?}");
    // A data set of one camera lacks nothing.
    std::fs::remove_dir_all(sample.path("cam2")).unwrap();
    assert_eq!(sample.open().unwrap().defects(), []);
}
