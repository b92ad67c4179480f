//! A flight over a level floor: rest, climb, way, and from some time on without odometry.

use nalgebra::{UnitQuaternion, Vector3};
use std::f64::consts::PI;

/// End of the rest on the ground, of the odometry, and of the flight, s.
pub const REST_S: f64 = 20.0;
pub const LOST_S: f64 = 50.0;
pub const END_S: f64 = 60.0;

/// Height of the camera on the ground, and of the flight, m.
const GROUND_M: f64 = 0.25;
const HEIGHT_M: f64 = 2.0;
/// Duration of the climb, which reaches 1.1 m/s, s.
const CLIMB_S: f64 = 2.5;
/// The way begins this long after the rest, and reaches its speed within as long, s.
const WAY_S: f64 = 4.0;
/// Angular frequency of the changes of height, rad/s.
const SWING_RAD_S: f64 = 0.7;

/// Motion of the vehicle in flight, beside some sway and roll.
#[derive(Clone, Copy, Debug)]
pub struct Motion {
    /// Speed to the north.
    pub speed_m_s: f64,
    /// Amplitude of the height.
    pub swing_m: f64,
}

/// State of the vehicle.
pub struct Truth {
    pub p: Vector3<f64>,
    pub v: Vector3<f64>,
    pub a: Vector3<f64>,
    pub rot_l_f: UnitQuaternion<f64>,
    pub rate_f: Vector3<f64>,
}

impl Motion {
    /// State at `t`, s.
    pub fn at(&self, t: f64) -> Truth {
        let h = 1e-3;
        let [before, now, after] = [t - h, t, t + h].map(|t| self.position(t));
        Truth {
            p: now,
            v: (after - before) / (2.0 * h),
            a: (after - 2.0 * now + before) / (h * h),
            rot_l_f: UnitQuaternion::from_axis_angle(&Vector3::x_axis(), roll(t)),
            rate_f: Vector3::x() * ((roll(t + h) - roll(t - h)) / (2.0 * h)),
        }
    }

    fn position(&self, t: f64) -> Vector3<f64> {
        let s = t - REST_S;
        let on_way_s = (s - WAY_S).max(0.0);
        // Speed rises as half a cosine.
        let way_s = if on_way_s < WAY_S {
            0.5 * on_way_s - WAY_S / (2.0 * PI) * (PI * on_way_s / WAY_S).sin()
        } else {
            on_way_s - 0.5 * WAY_S
        };
        let height_m = GROUND_M
            + (HEIGHT_M - GROUND_M) * risen(s, CLIMB_S)
            + self.swing_m * risen(on_way_s, WAY_S) * (SWING_RAD_S * on_way_s).sin();
        let sway_m = 0.15 * risen(on_way_s, WAY_S) * (0.8 * on_way_s).sin();
        Vector3::new(self.speed_m_s * way_s, sway_m, -height_m)
    }
}

fn roll(t: f64) -> f64 {
    let s = t - REST_S - WAY_S;
    0.08 * risen(s, WAY_S) * (1.3 * s).sin()
}

/// Rise from 0 to 1 within `duration_s`, without a step of the rate.
fn risen(s: f64, duration_s: f64) -> f64 {
    0.5 - 0.5 * (PI * (s / duration_s).clamp(0.0, 1.0)).cos()
}
