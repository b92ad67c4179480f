//! Fault injection into a stream of finished frames: a decorator around any source of frames, recorded,
//! simulated or live.
//!
//! Every draw is a pure function of the seed and of the frame's number, so the same frames meet the same fate however
//! they come.

use crate::random::{Draws, Purpose};
use crate::{DriverError, Faults, StereoFrame, StereoSource};
use plumbline_config::{Portable, Timestamp};
use std::ops::Range;

/// Gain of an image never falls below this.
const MIN_GAIN: f64 = 0.05;

/// A camera that delivers nothing for a time.
#[derive(Clone, Debug, PartialEq)]
pub struct LostCamera {
    /// 0 for the left one, 1 for the right one.
    pub camera: usize,
    /// Time span, seconds since the first frame.
    pub span_s: Range<f64>,
}

/// Faults of frames. Times are seconds since the first frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FrameFaults {
    /// Probability that a frame (both images) is lost.
    pub drop_probability: f64,
    /// A camera that is silent.
    pub lost_camera: Option<LostCamera>,
    /// Both images are black.
    pub blackout_s: Option<Range<f64>>,
    /// Standard deviation of the gain from frame to frame, relative.
    pub flicker: f64,
}

impl FrameFaults {
    /// True if there are no faults.
    #[must_use]
    pub fn is_none(&self) -> bool {
        *self == Self::default()
    }

    fn drops(&self, seed: u64, sequence: u64) -> bool {
        self.drop_probability > 0.0
            && Draws::new(seed, Purpose::Drop, sequence).unit() < self.drop_probability
    }

    /// Gain of a frame; 1 leaves it as it is.
    fn gain(&self, seed: u64, sequence: u64, time_s: f64) -> f64 {
        if self.blackout_s.as_ref().is_some_and(|span| span.contains(&time_s)) {
            return 0.0;
        }
        match self.flicker > 0.0 {
            true => {
                let jump = self.flicker * Draws::new(seed, Purpose::Flicker, sequence).normal();
                (1.0 + jump).at_least(MIN_GAIN)
            }
            false => 1.0,
        }
    }
}

/// A source whose frames meet these faults.
#[derive(Clone, Debug)]
pub struct FaultySource<S> {
    source: S,
    plan: FrameFaults,
    seed: u64,
    first: Option<Timestamp>,
    faults: Faults,
}

impl<S: StereoSource> FaultySource<S> {
    /// `source` with `plan`, whose draws are those of `seed`.
    #[must_use]
    pub fn new(source: S, plan: FrameFaults, seed: u64) -> Self {
        Self { source, plan, seed, first: None, faults: Faults::default() }
    }

    fn lose_camera(&mut self, frame: &mut StereoFrame, time_s: f64) {
        if let Some(lost) = &self.plan.lost_camera
            && lost.span_s.contains(&time_s)
        {
            let was_pair = frame.valid == [true; 2];
            frame.valid[lost.camera] = false;
            self.faults.unpaired += u64::from(was_pair);
        }
    }
}

impl<S: StereoSource> StereoSource for FaultySource<S> {
    fn next_frame(&mut self, frame: &mut StereoFrame) -> Result<bool, DriverError> {
        while self.source.next_frame(frame)? {
            let first = *self.first.get_or_insert(frame.stamp);
            if self.plan.drops(self.seed, frame.sequence) {
                self.faults.missing += 1;
                continue;
            }
            let time_s = frame.stamp.seconds_since(first);
            self.lose_camera(frame, time_s);
            let gain = self.plan.gain(self.seed, frame.sequence, time_s);
            if gain != 1.0 {
                frame.images.iter_mut().for_each(|image| expose(image.pixels_mut(), gain));
            }
            return Ok(true);
        }
        Ok(false)
    }

    fn skip_to(&mut self, stamp: Timestamp) -> u64 {
        self.source.skip_to(stamp)
    }

    fn expected_frames(&self) -> Option<u64> {
        self.source.expected_frames()
    }

