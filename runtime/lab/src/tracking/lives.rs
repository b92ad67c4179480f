//! Lives of tracks: how many frames each is seen.

use super::{Spread, Tracks};
use plumbline_flight::schedule::times::Times;

/// Tracks of one kind, in fixed memory.
#[derive(Clone, Debug)]
pub(super) struct Lives {
    /// Tracks of the newest frame and their ages, in order of their ids.
    alive: Vec<(u32, u32)>,
    before: Vec<(u32, u32)>,
    ended: Times,
    frames: u64,
    seen: u64,
    stereo: u64,
}

impl Lives {
    /// Room for so many tracks in a frame.
    pub(super) fn with_room_for(tracks: usize) -> Self {
        let room = || Vec::with_capacity(tracks);
        Self { alive: room(), before: room(), ended: Times::of_ms(), frames: 0, seen: 0, stereo: 0 }
    }

    /// Takes a frame: id, age in frames and whether both cameras see it, in order of the ids.
    pub(super) fn frame(&mut self, tracks: impl Iterator<Item = (u32, u32, bool)>) {
        std::mem::swap(&mut self.alive, &mut self.before);
        self.alive.clear();
        self.frames += 1;
        for (id, age, is_stereo) in tracks {
            self.seen += 1;
            self.stereo += u64::from(is_stereo);
            if self.alive.len() < self.alive.capacity() {
                self.alive.push((id, age));
            }
        }
        for (id, age) in &self.before {
            if self.alive.binary_search_by_key(id, |track| track.0).is_err() {
                self.ended.record(f64::from(*age));
            }
        }
    }

    /// Figures of all frames; tracks that live on end here.
    pub(super) fn figures(&self) -> Tracks {
        let mut ended = self.ended.clone();
        self.alive.iter().for_each(|(_, age)| ended.record(f64::from(*age)));
        let per_frame = |sum: u64| sum as f64 / self.frames.max(1) as f64;
        Tracks { per_frame: per_frame(self.seen), stereo: per_frame(self.stereo), frames: Spread::of(&ended) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_track_ends_with_its_last_frame_or_the_flight() {
        let mut lives = Lives::with_room_for(8);
        for k in 1..=10 {
            // One of ten frames, and a new one in each.
            lives.frame([(0, k, true), (k, 1, false)].into_iter());
        }
        let figures = lives.figures();
        assert_eq!((figures.per_frame, figures.stereo), (2.0, 1.0));
        let spread = figures.frames.unwrap();
        assert!((spread.median - 1.0).abs() < 0.01, "{spread:?}");
        assert!((lives.ended.count(), Lives::with_room_for(1).figures().frames) == (9, None));
    }
}
