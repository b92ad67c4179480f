//! State of one tracked point.

use super::template::{ReferencePatch, Refinement};
use crate::image::Pyramid;
use nalgebra::{Matrix2, Vector2};

/// Share of the way to its rival within which a point is looked for.
pub(super) const RIVAL_SHARE: f64 = 0.45;
/// Random walk of the flow from frame to frame, px.
const FLOW_SIGMA_PX: f32 = 0.1;

/// Inverse depth of a track in the previous image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Depth {
    /// 1/m.
    pub rho: f64,
    /// Standard deviation, 1/m.
    pub sigma: f64,
}

/// All tracks, in order of their ids, and their reference patches, which stay where they are while
/// tracks come and go. Preallocated.
#[derive(Clone, Debug)]
pub(super) struct TrackStore {
    pub tracks: Vec<Track>,
    pub references: Vec<ReferencePatch>,
    free: Vec<usize>,
    next_id: u32,
}

impl TrackStore {
    /// Room for `capacity` tracks.
    pub fn new(capacity: usize) -> Self {
        Self {
            tracks: Vec::with_capacity(capacity),
            references: vec![ReferencePatch::empty(); capacity],
            free: (0..capacity).rev().collect(),
            next_id: 0,
        }
    }

    /// Begins a track with the surroundings of `px` as its reference; `None` when there is no room, or no
    /// image at `px`.
    pub fn begin(&mut self, pyramid: &Pyramid, px: &Vector2<f32>) -> Option<&mut Track> {
        let slot = *self.free.last()?;
        self.references[slot].store(pyramid, px).then_some(())?;
        self.free.pop();
        self.tracks.push(Track::new(self.next_id, slot));
        self.next_id = self.next_id.wrapping_add(1);
        self.tracks.last_mut()
    }

    /// Removes the tracks that are marked lost.
    pub fn sweep(&mut self) {
        let free = &mut self.free;
        self.tracks.retain(|t| {
            if t.lost {
                free.push(t.slot);
            }
            !t.lost
        });
    }

    /// Removes all tracks; their ids are not used again.
    pub fn clear(&mut self) {
        self.tracks.iter_mut().for_each(|t| t.lost = true);
        self.sweep();
    }

    /// Every track with its reference patch.
    pub fn iter_mut(&mut self) -> impl Iterator<Item = (&mut Track, &ReferencePatch)> {
        let references = &self.references;
        self.tracks.iter_mut().map(|t| {
            let slot = t.slot;
            (t, &references[slot])
        })
    }
}

/// One point, followed from frame to frame.
#[derive(Clone, Copy, Debug)]
pub(super) struct Track {
    /// Unique id.
    pub id: u32,
    /// Frames in which it was seen.
    pub age: u32,
    /// Pixel in the newest image of each camera, where seen.
    pub px: [Option<Vector2<f64>>; 2],
    /// Normalized coordinates in the newest image of each camera, where seen.
    pub xy: [Option<Vector2<f64>>; 2],
    /// Takes offsets in the reference patch to offsets in each camera's newest image.
    pub warp: [Matrix2<f32>; 2],
    /// Covariance of each pixel against the reference patch, px².
    pub covariance_px2: [Matrix2<f32>; 2],
    /// Flow that the rotation did not explain, px per frame, in each camera.
    pub flow_px: [Vector2<f64>; 2],
    /// Place of its reference patch in the store.
    pub slot: usize,
    /// Frames in a row in which the reference was not recognised.
    pub strange: u32,
    /// Depth and remaining offset of the last stereo match.
    pub stereo: Option<StereoMemory>,
    /// Inverse depth in the previous image, while points are predicted.
    pub depth: Option<Depth>,
    /// Distance to the nearest place that looked the same when it began, px, if there was one.
    pub rival_px: Option<f32>,
    /// True if such places were looked for.
    pub is_looked_at: bool,
    /// True if it was found well within the search around its predicted place, false at the rim or not; `None` without one.
    pub was_predicted: Option<bool>,
    /// Frames in a row without the left camera, though it delivered.
    pub without_left: u32,
    /// Camera by which it was followed into this frame, with where it was before (normalized).
    pub came_by: Option<(usize, Vector2<f64>)>,
    /// Not to be kept beyond this frame.
    pub lost: bool,
}

/// Memory of a stereo match for the next frame.
#[derive(Clone, Copy, Debug)]
pub(super) struct StereoMemory {
    /// Inverse depth, 1/m.
    pub inverse_depth: f64,
    /// Change of the inverse depth over the last frame, 1/m.
    pub change: f64,
    /// Matched pixel minus the pixel that the inverse depth predicts: the rig's error at this place.
    pub offset_px: Vector2<f64>,
}

impl Track {
    /// A track just begun, not yet seen anywhere.
    fn new(id: u32, slot: usize) -> Self {
        Self {
            id,
            age: 1,
            px: [None; 2],
            xy: [None; 2],
            warp: [Matrix2::identity(); 2],
            covariance_px2: [Matrix2::zeros(); 2],
            flow_px: [Vector2::zeros(); 2],
            slot,
            strange: 0,
            stereo: None,
            depth: None,
            rival_px: None,
            is_looked_at: false,
            was_predicted: None,
            without_left: 0,
            came_by: None,
            lost: false,
        }
    }

    /// Normalized coordinates in the camera by which the track came into this frame, before and now; `None` for the other
    /// camera.
    pub fn step_in(&self, camera: usize) -> Option<(Vector2<f64>, Vector2<f64>)> {
        let (by, before) = self.came_by?;
        (by == camera).then_some((before, self.xy[camera]?))
    }

    /// The point is where the reference is seen again.
    pub fn recognise(&mut self, camera: usize, refined: &Refinement) {
        self.px[camera] = Some(refined.px.cast());
        self.warp[camera] = refined.warp;
        self.covariance_px2[camera] = refined.covariance_px2;
        self.strange = 0;
    }

    /// The point is where the flow leads, though the reference is not seen there.
    pub fn flow(&mut self, camera: usize, px: &Vector2<f32>, warp: Matrix2<f32>) {
        self.px[camera] = Some(px.cast());
        self.warp[camera] = warp;
        self.covariance_px2[camera] += Matrix2::identity() * (FLOW_SIGMA_PX * FLOW_SIGMA_PX);
        self.strange += 1;
    }

    /// Forgets where a camera saw the point.
    pub fn unsee(&mut self, camera: usize) {
        self.px[camera] = None;
        self.xy[camera] = None;
    }
}
