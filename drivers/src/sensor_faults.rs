//! Fault injection into sensors that are hit, covered or have their clock set: decorators around any source,
//! as [`crate::FaultySource`] is one for frames that are lost or dark.
//!
//! Times are seconds since the first sample or frame of the stream. Every draw is a pure function of the seed and of the
//! sample's number.

use crate::random::{Draws, Purpose};
use crate::{DriverError, Faults, ImuReading, ImuSource, LostCamera, StereoFrame, StereoSource};
use nalgebra::Vector3;
use plumbline_config::{GrayImage, ImuSample, Timestamp};
use std::ops::Range;

/// Stamps that are wrong for a time.
#[derive(Clone, Debug, PartialEq)]
pub struct ClockFault {
    /// Time span, seconds since the first frame.
    pub span_s: Range<f64>,
    /// Step added to the stamps from then on, s.
    pub step_s: f64,
}

/// Readings that stay what they are.
#[derive(Clone, Debug, PartialEq)]
pub struct StuckFault {
    /// Time span, seconds since the first frame.
    pub span_s: Range<f64>,
    /// Affected axes: gyroscope x, y, z, accelerometer x, y, z.
    pub axes: [bool; 6],
    /// True if they read zero; otherwise they repeat the last reading before the fault.
    pub at_zero: bool,
}

/// Faults of inertial samples.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ImuFaults {
    /// No sample comes.
    pub gaps_s: Vec<Range<f64>>,
    /// Blows or vibration beyond the sensor's range: every reading is at one end of it or at the other.
    pub saturated_s: Option<Range<f64>>,
    /// The ends of the range, rad/s and m/s².
    pub range: [f64; 2],
    /// Readings that stay what they are.
    pub stuck: Option<StuckFault>,
    /// Stamps that are wrong.
    pub clock: Option<ClockFault>,
}

/// Faults of images that still arrive.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ImageFaults {
    /// A lens is covered: the camera delivers, and sees nothing.
    pub covered: Option<LostCamera>,
    /// Pixels are noise.
    pub garbage_s: Option<Range<f64>>,
    /// Fog on both lenses: contrast is left within so many pixels of the middle alone, and fades there.
    pub fog: Option<(Range<f64>, f64)>,
    /// Cameras that deliver their first image of this time again and again.
    pub frozen: Option<(Range<f64>, [bool; 2])>,
    /// Stamps that are wrong.
    pub clock: Option<ClockFault>,
}

/// Grey level of a covered lens, and of fog.
const COVERED_LEVEL: u8 = 2;
const FOG_LEVEL: f64 = 110.0;
/// Share of the clear radius over which contrast fades.
const FOG_EDGE: f64 = 0.5;

fn shifted(stamp: Timestamp, clock: &Option<ClockFault>, time_s: f64) -> Timestamp {
    match clock {
        Some(fault) if fault.span_s.contains(&time_s) => stamp.plus_seconds(fault.step_s),
        _ => stamp,
    }
}

/// An inertial source whose samples meet these faults.
#[derive(Clone, Debug)]
pub struct FaultyImu<S> {
    source: S,
    plan: ImuFaults,
    seed: u64,
    first: Option<Timestamp>,
    missing: u64,
    /// The last readings before they were stuck.
    last: ImuSample,
}

impl<S: ImuSource> FaultyImu<S> {
    /// `source` with `plan`, whose draws are those of `seed`.
    #[must_use]
    pub fn new(source: S, plan: ImuFaults, seed: u64) -> Self {
        let zero = Vector3::zeros();
        let last = ImuSample { stamp: Timestamp::default(), gyro: zero, accel: zero };
        Self { source, plan, seed, first: None, missing: 0, last }
    }

    /// Holds the axes that are stuck at `time_s`.
    fn hold(&mut self, sample: &mut ImuSample, time_s: f64) {
        let Some(stuck) = &self.plan.stuck else { return };
        if !stuck.span_s.contains(&time_s) {
            self.last = *sample;
            return;
        }
        for k in (0..6).filter(|k| stuck.axes[*k]) {
            let (part, last) = match k {
                0..3 => (&mut sample.gyro, &self.last.gyro),
                _ => (&mut sample.accel, &self.last.accel),
            };
            part[k % 3] = if stuck.at_zero { 0.0 } else { last[k % 3] };
        }
    }

