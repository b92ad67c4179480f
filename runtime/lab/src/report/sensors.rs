//! What the sensors of a live flight brought, and what became of it.

use plumbline_drivers::{CameraMonitor, ImuFigures, SocketFigures, TriggerFigures, V4l2Figures};
use plumbline_flight::flight::LiveSensors;
use plumbline_flight::flight::capture::{Pairs, StreamFigures};
use serde::Serialize;

/// The sensors of a live flight.
#[derive(Clone, Debug, Serialize)]
pub struct Sensors {
    /// The inertial sensor.
    pub imu: Imu,
    /// The cameras.
    pub cameras: Cameras,
}

/// The inertial sensor.
#[derive(Clone, Debug, Serialize)]
pub struct Imu {
    /// Where it is.
    pub name: String,
    /// Its samples.
    #[serde(flatten)]
    pub stream: StreamFigures,
    /// Samples that came while its clock was being learnt: not handed out.
    pub settling: u64,
    /// Samples out of order of time: not handed out.
    pub disordered: u64,
    /// Samples of a gyroscope without their accelerometer: not handed out.
    pub unpaired: u64,
    /// Frames with the right checksum whose fields make no sense.
    pub malformed: u64,
    /// Samples with an axis at the end of its range.
    pub saturated: u64,
    /// Samples that repeated the ones before.
    pub stuck: u64,
    /// Samples that no sensor can measure: not handed out.
    pub impossible: u64,
    /// Steps of its temperature.
    pub temperature_steps: u64,
    /// Its last temperature, degrees Celsius.
    pub temperature_c: Option<f64>,
    /// How often it was opened, and went away.
    pub opened: u64,
    /// See `opened`.
    pub lost: u64,
    /// Its clock.
    pub clock: Clock,
    /// What came in as bytes.
    pub line: Line,
}

/// The clock of an inertial sensor against that of this computer.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Clock {
    /// This computer's less the sensor's, ns.
    pub offset_ns: i64,
    /// By how much this computer's runs faster, millionths.
    pub skew_ppm: f64,
    /// How often it was learnt afresh.
    pub restarts: u64,
    /// Samples whose time made no sense.
    pub refused: u64,
    /// Samples that came a millisecond or more later than the promptest.
    pub late: u64,
    /// The latest of them, ms.
    pub latest_ms: f64,
    /// Questions for its time that were answered.
    pub round_trips: u64,
    /// The quickest answer, ms.
    pub quickest_round_trip_ms: Option<f64>,
}

/// What came in as bytes.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Line {
    /// Bytes.
    pub bytes: u64,
    /// Frames with the right checksum.
    pub frames: u64,
    /// Bytes that were part of none.
    pub passed_over: u64,
    /// Frames with a wrong checksum.
    pub bad_checksums: u64,
    /// Announced lengths that were absurd.
    pub bad_lengths: u64,
}

/// The cameras.
#[derive(Clone, Debug, Serialize)]
pub struct Cameras {
    /// Where they are.
    pub name: String,
    /// Their frames.
    #[serde(flatten)]
    pub stream: StreamFigures,
    /// Which images frames had.
    #[serde(flatten)]
    pub pairs: Pairs,
    /// Why left and right bring nothing at the end, as far as they do not.
    pub trouble: [Option<String>; 2],
    /// Cameras of the kernel.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub v4l2: Option<V4l2>,
    /// A program that sends frames.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub socket: Option<Socket>,
    /// How frames were stamped, where a microcontroller triggers the cameras.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub triggers: Option<Triggers>,
}

/// How frames of triggered cameras were stamped.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Triggers {
    /// By their trigger.
    pub by_trigger: u64,
    /// By the triggers around theirs, whose message did not come.
    pub predicted: u64,
    /// By their driver less its usual delay.
    pub by_delay: u64,
    /// By their driver, since no trigger was ever known.
    pub by_driver: u64,
    /// Not handed out, since it was not known yet which triggers are theirs.
    pub held_back: u64,
    /// Not handed out, since number and time of their trigger contradicted each other.
    pub doubtful: u64,
    /// How often it was found out which trigger belongs to which frame.
    pub found: u64,
    /// The driver's stamp less the middle of the exposure, ms.
    pub delay_ms: f64,
}

/// Cameras of the kernel.
#[derive(Clone, Debug, Serialize)]
pub struct V4l2 {
    /// Pairs whose stamps are further apart than driver.pair_tolerance_s.
    pub apart: u64,
    /// Right less left stamp in the mean of the last pairs, ms.
    pub offset_ms: f64,
    /// How far a pair was from that, at most, ms.
    pub max_jitter_ms: f64,
    /// Measured time from image to image, ms.
    pub period_ms: f64,
    /// Left and right; a device that gives both images is the first.
    pub cameras: [V4l2Camera; 2],
}

/// A camera of the kernel.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct V4l2Camera {
    /// Images that came whole.
    pub images: u64,
    /// Missing by the numbers of the driver.
    pub missing: u64,
    /// Damaged, or not to be decoded.
    pub corrupt: u64,
    /// With a stamp that is not after that of the image before: not handed out.
    pub disordered: u64,
    /// Stamped by their arrival, since the driver's stamp made no sense.
    pub restamped: u64,
    /// Handed out without their partner.
    pub alone: u64,
    /// How often its stream was started.
    pub started: u64,
    /// How often it went away, or fell silent.
    pub lost: u64,
    /// Length of the exposure, ms; 0 where it is not known.
    pub exposure_ms: f64,
    /// From the middle of the exposure to the arrival: mean of the last images, and largest, ms.
    pub delay_ms: f64,
    /// See `delay_ms`.
    pub max_delay_ms: f64,
}

