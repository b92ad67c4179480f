//! Optical flow and distance of the ground, from the tracked points of a camera that looks down.
//!
//! The points are brought to a camera that looks exactly along the vehicle's down axis (x forward, y right, z down: `F`, the axes of
//! BODY_FRD), so that autopilots need no mounting. Signs are MAVLink's: a right-hand turn of the sensor about an axis gives a positive
//! flow about it, and flow less the gyroscope's integral is what translation adds: forward +y, to the right -x, each v/h.

use nalgebra::{Isometry3, Matrix3, UnitQuaternion, Vector2, Vector3};
use plumbline_config::options::VehicleConfig;
use plumbline_config::{ImuSample, Timestamp, ValidSetup};
use plumbline_estimator::points::PointObservation;

/// Frames further apart are not compared, s: autopilots refuse longer integrals.
const MAX_SPAN_S: f64 = 0.2;
/// Share of the span that inertial samples must cover.
const MIN_COVERED: f64 = 0.8;
/// Fewer points give no flow, and no distance.
const MIN_POINTS: usize = 8;
/// Number of agreeing points from which the quality is full.
const FULL_POINTS: f64 = 40.0;
/// Tangent of the largest angle from the down axis at which points are used.
const MAX_TAN: f64 = 1.2;
/// A point agrees whose flow differs by less than this share of the flow, and of a small angle, rad.
const AGREEING_SHARE: f64 = 0.3;
const AGREEING_RAD: f64 = 0.003;
/// Iterations of the least absolute residuals.
const ITERATIONS: usize = 6;
/// Residuals below this weigh alike, rad.
const SMALL_RAD: f64 = 1e-4;
/// Distances that the stereo pair can measure, in baselines: beyond, a pixel is a fifth of it.
const BASELINES: [f64; 2] = [2.0, 100.0];
/// Inertial samples that are kept.
const SAMPLES: usize = 2048;

/// Motion of the ground between two frames, in `F`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FlowMeasurement {
    /// Stamp of the later frame.
    pub stamp: Timestamp,
    /// Time between the frames, s.
    pub span_s: f64,
    /// Flow about x and y, rad.
    pub flow_rad: Vector2<f64>,
    /// Integral of the angular rate, rad.
    pub gyro_rad: Vector3<f64>,
    /// From 0, no flow, to 255.
    pub quality: u8,
    /// Distance of the ground along the down axis.
    pub distance: Option<GroundDistance>,
}

/// Distance of the ground along the down axis, and the limits of its measurement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GroundDistance {
    /// Distance, m.
    pub m: f64,
    /// Smallest and largest distance that can be measured, m.
    pub limits_m: [f64; 2],
}

/// Flow of one point.
#[derive(Clone, Copy, Debug)]
struct Shift {
    at: Vector2<f64>,
    by: Vector2<f64>,
}

/// Compares the points of each frame with those of the frame before. Allocates when it is made.
#[derive(Clone, Debug)]
pub struct FlowMeter {
    rot_f_b: UnitQuaternion<f64>,
    rot_f_c: UnitQuaternion<f64>,
    pose_c0_c1: Option<Isometry3<f64>>,
    last: Option<Timestamp>,
    /// Track ids and directions in the left camera, in order of the ids.
    previous: Vec<(u32, Vector2<f64>)>,
    shifts: Vec<Shift>,
    sorted: Vec<f64>,
    samples: Vec<ImuSample>,
}

impl FlowMeter {
    /// A meter for the left camera of the rig; `None` where the mounting of the IMU is unknown.
    pub fn new(setup: &ValidSetup, mounting: &VehicleConfig) -> Option<Self> {
        let rot_f_b = super::frames::half_turn_about_x() * mounting.rot_v_b()?;
        let left = setup.camera.first()?.pose_b_c();
        let right = setup.camera.get(1).map(|camera| camera.pose_b_c());
        let pose_c0_c1 = right.map(|right| left.inverse() * right);
        Some(Self::of_rig(rot_f_b, left.rotation, pose_c0_c1, setup.estimator.points.max_points))
    }

    fn of_rig(
        rot_f_b: UnitQuaternion<f64>,
        rot_b_c: UnitQuaternion<f64>,
        pose_c0_c1: Option<Isometry3<f64>>,
        max_points: usize,
    ) -> Self {
        Self {
            rot_f_b,
            rot_f_c: rot_f_b * rot_b_c,
            pose_c0_c1,
            last: None,
            previous: Vec::with_capacity(max_points),
            shifts: Vec::with_capacity(max_points),
            sorted: Vec::with_capacity(max_points),
            samples: Vec::with_capacity(SAMPLES),
        }
    }

