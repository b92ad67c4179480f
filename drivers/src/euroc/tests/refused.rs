//! Folders that are no data set, and the one-line error for each.

use super::*;
use std::fs::{create_dir_all, remove_dir_all, remove_file};

#[test]
fn a_path_that_is_no_data_set() {
    let dir = tempfile::tempdir().unwrap();
    let open = |path: &Path| EurocDataset::open(path, &EurocOptions::default()).unwrap_err().to_string();
    assert!(open(&dir.path().join("nowhere")).contains("does not exist"));
    assert!(open(dir.path()).contains("holds no mav0/cam0"));
    let file = dir.path().join("file.zip");
    std::fs::write(&file, "PK").unwrap();
    assert!(open(&file).contains("is not a directory"));
    create_dir_all(dir.path().join("mav0")).unwrap();
    assert!(open(dir.path()).contains("cam0/data.csv: is missing"));
}

#[test]
fn tables_missing_empty_or_of_headers_only() {
    for table in ["cam0/data.csv", "cam1/data.csv", "imu0/data.csv"] {
        let sample = Sample::new();
        for empty in ["", "#timestamp [ns],filename\n", "\r\n\r\n", "timestamp,filename"] {
            sample.put(table, empty);
            let message = sample.refusal();
            assert!(message.contains(table) && message.contains("has no rows"), "{message}");
        }
        sample.put(table, "a,b\nc,d\n");
        assert!(sample.refusal().contains("its only row is not readable"), "{}", sample.refusal());
        remove_file(sample.path(table)).unwrap();
        let message = sample.refusal();
        assert!(message.contains(table) && message.contains("is missing"), "{message}");
    }
}

#[test]
fn too_many_corrupt_rows() {
    let sample = Sample::new();
    sample.edit("imu0/data.csv", |lines| lines.iter_mut().step_by(8).for_each(|line| line.truncate(25)));
    let message = sample.refusal();
    assert!(message.contains("15 of 120 rows are corrupt"), "{message}");
}

#[test]
fn no_images_at_all() {
    let sample = Sample::new();
    remove_dir_all(sample.path("cam0/data")).unwrap();
    assert!(sample.refusal().contains("none of the 12 images"));
    let sample = Sample::new();
    for i in 0..FRAMES {
        std::fs::write(sample.image(1, i), b"\xff\xd8\xff\xe0 JFIF").unwrap();
    }
    let message = sample.refusal();
    assert!(
        message.contains("cam1/data: none of the 12 images of data.csv is a whole PNG or JPEG"),
        "{message}"
    );
}

#[test]
fn formats_that_are_not_read_are_refused_with_the_cure() {
    for (ending, magic) in [("tiff", &b"II*\0xxxx"[..]), ("pgm", b"P5 16 12 255 "), ("bmp", b"BM")] {
        for is_named in [true, false] {
            let sample = Sample::new();
            for i in 0..FRAMES {
                remove_file(sample.image(0, i)).unwrap();
                std::fs::write(sample.image(0, i).with_extension(ending), magic).unwrap();
            }
            if is_named {
                sample.edit("cam0/data.csv", |lines| {
                    lines.iter_mut().for_each(|line| *line = line.replace("png", ending))
                });
            }
            let message = sample.refusal();
            assert!(message.contains("convert the images to PNG"), "{message}");
        }
    }
}

#[test]
fn images_of_another_camera() {
    let sample = Sample::new();
    let options = EurocOptions { sizes_px: vec![SIZE, (752, 480)], ..EurocOptions::default() };
    let message = EurocDataset::open(sample.dir.path(), &options).unwrap_err().to_string();
    assert!(
        message.contains("images are 16x12, but the configuration says 752x480 for camera 1"),
        "{message}"
    );
}

#[test]
fn cameras_that_never_meet() {
    let sample = Sample::new();
    sample.edit("cam1/data.csv", |lines| {
        for (i, line) in lines.iter_mut().skip(1).enumerate() {
            *line = format!("{},{}.png", frame_ns(i as i64) + 20_000_000, frame_ns(i as i64));
        }
    });
    assert!(sample.refusal().contains("no left image has a partner within 0.002 s"));
}

