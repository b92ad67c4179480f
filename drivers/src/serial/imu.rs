//! A serial inertial sensor as a source of samples.

use super::port::{Port, Waited};
use super::protocol::Outgoing;
use super::stream::Stream;
use crate::clock::monotonic_ns;
use crate::inertial::{ImuFigures, ImuMonitor, Post};
use crate::{DriverError, Faults, ImuReading, ImuSource, StopFlag};
use plumbline_config::options::{ImuConfig, ImuDriverConfig, SerialLine};
use plumbline_protocol::Settings;

/// A serial inertial sensor: it may be missing at the start, and may go away and come back.
pub struct SerialImu {
    port: Port,
    stream: Stream,
    outgoing: Outgoing,
    /// Arrival of the bytes at hand.
    arrival_ns: i64,
    stop: StopFlag,
    post: Post,
}

impl SerialImu {
    /// Opens the sensor at this line, whose rate and ranges `imu` gives. With `driver.trigger_cameras` its
    /// microcontroller triggers the cameras `camera_rate_hz` times a second.
    ///
    /// # Errors
    /// When what is there cannot be used. A device that is not there is waited for.
    pub fn at(
        line: &SerialLine,
        driver: &ImuDriverConfig,
        imu: &ImuConfig,
        camera_rate_hz: f64,
        stop: StopFlag,
    ) -> Result<Self, DriverError> {
        let port = Port::open(line)?;
        let autopilot = (driver.mavlink_message, imu.rate_hz);
        let protocol = super::opened(driver.protocol, autopilot, settings(driver, imu, camera_rate_hz));
        let delay_ns = (driver.delay_s * 1e9).round() as i64;
        Ok(Self {
            port,
            stream: Stream::new(protocol, imu, delay_ns),
            outgoing: Outgoing::default(),
            arrival_ns: 0,
            stop,
            post: Post::default(),
        })
    }

    /// Figures of the samples so far.
    pub fn figures(&self) -> ImuFigures {
        self.stream.figures(self.port.figures())
    }

    /// Monitor of the figures for other threads; it lags by a moment.
    pub fn monitor(&self) -> ImuMonitor {
        self.post.monitor()
    }

    /// Says what is to be said, waits for bytes and takes them.
    fn exchange(&mut self) {
        self.stream.request(monotonic_ns(), &mut self.outgoing);
        if !self.outgoing.bytes().is_empty() {
            let taken = self.port.write(self.outgoing.bytes());
            self.outgoing.sent(taken);
        }
        match self.port.wait(PATIENCE_MS) {
            Waited::Bytes => {
                let count = self.port.read(self.stream.space());
                // After the bytes are here: late is ignored, early would be believed.
                self.arrival_ns = monotonic_ns();
                self.stream.came(count);
            }
            Waited::Nothing => {}
            Waited::Anew => {
                self.stream.reopened();
                self.outgoing.clear();
            }
        }
    }
}

/// From one look at what is to be said to the next, ms: a question for the time is due every 100.
const PATIENCE_MS: u32 = 20;
const _: () = assert!(PATIENCE_MS <= StopFlag::PATIENCE_MS);

/// Settings asked of the microcontroller.
fn settings(driver: &ImuDriverConfig, imu: &ImuConfig, camera_rate_hz: f64) -> Settings {
    let thousandths = |hertz: f64| (hertz * 1e3).round() as u32;
    Settings {
        imu_rate_mhz: thousandths(imu.rate_hz),
        trigger_rate_mhz: if driver.trigger_cameras { thousandths(camera_rate_hz) } else { 0 },
        trigger_pulse_us: (driver.trigger_pulse_s * 1e6).round() as u32,
        cameras: if driver.trigger_cameras { 0b11 } else { 0 },
    }
}

impl ImuSource for SerialImu {
    fn next_reading(&mut self) -> Result<Option<ImuReading>, DriverError> {
        loop {
            if let Some(reading) = self.stream.next(self.arrival_ns) {
                return Ok(Some(reading));
            }
            let Self { post, stream, port, .. } = self;
            post.put(monotonic_ns(), || stream.figures(port.figures()));
            if self.stop.is_stopped() {
                self.post.last(self.stream.figures(self.port.figures()));
                return Ok(None);
            }
            self.exchange();
        }
    }

    fn faults(&self) -> Faults {
        self.figures().faults()
    }
}