/// A program that sends frames.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Socket {
    /// How often one connected, and went away.
    pub connected: u64,
    /// See `connected`.
    pub lost: u64,
    /// How often one was sent away: no frames of this rig.
    pub refused: u64,
    /// Frames with a stamp that is not after that of the frame before: not handed out.
    pub disordered: u64,
    /// Frames stamped by their arrival, since their stamp made no sense.
    pub restamped: u64,
}

impl Sensors {
    /// After a flight.
    #[must_use]
    pub fn of(sensors: &LiveSensors) -> Self {
        let imu = Imu::of(&sensors.imu.name, sensors.imu.figures().0, &sensors.imu.monitor.read());
        let (stream, pairs) = sensors.cameras.figures();
        let (v4l2, socket) = match &sensors.cameras.monitor {
            CameraMonitor::V4l2(monitor) => (Some(V4l2::of(&monitor.figures())), None),
            CameraMonitor::Socket(monitor) => (None, Some(Socket::of(&monitor.figures()))),
        };
        let trouble = sensors.cameras.monitor.trouble();
        Self {
            imu,
            cameras: Cameras {
                name: sensors.cameras.name.clone(),
                stream,
                pairs,
                trouble,
                v4l2,
                socket,
                triggers: sensors.triggers.as_ref().map(|monitor| Triggers::of(&monitor.figures())),
            },
        }
    }

    /// For people: a line or two for each sensor.
    #[must_use]
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
                "{:<18}handed out {:.1} ms after their middle of exposure in the median, {:.1} at p99",
                "", cameras.stream.age_ms.p50, cameras.stream.age_ms.p99
            ),
        ];
        lines.extend(cameras.triggers.iter().map(Triggers::line));
        lines.push(format!(
            "{:<18}{} samples, {} missing, {:.2} Hz, {}",
            "IMU",
            imu.stream.count,
            imu.stream.missing,
            imu.stream.rate_hz,
            gaps(&imu.stream)
        ));
        let clock = &imu.clock;
        lines.push(format!(
            "{:<18}handed out {:.2} ms after their measurement in the median, {:.2} at p99; its clock is {:+.1} ppm off",
            "", imu.stream.age_ms.p50, imu.stream.age_ms.p99, -clock.skew_ppm
        ));
        lines
    }
}

impl Imu {
    fn of(name: &str, stream: StreamFigures, figures: &ImuFigures) -> Self {
        let ImuFigures { watch, clock, framing, link, .. } = figures;
        Self {
            name: name.to_owned(),
            stream,
            settling: figures.settling,
            disordered: figures.disordered,
            unpaired: figures.unpaired,
            malformed: figures.malformed,
            saturated: watch.saturated,
            stuck: watch.stuck,
            impossible: watch.impossible,
            temperature_steps: watch.temperature_steps,
            temperature_c: watch.temperature_c,
            opened: link.opened,
            lost: link.lost,
            clock: Clock {
                offset_ns: clock.offset_ns,
                skew_ppm: clock.skew_ppm,
                restarts: clock.restarts,
                refused: clock.refused,
                late: clock.late,
                latest_ms: clock.latest_ms,
                round_trips: clock.round_trips,
                quickest_round_trip_ms: clock.quickest_round_trip_ms,
            },
            line: Line {
                bytes: framing.bytes,
                frames: framing.frames,
                passed_over: framing.passed_over,
                bad_checksums: framing.bad_checksums,
                bad_lengths: framing.bad_lengths,
            },
        }
    }
}

impl V4l2 {
    fn of(figures: &V4l2Figures) -> Self {
        Self {
            apart: figures.apart,
            offset_ms: figures.offset_ms,
            max_jitter_ms: figures.max_jitter_ms,
            period_ms: figures.period_ms,
            cameras: figures.cameras.map(|camera| V4l2Camera {
                images: camera.images,
                missing: camera.missing,
                corrupt: camera.corrupt,
                disordered: camera.disordered,
                restamped: camera.restamped,
                alone: camera.alone,
                started: camera.started,
                lost: camera.lost,
                exposure_ms: camera.exposure_ms,
                delay_ms: camera.delay_ms,
                max_delay_ms: camera.max_delay_ms,
            }),
        }
    }
}

impl Triggers {
    fn of(figures: &TriggerFigures) -> Self {
        Self {
            by_trigger: figures.by_trigger,
            predicted: figures.predicted,
            by_delay: figures.by_delay,
            by_driver: figures.by_driver,
            held_back: figures.held_back,
            doubtful: figures.doubtful,
            found: figures.found,
            delay_ms: figures.delay_ms,
        }
    }

    fn line(&self) -> String {
        format!(
            "{:<18}{} stamped by their trigger, {} by those around it, {} without; the driver's stamps are {:.1} ms late",
            "",
            self.by_trigger,
            self.predicted,
            self.by_delay + self.by_driver,
            self.delay_ms
        )
    }
}

impl Socket {
    fn of(figures: &SocketFigures) -> Self {
        Self {
            connected: figures.connected,
            lost: figures.lost,
            refused: figures.refused,
            disordered: figures.disordered,
            restamped: figures.restamped,
        }
    }
}
