//! The map that a flight makes, and where the odometry lies in it.
//!
//! One call a keyframe ([`Mapper::process`]): features of its images, the search for the place in what was seen before,
//! a node and edges in the pose graph, a bounded number of steps of its solver. What comes out is the pose of the
//! odometry frame in the map, `T_MO`; the odometry itself never hears of it.
//!
//! A *segment* is a piece of unbroken odometry: a reset begins a new one. The first segment defines the map, if none was
//! loaded; every other one is *placed* when it has been located in what is there: twice from places apart that agree, or
//! once beyond doubt. Until then it is not known where the vehicle is in the map, and nothing is said. A segment that was
//! never placed is forgotten when the next one begins.
//!
//! Keyframes of a loaded map stand still: a sighting of one is an edge from a node at the origin of the map.

mod corrected;
pub mod follower;
mod job;
mod nodes;
pub mod path;
mod segment;
mod sighting;

pub use corrected::Passing;
pub use follower::{MapEstimate, MapFollower};
pub use job::{MapUpdate, PlaceJob, Sighting};
pub use path::MapPath;

use super::extractor::{Extractor, View};
use super::graph::{Node, PoseGraph};
use super::locate::{Locator, LocatorOptions, Query};
use super::map::{Keyframe, MapLimits, PlaceMap, view_distance_within};
use super::refine::Gravity;
use crate::exchange::SolvedFrame;
use crate::points::rig::RigCamera;
use nalgebra::{Isometry3, Matrix4, Vector3};
use nodes::NodeInfo;
use plumbline_config::options::PlacesConfig;
use plumbline_config::{Timestamp, ValidSetup};
use segment::Segment;

/// Keyframes younger than this are not searched: they are what the odometry still sees, s.
const MIN_AGE_S: f64 = 10.0;
/// Steps of the graph's solver in one call.
const STEPS_PER_CALL: usize = 3;
/// Keyframes that have moved whose neighbours are found anew in one call: with a search, and without one.
const TENDED_PER_CALL: [usize; 2] = [1, 3];
/// Steps of the solver at the end of a flight.
const FINAL_STEPS: usize = 500;
/// Loops that a graph may hold, for each keyframe.
const LOOPS_PER_KEYFRAME: usize = 2;
/// Nodes of the graph beside those of a full map: the origin, and those of views that the map had already.
const EXTRA_NODES: usize = 256;
/// Standard deviation of neighbouring keyframes against each other, m and rad.
const KEYFRAME_SIGMA: (f64, f64) = (0.003, 0.001);
/// Standard deviation of the vertical of the odometry, rad.
const SIGMA_VERTICAL_RAD: f64 = 0.004;
/// A frame that is no keyframe may become one while the segment is not placed, after so many frames.
pub const SEARCH_EVERY_FRAMES: u64 = 5;

/// Makes the map. Everything is allocated at construction.
pub struct Mapper {
    options: PlacesConfig,
    rig: Vec<RigCamera>,
    extractor: Extractor,
    locator: Locator,
    map: PlaceMap,
    graph: PoseGraph,
    infos: Vec<NodeInfo>,
    /// The first session of this flight: earlier ones come from a loaded map.
    first_session: u32,
    segment: Option<Segment>,
    segments: u32,
    sightings: u32,
    contradicted: u32,
    loops_used: u32,
}