    /// Forgets frames and samples: the clock was set.
    pub fn clear(&mut self) {
        self.last = None;
        self.previous.clear();
        self.samples.clear();
    }

    /// Flow from the frame before to that of `stamp`, whose `points` are in order of track id; `samples` are those that came between.
    pub fn measure(
        &mut self,
        stamp: Timestamp,
        points: &[PointObservation],
        samples: &[ImuSample],
        bias_gyro: &Vector3<f64>,
    ) -> Option<FlowMeasurement> {
        for sample in samples {
            if self.samples.len() == self.samples.capacity() {
                self.samples.drain(..SAMPLES / 2);
            }
            self.samples.push(*sample);
        }
        let measured = self.last.and_then(|last| {
            let span_s = stamp.seconds_since(last);
            let is_near = span_s > 0.0 && span_s <= MAX_SPAN_S;
            let turn_b = if is_near { self.turn(last, stamp)? - bias_gyro * span_s } else { return None };
            Some(self.compare(stamp, span_s, self.rot_f_b * turn_b, points))
        });
        self.remember(stamp, points);
        measured
    }

    fn compare(
        &mut self,
        stamp: Timestamp,
        span_s: f64,
        gyro_rad: Vector3<f64>,
        points: &[PointObservation],
    ) -> FlowMeasurement {
        self.find_shifts(&gyro_rad, points);
        let (by, agreeing) = match self.shifts.len() {
            0..MIN_POINTS => (Vector2::zeros(), 0),
            _ => self.shift_of_ground(),
        };
        let share = agreeing as f64 / self.shifts.len().max(1) as f64;
        let quality =
            if agreeing < MIN_POINTS { 0.0 } else { share * (agreeing as f64 / FULL_POINTS).min(1.0) };
        // A point that moves to the right in the sensor, +y, turns about +x; one that moves forward, +x, about -y.
        let flow_rad = gyro_rad.xy() + Vector2::new(by.y, -by.x);
        let quality = (quality * 255.0).round() as u8;
        FlowMeasurement { stamp, span_s, flow_rad, gyro_rad, quality, distance: self.distance(points) }
    }

    /// Flow of each point that is left when the turn of the sensor is taken away.
    fn find_shifts(&mut self, turn_f: &Vector3<f64>, points: &[PointObservation]) {
        self.shifts.clear();
        let rot_now_then = UnitQuaternion::from_scaled_axis(-turn_f);
        for point in points {
            let Ok(k) = self.previous.binary_search_by_key(&point.track_id, |(id, _)| *id) else { continue };
            let Some(now) = point.xy[0] else { continue };
            let (then_f, now_f) = (self.ray_f(&self.previous[k].1), self.ray_f(&now));
            if let (Some(from), Some(to)) = (on_plane(&(rot_now_then * then_f)), on_plane(&now_f))
                && self.shifts.len() < self.shifts.capacity()
            {
                self.shifts.push(Shift { at: (from + to) * 0.5, by: to - from });
            }
        }
    }

    /// Flow on the down axis, and how many points agree with it: least absolute residuals of a shift and an expansion, which is
    /// that of climb and descent, so that points on one side of the axis alone are no error.
    fn shift_of_ground(&mut self) -> (Vector2<f64>, usize) {
        let start = Vector2::new(self.median(|shift| shift.by.x), self.median(|shift| shift.by.y));
        let mut fit = Vector3::new(start.x, start.y, 0.0);
        let residual = |fit: &Vector3<f64>, shift: &Shift| shift.by - fit.xy() - shift.at * fit.z;
        for _ in 0..ITERATIONS {
            let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
            for shift in &self.shifts {
                let weight = 1.0 / residual(&fit, shift).norm().max(SMALL_RAD);
                for axis in 0..2 {
                    let row = Vector3::new(f64::from(axis == 0), f64::from(axis == 1), shift.at[axis]);
                    normal += row * row.transpose() * weight;
                    right += row * (shift.by[axis] * weight);
                }
            }
            let Some(root) = normal.cholesky() else { break };
            fit = root.solve(&right);
        }
        if !fit.iter().all(|x| x.is_finite()) {
            return (Vector2::zeros(), 0);
        }
        let limit = AGREEING_RAD + AGREEING_SHARE * fit.xy().norm();
        let agreeing = self.shifts.iter().filter(|shift| residual(&fit, shift).norm() < limit).count();
        (fit.xy(), agreeing)
    }

