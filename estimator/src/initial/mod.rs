//! The first estimate: frames are gathered until position, velocity and gravity are determined.
//!
//! With two cameras scale comes from the baseline: a few frames are enough, whether the vehicle stands or
//! moves ([`stereo`]). With one camera points, motion, gravity and scale are estimated together from a
//! longer window, after the gyroscope's bias and the delay and the readout of the images ([`timing`] with [`turns`], [`mono`]). Either
//! way the window's solver has the last word.

pub mod mono;
pub mod stereo;
pub mod timing;
pub mod turns;

use crate::inertial::Preintegration;
use crate::window::PointTrack;
use crate::window::state::{FrameTime, MAX_FRAMES, Rig};
use nalgebra::{Vector2, Vector3};
use plumbline_config::Timestamp;

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

    /// Appends a frame. Full, another one makes room: see [`Self::thin`].
    pub fn push(
        &mut self,
        time: FrameTime,
        tracks: &[PointTrack],
        motion: Option<Preintegration>,
        gyro_b: Vector3<f64>,
    ) {
        if self.spare.is_empty() {
            self.thin();
        }
        if let Some(mut buffer) = self.spare.pop() {
            buffer.clear();
            buffer.extend_from_slice(tracks);
            buffer.sort_unstable_by_key(|t| t.track_id);
            let motion = if self.frames.is_empty() { None } else { motion };
            self.frames.push(GatheredFrame { time, tracks: buffer, motion, gyro_b });
        }
    }

    /// Drops, of all but the newest [`MAX_FRAMES`], the frame that leaves the shortest interval: at any rate those that stay span the same
    /// time.
    fn thin(&mut self) {
        let interval_ns =
            |k: &usize| self.frames[k + 1].time.stamp.nanos_since(self.frames[k - 1].time.stamp);
        let Some(k) = (1..self.frames.len().saturating_sub(MAX_FRAMES)).min_by_key(interval_ns) else {
            return self.drop_oldest();
        };
        let dropped = self.frames.remove(k);
        self.spare.push(dropped.tracks);
        let next = &mut self.frames[k].motion;
        *next = dropped.motion.zip(next.take()).map(|(before, after)| before.followed_by(&after));
    }

    /// Puts the frames where the offset `time_offset_s` has them, s, and integrates the motions between them anew by `integrated`.
    pub fn retime(&mut self, time_offset_s: f64, integrated: impl Fn([Timestamp; 2]) -> Preintegration) {
        let mut before = None;
        for frame in &mut self.frames {
            frame.time = frame.time.at_offset(time_offset_s);
            frame.motion = before.map(|before| integrated([before, frame.time.stamp]));
            before = Some(frame.time.stamp);
        }
    }

    /// Turns the points from the times of their rows to those of the frames, with a readout that is longer than was known by `step_s`. `row`
    /// says how far down the image of a camera a place is, -1/2 to 1/2.
    pub fn unroll(
        &mut self,
        step_s: f64,
        rig: &Rig,
        bias_gyro: &Vector3<f64>,
        row: impl Fn(usize, &Vector2<f64>) -> f64,
    ) {
        for frame in &mut self.frames {
            let rate_b = frame.gyro_b - bias_gyro;
            for (c, measured) in frame.tracks.iter_mut().flat_map(|t| t.measured.iter_mut().enumerate()) {
                let rate_c = rig.pose_b_c(c).rotation.inverse_transform_vector(&rate_b);
                if let Some(measured) = measured {
                    measured.unroll(row(c, &measured.xy) * step_s, &rate_c);
                }
            }
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

/// The motion from frame `from` to frame `to`; `None` where one between them is not known.
#[must_use]
pub fn joined_motion(frames: &[GatheredFrame], from: usize, to: usize) -> Option<Preintegration> {
    let mut joined = frames.get(from + 1)?.motion.clone()?;
    for frame in &frames[from + 2..=to] {
        joined = joined.followed_by(frame.motion.as_ref()?);
    }
    Some(joined)
}
