//! Numbers that are none, or beyond all bounds, in every input of the odometer: what it gives out is finite, or marked
//! as having no pose.

use super::synthetic::{World, config, stamp};
use super::*;
use crate::front_end::FrontEnd;
use crate::input::FrameInput;
use crate::lines::{ImageLine, LineObservation};
use crate::points::PointObservation;
use crate::work_budget::InTurn;
use nalgebra::Vector2;
use plumbline_config::{ImageView, ImuSample};
use proptest::prelude::*;

/// Values that no sensor has.
const VALUES: [f64; 8] =
    [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e300, -1e300, 1e160, f64::MAX, f64::MIN_POSITIVE];
const FRAMES: u32 = 50;

/// Writes a value to an input of a frame, one of several by `pick`.
type Spoil = fn(&mut Tracked, usize, f64);

const FIELDS: [Spoil; 8] = [
    |tracked, pick, x| {
        let point = pick % tracked.points.len().max(1);
        tracked.points.iter_mut().skip(point).take(1).for_each(|point| set_xy(point, pick, x));
    },
    |tracked, pick, x| tracked.points.iter_mut().for_each(|point| set_xy(point, pick, x)),
    |tracked, pick, x| {
        let point = pick % tracked.points.len().max(1);
        let px =
            tracked.points.iter_mut().skip(point).take(1).flat_map(|point| point.px.iter_mut().flatten());
        px.for_each(|px| px.x = x);
    },
    |tracked, pick, x| image_lines(tracked).for_each(|line| line.ends_xy[pick % 2].y = x),
    |tracked, _, x| image_lines(tracked).for_each(|line| line.px_per_unit = [x; 2]),
    |tracked, pick, x| tracked.samples.iter_mut().for_each(|s| s.gyro[pick % 3] = x),
    |tracked, pick, x| {
        let sample = pick % tracked.samples.len().max(1);
        tracked.samples.iter_mut().skip(sample).take(1).for_each(|s| s.accel[pick % 3] = x);
    },
    |tracked, _, x| tracked.time.time_offset_s = x,
];
/// The accelerometer among them.
const ACCEL: usize = 6;

fn set_xy(point: &mut PointObservation, pick: usize, x: f64) {
    point.xy.iter_mut().flatten().for_each(|xy| xy[pick % 2] = x);
}

fn image_lines(tracked: &mut Tracked) -> impl Iterator<Item = &mut ImageLine> {
    tracked.lines.iter_mut().flat_map(|l| l.lines.iter_mut().flatten())
}

/// One poison: a value in a field of the frames `from..from + frames`.
#[derive(Clone, Copy, Debug)]
struct Poison {
    field: usize,
    value: f64,
    from: u32,
    frames: u32,
    pick: usize,
}

impl Poison {
    fn spoil(&self, k: u32, tracked: &mut Tracked) {
        if (self.from..self.from + self.frames).contains(&k) {
            FIELDS[self.field](tracked, self.pick, self.value);
        }
    }
}

/// Edges across the room as both cameras see them at `t`, none behind.
fn lines(world: &World, t: f64) -> Vec<LineObservation> {
    let pose_o_b = world.pose_o_b(t);
    let mut seen = Vec::new();
    for (track_id, pair) in (0..).zip(world.points_o.chunks_exact(2).take(60)) {
        let [a, b] = [pair[0], pair[0] + (pair[1] - pair[0]).normalize()];
        let lines = [0, 1].map(|camera| {
            let pose_c_o = (pose_o_b * world.pose_b_c.get(camera)?).inverse();
            let see = |p: &Vector3<f64>| {
                let q = pose_c_o * nalgebra::Point3::from(*p);
                (q.z > 0.5 && q.x.abs() < q.z).then(|| Vector2::new(q.x / q.z, q.y / q.z))
            };
            Some(ImageLine::between([see(&a)?, see(&b)?], [450.0; 2]))
        });
        if lines[0].is_some() {
            seen.push(LineObservation { track_id, segments: [None; 2], lines });
        }
    }
    seen
}

fn is_finite(estimate: &Estimate) -> bool {
    let (pose, mount) = (&estimate.pose_o_b, &estimate.pose_b_c0);
    [&pose.translation.vector, &estimate.v_o_b, &estimate.bias_gyro, &estimate.bias_accel]
        .into_iter()
        .flatten()
        .chain(pose.rotation.coords.iter())
        .chain(&mount.translation.vector)
        .chain(mount.rotation.coords.iter())
        .chain(&estimate.covariance)
        .chain([&estimate.time_offset_s, &estimate.time_offset_sigma_s])
        .all(|x| x.is_finite())
}