    fn faults(&self) -> Faults {
        let (theirs, ours) = (self.source.faults(), self.faults);
        Faults { missing: theirs.missing + ours.missing, unpaired: theirs.unpaired + ours.unpaired, ..theirs }
    }
}

fn expose(pixels: &mut [u8], gain: f64) {
    for pixel in pixels {
        *pixel = (f64::from(*pixel) * gain).round().clamp(0.0, 255.0) as u8;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Frames of 4x2 grey pixels at 20 Hz.
    struct Grey(u64);

    impl StereoSource for Grey {
        fn next_frame(&mut self, frame: &mut StereoFrame) -> Result<bool, DriverError> {
            frame.sequence = self.0;
            frame.stamp = Timestamp::from_nanos(7_000_000_000 + self.0 as i64 * 50_000_000);
            frame.valid = [true; 2];
            frame.images.iter_mut().for_each(|image| image.pixels_mut().fill(100));
            self.0 += 1;
            Ok(self.0 <= 200)
        }

        fn expected_frames(&self) -> Option<u64> {
            Some(200)
        }

        fn faults(&self) -> Faults {
            Faults { missing: 1, corrupt: 2, ..Faults::default() }
        }
    }

    /// Number, validity and first grey level of every frame; the faults.
    fn frames(plan: FrameFaults, seed: u64) -> (Vec<(u64, [bool; 2], u8)>, Faults) {
        let mut source = FaultySource::new(Grey(0), plan, seed);
        let mut frame = StereoFrame::new([(4, 2); 2]);
        let mut seen = Vec::new();
        while source.next_frame(&mut frame).unwrap() {
            assert!(frame.images[1].pixels().iter().all(|p| *p == frame.images[0].pixels()[0]));
            seen.push((frame.sequence, frame.valid, frame.images[0].pixels()[0]));
        }
        (seen, source.faults())
    }

    #[test]
    fn without_a_plan_frames_pass_unchanged() {
        let (seen, faults) = frames(FrameFaults::default(), 1);
        assert!(seen.len() == 200 && seen.iter().all(|(_, valid, grey)| *valid == [true; 2] && *grey == 100));
        assert_eq!((faults.missing, faults.corrupt), (1, 2));
    }

    #[test]
    fn frames_are_lost_by_the_seed_and_counted() {
        let plan = FrameFaults { drop_probability: 0.3, ..FrameFaults::default() };
        let (seen, faults) = frames(plan.clone(), 1);
        assert!((100..180).contains(&seen.len()), "{}", seen.len());
        assert_eq!(faults.missing, 1 + 200 - seen.len() as u64);
        assert_eq!(frames(plan.clone(), 1).0, seen);
        assert_ne!(frames(plan, 2).0, seen);
    }

    #[test]
    fn a_camera_is_silent_and_images_are_black_when_they_should_be() {
        let lost = LostCamera { camera: 1, span_s: 1.0..2.0 };
        let plan =
            FrameFaults { lost_camera: Some(lost), blackout_s: Some(3.0..3.5), ..FrameFaults::default() };
        let (seen, faults) = frames(plan, 1);
        for (number, valid, grey) in seen {
            assert_eq!(valid, [true, !(20..40).contains(&number)], "{number}");
            assert_eq!(grey == 0, (60..70).contains(&number), "{number}");
        }
        assert_eq!(faults.unpaired, 20);
    }

    #[test]
    fn flicker_changes_the_exposure_from_frame_to_frame() {
        let (seen, _) = frames(FrameFaults { flicker: 0.15, ..FrameFaults::default() }, 1);
        let mean = seen.iter().map(|(.., grey)| f64::from(*grey)).sum::<f64>() / 200.0;
        let variance = seen.iter().map(|(.., grey)| (f64::from(*grey) - mean).powi(2)).sum::<f64>() / 200.0;
        assert!((mean - 100.0).abs() < 4.0 && (10.0..20.0).contains(&variance.sqrt()), "{mean} {variance}");
    }
}
