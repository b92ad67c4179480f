//! Tells, while a flight goes on, which sensors are missing and which are back. A thread of normal priority asks their
//! drivers some times a second; nothing of it is on the way of a sample.

use super::sensors::LiveSensors;
use plumbline_drivers::inertial::LinkFigures;
use plumbline_drivers::{ImuFigures, TriggerMonitor};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Drivers are asked this often.
const LOOK: Duration = Duration::from_millis(100);
/// A sensor that is there has to bring something within this time.
const PATIENCE: Duration = Duration::from_secs(3);

/// The thread that asks.
#[derive(Debug)]
pub struct SensorWatch {
    is_over: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl SensorWatch {
    /// Starts it.
    ///
    /// # Errors
    /// When the system refuses a thread.
    pub fn start(sensors: &LiveSensors) -> std::io::Result<Self> {
        let (is_over, sensors) = (Arc::new(AtomicBool::new(false)), sensors.clone());
        let theirs = Arc::clone(&is_over);
        let thread = std::thread::Builder::new().name("sensor-watch".into()).spawn(move || {
            let mut told = Told::default();
            while !theirs.load(Ordering::Relaxed) {
                told.look(&sensors);
                std::thread::sleep(LOOK);
            }
        })?;
        Ok(Self { is_over, thread: Some(thread) })
    }
}

impl Drop for SensorWatch {
    fn drop(&mut self) {
        self.is_over.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// What has been told.
#[derive(Default)]
struct Told {
    cameras: [Option<String>; 2],
    imu: Option<String>,
    triggers: Option<String>,
    bringing: Bringing,
}

impl Told {
    fn look(&mut self, sensors: &LiveSensors) {
        let troubles = sensors.cameras.monitor.trouble();
        for ((told, now), name) in self.cameras.iter_mut().zip(troubles).zip(["left", "right"]) {
            let back = || format!("the {name} camera is there");
            tell(told, now, back);
        }
        let trouble = imu_trouble(&sensors.imu.monitor.read(), &mut self.bringing, Instant::now());
        let name = &sensors.imu.name;
        let words = trouble.map(|words| format!("{name}: {words} (driver.imu)"));
        tell(&mut self.imu, words, || format!("{name}: the IMU is there"));
        let trouble = sensors.triggers.as_ref().and_then(TriggerMonitor::trouble);
        tell(&mut self.triggers, trouble, || "frames are stamped by their triggers".to_owned());
    }
}

/// Says what has changed. Of a trouble in other words only its being another is worth a word.
fn tell(told: &mut Option<String>, now: Option<String>, back: impl FnOnce() -> String) {
    match (&*told, &now) {
        (before, Some(words)) if before.as_ref() != Some(words) => tracing::warn!("{words}"),
        (Some(_), None) => tracing::warn!("{}", back()),
        _ => {}
    }
    *told = now;
}

/// When samples came last.
#[derive(Default)]
struct Bringing {
    samples: u64,
    settling: u64,
    since: Option<Instant>,
}

/// Why the inertial sensor brings nothing, if it does not.
fn imu_trouble(figures: &ImuFigures, bringing: &mut Bringing, now: Instant) -> Option<String> {
    let since = *bringing.since.get_or_insert(now);
    let is_moving = (figures.samples, figures.settling) != (bringing.samples, bringing.settling);
    // The driver's first word may take a moment.
    let is_unknown = figures.link == LinkFigures::default();
    if is_unknown && now - since < LOOK * 5 {
        return None;
    }
    if is_moving || !(figures.link.is_open || is_unknown) {
        *bringing = Bringing { samples: figures.samples, settling: figures.settling, since: Some(now) };
    }
    if !figures.link.is_open {
        let why = figures.link.last_error.map(std::io::Error::from_raw_os_error);
        let why = why.map_or_else(String::new, |error| format!(" ({error})"));
        return Some(format!("the IMU is missing{why}; waiting for it"));
    }
    if is_moving || now - since < PATIENCE {
        // Until it has brought something it counts as missing.
        return None;
    }
    let framing = &figures.framing;
    Some(match figures.lacking {
        Some(lacking) => format!("what the IMU sends holds no samples: {lacking}"),
        None if framing.bytes == 0 => "the IMU sends nothing; look at its wires and its output".to_owned(),
        None if framing.frames == 0 => {
            "what the IMU sends is no frame of driver.imu.protocol; look at that, and at the speed of the line"
                .to_owned()
        }
        None => "the IMU has stopped sending samples".to_owned(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use plumbline_drivers::inertial::FramingFigures;

    #[test]
    fn a_sensor_that_is_away_or_says_nothing_is_told_of_with_the_cure() {
        let (mut bringing, start) = (Bringing::default(), Instant::now());
        let mut trouble = |figures: ImuFigures, s: f64| {
            imu_trouble(&figures, &mut bringing, start + Duration::from_secs_f64(s))
        };
        let away = ImuFigures {
            link: LinkFigures { last_error: Some(2), ..LinkFigures::default() },
            ..ImuFigures::default()
        };
        let there = |samples, bytes, frames| ImuFigures {
            samples,
            link: LinkFigures { is_open: true, ..LinkFigures::default() },
            framing: FramingFigures { bytes, frames, ..FramingFigures::default() },
            ..ImuFigures::default()
        };
        assert_eq!(trouble(ImuFigures::default(), 0.0), None);
        assert!(trouble(away, 0.0).is_some_and(|words| words.contains("No such file")));
        assert_eq!(trouble(there(0, 0, 0), 1.0), None);
        assert!(trouble(there(0, 0, 0), 4.0).is_some_and(|words| words.contains("wires")));
        assert!(trouble(there(0, 99, 0), 4.1).is_some_and(|words| words.contains("driver.imu.protocol")));
        assert_eq!(trouble(there(1, 200, 5), 4.2), None);
        assert_eq!(trouble(there(1, 200, 5), 6.0), None);
        assert!(trouble(there(1, 200, 5), 7.3).is_some_and(|words| words.contains("stopped")));
    }

    #[test]
    fn what_is_missing_is_told_once() {
        let mut told = None;
        for now in [Some("gone"), Some("gone"), None, None] {
            tell(&mut told, now.map(str::to_owned), || "back".to_owned());
            assert_eq!(told.as_deref(), now);
        }
    }
}