    fn saturate(&self, reading: &mut ImuReading) {
        let mut draws = Draws::new(self.seed, Purpose::Blow, reading.sequence);
        let [gyro, accel] = self.plan.range;
        let mut at_an_end =
            |range: f64| Vector3::from_fn(|_, _| if draws.unit() < 0.5 { -range } else { range });
        reading.sample.gyro = at_an_end(gyro);
        reading.sample.accel = at_an_end(accel);
    }
}

impl<S: ImuSource> ImuSource for FaultyImu<S> {
    fn next_reading(&mut self) -> Result<Option<ImuReading>, DriverError> {
        while let Some(mut reading) = self.source.next_reading()? {
            let first = *self.first.get_or_insert(reading.sample.stamp);
            let time_s = reading.sample.stamp.seconds_since(first);
            if self.plan.gaps_s.iter().any(|gap| gap.contains(&time_s)) {
                self.missing += 1;
                continue;
            }
            if self.plan.saturated_s.as_ref().is_some_and(|span| span.contains(&time_s)) {
                self.saturate(&mut reading);
            }
            self.hold(&mut reading.sample, time_s);
            reading.sample.stamp = shifted(reading.sample.stamp, &self.plan.clock, time_s);
            return Ok(Some(reading));
        }
        Ok(None)
    }

    fn faults(&self) -> Faults {
        let theirs = self.source.faults();
        Faults { missing: theirs.missing + self.missing, ..theirs }
    }
}

/// A source of frames whose images meet these faults.
#[derive(Clone, Debug)]
pub struct FaultyImages<S> {
    source: S,
    plan: ImageFaults,
    seed: u64,
    first: Option<Timestamp>,
    /// The images that come again and again.
    frozen: Option<[GrayImage; 2]>,
}

impl<S: StereoSource> FaultyImages<S> {
    /// `source` with `plan`, whose draws are those of `seed`.
    #[must_use]
    pub fn new(source: S, plan: ImageFaults, seed: u64) -> Self {
        Self { source, plan, seed, first: None, frozen: None }
    }

    /// Delivers the first images of the time in which cameras are frozen again.
    fn freeze(&mut self, frame: &mut StereoFrame, time_s: f64) {
        let Some((span, cameras)) = &self.plan.frozen else { return };
        if span.contains(&time_s) {
            let frozen = self.frozen.get_or_insert_with(|| frame.images.clone());
            for camera in (0..2).filter(|camera| cameras[*camera]) {
                frame.images[camera].clone_from(&frozen[camera]);
            }
        }
    }

    fn spoil(&self, frame: &mut StereoFrame, time_s: f64) {
        if let Some(covered) = &self.plan.covered
            && covered.span_s.contains(&time_s)
        {
            frame.images[covered.camera].pixels_mut().fill(COVERED_LEVEL);
        }
        if self.plan.garbage_s.as_ref().is_some_and(|span| span.contains(&time_s)) {
            let mut draws = Draws::new(self.seed, Purpose::Garbage, frame.sequence);
            for image in &mut frame.images {
                image.pixels_mut().iter_mut().for_each(|pixel| *pixel = draws.bits() as u8);
            }
        }
        if let Some((span, radius_px)) = &self.plan.fog
            && span.contains(&time_s)
        {
            frame.images.iter_mut().for_each(|image| fog(image, *radius_px));
        }
    }
}

/// Takes the contrast away, but around the middle.
fn fog(image: &mut GrayImage, radius_px: f64) {
    let (width, height) = (image.width(), image.height());
    let clear = |u: usize, v: usize| {
        let x = u as f64 - 0.5 * width as f64;
        let y = v as f64 - 0.5 * height as f64;
        let beyond = (libm::hypot(x, y) / radius_px - 1.0) / FOG_EDGE;
        1.0 - beyond.clamp(0.0, 1.0)
    };
    for (v, row) in image.pixels_mut().chunks_mut(width.max(1)).enumerate() {
        for (u, pixel) in row.iter_mut().enumerate() {
            let level = FOG_LEVEL + (f64::from(*pixel) - FOG_LEVEL) * clear(u, v);
            *pixel = level.round().clamp(0.0, 255.0) as u8;
        }
    }
}

