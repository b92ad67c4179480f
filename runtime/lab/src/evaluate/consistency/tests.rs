//! Errors drawn from a covariance come to a ratio of one; whatever the odometry frame, and however little is known of it.

use super::errors::step;
use super::flown::FlightConsistency;
use crate::evaluate::test_noise::Noise;
use nalgebra::{Isometry3, Matrix4, SMatrix, SVector, Translation3, UnitQuaternion, Vector3};
use plumbline_config::Timestamp;
use plumbline_estimator::odometry::StepCovariance;
use plumbline_flight::flight::{Published, PublishedState, TrueState, Truth};

const FLIGHTS: u32 = 1000;

fn drawn<const N: usize>(noise: &mut Noise) -> SVector<f64, N> {
    SVector::from_fn(|_, _| noise.normal())
}

/// A square root of a covariance with deviations of about `scale`.
fn root<const N: usize>(noise: &mut Noise, scale: f64) -> SMatrix<f64, N, N> {
    SMatrix::from_fn(
        |i, j| if i == j { scale * (1.0 + noise.uniform()) } else { 0.3 * scale * noise.normal() },
    )
}

fn turn(angle: f64) -> UnitQuaternion<f64> {
    UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle)
}

/// Effect of an error of position and yaw at `p0` on a state at `pose` with velocity `v`.
fn by_frame(pose: &Isometry3<f64>, v: &Vector3<f64>, p0: &Vector3<f64>) -> SMatrix<f64, 9, 4> {
    let mut by = SMatrix::<f64, 9, 4>::zeros();
    by.fixed_view_mut::<3, 3>(0, 0).fill_with_identity();
    by.fixed_view_mut::<3, 1>(0, 3).copy_from(&Vector3::z().cross(&(pose.translation.vector - p0)));
    by.fixed_view_mut::<3, 1>(3, 3).copy_from(&(pose.rotation.inverse() * Vector3::z()));
    by.fixed_view_mut::<3, 1>(6, 3).copy_from(&Vector3::z().cross(v));
    by
}

/// Two poses 1.2 s apart: the first is where its frame begins, known against the world as `frame_sigma` says, the second is
/// off by what is drawn from its covariance times `deviations`. The truth is in a world turned and moved at will.
fn flight(
    noise: &mut Noise,
    counter: u32,
    frame_sigma: f64,
    deviations: f64,
) -> ([PublishedState; 2], [TrueState; 2], StepCovariance) {
    let random_pose = |noise: &mut Noise| {
        Isometry3::from_parts(
            Translation3::from(drawn::<3>(noise) * 3.0),
            turn(3.0 * noise.normal()) * UnitQuaternion::from_scaled_axis(drawn::<3>(noise) * 0.3),
        )
    };
    let poses = [random_pose(noise), random_pose(noise)];
    let velocities = [drawn::<3>(noise), drawn::<3>(noise)];
    let p0 = poses[0].translation.vector;
    let frame_root = root::<4>(noise, frame_sigma);
    let of_frame: Matrix4<f64> = frame_root * frame_root.transpose();
    // Of the first pose tilt and velocity alone are in doubt, but for the frame.
    let mut first_root = root::<9>(noise, 2e-3);
    first_root.fixed_rows_mut::<3>(0).fill(0.0);
    let roots = [first_root, root::<9>(noise, 2e-3)];
    let world =
        Isometry3::from_parts(Translation3::from(drawn::<3>(noise) * 9.0), turn(9.0 * noise.uniform()));
    let frame_error: SVector<f64, 4> = frame_root * drawn::<4>(noise);
    let stamp =
        |k: usize| Timestamp::from_nanos(i64::from(counter) * 10_000_000_000 + k as i64 * 1_200_000_000);
    let mut states = Vec::new();
    let mut truths = Vec::new();
    for k in 0..2 {
        let mut error: SVector<f64, 9> = roots[k] * drawn::<9>(noise) * deviations;
        let mut own = roots[k] * roots[k].transpose();
        if k == 0 {
            // No error of yaw in the first pose.
            let up_b = poses[0].rotation.inverse() * Vector3::z();
            let mut level = SMatrix::<f64, 9, 9>::identity();
            let without = nalgebra::Matrix3::identity() - up_b * up_b.transpose();
            level.fixed_view_mut::<3, 3>(3, 3).copy_from(&without);
            error = level * error;
            own = level * own * level.transpose();
        }
        let by = by_frame(&poses[k], &velocities[k], &p0);
        states.push(PublishedState {
            stamp: stamp(k),
            pose_o_b: poses[k],
            v_o_b: velocities[k],
            covariance: own + by * of_frame * by.transpose(),
            reset_counter: counter,
            quality: 100,
            pose_m_o: None,
        });
        // Exactly, not to first order: the frame moves and turns as a whole.
        let p = poses[k].translation.vector + error.fixed_rows::<3>(0);
        let rotation =
            poses[k].rotation * UnitQuaternion::from_scaled_axis(error.fixed_rows::<3>(3).into_owned());
        let frame_turn = turn(frame_error[3]);
        let p = p0 + frame_turn * (p - p0) + frame_error.fixed_rows::<3>(0);
        let v = frame_turn * (velocities[k] + error.fixed_rows::<3>(6));
        truths.push(TrueState {
            stamp: stamp(k),
            pose_w_b: world * Isometry3::from_parts(Translation3::from(p), frame_turn * rotation),
            v_w_b: Some(world.rotation * v),
        });
    }
    let mut carried = Matrix4::identity();
    carried.fixed_view_mut::<3, 1>(0, 3).copy_from(&Vector3::z().cross(&(poses[1].translation.vector - p0)));
    let own = roots[1] * roots[1].transpose();
    let mut by_state = SMatrix::<f64, 4, 9>::zeros();
    by_state.fixed_view_mut::<3, 3>(0, 0).fill_with_identity();
    let up_b = poses[1].rotation.inverse() * Vector3::z();
    by_state.fixed_view_mut::<1, 3>(3, 3).copy_from(&up_b.transpose());
    let covariance: Matrix4<f64> = by_state * own * by_state.transpose();
    let of_to = covariance + carried * of_frame * carried.transpose();
    let step = StepCovariance { from: stamp(0), to: stamp(1), covariance, of_from: of_frame, of_to };
    let pair = |mut list: Vec<PublishedState>| [list.remove(0), list.remove(0)];
    (pair(states), [truths[0], truths[1]], step)
}

