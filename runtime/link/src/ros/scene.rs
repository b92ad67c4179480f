//! Scene for the views of RViz 2. It is kept from the start of the flight, whenever the router appears.

use super::landmarks::LandmarkMap;
use super::path::PathHistory;
use crate::net::pace::Rates;
use crate::net::relay::Relayed;
use nalgebra::Isometry3;
use plumbline_estimator::Odometry;
use plumbline_estimator::places::{MapEstimate, MapPath};
use plumbline_record::local::content::LocalRecord;
use plumbline_record::protobuf::decode;
use plumbline_record::topics::Topic;
use std::collections::BTreeMap;

/// Path, map and landmarks of a flight, in bounded memory.
#[derive(Clone, Debug)]
pub struct RosScene {
    /// Path in the odometry frame.
    pub path: PathHistory,
    /// Landmarks of the window, and of the keyframes that have left it.
    pub landmarks: LandmarkMap,
    /// Newest corrected path.
    pub corrected: MapPath,
    /// Newest pose of the odometry frame in the map.
    pub estimate: Option<MapEstimate>,
    /// Newest message of each other topic.
    others: BTreeMap<Topic, Vec<u8>>,
}

impl RosScene {
    /// Creates an empty scene of the size that a link can carry.
    #[must_use]
    pub fn new(rates: &Rates) -> Self {
        Self {
            path: PathHistory::new(rates.path_poses),
            landmarks: LandmarkMap::new(rates.keyframe_landmarks),
            corrected: MapPath::new(0),
            estimate: None,
            others: BTreeMap::new(),
        }
    }

    /// True if [`RosScene::take`] has a use for a record.
    #[must_use]
    pub fn draws(record: &LocalRecord) -> bool {
        matches!(
            record,
            LocalRecord::MapEstimate(_)
                | LocalRecord::Window(_)
                | LocalRecord::Path(_)
                | LocalRecord::Other(_)
        )
    }

    /// Takes a record of the flight.
    pub fn take(&mut self, Relayed { record, message }: Relayed) {
        match record {
            LocalRecord::MapEstimate(newest) => self.estimate = Some(newest),
            LocalRecord::Window(snapshot) => self.landmarks.update(snapshot),
            LocalRecord::Path(path) => self.corrected = path,
            LocalRecord::Other(kind) => {
                if let Some(topic) = Topic::of_kind(kind) {
                    self.others.insert(topic, message);
                }
            }
            _ => {}
        }
    }

    /// Newest record of a topic that has no place of its own here.
    #[must_use]
    pub fn newest<T: plumbline_record::fields::Record>(&self, topic: Topic) -> Option<T> {
        decode(self.others.get(&topic)?).ok()
    }

    /// Pose of the frame of `odometry` in the map, if it is known: after a reset the odometry frame is another one.
    #[must_use]
    pub fn pose_m_o(&self, odometry: &Odometry) -> Option<Isometry3<f64>> {
        let estimate = self.estimate.as_ref()?;
        estimate.pose_m_o.filter(|_| estimate.reset_counter == odometry.reset_counter)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use plumbline_config::options::Link;
    use plumbline_record::messages::LadderRung;
    use plumbline_record::protobuf::encode;

    #[test]
    fn what_a_flight_says_is_kept_for_views_whatever_it_is() {
        let mut scene = RosScene::new(&Rates::of(Link::Lan));
        for level in [1, 2] {
            let message = encode(&LadderRung { level, name: "no lines".into() });
            let record = LocalRecord::Other(Topic::Ladder.kind());
            assert!(RosScene::draws(&record));
            scene.take(Relayed { record, message });
        }
        assert_eq!(scene.newest::<LadderRung>(Topic::Ladder).unwrap().level, 2);
        assert_eq!(scene.newest::<LadderRung>(Topic::Sensors), None);
    }
}
