//! Map of a vehicle: the place of its odometry in it, and the corrected path with its loops.

use nalgebra::{Isometry3, Vector3};
use plumbline_estimator::places::mapper::path::PathPose;
use plumbline_estimator::places::{MapEstimate, MapPath};
use plumbline_link::net::read::Heard;

/// The corrected path, as it was received.
#[derive(Clone, Debug, Default)]
struct Path {
    sequence: u64,
    published_ns: i64,
    /// Pieces of unbroken odometry, x y z each, m.
    pieces: Vec<Vec<[f32; 3]>>,
    /// Both ends of each loop, m.
    loops: Vec<[[f32; 3]; 2]>,
    drift_m: Option<f64>,
}

/// The map of a vehicle, bounded by what a message may hold.
#[derive(Clone, Debug, Default)]
pub struct Corrected {
    correction: Option<Heard<MapEstimate>>,
    path: Option<Path>,
    /// Paths that the vehicle has sent, as it reports.
    announced: u64,
    /// Counts changes of the path.
    pub version: u64,
}

impl Corrected {
    /// Applies a correction; one that was overtaken is ignored.
    pub fn apply_correction(&mut self, correction: Heard<MapEstimate>) {
        let published_ns = correction.envelope.published_ns;
        if self.correction.as_ref().is_none_or(|newest| published_ns >= newest.envelope.published_ns) {
            self.correction = Some(correction);
        }
    }

    /// Applies the count of paths that the vehicle reports. One that has started anew counts from the beginning.
    pub fn announce(&mut self, paths: u64) {
        self.announced = paths;
        if self.path.as_ref().is_some_and(|path| path.sequence >= paths) {
            self.path = None;
            self.version += 1;
        }
    }

    /// Applies a corrected path, published or queried; one that was overtaken is ignored.
    pub fn apply_path(&mut self, Heard { envelope, message }: &Heard<MapPath>) {
        if self.path.as_ref().is_some_and(|newest| envelope.published_ns <= newest.published_ns) {
            return;
        }
        let place = |p: &Vector3<f64>| [p.x as f32, p.y as f32, p.z as f32];
        let unbroken = message.poses.chunk_by(|a, b| a.reset_counter == b.reset_counter);
        let piece =
            |poses: &[PathPose]| poses.iter().map(|at| place(&at.pose_m_b.translation.vector)).collect();
        self.path = Some(Path {
            sequence: envelope.sequence,
            published_ns: envelope.published_ns,
            pieces: unbroken.map(piece).collect(),
            loops: message
                .loops
                .iter()
                .map(|ends| [place(&ends.seen.p_m_b), place(&ends.seen_by.p_m_b)])
                .collect(),
            drift_m: message.drift_m,
        });
        self.announced = self.announced.max(envelope.sequence.saturating_add(1));
        self.version += 1;
    }

    /// The number of the newest path, where the one that is here is older.
    pub fn missing(&self) -> Option<u64> {
        let newest = self.announced.checked_sub(1)?;
        self.path.as_ref().is_none_or(|path| path.sequence < newest).then_some(newest)
    }

    /// Takes coordinates from the odometry frame after so many resets to the map frame; `None` while that is not known.
    pub fn pose_m_o(&self, resets: u32) -> Option<Isometry3<f64>> {
        let correction = &self.correction.as_ref()?.message;
        correction.pose_m_o.filter(|_| correction.reset_counter == resets)
    }

    /// Pieces of the corrected path: positions of the body in the map, m.
    pub fn pieces(&self) -> &[Vec<[f32; 3]>] {
        self.path.as_ref().map_or(&[], |path| &path.pieces)
    }

    /// Loops that count: both ends in the map, m.
    pub fn loops(&self) -> &[[[f32; 3]; 2]] {
        self.path.as_ref().map_or(&[], |path| &path.loops)
    }