fn judged(frame_sigma: f64, deviations: f64) -> FlightConsistency {
    let mut noise = Noise::new(11);
    let (mut estimates, mut published) = (Vec::new(), Published::default());
    let mut truth = Vec::new();
    for counter in 0..FLIGHTS {
        let (states, truths, known) = flight(&mut noise, counter, frame_sigma, deviations);
        estimates.extend(states.clone());
        published.odometry.extend(states);
        published.steps.push(known);
        truth.extend(truths);
    }
    FlightConsistency::of(&estimates, &published, &Truth::Recorded(truth)).unwrap()
}

#[test]
fn errors_drawn_from_the_covariance_have_a_ratio_of_one() {
    for frame_sigma in [1e-5, 1e-3, 0.2] {
        let result = judged(frame_sigma, 1.0);
        for nees in [result.estimates, result.odometry] {
            let (position, yaw, steps) = (nees.position.unwrap(), nees.yaw.unwrap(), nees.steps.unwrap());
            let (tilt, velocity) = (nees.tilt.unwrap(), nees.velocity.unwrap());
            let figures = [(position, 3, 1), (yaw, 1, 1), (steps, 4, 1), (velocity, 3, 2), (tilt, 2, 2)];
            for (figure, degrees, poses) in figures {
                // Drawn a thousand times: 1.96 standard deviations of chi-squared, half as many again for thirty figures.
                let count = f64::from(degrees) * (FLIGHTS as usize * poses) as f64;
                let off = (figure.mean_ratio - 1.0).abs();
                assert!(off < 1.5 * 1.96 * (2.0 / count).sqrt(), "frame {frame_sigma}: {degrees} {figure:?}");
                assert_eq!(figure.count, FLIGHTS as usize * poses);
            }
        }
    }
}

#[test]
fn twice_the_error_has_four_times_the_ratio() {
    let (once, twice) = (judged(0.01, 1.0).estimates.ratios(), judged(0.01, 2.0).estimates.ratios());
    for (once, twice) in once.into_iter().zip(twice) {
        let factor = twice.unwrap() / once.unwrap();
        assert!((factor - 4.0).abs() < 0.05, "{factor}");
    }
}

#[test]
fn without_a_true_velocity_none_is_judged() {
    let mut noise = Noise::new(3);
    let (states, mut truths, known) = flight(&mut noise, 0, 1e-3, 1.0);
    truths.iter_mut().for_each(|truth| truth.v_w_b = None);
    let published = Published { steps: vec![known], ..Published::default() };
    let result = FlightConsistency::of(&states, &published, &Truth::Recorded(truths.to_vec())).unwrap();
    assert!(result.estimates.velocity.is_none() && result.estimates.tilt.is_some());
    assert!(result.odometry.tilt.is_none());
    assert!(FlightConsistency::of(&states, &published, &Truth::None).is_none());
}

#[test]
fn a_published_pose_that_was_corrected_since_makes_its_step_uncertain() {
    let mut noise = Noise::new(3);
    let (states, truths, known) = flight(&mut noise, 0, 1e-3, 1.0);
    let claim = |known: &StepCovariance| step((&states[0], &truths[0]), (&states[1], &truths[1]), known);
    let scale = known.covariance.norm();
    assert!((claim(&known).covariance - known.covariance).norm() < 1e-6 * scale);
    let better = StepCovariance { of_from: known.of_from * 0.5, ..known };
    assert!(claim(&better).covariance[(0, 0)] > known.covariance[(0, 0)] + 0.4 * known.of_from[(0, 0)]);
    // A window that claims to know less than before takes nothing away.
    let worse = StepCovariance { of_from: known.of_from * 2.0, ..known };
    assert!((claim(&worse).covariance - known.covariance).norm() < 1e-6 * scale);
}
