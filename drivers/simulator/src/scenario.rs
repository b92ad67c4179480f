//! Scenario of a simulated flight.

use super::laps::laps;
use super::path::{self, hand_held};
use super::{Effects, ImuEffects, Inertial, LEAD_S, Scene, Surroundings, Trajectory};
use nalgebra::UnitQuaternion;
use plumbline_config::options::{Mask, Mounting, VehicleConfig};
use plumbline_config::{Config, Portable, Timestamp};
use plumbline_drivers::DriverError;
use plumbline_drivers::tum::read_tum;
use std::path::PathBuf;

/// Longest built-in flight, s: its curve is held in memory.
const MAX_DEMO_S: f64 = 7200.0;
/// Mountings this near to each other are the same, rad.
const MOUNTED_RAD: f64 = 2e-3;

/// Path of the vehicle.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum FlightPath {
    /// Take-off and figures of eight, for as long as is asked for.
    Demo,
    /// Picked up, and moved and turned about all axes by hand, for as long as is asked for: how a rig is calibrated. The
    /// seed says how.
    HandHeld,
    /// Take-off and a hover that sways by centimetres.
    Hover,
    /// Take-off and a drift of 0.1 m/s to the left.
    Drift,
    /// At rest, until it is carried off by 1.5 m from 6.5 to 9.5 s, and put down.
    Carried,
    /// A hover with yaws of 170 degrees at up to 500 degrees/s, seven in ten seconds.
    Yaws,
    /// Take-off and sweeps of 2 m to the side at up to 3 m/s, banked.
    Sweeps,
    /// Along the poses of a TUM file (plain or gzip), smoothed.
    Tum(PathBuf),
}

impl FlightPath {
    /// Names of the built-in paths.
    pub const NAMES: [&str; 7] = ["demo", "hand-held", "hover", "drift", "carried", "yaws", "sweeps"];

    /// The built-in path of that name, else the path along that file.
    pub fn named(name: &str) -> Self {
        match name {
            "demo" => Self::Demo,
            "hand-held" => Self::HandHeld,
            "hover" => Self::Hover,
            "drift" => Self::Drift,
            "carried" => Self::Carried,
            "yaws" => Self::Yaws,
            "sweeps" => Self::Sweeps,
            file => Self::Tum(file.into()),
        }
    }
}

/// Length of a simulated flight of which nothing is said, s.
pub const USUAL_DURATION_S: f64 = 20.0;

/// A simulated flight. Times are seconds.
#[derive(Clone, Debug, PartialEq)]
pub struct Scenario {
    /// Surroundings of the flight.
    pub scene: Scene,
    /// Path of the vehicle.
    pub path: FlightPath,
    /// First image, after the beginning of the path (and [`LEAD_S`]).
    pub start_s: f64,
    /// Length of the flight, of one lap where there are several; a file that ends earlier ends it.
    pub duration_s: f64,
    /// Number of laps, one after the other, with a way back in between.
    pub laps: u32,
    /// Seed of all random draws.
    pub seed: u64,
    /// Size of the images against the configured size, with the intrinsics to match.
    pub resolution_scale: f64,
    /// Effects on the images.
    pub effects: Effects,
    /// Effects on the inertial samples.
    pub imu: ImuEffects,
    /// Source of the inertial samples.
    pub inertial: Inertial,
    /// The whole scene leans by this angle from the vertical, degrees, towards a direction that the seed draws. Path and
    /// gravity stay.
    pub lean_deg: f64,
    /// The rig that the estimator believes is drawn around the true one, with this multiple of the standard deviations that
    /// `[rig]` states; 0 for the true one.
    pub calibration_error: f64,
    /// Change of the scene.
    pub surroundings: Surroundings,
    /// People who cross the view.
    pub people: People,
    /// By how much the intrinsics that the estimator believes are off.
    pub intrinsics_error: IntrinsicsError,
}

/// Boxes of a person's size that cross the view, and keep their distance to the vehicle.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct People {
    /// Share of the view's width that they fill side by side; 0 for nobody.
    pub share: f64,
    /// Velocity against the view, m/s.
    pub speed_m_s: f64,
    /// Time at which the first comes into view, s after the first frame; 0 if all are there from the start.
    pub from_s: f64,
}

/// Errors of a calibration; signs are drawn.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct IntrinsicsError {
    /// Error of both focal lengths of each camera, relative.
    pub focal: f64,
    /// Error of each coordinate of each principal point at the configured size, px.
    pub centre_px: f64,
    /// Error of the angle between the cameras, rad.
    pub vergence_rad: f64,
}

impl Default for Scenario {
    fn default() -> Self {
        Self {
            scene: Scene::Room,
            path: FlightPath::Demo,
            start_s: 0.0,
            duration_s: 60.0,
            laps: 1,
            seed: 1,
            resolution_scale: 1.0,
            effects: Effects::default(),
            imu: ImuEffects::default(),
            inertial: Inertial::default(),
            lean_deg: 0.0,
            calibration_error: 0.0,
            surroundings: Surroundings::Usual,
            people: People::default(),
            intrinsics_error: IntrinsicsError::default(),
        }
    }
}

