//! A flight of thousands of keyframes through a building, as a flight uses places: locate, add, close loops. The work of
//! each keyframe is measured as time of the processor.

use super::building::{Building, FEATURES, Stop, pose_b_c};
use nalgebra::{Isometry3, Matrix4, UnitQuaternion, Vector3, Vector4};
use plumbline_config::Random;
use plumbline_config::Timestamp;
use plumbline_estimator::places::graph::{Edge, Node, PoseGraph};
use plumbline_estimator::places::index::Votes;
use plumbline_estimator::places::refine::Gravity;
use plumbline_estimator::places::{
    Feature, Keyframe, Located, Locator, LocatorOptions, MapLimits, PlaceMap, Query,
};
use rustix::time::{ClockId, clock_gettime};

/// Keyframes of a map, as `plumbline map` has them by default.
pub const KEYFRAMES: usize = 2000;
/// Loops of a graph.
const LOOPS: usize = 2000;
/// The newest keyframes are no places to come back to.
const NEWEST: u32 = 30;
/// Steps of the pose graph after a loop.
const GRAPH_STEPS: usize = 1;
/// Noise of the odometry from keyframe to keyframe, m and rad.
const ODOMETRY: (f64, f64) = (0.003, 0.0003);

/// A keyframe before it is one.
pub struct Shot {
    pub stop: Stop,
    pub features: Vec<Feature>,
}

impl Shot {
    pub fn query(&self, seed: u64) -> Query<'_> {
        let up_b = self.stop.pose_m_b.rotation.inverse() * Vector3::z();
        let gravity = Gravity { up_b, sigma_rad: 0.01 };
        Query { features: &self.features, pose_b_c: pose_b_c(), gravity, seed }
    }

    pub fn keyframe(&self, number: usize) -> Keyframe {
        Keyframe::new(0, Timestamp::from_nanos(number as i64), self.stop.pose_m_b, pose_b_c())
    }

    pub fn is_at(&self, found: &Located) -> bool {
        (found.pose_m_b.translation.vector - self.stop.pose_m_b.translation.vector).norm() < 0.3
    }
}

/// Views at each stop of a path.
pub fn shots(building: &Building, stops: &[Stop], seed: u64) -> Vec<Shot> {
    let mut random = Random::new(seed);
    let seen =
        |stop: &Stop, random: &mut Random| building.seen(stop.hall, &(stop.pose_m_b * pose_b_c()), random);
    stops.iter().map(|stop| Shot { stop: *stop, features: seen(stop, &mut random) }).collect()
}

/// Time that a piece of work takes on the processor, ms; other programs do not count.
pub fn timed<T>(work: impl FnOnce() -> T) -> (T, f64) {
    let now = || {
        let time = clock_gettime(ClockId::ThreadCPUTime);
        time.tv_sec as f64 * 1e3 + time.tv_nsec as f64 * 1e-6
    };
    let begin = now();
    let result = work();
    (result, now() - begin)
}

/// Times of one kind of work.
#[derive(Default)]
pub struct Times(Vec<f64>);

impl Times {
    pub fn push(&mut self, ms: f64) {
        self.0.push(ms);
    }

    pub fn quantile(&self, share: f64) -> f64 {
        let mut sorted = self.0.clone();
        sorted.sort_by(f64::total_cmp);
        sorted.get(((sorted.len().max(1) - 1) as f64 * share) as usize).copied().unwrap_or(0.0)
    }

    pub fn print(&self, name: &str) {
        let q = |share: f64| self.quantile(share);
        println!(
            "{name:<44} {:>5} times  median {:>6.2}  95 % {:>6.2}  worst {:>6.2} ms",
            self.0.len(),
            q(0.5),
            q(0.95),
            q(1.0)
        );
    }
}

/// Map and locator of a flight.
pub struct Mapper {
    pub map: PlaceMap,
    pub locator: Locator,
    pub votes: Votes,
    pub graph: PoseGraph,
    random: Random,
}

impl Mapper {
    pub fn new(keyframes: usize) -> Self {
        Self {
            map: PlaceMap::new(MapLimits { keyframes, features: FEATURES }),
            locator: Locator::new(&LocatorOptions::default(), keyframes, FEATURES),
            votes: Votes::new(keyframes),
            graph: PoseGraph::new(keyframes, LOOPS),
            random: Random::new(8),
        }
    }

