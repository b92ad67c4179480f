//! Mounting of the IMU in the vehicle: measured at rest, and by a nod.
//!
//! A level vehicle at rest shows where its vertical axis lies in the axes of the IMU: gravity says it, and that is roll and
//! pitch of the mounting. A nod (the nose is lifted and put down again, the vehicle turns about its left axis alone) shows that
//! axis by the gyroscope, and with it the heading of the mounting: lifting the nose is a negative turn about the left axis.

use crate::finding::Finding;
use crate::rest::{Rest, rest};
use crate::verdict::{Fitness, Measure};
use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};
use plumbline_config::options::{Mounting, VehicleConfig};
use plumbline_config::{Config, ImuSample};

/// Name of the measure of roll and pitch.
pub const NAME: &str = "mounting";
/// Name of the measure of the heading.
pub const HEADING_NAME: &str = "mounting heading";
/// Tilt against the configured mounting, degrees: a floor is level, grass is not.
const TILT: (f64, f64) = (5.0, 20.0);
/// A vehicle that is tilted by more, degrees, has no roll and pitch to be told.
const STEEP_DEG: f64 = 45.0;
/// Causes of gravity that points upwards.
const UPSIDE_DOWN_CAUSE: &str = "that the IMU is mounted upside down, or that the accelerometer is negated (at rest it reads +9.81 along the axis that points up)";
/// Cosine of the angle between the mean force and the vehicle's vertical beyond which it is upside down, and samples that it takes.
const DOWN: (f64, usize) = (-0.8, 1000);
/// Tilt of a vehicle that is upside down, degrees.
const UPSIDE_DOWN_DEG: f64 = 150.0;
/// Heading against the configured mounting, degrees: a hand does not nod about one axis alone.
const HEADING: (f64, f64) = (15.0, 30.0);
/// A nod is this large at least, and no somersault, degrees.
const NOD_DEG: std::ops::Range<f64> = 12.0..80.0;
/// Before and after a nod the vehicle is tilted by less, degrees.
const LEVEL_DEG: f64 = 4.0;
/// A nod is over after this time, s.
const LONGEST_S: f64 = 15.0;
/// After a nod the vehicle stands still within this time, s, and turns by less, rad/s.
const STANDS: (f64, f64) = (3.0, 0.02);
/// Least time at rest, s: of a recording, and for a warning in flight, which may be smooth.
const MIN_REST_S: (f64, f64) = (1.0, 2.0);
/// Off by less from gravity, m/s², the accelerometer measures gravity alone.
const GRAVITY_M_S2: f64 = 0.4;
/// Share of the turning that may be about other axes.
const ASIDE: f64 = 0.35;
/// Instructions for a measurement.
const NOD: &str = "put the vehicle level and still for three seconds, lift its nose by 30 degrees, put it down again, while \
                   `plumbline doctor --live` measures";

/// A nod that was seen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Nod {
    /// Angle by which the nose was lifted, degrees.
    pub degrees: f64,
    /// Rotation from the IMU to the vehicle that it shows.
    pub rot_v_b: UnitQuaternion<f64>,
}

/// The first nod after the vehicle was level and at rest.
pub fn nod(samples: &[ImuSample], rest: &Rest) -> Option<Nod> {
    let end = rest.first_end?;
    let up_b = rest.accel.try_normalize(1e-3)?;
    let after = &samples[samples.partition_point(|sample| sample.stamp < end)..];
    let first = after.first()?;
    let mut rot_0_t = UnitQuaternion::identity();
    // Turning since the vehicle was level: as a vector, as a length; and the largest tilt, with the rotation there.
    let (mut turned, mut total) = (Vector3::zeros(), 0.0);
    let mut peak = (0.0, Vector3::zeros(), 0.0, Vector3::zeros());
    for (index, pair) in after.windows(2).enumerate() {
        let dt_s = pair[1].stamp.seconds_since(pair[0].stamp);
        let rate = 0.5 * (pair[0].gyro + pair[1].gyro) - rest.gyro;
        rot_0_t *= UnitQuaternion::from_scaled_axis(rate * dt_s);
        turned += rot_0_t * rate * dt_s;
        total += rate.norm() * dt_s;
        let tilt_deg = (rot_0_t * up_b).angle(&up_b).to_degrees();
        if tilt_deg > peak.0 {
            peak = (tilt_deg, rot_0_t.scaled_axis(), total, turned);
        }
        let is_down = NOD_DEG.contains(&peak.0) && tilt_deg < LEVEL_DEG;
        if is_down {
            // A vehicle that flies is level for moments too.
            return by_axis(peak, &up_b).filter(|_| stands_soon(&after[index..], rest));
        }
        // Small motions before it are none of it.
        if peak.0 < LEVEL_DEG {
            (turned, total) = (Vector3::zeros(), 0.0);
        }
        if peak.0 >= LEVEL_DEG && pair[1].stamp.seconds_since(first.stamp) > LONGEST_S + rest.seconds {
            return None;
        }
    }
    None
}

