//! States at random instants of simulated flights: as good as the estimates beside them, and the same bits in a re-execution.

use nalgebra::Isometry3;
use plumbline_config::{Random, Timestamp};
use plumbline_estimator::estimate::TrackingState;
use plumbline_flight::flight::{Flight, KeptInstants, Outputs, PublishedState, Truth, fly, open_simulation};
use plumbline_flight::log::WhenFull;
use plumbline_flight::log::verify::verify;
use plumbline_flight::pipeline::{Control, RunOptions};
use plumbline_lab::evaluate::consistency::errors::{since_start, tilt, velocity};
use plumbline_record::{InstantAnswer, InstantOutcome};
use plumbline_simulator::{Scenario, Scene};
use plumbline_tests::simulated;

/// Instants of each flight.
const COUNT: usize = 500;
/// Data before the first pose, s.
const WARM_UP_S: f64 = 1.0;

fn state(answer: &InstantAnswer) -> PublishedState {
    let at = &answer.instant;
    PublishedState {
        stamp: at.stamp,
        pose_o_b: at.pose_o_b,
        v_o_b: at.v_o_b,
        covariance: at.covariance,
        reset_counter: at.reset_counter,
        quality: at.quality,
        pose_m_o: None,
    }
}

/// Root mean squares of errors: position and yaw against `first`, tilt and velocity; and their mean NEES over what is expected.
fn judged(first: &PublishedState, states: &[PublishedState], truth: &Truth) -> [[f64; 3]; 2] {
    let true_first = truth.state_at(first.stamp).unwrap();
    let (mut squares, mut nees, mut counts) = ([0.0; 3], [0.0; 3], [0.0; 3]);
    for state in states {
        let at = truth.state_at(state.stamp).unwrap();
        let way = since_start((first, &true_first), (state, &at));
        let (tilt, velocity) = (tilt(state, &at), velocity(state, &at).unwrap());
        let found = [
            (way.error.xyz().norm_squared(), way.nees().map(|nees| nees / 4.0)),
            (tilt.error.norm_squared(), tilt.nees().map(|nees| nees / 2.0)),
            (velocity.error.norm_squared(), velocity.nees().map(|nees| nees / 3.0)),
        ];
        for (k, (square, ratio)) in found.into_iter().enumerate() {
            squares[k] += square;
            // Close to the first pose hardly anything is claimed of the way from it.
            nees[k] += ratio.unwrap_or_default();
            counts[k] += f64::from(u8::from(ratio.is_some()));
        }
    }
    let count = states.len() as f64;
    assert!(counts.iter().all(|known| *known > 0.95 * count), "{counts:?}");
    [squares.map(|sum| (sum / count).sqrt()), [0, 1, 2].map(|k| nees[k] / counts[k])]
}

/// Time of the first frame.
fn first_frame(flight: &Flight) -> Timestamp {
    let Truth::Simulated(simulator) = &flight.truth else { panic!("is simulated") };
    simulator.frame_time(0)
}

/// The estimate nearest to each instant.
fn beside(instants: &[PublishedState], estimates: &[PublishedState]) -> Vec<PublishedState> {
    let nearest = |stamp: Timestamp| {
        let distance = |state: &&PublishedState| state.stamp.nanos_since(stamp).abs();
        estimates.iter().min_by_key(distance).unwrap().clone()
    };
    instants.iter().map(|state| nearest(state.stamp)).collect()
}

fn flies(scene: Scene, seed: u64) {
    let scenario =
        Scenario { scene, start_s: 2.0, duration_s: 8.0, seed, resolution_scale: 0.5, ..Scenario::default() };
    let flight = open_simulation(None, &scenario, false, 0.0, None).unwrap();
    let mut random = Random::new(seed);
    let begin = first_frame(&flight);
    let stamps: Vec<Timestamp> = (0..COUNT)
        .map(|_| WARM_UP_S + random.range(0.0, scenario.duration_s - WARM_UP_S - 0.1))
        .map(|since_s| begin.plus_nanos((since_s * 1e9) as i64))
        .collect();
    let (control, folder) = (Control::default(), tempfile::tempdir().unwrap());
    let log = folder.path().join("flight.mcap");
    let mut instants = KeptInstants::of(stamps.clone(), &control);
    let mut outputs = Outputs::default();
    outputs.record(&log, &flight, WhenFull::Wait).unwrap();
    let mut subscribers = outputs.subscribers();
    subscribers.push(&mut instants);
    let flown = fly(flight, &RunOptions { speed: None, threads: 2 }, &control, subscribers).unwrap();
    outputs.finish();

    let mut rows = instants.into_rows();
    rows.sort_by_key(|answer| answer.number);
    assert!(rows.iter().map(|row| row.instant.stamp).eq(stamps.iter().copied()), "a row for each, in order");
    assert!(rows.iter().all(|row| row.outcome == InstantOutcome::Answered && row.instant.is_settled));
    assert!(rows.iter().all(|row| row.instant.state == TrackingState::Tracking));
    assert!(rows.iter().any(|row| row.instant.pose_o_b != Isometry3::identity()));
    let states: Vec<PublishedState> = rows.iter().map(state).collect();
    let first = &flown.poses[0];
    let [errors, nees] = judged(first, &states, &flown.truth);
    let [errors_beside, nees_beside] = judged(first, &beside(&states, &flown.poses), &flown.truth);
    println!(
        "{scene:?} {seed}: errors {errors:?} (beside {errors_beside:?}), NEES {nees:?} ({nees_beside:?})"
    );
    for k in 0..3 {
        assert!(errors[k] < 1.05 * errors_beside[k], "error {k}: {} beside {}", errors[k], errors_beside[k]);
        let ratio = nees[k] / nees_beside[k];
        assert!((0.8..1.1).contains(&ratio), "NEES {k}: {} beside {}", nees[k], nees_beside[k]);
    }
    assert_eq!(flown.outcome.figures.hot_path_allocations, 0);

    let verified = verify(&log, None, None, &mut |_| {}).unwrap();
    assert!(verified.identical && verified.complete, "{:?}", verified.difference);
    assert_eq!(verified.instants_identical, COUNT as u64);
    assert_eq!(verified.odometry_digest, flown.outcome.odometry_digest);
}

#[test]
fn states_at_random_instants_are_as_good_as_estimates_and_verify() {
    flies(Scene::Room, 1);
    flies(Scene::Hall, 2);
}

#[test]
fn asking_for_instants_changes_no_bit_of_a_flight() {
    let digests = |since_ns: Option<[i64; 5]>| {
        let scenario =
            Scenario { start_s: 2.0, duration_s: 2.0, resolution_scale: 0.5, ..Scenario::default() };
        let flight = simulated(&scenario);
        let control = Control::default();
        let begin = first_frame(&flight);
        let mut instants = since_ns.map(|since_ns| {
            KeptInstants::of(since_ns.map(|since_ns| begin.plus_nanos(since_ns)).into(), &control)
        });
        let options = RunOptions { speed: None, threads: 2 };
        let subscribers = instants.iter_mut().map(|instants| instants as _).collect();
        let flown = fly(flight, &options, &control, subscribers).unwrap();
        (flown.outcome.estimate_digest, flown.outcome.odometry_digest)
    };
    // Before the first pose, in the middle, and after the end.
    let since_ns = [-5_000_000_000, 100_000_000, 1_001_234_567, 1_001_234_567, 9_000_000_000];
    assert_eq!(digests(None), digests(Some(since_ns)));
}