impl Mapper {
    /// A mapper that starts from nothing, or goes on with the keyframes of `known`, which must have the limits of
    /// [`Self::limits`].
    #[must_use]
    pub fn new(setup: &ValidSetup, known: Option<PlaceMap>) -> Self {
        let options = setup.estimator.places.clone();
        let limits = Self::limits(setup);
        let (width_px, height_px) = (setup.left().width_px, setup.left().height_px);
        let map = known.unwrap_or_else(|| PlaceMap::new(limits));
        let nodes = limits.keyframes + EXTRA_NODES;
        let mut mapper = Self {
            rig: setup.camera.iter().map(|c| RigCamera::new(c.model())).collect(),
            extractor: Extractor::new(width_px, height_px, limits.features),
            locator: Locator::new(&locator_options(), limits.keyframes, limits.features),
            first_session: map.keyframes().map(|(_, k)| k.session + 1).max().unwrap_or(0),
            map,
            graph: PoseGraph::new(nodes, LOOPS_PER_KEYFRAME * limits.keyframes),
            infos: Vec::with_capacity(nodes),
            segment: None,
            segments: 0,
            sightings: 0,
            contradicted: 0,
            loops_used: 0,
            options,
        };
        // The origin of the map: what was seen of a loaded one hangs on it.
        let origin = Isometry3::identity();
        mapper.push_node(
            Node { segment: u32::MAX, ..Node::new(origin, &origin, true) },
            NodeInfo {
                stamp: Timestamp::MIN,
                reset_counter: u32::MAX,
                slot: None,
                keyframe_id: u32::MAX,
                first_pose_o_b: origin,
            },
        );
        mapper
    }

    /// Limits of the map of a setup.
    #[must_use]
    pub fn limits(setup: &ValidSetup) -> MapLimits {
        let places = &setup.estimator.places;
        MapLimits { keyframes: places.max_keyframes, features: places.max_features }
    }

    /// The map.
    pub fn map(&self) -> &PlaceMap {
        &self.map
    }

    /// The pose graph of this flight.
    pub fn graph(&self) -> &PoseGraph {
        &self.graph
    }

    /// Places seen again so far.
    pub fn sightings(&self) -> u32 {
        self.sightings
    }

    /// Places that looked like one seen before, and were not believed because the odometry speaks against it.
    pub fn contradicted(&self) -> u32 {
        self.contradicted
    }

    /// Loops that count, as of the last call.
    pub fn loops_used(&self) -> u32 {
        self.loops_used
    }

    /// Takes a frame into account.
    pub fn process(&mut self, job: &PlaceJob) -> MapUpdate {
        let solved = &job.solved;
        let (mut is_searched, mut sighting) = (false, None);
        if let Some(pose_o_b) = solved.pose_o_b {
            let mut segment = self.segment_of(solved);
            self.refresh(solved);
            segment.follow(solved);
            if self.is_wanted(&segment, solved, &pose_o_b) && job.images.image(0).is_some() {
                is_searched = true;
                sighting = self.add_keyframe(&mut segment, job, &pose_o_b);
            }
            self.segment = Some(segment);
            let progress = self.graph.optimize(STEPS_PER_CALL);
            self.loops_used = progress.loops_used as u32;
            if progress.steps > 0 {
                self.move_keyframes();
            }
            self.map.tend(TENDED_PER_CALL[usize::from(!is_searched)]);
        }
        self.sightings += u32::from(sighting.is_some());
        MapUpdate {
            index: solved.index,
            sequence: solved.sequence,
            stamp: solved.stamp,
            reset_counter: solved.reset_counter,
            pose_m_o: self.pose_m_o(),
            is_searched,
            sighting,
            keyframes: self.map.len() as u32,
            sightings: self.sightings,
            loops_used: self.loops_used,
        }
    }

    /// Solves the graph to its end, for the trajectory and the map that are kept.
    pub fn finish(&mut self) {
        let progress = self.graph.optimize(FINAL_STEPS);
        self.loops_used = progress.loops_used as u32;
        self.move_keyframes();
        if self.segment.is_some_and(|s| !s.is_placed) {
            self.forget_unplaced();
        }
        self.map.tend(usize::MAX);
    }

    /// Pose of the odometry frame in the map, as the newest node has it.
    fn pose_m_o(&self) -> Option<Isometry3<f64>> {
        self.segment.filter(|s| s.is_placed)?;
        self.graph.nodes().last().map(Node::pose_m_o)
    }