/// True if the vehicle stands still within a few seconds of the first sample.
fn stands_soon(samples: &[ImuSample], before: &Rest) -> bool {
    let end = samples[0].stamp.plus_seconds(STANDS.0);
    let soon = &samples[..samples.partition_point(|sample| sample.stamp < end)];
    let again = rest(soon);
    again.seconds > 0.0 && (again.gyro - before.gyro).norm() < STANDS.1
}

/// The mounting by the turn up to the largest tilt: its angle, its rotation vector, how much was turned in all, and about which
/// vector.
fn by_axis(
    (degrees, axis, total, turned): (f64, Vector3<f64>, f64, Vector3<f64>),
    up_b: &Vector3<f64>,
) -> Option<Nod> {
    let about = axis - up_b * axis.dot(up_b);
    let is_about_one_axis =
        turned.norm() >= (1.0 - ASIDE) * total && about.norm() >= (1.0 - ASIDE) * axis.norm();
    let left_b = (-about).try_normalize(1e-3).filter(|_| is_about_one_axis)?;
    let forward_b = left_b.cross(up_b);
    let rows = Matrix3::from_rows(&[forward_b.transpose(), left_b.transpose(), up_b.transpose()]);
    let rot_v_b = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rows));
    Some(Nod { degrees, rot_v_b })
}

/// The time at rest, where it is at least so long and the accelerometer measures gravity alone.
fn standing(samples: &[ImuSample], config: &Config, least_s: f64) -> Option<Rest> {
    let is_gravity = |rest: &Rest| (rest.gravity_m_s2 - config.imu.gravity_m_s2).abs() < GRAVITY_M_S2;
    Some(rest(samples)).filter(|rest| rest.seconds >= least_s && is_gravity(rest))
}

/// Judges the mounting: roll and pitch by gravity at rest, the heading by a nod.
pub fn judge(samples: &[ImuSample], config: &Config) -> [Measure; 2] {
    let rest = standing(samples, config, MIN_REST_S.0);
    let nod = rest.as_ref().and_then(|rest| nod(samples, rest));
    let mounting = config.vehicle.rot_v_b();
    let tilt = match (&rest, &mounting) {
        (None, _) => {
            let cure = "let the vehicle stand for three seconds, motors off";
            let missing = Measure::missing(NAME, "the vehicle never stood still", cure);
            upside_down(samples, mounting.as_ref()).map_or(missing, |finding| finding.into_measure_of(NAME))
        }
        (Some(rest), None) => unknown(rest, nod, config),
        (Some(rest), Some(rot_v_b)) => level(rest, nod, rot_v_b),
    };
    let heading = match nod {
        None => Measure::missing(HEADING_NAME, "no nod was recognized", NOD),
        Some(nod) => heading(&nod, mounting.as_ref()),
    };
    [tilt, heading]
}

