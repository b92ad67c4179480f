//! Promotion of tracks to landmarks, and the fate of those that do not fit.

use super::TrackMeasurement;
use super::feature::Feature;
use super::landmark::{Landmark, LandmarkStore, Observation};
use super::poses::Poses;
use super::problem::Problem;
use super::triangulate::Triangulation;

/// Fewer points than these, seen by both cameras where a pair is needed, are no start, prove no pose, and do not prove a frame wrong: a
/// few false matches agree with any motion.
pub const MIN_WITNESSES: usize = 12;

fn add_observations<F: Feature>(
    landmark: &mut Landmark<F>,
    frame: u8,
    track: &TrackMeasurement<F::Measurement>,
) {
    for camera in 0..2u8 {
        if let Some(measured) = track.measured[usize::from(camera)] {
            let _ = landmark.observations.push(Observation { frame, camera, measured });
        }
    }
}

/// Hands a frame's measurements to their landmarks; returns how many have one.
pub(super) fn link<F: Feature>(
    store: &mut LandmarkStore<F>,
    frame: u8,
    tracks: &[TrackMeasurement<F::Measurement>],
) -> usize {
    let mut linked = 0;
    for track in tracks {
        if let Some(index) = store.of_track(track.track_id) {
            linked += 1;
            add_observations(&mut store.all_mut()[index], frame, track);
        }
    }
    linked
}

/// New landmarks, hosted by `frame`, for those of its tracks that have none.
pub(super) fn host<F: Feature>(
    store: &mut LandmarkStore<F>,
    frame: usize,
    tracks: &[TrackMeasurement<F::Measurement>],
    guess: impl Fn(&F::Measurement) -> F,
) {
    for track in tracks {
        let Some(host_camera) = (0..2u8).find(|&c| track.measured[usize::from(c)].is_some()) else {
            continue;
        };
        let Some(seen) = &track.measured[usize::from(host_camera)] else { continue };
        if store.of_track(track.track_id).is_some() {
            continue;
        }
        let mut landmark = Landmark {
            track_id: track.track_id,
            host: frame as u8,
            host_camera,
            is_triangulated: false,
            feature: guess(seen),
            observations: heapless::Vec::new(),
        };
        add_observations(&mut landmark, frame as u8, track);
        store.insert(landmark);
    }
}

/// True if a landmark stays after an attempt at triangulation; its track is an outlier if not.
pub(super) fn keep(result: Triangulation, track_id: u32, outliers: &mut Vec<u32>) -> bool {
    let is_good = result != Triangulation::Contradiction;
    if !is_good {
        outliers.push(track_id);
    }
    is_good
}

/// Fit of the newest frame's observations to their landmarks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Verdict {
    /// Observations of landmarks with a depth.
    pub(super) seen: usize,
    /// Observations that do not fit.
    pub(super) wrong: usize,
}

impl Verdict {
    /// Adds the counts of another kind of features.
    pub(super) fn and(self, other: Self) -> Self {
        Self { seen: self.seen + other.seen, wrong: self.wrong + other.wrong }
    }

    /// True if most of enough witnesses contradict: then the frame is wrong, and not the observations.
    pub(super) fn is_mistrial(self) -> bool {
        self.seen >= MIN_WITNESSES && 2 * self.wrong > self.seen
    }
}

/// Judges the observations of the newest frame, with gates that are `slack` times as wide as those of outliers.
pub(super) fn judge_within<F: Feature>(
    store: &LandmarkStore<F>,
    poses: &Poses,
    problem: &Problem<'_>,
    slack: f64,
) -> Verdict {
    let newest = problem.frames.len().saturating_sub(1) as u8;
    let mut verdict = Verdict::default();
    for landmark in store.all().iter().filter(|l| l.is_triangulated && l.host != newest) {
        let placed = poses.placed(landmark);
        for o in landmark.observations.iter().rev().take_while(|o| o.frame == newest) {
            verdict.seen += 1;
            verdict.wrong += usize::from(!fits_within::<F>(poses, problem, &placed, o, slack));
        }
    }
    verdict
}

/// True if an observation lies within `slack` times [`Feature::outlier_sigmas`] of its landmark.
pub(super) fn fits_within<F: Feature>(
    poses: &Poses,
    problem: &Problem<'_>,
    placed: &F::Placed,
    o: &Observation<F::Measurement>,
    slack: f64,
) -> bool {
    let limit = slack * F::outlier_sigmas(problem.options);
    let measured = problem.moved_lenses.moved::<F>(o);
    poses.residual::<F>(problem, placed, (o, &measured)).is_some_and(|r| r.norm_squared() < limit * limit)
}

/// Removes observations that do not fit, and landmarks that are left with less than two views.
pub(super) fn remove_outliers<F: Feature>(
    store: &mut LandmarkStore<F>,
    poses: &Poses,
    problem: &Problem<'_>,
    outliers: &mut Vec<u32>,
) {
    let newest = problem.frames.len().saturating_sub(1) as u8;
    store.retain(|landmark| {
        if !landmark.is_triangulated {
            return true;
        }
        let placed = poses.placed(landmark);
        let Landmark { host, host_camera, track_id, observations, .. } = landmark;
        let mut host_fits = true;
        observations.retain(|o| {
            let stays = fits_within::<F>(poses, problem, &placed, o, 1.0);
            if !stays && o.frame == *host && o.camera == *host_camera {
                host_fits = false;
            } else if !stays && o.frame == newest {
                outliers.push(*track_id);
            }
            stays
        });
        host_fits && observations.len() >= 2
    });
}

/// Forgets what `camera` measured of frame `first` and later ones, and the landmarks that rest on nothing else.
pub(super) fn forget_images<F: Feature>(store: &mut LandmarkStore<F>, camera: u8, first: u8) {
    store.retain(|landmark| {
        let is_host = landmark.host >= first && landmark.host_camera == camera;
        landmark.observations.retain(|o| o.frame < first || o.camera != camera);
        !is_host && !landmark.observations.is_empty()
    });
}

#[cfg(test)]
#[path = "tracks_tests.rs"]
mod tests;