    fn median(&mut self, value: impl Fn(&Shift) -> f64) -> f64 {
        self.sorted.clear();
        self.sorted.extend(self.shifts.iter().map(value));
        median(&mut self.sorted)
    }

    /// Median distance along the down axis of the points that both cameras see, within what the pair can measure.
    fn distance(&mut self, points: &[PointObservation]) -> Option<GroundDistance> {
        let pose_c0_c1 = self.pose_c0_c1?;
        let baseline = pose_c0_c1.translation.vector;
        self.sorted.clear();
        for point in points {
            let (Some(left), Some(right)) = (point.xy[0], point.xy[1]) else { continue };
            let left_c = left.push(1.0);
            let right_c = pose_c0_c1.rotation * right.push(1.0);
            let (across, of_baseline) = (right_c.cross(&left_c), right_c.cross(&baseline));
            let left_f = self.rot_f_c * left_c;
            // Inverse distances: symmetric errors, and far points are many small ones.
            let inverse = across.norm_squared() / (across.dot(&of_baseline) * left_f.z);
            if on_plane(&left_f).is_some()
                && inverse.is_finite()
                && self.sorted.len() < self.sorted.capacity()
            {
                self.sorted.push(inverse);
            }
        }
        if self.sorted.len() < MIN_POINTS {
            return None;
        }
        let m = 1.0 / median(&mut self.sorted);
        let limits_m = BASELINES.map(|baselines| baselines * baseline.norm());
        (limits_m[0]..=limits_m[1]).contains(&m).then_some(GroundDistance { m, limits_m })
    }

    fn ray_f(&self, xy: &Vector2<f64>) -> Vector3<f64> {
        self.rot_f_c * xy.push(1.0)
    }

    /// Integral of the angular rate of the body as it was measured, rad; `None` where too much is missing.
    fn turn(&self, from: Timestamp, to: Timestamp) -> Option<Vector3<f64>> {
        let span_s = to.seconds_since(from);
        let (mut turn, mut covered_s) = (Vector3::zeros(), 0.0);
        for pair in self.samples.windows(2) {
            let length_s = pair[1].stamp.seconds_since(pair[0].stamp);
            let begin = from.seconds_since(pair[0].stamp).max(0.0);
            let end = to.seconds_since(pair[0].stamp).min(length_s);
            if end <= begin || length_s <= 0.0 {
                continue;
            }
            let middle = 0.5 * (begin + end) / length_s;
            turn += pair[0].gyro.lerp(&pair[1].gyro, middle) * (end - begin);
            covered_s += end - begin;
        }
        let is_known = covered_s >= MIN_COVERED * span_s && turn.iter().all(|x| x.is_finite());
        is_known.then(|| turn * (span_s / covered_s))
    }

    fn remember(&mut self, stamp: Timestamp, points: &[PointObservation]) {
        self.last = Some(stamp);
        self.previous.clear();
        let seen = points.iter().filter_map(|point| Some((point.track_id, point.xy[0]?)));
        self.previous.extend(seen.take(self.previous.capacity()));
        let later = self.samples.iter().position(|sample| sample.stamp > stamp);
        let needless = later.unwrap_or(self.samples.len()).saturating_sub(1);
        self.samples.drain(..needless);
    }
}

/// Place of a direction on the plane at distance 1 along the down axis, if it is near that axis.
fn on_plane(ray_f: &Vector3<f64>) -> Option<Vector2<f64>> {
    let place = (ray_f.z > 0.0).then(|| ray_f.xy() / ray_f.z)?;
    (place.norm() < MAX_TAN).then_some(place)
}

