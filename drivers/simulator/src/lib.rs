//! A simulated flight: a stereo camera and an inertial sensor in an indoor world, with the exact truth.
//!
//! A smooth [`Trajectory`] (built in, or any TUM file) flies through one of the [`Scene`]s built around
//! it. Images are rendered through the configured camera models; inertial samples are the derivatives of
//! the same curve. Everything is a pure function of the configuration and of the [`Scenario`]: no clock,
//! no threads, no order of calls has a say, so frames may be rendered ahead and out of order.
//!
//! [`faults`] are injected on purpose into the streams of any flight, simulated, recorded or live.
//!
//! Frames: `W` world (z up), `B` body (the inertial sensor's own), `C0` and `C1` cameras. Times are those
//! of the trajectory's file; images begin [`LEAD_S`] after it, so that inertial samples surround them.

#![cfg_attr(not(test), deny(clippy::disallowed_methods))]

mod actors;
mod builder;
mod calibration;
mod canvas;
mod cover;
mod effects;
mod facet;
pub mod faults;
mod fittings;
mod imu;
mod laps;
mod lens;
mod light;
mod named;
mod noise;
mod path;
mod pattern;
mod random;
mod reconcile;
mod render;
mod samples;
mod scenario;
mod scenes;
mod settings;
mod shade;
mod shot;
mod solid;
mod spline;
mod stereo;
mod texture;
mod trajectory;
mod world;

#[cfg(test)]
mod conditions_tests;
#[cfg(test)]
mod fixture;
#[cfg(test)]
mod pictures_tests;
#[cfg(test)]
mod tests;

pub use calibration::{draw_calibration, mistake_intrinsics};
pub use effects::Effects;
pub use faults::{InjectedFault, InjectedFrames, InjectedImu};
pub use imu::ImuEffects;
pub use named::{Dose, ImuError, Named, SimulatedCondition};
pub use samples::{Inertial, recorded_along};
pub use scenario::{FlightPath, IntrinsicsError, People, Scenario, USUAL_DURATION_S};
pub use scenes::{Scene, Surroundings};
pub use stereo::SimulatedStereo;
pub use trajectory::{MotionState, Trajectory};
pub use world::Hit;

use actors::Person;
use effects::Sensor;
use imu::ImuModel;
use lens::{Lens, TILE};
use nalgebra::{Isometry3, Vector2};
use plumbline_config::{Config, GrayImage, Portable, Timestamp};
use plumbline_drivers::{DriverError, ImuReading, ImuSource, StereoFrame, TruthState};
use render::Renderer;
use samples::Samples;
use shot::Shot;
use std::sync::Arc;
use world::World;

/// Inertial samples begin this long before the first image and end this long after the last.
pub const LEAD_S: f64 = 0.1;
/// Interval at which the flight path is kept clear of furniture: 15 cm at 3 m/s.
const PATH_STEP_S: f64 = 0.05;

/// A simulated flight; clones share it.
#[derive(Clone, Debug)]
pub struct Simulator {
    inner: Arc<Inner>,
}

#[derive(Debug)]
struct Inner {
    config: Config,
    scenario: Scenario,
    flight: Trajectory,
    world: World,
    people: Vec<Person>,
    cameras: Vec<(Lens, Sensor)>,
    imu: Samples,
    first_frame: Timestamp,
    frames: u64,
}

/// Working memory of one rendering thread.
#[derive(Clone, Debug)]
pub struct RenderScratch {
    renderer: Renderer,
    shots: Vec<Shot>,
    /// Lenses of a rolling shutter, one for each camera.
    rolled: Vec<Lens>,
    light: Vec<f32>,
    exposure: Vec<f32>,
    rows: Vec<f32>,
}

impl Simulator {
    /// Prepares the flight of `scenario` for the rig of `config` (at full resolution; see
    /// [`Self::config`] for the rig that is simulated).
    ///
    /// # Errors
    /// When the trajectory cannot be read, or the scenario asks for what it does not hold.
    pub fn new(config: &Config, scenario: &Scenario) -> Result<Self, DriverError> {
        scenario.check(config)?;
        let config = scenario.rig(config);
        let (flight, recorded) = match (&scenario.inertial, &scenario.path) {
            (Inertial::Recorded(samples), FlightPath::Tum(poses)) => {
                let (samples, flight) = Samples::read(samples, poses, &config.imu)?;
                (flight, Some(samples))
            }
            _ => (scenario.flight(&config)?, None),
        };
        let (first_frame, duration_s) = scenario.window(&flight)?;
        let [begin, end] = [-LEAD_S, duration_s + LEAD_S].map(|s| first_frame.plus_seconds(s));
        let imu = match recorded {
            Some(mut recorded) => {
                recorded.samples.retain(|sample| (begin..=end).contains(&sample.stamp));
                recorded
            }
            None => ImuModel::new(&config.imu, scenario.imu, scenario.seed, [begin, end]).samples(&flight),
        };
        let path: Vec<_> = flight.positions(PATH_STEP_S).collect();
        let mut world = scenes::build(scenario.scene, scenario.seed, &path, scenario.surroundings);
        if scenario.lean_deg != 0.0 {
            world.lean(scenario.lean_deg.to_radians(), scenario.seed, &path);
        }
        let first_frame_s = first_frame.seconds_since(flight.begin());
        let people = actors::enter(scenario, &config.camera[0], first_frame_s, &mut world);
        let cameras = config.camera.iter().map(|camera| {
            let model = camera.model();
            let sensor = Sensor::new(&scenario.effects, &model, scenario.seed);
            (Lens::new(model, camera.pose_b_c()), sensor)
        });
        let cameras = cameras.collect();
        let frames = (duration_s * config.camera[0].rate_hz - 1e-6).ceil().at_least(1.0) as u64;
        let scenario = scenario.clone();
        let inner = Inner { config, scenario, flight, world, people, cameras, imu, first_frame, frames };
        Ok(Self { inner: Arc::new(inner) })
    }

