//! Faults that a flight of the campaign may have: when, and how they are brought about.

use super::Entry;
use nalgebra::{UnitQuaternion, Vector3};
use plumbline_config::Config;
use plumbline_flight::flight::{Flight, FlightError};
use plumbline_simulator::InjectedFault;
use plumbline_simulator::{FlightPath, ImuError, Scene, SimulatedCondition, Surroundings};
use std::ops::Range;

/// Faults begin here, s after the first frame.
const BEGIN_S: f64 = 5.0;
/// Sensors that fail in silence do so from here on, s after the first frame.
pub const SILENT_FROM_S: f64 = 10.0;
/// Time by which such a flight is judged at least, s.
const SILENT_FOR_S: f64 = 4.0;
/// A fault of one instant lasts for one frame, s.
const FRAME_S: f64 = 0.05;
/// After a fault the flight goes on for so long, s.
pub(super) const AFTERWARDS_S: f64 = 6.0;
/// Length of a hover and of a slow drift that are watched, s.
const HOVER_S: f64 = 120.0;
const DRIFT_S: f64 = 25.0;
/// Angle by which cameras are turned, degrees: both as one rig, and the right one alone.
const RIG_TURNED_DEG: f64 = 1.0;
const RIGHT_TURNED_DEG: f64 = 2.0;

/// Fault of a flight.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CampaignFault {
    /// Nothing.
    None,
    /// Both images black for 1.5 s.
    Blackout,
    /// 5 % of the frames lost.
    Drops,
    /// Left camera silent for 5 s.
    LeftLost,
    /// Right camera silent for 5 s.
    RightLost,
    /// Exposure jumps by 15 % from frame to frame.
    Flicker,
    /// Image stamps 8 ms early.
    Offset,
    /// Cameras turned by 1 degree against the calibration.
    Extrinsics,
    /// Three gaps of 50 ms in the inertial samples, a second apart.
    ImuGap50,
    /// Three gaps of 200 ms in the inertial samples, a second apart.
    ImuGap200,
    /// Every inertial reading at an end of its range for 0.3 s.
    Saturated,
    /// The right camera turned by 2 degrees against the calibration.
    RightTurned,
    /// Both images black for 5 s.
    Blind,
    /// Nothing nearer than 80 m.
    FarOnly,
    /// A bare room, in which some ten points are seen.
    TenPoints,
    /// Two minutes of hovering.
    Hover,
    /// A drift of 0.1 m/s, 80 m away from everything.
    FarDrift,
    /// One frame and one inertial sample stamped an hour ahead.
    HourAhead,
    /// Clocks ten seconds back for half a second.
    SetBack,
    /// One frame of noise.
    Garbage,
    /// The left lens covered for 5 s: its images come, and are dark.
    Covered,
    /// Both lenses covered while the vehicle is carried from one place of rest to another.
    Kidnapped,
    /// The gyroscope reads zero, from 10 s on as in all that follow.
    GyroZero,
    /// One axis of the gyroscope repeats its last reading.
    GyroAxisStuck,
    /// The accelerometer repeats its last reading.
    AccelStuck,
    /// The inertial sensor repeats its last sample with new stamps.
    ImuFrozen,
    /// Inertial samples are stamped 0.1 s late.
    ImuLate100,
    /// Inertial samples are stamped 0.5 s late.
    ImuLate500,
    /// The left camera repeats its last image.
    ImageFrozen,
    /// Both cameras repeat their last images.
    ImagesFrozen,
    /// Images are stamped 0.2 s late.
    ImagesLate,
    /// An error of the inertial sensor.
    Inertial(ImuError),
    /// A condition of light, camera, scene or motion.
    Condition(SimulatedCondition),
    /// A fault of the streams or of the calibration, with its dose.
    Injected(InjectedFault),
}

impl CampaignFault {
    /// The errors of inertial sensors, in their usual doses.
    pub fn inertial() -> impl Iterator<Item = Self> {
        ImuError::cases().map(Self::Inertial)
    }

    /// The conditions of light, camera, scene and motion, in their usual doses.
    pub fn conditions() -> impl Iterator<Item = Self> {
        SimulatedCondition::cases().map(Self::Condition)
    }

    /// The faults of streams and calibration, in their usual doses.
    pub fn injected() -> impl Iterator<Item = Self> {
        InjectedFault::cases().map(Self::Injected)
    }

    /// True if it is compared with the same flight without it: an error of the inertial sensor, a condition, or a fault with a
    /// dose.
    #[must_use]
    pub fn is_compared(self) -> bool {
        matches!(self, Self::Inertial(_) | Self::Condition(_) | Self::Injected(_))
    }

