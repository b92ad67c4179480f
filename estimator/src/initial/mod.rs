//! The first estimate: frames are gathered until position, velocity and gravity are determined.
//!
//! With two cameras scale comes from the baseline: a few frames are enough, whether the vehicle stands or
//! moves. With one camera points, motion, gravity and scale are estimated together from a
//! longer window, after the gyroscope's bias and the delay and the readout of the images ([`timing`] with [`turns`], [`mono`]). Either
//! way the window's solver has the last word.

pub mod mono;
pub mod timing;
pub mod turns;

use crate::window::PointTrack;
use crate::window::state::{FrameTime, MAX_FRAMES};
use nalgebra::Vector3;
use plumbline_config::Timestamp;

/// Frames that are gathered: those of a window, and for longer starts as many again and a half.
pub const GATHERED_FRAMES: usize = 40;

/// Tilt taken from the specific force, rad: a vehicle that accelerates by 5 m/s² leans by as much.
pub const TILT_SIGMA_RAD: f64 = 0.5;
/// Nothing is known of the velocity; vehicles are no faster than this, m/s.
pub const VELOCITY_SIGMA_M_S: f64 = 20.0;

/// A frame that waits for the first estimate.
#[derive(Clone, Debug)]
pub struct GatheredFrame {
    /// Time of the frame.
    pub time: FrameTime,
    /// Points seen, in order of track.
    pub tracks: Vec<PointTrack>,
    /// Reading of the gyroscope at the stamp, bias included, rad/s.
    pub gyro_b: Vector3<f64>,
}

/// The newest frames before the first estimate, in fixed memory; inertial samples have come throughout between them.
#[derive(Clone, Debug)]
pub struct Gathering {
    frames: Vec<GatheredFrame>,
    spare: Vec<Vec<PointTrack>>,
}

impl Gathering {
    /// Frames of `points` each, at most.
    pub fn new(points: usize) -> Self {
        Self {
            frames: Vec::with_capacity(GATHERED_FRAMES),
            spare: (0..GATHERED_FRAMES).map(|_| Vec::with_capacity(points)).collect(),
        }
    }

    /// Appends a frame. Full, another one makes room: of all but the newest [`MAX_FRAMES`], that which leaves the shortest interval. At any
    /// rate those that stay span the same time.
    pub fn push(&mut self, time: FrameTime, tracks: &[PointTrack], gyro_b: Vector3<f64>) {
        if self.spare.is_empty() {
            let frames = &self.frames;
            let interval_ns = |k: &usize| frames[k + 1].time.stamp.nanos_since(frames[k - 1].time.stamp);
            let shortest = (1..frames.len().saturating_sub(MAX_FRAMES)).min_by_key(interval_ns);
            self.drop(shortest.unwrap_or(0));
        }
        if let Some(mut buffer) = self.spare.pop() {
            buffer.clear();
            buffer.extend_from_slice(tracks);
            buffer.sort_unstable_by_key(|t| t.track_id);
            self.frames.push(GatheredFrame { time, tracks: buffer, gyro_b });
        }
    }

    /// Puts the frames where the offset `time_offset_s` has them, s; `gyro_b` gives the reading of the gyroscope there, rad/s.
    pub fn retime(&mut self, time_offset_s: f64, gyro_b: impl Fn(Timestamp) -> Vector3<f64>) {
        for frame in self.frames.iter_mut().filter(|frame| frame.time.time_offset_s != time_offset_s) {
            frame.time = frame.time.by_offset(time_offset_s);
            frame.gyro_b = gyro_b(frame.time.stamp);
        }
    }

    /// Forgets a frame.
    pub fn drop(&mut self, frame: usize) {
        self.spare.push(self.frames.remove(frame).tracks);
    }

    /// Leaves out what `camera` measured.
    pub fn leave_out(&mut self, camera: usize) {
        for frame in &mut self.frames {
            frame.tracks.retain_mut(|track| track.leave_out(camera));
        }
    }

    /// Forgets everything.
    pub fn clear(&mut self) {
        self.spare.extend(self.frames.drain(..).map(|frame| frame.tracks));
    }

    /// The frames in order of time.
    pub fn frames(&self) -> &[GatheredFrame] {
        &self.frames
    }

    /// Time from the first to the newest frame, s.
    pub fn span_s(&self) -> f64 {
        match &self.frames[..] {
            [first, .., last] => last.time.stamp.seconds_since(first.time.stamp),
            _ => 0.0,
        }
    }
}

/// The measurement of a track in a frame; `None` where it was not seen.
pub fn find_track(frame: &GatheredFrame, track_id: u32) -> Option<&PointTrack> {
    frame.tracks.binary_search_by_key(&track_id, |t| t.track_id).ok().map(|k| &frame.tracks[k])
}