/// Median of values, at least one.
fn median(values: &mut [f64]) -> f64 {
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix2, Translation3};

    const SPAN_S: f64 = 0.05;
    const HEIGHT_M: f64 = 2.0;

    /// A stereo pair that looks down, its images' upper edge to the left, tilted by some degrees, on an IMU of its own axes.
    struct Rig {
        meter: FlowMeter,
        rot_f_b: UnitQuaternion<f64>,
        pose_f_c0: Isometry3<f64>,
        pose_c0_c1: Isometry3<f64>,
    }

    impl Rig {
        fn tilted(degrees: f64) -> Self {
            let rot_f_b = UnitQuaternion::from_euler_angles(0.4, -1.1, 2.0);
            let rot_f_c = UnitQuaternion::from_euler_angles(0.0, degrees.to_radians(), 0.0)
                * UnitQuaternion::from_euler_angles(0.0, 0.0, -0.7);
            let pose_c0_c1 = Isometry3::from_parts(
                Translation3::new(0.11, 0.001, -0.002),
                UnitQuaternion::from_euler_angles(0.01, -0.02, 0.015),
            );
            let rot_b_c = rot_f_b.inverse() * rot_f_c;
            let meter = FlowMeter::of_rig(rot_f_b, rot_b_c, Some(pose_c0_c1), 200);
            let pose_f_c0 = Isometry3::from_parts(Translation3::identity(), rot_f_c);
            Self { meter, rot_f_b, pose_f_c0, pose_c0_c1 }
        }

        /// Points on the floor, one in seven of them of a thing that moves, seen from a pose of the vehicle over it.
        fn seen(&self, pose_w_f: &Isometry3<f64>, moved: f64) -> Vec<PointObservation> {
            let places =
                (0..144).map(|k| Vector2::new(f64::from(k % 12) - 5.5, f64::from(k / 12) - 5.5) * 0.31);
            let points = places.enumerate().filter_map(|(k, xy)| {
                let own = if k % 7 == 3 { moved } else { 0.0 };
                let p_w = nalgebra::Point3::new(xy.x + own, xy.y, HEIGHT_M);
                let p_c0 = self.pose_f_c0.inverse() * (pose_w_f.inverse() * p_w);
                let p_c1 = self.pose_c0_c1.inverse() * p_c0;
                let xy = [p_c0, p_c1].map(|p| Vector2::new(p.x / p.z, p.y / p.z));
                (p_c0.z > 0.1 && p_c1.z > 0.1 && xy[0].norm() < 0.9).then_some(PointObservation {
                    track_id: 10 + k as u32,
                    age: 2,
                    px: [None; 2],
                    xy: xy.map(Some),
                    covariance_px2: [Matrix2::zeros(); 2],
                })
            });
            points.collect()
        }

        /// Two frames of a vehicle that moves and turns at these rates, in its own axes.
        fn flown(&mut self, v_f: [f64; 3], rate_f: [f64; 3], moved: f64) -> FlowMeasurement {
            let (v_f, rate_f) = (Vector3::from(v_f), Vector3::from(rate_f));
            let bias = Vector3::new(0.02, -0.03, 0.01);
            let gyro = self.rot_f_b.inverse() * rate_f + bias;
            let at = |s: f64| Timestamp::from_nanos((1e9 * (7.0 + s)) as i64);
            let samples: Vec<_> = (0..40)
                .map(|k| ImuSample { stamp: at(0.005 * f64::from(k) - 0.05), gyro, accel: Vector3::zeros() })
                .collect();
            let pose = |s: f64| {
                let rotation = UnitQuaternion::from_scaled_axis(rate_f * s);
                Isometry3::from_parts(Translation3::from(v_f * s), rotation)
            };
            let (before, after) = (self.seen(&pose(0.0), 0.0), self.seen(&pose(SPAN_S), moved));
            assert_eq!(self.meter.measure(at(0.0), &before, &samples[..20], &bias), None);
            self.meter.measure(at(SPAN_S), &after, &samples[20..], &bias).unwrap()
        }
    }

    #[test]
    fn under_pure_rotation_the_flow_is_the_integral_of_the_gyroscope() {
        for rate in [[0.8, 0.0, 0.0], [0.0, -1.1, 0.0], [0.0, 0.0, 2.0], [0.5, 0.7, -1.3]] {
            for tilt in [0.0, 30.0] {
                let flow = Rig::tilted(tilt).flown([0.0; 3], rate, 0.0);
                let turned = Vector3::from(rate) * SPAN_S;
                assert!((flow.gyro_rad - turned).norm() < 1e-9, "{flow:?}");
                assert!((flow.flow_rad - turned.xy()).norm() < 1e-4, "{flow:?} for {rate:?}");
                assert_eq!(flow.quality, 255);
            }
        }
    }

    #[test]
    fn a_turn_that_the_gyroscope_missed_is_still_in_the_flow() {
        let mut rig = Rig::tilted(0.0);
        let still = Isometry3::identity();
        let turned = Isometry3::from_parts(
            Translation3::identity(),
            UnitQuaternion::from_scaled_axis(Vector3::new(0.02, -0.01, 0.0)),
        );
        let at = |ms: i64| Timestamp::from_nanos(ms * 1_000_000);
        let samples: Vec<_> = (0..30)
            .map(|k| ImuSample { stamp: at(5 * k), gyro: Vector3::zeros(), accel: Vector3::zeros() })
            .collect();
        rig.meter.measure(at(50), &rig.seen(&still, 0.0), &samples, &Vector3::zeros());
        let flow = rig.meter.measure(at(100), &rig.seen(&turned, 0.0), &[], &Vector3::zeros()).unwrap();
        // The mean over the view, whose rim turns by more than its middle.
        assert!((flow.flow_rad - Vector2::new(0.02, -0.01)).norm() < 0.003, "{flow:?}");
    }

    #[test]
    fn translation_gives_velocity_over_height_with_mavlinks_signs() {
        let expected = |v: [f64; 3]| Vector2::new(-v[1], v[0]) * (SPAN_S / HEIGHT_M);
        for tilt in [0.0, 30.0] {
            for v in [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-0.4, 0.7, 0.0], [0.6, 0.0, -0.8], [0.0, 0.0, 1.0]] {
                for rate in [[0.0; 3], [0.3, -0.2, 0.9]] {
                    let flow = Rig::tilted(tilt).flown(v, rate, 0.0);
                    let moved = flow.flow_rad - flow.gyro_rad.xy();
                    let error = (moved - expected(v)).norm();
                    // Rotated by half of the turn, and nearer by half of the descent.
                    assert!(error < 0.002, "{moved:?} for {:?}, v {v:?}, rate {rate:?}", expected(v));
                }
            }
        }
        let forward = Rig::tilted(0.0).flown([1.0, 0.0, 0.0], [0.0; 3], 0.0).flow_rad;
        assert!(forward.y > 0.0249 && forward.x.abs() < 1e-6, "{forward:?}");
        let right = Rig::tilted(0.0).flown([0.0, 1.0, 0.0], [0.0; 3], 0.0).flow_rad;
        assert!(right.x < -0.0249 && right.y.abs() < 1e-6, "{right:?}");
    }

    #[test]
    fn a_seventh_of_moving_points_lowers_the_quality_and_keeps_the_flow() {
        let still = Rig::tilted(0.0).flown([1.0, 0.0, 0.0], [0.0; 3], 0.0);
        let moving = Rig::tilted(0.0).flown([1.0, 0.0, 0.0], [0.0; 3], 0.3);
        assert!((still.flow_rad - moving.flow_rad).norm() < 5e-4, "{moving:?}");
        assert!((200..240).contains(&moving.quality), "{moving:?}");
    }

    #[test]
    fn the_pair_tells_the_distance_of_the_floor() {
        let flow = Rig::tilted(0.0).flown([0.0; 3], [0.0; 3], 0.0);
        let distance = flow.distance.unwrap();
        assert!((distance.m - HEIGHT_M).abs() < 1e-6, "{distance:?}");
        assert!((distance.limits_m[0] - 0.22).abs() < 1e-3);
        let mut mono = Rig::tilted(0.0);
        mono.meter.pose_c0_c1 = None;
        assert_eq!(mono.flown([0.0; 3], [0.0; 3], 0.0).distance, None);
    }

    #[test]
    fn without_points_samples_or_a_frame_just_before_there_is_no_flow() {
        let mut rig = Rig::tilted(0.0);
        let at = |ms: i64| Timestamp::from_nanos(ms * 1_000_000);
        let points = rig.seen(&Isometry3::identity(), 0.0);
        let samples: Vec<_> = (0..200)
            .map(|k| ImuSample { stamp: at(5 * k), gyro: Vector3::zeros(), accel: Vector3::zeros() })
            .collect();
        let none = Vector3::zeros();
        assert_eq!(rig.meter.measure(at(50), &points, &samples, &none), None);
        assert_eq!(rig.meter.measure(at(100), &points[..5], &[], &none).unwrap().quality, 0);
        assert_eq!(rig.meter.measure(at(150), &points, &[], &none).unwrap().quality, 0);
        assert_eq!(rig.meter.measure(at(200), &points, &[], &none).unwrap().quality, 255);
        assert_eq!(rig.meter.measure(at(500), &points, &[], &none), None, "too long ago");
        assert_eq!(rig.meter.measure(at(500), &points, &[], &none), None, "the same time again");
        assert!(rig.meter.measure(at(550), &points, &[], &none).is_some());
        assert!(rig.meter.measure(at(980), &points, &[], &none).is_none());
        assert_eq!(rig.meter.measure(at(1100), &points, &[], &none), None, "the samples end before");
    }
}