    /// The fault of the streams or of the calibration, if it is one.
    #[must_use]
    pub fn injected_fault(self) -> Option<InjectedFault> {
        if let Self::Injected(fault) = self { Some(fault) } else { None }
    }

    /// Start of a fault with a dose, s after the first frame; `None` for others, which lengthen their flights.
    #[must_use]
    pub fn injected_from_s(self) -> Option<f64> {
        match self {
            Self::Injected(fault) => Some(fault.span_s().start),
            _ => None,
        }
    }

    /// Its name.
    #[must_use]
    pub fn name(self) -> String {
        match self {
            Self::Inertial(error) => error.to_string(),
            Self::Condition(condition) => condition.to_string(),
            Self::Injected(fault) => fault.to_string(),
            other => format!("{other:?}"),
        }
    }

    /// All that can go wrong, but for errors of inertial sensors, conditions and faults with a dose.
    pub const ALL: [Self; 30] = [
        Self::Blackout,
        Self::Drops,
        Self::LeftLost,
        Self::RightLost,
        Self::Flicker,
        Self::Offset,
        Self::Extrinsics,
        Self::ImuGap50,
        Self::ImuGap200,
        Self::Saturated,
        Self::RightTurned,
        Self::Blind,
        Self::FarOnly,
        Self::TenPoints,
        Self::Hover,
        Self::FarDrift,
        Self::HourAhead,
        Self::SetBack,
        Self::Garbage,
        Self::Covered,
        Self::Kidnapped,
        Self::GyroZero,
        Self::GyroAxisStuck,
        Self::AccelStuck,
        Self::ImuFrozen,
        Self::ImuLate100,
        Self::ImuLate500,
        Self::ImageFrozen,
        Self::ImagesFrozen,
        Self::ImagesLate,
    ];

    /// True if it is about the other camera, so that one camera alone cannot have it.
    #[must_use]
    pub fn needs_two_cameras(self) -> bool {
        if let Self::Injected(fault) = self {
            return fault.needs_two_cameras();
        }
        matches!(
            self,
            Self::LeftLost | Self::RightLost | Self::RightTurned | Self::Covered | Self::ImageFrozen
        )
    }

    /// When it lasts, s after the first frame; for what lasts throughout, from when the estimate should have settled.
    /// `None` where nothing goes wrong, and for faults with a dose, which the table of honesty judges.
    #[must_use]
    pub fn span_s(self) -> Option<Range<f64>> {
        let lasting = |s: f64| Some(BEGIN_S..BEGIN_S + s);
        match self {
            Self::None | Self::Injected(_) => None,
            Self::Blackout => Some(6.0..7.5),
            Self::ImuGap50 => lasting(2.05),
            Self::ImuGap200 => lasting(2.2),
            Self::Saturated => lasting(0.3),
            Self::HourAhead | Self::Garbage => lasting(FRAME_S),
            Self::SetBack => lasting(0.5),
            Self::Kidnapped => Some(5.5..10.0),
            Self::Inertial(_) | Self::Condition(_) => lasting(4.0),
            Self::Hover => lasting(HOVER_S),
            Self::FarDrift => lasting(DRIFT_S),
            Self::LeftLost | Self::RightLost | Self::Blind | Self::TenPoints | Self::Covered => lasting(5.0),
            Self::Drops
            | Self::Flicker
            | Self::Offset
            | Self::Extrinsics
            | Self::RightTurned
            | Self::FarOnly => lasting(4.0),
            Self::GyroZero
            | Self::GyroAxisStuck
            | Self::AccelStuck
            | Self::ImuFrozen
            | Self::ImuLate100
            | Self::ImuLate500
            | Self::ImageFrozen
            | Self::ImagesFrozen
            | Self::ImagesLate => Some(SILENT_FROM_S..SILENT_FROM_S + SILENT_FOR_S),
        }
    }

