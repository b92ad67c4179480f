//! Everything an estimate holds, a row a frame: kept during a flight, written as CSV, read back for figures.
//!
//! The names of the columns say quantity, frame and unit: `p_o_b_x_m` is the x component of the position of the body
//! `B` in the odometry frame `O`, in metres; `var_theta_x_rad2` is the variance of the attitude's error about the
//! body's x axis (right perturbation `R Exp(dtheta)`). Quaternions are Hamilton, columns in the order x y z w. A
//! frame without a pose has empty cells where the state would stand.

mod columns;
mod read;

pub use read::{StatesError, is_states, read_states};

use nalgebra::{Isometry3, SVector, Vector3};
use plumbline_config::Timestamp;
use plumbline_estimator::{Estimate, FrameFigures, HealthBits, TrackingState};
use std::io::{BufWriter, Write};
use std::path::Path;

/// The state of the vehicle and of its sensors after a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RowState {
    /// Pose of the body in the odometry frame.
    pub pose_o_b: Isometry3<f64>,
    /// Velocity of the body in the odometry frame, m/s.
    pub v_o_b: Vector3<f64>,
    /// Gyroscope bias, rad/s.
    pub bias_gyro: Vector3<f64>,
    /// Accelerometer bias, m/s².
    pub bias_accel: Vector3<f64>,
    /// Diagonal of the covariance: position (m²), attitude (rad²), velocity (m²/s²).
    pub variances: SVector<f64, 9>,
    /// Variance of the attitude's error about the vertical of `O`, rad²: of the heading.
    pub heading_variance: f64,
    /// `t_imu - t_camera`, s.
    pub time_offset_s: f64,
    /// Its standard deviation, s.
    pub time_offset_sigma_s: f64,
    /// Pose of the left camera in the body, as refined online.
    pub pose_b_c0: Isometry3<f64>,
}

/// What the estimator said after one frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StateRow {
    /// Time of the state on the IMU's axis.
    pub stamp: Timestamp,
    /// Sequence number of the frame.
    pub frame_sequence: u64,
    /// How far the estimator was.
    pub tracking: TrackingState,
    /// -1 failed, else 0..=100.
    pub quality: i8,
    /// Errors and warnings.
    pub health: HealthBits,
    /// Resets so far.
    pub reset_counter: u32,
    /// The state; `None` while there is no pose.
    pub nav: Option<RowState>,
    /// Work and outcome of the frame.
    pub figures: FrameFigures,
}

impl StateRow {
    /// The row of an estimate.
    #[must_use]
    pub fn of(e: &Estimate) -> Self {
        let up_b = e.pose_o_b.rotation.inverse() * Vector3::z();
        let attitude = e.covariance.fixed_view::<3, 3>(3, 3);
        let nav = || RowState {
            heading_variance: (up_b.transpose() * attitude * up_b)[0],
            pose_o_b: e.pose_o_b,
            v_o_b: e.v_o_b,
            bias_gyro: e.bias_gyro,
            bias_accel: e.bias_accel,
            variances: e.covariance.diagonal(),
            time_offset_s: e.time_offset_s,
            time_offset_sigma_s: e.time_offset_sigma_s,
            pose_b_c0: e.pose_b_c0,
        };
        Self {
            stamp: e.stamp,
            frame_sequence: e.frame_sequence,
            tracking: e.state,
            quality: e.quality,
            health: e.health,
            reset_counter: e.reset_counter,
            nav: e.has_pose().then(nav),
            figures: e.figures,
        }
    }
}

impl Default for StateRow {
    /// A frame of which nothing is known: what room is made with.
    fn default() -> Self {
        Self {
            stamp: Timestamp::default(),
            frame_sequence: 0,
            tracking: TrackingState::Initialising,
            quality: 0,
            health: HealthBits::default(),
            reset_counter: 0,
            nav: None,
            figures: FrameFigures::default(),
        }
    }
}

