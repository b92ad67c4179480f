//! The first estimate: frames are gathered until position, velocity and gravity are determined.
//!
//! With two cameras scale comes from the baseline: a few frames are enough, whether the vehicle stands or
//! moves ([`stereo`]). With one camera points, motion, gravity and scale are estimated together from a
//! longer window, after the gyroscope's bias ([`gyro_bias`], [`mono`]). Either way the window's solver
//! has the last word.

pub mod gyro_bias;
pub mod mono;
pub mod stereo;

use crate::inertial::Preintegration;
use crate::window::PointTrack;
use crate::window::state::FrameTime;
use nalgebra::Vector3;

/// A frame that waits for the first estimate.
#[derive(Clone, Debug)]
pub struct GatheredFrame {
    /// Time of the frame.
    pub time: FrameTime,
    /// Points seen, in order of track.
    pub tracks: Vec<PointTrack>,
    /// Motion since the frame before, integrated without biases; `None` for the first.
    pub motion: Option<Preintegration>,
    /// Reading of the gyroscope at the stamp, bias included, rad/s.
    pub gyro_b: Vector3<f64>,
}

/// The memory of a start with one camera, allocated once.
#[derive(Clone, Debug)]
pub struct MonoWorkspace {
    /// Workspace of the gyroscope bias.
    pub gyro_bias: gyro_bias::BiasWorkspace,
    /// Workspace of velocity, gravity and scale.
    pub alignment: mono::AlignmentWorkspace,
}

impl MonoWorkspace {
    /// Room for `frames` of `points` each.
    #[must_use]
    pub fn new(frames: usize, points: usize) -> Self {
        Self {
            gyro_bias: gyro_bias::BiasWorkspace::new(frames, points),
            alignment: mono::AlignmentWorkspace::new(frames, points),
        }
    }
}

/// The newest frames before the first estimate, in fixed memory.
#[derive(Clone, Debug)]
pub struct Gathering {
    frames: Vec<GatheredFrame>,
    spare: Vec<Vec<PointTrack>>,
}

impl Gathering {
    /// Room for `frames` of `points`.
    #[must_use]
    pub fn new(frames: usize, points: usize) -> Self {
        Self {
            frames: Vec::with_capacity(frames),
            spare: (0..frames).map(|_| Vec::with_capacity(points)).collect(),
        }
    }

    /// Appends a frame; full, the oldest goes.
    pub fn push(
        &mut self,
        time: FrameTime,
        tracks: &[PointTrack],
        motion: Option<Preintegration>,
        gyro_b: Vector3<f64>,
    ) {
        if self.spare.is_empty() {
            self.drop_oldest();
        }
        if let Some(mut buffer) = self.spare.pop() {
            buffer.clear();
            buffer.extend_from_slice(tracks);
            buffer.sort_unstable_by_key(|t| t.track_id);
            let motion = if self.frames.is_empty() { None } else { motion };
            self.frames.push(GatheredFrame { time, tracks: buffer, motion, gyro_b });
        }
    }

    /// Forgets the oldest frame.
    pub fn drop_oldest(&mut self) {
        if !self.frames.is_empty() {
            self.spare.push(self.frames.remove(0).tracks);
            if let Some(first) = self.frames.first_mut() {
                first.motion = None;
            }
        }
    }

    /// Leaves out what `camera` measured.
    pub fn leave_out(&mut self, camera: usize) {
        for frame in &mut self.frames {
            frame.tracks.retain_mut(|track| track.leave_out(camera));
        }
    }

    /// Forgets everything.
    pub fn clear(&mut self) {
        while !self.frames.is_empty() {
            self.drop_oldest();
        }
    }

    /// The frames in order of time.
    #[must_use]
    pub fn frames(&self) -> &[GatheredFrame] {
        &self.frames
    }

    /// Time from the first to the newest frame, s.
    #[must_use]
    pub fn span_s(&self) -> f64 {
        match (self.frames.first(), self.frames.last()) {
            (Some(first), Some(last)) => last.time.stamp.seconds_since(first.time.stamp),
            _ => 0.0,
        }
    }
}

/// The measurement of a track in a frame; `None` where it was not seen.
#[must_use]
pub fn find_track(frame: &GatheredFrame, track_id: u32) -> Option<&PointTrack> {
    frame.tracks.binary_search_by_key(&track_id, |t| t.track_id).ok().map(|k| &frame.tracks[k])
}
