//! Conditions of light, camera, scene and motion that images suffer from, by name and dose.
//!
//! To add one, add a [`NamedKind`] to the table and do what it says in [`Effects`](super::Effects) or in the
//! [`Scenario`](super::Scenario).

use super::effects::{Glare, LightSteps, Warming};
use super::named::{Dose, Family, Named, NamedKind};
use super::scenario::{IntrinsicsError, People};
use super::surroundings::Surroundings;
use super::{Effects, FlightPath};
use plumbline_config::Portable;

/// Variance of the photon noise per grey level at night: a fifth of the photons for each grey level.
const NIGHT_SHOT_NOISE: f64 = 0.05;
/// Noise of a real sensor (MT9V034, as it flew in EuRoC): the variance of consecutive images of a scene at rest is
/// `0.14 + 0.0158 grey`, white in time and space.
const REAL_READ_NOISE: f64 = 0.37;
const REAL_SHOT_NOISE: f64 = 0.0158;
/// Light lost in the corners of its lens (the mean of 60 views shows none), and change of the exposure from one image to the next.
const REAL_VIGNETTING: f64 = 0.05;
const REAL_FLICKER: f64 = 0.0015;
/// Blur of the lens, px, by the spectrum at the highest frequencies.
const REAL_LENS_BLUR_PX: f64 = 0.3;
/// Sub-exposures per millisecond of exposure, and their bounds. At 2 rad/s a point moves by 1.1 px between two of them.
const SUB_EXPOSURES_PER_MS: f64 = 0.8;
const SUB_EXPOSURES: (f64, f64) = (3.0, 8.0);

/// A condition with its doses.
pub type SimulatedCondition = Named<Conditions>;

/// Family of the conditions.
#[derive(Clone, Copy, Debug)]
pub struct Conditions;

impl Family for Conditions {
    const NOUN: &'static str = "condition";
    const KINDS: &'static [NamedKind] = KINDS;
}

fn expose(effects: &mut Effects, exposure_ms: f64) {
    effects.exposure_s = 1e-3 * exposure_ms;
    effects.sub_exposures =
        (SUB_EXPOSURES_PER_MS * exposure_ms).ceil().clamp(SUB_EXPOSURES.0, SUB_EXPOSURES.1) as usize;
}

