//! Subscriber that keeps the tracking figures of a flight.

use super::Spread;
use super::TrackingFigures;
use super::fit::Fits;
use super::lives::Lives;
use plumbline_config::ValidConfig;
use plumbline_estimator::Tracked;
use plumbline_flight::pipeline::listener::{Listener, ListenerView, Producer, Subscriber};
use plumbline_flight::schedule::times::Times;
use std::sync::{Arc, Mutex, PoisonError};

/// Keeps the tracking figures of a flight.
#[derive(Debug)]
pub struct TrackingWatch {
    tracks: Arc<Mutex<Seen>>,
    fits: Arc<Mutex<Fits>>,
}

/// Tracks of the images.
#[derive(Clone, Debug)]
struct Seen {
    points: Lives,
    lines: Lives,
    line_length_px: Times,
}

impl Seen {
    fn frame(&mut self, tracked: &Tracked) {
        let points = tracked.points.iter();
        self.points.frame(points.map(|p| (p.track_id, p.age, p.px.iter().all(Option::is_some))));
        let lines = tracked.lines.iter();
        self.lines.frame(lines.map(|l| (l.track_id, l.age, l.segments.iter().all(Option::is_some))));
        let left = tracked.lines.iter().filter_map(|line| line.segments[0].as_ref());
        left.for_each(|segment| self.line_length_px.record(f64::from(segment.length())));
    }
}

impl TrackingWatch {
    /// Room for the flights of a configuration.
    #[must_use]
    pub fn new(config: &ValidConfig) -> Self {
        let estimator = &config.estimator;
        let tracks = Seen {
            points: Lives::with_room_for(estimator.points.max_points),
            lines: Lives::with_room_for(2 * estimator.lines.max_segments),
            line_length_px: Times::of_ms(),
        };
        Self { tracks: Arc::new(Mutex::new(tracks)), fits: Arc::new(Mutex::new(Fits::new(config))) }
    }

    /// Figures, after the run.
    #[must_use]
    pub fn figures(&self) -> TrackingFigures {
        let seen = self.tracks.lock().unwrap_or_else(PoisonError::into_inner);
        let (residuals_px, outliers) = self.fits.lock().unwrap_or_else(PoisonError::into_inner).figures();
        TrackingFigures {
            points: seen.points.figures(),
            residuals_px,
            outliers,
            lines: seen.lines.figures(),
            line_length_px: Spread::of(&seen.line_length_px),
        }
    }
}

impl Subscriber for TrackingWatch {
    fn listener(&mut self, producer: Producer) -> Box<dyn Listener> {
        match producer {
            Producer::FrontEnd => Box::new(OfTracks(Arc::clone(&self.tracks))),
            Producer::Window => Box::new(OfWindow(Arc::clone(&self.fits))),
            _ => Box::new(()),
        }
    }
}

/// Listener of the front-end. Its lock is its own until the run ends.
struct OfTracks(Arc<Mutex<Seen>>);

impl Listener for OfTracks {
    fn shown(&mut self, view: ListenerView<'_>) {
        if let ListenerView::Tracked(tracked) = view {
            self.0.lock().unwrap_or_else(PoisonError::into_inner).frame(tracked);
        }
    }
}

/// Listener of the window, with a lock of its own likewise.
struct OfWindow(Arc<Mutex<Fits>>);

impl Listener for OfWindow {
    fn shown(&mut self, view: ListenerView<'_>) {
        let ListenerView::Solved(solved) = view else { return };
        if solved.estimate.has_pose() {
            self.0.lock().unwrap_or_else(PoisonError::into_inner).frame(solved.window());
        }
    }
}
