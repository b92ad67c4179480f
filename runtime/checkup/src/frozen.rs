//! Images that freeze: a camera that delivers one image again and again, with noise of its own on each copy, while the vehicle moves.
//!
//! A view that stays the same ([`view`]) is that of a vehicle at rest, unless the other camera moves meanwhile, or the gyroscope turns
//! while the view stops or goes on from one image to the next, as no vehicle does.

mod view;

use crate::plausibility::{Glimpse, Seen, TurnFinder};
use crate::scale::between;
use crate::statistics::mean_and_spread;
use crate::verdict::{Fitness, Measure};
use nalgebra::Vector3;
use plumbline_config::{Config, ImuSample, Timestamp};
use std::fmt::Write as _;
use view::{SameView, View};

/// Name of the measure.
pub(crate) const NAME: &str = "frozen images";
/// Shortest time of one view that is looked at, s, and its fewest images.
const MIN_SPAN_S: f64 = 0.25;
const MIN_REPEATS: usize = 4;
/// The other camera moves where it turns by at least this rate, rad/s, so many times, and is turned by this angle, rad, from where it was;
/// by the larger one though no inertial sensor shows a motion. A vehicle on the ground that is pushed turns to and fro.
const MOVES_RAD_S: f64 = 0.03;
const MIN_TURNS: usize = 4;
const MIN_ANGLE: (f64, f64) = (0.03, 0.1);
/// The gyroscope turns where means over this time, s, differ from their mean by this rate, rad/s, so many times. A bias is not counted so.
/// After so many a view that neither stops nor jumps is frozen too: no stamps are late by so much.
const MEAN_S: f64 = 0.1;
const TURNS_RAD_S: f64 = 0.05;
const MIN_MEANS: usize = 4;
const MANY_MEANS: usize = 15;
/// Least angle between the attitudes of such a turn, rad, and without forces; vibration turns to and fro.
const MIN_TURNED: (f64, f64) = (0.1, 0.5);
/// Scatter of gyroscope (rad/s) and accelerometer (m/s²) of a vehicle at rest.
const REST: (f64, f64) = (0.02, 0.35);
/// A view stops if it turned at this rate, rad/s, up to the first image, while the gyroscope changes by less than this share.
const STOPS: (f64, f64) = (0.1, 0.5);
/// A view jumps by at least this angle, rad, and by so many times that of the next image.
const JUMPS: (f64, f64) = (0.02, 2.0);
/// Spans that are written out.
const TOLD: usize = 3;
/// Ends of both cameras' spans that are the same, s.
const TOGETHER_S: f64 = 0.15;

/// Views of both cameras, and how they turn.
pub(crate) struct Views {
    views: [View; 2],
    /// Views that ended.
    ended: Vec<SameView>,
    right: Option<TurnFinder>,
    turns: [Vec<Seen>; 2],
    images: [usize; 2],
    /// Stamp of the first frame.
    begin: Option<Timestamp>,
}

impl Views {
    pub(crate) fn new(config: &Config) -> Self {
        Self {
            views: Default::default(),
            ended: Vec::new(),
            right: config.camera.get(1).map(|camera| TurnFinder::new(camera.model())),
            turns: Default::default(),
            images: [0; 2],
            begin: None,
        }
    }

    /// Takes a frame, and how its left camera turned since the one before.
    pub(crate) fn add(&mut self, frame: &Glimpse, left: Option<Seen>) {
        let images = [0, 1].map(|camera| frame.valid[camera].then_some(&frame.images[camera]));
        self.begin.get_or_insert(frame.stamp);
        self.turns[0].extend(left);
        self.turns[1].extend(self.right.as_mut().and_then(|right| right.next(frame.stamp, images[1])));
        for (camera, image) in images.into_iter().enumerate() {
            self.images[camera] += usize::from(image.is_some());
            self.ended.extend(self.views[camera].add(frame.stamp, image, camera).filter(is_long));
        }
    }

    /// The times in which images are frozen.
    pub(crate) fn frozen(&self, samples: &[ImuSample], config: &Config) -> Frozen {
        let data = Data { views: self, samples, offset_s: config.rig.time_offset_s };
        let open = (0..2).filter_map(|camera| self.views[camera].so_far(camera)).filter(is_long);
        let same = self.ended.iter().copied().chain(open);
        let spans = same.filter_map(|view| Some(Span { shown: data.shown(&view)?, view })).collect();
        Frozen { spans, images: self.images, begin: self.begin.unwrap_or(Timestamp::MIN) }
    }
}

