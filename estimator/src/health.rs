//! Health bits, each declared once: number, name, meaning, probable causes and cure.
//!
//! From this table come the findings of a flight, the table in `docs/health.md` and the class `plumbline.Health` of the Python
//! package; `make messages` writes both files.

use plumbline_fields::{FieldContent, Shape, Value};

/// Error and warning bits of an estimate.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct HealthBits(pub u32);

/// One number in messages.
impl FieldContent for HealthBits {
    const SHAPE: Shape = Shape::Uint32;

    fn get(&self) -> Value<'_> {
        Value::Whole(self.0.into())
    }

    fn set(&mut self, value: Value<'_>) -> Result<(), &'static str> {
        self.0 = value.whole() as u32;
        Ok(())
    }
}

/// A health bit as people are told of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HealthBit {
    /// The bit.
    pub bit: HealthBits,
    /// Name.
    pub name: &'static str,
    /// Meaning, for who reads up on it.
    pub meaning: &'static str,
    /// Finding in one sentence, for who has never heard of it.
    pub finding: &'static str,
    /// Probable causes; empty where the bit is no fault.
    pub causes: &'static str,
    /// Cure; empty where the bit is no fault.
    pub cure: &'static str,
}

impl HealthBit {
    /// True if the bit is a fault. Standing still, for example, is none.
    pub const fn is_fault(&self) -> bool {
        !self.cure.is_empty()
    }
}

/// Causes and cure of readings that repeat.
const STUCK: (&str, &str) = (
    "a sensor or driver that hands out old readings, a range that is too small (it stays at its end), or a simulator without noise",
    "restart the sensor, or choose a larger range; for data without noise set `imu.stuck_after_s = 0`",
);
/// Causes and cure of images that repeat.
const FROZEN: (&str, &str) = (
    "a camera that hangs, a driver that hands out an image again (twice the frame rate, or a frame that was dropped), or a simulator \
     without noise",
    "restart the camera, and hand out each image once, with its own stamp; for simulated images without noise set \
     `estimator.health.refuse_repeated_images = false`",
);

