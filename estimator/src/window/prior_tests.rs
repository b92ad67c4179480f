use super::super::test_dense::full;
use super::super::test_room::{Room, scatter_step};
use super::*;
use crate::geometry::exp_so3;
use nalgebra::{DVector, SVector};
use plumbline_config::Config;

const SIGMAS: AnchorSigmas = AnchorSigmas {
    position_m: 0.01,
    yaw_rad: 0.002,
    tilt_rad: 0.1,
    velocity_m_s: 2.0,
    bias_gyro_rad_s: 0.05,
    bias_accel_m_s2: 0.3,
};

fn anchored(nav: &NavState, known: &AnchorState) -> Prior {
    let rig = Rig::of(Config::preset("sim").expect("is good").setup());
    let mut prior = Prior::new(unknown_of_frame(3), &rig);
    prior.start(&rig, &KnownRig::within(&SVector::from_element(0.5)));
    prior.anchor(1, nav, known, &SIGMAS);
    prior
}

#[test]
fn it_begins_with_the_calibration_and_what_is_held_fixed_is_left_out() {
    let rig = Rig::of(Config::preset("sim").expect("is good").setup());
    let mut prior = Prior::new(unknown_of_frame(2), &rig);
    let mut sigmas = SVector::<f64, RIG_DIM>::from_element(0.1);
    sigmas[Rig::TIME_OFFSET] = 0.0;
    prior.start(&rig, &KnownRig::within(&sigmas));
    assert_eq!(prior.frames(), 0);
    let (h, b) = full(&prior.equations);
    assert!((h[(Rig::P_B_C0, Rig::P_B_C0)] - 100.0).abs() < 1e-9);
    assert_eq!(h[(Rig::TIME_OFFSET, Rig::TIME_OFFSET)], 0.0);
    assert_eq!(b.norm(), 0.0);
}

#[test]
fn an_anchor_knows_tilt_less_well_than_yaw_whatever_the_attitude() {
    for phi in [Vector3::new(0.0, 0.0, 0.0), Vector3::new(1.2, -0.7, 0.4), Vector3::new(0.0, 1.5, 0.0)] {
        let nav = NavState { rot_o_b: exp_so3(&phi), ..NavState::default() };
        let prior = anchored(&nav, &AnchorState::default());
        assert_eq!(prior.frames(), 2);
        let at = unknown_of_frame(1) + NavState::ROT;
        let (h, _) = full(&prior.equations);
        let attitude = h.fixed_view::<3, 3>(at, at);
        let up_b = nav.rot_o_b.inverse() * Vector3::z();
        let level_b = nav.rot_o_b.inverse() * Vector3::new(0.6, -0.8, 0.0);
        assert!(((attitude * up_b).dot(&up_b) * SIGMAS.yaw_rad.powi(2) - 1.0).abs() < 1e-9);
        assert!(((attitude * level_b).dot(&level_b) * SIGMAS.tilt_rad.powi(2) - 1.0).abs() < 1e-9);
    }
}

#[test]
fn an_anchor_pulls_the_biases_to_where_they_were_believed_to_be() {
    let nav = NavState { bias_gyro: Vector3::new(0.02, 0.0, 0.0), ..NavState::default() };
    let prior =
        anchored(&nav, &AnchorState { bias_accel: Vector3::new(0.0, 0.0, 0.1), ..AnchorState::default() });
    let at = unknown_of_frame(1);
    let gradient = prior.equations.gradient();
    // Downhill is against the gradient: the gyroscope's bias back to 0, the accelerometer's up to 0.1.
    assert!((gradient[at + NavState::BIAS_GYRO] - 0.02 / 0.05_f64.powi(2)).abs() < 1e-9);
    assert!((gradient[at + NavState::BIAS_ACCEL + 2] + 0.1 / 0.3_f64.powi(2)).abs() < 1e-9);
    assert_eq!(gradient[at + NavState::P], 0.0);
}

