//! Pose graphs of flights whose truth is known.

use super::edge::turn;
use super::*;
use nalgebra::{Isometry3, Matrix4, UnitQuaternion, Vector3, Vector4};
use plumbline_config::Random;

const NODES: usize = 200;
/// Nodes of a lap.
const LAP: usize = 100;

/// Two laps of a circle with a body whose x axis points up, as on the EuRoC rig; odometry with a drift of heading and
/// position.
struct Flight {
    truth: Vec<Isometry3<f64>>,
    odometry: Vec<Isometry3<f64>>,
}

impl Flight {
    fn new(seed: u64) -> Self {
        let mut random = Random::new(seed);
        let mount = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), -std::f64::consts::FRAC_PI_2);
        let truth: Vec<_> = (0..NODES)
            .map(|k| {
                let angle = std::f64::consts::TAU * k as f64 / LAP as f64;
                let p = Vector3::new(3.0 * angle.cos(), 3.0 * angle.sin(), 1.0 + 0.2 * (3.0 * angle).sin());
                Isometry3::from_parts(p.into(), turn(angle) * mount)
            })
            .collect();
        let bias = 0.0002 * random.gaussian();
        let mut odometry = vec![truth[0]];
        for k in 1..NODES {
            let step = truth[k - 1].inverse() * truth[k];
            let noise = Vector3::from_fn(|_, _| 0.004 * random.gaussian());
            // About the vertical, which the body knows.
            let up = truth[k - 1].rotation.inverse() * Vector3::z();
            let heading = UnitQuaternion::from_scaled_axis(up * (bias + 0.0006 * random.gaussian()));
            let noisy =
                Isometry3::from_parts((step.translation.vector + noise).into(), heading * step.rotation);
            odometry.push(odometry[k - 1] * noisy);
        }
        Self { truth, odometry }
    }

    fn graph(&self) -> PoseGraph {
        let mut graph = PoseGraph::new(NODES, 100);
        for (k, pose) in self.odometry.iter().enumerate() {
            graph.add_node(Node::new(*pose, &Isometry3::identity(), k == 0)).unwrap();
            if k > 0 {
                let information = information(0.005, 0.001);
                assert!(graph.add_sequential(Edge::of_odometry(graph.nodes(), k - 1, k, information)));
            }
        }
        graph
    }

    /// The second lap is another piece of odometry, that waits to be placed.
    fn two_segments(&self) -> PoseGraph {
        let mut graph = PoseGraph::new(NODES, 100);
        let elsewhere = Isometry3::translation(1000.0, 0.0, 0.0);
        for (k, pose) in self.odometry.iter().enumerate() {
            let is_second = k >= LAP;
            let pose_m_o = if is_second { elsewhere } else { Isometry3::identity() };
            let node = Node {
                segment: u32::from(is_second),
                is_placed: !is_second,
                ..Node::new(*pose, &pose_m_o, k == 0 || k == LAP)
            };
            graph.add_node(node).unwrap();
            if k > 0 && k != LAP {
                let edge = Edge::of_odometry(graph.nodes(), k - 1, k, information(0.005, 0.001));
                graph.add_sequential(edge);
            }
        }
        graph
    }

    /// The loop from the first lap to the second that begins at `k`, moved and turned by an error.
    fn closure(&self, graph: &PoseGraph, k: usize, shift: Vector3<f64>, yaw: f64) -> Edge {
        let between = self.truth[k].inverse() * self.truth[k + LAP];
        let up = self.truth[k].rotation.inverse() * Vector3::z();
        let wrong = Isometry3::from_parts(shift.into(), UnitQuaternion::from_scaled_axis(up * yaw));
        Edge::of_loop(graph.nodes(), (k, k + LAP), &(wrong * between), information(0.02, 0.005))
    }

    fn ate_m(&self, graph: &PoseGraph) -> f64 {
        let errors = graph
            .nodes()
            .iter()
            .zip(&self.truth)
            .map(|(n, t)| (n.p_m_b - t.translation.vector).norm_squared());
        (errors.sum::<f64>() / NODES as f64).sqrt()
    }
}

fn information(sigma_m: f64, sigma_rad: f64) -> Matrix4<f64> {
    let p = sigma_m.powi(-2);
    Matrix4::from_diagonal(&Vector4::new(p, p, p, sigma_rad.powi(-2)))
}

/// Steps until there is nothing left to do; fewer than a hundred are needed.
fn settle(graph: &mut PoseGraph) -> OptimizationProgress {
    let progress = graph.optimize(100);
    assert!(progress.is_done, "{progress:?}");
    progress
}