    /// The rig as simulated: the given one with the scenario's resolution.
    pub fn config(&self) -> &Config {
        &self.inner.config
    }

    /// Simulated scenario.
    pub fn scenario(&self) -> &Scenario {
        &self.inner.scenario
    }

    /// A stream of the inertial samples.
    pub fn imu(&self) -> SimulatedImu {
        SimulatedImu { simulator: self.clone(), next: 0 }
    }

    /// A stream of the frames, with working memory of its own.
    pub fn stereo(&self) -> SimulatedStereo {
        SimulatedStereo::new(self.clone())
    }

    /// Frames of the flight.
    pub fn frame_count(&self) -> u64 {
        self.inner.frames
    }

    /// Cameras of the rig.
    pub fn camera_count(&self) -> usize {
        self.inner.cameras.len()
    }

    /// Sizes of the images, px; 0x0 for a camera that is not there.
    pub fn image_sizes(&self) -> [(usize, usize); 2] {
        let size = |camera: &(Lens, Sensor)| (camera.0.model.width_px, camera.0.model.height_px);
        [0, 1].map(|k| self.inner.cameras.get(k).map_or((0, 0), size))
    }

    /// Time at which frame `index` is taken, on the inertial sensor's time axis (the middle of the exposure, of that of the
    /// middle row).
    pub fn frame_time(&self, index: u64) -> Timestamp {
        self.inner.first_frame.plus_seconds(index as f64 / self.inner.config.camera[0].rate_hz)
    }

    /// Camera stamp of frame `index`.
    pub fn frame_stamp(&self, index: u64) -> Timestamp {
        self.frame_time(index).plus_seconds(-self.inner.scenario.effects.time_offset_s)
    }

    /// Working memory for one thread that renders. The first one paints the world, which takes up to a second.
    pub fn scratch(&self) -> RenderScratch {
        self.inner.world.paint();
        let sizes = self.image_sizes();
        let width = sizes[0].0.max(sizes[1].0);
        let height = sizes[0].1.max(sizes[1].1);
        let lenses = self.inner.cameras.iter().map(|(lens, _)| lens);
        let rows = lenses.clone().map(|lens| lens.rows).max().unwrap_or(1);
        let is_rolling = self.inner.config.camera.iter().any(|camera| camera.readout_s > 0.0);
        RenderScratch {
            renderer: Renderer::new(self.inner.world.surfaces.len(), (width, height)),
            shots: Vec::with_capacity(rows),
            rolled: lenses.filter(|_| is_rolling).cloned().collect(),
            light: vec![0.0; width * height],
            exposure: vec![0.0; width * height],
            rows: vec![0.0; 2 * width],
        }
    }

    /// Renders frame `index` (in any order) into `frame`, whatever becomes of it later.
    pub fn render_frame(&self, index: u64, scratch: &mut RenderScratch, frame: &mut StereoFrame) {
        frame.sequence = index;
        frame.stamp = self.frame_stamp(index);
        frame.valid = [false; 2];
        for camera in 0..self.camera_count() {
            self.render_camera(index, camera, scratch, &mut frame.images[camera]);
            frame.valid[camera] = true;
        }
    }

    /// Renders the image of one camera at frame `index`. `image` is given the right size if it has another.
    pub fn render_camera(
        &self,
        index: u64,
        camera: usize,
        scratch: &mut RenderScratch,
        image: &mut GrayImage,
    ) {
        let (inner, effects) = (&*self.inner, &self.inner.scenario.effects);
        let time = self.frame_time(index);
        let elapsed_s = time.seconds_since(inner.first_frame);
        let (lens, sensor) = &inner.cameras[camera];
        let size = (lens.model.width_px, lens.model.height_px);
        if (image.width(), image.height()) != size {
            *image = GrayImage::new(size.0, size.1);
        }
        let gain = effects.gain_at(inner.scenario.seed, index, elapsed_s);
        let pixels = size.0 * size.1;
        if gain > 0.0 {
            self.expose(time, camera, scratch);
        } else {
            scratch.light[..pixels].fill(0.0);
        }
        let (light, rows) = (&mut scratch.light[..pixels], &mut scratch.rows[..2 * size.0]);
        sensor.develop(light, rows, gain, (index, camera), image.pixels_mut());
    }