impl Scenario {
    /// Checks the scenario against the rig.
    pub(super) fn check(&self, config: &Config) -> Result<(), DriverError> {
        let e = &self.effects;
        let (is_file, is_recorded) = (matches!(self.path, FlightPath::Tum(_)), self.has_recorded_samples());
        let rates = config.camera.iter().map(|c| c.rate_hz).chain([config.imu.rate_hz]);
        let is_short = self.start_s + self.duration_s <= MAX_DEMO_S;
        let has_own_path = self.laps == 1 && is_file;
        let checks = [
            (matches!(config.camera.len(), 1 | 2), "the rig must have one or two cameras"),
            (rates.into_iter().all(|hz| hz > 0.0), "rates must be positive"),
            (self.start_s >= 0.0 && self.start_s.is_finite(), "the start must be a number of seconds from 0"),
            (self.duration_s > 0.0, "the duration must be positive"),
            ((1..=100).contains(&self.laps), "there must be 1 to 100 laps"),
            (is_file || is_short, "the built-in flight lasts two hours at most; choose a shorter duration"),
            (
                !is_recorded || has_own_path,
                "recorded inertial samples need the recorded path they belong to, flown once",
            ),
            (
                !is_recorded || self.imu == ImuEffects::default(),
                "recorded inertial samples have the errors of their sensor; leave simulated ones out",
            ),
            (
                (0.0..=10.0).contains(&self.calibration_error),
                "the calibration error must be within 0 to 10 standard deviations",
            ),
            ((0.0..=LEAD_S).contains(&e.readout_s), "the readout must be within 0 to 0.1 s"),
            (self.lean_deg.abs() <= 5.0, "the scene may lean by 5 degrees at most"),
            ((0.1..=4.0).contains(&self.resolution_scale), "the resolution scale must be within 0.1 to 4"),
            (e.time_offset_s.abs() <= 0.9 * LEAD_S, "the time offset must be below 0.09 s"),
            ((0.0..=LEAD_S).contains(&e.exposure_s), "the exposure must be within 0 to 0.1 s"),
            (e.read_noise >= 0.0 && e.shot_noise >= 0.0, "noise must not be negative"),
            (e.gain > 0.0, "the gain must be positive"),
        ];
        match checks.iter().find(|(holds, _)| !holds) {
            Some((_, message)) => Err(DriverError::Scenario((*message).into())),
            None => Ok(()),
        }
    }

    /// True if the inertial samples are recorded ones, with which the path is reconciled.
    pub fn has_recorded_samples(&self) -> bool {
        matches!(self.inertial, Inertial::Recorded(_))
    }

    /// The rig that is simulated: `config` at the scenario's resolution, with its readout and exposure. On
    /// a built-in path the vehicle is mounted around its left camera, and the mounting of the IMU follows; a file flies any
    /// vehicle.
    pub fn rig(&self, config: &Config) -> Config {
        let mut rig = scaled_config(config, self.resolution_scale);
        if let (false, Some(left)) = (matches!(self.path, FlightPath::Tum(_)), rig.camera.first()) {
            let rot_v_b = path::level_camera(0.0) * left.pose_b_c().rotation.inverse();
            let is_so = |configured: UnitQuaternion<f64>| configured.angle_to(&rot_v_b) < MOUNTED_RAD;
            if !rig.vehicle.rot_v_b().is_some_and(is_so) {
                rig.vehicle = VehicleConfig { imu_to_vehicle_deg: Mounting::of_rotation(&rot_v_b) };
            }
        }
        for camera in &mut rig.camera {
            let Effects { readout_s, exposure_s, .. } = self.effects;
            camera.readout_s = if readout_s > 0.0 { readout_s } else { camera.readout_s };
            camera.exposure_s = if exposure_s > 0.0 { exposure_s } else { camera.exposure_s };
        }
        rig
    }

    /// The whole path.
    pub(super) fn flight(&self, config: &Config) -> Result<Trajectory, DriverError> {
        let once = self.once(config)?;
        if self.laps == 1 {
            return Ok(once);
        }
        let rest_s = once.end().seconds_since(once.begin()) - self.start_s - LEAD_S;
        let lap = (self.start_s, (self.duration_s + LEAD_S).at_most(rest_s));
        laps(&once, lap, self.laps)
            .ok_or_else(|| DriverError::Scenario("the path is too short to be flown in laps".into()))
    }

