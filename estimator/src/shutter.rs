//! Rolling shutter: where a row would have seen a direction at the time of its frame.
//!
//! Row `v` of `h` rows is exposed `tau = T (v / (h - 1) - 1/2)` after the frame's stamp, with the readout time `T`; the stamp is
//! the middle of the exposure of the middle row. Between row and frame the body turns by `R(tau)`, which takes its coordinates
//! at the row's time to those at the frame's, and a direction `q` in the camera becomes `R_bc' R(tau) R_bc q`. The gyroscope
//! says what `R` is, to a hundredth of a pixel; the way of the camera meanwhile depends on depth and velocity, and is left to
//! the window ([`crate::window::reprojection`]).

use crate::geometry::{exp_so3, log_so3};
use nalgebra::{UnitQuaternion, Vector2, Vector3};
use plumbline_config::options::CameraConfig;
use plumbline_config::{Portable, ValidSetup};

/// Places of a readout at which the attitude is known; between them the rotation vector is interpolated.
const KNOTS: usize = 5;

/// Readout of a camera.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Readout {
    /// Time from the first row to the last, s; 0 for a global shutter.
    pub readout_s: f64,
    /// Rows after the first.
    rows: f64,
}

impl Readout {
    /// Readout of a configured camera.
    pub fn of(camera: &CameraConfig) -> Self {
        Self { readout_s: camera.readout_s, rows: (camera.height_px as f64 - 1.0).at_least(1.0) }
    }

    /// True if all rows are exposed at once.
    pub fn is_global(&self) -> bool {
        self.readout_s == 0.0
    }

    /// Time by which the last row is later than the frame, s.
    pub fn after_s(&self) -> f64 {
        0.5 * self.readout_s
    }

    /// Time by which row `v` (which may lie between two) is later than the frame, s.
    pub fn late_s(&self, v: f64) -> f64 {
        self.readout_s * (v / self.rows.at_least(1.0) - 0.5)
    }
}

/// Readouts of left and right camera; global for a camera that is not there.
pub fn readouts(setup: &ValidSetup) -> [Readout; 2] {
    [0, 1].map(|k| setup.camera.get(k).map_or_else(Readout::default, Readout::of))
}

/// Turns of a camera between the rows of one frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RowTurns {
    readout: Readout,
    /// Rotation vectors in the camera that take directions at the time of a row to the time of the frame, rad.
    knots: [Vector3<f64>; KNOTS],
}

impl RowTurns {
    /// Turns of a camera mounted with `rot_b_c`; `turn_b` gives the rotation that takes coordinates of the body, that many
    /// seconds after the frame, to those at the frame.
    pub fn new(
        readout: Readout,
        rot_b_c: &UnitQuaternion<f64>,
        turn_b: impl Fn(f64) -> UnitQuaternion<f64>,
    ) -> Self {
        if readout.is_global() {
            return Self { readout, ..Self::default() };
        }
        let knot = |k: usize| {
            let late_s = readout.readout_s * (k as f64 / (KNOTS - 1) as f64 - 0.5);
            rot_b_c.inverse() * log_so3(&turn_b(late_s))
        };
        Self { readout, knots: std::array::from_fn(knot) }
    }

    /// True if all rows are exposed at once.
    pub fn is_global(&self) -> bool {
        self.readout.is_global()
    }

    /// Rotation of row `v`.
    fn turn(&self, v: f64) -> UnitQuaternion<f64> {
        let at = (v / self.readout.rows * (KNOTS - 1) as f64).clamp(0.0, (KNOTS - 1) as f64);
        let k = (at as usize).min(KNOTS - 2);
        exp_so3(&(self.knots[k] + (self.knots[k + 1] - self.knots[k]) * (at - k as f64)))
    }

    /// Normalized coordinates at the time of the frame of what row `v` sees at `xy`; `None` behind the camera.
    pub fn at_frame(&self, xy: &Vector2<f64>, v: f64) -> Option<Vector2<f64>> {
        if self.is_global() {
            return Some(*xy);
        }
        let q = self.turn(v) * Vector3::new(xy.x, xy.y, 1.0);
        (q.z > 1e-3).then(|| q.xy() / q.z)
    }

    /// Direction at the time of row `v` of what is in direction `q` at the time of the frame.
    pub fn at_row(&self, q: &Vector3<f64>, v: f64) -> Vector3<f64> {
        self.turn(v).inverse() * q
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn readout() -> Readout {
        Readout { readout_s: 0.03, rows: 479.0 }
    }

    #[test]
    fn the_middle_row_is_that_of_the_stamp() {
        let readout = readout();
        assert_eq!((readout.late_s(239.5), readout.after_s()), (0.0, 0.015));
        assert!((readout.late_s(479.0) - 0.015).abs() < 1e-12 && (readout.late_s(0.0) + 0.015).abs() < 1e-12);
        assert!(Readout::default().is_global() && Readout::default().late_s(100.0) == 0.0);
    }

    #[test]
    fn rows_are_turned_as_the_camera_turns() {
        // A turn that speeds up: 2 rad/s and 15 rad/s².
        let rot_b_c = exp_so3(&Vector3::new(0.4, -1.2, 0.3));
        let axis = Vector3::new(0.6, 0.64, -0.48);
        let turn = |t: f64| exp_so3(&(axis * (2.0 * t + 7.5 * t * t)));
        let rows = RowTurns::new(readout(), &rot_b_c, turn);
        for v in [0.0, 37.0, 200.5, 239.5, 333.0, 479.0] {
            let xy = Vector2::new(0.3, -0.2);
            let q = Vector3::new(xy.x, xy.y, 1.0);
            let exact = rot_b_c.inverse() * (turn(readout().late_s(v)) * (rot_b_c * q));
            let at_frame = rows.at_frame(&xy, v).expect("is in front");
            // A twentieth of a pixel at 458 px.
            assert!((at_frame - exact.xy() / exact.z).norm() < 1.1e-4, "row {v}");
            let back = rows.at_row(&exact, v);
            assert!((back.xy() / back.z - xy).norm() < 1.1e-4, "row {v}");
        }
    }

    #[test]
    fn a_global_shutter_changes_no_bit() {
        let rows = RowTurns::new(Readout::default(), &UnitQuaternion::identity(), |_| exp_so3(&Vector3::x()));
        let xy = Vector2::new(0.123, -0.456);
        assert!(rows.is_global());
        assert_eq!(rows.at_frame(&xy, 17.0), Some(xy));
    }
}
