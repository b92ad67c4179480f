//! Truth of the pairs in motion: how far its path wanders from the one that the inertial samples feel.
//!
//! The second difference `p(t + h) - 2 p(t) + p(t - h)` of a path is the integral of its acceleration, weighted by a triangle. What the truth has
//! beyond that of the samples has the variance `2 q h` if its positions walk at random with a density of `q`, and `6 s²` if
//! they scatter by `s`.

use nalgebra::Vector3;
use plumbline_config::{Config, import};
use plumbline_drivers::{EurocDataset, EurocOptions, ImuSource as _};
use plumbline_tests::shared;

/// Rows of the truth, and their interval, s.
type Row = (f64, Vector3<f64>, Vector3<f64>);
const ROW_S: f64 = 0.005;

/// Time, position and acceleration by the samples of each row of the truth, m and m/s² in `W`.
fn rows(folder: &std::path::Path) -> Vec<Row> {
    let config = import::euroc_into(Config::preset("euroc").unwrap(), folder).unwrap();
    let dataset = EurocDataset::open(folder, &EurocOptions::for_config(&config)).unwrap();
    let mut samples = Vec::new();
    let mut imu = dataset.imu();
    while let Some(reading) = imu.next_reading().unwrap() {
        samples.push(reading.sample);
    }
    let truth = dataset.ground_truth().unwrap().unwrap();
    let gravity_w = Vector3::new(0.0, 0.0, -config.imu.gravity_m_s2);
    let of_row = |state: &plumbline_drivers::TruthState| {
        let nearest = samples.iter().min_by_key(|sample| state.stamp.nanos_since(sample.stamp).abs())?;
        let pose = &state.pose_w_b;
        let time_s = state.stamp.seconds_since(truth[0].stamp);
        Some((time_s, pose.translation.vector, pose.rotation * nearest.accel + gravity_w))
    };
    truth.iter().filter_map(of_row).collect()
}

/// Density of the random walk of the truth by second differences over `half` rows, m²/s, of each axis.
fn walk(rows: &[Row], half: usize) -> Vector3<f64> {
    let half_s = half as f64 * ROW_S;
    let beyond = |span: &[Row]| {
        let [first, middle, last] = [0, half, 2 * half].map(|k| span[k].1);
        let weight = |k: usize| (half - k.abs_diff(half)) as f64 * ROW_S * ROW_S;
        let felt: Vector3<f64> = span.iter().enumerate().map(|(k, row)| row.2 * weight(k)).sum();
        (last - middle) - (middle - first) - felt
    };
    let is_whole = |span: &&[Row]| span[2 * half].0 - span[0].0 < (2.0 * half_s) * 1.02;
    let all: Vec<Vector3<f64>> = rows.windows(2 * half + 1).filter(is_whole).map(beyond).collect();
    let mean = all.iter().sum::<Vector3<f64>>() / all.len() as f64;
    let squares: Vector3<f64> = all.iter().map(|x| (x - mean).component_mul(&(x - mean))).sum();
    squares / (all.len() as f64 * 2.0 * half_s)
}

#[test]
fn the_truth_of_the_pairs_in_motion_walks_by_four_millimetres_in_a_second() {
    let Some(shared) = shared("euroc/MH_01_lossless") else { return };
    let rows = rows(&shared.join("euroc/MH_01_lossless"));
    let after_a_second_mm = [5, 10, 20, 50].map(|half| 1e3 * walk(&rows, half).sum().sqrt());
    println!("the truth walks by {after_a_second_mm:.1?} mm in a second, by 25, 50, 100 and 250 ms");
    // Alike over all lengths: a walk, and no scatter.
    assert!(after_a_second_mm.iter().all(|mm| (3.0..5.0).contains(mm)), "{after_a_second_mm:?}");
}
