use super::super::test_room::scatter_step;
use super::super::test_views::{isometry, vector};
use super::*;
use crate::inertial::ImuNoise;
use proptest::prelude::*;

prop_compose! {
    fn states()(p in vector(5.0), phi in vector(1.8), v in vector(3.0), bg in vector(0.1), ba in vector(0.3)) -> NavState {
        NavState { p_o_b: p, rot_o_b: exp_so3(&phi), v_o_b: v, bias_gyro: bg, bias_accel: ba }
    }
}

proptest! {
    #[test]
    fn a_step_leads_to_the_state_from_which_it_is_taken_back(nav in states(), seed in 0u32..1000) {
        let d = scatter_step::<FRAME_DIM>(seed, 0.5);
        prop_assert!((nav.plus(&d).minus(&nav) - d).norm() < 1e-9);
        prop_assert!(nav.plus(&SVector::zeros()).minus(&nav).norm() < 1e-9);
    }

    #[test]
    fn extrinsics_depend_on_the_rig_as_their_derivative_says(pose_b_c0 in isometry(0.2, 2.0), pose_c0_c1 in isometry(0.2, 0.3), camera in 0usize..2) {
        const H: f64 = 1e-6;
        let rig = Rig { pose_b_c0, pose_c0_c1, time_offset_s: 0.0, intrinsics: Default::default() };
        let mount = Mount::of(&rig, camera);
        for k in 0..12 {
            let mut d = SVector::<f64, RIG_DIM>::zeros();
            d[k] = H;
            let [plus, minus] = [rig.plus(&d).pose_b_c(camera), rig.plus(&-d).pose_b_c(camera)];
            let by_p = (plus.translation.vector - minus.translation.vector) / (2.0 * H);
            let by_rot = log_so3(&(minus.rotation.inverse() * plus.rotation)) / (2.0 * H);
            prop_assert!((by_p - mount.by_rig.fixed_view::<3, 1>(NavState::P, k)).norm() < 1e-7, "position by {k}");
            prop_assert!((by_rot - mount.by_rig.fixed_view::<3, 1>(NavState::ROT, k)).norm() < 1e-7, "attitude by {k}");
        }
    }

    #[test]
    fn a_state_is_carried_on_as_newton_would(nav in states()) {
        // Free fall with a constant turn, in steps.
        let gravity_o = Vector3::new(0.0, 0.0, -9.81);
        let (rate, zero) = (Vector3::new(0.3, -0.2, 0.5), Vector3::zeros());
        let noise = ImuNoise { gyro_density: 1e-3, accel_density: 1e-2, ..ImuNoise::NONE };
        let mut motion = Preintegration::new(&nav.bias_gyro, &nav.bias_accel);
        for _ in 0..20 {
            motion.integrate(0.01, &(rate + nav.bias_gyro), &nav.bias_accel, &nav.bias_accel, &noise);
        }
        let after = nav.after(&motion, &gravity_o);
        prop_assert!((after.v_o_b - nav.v_o_b - gravity_o * 0.2).norm() < 1e-9);
        prop_assert!((after.p_o_b - nav.p_o_b - nav.v_o_b * 0.2 - gravity_o * 0.02).norm() < 1e-9);
        prop_assert!(after.rot_o_b.angle_to(&(nav.rot_o_b * exp_so3(&(rate * 0.2)))) < 1e-7);
        prop_assert_eq!((after.bias_gyro - nav.bias_gyro + zero).norm(), 0.0);
    }
}

#[test]
fn a_state_with_any_component_that_is_no_number_is_not_finite() {
    assert!(NavState::default().is_finite());
    for value in [f64::NAN, f64::INFINITY] {
        let bad = Vector3::new(0.0, value, 0.0);
        let nav = NavState::default();
        assert!(!NavState { p_o_b: bad, ..nav.clone() }.is_finite());
        assert!(!NavState { v_o_b: bad, ..nav.clone() }.is_finite());
        assert!(!NavState { bias_gyro: bad, ..nav.clone() }.is_finite());
        assert!(!NavState { bias_accel: bad, ..nav.clone() }.is_finite());
        assert!(!NavState { rot_o_b: exp_so3(&bad), ..nav }.is_finite());
    }
}
