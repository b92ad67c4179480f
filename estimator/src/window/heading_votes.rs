//! Finding the heading of the Manhattan world.
//!
//! Where an edge is horizontal, its direction is that in which the plane through edge and camera meets the
//! horizontal: `z x n`. Every edge but verticals votes for that heading, modulo 90 degrees; edges along and across
//! one heading vote alike, all others (and edges that are not horizontal) scatter. Votes fade over seconds.

use nalgebra::Vector3;
use plumbline_config::Portable;
use std::f64::consts::FRAC_PI_2;

/// Bins over 90 degrees.
const BINS: usize = 90;
/// A peak is this many bins wide to either side.
const HALF_WIDTH: usize = 1;
/// Share of a vote that remains after a frame: half of it remains after 34 frames.
const MEMORY: f64 = 0.98;
/// A peak with this share of all votes, twelve times that of scattered ones, is a heading ...
const MIN_SHARE: f64 = 0.4;
/// ... when it had it for this many frames in a row ...
const MIN_FRAMES: u32 = 10;
/// ... and its votes weigh this much (an edge of 0.2 rad, 100 px long, that is seen from the side weighs 0.2).
const MIN_VOTES: f64 = 5.0;
/// A heading with less than this share of the votes is out of sight: another one may take its place.
const LOST_SHARE: f64 = 0.07;
/// A plane whose normal has a smaller vertical part is nearly vertical: verticals lie in it as well as horizontal
/// edges, so that it votes for nothing.
const MIN_TILT: f64 = 0.1;
/// A plane whose normal has a smaller horizontal part is nearly horizontal: horizontal edges of all headings lie in
/// it.
const MIN_SLOPE: f64 = 0.2;

/// Votes for headings.
#[derive(Clone, Debug)]
pub struct HeadingVotes {
    votes: [f64; BINS],
    /// Votes times their place in the bin, in bins.
    moments: [f64; BINS],
    total: f64,
    frames: u32,
}

impl Default for HeadingVotes {
    fn default() -> Self {
        Self { votes: [0.0; BINS], moments: [0.0; BINS], total: 0.0, frames: 0 }
    }
}

impl HeadingVotes {
    /// A frame begins: older votes fade.
    pub fn fade(&mut self) {
        for value in self.votes.iter_mut().chain(&mut self.moments) {
            *value *= MEMORY;
        }
        self.total *= MEMORY;
    }

    /// An edge of `length_rad` seen in the plane of unit normal `n_o` (in `O`).
    pub fn vote(&mut self, n_o: &Vector3<f64>, length_rad: f64) {
        let slope = n_o.xy().norm();
        // A plane that is no number votes for nothing: its vote would never fade.
        let has_heading = n_o.z.abs() >= MIN_TILT && slope >= MIN_SLOPE;
        if !has_heading {
            return;
        }
        let place = bins_of(libm::atan2(n_o.x, -n_o.y));
        let bin = (place as usize).min(BINS - 1);
        let weight = length_rad * slope;
        self.votes[bin] += weight;
        self.moments[bin] += weight * (place - bin as f64);
        self.total += weight;
    }

    /// Heading to take instead of `present_rad`, rad modulo 90 degrees; `None` while there is no better one. Call once
    /// a frame.
    pub fn verdict(&mut self, present_rad: Option<f64>) -> Option<f64> {
        let mut best = 0;
        for bin in 1..BINS {
            if self.support(bin) > self.support(best) {
                best = bin;
            }
        }
        let is_peak = self.support(best) > (MIN_SHARE * self.total).at_least(MIN_VOTES);
        let is_lost = present_rad.is_none_or(|heading| {
            let bin = (bins_of(heading) as usize).min(BINS - 1);
            self.support(bin) < LOST_SHARE * self.total
        });
        self.frames = if is_peak && is_lost { self.frames + 1 } else { 0 };
        (self.frames >= MIN_FRAMES).then(|| {
            self.frames = 0;
            self.mean_about(best)
        })
    }

    /// Votes for a bin and its neighbours.
    fn support(&self, bin: usize) -> f64 {
        around(bin).map(|(k, _)| self.votes[k]).sum()
    }

