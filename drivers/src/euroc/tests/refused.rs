//! Folders that are no data set, and the one-line error for each.

use super::*;
use std::fs::create_dir_all;

#[test]
fn too_many_corrupt_rows() {
    let sample = Sample::new();
    sample.edit("imu0/data.csv", |lines| lines.iter_mut().step_by(8).for_each(|line| line.truncate(25)));
    let message = sample.refusal();
    assert!(message.contains("15 of 120 rows are corrupt"), "{message}");
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
