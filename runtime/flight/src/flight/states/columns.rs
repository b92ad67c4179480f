//! The columns of the table: their names, and how a row is written.

use super::{RowState, StateRow};
use nalgebra::{Isometry3, Vector3};
use plumbline_estimator::{FrameFigures, TrackingState};
use std::fmt::Write as _;

/// Columns of the frame itself, before the state.
pub(super) const FRAME: [&str; 6] =
    ["stamp_ns", "frame", "tracking", "quality", "health_bits", "reset_counter"];
/// Columns of the state, empty while there is none.
pub(super) const STATE: [&str; 35] = [
    "p_o_b_x_m",
    "p_o_b_y_m",
    "p_o_b_z_m",
    "q_o_b_x",
    "q_o_b_y",
    "q_o_b_z",
    "q_o_b_w",
    "v_o_b_x_m_s",
    "v_o_b_y_m_s",
    "v_o_b_z_m_s",
    "bias_gyro_x_rad_s",
    "bias_gyro_y_rad_s",
    "bias_gyro_z_rad_s",
    "bias_accel_x_m_s2",
    "bias_accel_y_m_s2",
    "bias_accel_z_m_s2",
    "var_p_x_m2",
    "var_p_y_m2",
    "var_p_z_m2",
    "var_theta_x_rad2",
    "var_theta_y_rad2",
    "var_theta_z_rad2",
    "var_v_x_m2_s2",
    "var_v_y_m2_s2",
    "var_v_z_m2_s2",
    "var_heading_rad2",
    "time_offset_s",
    "time_offset_sigma_s",
    "p_b_c0_x_m",
    "p_b_c0_y_m",
    "p_b_c0_z_m",
    "q_b_c0_x",
    "q_b_c0_y",
    "q_b_c0_z",
    "q_b_c0_w",
];
/// The states of the estimator and what they are called.
pub(super) const TRACKING: [(TrackingState, &str); 4] = [
    (TrackingState::Initialising, "initialising"),
    (TrackingState::Tracking, "tracking"),
    (TrackingState::Blind, "blind"),
    (TrackingState::Failed, "failed"),
];

/// All names in order.
pub(super) fn names() -> impl Iterator<Item = &'static str> {
    FRAME.into_iter().chain(STATE).chain(FrameFigures::NAMES)
}

/// The first line of a table.
pub(super) fn header() -> String {
    names().collect::<Vec<_>>().join(",")
}

/// Appends the cells of a row, without a line end.
pub(super) fn write_row(line: &mut String, row: &StateRow) {
    let StateRow { stamp, frame_sequence, tracking, quality, health, reset_counter, nav, figures } = row;
    let tracking = TRACKING.iter().find(|(state, _)| state == tracking).map_or("", |(_, name)| name);
    // Writing to a string cannot fail.
    let _ = write!(
        line,
        "{},{frame_sequence},{tracking},{quality},{},{reset_counter}",
        stamp.as_nanos(),
        health.0
    );
    match nav {
        Some(nav) => state_values(nav).iter().for_each(|value| _ = write!(line, ",{value}")),
        None => STATE.iter().for_each(|_| line.push(',')),
    }
    figures.values().iter().for_each(|value| _ = write!(line, ",{value}"));
}

/// The numbers of a state in the order of [`STATE`].
fn state_values(nav: &RowState) -> [f64; STATE.len()] {
    let RowState { pose_o_b, v_o_b, bias_gyro, bias_accel, variances, .. } = nav;
    let mut values = [0.0; STATE.len()];
    let all = pose_values(pose_o_b)
        .into_iter()
        .chain([v_o_b, bias_gyro, bias_accel].into_iter().flat_map(Vector3::iter).copied())
        .chain(variances.iter().copied())
        .chain([nav.heading_variance, nav.time_offset_s, nav.time_offset_sigma_s])
        .chain(pose_values(&nav.pose_b_c0));
    values.iter_mut().zip(all).for_each(|(value, number)| *value = number);
    values
}

fn pose_values(pose: &Isometry3<f64>) -> [f64; 7] {
    let (p, q) = (pose.translation.vector, pose.rotation.coords);
    [p.x, p.y, p.z, q.x, q.y, q.z, q.w]
}