    /// Mean heading of the votes about a bin, rad.
    fn mean_about(&self, bin: usize) -> f64 {
        let moment: f64 = around(bin).map(|(k, offset)| self.votes[k] * offset + self.moments[k]).sum();
        (bin as f64 + moment / self.support(bin)) * FRAC_PI_2 / BINS as f64
    }
}

/// A bin and its neighbours, with their distance in bins.
fn around(bin: usize) -> impl Iterator<Item = (usize, f64)> {
    (0..=2 * HALF_WIDTH).map(move |k| ((bin + BINS + k - HALF_WIDTH) % BINS, k as f64 - HALF_WIDTH as f64))
}

/// A heading modulo 90 degrees, in bins.
fn bins_of(heading_rad: f64) -> f64 {
    heading_rad.rem_euclid(FRAC_PI_2) * (BINS as f64 / FRAC_PI_2)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Normal of the plane through the camera and a horizontal edge of this heading, seen `up` above the horizon.
    fn plane(heading_rad: f64, up: f64) -> Vector3<f64> {
        let along = Vector3::new(libm::cos(heading_rad), libm::sin(heading_rad), 0.0);
        let side = Vector3::new(-along.y, along.x, 0.0);
        along.cross(&(side + Vector3::z() * up)).normalize()
    }

    /// Frames of edges at these headings until there is a verdict; at most `frames`.
    fn watch(votes: &mut HeadingVotes, headings: &[f64], present: Option<f64>, frames: usize) -> Option<f64> {
        (0..frames).find_map(|_| {
            votes.fade();
            for (k, heading) in headings.iter().enumerate() {
                votes.vote(&plane(*heading, 0.4 + 0.05 * k as f64), 0.2);
            }
            votes.verdict(present)
        })
    }

    /// Edges of a room at `heading_rad`, and others at all headings.
    fn room(heading_rad: f64) -> Vec<f64> {
        let mut headings = vec![heading_rad; 5];
        headings.extend([heading_rad + FRAC_PI_2; 5]);
        headings.extend((0..10).map(|k| 0.157 * f64::from(k)));
        headings
    }

    #[test]
    fn edges_along_and_across_one_heading_are_a_manhattan_world() {
        // One of them lies on the seam of the bins.
        for heading in [0.3, 1.2, -0.4, 0.0] {
            let found = watch(&mut HeadingVotes::default(), &room(heading), None, 60).expect("is found");
            let off = (found - heading + 0.5 * FRAC_PI_2).rem_euclid(FRAC_PI_2) - 0.5 * FRAC_PI_2;
            assert!(off.abs() < 0.005, "{heading}: {off} rad off");
        }
    }

    #[test]
    fn scattered_edges_are_none() {
        let headings: Vec<f64> = (0..40).map(|k| 0.618 * f64::from(k)).collect();
        assert_eq!(watch(&mut HeadingVotes::default(), &headings, None, 400), None);
    }

    #[test]
    fn verticals_and_edges_level_with_the_camera_do_not_vote() {
        let mut votes = HeadingVotes::default();
        for _ in 0..100 {
            votes.fade();
            votes.vote(&Vector3::new(0.6, 0.8, 0.0), 0.5);
            votes.vote(&plane(0.3, 0.05), 0.5);
            assert_eq!(votes.verdict(None), None);
        }
    }

    #[test]
    fn another_heading_takes_over_only_when_the_first_is_out_of_sight() {
        let mut votes = HeadingVotes::default();
        let first = watch(&mut votes, &room(0.3), None, 60);
        assert!(first.is_some());
        let mut both = room(0.3);
        both.extend(room(1.0));
        assert_eq!(watch(&mut votes, &both, first, 200), None, "both in sight");
        let second = watch(&mut votes, &room(1.0), first, 400).expect("takes over");
        assert!((second - 1.0).abs() < 0.005);
    }

    #[test]
    fn a_plane_that_is_no_number_votes_for_nothing() {
        let mut votes = HeadingVotes::default();
        for value in [f64::NAN, f64::INFINITY] {
            votes.vote(&Vector3::new(0.3, value, 0.5).normalize(), 0.3);
        }
        assert!(watch(&mut votes, &room(0.3), None, 60).is_some());
    }
}
