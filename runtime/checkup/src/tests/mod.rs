//! Every fault that a rig can have, put into a simulated flight, is found by its name; the flight as it is, and a real
//! recording, are fit.

mod camera_imu;
mod drawn;
mod faults;
mod fitted;
mod recorded;

use crate::{Checkup, Fitness, FrameInput, Measure};
use plumbline_config::{Config, GrayImage, ImuSample, Timestamp};
use plumbline_drivers::{ImuSource as _, StereoFrame};
use plumbline_simulator::{FlightPath, Scenario, Simulator};
use plumbline_test_support::kept;

/// A frame: its number, stamp and images.
pub(crate) type Seen = (u64, Timestamp, [GrayImage; 2]);

/// Sensor data of a test.
#[derive(Clone)]
struct Data {
    config: Config,
    samples: Vec<(u64, ImuSample)>,
    frames: Vec<Seen>,
}

impl Data {
    fn report(&self) -> Vec<Measure> {
        self.checkup().report()
    }

    /// A checkup that was given the data.
    fn checkup(&self) -> Checkup {
        let mut checkup = Checkup::new(&self.config.clone().validated("test").unwrap());
        let mut samples = self.samples.iter();
        for (sequence, stamp, images) in &self.frames {
            while checkup.needs_samples(*stamp) {
                let Some((sequence, sample)) = samples.next() else { break };
                checkup.add_sample(*sequence, sample);
            }
            checkup.note_frame(*sequence, *stamp);
            let images = [0, 1].map(|k| (k < self.config.camera.len()).then(|| images[k].view()));
            checkup.look_at(&FrameInput { sequence: Some(*sequence), stamp: *stamp, images });
        }
        samples.for_each(|(sequence, sample)| checkup.add_sample(*sequence, sample));
        checkup
    }

    /// Copy with another configuration, or other data.
    fn with(&self, change: impl FnOnce(&mut Self)) -> Self {
        let mut changed = self.clone();
        change(&mut changed);
        changed
    }
}

/// The take-off of the built-in flight: at rest, then in motion, mostly about one axis. With its first `frames` frames: where
/// a fault concerns the inertial samples alone, none are rendered.
fn flight(frames: usize) -> Data {
    simulated(FlightPath::Demo, 0.0, 6.0, frames)
}

/// Frames that are enough where nothing has to move.
const FEW: usize = 15;
/// All frames.
const ALL: usize = usize::MAX;

/// A lively flight along a real trajectory, which turns about all axes; `None` where that is not there.
fn lively() -> Option<Data> {
    let path = plumbline_test_support::shared("euroc/trajectories/V1_03_difficult.tum.gz")?;
    Some(simulated(FlightPath::Tum(path), 30.0, 7.0, ALL))
}

/// A simulated flight in the room, at a small resolution.
fn simulated(path: FlightPath, start_s: f64, duration_s: f64, frames: usize) -> Data {
    let preset = Config::preset("sim").unwrap().into_inner();
    let scenario = Scenario { path, start_s, duration_s, resolution_scale: 0.35, ..Scenario::default() };
    let simulator = Simulator::new(&preset, &scenario).unwrap();
    let (mut samples, mut imu) = (Vec::new(), simulator.imu());
    while let Some(reading) = imu.next_reading().unwrap() {
        samples.push((reading.sequence, reading.sample));
    }
    let frames =
        if frames == 0 { Vec::new() } else { rendered(&simulator, &format!("{scenario:?}"), frames) };
    Data { config: simulator.config().clone(), samples, frames }
}

/// The first `count` frames of a flight, rendered once for all tests.
pub(crate) fn rendered(simulator: &Simulator, scenario: &str, count: usize) -> Vec<Seen> {
    let pixels = kept::once(scenario, || {
        let (mut frame, mut scratch) = (StereoFrame::new(simulator.image_sizes()), simulator.scratch());
        let render = |index| {
            simulator.render_frame(index, &mut scratch, &mut frame);
            frame.images.each_ref().map(GrayImage::pixels).concat()
        };
        (0..simulator.frame_count()).flat_map(render).collect()
    });
    let sizes = simulator.image_sizes();
    let bytes = sizes.iter().map(|(width, height)| width * height).sum();
    let of_frame = |(index, pixels): (u64, &[u8])| {
        let mut rest = pixels;
        let images = sizes.map(|(width, height)| {
            let mut image = GrayImage::new(width, height);
            let (own, others) = rest.split_at(width * height);
            image.pixels_mut().copy_from_slice(own);
            rest = others;
            image
        });
        (index, simulator.frame_stamp(index), images)
    };
    (0..).zip(pixels.chunks(bytes)).take(count).map(of_frame).collect()
}

/// The measure of this name, which is there.
fn measure<'a>(report: &'a [Measure], name: &str) -> &'a Measure {
    report.iter().find(|measure| measure.name == name).unwrap_or_else(|| panic!("{name} is looked at"))
}

/// True if nothing speaks against a flight.
fn is_fit(report: &[Measure]) -> bool {
    report.iter().all(|measure| measure.verdict != Fitness::NotFit)
}

/// Names of what a flight needs and the data do not show.
fn missing(report: &[Measure]) -> Vec<&str> {
    report.iter().filter(|measure| measure.is_missing()).map(|measure| measure.name).collect()
}

fn told(report: &[Measure]) -> String {
    let line = |m: &Measure| format!("{:<13} {:<32} {} [{}]", m.verdict.to_string(), m.name, m.value, m.cure);
    report.iter().map(line).collect::<Vec<_>>().join("\n")
}

/// Asserts that a fault is found under this name, with these words in value or cure, and at least this
/// severity.
#[track_caller]
fn assert_found(report: &[Measure], name: &str, at_least: Fitness, words: &str) {
    let found = measure(report, name);
    let text = format!("{} [{}]", found.value, found.cure);
    assert!(found.verdict >= at_least && text.contains(words), "{}", told(report));
}