#[test]
fn the_jacobians_agree_with_differences() {
    let flight = Flight::new(1);
    let mut nodes: Vec<_> =
        flight.odometry.iter().map(|p| Node::new(*p, &Isometry3::identity(), false)).collect();
    (nodes[3].yaw, nodes[80].yaw) = (0.3, -0.7);
    nodes[80].p_m_b += Vector3::new(0.4, -0.2, 0.1);
    let edge = Edge {
        way: Vector3::new(1.0, 2.0, 3.0),
        turn: 0.2,
        ..Edge::of_odometry(&nodes, 3, 80, Matrix4::identity())
    };
    let analytic = edge.linearize(&nodes);
    for (node, by) in [(3, analytic.by_from), (80, analytic.by_to)] {
        for i in 0..4 {
            let moved = |step: f64| {
                let mut nodes = nodes.clone();
                if i < 3 {
                    nodes[node].p_m_b[i] += step
                } else {
                    nodes[node].yaw += step
                }
                edge.error(&nodes[3], &nodes[80])
            };
            let numeric = (moved(1e-6) - moved(-1e-6)) / 2e-6;
            assert!((numeric - by.column(i)).norm() < 1e-8, "node {node}, unknown {i}");
        }
    }
}

#[test]
fn loops_take_the_drift_out_whatever_way_the_body_is_mounted() {
    let (mut sum_before, mut sum_after) = (0.0, 0.0);
    for seed in 0..10 {
        let flight = Flight::new(seed);
        let mut graph = flight.graph();
        let before = flight.ate_m(&graph);
        for k in (5..95).step_by(10) {
            graph.add_loop(flight.closure(&graph, k, Vector3::zeros(), 0.0), false).unwrap();
        }
        assert_eq!(settle(&mut graph).loops_used, 9);
        let after = flight.ate_m(&graph);
        println!("seed {seed}: ATE {before:.3} m without loops, {after:.3} m with");
        assert!(after < before);
        (sum_before, sum_after) = (sum_before + before, sum_after + after);
        // Poses keep the roll and pitch of the odometry.
        for (node, pose) in graph.nodes().iter().zip(&flight.odometry) {
            let up = |r: &UnitQuaternion<f64>| r.inverse() * Vector3::z();
            assert!((up(&node.pose_m_b().rotation) - up(&pose.rotation)).norm() < 1e-9);
        }
    }
    // What is left is the walk of the first lap, which nothing was there to correct.
    assert!(sum_after < 0.5 * sum_before);
}

#[test]
fn a_single_false_loop_changes_nothing() {
    let flight = Flight::new(3);
    let mut graph = flight.graph();
    let before = graph.nodes().to_vec();
    // One that the odometry may have drifted by, and one that it may not.
    let near = flight.closure(&graph, 30, Vector3::new(0.15, -0.1, 0.0), 0.02);
    assert_eq!(graph.add_loop(near, false), Ok(()));
    let far = flight.closure(&graph, 30, Vector3::new(1.5, -0.8, 0.0), 0.6);
    assert_eq!(graph.add_loop(far, false), Err(LoopRefused::Contradicted));
    settle(&mut graph);
    assert_eq!(graph.nodes(), before);
}

#[test]
fn what_the_odometry_speaks_against_does_not_count_however_many_say_it() {
    for seed in 0..10 {
        let flight = Flight::new(seed);
        let mut graph = flight.graph();
        let before = graph.nodes().to_vec();
        // A room like the first one, 4 m beside it: all that is seen in it agrees with all else.
        for k in 5..95 {
            let alike = flight.closure(&graph, k, Vector3::new(0.0, 4.0, 0.0), 0.0);
            assert_eq!(graph.add_loop(alike, true), Err(LoopRefused::Contradicted), "seed {seed}, {k}");
            let turned = flight.closure(&graph, k, Vector3::zeros(), std::f64::consts::FRAC_PI_2);
            assert_eq!(graph.add_loop(turned, true), Err(LoopRefused::Contradicted), "seed {seed}, {k}");
        }
        settle(&mut graph);
        assert_eq!(graph.nodes(), before);
    }
}

#[test]
fn true_loops_are_never_contradicted() {
    for seed in 0..50 {
        let flight = Flight::new(seed);
        let graph = flight.graph();
        for k in (0..LAP).step_by(7) {
            let edge = flight.closure(&graph, k, Vector3::zeros(), 0.0);
            let distance2 = graph.odometry_distance2(&edge).unwrap();
            assert!(distance2 < 13.28, "seed {seed}, {k}: {distance2}");
        }
    }
}