    /// The path as it is given.
    fn once(&self, config: &Config) -> Result<Trajectory, DriverError> {
        let length_s = (self.start_s + self.duration_s + 2.0 * LEAD_S).at_least(1.0);
        let flown = |at: &dyn Fn(f64) -> path::Place| {
            path::flown(length_s, &config.camera[0].pose_b_c(), at)
                .ok_or_else(|| DriverError::Scenario("the built-in flight is too short".into()))
        };
        match &self.path {
            FlightPath::Demo => flown(&path::demo),
            FlightPath::HandHeld => flown(&hand_held(self.seed)),
            FlightPath::Hover => flown(&path::hover),
            FlightPath::Drift => flown(&path::drift),
            FlightPath::Carried => flown(&path::carried),
            FlightPath::Yaws => flown(&path::yaws),
            FlightPath::Sweeps => flown(&path::sweeps),
            FlightPath::Tum(file) => Trajectory::from_poses(&read_tum(file)?).ok_or_else(|| {
                DriverError::refused(file, "needs at least eight poses in order of time to fly along")
            }),
        }
    }

    /// First image and duration (s).
    pub(super) fn window(&self, flight: &Trajectory) -> Result<(Timestamp, f64), DriverError> {
        // A path in laps begins at the start.
        let (start_s, duration_s) = match self.laps {
            1 => (self.start_s, self.duration_s),
            _ => (0.0, f64::INFINITY),
        };
        let first = flight.begin().plus_seconds(LEAD_S + start_s);
        let rest_s = flight.end().seconds_since(first) - LEAD_S;
        if rest_s <= 0.0 {
            return Err(DriverError::Scenario(format!(
                "the path ends before the flight starts at {} s; start earlier",
                self.start_s
            )));
        }
        Ok((first, duration_s.at_most(rest_s)))
    }
}

/// `config` with images `scale` times as large, intrinsics to match (pixel centres at whole numbers).
fn scaled_config(config: &Config, scale: f64) -> Config {
    let mut scaled = config.clone();
    if scale == 1.0 {
        return scaled;
    }
    scaled.rig.camera_centre_sigma_px *= scale;
    for camera in &mut scaled.camera {
        camera.width_px = (camera.width_px as f64 * scale).round() as usize;
        camera.height_px = (camera.height_px as f64 * scale).round() as usize;
        camera.focal_px = camera.focal_px.map(|f| f * scale);
        camera.centre_px = camera.centre_px.map(|c| (c + 0.5) * scale - 0.5);
        if let Some(Mask::Pixels(mask)) = &mut camera.mask {
            *mask = mask.resized(camera.width_px, camera.height_px);
        }
    }
    scaled
}

#[cfg(test)]
mod tests {
    use super::super::{Simulator, fixture};
    use super::*;
    use plumbline_drivers::{ImuSource, StereoFrame, StereoSource};

    fn simulator(path: &FlightPath, duration_s: f64) -> Simulator {
        let scenario =
            Scenario { path: path.clone(), duration_s, resolution_scale: 0.2, ..Scenario::default() };
        Simulator::new(&fixture::config(), &scenario).unwrap()
    }

    /// True if all frames and inertial samples of the shorter flight are those of the longer one.
    fn is_beginning(shorter: &Simulator, longer: &Simulator) -> bool {
        let [mut a, mut b] = [shorter, longer].map(Simulator::stereo);
        let [mut one, mut other] = [shorter, longer].map(|s| StereoFrame::new(s.image_sizes()));
        while a.next_frame(&mut one).unwrap() {
            assert!(b.next_frame(&mut other).unwrap());
            if one.images != other.images || one.stamp != other.stamp {
                return false;
            }
        }
        let [mut a, mut b] = [shorter, longer].map(Simulator::imu);
        while let Some(reading) = a.next_reading().unwrap() {
            if b.next_reading().unwrap() != Some(reading) {
                return false;
            }
        }
        true
    }

    #[test]
    fn along_a_file_a_shorter_flight_is_the_beginning_of_a_longer_one() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("wobble.tum");
        plumbline_drivers::tum::write_tum(&file, &fixture::wobble_poses(4.0)).unwrap();
        let path = FlightPath::Tum(file);
        assert!(is_beginning(&simulator(&path, 1.0), &simulator(&path, 2.5)));
    }

    #[test]
    fn the_built_in_flight_is_another_one_for_each_duration() {
        assert!(!is_beginning(&simulator(&FlightPath::Demo, 4.0), &simulator(&FlightPath::Demo, 8.0)));
    }

    #[test]
    fn the_mounting_of_a_simulated_vehicle_is_the_one_that_it_flies_with() {
        let level = |preset: &str, path: &FlightPath| {
            let config = Config::preset(preset).unwrap();
            let scenario = Scenario { path: path.clone(), duration_s: 2.0, ..Scenario::default() };
            let simulator = Simulator::new(&config, &scenario).unwrap();
            let rot_v_b = simulator.config().vehicle.rot_v_b().unwrap();
            let first =
                simulator.ground_truth(simulator.frame_stamp(0)).pose_w_b.rotation * rot_v_b.inverse();
            first.angle().to_degrees()
        };
        // The rig of EuRoC looks twenty degrees below the nose of its own vehicle, and hardly below that of the built-in flight.
        for preset in ["sim", "euroc"] {
            let degrees = level(preset, &FlightPath::Demo);
            assert!(degrees < 0.5, "{preset}: {degrees} degrees at rest");
        }
    }
}
