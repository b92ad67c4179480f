//! Faults with noise in simulated motions: each is named with its sensor, axes and time, and sound recordings have none.

use super::*;
use plumbline_drivers::ImuSource as _;
use plumbline_simulator::InjectedImu;
use plumbline_simulator::{FlightPath, Scenario, Simulator};

/// A recording whose images show the motion exactly.
#[derive(Clone)]
struct Recording {
    config: Config,
    turns: Vec<Turn>,
    samples: Vec<ImuSample>,
}

impl Recording {
    /// Along a path, with these faults.
    fn of(path: FlightPath, faults: &[&str]) -> Self {
        let scenario = Scenario { path, duration_s: 20.0, ..Scenario::default() };
        let simulator = Simulator::new(&Config::preset("sim").unwrap(), &scenario).unwrap();
        let (config, begin) = (simulator.config().clone(), simulator.frame_time(0));
        let faults: Vec<_> = faults.iter().map(|fault| fault.parse().unwrap()).collect();
        let mut imu = InjectedImu::new(simulator.imu(), &config.imu, begin, &faults, 1);
        let samples =
            std::iter::from_fn(|| imu.next_reading().unwrap()).map(|reading| reading.sample).collect();
        let turn = |k: u64| {
            let [from, to] = [k, k + 1].map(|k| simulator.frame_time(k));
            let pose_w_c = |at| simulator.ground_truth(at).pose_w_b * config.camera[0].pose_b_c();
            let (moved, dt_s) = (pose_w_c(from).inverse() * pose_w_c(to), to.seconds_since(from));
            let (rate_c, velocity_c) = (moved.rotation.scaled_axis() / dt_s, moved.translation.vector / dt_s);
            Turn { from, to, rate_c, velocity_c }
        };
        Self { turns: (1..simulator.frame_count()).map(|k| turn(k - 1)).collect(), samples, config }
    }

    fn failures(&self) -> Vec<Failure> {
        failures(&self.turns, &self.samples, &self.config)
    }
}

#[test]
fn sound_recordings_have_no_failure() {
    use FlightPath::{Carried, Demo, Drift, HandHeld, Hover, Sweeps, Yaws};
    for path in [Demo, HandHeld, Hover, Drift, Carried, Yaws, Sweeps] {
        for faults in [&[][..], &["accel-scale:xyz:1.05@0"], &["imu-late:50"], &["accel-pulse:z:30@6+0.1"]] {
            assert_eq!(Recording::of(path.clone(), faults).failures(), Vec::new(), "{path:?} {faults:?}");
        }
        let sound = Recording::of(path.clone(), &[]);
        let turned = assignments().filter(|axes| axes.determinant() > 0.0).map(|axes| (axes, 1.0, 1.0));
        let factors = [(10.0, 1.0), (2.0, 1.0), (0.5, 1.0), (0.1, 1.0), (1.0, 1.2), (1.0, 0.8)];
        let lenses = factors.map(|(baseline, focal)| (Matrix3::identity(), baseline, focal));
        for (axes, baseline, focal) in turned.chain(lenses) {
            let mut wrong = sound.clone();
            for turn in &mut wrong.turns {
                (turn.rate_c, turn.velocity_c) =
                    (axes * turn.rate_c * focal, axes * turn.velocity_c * baseline);
            }
            assert_eq!(wrong.failures(), Vec::new(), "{path:?} {axes} {baseline} {focal}");
        }
    }
}

#[test]
fn axes_are_alive_by_their_motion_and_not_by_their_noise() {
    let moved = |path: FlightPath, faults: &[&str]| moved(&Recording::of(path, faults).samples);
    assert_eq!(moved(FlightPath::HandHeld, &[]), [[true; 3]; 2]);
    // Figures of eight turn about the vertical alone, which is x in this rig.
    let [gyroscope, _] = moved(FlightPath::Demo, &[]);
    assert_eq!(gyroscope, [true, false, false]);
    assert_eq!(moved(FlightPath::Hover, &[]), [[false; 3]; 2]);
    for dose in ["1", "10", "100"] {
        let fault = format!("gyro-dead:y:{dose}@0");
        let [gyroscope, accelerometer] = moved(FlightPath::HandHeld, &[&fault, "accel-frozen:xz@0"]);
        assert_eq!((gyroscope, accelerometer), ([true, false, true], [false, true, false]), "{fault}");
    }
    let blow = moved(FlightPath::Hover, &["accel-pulse:x:30@6+0.1"]);
    assert_eq!(blow, [[false; 3]; 2], "a blow is no motion");
}

#[test]
fn faults_with_noise_are_named_with_their_axes_and_their_time() {
    const ONE: [[&str; 2]; 3] = [["x", "x"], ["y", "y"], ["z", "z"]];
    const TWO: [[&str; 2]; 3] = [["xy", "x and y"], ["yz", "y and z"], ["xz", "x and z"]];
    const ALL: [[&str; 2]; 3] = [["xyz", "x, y and z"]; 3];
    for (kind, dose, from_s, axes, what) in [
        ("gyro-dead", "", 0.0, ONE, "reads noise alone"),
        ("gyro-dead", ":10", 0.0, TWO, "read noise alone"),
        ("gyro-frozen", "", 10.0, ONE, "reads noise alone"),
        ("gyro-dead", "", 10.0, ALL, "read noise alone"),
        ("gyro-sign", "", 10.8, ONE, "reads the opposite of the motion"),
        ("gyro-exchanged", "", 10.8, TWO, "read each other's motion"),
        ("gyro-step", ":1", 10.8, ONE, "reads too much or too little by a constant"),
        ("accel-dead", "", 0.0, ONE, "reads noise alone"),
        ("accel-frozen", "", 10.0, ONE, "reads noise alone"),
        ("accel-dead", ":5", 10.0, ALL, "read noise alone"),
        ("accel-sign", "", 10.8, ONE, "reads the opposite of the motion"),
        ("accel-exchanged", "", 10.8, TWO, "read each other's motion"),
        ("accel-step", ":3", 10.8, ONE, "reads too much or too little by a constant"),
    ] {
        for [letters, names] in axes {
            let fault = format!("{kind}:{letters}{dose}@{from_s}");
            let found = Recording::of(FlightPath::HandHeld, &[&fault]).failures();
            let [failure] = found[..] else { panic!("{fault}: {found:?}") };
            let sensor = if kind.starts_with("gyro") { "gyroscope" } else { "accelerometer" };
            let value = failure.value();
            assert!(value.starts_with(&format!("{sensor} {names} {what} from")), "{fault}: {value}");
            assert!((failure.span_s[0] - from_s).abs() <= 1.5, "{fault}: {value}");
            let is_told = from_s > 0.0 && !kind.ends_with("step");
            assert_eq!(failure.cure().contains("was right before"), is_told, "{fault}: {failure:?}");
        }
    }
    let both = Recording::of(FlightPath::HandHeld, &["imu-frozen"]).failures();
    assert!(both.len() == 2 && both.iter().all(|failure| failure.fault.axes == [true; 3]), "{both:?}");
}