/// Gravity that points upwards in the vehicle for five seconds.
fn upside_down(samples: &[ImuSample], rot_v_b: Option<&UnitQuaternion<f64>>) -> Option<Finding> {
    let force: Vector3<f64> = samples.iter().map(|sample| sample.accel).sum();
    let up_v = (rot_v_b? * force).try_normalize(1e-6)?;
    (samples.len() >= DOWN.1 && up_v.z < DOWN.0).then(|| {
        Finding::new(
            "gravity points upwards in the vehicle",
            format!("mean force at {:.0} degrees from upwards", up_v.z.acos().to_degrees()),
            UPSIDE_DOWN_CAUSE,
            "correct `vehicle.imu_to_vehicle_deg`, or the signs of the accelerometer",
        )
    })
}

/// Warning of a mounting that gravity contradicts.
pub fn finding(samples: &[ImuSample], config: &Config) -> Option<Finding> {
    let rot_v_b = config.vehicle.rot_v_b()?;
    let Some(rest) = standing(samples, config, MIN_REST_S.1) else {
        return upside_down(samples, Some(&rot_v_b));
    };
    let measure = level(&rest, None, &rot_v_b);
    (measure.verdict == Fitness::NotFit).then(|| Finding::new(measure.name, measure.value, "", measure.cure))
}

/// An angle in degrees with `digits` decimals: neither -180 nor -0.
fn angle(degrees: f64, digits: usize) -> String {
    let text = format!("{degrees:.digits$}");
    let rounded: f64 = text.parse().unwrap_or(degrees);
    if rounded == 0.0 || rounded == -180.0 { format!("{:.digits$}", rounded.abs()) } else { text }
}

/// The key of the configuration for a mounting.
fn key(nod: &Nod) -> String {
    let [roll, pitch, yaw] =
        Mounting::of_rotation(&nod.rot_v_b).degrees().unwrap_or_default().map(|degrees| angle(degrees, 1));
    format!("`vehicle.imu_to_vehicle_deg = [{roll}, {pitch}, {yaw}]`, if the nose was lifted first")
}

/// Without a mounting neither an autopilot nor ROS 2 can be served.
fn unknown(rest: &Rest, nod: Option<Nod>, config: &Config) -> Measure {
    let is_needed = !config.autopilot.connect.is_empty() || config.ros.enabled;
    let verdict = if is_needed { Fitness::NotFit } else { Fitness::Mind };
    let up = rest.accel.normalize();
    let value =
        format!("unknown; at rest the vertical is along {:.2} {:.2} {:.2} of the IMU", up.x, up.y, up.z);
    let cure = match &nod {
        Some(nod) => format!("set {}", key(nod)),
        None => format!("{NOD}; {}", VehicleConfig::CURE),
    };
    Measure::new(NAME, verdict, value, cure, &[])
}

/// Roll and pitch against the configured mounting.
fn level(rest: &Rest, nod: Option<Nod>, rot_v_b: &UnitQuaternion<f64>) -> Measure {
    let up_v = rot_v_b * rest.accel;
    let tilt = up_v.angle(&Vector3::z()).to_degrees();
    // Attitude of the vehicle: right side down and nose up are positive.
    let roll = up_v.y.atan2(up_v.z).to_degrees();
    let pitch = up_v.x.atan2(up_v.z).to_degrees();
    let mut value = format!("at rest the vehicle is tilted by {tilt:.1} degrees");
    if tilt <= STEEP_DEG {
        value += &format!(" (roll {}, pitch {})", angle(roll, 1), angle(pitch, 1));
    }
    let cure = match &nod {
        Some(nod) => format!("on a level floor: set {}", key(nod)),
        None if tilt > UPSIDE_DOWN_DEG => format!(
            "probably {UPSIDE_DOWN_CAUSE}; negate the accelerometer, or correct `vehicle.imu_to_vehicle_deg`"
        ),
        None => "put the vehicle on a level floor; if it is, correct `vehicle.imu_to_vehicle_deg`".into(),
    };
    Measure::new(NAME, Fitness::within(tilt, TILT.0, TILT.1), value, cure, &[("tilt_deg", tilt)])
}

