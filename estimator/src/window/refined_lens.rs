//! Observations under intrinsics that are refined: their derivatives, and how they follow ([`super::lens`]).

use super::camera_poses::CameraPose;
use super::camera_sums::LensRows;
use super::feature::Feature;
use super::landmark::{LandmarkStore, Observation};
use super::lens::{Lens, Lenses};
use super::motions::LENS;
use super::state::{INTRINSICS_DIM, Rig};
use super::{HostedLine, InversePoint, LineTrack, PointTrack, TrackMeasurement, Window};
use nalgebra::{Vector2, Vector3};

/// Difference from the reference that measurements do not follow, in focal lengths: a ten thousandth of a pixel.
const SMALL_STEP: f64 = 2e-7;

impl Lenses {
    /// Derivatives of both residuals of an observation by the intrinsics of its camera.
    #[inline]
    pub(super) fn derivatives<F: Feature>(
        &self,
        camera: usize,
        placed: &F::Placed,
        target: &CameraPose,
        measured: &F::Measurement,
    ) -> Option<LensRows> {
        let lens = &self.lenses[camera];
        let by = F::by_places(placed, target, measured)?;
        let places = F::places(measured);
        Some(std::array::from_fn(|d| {
            let of_place = lens.at(&places[d]);
            let mut row = [0.0; LENS];
            for k in 0..INTRINSICS_DIM {
                row[k] = -(by[d].x * f64::from(of_place[(0, k)]) + by[d].y * f64::from(of_place[(1, k)]));
            }
            row
        }))
    }

    /// Corrects what has been measured of tracks by the configured intrinsics.
    fn correct<F: Feature>(&self, tracks: &mut [TrackMeasurement<F::Measurement>]) {
        for track in tracks {
            for (camera, measured) in track.measured.iter_mut().enumerate() {
                let shift = |xy: &Vector2<f64>| self.shift(camera, xy, &self.reference[camera]);
                measured.iter_mut().for_each(|m| F::move_all_places(m, shift));
            }
        }
    }

    /// Moves the observations of all landmarks by steps of the intrinsics.
    fn move_all<F: Feature>(&self, store: &mut LandmarkStore<F>, steps: &[Vector3<f64>; 2]) {
        for observation in store.all_mut().iter_mut().flat_map(|landmark| &mut landmark.observations) {
            let camera = usize::from(observation.camera);
            F::move_all_places(&mut observation.measured, |xy| self.shift(camera, xy, &steps[camera]));
        }
    }
}

/// A lens, and the step of its intrinsics from the reference.
type MovedLens<'a> = (&'a Lens, Vector3<f64>);

/// Lenses of both cameras whose intrinsics have moved from the reference; `None` where they have not.
#[derive(Clone, Copy, Debug)]
pub struct MovedLenses<'a>([Option<MovedLens<'a>>; 2]);

impl<'a> MovedLenses<'a> {
    /// Lenses that have moved with the present intrinsics of `rig`.
    pub(super) fn of(lenses: Option<&'a Lenses>, rig: &Rig) -> Self {
        Self([0, 1].map(|camera| {
            let lenses = lenses?;
            let step = lenses.step(rig, camera);
            let has_moved = step.iter().any(|x| *x != 0.0);
            lenses.lenses.get(camera).filter(|_| has_moved).map(|lens| (lens, step))
        }))
    }

    /// What was measured by the present intrinsics.
    #[inline(always)]
    pub(super) fn moved<F: Feature>(&self, observation: &Observation<F::Measurement>) -> F::Measurement {
        let mut moved = observation.measured;
        if let Some((lens, step)) = &self.0[usize::from(observation.camera)] {
            F::move_places(&mut moved, |xy| lens.shift(xy, step));
        }
        moved
    }
}

impl Window {
    /// Corrects what has been measured by the configured intrinsics.
    pub fn correct_intrinsics(&self, points: &mut [PointTrack], lines: &mut [LineTrack]) {
        let Some(lenses) = &self.options.lenses else { return };
        lenses.correct::<InversePoint>(points);
        lenses.correct::<HostedLine>(lines);
    }

    /// Measurements follow the refined intrinsics.
    pub(super) fn follow_lenses(&mut self) {
        let Self { rig, points, lines, options, .. } = self;
        let Some(lenses) = &mut options.lenses else { return };
        let steps = [0, 1].map(|k| lenses.step(rig, k));
        if steps.iter().flatten().any(|x| x.abs() > SMALL_STEP) {
            lenses.move_all(points, &steps);
            lenses.move_all(lines, &steps);
            lenses.reference = rig.intrinsics;
        }
    }

    /// The window is empty: what it will measure is corrected by the refined intrinsics.
    pub(super) fn refer_lenses(&mut self) {
        if let Some(lenses) = &mut self.options.lenses {
            lenses.reference = self.rig.intrinsics;
        }
    }
}