fn is_finite_feedback(feedback: &Feedback) -> bool {
    let poses = feedback.pose_b_c.iter();
    let coordinates = poses.flat_map(|p| p.translation.vector.iter().chain(p.rotation.coords.iter()));
    coordinates.chain(&feedback.bias_gyro).chain([&feedback.time_offset_s]).all(|x| x.is_finite())
}

/// A flight of which every frame passes through `spoil`; the estimates, all of them checked.
fn fly(
    setup: &plumbline_config::ValidSetup,
    spoil: impl Fn(u32, &mut Tracked),
) -> Result<Vec<Estimate>, TestCaseError> {
    let mut world = World::new(setup, 7, 300);
    let mut odometer = Odometer::new(setup);
    let (mut tracked, mut feedback) = (Tracked::new(setup), Feedback::new(setup));
    let mut estimates = Vec::new();
    for k in 0..FRAMES {
        let t = 0.2 + f64::from(k) * 0.05;
        tracked.samples.clear();
        tracked.samples.extend(world.samples_to(t));
        tracked.points = world.observe(t, [true; 2]);
        tracked.lines = lines(&world, t);
        tracked.sequence = u64::from(k);
        tracked.time = FrameTime { stamp: stamp(t), time_offset_s: 0.0 };
        spoil(k, &mut tracked);
        let estimate = odometer.process(&tracked, &mut (), &mut feedback);
        prop_assert!(is_finite(&estimate) || !estimate.has_pose(), "frame {k}: {estimate:?}");
        prop_assert!(is_finite_feedback(&feedback), "frame {k}: {feedback:?}");
        estimates.push(estimate);
    }
    Ok(estimates)
}

fn poisons() -> impl Strategy<Value = Poison> {
    (0..FIELDS.len(), prop::sample::select(&VALUES[..]), 0u32..40, 1u32..4, 0usize..1000)
        .prop_map(|(field, value, from, frames, pick)| Poison { field, value, from, frames, pick })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, ..ProptestConfig::default() })]

    #[test]
    fn no_poison_leaves_the_odometer(poison in poisons(), mono in any::<bool>()) {
        let setup = config(if mono { 1 } else { 2 });
        let _ = fly(&setup, |k, tracked| poison.spoil(k, tracked))?;
    }

    #[test]
    fn stamps_anywhere_in_time_give_finite_estimates(at in 5u32..40, nanos in any::<i64>(), of_samples in any::<bool>()) {
        let far = Timestamp::from_nanos(nanos);
        let _ = fly(&config(2), |k, tracked| {
            if k == at {
                if of_samples {
                    tracked.samples.iter_mut().for_each(|s| s.stamp = far);
                } else {
                    tracked.time.stamp = far;
                }
            }
        })?;
    }
}

#[test]
fn every_field_poisoned_in_a_running_flight_is_survived() {
    for field in 0..FIELDS.len() {
        for value in [f64::NAN, f64::INFINITY] {
            let poison = Poison { field, value, from: 20, frames: 1, pick: 4 };
            let estimates = fly(&config(2), |k, tracked| poison.spoil(k, tracked)).expect("finite");
            assert!(estimates[19].has_pose(), "{poison:?}");
            assert!(estimates[FRAMES as usize - 1].has_pose(), "{poison:?}: never recovers");
        }
    }
}

#[test]
fn a_force_beyond_all_bounds_costs_a_reset_at_most_and_no_more() {
    let poison = Poison { field: ACCEL, value: 1e300, from: 20, frames: 1, pick: 4 };
    let estimates = fly(&config(2), |k, tracked| poison.spoil(k, tracked)).expect("finite");
    assert!(estimates[19].has_pose());
    let last = &estimates[FRAMES as usize - 1];
    assert!(last.has_pose() && last.reset_counter <= 1, "{last:?}");
    assert!(last.pose_o_b.translation.vector.norm() < 10.0, "the pose is where it was: {}", last.pose_o_b);
}

