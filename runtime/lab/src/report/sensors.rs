//! Figures of the sensors of a live flight, and of what became of their data.

use plumbline_drivers::{CameraMonitor, ImuFigures, SocketFigures, V4l2Figures};
use plumbline_flight::flight::LiveSensors;
use plumbline_flight::flight::capture::{PairCounts, StreamFigures};
use serde::Serialize;

/// The sensors of a live flight.
#[derive(Clone, Debug, Serialize)]
pub struct SensorReport {
    /// The inertial sensor.
    pub imu: ImuReport,
    /// The cameras.
    pub cameras: CameraReport,
}

/// The inertial sensor.
#[derive(Clone, Debug, Serialize)]
pub struct ImuReport {
    /// Its place.
    pub name: String,
    /// Its samples.
    #[serde(flatten)]
    pub stream: StreamFigures,
    /// Counts of what became of them before.
    #[serde(flatten)]
    pub figures: ImuFigures,
}

/// The cameras.
#[derive(Clone, Debug, Serialize)]
pub struct CameraReport {
    /// Their places.
    pub name: String,
    /// Their frames.
    #[serde(flatten)]
    pub stream: StreamFigures,
    /// Images of the frames.
    #[serde(flatten)]
    pub pairs: PairCounts,
    /// Why left and right bring nothing at the end, as far as they do not.
    pub trouble: [Option<String>; 2],
    /// Cameras of the kernel.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub v4l2: Option<V4l2Figures>,
    /// A program that sends frames.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub socket: Option<SocketFigures>,
}

impl SensorReport {
    /// After a flight.
    pub fn of(sensors: &LiveSensors) -> Self {
        let imu = ImuReport {
            name: sensors.imu.name.clone(),
            stream: sensors.imu.figures().0,
            figures: sensors.imu.monitor.read(),
        };
        let (stream, pairs) = sensors.cameras.figures();
        let (v4l2, socket) = match &sensors.cameras.monitor {
            CameraMonitor::V4l2(monitor) => (Some(monitor.figures()), None),
            CameraMonitor::Socket(monitor) => (None, Some(monitor.figures())),
        };
        let trouble = sensors.cameras.monitor.trouble();
        Self {
            imu,
            cameras: CameraReport {
                name: sensors.cameras.name.clone(),
                stream,
                pairs,
                trouble,
                v4l2,
                socket,
            },
        }
    }

    /// For people: a line or two for each sensor.
    pub fn lines(&self) -> Vec<String> {
        let (imu, cameras) = (&self.imu, &self.cameras);
        let gaps = |stream: &StreamFigures| match stream.gaps {
            0 => "no gap".to_owned(),
            gaps => format!("{gaps} gaps, the longest {:.0} ms", stream.longest_gap_ms),
        };
        let mut lines = vec![
            format!(
                "{:<18}{} pairs, {} left alone, {} right alone, {} missing, {:.2} Hz, {}",
                "cameras",
                cameras.pairs.pairs,
                cameras.pairs.left_alone,
                cameras.pairs.right_alone,
                cameras.stream.missing,
                cameras.stream.rate_hz,
                gaps(&cameras.stream)
            ),
            format!(
                "{:<18}delay from the middle of the exposure to delivery: median {:.1} ms, p99 {:.1} ms",
                "", cameras.stream.age_ms.p50, cameras.stream.age_ms.p99
            ),
        ];
        lines.push(format!(
            "{:<18}{} samples, {} missing, {:.2} Hz, {}",
            "IMU",
            imu.stream.count,
            imu.stream.missing,
            imu.stream.rate_hz,
            gaps(&imu.stream)
        ));
        let clock = &imu.figures.clock;
        // Without samples there is no delay and no clock.
        lines.extend((imu.stream.count > 0).then(|| format!(
            "{:<18}delay from the measurement to delivery: median {:.2} ms, p99 {:.2} ms; the IMU's clock runs {}",
            "",
            imu.stream.age_ms.p50,
            imu.stream.age_ms.p99,
            clock_words(-clock.skew_ppm)
        )));
        lines
    }
}

/// Error of a clock: "0.5 ppm fast".
fn clock_words(ppm: f64) -> String {
    format!("{:.1} ppm {}", ppm.abs(), if ppm < 0.0 { "slow" } else { "fast" })
}