#[test]
fn an_imu_of_another_day() {
    let sample = Sample::new();
    sample.edit("imu0/data.csv", |lines| lines.iter_mut().for_each(|line| line.replace_range(0..5, "15037")));
    assert!(sample.refusal().contains("do the files belong together?"));
}

#[test]
fn tables_without_stamps() {
    for (table, stamp) in
        [("imu0/data.csv", "0"), ("cam0/data.csv", "0"), ("cam1/data.csv", "1700000000000000000")]
    {
        let sample = Sample::new();
        sample.edit(table, |lines| {
            for line in lines.iter_mut().filter(|line| !line.starts_with('#')) {
                *line = format!("{stamp},{}", line.split_once(',').unwrap().1);
            }
        });
        let message = sample.refusal();
        assert!(message.contains(table) && message.contains("not stamped"), "{message}");
        assert!(message.contains(&format!("have the stamp {stamp}")), "{message}");
    }
}

#[test]
fn ground_truth_that_is_garbage_is_said_when_asked_for() {
    let sample = Sample::new();
    create_dir_all(sample.path("state_groundtruth_estimate0")).unwrap();
    sample.put("state_groundtruth_estimate0/data.csv", [0xff_u8; 300]);
    let dataset = sample.open().unwrap();
    assert!(dataset.ground_truth().unwrap_err().to_string().contains("its only row is not readable"));
}

#[test]
fn truth_of_a_motion_capture_is_found_after_that_of_the_batch_estimate() {
    let sample = Sample::new();
    let put = |folder: &str, x: f64| {
        create_dir_all(sample.path(folder)).unwrap();
        sample.put(&format!("{folder}/data.csv"), format!("{START_NS},{x},0,0,1,0,0,0"));
    };
    put("leica0", 9.0);
    assert!(ground_truth_table(sample.dir.path()).is_some_and(|table| is_of_positions(&table)));
    assert_eq!(sample.open().unwrap().ground_truth().unwrap(), None);
    for (folder, x) in [("vicon0", 3.0), ("mocap0", 2.0), ("state_groundtruth_estimate0", 1.0)] {
        put(folder, x);
        let truth = sample.open().unwrap().ground_truth().unwrap().unwrap();
        assert_eq!(truth[0].pose_w_b.translation.x, x, "{folder}");
        for path in [sample.dir.path(), &sample.path("")] {
            assert!(ground_truth_table(path).is_some_and(|table| table.parent().unwrap().ends_with(folder)));
        }
    }
}

#[test]
fn a_bad_table_shows_its_first_bad_line_and_what_is_wrong_with_it() {
    let sample = Sample::new();
    let rewrite = |row: &dyn Fn(&str) -> String| {
        let sample = Sample::new();
        sample.edit("imu0/data.csv", |lines| lines.iter_mut().for_each(|line| *line = row(line)));
        sample.refusal()
    };
    let in_seconds = rewrite(&|line| format!("{}.{}", &line[..10], &line[10..]));
    assert!(in_seconds.contains("line 1: the time '14037"), "{in_seconds}");
    assert!(in_seconds.contains("seconds, multiply it by 1e9"), "{in_seconds}");
    let semicolons = rewrite(&|line| line.replace(',', ";"));
    assert!(semicolons.contains("commas separate columns"), "{semicolons}");
    let short = rewrite(&|line| line.rsplit_once(',').unwrap().0.to_owned());
    assert!(
        short.contains("ends before column 7") && short.contains("expected columns: timestamp"),
        "{short}"
    );
    sample.edit("cam0/data.csv", |lines| lines.iter_mut().skip(2).for_each(|line| line.insert(0, 'x')));
    assert!(sample.refusal().contains("cam0/data.csv") && sample.refusal().contains("line 3: the time 'x"));
}

#[test]
fn seconds_that_hold_no_frame_are_refused() {
    let sample = Sample::new();
    for seconds in [50.0..60.0, 0.2..0.2, -5.0..-1.0] {
        let options = EurocOptions { seconds, ..EurocOptions::default() };
        let message = EurocDataset::open(sample.path("..").as_path(), &options).unwrap_err().to_string();
        assert!(message.contains("s of frames, of which"), "{message}");
    }
}