fn is_long(view: &SameView) -> bool {
    view.repeats >= MIN_REPEATS && view.to.seconds_since(view.from) >= MIN_SPAN_S
}

/// What shows that the vehicle moves while a view stays the same.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Shown {
    OtherCamera,
    InertialSensors,
}

struct Data<'a> {
    views: &'a Views,
    samples: &'a [ImuSample],
    offset_s: f64,
}

impl Data<'_> {
    fn shown(&self, view: &SameView) -> Option<Shown> {
        let samples = self.within(view.from, view.to);
        let (_, turning) = mean_and_spread(samples.iter().map(|sample| sample.gyro));
        let (_, shaking) = mean_and_spread(samples.iter().map(|sample| sample.accel));
        let is_at_rest = turning < REST.0 && shaking < REST.1;
        if self.angle_of_other(view) >= if is_at_rest { MIN_ANGLE.1 } else { MIN_ANGLE.0 } {
            return Some(Shown::OtherCamera);
        }
        let (means, turned) = turned(samples);
        let is_sudden = || self.stops(view) || self.jumps(view);
        let is_shown = match shaking >= REST.1 {
            true => turned >= MIN_TURNED.0 && (means >= MANY_MEANS || means >= MIN_MEANS && is_sudden()),
            false => turned >= MIN_TURNED.1 && means >= MIN_MEANS && is_sudden(),
        };
        is_shown.then_some(Shown::InertialSensors)
    }

    fn within(&self, from: Timestamp, to: Timestamp) -> &[ImuSample] {
        between(self.samples, from.plus_seconds(self.offset_s), to.plus_seconds(self.offset_s))
    }

    /// Largest angle by which the other camera is turned meanwhile from where it was, rad; none of a few turns.
    fn angle_of_other(&self, view: &SameView) -> f64 {
        let turns = self.views.turns[1 - view.camera].iter();
        let (mut moving, mut angle, mut largest) = (0, Vector3::zeros(), 0.0);
        for turn in turns.filter(|turn| turn.from >= view.from && turn.to <= view.to) {
            angle += turn.rate_c * turn.to.seconds_since(turn.from);
            largest = angle.norm().max(largest);
            moving += usize::from(turn.rate_c.norm() >= MOVES_RAD_S);
        }
        if moving < MIN_TURNS { 0.0 } else { largest }
    }

    /// True if the view stops at its first image while the gyroscope turns on.
    fn stops(&self, view: &SameView) -> bool {
        let before = self.views.turns[view.camera].iter().find(|turn| turn.to == view.from);
        before.filter(|turn| turn.rate_c.norm() >= STOPS.0).is_some_and(|turn| {
            let rate = |from, to| mean_and_spread(self.within(from, to).iter().map(|sample| sample.gyro)).0;
            let after = rate(view.from, view.from.plus_seconds(MEAN_S));
            (after - rate(turn.from, turn.to)).norm() < STOPS.1 * turn.rate_c.norm()
        })
    }

    /// True if the view goes on with a jump after its last image.
    fn jumps(&self, view: &SameView) -> bool {
        let mut after = self.views.turns[view.camera].iter().filter(|turn| turn.from >= view.to);
        match (after.next(), after.next()) {
            (Some(first), Some(next)) if first.from == view.to => {
                first.angle() >= JUMPS.0 && first.angle() >= JUMPS.1 * next.angle()
            }
            // What is seen has nothing in common with what was seen.
            (Some(_), Some(_)) => true,
            _ => false,
        }
    }
}

/// Means in which the gyroscope turned, whatever its bias is, and the largest angle from the first attitude less that of the bias, rad.
fn turned(samples: &[ImuSample]) -> (usize, f64) {
    let [first, .., last] = samples else { return (0, 0.0) };
    let count = (last.stamp.seconds_since(first.stamp) / MEAN_S).max(1.0);
    let each = (samples.len() as f64 / count).ceil().max(1.0) as usize;
    let mean = |samples: &[ImuSample]| mean_and_spread(samples.iter().map(|sample| sample.gyro)).0;
    let middle = mean(samples);
    let (mut means, mut angle, mut largest) = (0, Vector3::zeros(), 0.0);
    for chunk in samples.chunks(each) {
        let rate = mean(chunk) - middle;
        angle += rate * MEAN_S;
        means += usize::from(rate.norm() >= TURNS_RAD_S);
        largest = angle.norm().max(largest);
    }
    (means, largest)
}