/// Heading that a nod shows, against that of the configured mounting.
fn heading(nod: &Nod, mounting: Option<&UnitQuaternion<f64>>) -> Measure {
    let Some(rot_v_b) = mounting else {
        let value = format!("shown by a nod of {:.0} degrees", nod.degrees);
        return Measure::new(HEADING_NAME, Fitness::Good, value, "", &[]);
    };
    let nose_v = rot_v_b * nod.rot_v_b.inverse() * Vector3::x();
    let heading = nose_v.y.atan2(nose_v.x).to_degrees();
    let side = if heading.round() < 0.0 { "right" } else { "left" };
    let value = format!(
        "by a nod of {:.0} degrees the nose is {} degrees to the {side} of the configured one",
        nod.degrees,
        angle(heading.abs(), 0)
    );
    let verdict = Fitness::within(heading.abs(), HEADING.0, HEADING.1);
    Measure::new(HEADING_NAME, verdict, value, format!("on a level floor: set {}", key(nod)), &[])
}

#[cfg(test)]
mod tests {
    use super::*;
    use plumbline_config::Timestamp;

    /// Samples of an IMU mounted so in a vehicle that rests, lifts its nose by so much, and is put down at once.
    fn samples(vehicle: &VehicleConfig, nose_deg: f64) -> Vec<ImuSample> {
        held_samples(vehicle, nose_deg, 0.0)
    }

