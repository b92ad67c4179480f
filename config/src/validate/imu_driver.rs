//! Validation of the inertial sensor's address, and of what its line can carry.

use crate::Config;
use crate::error::Violation;
use crate::options::{ImuEndpoint, ImuProtocol};

pub(super) fn check(config: &Config, found: &mut Vec<Violation>) {
    let driver = &config.driver.imu;
    let mut refuse = |key: &str, reason: String, cure: &str| {
        found.push(Violation::new(format!("driver.imu.{key}"), reason, cure));
    };
    let rate_hz = config.camera.first().map_or(0.0, |camera| camera.rate_hz);
    if driver.trigger_cameras && driver.trigger_pulse_s * rate_hz >= 1.0 {
        let reason = format!("{} s are as long as the time from image to image", driver.trigger_pulse_s);
        refuse("trigger_pulse_s", reason, "choose less than 1 / camera[0].rate_hz");
    }
    if driver.connect.is_empty() {
        return;
    }
    let endpoint = match ImuEndpoint::parse(&driver.connect) {
        Ok(endpoint) => endpoint,
        Err(reason) => {
            return refuse(
                "connect",
                reason,
                "write serial://DEVICE:BAUD such as \"serial:///dev/ttyACM0:921600\", iio://NAME, or \
                 iio://GYROSCOPE,ACCELEROMETER; `plumbline devices` lists both kinds; \"\" for none",
            );
        }
    };
    let is_ours = matches!(endpoint, ImuEndpoint::Serial(_)) && driver.protocol == ImuProtocol::Plumbline;
    if driver.trigger_cameras && !is_ours {
        let reason = "only a microcontroller with our own protocol triggers cameras".into();
        refuse("trigger_cameras", reason, "set it to false, or driver.imu.protocol to \"plumbline\"");
    }
    if let ImuEndpoint::Serial(line) = endpoint {
        let sample_bytes = driver.protocol.sample_bytes(driver.mavlink_message);
        let rate_hz = config.imu.rate_hz;
        if let Some(reason) = line.too_slow(rate_hz * sample_bytes, &format!("imu.rate_hz = {rate_hz}")) {
            refuse("connect", reason, "use a faster line, such as 921600, or a lower rate");
        }
    }
}
