//! Sensors that fail without a word: faults that last from one moment to the end of the flight.

use super::fault::{CampaignFault, SILENT_FROM_S};
use plumbline_drivers::{ClockFault, ImageFaults, ImuFaults, StuckFault};
use plumbline_estimator::HealthBits;
use std::ops::Range;

/// When it lasts.
fn lasting() -> Range<f64> {
    SILENT_FROM_S..f64::INFINITY
}

impl CampaignFault {
    /// The health bits of which one names the sensor that fails in silence; none for faults of another kind.
    #[must_use]
    pub fn names(self) -> &'static [HealthBits] {
        match self {
            Self::GyroZero | Self::GyroAxisStuck => &[HealthBits::GYRO_STUCK],
            Self::AccelStuck => &[HealthBits::ACCEL_STUCK],
            Self::ImuFrozen => &[HealthBits::GYRO_STUCK, HealthBits::ACCEL_STUCK],
            Self::ImuLate100 | Self::ImuLate500 => &[HealthBits::IMU_LATE],
            Self::ImageFrozen => &[HealthBits::LEFT_FROZEN],
            Self::ImagesFrozen => &[HealthBits::LEFT_FROZEN, HealthBits::RIGHT_FROZEN],
            Self::ImagesLate => &[HealthBits::IMAGES_LATE],
            _ => &[],
        }
    }

    /// True if a sensor fails in silence.
    #[must_use]
    pub fn is_silent(self) -> bool {
        !self.names().is_empty()
    }

    /// Faults of the inertial samples, where they fail in silence.
    pub(super) fn silent_imu(self) -> ImuFaults {
        let [gyro, accel] = [0..3, 3..6].map(|axes: Range<usize>| std::array::from_fn(|k| axes.contains(&k)));
        let stuck = |axes: [bool; 6], at_zero| ImuFaults {
            stuck: Some(StuckFault { span_s: lasting(), axes, at_zero }),
            ..ImuFaults::default()
        };
        let late = |s| ImuFaults { clock: clock(s), ..ImuFaults::default() };
        match self {
            Self::GyroZero => stuck(gyro, true),
            Self::GyroAxisStuck => stuck(std::array::from_fn(|k| k == 1), false),
            Self::AccelStuck => stuck(accel, false),
            Self::ImuFrozen => stuck([true; 6], false),
            Self::ImuLate100 => late(0.1),
            Self::ImuLate500 => late(0.5),
            _ => ImuFaults::default(),
        }
    }

    /// Faults of the images, where they fail in silence.
    pub(super) fn silent_images(self) -> ImageFaults {
        let none = ImageFaults::default();
        match self {
            Self::ImageFrozen => ImageFaults { frozen: Some((lasting(), [true, false])), ..none },
            Self::ImagesFrozen => ImageFaults { frozen: Some((lasting(), [true; 2])), ..none },
            Self::ImagesLate => ImageFaults { clock: clock(0.2), ..none },
            _ => none,
        }
    }
}

fn clock(step_s: f64) -> Option<ClockFault> {
    Some(ClockFault { span_s: lasting(), step_s })
}