    /// A nod whose nose is held up for a while, s.
    fn held_samples(vehicle: &VehicleConfig, nose_deg: f64, held_s: f64) -> Vec<ImuSample> {
        let rot_b_v = vehicle.rot_v_b().unwrap().inverse();
        let bias = Vector3::new(0.004, -0.003, 0.002);
        // Angle of the nose over time, s: two seconds of rest, up and down within four.
        let angle = |t: f64| match if t < 4.0 { t } else { (t - held_s).max(4.0) } {
            t if !(2.0..6.0).contains(&t) => 0.0,
            t => nose_deg.to_radians() * 0.5 * (1.0 - (std::f64::consts::TAU * (t - 2.0) / 4.0).cos()),
        };
        let sample = |k: i64| {
            let t = k as f64 * 0.005;
            let rate = (angle(t + 1e-4) - angle(t - 1e-4)) / 2e-4;
            let rot_w_v = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), -angle(t));
            ImuSample {
                stamp: Timestamp::from_nanos(k * 5_000_000),
                gyro: rot_b_v * Vector3::new(0.0, -rate, 0.0) + bias,
                accel: rot_b_v * (rot_w_v.inverse() * Vector3::new(0.0, 0.0, 9.81)),
            }
        };
        (0..1600 + (200.0 * held_s) as i64).map(sample).collect()
    }

    fn config(vehicle: VehicleConfig) -> Config {
        let mut config = Config::preset("sim").unwrap().into_inner();
        config.vehicle = vehicle;
        config
    }

    #[test]
    fn a_nod_tells_any_mounting() {
        for degrees in [[0.0, 0.0, 0.0], [180.0, -70.3, 0.0], [-90.0, 0.0, 90.0], [12.0, 34.0, -120.0]] {
            let vehicle = VehicleConfig::mounted(degrees);
            let samples = samples(&vehicle, 30.0);
            let rest = rest(&samples);
            let nod = nod(&samples, &rest).unwrap();
            let off = nod.rot_v_b.angle_to(&vehicle.rot_v_b().unwrap()).to_degrees();
            assert!(off < 0.5 && (nod.degrees - 30.0).abs() < 0.5, "{degrees:?}: {off} {nod:?}");
        }
    }

    #[test]
    fn a_vehicle_that_flies_off_tilted_does_not_nod() {
        let vehicle = VehicleConfig::mounted([0.0, 0.0, 0.0]);
        let mut flying = samples(&vehicle, -20.0);
        // Level again it shakes and turns.
        for (k, sample) in flying.iter_mut().enumerate().skip(1100) {
            let shake = if k % 2 == 0 { 1.0 } else { -1.0 };
            sample.gyro += Vector3::new(0.1 * shake, 0.0, 0.5);
            sample.accel.z += shake;
        }
        assert_eq!(nod(&flying, &rest(&flying)), None);
    }

    #[test]
    fn an_unknown_mounting_is_measured_and_its_key_proposed() {
        let vehicle = VehicleConfig::mounted([180.0, 0.0, 0.0]);
        let samples = samples(&vehicle, 25.0);
        let [measure, _] = judge(&samples, &config(VehicleConfig::default()));
        assert_eq!(measure.verdict, Fitness::Mind);
        let key = measure.cure.strip_prefix("set `vehicle.imu_to_vehicle_deg = [").unwrap();
        let roll: f64 = key.split(',').next().unwrap().parse().unwrap();
        assert!((roll.abs() - 180.0).abs() < 0.2, "{}", measure.cure);
        // An autopilot needs it.
        let mut config = config(VehicleConfig::default());
        config.autopilot.connect = "udp://127.0.0.1:14540".into();
        assert_eq!(judge(&samples, &config)[0].verdict, Fitness::NotFit);
        // Rest alone does not tell the heading.
        let [still, heading] = judge(&samples[..400], &config);
        assert_eq!(heading.verdict, Fitness::NotMeasured, "{}", heading.value);
        assert!(still.cure.contains("lift its nose") && still.verdict == Fitness::NotFit, "{}", still.cure);
    }

    #[test]
    fn a_mounting_turned_about_the_vertical_is_found_by_a_nod_alone() {
        let samples = samples(&VehicleConfig::mounted([0.0, 0.0, 90.0]), 30.0);
        let level = config(VehicleConfig::mounted([0.0, 0.0, 0.0]));
        let [tilt, heading] = judge(&samples, &level);
        assert_eq!((tilt.verdict, heading.verdict), (Fitness::Good, Fitness::NotFit), "{}", heading.value);
        assert!(heading.cure.contains("90.0]`, if the nose was lifted first"), "{}", heading.cure);
        // Without a nod roll and pitch are good, and the heading is open.
        let [tilt, heading] = judge(&samples[..400], &level);
        assert_eq!((tilt.verdict, heading.verdict), (Fitness::Good, Fitness::NotMeasured), "{}", tilt.value);
        assert!(heading.cure.contains("lift its nose"), "{}", heading.cure);
    }

    #[test]
    fn a_nose_held_up_changes_neither_tilt_nor_gravity() {
        let vehicle = VehicleConfig::mounted([0.0, 0.0, 0.0]);
        let samples = held_samples(&vehicle, 30.0, 4.0);
        let rest = rest(&samples);
        let config = config(vehicle);
        let [tilt, heading] = judge(&samples, &config);
        assert!(tilt.figures["tilt_deg"] < 0.5, "{}", tilt.value);
        assert_eq!((tilt.verdict, heading.verdict), (Fitness::Good, Fitness::Good), "{}", heading.value);
        assert!(heading.value.contains("the nose is 0 degrees to the left"), "{}", heading.value);
        assert!((rest.gravity_m_s2 - 9.81).abs() < 0.01, "{rest:?}");
        assert!(rest.seconds > 6.0, "{rest:?}");
    }

    #[test]
    fn a_mounting_on_its_side_or_turned_round_is_told_without_signs_that_mean_nothing() {
        let vehicle = VehicleConfig::mounted([90.0, 0.0, 0.0]);
        let tilted = held_samples(&vehicle, 0.0, 0.0);
        let level = config(VehicleConfig::mounted([0.0, 0.0, 0.0]));
        let [tilt, _] = judge(&tilted, &level);
        assert_eq!(tilt.value, "at rest the vehicle is tilted by 90.0 degrees");
        let found = finding(&tilted, &level).unwrap().to_string();
        assert!(found.starts_with("mounting (at rest the vehicle is tilted by 90.0 degrees)"), "{found}");
        assert_eq!(finding(&tilted, &config(vehicle)), None);
        for (degrees, digits, text) in
            [(-179.97, 1, "180.0"), (-180.0, 0, "180"), (-0.01, 1, "0.0"), (-0.4, 0, "0"), (-90.0, 0, "-90")]
        {
            assert_eq!(angle(degrees, digits), text);
        }
    }
}
