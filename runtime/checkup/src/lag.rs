//! Simultaneity of left and right: where they do not agree, an image is matched with those of the other
//! camera one to three frames before. A driver that pairs by arrival hands out one camera late by whole
//! frames, under equal stamps.

use crate::late_camera::Lag;
use crate::pair::PairMatcher;
use crate::statistics::median;
use plumbline_config::{Config, GrayImage, ImageView, Timestamp};
use std::collections::VecDeque;

/// Frames by which a camera may be late.
const MAX_LAG: usize = 3;
/// Lags that are tried, positive where the right camera is late; one a frame in turn.
const LAGS: [i8; 2 * MAX_LAG] = [1, -1, 2, -2, 3, -3];
/// A frame whose median error exceeds this share of the limit is looked into.
const DOUBTFUL: f64 = 0.2;
/// Fewest matches of a frame that are judged.
const MIN_MATCHES: usize = 8;
/// Fewest errors of a lag that count, and how far they are smaller than those of the frames as they came.
const MIN_ERRORS: usize = 100;
const BETTER: f64 = 0.4;
/// Errors that are kept of each lag.
const MAX_ERRORS: usize = 5000;

/// Finds by how many frames a camera is late.
pub(crate) struct LagFinder {
    matcher: PairMatcher,
    limit_px: f64,
    /// The images before with their stamps, the newest last.
    before: VecDeque<(Timestamp, [GrayImage; 2])>,
    next: usize,
    /// Errors of the frames that were looked into as they came, and with each lag.
    came: Vec<Moment>,
    lagged: [Vec<Moment>; LAGS.len()],
}

/// Error of a match between images of these stamps, px.
struct Moment {
    stamps: [Timestamp; 2],
    error_px: f64,
}

fn errors_px(moments: &[Moment], is_frozen: &dyn Fn(Timestamp) -> bool) -> Vec<f64> {
    let sound = moments.iter().filter(|moment| !moment.stamps.iter().any(|stamp| is_frozen(*stamp)));
    sound.map(|moment| moment.error_px).collect()
}

impl LagFinder {
    /// For a rig with two cameras; `None` for one camera.
    pub(crate) fn new(config: &Config) -> Option<Self> {
        Some(Self {
            matcher: PairMatcher::new(config)?,
            limit_px: DOUBTFUL * f64::from(config.estimator.points.max_epipolar_px),
            before: VecDeque::with_capacity(MAX_LAG + 1),
            next: 0,
            came: Vec::new(),
            lagged: Default::default(),
        })
    }

    /// Takes the images of a frame, and the errors of its matches as it came.
    pub(crate) fn add(
        &mut self,
        stamp: Timestamp,
        [left, right]: [&ImageView<'_>; 2],
        errors_px: impl Iterator<Item = f64>,
    ) {
        let errors: Vec<f64> = errors_px.map(f64::abs).collect();
        if errors.len() < MIN_MATCHES || median(&errors) > self.limit_px {
            let room = MAX_ERRORS.saturating_sub(self.came.len());
            let moment = |error_px: &f64| Moment { stamps: [stamp; 2], error_px: *error_px };
            self.came.extend(errors.iter().take(room).map(moment));
            self.look_into(stamp, [left, right]);
        }
        if self.before.len() == MAX_LAG {
            self.before.pop_front();
        }
        self.before.push_back((stamp, [left, right].map(copy)));
    }

    fn look_into(&mut self, stamp: Timestamp, [left, right]: [&ImageView<'_>; 2]) {
        let place = self.next % LAGS.len();
        self.next += 1;
        let lag = LAGS[place];
        let earlier = self.before.len().checked_sub(usize::from(lag.unsigned_abs()));
        let Some((earlier, [left_before, right_before])) = earlier.and_then(|at| self.before.get(at)) else {
            return;
        };
        // A right camera that is late shows now what the left one showed before.
        let is_found = match lag > 0 {
            true => self.matcher.find(&left_before.view(), right),
            false => self.matcher.find(left, &right_before.view()),
        };
        let (kept, stamps) = (&mut self.lagged[place], [*earlier, stamp]);
        if is_found && kept.len() < MAX_ERRORS {
            let errors = self.matcher.matches().iter().map(|found| found.epipolar_px.abs());
            kept.extend(errors.map(|error_px| Moment { stamps, error_px }));
        }
    }

    /// The lag with which left and right agree, where they do not as they came, by frames whose images are not frozen.
    pub(crate) fn lag(&self, is_frozen: &dyn Fn(Timestamp) -> bool) -> Option<Lag> {
        let came = errors_px(&self.came, is_frozen);
        if came.len() < MIN_ERRORS {
            return None;
        }
        let came = median(&came);
        let lagged = self.lagged.iter().map(|moments| errors_px(moments, is_frozen));
        let lags = LAGS.iter().zip(lagged).filter(|(_, errors)| errors.len() >= MIN_ERRORS);
        let best = lags.map(|(lag, errors)| (*lag, median(&errors))).min_by(|a, b| a.1.total_cmp(&b.1))?;
        (best.1 < BETTER * came).then_some(Lag { frames: best.0, errors_px: (best.1, came) })
    }
}

fn copy(view: &ImageView<'_>) -> GrayImage {
    let mut image = GrayImage::new(view.width(), view.height());
    for (row, line) in image.pixels_mut().chunks_exact_mut(view.width().max(1)).enumerate() {
        line.copy_from_slice(view.row(row));
    }
    image
}
