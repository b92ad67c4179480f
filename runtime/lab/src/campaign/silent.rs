//! Sensors that fail without a word: faults that last from one moment to the end of the flight.

use super::fault::CampaignFault;
use plumbline_estimator::HealthBits;

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
}