#[test]
fn a_segment_stays_where_it_was_confirmed_to_be() {
    let flight = Flight::new(6);
    let mut graph = flight.two_segments();
    let alike = Vector3::new(0.0, 4.0, 0.0);
    for k in [10, 14, 18] {
        graph.add_loop(flight.closure(&graph, k, Vector3::zeros(), 0.0), false).unwrap();
    }
    graph.place_segment(1, &Isometry3::identity());
    settle(&mut graph);
    for k in [50, 54, 58, 62, 66] {
        let false_loop = flight.closure(&graph, k, alike, 0.0);
        assert_eq!(graph.add_loop(false_loop, true), Err(LoopRefused::Contradicted));
        graph.add_loop(flight.closure(&graph, k, Vector3::zeros(), 0.0), false).unwrap();
    }
}

#[test]
fn false_loops_that_support_each_other_are_outvoted() {
    for seed in 0..10 {
        let flight = Flight::new(seed);
        let mut graph = flight.graph();
        let mut sound = flight.graph();
        for k in (5..95).step_by(10) {
            for g in [&mut graph, &mut sound] {
                g.add_loop(flight.closure(g, k, Vector3::zeros(), 0.0), false).unwrap();
            }
        }
        // A look-alike place, shifted as a whole by what the odometry may have drifted: these agree with each other.
        let error = Vector3::new(0.0, 0.3, 0.1);
        for k in [50, 53, 56] {
            graph.add_loop(flight.closure(&graph, k, error, 0.0), false).unwrap();
        }
        settle(&mut graph);
        settle(&mut sound);
        let (with, without) = (flight.ate_m(&graph), flight.ate_m(&sound));
        assert!(
            (with - without).abs() < 0.002,
            "seed {seed}: {with} m with false loops, {without} m without"
        );
    }
}

#[test]
fn work_in_small_pieces_gives_the_same_bits() {
    let flight = Flight::new(5);
    let run = |steps: usize| {
        let mut graph = flight.graph();
        for k in [10, 30, 60] {
            graph.add_loop(flight.closure(&graph, k, Vector3::zeros(), 0.0), false).unwrap();
        }
        while !graph.optimize(steps).is_done {}
        graph.nodes().to_vec()
    };
    assert_eq!(run(1), run(1000));
}

#[test]
fn a_node_that_goes_leaves_what_was_known_over_it() {
    let flight = Flight::new(4);
    let mut whole = flight.graph();
    for k in (5..95).step_by(10) {
        whole.add_loop(flight.closure(&whole, k, Vector3::zeros(), 0.0), false).unwrap();
    }
    settle(&mut whole);
    let mut thinned = whole.clone();
    // Nodes with and without loops, and the one that holds the map.
    for gone in [151, 125, 75, 30, 25, 0] {
        thinned.remove_node(gone);
    }
    assert_eq!(thinned.nodes().len(), NODES - 6);
    assert!(thinned.nodes()[0].is_fixed);
    let (before, after) = (whole.edges().len(), thinned.edges().len());
    assert_eq!(before - after, 6, "an edge of the odometry goes with each node, and no loop");
    for node in thinned.nodes() {
        let same = whole.nodes().iter().find(|n| n.pose_o_b == node.pose_o_b).unwrap();
        assert!((same.p_m_b - node.p_m_b).norm() < 1e-12);
    }
    thinned.place_segment(7, &Isometry3::identity());
    settle(&mut thinned);
    for node in thinned.nodes() {
        let same = whole.nodes().iter().find(|n| n.pose_o_b == node.pose_o_b).unwrap();
        assert!((same.p_m_b - node.p_m_b).norm() < 0.01);
    }
}

#[test]
fn a_segment_is_placed_by_a_loop_and_free_to_move_from_then_on() {
    let flight = Flight::new(6);
    let mut graph = flight.two_segments();
    graph.add_loop(flight.closure(&graph, 20, Vector3::zeros(), 0.0), false).unwrap();
    assert!(!graph.edges().last().unwrap().is_supported());
    graph.add_loop(flight.closure(&graph, 40, Vector3::zeros(), 0.0), false).unwrap();
    assert!(graph.edges().last().unwrap().is_supported());
    graph.place_segment(1, &Isometry3::identity());
    settle(&mut graph);
    assert!(graph.nodes().iter().all(|n| n.is_placed));
    assert!(flight.ate_m(&graph) < 0.2, "{}", flight.ate_m(&graph));
}
