//! From two sensor streams to estimates and odometry, in one order, at any speed.
//!
//! The order is by measurement time: inertial samples up to the time a frame needs, then the frame. The
//! estimate of the frame at time `t` corrects the odometry just before the first inertial sample at or
//! after `t` + [`CORRECTION_DELAY_NS`], however early it was ready; so replay at full speed and at 1x hand
//! out the same odometry, bit for bit. Nothing here reads a clock but the pace and the stopwatches, and
//! neither reaches an estimate.

pub mod clock;
pub mod digest;
pub mod figures;
pub mod orders;
pub mod tap;

use crate::alloc;
use clock::Pace;
use digest::Digest;
use figures::Figures;
use orders::{CorrectionOrder, FrameOrder, Verdict};
use plumbline_config::{Config, Timestamp};
use plumbline_drivers::{DriverError, Faults, ImuReading, ImuSource, Prefetch, StereoFrame, StereoSource};
use plumbline_estimator::{Estimate, Estimator, FrameInput, ImuAdmission, Odometry, Propagator};
use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, Ordering};
use tap::Tap;

/// An estimate takes effect on the odometry this long after its measurement, in data time: longer than the
/// slowest frame may take, shorter than a frame period.
pub const CORRECTION_DELAY_NS: i64 = 40_000_000;
/// Allocations count from this much data time on: by then every buffer has seen use.
const WARM_UP_NS: i64 = 2_000_000_000;
/// Estimates that wait to take effect: at most the frames within the delay.
const MAX_PENDING: usize = 8;

/// How a run goes.
#[derive(Clone, Copy, Debug)]
pub struct RunOptions {
    /// Multiple of real time; `None` for as fast as it goes.
    pub speed: Option<f64>,
    /// 1 decodes or renders between frames, more do so ahead on another thread.
    pub threads: usize,
}

/// Takes what a run produces, on the pipeline's own thread: must not block.
pub trait Sink {
    /// An estimate, once for each frame; `frame_ms` is what it took.
    fn estimate(&mut self, estimate: &Estimate, frame_ms: f64);
    /// Odometry, once for each inertial sample after the first pose.
    fn odometry(&mut self, odometry: &Odometry);
}

/// What a run came to.
#[derive(Debug)]
pub struct Outcome {
    /// Times and counts.
    pub figures: Figures,
    /// SHA-256 over the bits of all estimates.
    pub estimate_digest: String,
    /// SHA-256 over the bits of all odometry.
    pub odometry_digest: String,
    /// What the drivers survived (IMU, cameras).
    pub faults: (Faults, Faults),
}

/// The run of one estimator over one pair of streams.
pub struct Pipeline {
    estimator: Estimator,
    propagator: Propagator,
    pending: VecDeque<Estimate>,
    next_reading: Option<ImuReading>,
    newest_imu: Timestamp,
    first_stamp: Option<Timestamp>,
    pace: Pace,
    estimates: Digest,
    odometry: Digest,
    figures: Figures,
    tap: Box<dyn Tap>,
    readings: u64,
}

impl Pipeline {
    /// Everything allocated for the configuration.
    #[must_use]
    pub fn new(config: &Config, speed: Option<f64>) -> Self {
        Self {
            estimator: Estimator::new(config),
            propagator: Propagator::new(config),
            pending: VecDeque::with_capacity(MAX_PENDING),
            next_reading: None,
            newest_imu: Timestamp::MIN,
            first_stamp: None,
            pace: Pace::new(speed),
            estimates: Digest::default(),
            odometry: Digest::default(),
            figures: Figures::default(),
            tap: Box::new(()),
            readings: 0,
        }
    }

    /// The same with a listener.
    #[must_use]
    pub fn tapped(self, tap: Box<dyn Tap>) -> Self {
        Self { tap, ..self }
    }