    /// Localization of a shot by all keyframes but the newest.
    pub fn locate(&mut self, number: usize, shot: &Shot) -> Option<Located> {
        let newest = (number as u32).saturating_sub(NEWEST);
        self.locator.locate(&self.map, &shot.query(number as u64), |k| k.id < newest)
    }

    /// Adds a node and its edge of odometry, while there is room.
    pub fn add_node(&mut self, shot: &Shot) {
        let truth = shot.stop.pose_m_b;
        let count = self.graph.nodes().len();
        let pose_o_b = match count.checked_sub(1) {
            None => truth,
            Some(last) => {
                let before = &self.graph.nodes()[last];
                let step = self.truth_of(last).inverse() * truth;
                before.pose_o_b * step * self.drift()
            }
        };
        let node = Node::new(pose_o_b, &Isometry3::identity(), count == 0);
        if self.graph.add_node(node).is_some() && count > 0 {
            let information = information(ODOMETRY.0, ODOMETRY.1);
            self.graph.add_sequential(Edge::of_odometry(self.graph.nodes(), count - 1, count, information));
        }
    }

    /// Adds a loop from the newest node, and goes on with the optimization.
    pub fn close(&mut self, found: &Located) {
        let to = self.graph.nodes().len() - 1;
        let from = found.keyframe_id as usize;
        let pose_a_b = self.truth_of(from).inverse() * found.pose_m_b;
        let information = information(0.02, 0.01);
        let edge = Edge::of_loop(self.graph.nodes(), (from, to), &pose_a_b, information);
        // A graph that is full, or a place that looks like another: it goes on without.
        let _ = self.graph.add_loop(edge, false);
        self.graph.optimize(GRAPH_STEPS);
    }

    /// While the map is not full, numbers are slots.
    fn truth_of(&self, number: usize) -> Isometry3<f64> {
        self.map.keyframe(number).map_or_else(Isometry3::identity, |k| k.pose_m_b)
    }

    fn drift(&mut self) -> Isometry3<f64> {
        let mut noise = |sigma: f64| Vector3::from_fn(|_, _| sigma * self.random.gaussian());
        let turn = UnitQuaternion::from_scaled_axis(noise(ODOMETRY.1));
        Isometry3::from_parts(noise(ODOMETRY.0).into(), turn)
    }
}

fn information(sigma_m: f64, sigma_rad: f64) -> Matrix4<f64> {
    let p = sigma_m.powi(-2);
    Matrix4::from_diagonal(&Vector4::new(p, p, p, sigma_rad.powi(-2)))
}

/// Times of a flight, all of it and what one keyframe takes.
#[derive(Default)]
pub struct Figures {
    pub query: Times,
    pub locate: Times,
    pub add: Times,
    pub graph: Times,
    pub whole: Times,
    pub found: usize,
    pub wrong: usize,
}

impl Figures {
    pub fn print(&self, name: &str) {
        println!("{name}: {} found, {} of them wrong", self.found, self.wrong);
        self.query.print("  query alone");
        self.locate.print("  query and verification");
        self.add.print("  keyframe added, and another forgotten");
        self.graph.print("  pose graph: a node, a loop, a step");
        self.whole.print("  all of it");
    }
}

/// Flies on; what happens to each keyframe is measured.
pub fn fly(mapper: &mut Mapper, first: usize, shots: &[Shot]) -> Figures {
    let mut figures = Figures::default();
    for (number, shot) in shots.iter().enumerate().map(|(i, s)| (first + i, s)) {
        let (_, query_ms) = timed(|| mapper.map.query(&shot.features, |_| true, &mut mapper.votes).len());
        let (found, locate_ms) = timed(|| mapper.locate(number, shot));
        let is_full = mapper.graph.nodes().len() == mapper.map.limits().keyframes;
        let ((), node_ms) = timed(|| {
            if !is_full {
                mapper.add_node(shot);
            }
        });
        let (_, add_ms) = timed(|| mapper.map.add(shot.keyframe(number), &shot.features));
        let mut graph_ms = 0.0;
        if let Some(found) = &found {
            figures.found += 1;
            figures.wrong += usize::from(!shot.is_at(found));
            if !is_full {
                graph_ms = node_ms + timed(|| mapper.close(found)).1;
                figures.graph.push(graph_ms);
            }
        }
        figures.query.push(query_ms);
        figures.locate.push(locate_ms);
        figures.add.push(add_ms);
        figures.whole.push(locate_ms + add_ms + graph_ms);
    }
    figures
}