/// Writes the rows to `path` as CSV, replacing a file of that name. Numbers come back from it bit for bit.
///
/// # Errors
/// When the file cannot be written.
pub fn write_states<'a>(path: &Path, rows: impl IntoIterator<Item = &'a StateRow>) -> std::io::Result<()> {
    let mut out = BufWriter::new(std::fs::File::create(path)?);
    writeln!(out, "{}", columns::header())?;
    let mut line = String::new();
    for row in rows {
        line.clear();
        columns::write_row(&mut line, row);
        writeln!(out, "{line}")?;
    }
    out.flush()
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::UnitQuaternion;
    use proptest::prelude::*;

    /// A row whose numbers are all different.
    fn row(seed: f64) -> StateRow {
        let vector = |k: f64| Vector3::new(seed + k, seed * 1e-7 - k, (seed + k).sin());
        let pose = |k: f64| {
            Isometry3::from_parts(vector(k).into(), UnitQuaternion::from_scaled_axis(vector(k) * 0.01))
        };
        StateRow {
            stamp: Timestamp::from_nanos(1_403_638_538_577_829_376 + (seed * 1e6) as i64),
            frame_sequence: 7,
            tracking: TrackingState::Tracking,
            quality: 99,
            health: HealthBits(0b1010),
            reset_counter: 2,
            nav: Some(RowState {
                pose_o_b: pose(1.0),
                v_o_b: vector(2.0),
                bias_gyro: vector(3.0) * 1e-3,
                bias_accel: vector(4.0) * 1e-2,
                variances: SVector::from_fn(|i, _| (i as f64 + 1.0) * 1e-4),
                heading_variance: 4.5e-4,
                time_offset_s: -0.0025,
                time_offset_sigma_s: 1e-4,
                pose_b_c0: pose(5.0),
            }),
            figures: FrameFigures { points_tracked: 150, is_keyframe: true, ..FrameFigures::default() },
        }
    }

    fn there_and_back(rows: &[StateRow]) -> Vec<StateRow> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("states.csv");
        write_states(&path, rows).unwrap();
        read_states(&path).unwrap()
    }

    proptest! {
        #[test]
        fn rows_come_back_bit_for_bit(seed in -1e3..1e3_f64) {
            let blind = StateRow { tracking: TrackingState::Blind, ..row(seed + 1.0) };
            let none = StateRow { nav: None, tracking: TrackingState::Failed, quality: -1, ..row(seed + 2.0) };
            let rows = [row(seed), blind, none];
            prop_assert_eq!(there_and_back(&rows), rows);
        }
    }

    #[test]
    fn every_column_has_a_name_of_its_own() {
        let mut line = String::new();
        columns::write_row(&mut line, &row(1.0));
        let header = columns::header();
        let names: std::collections::BTreeSet<&str> = header.split(',').collect();
        assert_eq!(names.len(), header.split(',').count());
        assert_eq!(line.split(',').count(), names.len());
        for name in
            ["stamp_ns", "p_o_b_z_m", "q_o_b_w", "bias_accel_y_m_s2", "var_theta_z_rad2", "p_b_c0_x_m"]
        {
            assert!(names.contains(name), "{name} is missing in {header}");
        }
    }

    #[test]
    fn what_is_no_such_table_is_refused_with_its_line() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("states.csv");
        write_states(&path, &[row(1.0), row(2.0)]).unwrap();
        let good = std::fs::read_to_string(&path).unwrap();
        let refused = |text: &str| {
            std::fs::write(&path, text).unwrap();
            read_states(&path).unwrap_err().to_string()
        };
        for (from, to, says) in [
            ("stamp_ns", "stamp", "line 1: column 1 is `stamp`, expected `stamp_ns`"),
            ("tracking,99", "walking,99", "line 2: column 3 (tracking): `walking`"),
            ("tracking,99", "tracking,990", "line 2: column 4 (quality): `990`"),
            (",99,10,2,", ",99,10,2,,", "line 2: 55 cells, expected 54"),
        ] {
            let message = refused(&good.replacen(from, to, 1));
            assert!(message.contains(says) && message.contains("states.csv"), "{to}: {message}");
        }
        let half = good.lines().take(2).map(|l| l.to_owned() + "\n").collect::<String>();
        let torn = refused(&(half.clone() + "17,3,tracking"));
        assert!(torn.contains("line 3: 3 cells"), "{torn}");
        let backwards = refused(&(half.clone() + half.lines().nth(1).unwrap()));
        assert!(backwards.contains("line 3: its stamp is not later than the one before"), "{backwards}");
        assert!(refused("").contains("line 1: "));
        assert!(refused(good.lines().next().unwrap()).contains("no row"));
        let nan = refused(&good.replacen("-0.0025", "NaN", 1));
        assert!(nan.contains("`NaN` is not a finite number"), "{nan}");
    }
}
