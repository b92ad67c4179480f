//! Judgements of known disagreements.

use super::*;
use nalgebra::Vector3;
use plumbline_config::Timestamp;

/// Verdict and words for a rotation that is off by so much within this standard deviation, degrees.
fn judged(off_deg: f64, sigma_deg: f64, least_scatter_rad_s: f64) -> (Fitness, String) {
    let found = Agreement {
        offset_s: (0.0, 0.001),
        rotation_b: (Vector3::new(off_deg.to_radians(), 0.0, 0.0), sigma_deg.to_radians()),
        focal: (0.0, 0.001),
        offset_gain: 1.0,
        residual_rad_s: 0.05,
        scatter_rad_s: 0.5,
        least_scatter_rad_s,
    };
    let measure = rotation("camera-IMU rotation", &found, &Config::preset("sim").unwrap(), "turn more");
    (measure.verdict, measure.cure)
}

/// Turns about all axes as a camera shows them whose configured focal lengths are too long by a share; a gyroscope with this scale.
fn seen(too_long: f64, gyro_scale: f64) -> (Vec<Turn>, Vec<ImuSample>, Config) {
    let config = Config::preset("sim").unwrap().into_inner();
    let rot_c_b = config.camera[0].pose_b_c().rotation.inverse();
    let rate_b = |t_s: f64| Vector3::new((1.3 * t_s).sin(), (1.7 * t_s).cos(), 0.6 * (0.9 * t_s).sin());
    let at = |t_s: f64| Timestamp::from_nanos((t_s * 1e9) as i64);
    let sample = |k: i32| {
        let t_s = f64::from(k) / 200.0;
        ImuSample { stamp: at(t_s), gyro: rate_b(t_s) * gyro_scale, accel: Vector3::zeros() }
    };
    let turn = |k: i32| {
        let t_s = 0.5 + f64::from(k) / 20.0;
        let mut rate_c = rot_c_b * rate_b(t_s + 0.025);
        rate_c.x /= 1.0 + too_long;
        rate_c.y /= 1.0 + too_long;
        Turn { from: at(t_s), to: at(t_s + 0.05), rate_c, velocity_c: Vector3::zeros() }
    };
    ((0..160).map(turn).collect(), (0..2_000).map(sample).collect(), config)
}

#[test]
fn focal_lengths_that_are_off_are_told_with_their_size() {
    let verdicts = |too_long: f64| {
        let (turns, samples, config) = seen(too_long, 1.0);
        judge(&turns, &samples, &config)
    };
    for (too_long, verdict, words) in [
        (0.0, Fitness::Good, ""),
        (0.01, Fitness::Good, ""),
        (0.05, Fitness::Mind, "5 % too long"),
        (0.1, Fitness::NotFit, "10 % too long"),
        (-0.1, Fitness::NotFit, "10 % too short"),
    ] {
        let measures = verdicts(too_long);
        let focal = measures.iter().find(|measure| measure.name == "focal length").unwrap();
        assert!(focal.verdict == verdict && focal.cure.contains(words), "{too_long}: {measures:?}");
        let others = measures.iter().filter(|measure| measure.name != "focal length");
        assert!(others.clone().all(|measure| measure.verdict == Fitness::Good), "{measures:?}");
    }
    let (turns, samples, config) = seen(0.0, 1.08);
    let measures = judge(&turns, &samples, &config);
    assert!(
        measures[2].verdict > Fitness::Good && measures[2].cure.contains("gyroscope's scale"),
        "{measures:?}"
    );
}

#[test]
fn a_rotation_beyond_any_mounting_error_is_not_fit_however_uncertain() {
    let (verdict, cure) = judged(30.9, 6.9, 0.05);
    assert!(verdict == Fitness::NotFit && cure.contains("columns and signs of the gyroscope"), "{cure}");
    assert_eq!(judged(30.9, 15.0, 0.05).0, Fitness::Uncertain);
}

#[test]
fn a_rotation_that_turning_about_all_axes_leaves_uncertain_points_at_the_lens() {
    let (verdict, cure) = judged(8.41, 2.86, 0.3);
    assert!(
        verdict == Fitness::Mind
            && cure.contains("focal lengths and lens model")
            && cure.contains("centre_px"),
        "{cure}"
    );
    assert_eq!(judged(8.41, 2.86, 0.05), (Fitness::Uncertain, "turn more".to_owned()));
}