    /// Runs both streams to their end, or until `stop` is set.
    ///
    /// # Errors
    /// When a driver cannot go on.
    pub fn run(
        mut self,
        config: &Config,
        mut imu: Box<dyn ImuSource>,
        stereo: Box<dyn StereoSource>,
        options: &RunOptions,
        stop: &AtomicBool,
        sink: &mut dyn Sink,
    ) -> Result<Outcome, DriverError> {
        let size = |k: usize| config.camera.get(k).map_or((0, 0), |c| (c.width_px, c.height_px));
        let sizes_px = [size(0), size(1)];
        let mut stereo: Box<dyn StereoSource> = if options.threads > 1 {
            Box::new(Prefetch::new(stereo, sizes_px, config.driver.image_queue)?)
        } else {
            stereo
        };
        let mut frame = StereoFrame::new(sizes_px);
        self.next_reading = imu.next_reading()?;
        self.figures.start();
        while !stop.load(Ordering::Relaxed) && stereo.next_frame(&mut frame)? {
            let needed = self.estimator.imu_needed_until(frame.stamp);
            self.advance_imu(imu.as_mut(), needed, sink)?;
            self.take_frame(&frame, sink);
            self.tap.frame(&mut frame);
        }
        self.advance_imu(imu.as_mut(), Timestamp::MAX, sink)?;
        self.figures.finish();
        Ok(Outcome {
            figures: self.figures,
            estimate_digest: self.estimates.hex(),
            odometry_digest: self.odometry.hex(),
            faults: (imu.faults(), stereo.faults()),
        })
    }

    /// Takes inertial samples until one reaches `needed`.
    fn advance_imu(
        &mut self,
        imu: &mut dyn ImuSource,
        needed: Timestamp,
        sink: &mut dyn Sink,
    ) -> Result<(), DriverError> {
        while self.newest_imu < needed {
            let Some(reading) = self.next_reading.take() else { break };
            self.newest_imu = self.newest_imu.max(reading.sample.stamp);
            self.first_stamp.get_or_insert(reading.sample.stamp);
            if let Some(late_ms) = self.pace.wait_for(reading.sample.stamp) {
                self.figures.lag_ms.record(late_ms);
            }
            self.tick(&reading, sink);
            self.next_reading = imu.next_reading()?;
        }
        Ok(())
    }

    /// One inertial sample: to the estimator's buffer, and to the odometry.
    fn tick(&mut self, reading: &ImuReading, sink: &mut dyn Sink) {
        let sample = &reading.sample;
        let counting = self.is_warm(sample.stamp).then(alloc::Count::begin);
        let watch = clock::Stopwatch::start();
        while self.pending.front().is_some_and(|e| sample.stamp >= e.stamp.plus_nanos(CORRECTION_DELAY_NS)) {
            if let Some(estimate) = self.pending.pop_front() {
                self.propagator.correct(&estimate);
                let frame = estimate.frame_sequence;
                self.tap.correction(&CorrectionOrder { frame, readings_before: self.readings });
            }
        }
        let odometry = self.propagator.tick(sample);
        self.readings += 1;
        let handout_us = watch.elapsed_ms() * 1e3;
        if self.estimator.add_imu(sample) != ImuAdmission::Accepted {
            self.figures.imu_refused += 1;
        }
        self.tap.reading(reading);
        if let Some(odometry) = &odometry {
            self.tap.odometry(odometry);
        }
        self.figures.hot_path_allocations += counting.map_or(0, alloc::Count::end);
        if let Some(odometry) = odometry {
            self.figures.handed_out(handout_us);
            self.odometry.odometry(&odometry);
            sink.odometry(&odometry);
        }
    }

    /// One frame: the estimate after it, to take effect on the odometry a little later.
    fn take_frame(&mut self, frame: &StereoFrame, sink: &mut dyn Sink) {
        let input = FrameInput {
            sequence: frame.sequence,
            stamp: frame.stamp,
            images: [frame.image(0), frame.image(1)],
        };
        let counting = self.is_warm(frame.stamp).then(alloc::Count::begin);
        let verdict = Verdict::Taken { level: 0 };
        self.tap.order(&FrameOrder { frame: frame.sequence, readings_before: self.readings, verdict });
        let watch = clock::Stopwatch::start();
        let cpu = clock::CpuStopwatch::start();
        let estimate = self.estimator.add_frame(&input, &mut self.figures.stages);
        let (frame_ms, cpu_ms) = (watch.elapsed_ms(), cpu.elapsed_ms());
        self.tap.estimate(&estimate);
        self.figures.hot_path_allocations += counting.map_or(0, alloc::Count::end);
        self.figures.frame(frame.stamp, &estimate, frame_ms, cpu_ms);
        self.estimates.estimate(&estimate);
        if self.pending.len() == MAX_PENDING {
            self.pending.pop_front();
        }
        sink.estimate(&estimate, frame_ms);
        self.pending.push_back(estimate);
    }

    fn is_warm(&self, stamp: Timestamp) -> bool {
        self.first_stamp.is_some_and(|first| stamp.nanos_since(first) > WARM_UP_NS)
    }
}