#[derive(Clone, Copy, Debug)]
struct Span {
    view: SameView,
    shown: Shown,
}

/// Times in which images are frozen.
#[derive(Debug)]
pub(crate) struct Frozen {
    spans: Vec<Span>,
    images: [usize; 2],
    begin: Timestamp,
}

impl Frozen {
    pub(crate) fn is_none(&self) -> bool {
        self.spans.is_empty()
    }

    /// True if an image of this stamp is frozen.
    pub(crate) fn covers(&self, stamp: Timestamp) -> bool {
        self.spans.iter().any(|span| stamp > span.view.from && stamp <= span.view.to)
    }

    /// True if what images show of this time is no motion of the vehicle.
    pub(crate) fn touches(&self, from: Timestamp, to: Timestamp) -> bool {
        self.spans.iter().any(|span| to > span.view.from && from <= span.view.to)
    }

    /// Frozen images of a camera.
    fn repeats(&self, camera: usize) -> usize {
        self.of(camera).map(|span| span.view.repeats).sum()
    }

    /// Those of them that are bit for bit the one before.
    pub(crate) fn exact(&self, camera: usize) -> usize {
        self.of(camera).map(|span| span.view.exact).sum()
    }

    fn of(&self, camera: usize) -> impl Iterator<Item = &Span> {
        self.spans.iter().filter(move |span| span.view.camera == camera)
    }

    /// The measure; `None` if nothing is frozen.
    pub(crate) fn judge(&self) -> Option<Measure> {
        let [left, right]: [Vec<&Span>; 2] = [0, 1].map(|camera| self.of(camera).collect());
        let (values, name) = match (left.is_empty(), right.is_empty()) {
            (true, true) => return None,
            (false, true) => (vec![self.words("left", &left)], "left camera"),
            (true, false) => (vec![self.words("right", &right)], "right camera"),
            _ if are_together(&left, &right) => (vec![self.words("left and right", &left)], "cameras"),
            _ => (vec![self.words("left", &left), self.words("right", &right)], "cameras"),
        };
        let cure = format!(
            "look at cable, driver and load of the {name}, and restart {}; the measures below leave these images out",
            if name == "cameras" { "them" } else { "it" }
        );
        let figures = [("left_frozen_s", seconds(&left)), ("right_frozen_s", seconds(&right))];
        Some(Measure::new(NAME, Fitness::NotFit, values.join("; "), cure, &figures))
    }

    /// Which images, when, how many, and what shows it.
    fn words(&self, side: &str, spans: &[&Span]) -> String {
        let after_s = |stamp: Timestamp| stamp.seconds_since(self.begin);
        let time = |span: &&Span| format!("{:.1} to {:.1} s", after_s(span.view.from), after_s(span.view.to));
        let mut times = spans.iter().take(TOLD).map(time).collect::<Vec<_>>().join(", ");
        if spans.len() > TOLD {
            let _ = write!(times, " and {} times more", spans.len() - TOLD);
        }
        let camera = spans.first().map_or(0, |span| span.view.camera);
        let shown = match spans.first().map(|span| span.shown) {
            Some(Shown::OtherCamera) => format!("the {} ones move", ["right", "left"][camera]),
            _ => "gyroscope and accelerometer show motion".to_owned(),
        };
        format!(
            "{side} images stand still for {:.1} s ({times} after the first image; {} of {} images) while {shown}",
            seconds(spans),
            self.repeats(camera),
            self.images[camera]
        )
    }
}

/// Length of all, s.
fn seconds(spans: &[&Span]) -> f64 {
    spans.iter().map(|span| span.view.to.seconds_since(span.view.from)).sum()
}

/// True if both cameras freeze at the same times.
fn are_together(left: &[&Span], right: &[&Span]) -> bool {
    let is_same = |(a, b): (&&Span, &&Span)| {
        let apart = |a: Timestamp, b: Timestamp| a.seconds_since(b).abs() <= TOGETHER_S;
        apart(a.view.from, b.view.from) && apart(a.view.to, b.view.to)
    };
    left.len() == right.len() && left.iter().zip(right).all(is_same)
}