    /// The segment of a frame: the present one, or a new one after a reset.
    fn segment_of(&mut self, solved: &SolvedFrame) -> Segment {
        if let Some(segment) = self.segment.filter(|s| s.reset_counter == solved.reset_counter) {
            return segment;
        }
        if self.segment.is_some_and(|s| !s.is_placed) {
            self.forget_unplaced();
        }
        let number = self.segments;
        self.segments += 1;
        Segment {
            number,
            reset_counter: solved.reset_counter,
            // Only the first one defines the map: where a later one lies is not known, also with one camera, which has none.
            is_placed: self.map.is_empty() && self.graph.nodes().len() == 1,
            since_node: Matrix4::zeros(),
            known_until: solved.stamp,
        }
    }

    /// True if a frame is taken: it shows something new, or the place of its segment is not known yet.
    fn is_wanted(&self, segment: &Segment, solved: &SolvedFrame, pose_o_b: &Isometry3<f64>) -> bool {
        if !solved.is_keyframe && segment.is_placed {
            return false;
        }
        let Some((node, info)) = self.graph.nodes().last().zip(self.infos.last()) else { return true };
        if info.reset_counter != segment.reset_counter {
            return true;
        }
        let [before, now] = [&node.pose_o_b, pose_o_b].map(|pose| pose * self.rig[0].pose_b_c);
        view_distance_within(&before, &now, self.options.spacing_m).is_none()
    }

    /// Makes a keyframe of a frame: looks where it was seen before, and adds it to map and graph.
    fn add_keyframe(
        &mut self,
        segment: &mut Segment,
        job: &PlaceJob,
        pose_o_b: &Isometry3<f64>,
    ) -> Option<Sighting> {
        let solved = &job.solved;
        for (camera, pose_b_c) in self.rig.iter_mut().zip(job.pose_b_c) {
            camera.pose_b_c = pose_b_c;
        }
        let pose_b_c = self.rig[0].pose_b_c;
        let up_b = pose_o_b.rotation.inverse() * Vector3::z();
        let left = (&self.rig[0], job.images.image(0)?);
        let right = self.rig.get(1).and_then(|camera| Some((camera, job.images.image(1)?)));
        let up_c = pose_b_c.rotation.inverse() * up_b;
        let features = self.extractor.extract(&View { left, right, up_c });
        let query = Query {
            features,
            pose_b_c,
            gravity: Gravity { up_b, sigma_rad: SIGMA_VERTICAL_RAD },
            seed: solved.sequence,
        };
        let session = self.first_session + segment.number;
        let newest = solved.stamp.plus_seconds(-MIN_AGE_S);
        let located = self.locator.locate(&self.map, &query, |k| {
            if k.session == session { segment.is_placed && k.stamp < newest } else { true }
        });

        let sighting = located.as_ref().map(|found| self.sighting_of(found));
        let node = self.add_node(segment, solved, pose_o_b)?;
        // What the odometry speaks against was not this place, but one that looks like it.
        let found = located.is_some();
        let located = located.filter(|located| self.add_loop(segment, node, located));
        self.contradicted += u32::from(found && located.is_none());
        let sighting = sighting.filter(|_| located.is_some());
        let pose_m_b = self.graph.nodes()[node].pose_m_b();
        let keyframe = Keyframe::new(session, solved.stamp, pose_m_b, pose_b_c);
        // With one camera there is no depth, and so nothing to be located by; a view that the map has needs no other.
        if job.images.image(1).is_some()
            && !located.as_ref().is_some_and(|found| self.has_view(found, &pose_b_c))
            && let Some(slot) = self.map.add(keyframe, self.extractor.features())
        {
            if let Some(forgotten) = self.infos.iter().position(|i| i.slot == Some(slot)) {
                self.remove_node(forgotten);
            }
            let id = self.map.keyframe(slot).map_or(u32::MAX, |k| k.id);
            if let Some(info) = self.infos.last_mut() {
                (info.slot, info.keyframe_id) = (Some(slot), id);
            }
        }
        sighting
    }
}

/// In flight keyframes are as exact against each other as the odometry has them.
fn locator_options() -> LocatorOptions {
    LocatorOptions {
        map_sigma_m: KEYFRAME_SIGMA.0,
        map_sigma_rad: KEYFRAME_SIGMA.1,
        ..LocatorOptions::default()
    }
}
