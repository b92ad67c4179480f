//! Noise of the inertial sensor, from a recording at rest: white noise densities and bias walks by the Allan variance.
//!
//! [`longest_rest`] finds the part at rest, [`allan_variance`] and [`fit`] look at each axis of it, [`Found`] puts them
//! together and says what there was too little of. `figure` draws the deviations.

mod allan;
mod figure;
mod fit;
mod rest;
#[cfg(test)]
mod tests;

pub use allan::{AllanPoint, allan_variance};
pub use figure::write_figure;
pub use fit::{AxisNoise, Measured, fit};
pub use rest::{RestInterval, longest_rest};

use nalgebra::Vector3;
use plumbline_config::ImuSample;
use plumbline_config::options::ImuConfig;

/// A rest shorter than this says nothing of the noise, s.
pub const SHORTEST_REST_S: f64 = 2.0;
/// Advice to a recording that is too short for the walks.
const WALK_CURE: &str = "record two hours or more, at an even temperature";
/// A misfit above this is told.
const NOTABLE_MISFIT: f64 = 4.0;
/// An axis this much noisier than all together is told.
const NOTABLE_AXIS: f64 = 1.5;
/// Gravity differs by this where the accelerometer is well, m/s².
const NOTABLE_GRAVITY_M_S2: f64 = 0.5;

/// Names of the sensors and the units of their densities and walks.
const SENSORS: [(&str, &str, &str); 2] = [
    ("gyroscope", "rad/s/sqrt(Hz)", "rad/s^2/sqrt(Hz)"),
    ("accelerometer", "m/s^2/sqrt(Hz)", "m/s^3/sqrt(Hz)"),
];

/// Gyroscope or accelerometer.
#[derive(Clone, Debug, PartialEq)]
pub struct SensorNoise {
    /// x, y and z; `None` where an axis has no noise that could be looked at.
    pub axes: [Option<AxisNoise>; 3],
    /// White noise density: the root of the mean square of the axes.
    pub density: Option<Measured>,
    /// Bias walk, likewise; `None` unless it is seen on every axis.
    pub walk: Option<Measured>,
}

/// Finds of a recording about the sensor.
#[derive(Clone, Debug, PartialEq)]
pub struct Found {
    /// The part at rest.
    pub rest: RestInterval,
    /// Gyroscope and accelerometer.
    pub sensors: [SensorNoise; 2],
    /// Mean rate at rest, rad/s: the bias of the gyroscope, and the turn of the earth.
    pub mean_rate: Vector3<f64>,
    /// Mean specific force at rest, m/s².
    pub mean_force: Vector3<f64>,
}

/// Looks for a rest in `samples`, which are in order of time, and at the noise within; `None` when there are next to none.
#[must_use]
pub fn find(samples: &[ImuSample]) -> Option<Found> {
    let rest = longest_rest(samples)?;
    let still = &samples[rest.range.clone()];
    let count = still.len().max(1) as f64;
    let sensor = |k: usize| {
        let axis = |axis: usize| {
            let value = |s: &ImuSample| if k == 0 { s.gyro[axis] } else { s.accel[axis] };
            let rate: Vec<f64> = still.iter().map(value).collect();
            fit(allan_variance(&rate, rest.dt_s))
        };
        SensorNoise::of([0, 1, 2].map(axis))
    };
    let sensors = [0, 1].map(sensor);
    let mean_rate = still.iter().map(|s| s.gyro).sum::<Vector3<f64>>() / count;
    let mean_force = still.iter().map(|s| s.accel).sum::<Vector3<f64>>() / count;
    Some(Found { sensors, mean_rate, mean_force, rest })
}

impl SensorNoise {
    fn of(axes: [Option<AxisNoise>; 3]) -> Self {
        let densities: Vec<Measured> = axes.iter().flatten().map(|axis| axis.density).collect();
        let walks: Vec<Measured> = axes.iter().flatten().filter_map(|axis| axis.walk).collect();
        Self { density: root_mean_square(&densities), walk: root_mean_square(&walks), axes }
    }

    /// The largest of what the axes' walks can be.
    #[must_use]
    pub fn walk_at_most(&self) -> Option<f64> {
        self.axes.iter().flatten().map(|axis| axis.walk_at_most).max_by(f64::total_cmp)
    }
}

/// Root mean square of three axes; `None` if one is missing.
fn root_mean_square(axes: &[Measured]) -> Option<Measured> {
    if axes.len() < 3 {
        return None;
    }
    let mean = axes.iter().map(|m| m.value * m.value).sum::<f64>() / 3.0;
    let variance = axes.iter().map(|m| (2.0 * m.value * m.sigma / 3.0).powi(2)).sum::<f64>();
    let value = mean.sqrt();
    (value > 0.0).then(|| Measured { value, sigma: variance.sqrt() / (2.0 * value) })
}