    /// Makes the flight one in which it happens, and long enough to see what comes after.
    pub(super) fn shape(self, entry: &mut Entry) {
        let scenario = &mut entry.scenario;
        let effects = &mut scenario.effects;
        let dark = |span: Range<f64>| Some((span.start, span.end));
        match self {
            Self::Blackout | Self::Blind | Self::Kidnapped => effects.blackout = self.span_s().and_then(dark),
            Self::Flicker => effects.flicker = 0.15,
            Self::Offset => effects.time_offset_s = 0.008,
            Self::Inertial(error) => error.apply(scenario),
            Self::Condition(condition) => condition.apply(scenario),
            _ => {}
        }
        let elsewhere = match self {
            Self::Hover => Some(("hover", FlightPath::Hover)),
            Self::FarDrift => Some(("drift", FlightPath::Drift)),
            Self::Kidnapped => Some(("carried", FlightPath::Carried)),
            _ => None,
        };
        if scenario.path == FlightPath::Hover {
            "hover".clone_into(&mut entry.path);
        }
        if let Some((name, path)) = elsewhere {
            name.clone_into(&mut entry.path);
            scenario.path = path;
            scenario.start_s = 0.0;
        }
        if self == Self::TenPoints {
            scenario.surroundings = Surroundings::Bare { spots: 10.0 };
        }
        if matches!(self, Self::FarOnly | Self::FarDrift) {
            entry.scene = "far";
            scenario.scene = Scene::Far;
        }
        if let Some(span) = self.span_s().filter(|_| !self.is_of_any_length()) {
            scenario.duration_s = scenario.duration_s.max(span.end + AFTERWARDS_S);
        }
    }

    /// True if the flight is as long as it is asked for, and may end soon after the fault.
    fn is_of_any_length(self) -> bool {
        use CampaignFault::{Blackout, Drops, Extrinsics, Flicker, LeftLost, None, Offset, RightLost};
        self.is_compared()
            || matches!(self, None | Blackout | Drops | LeftLost | RightLost | Flicker | Offset | Extrinsics)
    }

    /// By how much both cameras are believed turned against the truth, degrees.
    pub(super) fn extrinsics_error_deg(self) -> f64 {
        if self == Self::Extrinsics { RIG_TURNED_DEG } else { 0.0 }
    }

    /// The flight with it in its streams and in what is believed of the rig; `seed` is that of its draws.
    pub(super) fn strike(self, mut flight: Flight, seed: u64) -> Result<Flight, FlightError> {
        let faults: Vec<InjectedFault> = self.texts().iter().filter_map(|text| text.parse().ok()).collect();
        flight = flight.with_injected(&faults, seed)?;
        if self == Self::RightTurned {
            flight.config = flight.config.with("the rig with its right camera turned", turn_right)?;
        }
        if let Self::Injected(fault) = self {
            flight = flight.with_injected(&[fault], seed)?;
        }
        Ok(flight)
    }

    /// Faults of the table that bring it about.
    fn texts(self) -> &'static [&'static str] {
        match self {
            Self::Drops => &["frames-missing:0.05"],
            Self::LeftLost => &["camera-lost:left@5+5"],
            Self::RightLost => &["camera-lost:right@5+5"],
            Self::ImuGap50 => &["imu-gap@5+0.05", "imu-gap@6+0.05", "imu-gap@7+0.05"],
            Self::ImuGap200 => &["imu-gap@5+0.2", "imu-gap@6+0.2", "imu-gap@7+0.2"],
            // Beyond the range, and held within it.
            Self::Saturated => &[
                "gyro-spikes:xyz:1:1000@5+0.3",
                "gyro-clip:xyz:17.4@5+0.3",
                "accel-spikes:xyz:1:10000@5+0.3",
                "accel-clip:xyz:156.9@5+0.3",
            ],
            Self::HourAhead => &["clock-back:-3600@5+0.005"],
            Self::SetBack => &["clock-back:10@5+0.5"],
            Self::Covered => &["image-black:left@5+5"],
            Self::Garbage => &["image-noise:both:100:0@5+0.05"],
            Self::GyroZero => &["gyro-dead:xyz:0"],
            Self::GyroAxisStuck => &["gyro-frozen:y:0"],
            Self::AccelStuck => &["accel-frozen:xyz:0"],
            Self::ImuFrozen => &["imu-frozen:xyz:0"],
            Self::ImuLate100 => &["imu-late:100"],
            Self::ImuLate500 => &["imu-late:500"],
            Self::ImageFrozen => &["image-frozen:left:0"],
            Self::ImagesFrozen => &["image-frozen:both:0"],
            Self::ImagesLate => &["stamp-late:200@10"],
            _ => &[],
        }
    }
}

/// Turns the right camera alone about an oblique axis through itself.
fn turn_right(config: &mut Config) {
    let Some(camera) = config.camera.get_mut(1) else { return };
    let axis = Vector3::new(0.62, 0.6, -0.5).normalize();
    let turn = UnitQuaternion::from_scaled_axis(axis * RIGHT_TURNED_DEG.to_radians());
    let mut pose = camera.pose_b_c();
    pose.rotation *= turn;
    let matrix = pose.to_homogeneous();
    camera.pose_b_c = std::array::from_fn(|i| std::array::from_fn(|j| matrix[(i, j)]));
}
