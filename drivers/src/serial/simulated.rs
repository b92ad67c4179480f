//! Devices that play a known motion, for tests and fuzzers.

use super::protocol::Protocol;
use plumbline_config::options::{ImuConfig, ImuProtocol, MavlinkImu};
use plumbline_protocol::Settings;

/// A sensor of wide ranges.
pub fn imu_config(rate_hz: f64) -> ImuConfig {
    ImuConfig::with_noise(rate_hz, (1e-3, 1e-5), (1e-2, 1e-3))
}

/// Rate of the x axis from one sample to the next, rad/s: the number of a sample stands in its values.
pub const STEP_RAD_S: f64 = 1e-4;

/// A device that measures at whole periods of the host's clock from `start_ns` on, and stamps by a clock of its own.
#[derive(Clone, Copy, Debug)]
pub struct Device {
    pub protocol: ImuProtocol,
    pub rate_hz: i64,
    pub start_ns: i64,
    /// Device seconds per host second, less one.
    pub skew: f64,
}

impl Device {
    /// Time at which sample `k` is measured by the host's clock, ns.
    pub fn truth_ns(&self, k: i64) -> i64 {
        self.start_ns + k * 1_000_000_000 / self.rate_hz
    }

    /// The device's time for a time of the host, ns.
    pub fn device_ns(&self, host_ns: i64) -> i64 {
        let since = host_ns - self.start_ns;
        3_000_000_000 + since + (since as f64 * self.skew).round() as i64
    }

    /// The frame of sample `k`.
    pub fn frame(&self, k: i64) -> Vec<u8> {
        let device_ns = self.device_ns(self.truth_ns(k));
        let gyro = [(k as f64 * STEP_RAD_S) as f32, 0.01, -0.02];
        let accel = [0.1, 0.2, 9.81 + 1e-3 * (k % 7) as f32];
        opened(self.protocol).played(k, device_ns, gyro, accel)
    }
}

/// A protocol as it is where nothing is said of it.
pub fn opened(protocol: ImuProtocol) -> Box<dyn Protocol> {
    super::opened(protocol, (MavlinkImu::HighresImu, 200.0), Settings::default())
}