    /// Light of one image into `scratch.light`.
    fn expose(&self, time: Timestamp, camera: usize, scratch: &mut RenderScratch) {
        let effects = &self.inner.scenario.effects;
        let lens = &self.inner.cameras[camera].0;
        let pixels = lens.model.width_px * lens.model.height_px;
        let count = if effects.exposure_s > 0.0 { effects.sub_exposures.max(1) } else { 1 };
        let share = 1.0 / count as f32;
        for k in 0..count {
            let at = effects.exposure_s * ((k as f64 + 0.5) / count as f64 - 0.5);
            self.take(time.plus_seconds(at), camera, scratch);
            let light = &mut scratch.light[..pixels];
            match k {
                0 if count == 1 => light.copy_from_slice(&scratch.exposure[..pixels]),
                0 => light.iter_mut().zip(&scratch.exposure).for_each(|(sum, light)| *sum = share * light),
                _ => light.iter_mut().zip(&scratch.exposure).for_each(|(sum, light)| *sum += share * light),
            }
        }
    }

    /// Light of one sub-exposure around `time` into `scratch.exposure`: at once, or row of tiles by row of tiles.
    fn take(&self, time: Timestamp, camera: usize, scratch: &mut RenderScratch) {
        let RenderScratch { renderer, shots, rolled, exposure, .. } = scratch;
        let lens = &self.inner.cameras[camera].0;
        let out = &mut exposure[..lens.model.width_px * lens.model.height_px];
        shots.clear();
        let row_s = self.row_s(camera);
        let Some(rolled) = rolled.get_mut(camera).filter(|_| row_s > 0.0) else {
            shots.push(self.shot(time, camera));
            renderer.render(&self.inner.world, lens, shots, out);
            return;
        };
        let middle = 0.5 * (lens.model.height_px as f64 - 1.0);
        let first = 0.5 * (TILE as f64 - 1.0);
        let times =
            (0..lens.rows).map(|row| time.plus_seconds(((row * TILE) as f64 + first - middle) * row_s));
        shots.extend(times.clone().map(|time| self.shot(time, camera)));
        let turn = |(shot, time): (&Shot, Timestamp)| {
            let next = self.shot(time.plus_seconds(TILE as f64 * row_s), camera);
            (shot.pose_w_c.rotation.inverse() * next.pose_w_c.rotation).scaled_axis() / TILE as f64
        };
        rolled.roll(lens, shots.iter().zip(times).map(turn));
        renderer.render(&self.inner.world, rolled, shots, out);
    }

    /// Time between two rows of a camera, s.
    fn row_s(&self, camera: usize) -> f64 {
        let height = self.inner.cameras[camera].0.model.height_px;
        self.inner.config.camera[camera].readout_s / (height as f64 - 1.0).at_least(1.0)
    }

    /// A camera and what moves at `time`.
    fn shot(&self, time: Timestamp, camera: usize) -> Shot {
        let inner = &self.inner;
        let mut shot = Shot::at(self.pose_w_c(time, &inner.cameras[camera].0));
        if !inner.people.is_empty() {
            shot.movers = actors::poses(&inner.people, &inner.flight, time);
        }
        shot
    }

    fn pose_w_c(&self, time: Timestamp, lens: &Lens) -> Isometry3<f64> {
        self.inner.flight.motion(time).pose_w_b * lens.pose_b_c
    }

    /// True state at `time` (of the inertial sensor's axis).
    pub fn ground_truth(&self, time: Timestamp) -> TruthState {
        let motion = self.inner.flight.motion(time);
        let biases = self.inner.imu.biases(time);
        TruthState {
            stamp: time,
            pose_w_b: motion.pose_w_b,
            v_w_b: motion.v_w_b,
            bias_gyro: biases.gyro,
            bias_accel: biases.accel,
        }
    }

    /// True states at the times of the inertial samples.
    pub fn truth(&self) -> impl Iterator<Item = TruthState> + '_ {
        self.inner.imu.samples.iter().map(|sample| self.ground_truth(sample.stamp))
    }

    /// The point of the world that pixel `px` of `camera` sees at `time` (of the inertial sensor's axis).
    pub fn first_hit(&self, time: Timestamp, camera: usize, px: &Vector2<f64>) -> Option<Hit> {
        let lens = &self.inner.cameras.get(camera)?.0;
        let pose_w_c = self.pose_w_c(time, lens);
        let direction = pose_w_c.rotation * lens.ray(px)?;
        self.inner.world.first_hit(&pose_w_c.translation.vector, &direction)
    }
}

/// Inertial samples of a simulated flight, in order.
#[derive(Clone, Debug)]
pub struct SimulatedImu {
    simulator: Simulator,
    next: u64,
}

impl ImuSource for SimulatedImu {
    fn next_reading(&mut self) -> Result<Option<ImuReading>, DriverError> {
        let sample = self.simulator.inner.imu.samples.get(self.next as usize);
        let reading = sample.map(|sample| ImuReading { sequence: self.next, sample: *sample });
        self.next += 1;
        Ok(reading)
    }
}
