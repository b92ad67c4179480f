use super::*;

/// Watches frames of a twentieth of a second whose mean forces are these, m/s²; returns the standard deviation of the velocity along x
/// after each, m/s.
fn watched(forces: impl IntoIterator<Item = f64>) -> Vec<f64> {
    let of_velocity = |watch: &SuddenForce, to: Timestamp| watch.of_velocity(to);
    let sigma =
        |covariance: Option<Matrix3<f64>>| covariance.map_or(0.0, |covariance| covariance[(0, 0)].sqrt());
    after_each(forces, of_velocity).into_iter().map(sigma).collect()
}

/// Watches such frames; returns what the watch tells after each.
fn after_each<T>(
    forces: impl IntoIterator<Item = f64>,
    told: impl Fn(&SuddenForce, Timestamp) -> T,
) -> Vec<T> {
    let mut watch = SuddenForce::new();
    let of_frame = |(k, force): (usize, f64)| {
        let motion = Preintegration { dt_s: 0.05, delta_v: Vector3::new(force, 0.0, 9.8) * 0.05, ..still() };
        let [from, to] = [k, k + 1].map(|k| Timestamp::default().plus_seconds(0.05 * k as f64));
        watch.update([from, to], &UnitQuaternion::identity(), &motion);
        told(&watch, to)
    };
    forces.into_iter().enumerate().map(of_frame).collect()
}

fn still() -> Preintegration {
    let zero = Vector3::zeros();
    Preintegration::new(&zero, &zero)
}

/// Forces of a vehicle that flies about.
fn flying(k: usize) -> f64 {
    2.0 * libm::sin(0.2 * k as f64)
}

#[test]
fn flying_about_leaves_the_velocity_certain() {
    assert!(watched((0..200).map(flying)).iter().all(|sigma| *sigma == 0.0));
}

#[test]
fn a_force_that_sets_in_makes_the_velocity_uncertain_at_once_and_for_a_while() {
    for step in [3.0, -8.0] {
        let sigmas = watched((0..200).map(|k| flying(k) + if k >= 100 { step } else { 0.0 }));
        assert!(sigmas[..100].iter().all(|sigma| *sigma == 0.0));
        // The velocity is wrong by the step over the frame: within five standard deviations.
        assert!(sigmas[100] > f64::abs(step) * 0.05 / 5.0, "{}", sigmas[100]);
        assert!(sigmas[101..105].iter().all(|sigma| *sigma > f64::abs(step) * 0.1 / 5.0));
        assert_eq!(sigmas[115], 0.0, "images have had time to contradict it");
    }
}

#[test]
fn a_force_that_sets_in_between_two_frames_is_as_sudden() {
    let half = |k: usize| [0.0, 1.5, 3.0][(k + 1).saturating_sub(100).min(2)];
    let sigmas = watched((0..200).map(|k| 0.25 * flying(k) + half(k)));
    assert!(sigmas[100] > 1.5 * 0.05 / 5.0 && sigmas[101] > 3.0 * 0.1 / 5.0, "{}", sigmas[100]);
}

#[test]
fn shaking_becomes_usual() {
    let sigmas = watched((0..400).map(|k| if k % 2 == 0 { 4.0 } else { -4.0 }));
    assert!(sigmas[300..].iter().all(|sigma| *sigma == 0.0));
}

#[test]
fn what_is_no_number_and_a_hole_are_no_change() {
    let mut watch = SuddenForce::new();
    let mut frame = |x: f64| {
        let motion = Preintegration { dt_s: 0.05, delta_v: Vector3::new(x, 0.0, 0.0), ..still() };
        watch.update([Timestamp::default(); 2], &UnitQuaternion::identity(), &motion);
        watch.of_velocity(Timestamp::default())
    };
    assert_eq!([0.0, f64::NAN, 10.0].map(&mut frame), [None; 3]);
}

#[test]
fn a_force_that_did_not_act_moves_predictions_further_with_each_frame_until_it_is_confirmed() {
    let forces = (0..130).map(|k| flying(k) + if k >= 100 { 8.0 } else { 0.0 });
    let moved = after_each(forces, |watch, to| watch.moved_m(to, 0.05));
    assert!(moved[..100].iter().all(Option::is_none));
    for (after, way) in [(0, 0.01), (1, 0.03), (2, 0.05)] {
        let found = moved[100 + after].expect("sudden");
        assert!((found / way - 1.0).abs() < 0.1, "{after}: {found}");
    }
    assert_eq!(moved[120], None);
}