impl<S: StereoSource> StereoSource for FaultyImages<S> {
    fn next_frame(&mut self, frame: &mut StereoFrame) -> Result<bool, DriverError> {
        if !self.source.next_frame(frame)? {
            return Ok(false);
        }
        let first = *self.first.get_or_insert(frame.stamp);
        let time_s = frame.stamp.seconds_since(first);
        self.spoil(frame, time_s);
        self.freeze(frame, time_s);
        frame.stamp = shifted(frame.stamp, &self.plan.clock, time_s);
        Ok(true)
    }

    fn skip_to(&mut self, stamp: Timestamp) -> u64 {
        self.source.skip_to(stamp)
    }

    fn expected_frames(&self) -> Option<u64> {
        self.source.expected_frames()
    }

    fn faults(&self) -> Faults {
        self.source.faults()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use plumbline_config::ImuSample;

    /// A second of samples at 200 Hz that feel gravity.
    struct Rest(u64);

    impl ImuSource for Rest {
        fn next_reading(&mut self) -> Result<Option<ImuReading>, DriverError> {
            let stamp = Timestamp::from_nanos(7_000_000_000 + self.0 as i64 * 5_000_000);
            let sample = ImuSample { stamp, gyro: Vector3::zeros(), accel: Vector3::new(0.0, 0.0, 9.81) };
            self.0 += 1;
            Ok((self.0 <= 200).then_some(ImuReading { sequence: self.0 - 1, sample }))
        }

        fn faults(&self) -> Faults {
            Faults::default()
        }
    }

    fn readings(plan: ImuFaults, seed: u64) -> (Vec<ImuReading>, Faults) {
        let mut source = FaultyImu::new(Rest(0), plan, seed);
        let mut all = Vec::new();
        while let Some(reading) = source.next_reading().unwrap() {
            all.push(reading);
        }
        (all, source.faults())
    }

    #[test]
    fn samples_are_missing_in_gaps_and_counted() {
        let (all, faults) =
            readings(ImuFaults { gaps_s: vec![0.2..0.25, 0.5..0.7], ..ImuFaults::default() }, 1);
        assert_eq!((all.len(), faults.missing), (150, 50));
        assert!(all.iter().all(|r| !(40..50).contains(&r.sequence) && !(100..140).contains(&r.sequence)));
    }

    #[test]
    fn a_saturated_sensor_is_at_the_ends_of_its_range_and_at_no_other_time() {
        let plan = ImuFaults { saturated_s: Some(0.3..0.6), range: [17.0, 150.0], ..ImuFaults::default() };
        let (all, _) = readings(plan.clone(), 1);
        for reading in &all {
            let ends = reading.sample.gyro.iter().all(|x| x.abs() == 17.0)
                && reading.sample.accel.iter().all(|x| x.abs() == 150.0);
            assert_eq!(ends, (60..120).contains(&reading.sequence), "{reading:?}");
        }
        let sum: Vector3<f64> = all.iter().map(|r| r.sample.gyro).sum();
        assert!(sum.amax() < 17.0 * 30.0, "both ends are met: {sum}");
        assert_eq!(readings(plan.clone(), 1).0, all);
        assert_ne!(readings(plan, 2).0, all);
    }

    #[test]
    fn stuck_axes_hold_what_they_read_last_and_the_others_go_on() {
        let stuck = |at_zero, axes| Some(StuckFault { span_s: 0.5..0.75, axes, at_zero });
        let axes = [false, false, false, true, false, true];
        // The draws of the ends of the range make readings that change.
        let changing =
            ImuFaults { saturated_s: Some(0.0..2.0), range: [17.0, 150.0], ..ImuFaults::default() };
        let (sound, _) = readings(changing.clone(), 1);
        for at_zero in [false, true] {
            let (all, _) = readings(ImuFaults { stuck: stuck(at_zero, axes), ..changing.clone() }, 1);
            for (a, b) in sound.iter().zip(&all) {
                let is_held = (100..150).contains(&a.sequence);
                let held = if at_zero { Vector3::zeros() } else { sound[99].sample.accel };
                let x = if is_held { held.x } else { a.sample.accel.x };
                assert_eq!((b.sample.accel.x, b.sample.accel.y), (x, a.sample.accel.y), "{}", a.sequence);
                assert_eq!(b.sample.gyro, a.sample.gyro);
            }
        }
    }

    #[test]
    fn a_clock_is_wrong_for_a_time() {
        let clock = Some(ClockFault { span_s: 0.5..0.505, step_s: 3600.0 });
        let (all, _) = readings(ImuFaults { clock, ..ImuFaults::default() }, 1);
        for reading in all {
            let due = Timestamp::from_nanos(7_000_000_000 + reading.sequence as i64 * 5_000_000);
            let expected_s = if reading.sequence == 100 { 3600.0 } else { 0.0 };
            assert_eq!(reading.sample.stamp.seconds_since(due), expected_s);
        }
    }

    /// Frames of a checkerboard of single pixels at 20 Hz.
    struct Board(u64);

    impl StereoSource for Board {
        fn next_frame(&mut self, frame: &mut StereoFrame) -> Result<bool, DriverError> {
            frame.sequence = self.0;
            frame.stamp = Timestamp::from_nanos(7_000_000_000 + self.0 as i64 * 50_000_000);
            frame.valid = [true; 2];
            for image in &mut frame.images {
                let shade = (self.0 % 7) as u8;
                let board = |k: usize| if (k + k / 40).is_multiple_of(2) { 40 + shade } else { 200 + shade };
                image.pixels_mut().iter_mut().enumerate().for_each(|(k, pixel)| *pixel = board(k));
            }
            self.0 += 1;
            Ok(self.0 <= 40)
        }

        fn expected_frames(&self) -> Option<u64> {
            Some(40)
        }

        fn faults(&self) -> Faults {
            Faults::default()
        }
    }

    fn frames(plan: ImageFaults) -> Vec<StereoFrame> {
        let mut source = FaultyImages::new(Board(0), plan, 1);
        let mut frame = StereoFrame::new([(40, 30); 2]);
        let mut all = Vec::new();
        while source.next_frame(&mut frame).unwrap() {
            all.push(frame.clone());
        }
        all
    }

    #[test]
    fn a_covered_lens_delivers_darkness_and_the_other_one_sees() {
        let covered = Some(LostCamera { camera: 0, span_s: 0.5..1.0 });
        for frame in frames(ImageFaults { covered, ..ImageFaults::default() }) {
            let dark =
                frame.images.each_ref().map(|image| image.pixels().iter().all(|p| *p == COVERED_LEVEL));
            assert_eq!((dark, frame.valid), ([(10..20).contains(&frame.sequence), false], [true; 2]));
        }
    }

    #[test]
    fn a_frozen_camera_repeats_an_image_and_the_other_one_sees() {
        let sound = frames(ImageFaults::default());
        let frozen =
            frames(ImageFaults { frozen: Some((0.5..1.0, [true, false])), ..ImageFaults::default() });
        for (k, (a, b)) in sound.iter().zip(&frozen).enumerate() {
            let left = if (10..20).contains(&k) { &sound[10] } else { a };
            assert!(b.images[0] == left.images[0] && b.images[1] == a.images[1], "{k}");
        }
    }

    #[test]
    fn garbage_is_like_nothing_and_the_same_every_time() {
        let plan = ImageFaults { garbage_s: Some(0.5..0.55), ..ImageFaults::default() };
        let sound = frames(ImageFaults::default());
        let spoiled = frames(plan.clone());
        for (k, (a, b)) in sound.iter().zip(&spoiled).enumerate() {
            assert_eq!(a.images == b.images, k != 10, "{k}");
        }
        assert_ne!(spoiled[10].images[0], spoiled[10].images[1]);
        assert!(frames(plan)[10].images == spoiled[10].images);
    }

    #[test]
    fn fog_leaves_the_middle() {
        let seen = frames(ImageFaults { fog: Some((0.5..1.0, 6.0)), ..ImageFaults::default() });
        let contrast = |frame: &StereoFrame, u: usize, v: usize| {
            let pixels = frame.images[0].pixels();
            pixels[v * 40 + u].abs_diff(pixels[v * 40 + u + 1])
        };
        assert_eq!((contrast(&seen[5], 2, 2), contrast(&seen[5], 20, 15)), (160, 160));
        assert_eq!((contrast(&seen[12], 2, 2), contrast(&seen[12], 20, 15)), (0, 160));
    }
}