const KINDS: &[NamedKind] = &[
    NamedKind {
        name: "blur",
        about: "Motion blur of a longer exposure, with noise and gain",
        doses: &[
            Dose::new("exposure, ms", 6.0, 100.0),
            Dose::new("noise, grey levels", 1.0, 50.0),
            Dose::new("gain", 1.0, 20.0),
        ],
        cases: &[&[3.0, 1.0], &[6.0, 1.0], &[6.0, 3.0], &[10.0, 6.0]],
        apply: |scenario, [exposure_ms, noise, gain]| {
            expose(&mut scenario.effects, *exposure_ms);
            scenario.effects.read_noise = *noise;
            scenario.effects.gain = *gain;
        },
    },
    NamedKind {
        name: "auto-exposure",
        about: "Light that steps up and down, and an exposure that follows with a lag; images in between are saturated or dark",
        doses: &[
            Dose::new("lag, s", 0.3, 10.0),
            Dose::new("ratio of bright to dark", 4.0, 100.0),
            Dose::new("time between steps, s", 2.0, 1000.0),
        ],
        cases: &[&[]],
        apply: |scenario, [lag_s, ratio, period_s]| {
            let steps = LightSteps { lag_s: *lag_s, ratio: *ratio, period_s: *period_s };
            scenario.effects.light_steps = Some(steps);
        },
    },
    NamedKind {
        name: "glare",
        about: "Four bright lights around the horizon, with a veil around them; they reduce the exposure",
        doses: &[
            Dose::new("brightness in the middle, grey levels", 300.0, 10_000.0),
            Dose::new("radius of the veil, degrees", 8.0, 90.0),
        ],
        cases: &[&[]],
        apply: |scenario, [grey, radius_deg, _]| {
            scenario.effects.glare = Some(Glare { grey: *grey, radius_rad: radius_deg.to_radians() });
        },
    },
    NamedKind {
        name: "night",
        about: "Little light, a long exposure and a noisy sensor (with five times the photon noise)",
        doses: &[
            Dose::new("light, %", 20.0, 100.0),
            Dose::new("noise, grey levels", 4.0, 50.0),
            Dose::new("exposure, ms", 8.0, 100.0),
        ],
        cases: &[&[]],
        apply: |scenario, [percent, noise, exposure_ms]| {
            expose(&mut scenario.effects, *exposure_ms);
            scenario.effects.gain = 0.01 * percent;
            scenario.effects.read_noise = *noise;
            scenario.effects.shot_noise = NIGHT_SHOT_NOISE;
        },
    },
    NamedKind {
        name: "rolling-shutter",
        about: "Rows that are exposed one after the other; the stamp is the middle of the exposure of the middle row",
        doses: &[Dose::new("readout from the first row to the last, ms", 20.0, 100.0)],
        cases: &[&[10.0], &[20.0], &[30.0]],
        apply: |scenario, [readout_ms, ..]| scenario.effects.readout_s = 1e-3 * readout_ms,
    },
    NamedKind {
        name: "people",
        about: "Textured boxes of a person's size that cross the view 1.2 m in front of the left camera, together at most this share \
                of its width",
        doses: &[
            Dose::new("% of the view", 33.0, 100.0),
            Dose::new("walking speed, m/s", 1.2, 10.0),
            Dose::new("when the first comes, s; 0 for all there from the start", 0.0, 3600.0),
        ],
        cases: &[&[33.0], &[60.0], &[33.0, 1.2, 4.0], &[60.0, 1.2, 4.0]],
        apply: |scenario, [percent, speed_m_s, from_s]| {
            scenario.people = Some(People { share: 0.01 * percent, speed_m_s: *speed_m_s, from_s: *from_s });
        },
    },
    NamedKind {
        name: "vehicle-parts",
        about: "Legs and turning rotors of the vehicle in the corners of the images, and specks of rain",
        doses: &[
            Dose::new("specks in an image", 60.0, 2000.0),
            Dose::new("1 for masks of legs and rotors", 0.0, 1.0),
        ],
        cases: &[&[]],
        apply: |scenario, [specks, masked, _]| {
            scenario.vehicle_parts = true;
            scenario.masks_vehicle_parts = *masked > 0.5;
            scenario.effects.specks = specks.round() as u32;
        },
    },
    NamedKind {
        name: "repeated",
        about: "Repetitive pattern on all surfaces",
        doses: &[Dose::new("period at a distance of 3 m, px of the preset sim at full size", 30.0, 500.0)],
        cases: &[&[10.0], &[30.0], &[60.0]],
        apply: |scenario, [px, ..]| {
            scenario.surroundings = Surroundings::Repeated { period_px: px.at_least(1.0) };
        },
    },
    NamedKind {
        name: "bare",
        about: "Empty room of plain walls with this number of small dark spots in a view",
        doses: &[Dose::new("spots", 15.0, 1000.0)],
        cases: &[&[]],
        apply: |scenario, [spots, ..]| scenario.surroundings = Surroundings::Bare { spots: *spots },
    },
    NamedKind {
        name: "bare-hover",
        about: "Hover in such a room",
        doses: &[Dose::new("spots", 15.0, 1000.0), Dose::new("minutes", 5.0, 60.0)],
        cases: &[&[]],
        apply: |scenario, [spots, minutes, _]| {
            scenario.surroundings = Surroundings::Bare { spots: *spots };
            scenario.path = FlightPath::Hover;
            scenario.start_s = 0.0;
            scenario.duration_s = 60.0 * minutes;
        },
    },
    NamedKind {
        name: "fast",
        about: "Same stretch of a recorded path at a multiple of its speed",
        doses: &[Dose::new("factor", 1.5, 4.0)],
        cases: &[&[]],
        apply: |scenario, [times, ..]| {
            let times = times.at_least(0.25);
            scenario.speed = times;
            scenario.start_s /= times;
            scenario.duration_s /= times;
        },
    },
    NamedKind {
        name: "real",
        about: "Images like recorded ones: all tones and weak patterns, highlights, photon noise, blur of the exposure, and a lens \
                that its calibration does not describe exactly",
        doses: &[
            Dose::new("exposure, ms", 3.0, 100.0),
            Dose::new("difference between lens and calibration at the corners, px", 2.0, 20.0),
        ],
        cases: &[&[]],
        apply: |scenario, [exposure_ms, lens_px, _]| {
            if *exposure_ms > 0.0 {
                expose(&mut scenario.effects, *exposure_ms);
            }
            scenario.surroundings = Surroundings::Real;
            scenario.effects.lens_residual_px = *lens_px;
            scenario.effects.read_noise = REAL_READ_NOISE;
            scenario.effects.shot_noise = REAL_SHOT_NOISE;
            scenario.effects.vignetting = REAL_VIGNETTING;
            scenario.effects.lens_blur_px = REAL_LENS_BLUR_PX;
            scenario.effects.flicker = REAL_FLICKER;
        },
    },
    NamedKind {
        name: "intrinsics",
        about: "Calibration error of the cameras, with random signs",
        doses: &[
            Dose::new("focal length, %", 0.3, 10.0),
            Dose::new("principal point, px", 2.0, 50.0),
            Dose::new("vergence of the cameras, mrad", 1.0, 50.0),
        ],
        cases: &[&[]],
        apply: |scenario, [percent, centre_px, mrad]| {
            scenario.intrinsics_error =
                IntrinsicsError { focal: 0.01 * percent, centre_px: *centre_px, vergence_rad: 1e-3 * mrad };
        },
    },
    NamedKind {
        name: "warming",
        about: "Rig that warms up: focal lengths grow, and the cameras turn towards each other",
        doses: &[
            Dose::new("final growth of the focal length, %", 0.2, 10.0),
            Dose::new("final vergence, mrad", 0.5, 50.0),
            Dose::new("time constant, s", 20.0, 10_000.0),
        ],
        cases: &[&[]],
        apply: |scenario, [percent, mrad, time_s]| {
            let warming = Warming { focal: 0.01 * percent, vergence_rad: 1e-3 * mrad, time_s: *time_s };
            scenario.effects.warming = Some(warming);
        },
    },
];
