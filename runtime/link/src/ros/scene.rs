//! Scene for the views of RViz 2. It is kept from the start of the flight, whenever the router appears.

use super::landmarks::LandmarkMap;
use super::path::PathHistory;
use crate::net::pace::Rates;
use nalgebra::Isometry3;
use plumbline_estimator::Odometry;
use plumbline_estimator::places::{MapEstimate, MapPath};
use plumbline_flight::local::Record;

/// Path, map and landmarks of a flight, in bounded memory.
#[derive(Clone, Debug)]
pub struct Scene {
    /// Path in the odometry frame.
    pub path: PathHistory,
    /// Landmarks of the window, and of the keyframes that have left it.
    pub landmarks: LandmarkMap,
    /// Newest corrected path.
    pub corrected: MapPath,
    /// Newest pose of the odometry frame in the map.
    pub estimate: Option<MapEstimate>,
}

impl Scene {
    /// Creates an empty scene of the size that a link can carry.
    #[must_use]
    pub fn new(rates: &Rates) -> Self {
        Self {
            path: PathHistory::new(rates.path_poses),
            landmarks: LandmarkMap::new(rates.keyframe_landmarks),
            corrected: MapPath::new(0),
            estimate: None,
        }
    }

    /// True if [`Scene::take`] has a use for a record.
    #[must_use]
    pub fn draws(record: &Record) -> bool {
        matches!(record, Record::MapEstimate(_) | Record::Window(_) | Record::Path(_))
    }

    /// Takes a record of the flight.
    pub fn take(&mut self, record: Record) {
        match record {
            Record::MapEstimate(newest) => self.estimate = Some(newest),
            Record::Window(snapshot) => self.landmarks.update(snapshot),
            Record::Path(path) => self.corrected = path,
            _ => {}
        }
    }

    /// Pose of the frame of `odometry` in the map, if it is known: after a reset the odometry frame is another one.
    #[must_use]
    pub fn pose_m_o(&self, odometry: &Odometry) -> Option<Isometry3<f64>> {
        let estimate = self.estimate.as_ref()?;
        estimate.pose_m_o.filter(|_| estimate.reset_counter == odometry.reset_counter)
    }
}
