//! States at instants as rows of a table (CSV). The names of the columns are those of the table of estimates.

use super::{AXES, off_diagonal};
use crate::orders::{InstantAnswer, InstantOutcome};
use std::fmt::Write as _;
use std::io;
use std::path::Path;

/// Columns before the covariances.
const FIRST: &str = "stamp_ns,outcome,tracking,quality,reset_counter,estimated_ns,settled,p_o_b_x_m,p_o_b_y_m,p_o_b_z_m,q_o_b_x,\
                     q_o_b_y,q_o_b_z,q_o_b_w,v_o_b_x_m_s,v_o_b_y_m_s,v_o_b_z_m_s,w_b_x_rad_s,w_b_y_rad_s,w_b_z_rad_s";

/// Names of all columns, in order.
fn names() -> Vec<String> {
    let first = FIRST.split(',').map(str::to_owned);
    let variances = super::names().into_iter().filter(|name| name.starts_with("var_")).take(AXES.len());
    first.chain(variances).chain(super::covariance_names()).collect()
}

/// Writes answers to `path` as a table, replacing a file of that name.
///
/// # Errors
/// When the file cannot be written.
pub fn write(path: &Path, rows: &[InstantAnswer]) -> io::Result<()> {
    super::write(path, &names(), rows, write_row)
}

/// Appends the cells of a row, without a line end; those of a state that there is not are empty. Numbers come back from
/// them bit for bit.
fn write_row(line: &mut String, answer: &InstantAnswer) {
    let at = &answer.instant;
    let outcome = match answer.outcome {
        InstantOutcome::Answered => "answered",
        InstantOutcome::NoPose => "no_pose",
        InstantOutcome::TooOld => "too_old",
        InstantOutcome::Ahead => "ahead",
    };
    // Writing to a string cannot fail.
    let _ = write!(line, "{},{outcome}", at.stamp.as_nanos());
    if answer.outcome != InstantOutcome::Answered {
        line.extend(std::iter::repeat_n(',', names().len() - 2));
        return;
    }
    let state = format!("{:?}", at.state).to_lowercase();
    let (estimated, settled) = (at.estimated.as_nanos(), u8::from(at.is_settled));
    let _ = write!(line, ",{state},{},{},{estimated},{settled}", at.quality, at.reset_counter);
    let pose = at.pose_o_b.translation.vector.iter().chain(at.pose_o_b.rotation.coords.iter());
    let variances = at.covariance.diagonal();
    let motion = at.v_o_b.iter().chain(&at.angular_rate_b).chain(&variances);
    for number in pose.chain(motion).copied().chain(off_diagonal().map(|place| at.covariance[place])) {
        let _ = write!(line, ",{number:?}");
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use plumbline_estimator::Instant;

    #[test]
    fn every_row_has_a_cell_for_every_column() {
        for outcome in [InstantOutcome::Answered, InstantOutcome::NoPose] {
            let instant = Instant { quality: -1, ..Instant::default() };
            let mut line = String::new();
            write_row(&mut line, &InstantAnswer { outcome, instant, ..InstantAnswer::default() });
            assert_eq!(line.split(',').count(), names().len(), "{line}");
        }
        assert_eq!(names().len(), 20 + 9 + 36);
    }
}