    /// The map in words, such as "44 keyframes, 21 loops, drift taken out 0.02 m"; `None` where no word of a map has come.
    pub fn words(&self, resets: u32) -> Option<String> {
        let MapEstimate { keyframes, sightings, loops_used, .. } = self.correction.as_ref()?.message;
        let count = |n: u32, one: &str, many: &str| format!("{n} {}", if n == 1 { one } else { many });
        let keyframes = count(keyframes, "keyframe", "keyframes");
        if self.pose_m_o(resets).is_none() {
            return Some(format!("{keyframes}, place in the map not known yet"));
        }
        let loops = count(loops_used, "loop", "loops");
        let drift = self.path.as_ref().and_then(|path| path.drift_m).unwrap_or(0.0);
        Some(match sightings {
            0 => format!("{keyframes}, no place seen again yet"),
            _ => format!("{keyframes}, {loops}, drift taken out {drift:.2} m"),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use plumbline_config::Timestamp;
    use plumbline_estimator::places::mapper::path::{LoopEnd, LoopEnds};
    use plumbline_record::messages::Envelope;

    fn correction(published_ns: i64, pose_m_o: Option<Isometry3<f64>>) -> Heard<MapEstimate> {
        let (reset_counter, keyframes, sightings, loops_used) = (1, 7, 3, 1);
        let map = MapEstimate {
            pose_m_o,
            reset_counter,
            keyframes,
            sightings,
            loops_used,
            ..MapEstimate::default()
        };
        Heard { envelope: Envelope { published_ns, ..Envelope::default() }, message: map }
    }

    fn path(published_ns: i64, sequence: u64) -> Heard<MapPath> {
        let stamp = Timestamp::default();
        let at = |x: f64, reset_counter| PathPose {
            stamp,
            reset_counter,
            pose_m_b: Isometry3::translation(x, x + 1.0, x + 2.0),
        };
        let end = |x: f64| LoopEnd { stamp, p_m_b: Vector3::new(x, x + 1.0, x + 2.0) };
        let mut message = MapPath::new(0);
        message.poses = vec![at(0.0, 0), at(7.0, 0), at(14.0, 1)];
        message.loops = vec![LoopEnds { seen: end(0.0), seen_by: end(14.0) }];
        message.drift_m = Some(0.256);
        Heard { envelope: Envelope { published_ns, sequence, ..Envelope::default() }, message }
    }

    #[test]
    fn the_map_is_told_in_words_and_not_before_the_place_is_known() {
        let mut map = Corrected::default();
        assert_eq!(map.words(1), None);
        map.apply_correction(correction(1, None));
        assert_eq!(map.words(1).unwrap(), "7 keyframes, place in the map not known yet");
        map.apply_correction(correction(2, Some(Isometry3::identity())));
        map.apply_path(&path(2, 0));
        assert_eq!(map.words(1).unwrap(), "7 keyframes, 1 loop, drift taken out 0.26 m");
        // The odometry frame after the next reset is another one.
        assert!(map.words(2).unwrap().contains("not known yet") && map.pose_m_o(2).is_none());
    }

    #[test]
    fn a_path_is_broken_where_the_odometry_was_reset() {
        let mut map = Corrected::default();
        map.apply_path(&path(2, 0));
        assert_eq!(map.pieces(), [vec![[0.0, 1.0, 2.0], [7.0, 8.0, 9.0]], vec![[14.0, 15.0, 16.0]]]);
        assert_eq!(map.loops(), [[[0.0, 1.0, 2.0], [14.0, 15.0, 16.0]]]);
    }

    #[test]
    fn a_path_that_was_missed_is_noticed_and_an_overtaken_one_ignored() {
        let mut map = Corrected::default();
        assert_eq!(map.missing(), None);
        map.apply_correction(correction(5, None));
        map.announce(3);
        assert_eq!(map.missing(), Some(2));
        map.apply_path(&path(4, 2));
        assert_eq!((map.missing(), map.version), (None, 1));
        map.apply_path(&path(3, 1));
        map.apply_correction(correction(4, Some(Isometry3::identity())));
        assert_eq!(map.pose_m_o(1), None);
        assert_eq!((map.missing(), map.version), (None, 1));
        // A vehicle that has started anew has another map.
        map.announce(0);
        assert!(map.pieces().is_empty() && map.version == 2);
    }
}
