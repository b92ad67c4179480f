//! One pass over a recording: in pieces, each of which finds the rig by itself.
//!
//! Every piece is estimated by an estimator of its own that knows nothing but the calibration it begins with and how far
//! that may be off. So the pieces are independent, and how they scatter tells what each of them does not know of
//! its own errors: that tracks of one patch err together, and that Jacobians stay at first estimates.

use plumbline_config::options::image_sizes;
use plumbline_config::{ImuSample, Timestamp, ValidSetup};
use plumbline_drivers::{Prefetch, StereoFrame, StereoSource};
use plumbline_estimator::{Estimator, Fit, FrameInput, RigEstimate};
use plumbline_flight::flight::{Flight, FlightError};
use std::collections::VecDeque;

/// Samples that a new piece is given from before its first frame, s: to level by.
const LEAD_S: f64 = 0.3;
/// A piece shorter than this part of the others says too little.
const LEAST_PART: f64 = 0.6;

/// Result of a pass.
#[derive(Clone, Debug, Default)]
pub(super) struct Pass {
    /// Finds of each piece.
    pub(super) pieces: Vec<RigEstimate>,
    /// Mean cost of an observation in every whole piece, `None` where it found no pose or lost it.
    pub(super) costs: Vec<Option<f64>>,
    /// Pieces that found no pose, or lost it.
    pub(super) lost: usize,
    /// Every inertial sample between the frames.
    pub(super) samples: Vec<ImuSample>,
    /// Length, s.
    pub(super) span_s: f64,
}

/// The piece that is being estimated.
struct Piece {
    estimator: Estimator,
    begin: Timestamp,
    last: Timestamp,
    resets: u32,
    /// Summed over its frames.
    fit: Fit,
}

impl Piece {
    fn new(setup: &ValidSetup, begin: Timestamp, lead: &VecDeque<ImuSample>) -> Self {
        let mut estimator = Estimator::new(setup);
        for sample in lead {
            estimator.add_imu(sample);
        }
        Self { estimator, begin, last: begin, resets: 0, fit: Fit::default() }
    }

    fn add(&mut self, frame: &StereoFrame) {
        let image = |camera: usize| frame.valid[camera].then(|| frame.images[camera].view());
        let input =
            FrameInput { sequence: Some(frame.sequence), stamp: frame.stamp, images: [image(0), image(1)] };
        self.resets = self.estimator.add_frame(&input).reset_counter;
        self.last = frame.stamp;
        if let Some(fit) = self.estimator.newest_fit() {
            self.fit.cost += fit.cost;
            self.fit.observations += fit.observations;
        }
    }

    /// Its find, and the mean cost of an observation, if it went well for long enough.
    fn finish(mut self, least_s: f64) -> Option<(RigEstimate, f64)> {
        let is_sound = self.resets == 0 && self.last.seconds_since(self.begin) >= least_s;
        let mean_cost = self.fit.cost / self.fit.observations.max(1) as f64;
        is_sound.then(|| self.estimator.rig_estimate()).flatten().map(|estimate| (estimate, mean_cost))
    }
}

/// Estimates the rig of `setup` in every `piece_s` seconds of `flight`; `progress` is told the frames so far.
///
/// # Errors
/// When a driver cannot go on.
pub(super) fn pass(
    flight: Flight,
    setup: &ValidSetup,
    piece_s: f64,
    progress: &mut dyn FnMut(u64),
) -> Result<Pass, FlightError> {
    let Flight { mut imu, stereo, config, .. } = flight;
    let sizes_px = image_sizes(&config.camera);
    let mut stereo = Prefetch::new(stereo, sizes_px, config.driver.image_queue)?;
    let mut frame = StereoFrame::new(sizes_px);
    let mut found = Pass::default();
    let mut lead: VecDeque<ImuSample> = VecDeque::new();
    let mut piece: Option<Piece> = None;
    let (mut first, mut frames) = (None, 0);
    while stereo.next_frame(&mut frame)? {
        let since_s = piece.as_ref().map_or(f64::INFINITY, |p| frame.stamp.seconds_since(p.begin));
        if since_s >= piece_s {
            found.close(piece.take(), piece_s);
        }
        let piece = piece.get_or_insert_with(|| Piece::new(setup, frame.stamp, &lead));
        let needed = piece.estimator.imu_needed_until(frame.stamp);
        while lead.back().is_none_or(|sample| sample.stamp < needed) {
            let Some(reading) = imu.next_reading()? else { break };
            piece.estimator.add_imu(&reading.sample);
            found.samples.push(reading.sample);
            lead.push_back(reading.sample);
            while lead.front().is_some_and(|old| reading.sample.stamp.seconds_since(old.stamp) > LEAD_S) {
                lead.pop_front();
            }
        }
        piece.add(&frame);
        found.span_s = frame.stamp.seconds_since(*first.get_or_insert(frame.stamp));
        frames += 1;
        progress(frames);
    }
    found.close(piece, piece_s);
    Ok(found)
}

impl Pass {
    fn close(&mut self, piece: Option<Piece>, piece_s: f64) {
        let Some(piece) = piece else { return };
        let is_rest = piece.last.seconds_since(piece.begin) < LEAST_PART * piece_s;
        match piece.finish(LEAST_PART * piece_s) {
            Some((estimate, cost)) => {
                self.pieces.push(estimate);
                self.costs.push(Some(cost));
            }
            // What is left over at the end is no loss.
            None if is_rest => {}
            None => {
                self.lost += 1;
                self.costs.push(None);
            }
        }
    }
}