impl Found {
    /// Writes what was found into a configuration's sensor, white noise times `inflate`, and names the keys it has
    /// written.
    pub fn write_into(&self, imu: &mut ImuConfig, inflate: f64) -> Vec<&'static str> {
        let mut written = Vec::new();
        if self.rest.length_s < SHORTEST_REST_S {
            return written;
        }
        // Stamps in whole nanoseconds, of a sensor of 200 Hz: not 199.99999.
        imu.rate_hz = (1e3 / self.rest.dt_s).round() / 1e3;
        written.push("rate_hz");
        let [gyro, accel] = &self.sensors;
        let mut set = |to: &mut f64, name, found: Option<Measured>, factor: f64| {
            if let Some(found) = found {
                *to = found.value * factor;
                written.push(name);
            }
        };
        set(&mut imu.gyro_noise_density, "gyro_noise_density", gyro.density, inflate);
        set(&mut imu.gyro_bias_walk, "gyro_bias_walk", gyro.walk, 1.0);
        set(&mut imu.accel_noise_density, "accel_noise_density", accel.density, inflate);
        set(&mut imu.accel_bias_walk, "accel_bias_walk", accel.walk, 1.0);
        written
    }

    /// The figures, a line each.
    #[must_use]
    pub fn table(&self) -> Vec<String> {
        let mut lines = vec![format!("{:<14} {:>25} {:>25}", "", "white noise density", "bias walk")];
        for (sensor, (name, density_unit, walk_unit)) in self.sensors.iter().zip(SENSORS) {
            for (axis, letter) in sensor.axes.iter().zip(["x", "y", "z"]) {
                let density = words(axis.as_ref().map(|a| a.density), None);
                let walk = words(axis.as_ref().and_then(|a| a.walk), axis.as_ref().map(|a| a.walk_at_most));
                lines.push(format!("{:<14} {density:>25} {walk:>25}", format!("{name} {letter}")));
            }
            let (density, walk) = (words(sensor.density, None), words(sensor.walk, sensor.walk_at_most()));
            lines
                .push(format!("{:<14} {density:>25} {walk:>25}   {density_unit}, {walk_unit}", "  together"));
        }
        let degrees = self.mean_rate.map(f64::to_degrees);
        lines.push(format!(
            "mean at rest   gyroscope {:.4} {:.4} {:.4} deg/s, accelerometer {:.4} m/s^2",
            degrees.x,
            degrees.y,
            degrees.z,
            self.mean_force.norm()
        ));
        lines
    }

    /// Warnings before the figures are trusted, each with its cure.
    #[must_use]
    pub fn remarks(&self, gravity_m_s2: f64) -> Vec<String> {
        let mut remarks = self.remarks_on_rest();
        if self.rest.length_s < SHORTEST_REST_S {
            return remarks;
        }
        for (sensor, (name, ..)) in self.sensors.iter().zip(SENSORS) {
            remarks.extend(remarks_on(sensor, name, self.rest.length_s));
        }
        let gravity = self.mean_force.norm();
        if (gravity - gravity_m_s2).abs() > NOTABLE_GRAVITY_M_S2 {
            remarks.push(format!(
                "at rest the accelerometer feels {gravity:.2} m/s^2 where gravity is {gravity_m_s2:.2}: is it in \
                 m/s^2, and calibrated?"
            ));
        }
        remarks
    }

    fn remarks_on_rest(&self) -> Vec<String> {
        let rest = &self.rest;
        let mut remarks = Vec::new();
        if rest.length_s < SHORTEST_REST_S {
            remarks.push(format!(
                "the recording of {:.1} s is nowhere at rest for {SHORTEST_REST_S} s: even its quietest part scatters by \
                 {:.3} rad/s and {:.2} m/s^2; lay the vehicle on something solid, rotors off, and do not touch it",
                rest.recording_s, rest.quiet[0], rest.quiet[1]
            ));
        } else if rest.still_part < 0.99 {
            remarks.push(format!(
                "not at rest throughout: {:.0} % of {:.1} s is; used is the longest rest, from {:.1} s on for {:.1} s",
                100.0 * rest.still_part,
                rest.recording_s,
                rest.begin_s,
                rest.length_s
            ));
        }
        if rest.length_s >= SHORTEST_REST_S && rest.is_shaken() {
            remarks.push(format!(
                "it stands, and is shaken all the same ({:.3} rad/s and {:.2} m/s^2 within half a second): the figures are those \
                 of the vibration; switch the rotors off",
                rest.scatter[0], rest.scatter[1]
            ));
        }
        if rest.missing > 0 {
            remarks.push(format!(
                "{} samples are missing in the rest, and were passed over; if they are many, look at the driver's counts",
                rest.missing
            ));
        }
        remarks
    }
}

fn words(measured: Option<Measured>, at_most: Option<f64>) -> String {
    match (measured, at_most) {
        (Some(m), _) => format!("{:.3e} ±{:.1} %", m.value, 100.0 * m.sigma / m.value),
        (None, Some(at_most)) => format!("below {at_most:.1e}"),
        (None, None) => "not found".into(),
    }
}

fn remarks_on(sensor: &SensorNoise, name: &str, length_s: f64) -> Vec<String> {
    let mut remarks = Vec::new();
    let Some(density) = sensor.density else {
        return vec![format!(
            "{name}: no noise that could be looked at: stuck, or too short a rest ({length_s:.1} s); record a minute"
        )];
    };
    if sensor.walk.is_none() {
        remarks.push(format!(
            "{name}: {length_s:.0} s are too short to see the bias walk on every axis, the white noise hides it; {WALK_CURE}"
        ));
    }
    for (axis, letter) in sensor.axes.iter().zip(["x", "y", "z"]) {
        let Some(axis) = axis else { continue };
        if axis.density.value > NOTABLE_AXIS * density.value {
            remarks.push(format!("{name} {letter}: noisier than the others; is it loose, or shaken?"));
        }
        if axis.misfit > NOTABLE_MISFIT {
            let (floor, tau_s) = axis.floor;
            remarks.push(format!(
                "{name} {letter}: more than white noise and a walk (misfit {:.0}): the deviation has its floor of {floor:.1e} at \
                 {tau_s:.1} s; see the figure (--plot), and look for vibration or warming up",
                axis.misfit
            ));
        }
    }
    remarks
}