/// Defines the bits: meaning, number, constant, name, finding, and causes with cure.
macro_rules! health_bits {
    ($($(#[doc = $meaning:literal])+ $number:literal $constant:ident $name:literal, $finding:literal, $advice:expr;)*) => {
        impl HealthBits {
            $(
                $(#[doc = $meaning])+
                pub const $constant: Self = Self(1 << $number);
            )*

            /// Number of bits.
            pub const COUNT: usize = [$($number),*].len();

            /// Every bit with its name, for people.
            pub const NAMES: [(Self, &'static str); Self::COUNT] = [$((Self::$constant, $name)),*];

            /// Every bit with what people are told of it.
            pub const ABOUT: [HealthBit; Self::COUNT] = [$(HealthBit {
                bit: Self::$constant,
                name: $name,
                meaning: concat!($($meaning),+).trim_ascii(),
                finding: $finding,
                causes: $advice.0,
                cure: $advice.1,
            }),*];
        }
    };
}

health_bits! {
    /// The covariance, or the normal equations, were not positive definite.
    0 NOT_POSITIVE_DEFINITE "not positive definite", "the covariance of the estimate broke down", (
        "units or a calibration that are far off",
        "run `plumbline doctor` on the data; if they are sound, report it with the log",
    );
    /// A reading is at the end of the range.
    1 IMU_SATURATED "IMU saturated", "the IMU was at the end of its range", (
        "shocks, or a range that is too small",
        "choose a larger range in the sensor and the same in `imu.accel_range_m_s2` and `imu.gyro_range_rad_s`; damp the mounting",
    );
    /// No point was tracked in this frame.
    2 NO_FEATURES "no features", "no point was found in the images", (
        "darkness, a covered lens, no focus, or plain surfaces",
        "look at light, exposure and focus",
    );
    /// Fewer points than a reliable estimate needs.
    3 LOW_FEATURES "few features", "few points were found in the images", (
        "little light or texture, a lens out of focus, or blur",
        "look at light, exposure and focus; fly more slowly where there is little texture",
    );
    /// The velocity in the body frame is less certain than `estimator.health` requires. Normal for a few seconds after a start or in the dark.
    4 VELOCITY_UNCERTAIN "velocity uncertain", "the velocity is less certain than `estimator.health` requires", (
        "a scene that is far for the distance between the cameras, one camera that hardly moves, or few points",
        "fly nearer to texture, or use a longer distance between the cameras",
    );
    /// Inertial samples are missing since the last frame.
    5 IMU_GAP "IMU gap", "inertial samples are missing", (
        "a cable, the baud rate, or a program that does not keep up",
        "look at cable, baud rate and load",
    );
    /// Frames are missing since the last one.
    6 FRAME_GAP "frame gap", "frames are missing", (
        "bandwidth, load, or a recorder that did not keep up",
        "look at bandwidth and load",
    );
    /// The left image is missing, or black while the right one is not.
    7 LEFT_MISSING "left image missing", "the left image is missing or black", (
        "a cable, or a covered lens",
        "look at the cable of the left camera and at its lens",
    );
    /// The right image of a stereo rig is missing, or black while the left one is not.
    8 RIGHT_MISSING "right image missing", "the right image is missing or black", (
        "a cable, or a covered lens",
        "look at the cable of the right camera and at its lens",
    );
    /// The stamp is not later than the one before, or implausible: the frame was refused, and the state is that of the frame before.
    9 BAD_STAMP "bad stamp", "frames were refused for their stamps", (
        "a clock that was set, or stamps that repeat",
        "stamp by one clock that is never set, such as CLOCK_MONOTONIC",
    );
    /// An image has another size than the configuration says.
    10 BAD_IMAGE_SIZE "bad image size", "images have another size than the configuration says", (
        "another mode of the camera, or the calibration of another size",
        "correct `width_px` and `height_px` of `[[camera]]` with the calibration of that size, or the camera's mode",
    );
    /// The vehicle stands still: not a fault.
    11 STATIONARY "stationary", "the vehicle stands still", ("", "");
    /// The frame was processed with less than the configured work.
    12 DEGRADED "degraded", "frames got less than the configured work", (
        "a computer that does not keep up",
        "use fewer points, smaller images or a faster computer",
    );
    /// Few points are found in both images, or one image has jumped against the other.
    13 CAMERAS_DISAGREE "cameras disagree", "left and right images do not agree", (
        "images that are not of the same moment (one camera late or frozen), a camera that has been knocked, images that are \
         exchanged, mirrored or turned, or a calibration of the pair that is wrong",
        "run `plumbline doctor` on the data: it tells these apart",
    );
    /// The images contradict the inertial samples as a whole; the estimate follows the images. The quality is at most 10.
    14 IMU_CONTRADICTED "IMU contradicted", "the images contradict the IMU", (
        "a shock, a wrong scale (distance between the cameras, unit of the accelerometer), a wrong lens model, a focus that moves, or \
         stamps that are off",
        "wait a second after a shock; else run `plumbline doctor` on the data",
    );
    /// The estimator assumes at least twice the configured noise of the accelerometer.
    15 ACCEL_NOISY "accelerometer noisy", "the accelerometer is noisier than configured, or contradicts the scale of the images", (
        "vibration, a configured noise that is that of a data sheet, stamps of the samples that scatter or are late, or a distance between \
         the cameras (baseline) that is wrong",
        "run `plumbline doctor` on the data, which measures noise and scale; where the scale is right, set `imu.accel_noise_density` to the \
         noise in flight and damp the mounting",
    );
    /// Readings of the gyroscope, or of one of its axes, repeat bit for bit, and are not used.
    16 GYRO_STUCK "gyroscope stuck", "the gyroscope repeats its readings", STUCK;
    /// Readings of the accelerometer, or of one of its axes, repeat bit for bit, and are not used.
    17 ACCEL_STUCK "accelerometer stuck", "the accelerometer repeats its readings", STUCK;
    /// The left image repeats the one before, bit for bit or, in flight, but for its noise: it counts as missing.
    18 LEFT_FROZEN "left image frozen", "the left camera repeats its images", FROZEN;
    /// The right image repeats the one before, bit for bit or, in flight, but for its noise: it counts as missing.
    19 RIGHT_FROZEN "right image frozen", "the right camera repeats its images", FROZEN;
    /// The inertial samples show the rotation that the images showed earlier: their stamps are late, and they are not used. The estimate
    /// uses images only, and moving things can mislead it. The quality is at most 10.
    20 IMU_LATE "IMU late", "the inertial samples are stamped late", (
        "stamps of the arrival, a clock of its own, or a focal length that is off",
        "stamp samples when they are measured; for a constant delay set `driver.imu.delay_s`, which takes effect in flight, not in `replay`",
    );
    /// The images show the rotation that the gyroscope measured earlier: their stamps are late. The quality is at most 10.
    21 IMAGES_LATE "images late", "the images are stamped late", (
        "stamps of the arrival, or of another clock than that of the IMU; a focal length that is off; or a cabin, deck or other carrier that fills the view and moves",
        "give each image the time of its exposure; `plumbline doctor` measures a constant delay for `rig.time_offset_s`",
    );
    /// Gyroscope and images have disagreed for a second, and neither can be named. The quality is at most 10.
    22 ROTATION_DISPUTED "rotation disputed", "gyroscope and images disagree on how the vehicle turns", (
        "images that are mirrored or turned, columns or signs of the gyroscope, the pose of the camera on the IMU, a wrong lens model or \
         focal length, stamps that are off, or things that move and fill the view",
        "run `plumbline doctor` on the data",
    );
    /// By the gyroscope, the image moved by more than 3 px during the exposure; only with `camera.0.exposure_s`.
    24 BLURRED "blurred", "turning blurs the images", (
        "an exposure that is too long for these turns",
        "turn more slowly, or expose for a shorter time with more light",
    );
    /// The accelerometer, or one of its axes, does not fit the motion that the images show, and is nearly ignored. The quality is at most 10.
    27 ACCEL_CONTRADICTED "accelerometer contradicted", "the images contradict the accelerometer", (
        "a shock, forces beyond the range, stamps that are off, columns or signs of the accelerometer, a loose mounting, or a broken \
         sensor",
        "wait a second after a shock; else run `plumbline doctor` on the data, and look at stamps, mounting and range",
    );
    /// The images turn otherwise than the gyroscope, and no delay explains it; the quality is at most 10.
    28 GYRO_CONTRADICTED "gyroscope contradicted", "the images contradict the gyroscope", (
        "images that are mirrored or turned, columns, signs or units of the gyroscope, the pose of the camera on the IMU, or a broken sensor",
        "run `plumbline doctor` on the data",
    );
    /// Left and right image are not of the same moment; the quality is at most 10.
    29 CAMERAS_OUT_OF_STEP "cameras out of step", "left and right image are not of the same moment", (
        "one camera that is late by a frame, or cameras that are triggered apart",
        "trigger both cameras together; look at which frames the driver pairs; `plumbline doctor` measures which camera is late, and by how much",
    );
    /// By the data, a focal length or the distance between the cameras is off by more than 3 %; the quality is at most 10.
    30 SCALE_CONTRADICTED "scale contradicted", "by the data, a focal length or the distance between the cameras is wrong", (
        "a calibration of another camera, image size or rig, a lens that was turned, a unit, or an accelerometer that reads a multiple",
        "run `plumbline doctor` on the data: it measures focal lengths, distance and scale",
    );
}

impl HealthBits {
    /// Sets the bits of `other`.
    pub fn insert(&mut self, other: Self) {
        self.0 |= other.0;
    }

    /// True if all bits of `other` are set.
    #[must_use]
    pub fn contains(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }

    /// Findings of the bits that are set and are faults, each with its cure.
    pub fn advice(self) -> impl Iterator<Item = String> {
        let faults =
            Self::ABOUT.into_iter().filter(move |about| self.contains(about.bit) && !about.cure.is_empty());
        faults.map(|about| format!("{}: {}", about.finding, about.cure))
    }

    /// Names of the bits that are set.
    pub fn names(self) -> impl Iterator<Item = &'static str> {
        Self::NAMES.into_iter().filter(move |(bit, _)| self.contains(*bit)).map(|(_, name)| name)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_bit_has_a_place_of_its_own_and_every_fault_causes_and_a_cure() {
        assert!(HealthBits::ABOUT.is_sorted_by(|before, about| before.bit.0 < about.bit.0));
        for about in &HealthBits::ABOUT {
            assert!(about.bit.0.is_power_of_two(), "{}", about.name);
            assert!(!about.meaning.is_empty() && !about.finding.is_empty(), "{}", about.name);
            assert_eq!(about.causes.is_empty(), about.cure.is_empty(), "{}", about.name);
        }
        let calm = HealthBits::ABOUT.iter().filter(|about| !about.is_fault()).map(|about| about.bit);
        assert_eq!(calm.collect::<Vec<_>>(), [HealthBits::STATIONARY]);
    }
}