#[test]
fn an_anchor_turns_the_vertical_back_to_where_it_was_known_and_leaves_the_yaw() {
    let known = exp_so3(&Vector3::new(0.3, -0.2, 0.9));
    let yawed = exp_so3(&Vector3::new(0.0, 0.0, 0.7)) * known;
    let nav = NavState { rot_o_b: yawed * exp_so3(&Vector3::new(0.01, -0.02, 0.015)), ..NavState::default() };
    let up_b = known.inverse() * Vector3::z();
    let prior = anchored(&nav, &AnchorState { up_b: Some(up_b), ..AnchorState::default() });
    let at = unknown_of_frame(1) + NavState::ROT;
    let (information, gradient) = full(&prior.equations);
    let block = information.view((at, at), (3, 3)).into_owned();
    let turn = -block.try_inverse().unwrap() * gradient.rows(at, 3);
    let turn = Vector3::new(turn[0], turn[1], turn[2]);
    let found = (nav.rot_o_b * exp_so3(&turn)).inverse() * Vector3::z();
    let before = (nav.rot_o_b.inverse() * Vector3::z()).angle(&up_b);
    assert!(found.angle(&up_b) < 0.02 * before, "{} of {before} rad", found.angle(&up_b));
    assert!(turn.dot(&(nav.rot_o_b.inverse() * Vector3::z())).abs() < 1e-9, "turns about the vertical");
}

#[test]
fn its_cost_is_the_quadratic_that_its_equations_say() {
    let mut window = Room { frames: 5, ..Room::default() }.window();
    window.remove_frame(0);
    for (k, frame) in (0..).zip(&mut window.frames) {
        frame.nav = frame.nav.plus(&scatter_step(k, 1e-2));
    }
    let frames = window.prior.frames();
    let mut d = DVector::zeros(unknown_of_frame(frames));
    d.rows_mut(0, RIG_DIM).copy_from(&window.rig.minus(&window.prior.rig));
    for (k, frame) in window.frames.iter().take(frames).enumerate() {
        d.rows_mut(unknown_of_frame(k), FRAME_DIM).copy_from(&frame.nav.minus(&frame.linearization));
    }
    let (h, b) = full(&window.prior.equations);
    let mut target = NormalEquations::new(unknown_of_frame(8));
    target.reset(unknown_of_frame(window.frames.len()));
    let cost = window.prior.evaluate(&window.rig, &window.frames, Some(&mut target));
    let expected = 0.5 * d.dot(&(&h * &d)) + b.dot(&d);
    assert!((cost - expected).abs() < 1e-9 * (1.0 + expected.abs()), "{cost} instead of {expected}");
    let (moved_h, moved_b) = full(&target);
    let n = d.len();
    assert_eq!(moved_h.view((0, 0), (n, n)), h);
    let moved = &h * &d + &b;
    assert!((moved_b.rows(0, n) - &moved).norm() < 1e-9 * moved.norm());
}

#[test]
fn a_prior_made_at_the_present_states_has_there_the_gradient_that_it_was_made_of() {
    let window = Room { frames: 3, ..Room::default() }.window();
    let mut prior = window.prior.clone();
    let mut frames = window.frames.clone();
    let mut equations = NormalEquations::new(unknown_of_frame(16));
    equations.reset(unknown_of_frame(3));
    for k in 0..equations.dim() {
        equations.add(k, k, 2.0 + k as f64);
        equations.gradient_mut()[k] = (k as f64).sin();
    }
    // The frames have moved from where they are linearized.
    for (k, frame) in (0..).zip(&mut frames) {
        frame.nav = frame.nav.plus(&scatter_step(k, 1e-2));
    }
    prior.replace(&equations, &window.rig, &frames);
    let mut target = NormalEquations::new(unknown_of_frame(16));
    target.reset(unknown_of_frame(3));
    let _ = prior.evaluate(&window.rig, &frames, Some(&mut target));
    for k in 0..target.dim() {
        assert!((target.gradient()[k] - equations.gradient()[k]).abs() < 1e-9, "{k}");
    }
}