#[test]
fn calibrations_at_the_bounds_of_what_is_valid_give_finite_estimates() {
    let changes: [fn(&mut plumbline_config::EstimatorSetup); 10] = [
        |s| (s.imu.gyro_noise_density, s.imu.accel_noise_density) = (1e-7, 1e-6),
        |s| (s.imu.gyro_noise_density, s.imu.accel_noise_density) = (0.05, 1.0),
        |s| (s.imu.gyro_bias_walk, s.imu.accel_bias_walk) = (1e-9, 1e-8),
        |s| (s.imu.gyro_bias_sigma_rad_s, s.imu.accel_bias_sigma_m_s2) = (1e-6, 1e-6),
        |s| (s.estimator.points.sigma_px, s.estimator.lines.sigma_px) = (0.01, 0.01),
        |s| (s.estimator.points.sigma_px, s.estimator.lines.sigma_px) = (20.0, 20.0),
        |s| s.estimator.window.cauchy_scale = 0.1,
        |s| (s.estimator.window.keyframes, s.estimator.window.recent_frames) = (2, 1),
        |s| (s.rig.time_offset_sigma_s, s.rig.camera_imu_rotation_sigma_rad) = (0.0, 0.2),
        |s| (s.rig.time_offset_s, s.rig.time_offset_sigma_s) = (0.1, 0.05),
    ];
    for (which, change) in changes.iter().enumerate() {
        for cameras in [1, 2] {
            let mut setup = (*config(cameras)).clone();
            change(&mut setup);
            let setup = setup.validate().expect("is within the bounds");
            let estimates = fly(&setup, |_, _| {});
            assert!(estimates.is_ok(), "change {which}, {cameras} cameras: {estimates:?}");
        }
    }
}

/// An image of random blocks, `shift` pixels to the left.
fn blocks(shift: usize) -> Vec<u8> {
    (0..752 * 480)
        .map(|k| {
            let (x, y) = ((k % 752 + shift) / 9, k / 752 / 9);
            let mixed = (x * 7919 + y * 104_729 + 17).wrapping_mul(2_654_435_761);
            40 + ((mixed >> 13) % 160) as u8
        })
        .collect()
}

#[test]
fn feedback_that_is_no_number_reaches_no_estimate_through_the_front_end() {
    let poisons: [fn(&mut Feedback, f64); 6] = [
        |f, x| f.pose_b_c[0].translation.vector.x = x,
        |f, x| f.pose_b_c[1].translation.vector.y = x,
        |f, x| f.pose_b_c[1].rotation = crate::geometry::exp_so3(&Vector3::new(x, 0.0, 0.0)),
        |f, x| f.time_offset_s = x,
        |f, x| f.bias_gyro.y = x,
        |f, x| f.wrong_points.extend([0, 5, x as u32]),
    ];
    let mut setup = (*config(2)).clone();
    // Neither images nor readings have noise.
    (setup.estimator.health.refuse_repeated_images, setup.imu.stuck_after_s) = (false, 0.0);
    let setup = setup.validate().expect("is valid");
    let (left, right) = (blocks(0), blocks(13));
    let view = |pixels| ImageView::new(752, 480, 752, pixels).expect("has this size");
    for (which, poison) in poisons.iter().enumerate() {
        for value in [f64::NAN, f64::INFINITY, 1e300] {
            let (mut front_end, mut odometer) = (FrontEnd::new(&setup), Odometer::new(&setup));
            let (mut tracked, mut feedback) = (Tracked::new(&setup), Feedback::new(&setup));
            let mut poses = 0;
            for k in 0..30 {
                for i in 0..11 {
                    let t = 0.05 * f64::from(k) - 0.05 + 0.005 * f64::from(i);
                    let accel = Vector3::new(0.0, 0.0, 9.81);
                    front_end.add_imu(&ImuSample { stamp: stamp(t), gyro: Vector3::zeros(), accel });
                }
                let frame = FrameInput::stereo(stamp(0.05 * f64::from(k)), view(&left), view(&right));
                front_end.track(&frame, &WorkBudget::FULL, &InTurn, [&mut (), &mut ()], &mut tracked);
                let mut heard = feedback.clone();
                if k == 26 {
                    poison(&mut heard, value);
                }
                front_end.apply_feedback(&heard);
                let estimate = odometer.process(&tracked, &mut (), &mut feedback);
                poses += u32::from(estimate.has_pose());
                let is_good = is_finite(&estimate) || !estimate.has_pose();
                assert!(
                    is_good && is_finite_feedback(&feedback),
                    "{which}: {value} after frame {k}: {estimate:?}"
                );
            }
            assert!(poses > 1, "{which}: {value}: there were {poses} poses to spoil");
        }
    }
}
