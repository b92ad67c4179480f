//! What a vehicle says of its map: where its odometry lies in it, and the corrected path with its loops.

use nalgebra::{Isometry3, Vector3};
use plumbline_link::net::{proto, read};

/// Where the odometry lies in the map.
#[derive(Clone, Copy, Debug)]
struct Correction {
    /// Takes coordinates from the odometry to the map frame; `None` where the place in the map is not known.
    pose_m_o: Option<Isometry3<f64>>,
    /// The odometry frame that it is about.
    reset_counter: u32,
    published_ns: i64,
    loops: u32,
    keyframes: u32,
    seen_again: u32,
    paths: u64,
}

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
    correction: Option<Correction>,
    path: Option<Path>,
    /// Counts changes of the path.
    pub version: u64,
}

impl Corrected {
    /// Applies a correction; one that was overtaken is ignored.
    pub fn apply_correction(&mut self, message: &proto::MapCorrection) {
        let Some(header) = &message.header else { return };
        if self.correction.is_some_and(|newest| header.published_ns < newest.published_ns) {
            return;
        }
        self.correction = Some(Correction {
            pose_m_o: message.pose_m_o.as_ref().and_then(read::isometry),
            reset_counter: header.reset_counter,
            published_ns: header.published_ns,
            loops: message.loops,
            keyframes: message.keyframes,
            seen_again: message.seen_again,
            paths: message.paths,
        });
        // A vehicle that has started anew counts from the beginning.
        if self.path.as_ref().is_some_and(|path| path.sequence >= message.paths) {
            self.path = None;
            self.version += 1;
        }
    }

    /// Applies a corrected path, published or queried; one that was overtaken is ignored.
    pub fn apply_path(&mut self, message: &proto::MapPath) {
        let Some(header) = &message.header else { return };
        if self.path.as_ref().is_some_and(|newest| header.published_ns <= newest.published_ns) {
            return;
        }
        let place = |numbers: &[f32]| [numbers[0], numbers[1], numbers[2]];
        let places = message.poses_m_b.chunks_exact(7).map(place);
        let mut pieces: Vec<Vec<[f32; 3]>> = Vec::new();
        let mut before = None;
        for (at, reset_counter) in places.zip(&message.reset_counters) {
            if before != Some(reset_counter) {
                pieces.push(Vec::new());
            }
            before = Some(reset_counter);
            if let Some(piece) = pieces.last_mut() {
                piece.push(at);
            }
        }
        let ends = message.loops_m.chunks_exact(6).map(|both| [place(&both[..3]), place(&both[3..])]);
        self.path = Some(Path {
            sequence: header.sequence,
            published_ns: header.published_ns,
            pieces,
            loops: ends.collect(),
            drift_m: message.drift_m,
        });
        self.version += 1;
    }

    /// The number of the newest path, where the one that is here is older.
    #[must_use]
    pub fn missing(&self) -> Option<u64> {
        let newest = self.correction?.paths.checked_sub(1)?;
        self.path.as_ref().is_none_or(|path| path.sequence < newest).then_some(newest)
    }

    /// Takes coordinates from the odometry frame after so many resets to the map frame; `None` while that is not known.
    #[must_use]
    pub fn pose_m_o(&self, resets: u32) -> Option<Isometry3<f64>> {
        self.correction.filter(|correction| correction.reset_counter == resets)?.pose_m_o
    }

    /// Pieces of the corrected path: positions of the body in the map, m.
    #[must_use]
    pub fn pieces(&self) -> &[Vec<[f32; 3]>] {
        self.path.as_ref().map_or(&[], |path| &path.pieces)
    }

    /// Loops that count: both ends in the map, m.
    #[must_use]
    pub fn loops(&self) -> &[[[f32; 3]; 2]] {
        self.path.as_ref().map_or(&[], |path| &path.loops)
    }

    /// The map in words, such as "44 keyframes, 21 loops, drift taken out 0.02 m"; `None` where no word of a map has come.
    #[must_use]
    pub fn words(&self, resets: u32) -> Option<String> {
        let Correction { keyframes, loops, seen_again, .. } = self.correction?;
        let count = |n: u32, one: &str, many: &str| format!("{n} {}", if n == 1 { one } else { many });
        let keyframes = count(keyframes, "keyframe", "keyframes");
        if self.pose_m_o(resets).is_none() {
            return Some(format!("{keyframes}, place in the map not known yet"));
        }
        let loops = count(loops, "loop", "loops");
        let drift = self.path.as_ref().and_then(|path| path.drift_m).unwrap_or(0.0);
        Some(match seen_again {
            0 => format!("{keyframes}, no place seen again yet"),
            _ => format!("{keyframes}, {loops}, drift taken out {drift:.2} m"),
        })
    }
}

/// A place of the map as the odometry frame has it.
#[must_use]
pub fn in_odometry(pose_m_o: &Isometry3<f64>, [x, y, z]: [f32; 3]) -> Vector3<f64> {
    pose_m_o.inverse_transform_point(&nalgebra::Point3::new(x.into(), y.into(), z.into())).coords
}

#[cfg(test)]
mod tests {
    use super::*;
    use plumbline_link::net::wire;

    fn correction(published_ns: i64, pose_m_o: Option<Isometry3<f64>>, paths: u64) -> proto::MapCorrection {
        proto::MapCorrection {
            header: Some(proto::Header { published_ns, reset_counter: 1, ..Default::default() }),
            pose_m_o: pose_m_o.as_ref().and_then(wire::pose),
            loops: 1,
            keyframes: 7,
            seen_again: 3,
            paths,
        }
    }

    fn path(published_ns: i64, sequence: u64) -> proto::MapPath {
        proto::MapPath {
            header: Some(proto::Header { published_ns, sequence, ..Default::default() }),
            stamps_ns: vec![1, 2, 3],
            poses_m_b: (0u8..21).map(f32::from).collect(),
            reset_counters: vec![0, 0, 1],
            loops_ns: vec![1, 3],
            loops_m: vec![0.0, 1.0, 2.0, 14.0, 15.0, 16.0],
            drift_m: Some(0.256),
        }
    }

    #[test]
    fn the_map_is_told_in_words_and_not_before_the_place_is_known() {
        let mut map = Corrected::default();
        assert_eq!(map.words(1), None);
        map.apply_correction(&correction(1, None, 0));
        assert_eq!(map.words(1).unwrap(), "7 keyframes, place in the map not known yet");
        map.apply_correction(&correction(2, Some(Isometry3::identity()), 1));
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
        map.apply_correction(&correction(5, None, 3));
        assert_eq!(map.missing(), Some(2));
        map.apply_path(&path(4, 2));
        assert_eq!((map.missing(), map.version), (None, 1));
        map.apply_path(&path(3, 1));
        map.apply_correction(&correction(4, None, 9));
        assert_eq!((map.missing(), map.version), (None, 1));
        // A vehicle that has started anew has another map.
        map.apply_correction(&correction(9, None, 0));
        assert!(map.pieces().is_empty() && map.version == 2);
    }

    #[test]
    fn places_of_the_map_are_brought_to_the_odometry() {
        let pose_m_o =
            Isometry3::new(Vector3::new(1.0, 0.0, 0.0), Vector3::z() * std::f64::consts::FRAC_PI_2);
        assert!((in_odometry(&pose_m_o, [1.0, 2.0, 3.0]) - Vector3::new(2.0, 0.0, 3.0)).norm() < 1e-12);
    }
}
