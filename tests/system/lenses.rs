//! Flights through every lens that cameras are sold with.

use plumbline_config::Config;
use plumbline_config::camera::Distortion;
use plumbline_flight::flight::open_simulation;
use plumbline_lab::report::Report;
use plumbline_simulator::{FlightPath, Scenario};
use plumbline_tests::reported;

/// Lenses of public rigs, and how many times longer than a pinhole's their focal length is at the same size of things near the
/// axis.
fn lenses() -> [(Distortion, f64); 6] {
    let brown = |k1, k2| Distortion::RadialTangential { k1, k2, p1: 2e-4, p2: 2e-5 };
    [
        (brown(-0.283, 0.074), 1.0),
        (Distortion::Equidistant { k1: 0.0035, k2: 0.0007, k3: -0.0021, k4: 0.0002 }, 1.0),
        (
            Distortion::Rational {
                k1: 0.626,
                k2: 0.466,
                p1: -1.9e-4,
                p2: -4.3e-5,
                k3: 0.0042,
                k4: 0.894,
                k5: 0.543,
                k6: 0.066,
            },
            1.0,
        ),
        (Distortion::Omni { xi: 1.446, k1: -0.344, k2: 0.062, p1: 1.3e-3, p2: -2.1e-4 }, 2.446),
        (Distortion::Eucm { alpha: 0.629, beta: 1.042 }, 1.0),
        (Distortion::DoubleSphere { xi: -0.241, alpha: 0.567 }, 0.759),
    ]
}

/// Flies at half scale with both cameras of the preset `sim` behind this lens.
fn flown(distortion: Distortion, focal: f64, (path, seed): (&str, u64), duration_s: f64) -> Report {
    let mut config = Config::preset("sim").unwrap().into_inner();
    for camera in &mut config.camera {
        camera.distortion = distortion;
        camera.focal_px = camera.focal_px.map(|f| f * focal);
    }
    let config = config.validated("lens").unwrap();
    let path = FlightPath::named(path);
    let scenario = Scenario { path, seed, duration_s, resolution_scale: 0.5, ..Scenario::default() };
    reported(open_simulation(Some(config), &scenario, false, 0.0, None).unwrap())
}

/// A lens without distortion.
const PINHOLE: Distortion = Distortion::RadialTangential { k1: 0.0, k2: 0.0, p1: 0.0, p2: 0.0 };

/// A flight that turns every way; `docs/calibration.md` has the figures of sixteen others.
#[test]
fn every_lens_flies_as_well_as_a_pinhole() {
    let error_m = |distortion, focal| -> f64 {
        let report = flown(distortion, focal, ("sweeps", 2), 8.0);
        assert_eq!((report.resets, report.hot_path_allocations), (0, 0), "{distortion:?}");
        assert!(report.completion >= 0.98, "{distortion:?}: {}", report.completion);
        report.ate_rmse_m.unwrap()
    };
    let pinhole_m = error_m(PINHOLE, 1.0);
    for (distortion, focal) in lenses() {
        let lens_m = error_m(distortion, focal);
        println!("{:18} {:.4} m, pinhole {pinhole_m:.4} m", distortion.model(), lens_m);
        assert!(lens_m < 1.1 * pinhole_m, "{distortion:?}: {lens_m} m, pinhole {pinhole_m} m");
    }
}

/// Sixteen flights of 8 s each, and their ratio to the same flights through a pinhole.
#[test]
#[ignore = "takes minutes: make soak"]
fn soak_sixteen_flights_through_each_lens_are_those_through_a_pinhole() {
    let paths = ["demo", "demo", "sweeps", "sweeps", "carried", "hand-held", "yaws", "drift"];
    let flights = [1, 11].into_iter().flat_map(|first| paths.into_iter().zip(first..));
    let flights: Vec<(&str, u64)> = flights.collect();
    let errors_m = |distortion, focal| -> Vec<f64> {
        let error_m = |flight: &(&str, u64)| {
            let report = flown(distortion, focal, *flight, 8.0);
            assert_eq!(report.resets, 0, "{distortion:?} {flight:?}");
            report.ate_rmse_m.unwrap()
        };
        flights.iter().map(error_m).collect()
    };
    let pinhole = errors_m(PINHOLE, 1.0);
    let pinhole_m = pinhole.iter().sum::<f64>();
    let mut missed = Vec::new();
    for (distortion, focal) in lenses() {
        let ratio = errors_m(distortion, focal).iter().sum::<f64>() / pinhole_m;
        println!("{:18} {ratio:.2} of the error of a pinhole", distortion.model());
        if ratio >= 1.1 {
            missed.push(distortion.model());
        }
    }
    assert!(missed.is_empty(), "{missed:?}");
}

/// A fisheye of 190 degrees, of which the outer part is not used: what is left of the image flies.
#[test]
fn a_lens_that_sees_beyond_a_right_angle_flies() {
    let t265 = Distortion::Equidistant { k1: -0.0033, k2: 0.0541, k3: -0.0516, k4: 0.0107 };
    let report = flown(t265, 0.5, ("demo", 3), 8.0);
    assert_eq!(report.resets, 0);
    assert!(report.completion >= 0.98, "{}", report.completion);
    assert!(report.ate_rmse_m.unwrap() < 0.03, "{:?} m", report.ate_rmse_m);
}
