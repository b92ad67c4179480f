//! A hub of HID sensors that this process plays to the kernel (uhid): an accelerometer and a gyroscope, as laptops, tablets
//! and depth cameras have them. The kernel drives them as two inertial devices of Industrial I/O.
//!
//! Source: HID Usage Tables 1.4, chapter 21 (sensor page), and `Documentation/hid/uhid.rst` of the kernel.

use std::fs::{File, OpenOptions};
use std::io::{self, Read as _, Write as _};
use std::os::unix::fs::OpenOptionsExt as _;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// Reports of the accelerometer and of the gyroscope, by their usages on the sensor page.
const SENSORS: [Sensor; 2] = [
    // Without a unit it is g, here 1e-5 of it.
    Sensor { usage: 0x73, first_axis: 0x0453, exponent: 0x0b, unit: 9.806_65e-5 },
    // And degrees per second, here 1e-3 of them: the kernel's scales have nine decimals.
    Sensor { usage: 0x76, first_axis: 0x0457, exponent: 0x0d, unit: 1.745_329_3e-5 },
];

struct Sensor {
    usage: u8,
    first_axis: u16,
    exponent: u8,
    /// Unit of a count, m/s² or rad/s.
    unit: f64,
}

/// Kinds of events, as `linux/uhid.h` numbers them.
const GET_REPORT: u32 = 9;
const GET_REPORT_REPLY: u32 = 10;
const CREATE2: u32 = 11;
const INPUT2: u32 = 12;
const SET_REPORT: u32 = 13;
const SET_REPORT_REPLY: u32 = 14;
const DESTROY: u32 = 1;
/// An event of the kernel, bytes.
const EVENT_BYTES: usize = 4380;
const BUS_USB: u16 = 3;
/// Values of the selectors of reporting state and power state: the second usage of each.
const ALL_EVENTS: u8 = 2;
const FULL_POWER: u8 = 2;

/// Settings of a sensor: the values of its feature report.
#[derive(Clone, Copy, Debug)]
struct Features {
    reporting: u8,
    power: u8,
    interval_ms: u32,
}

impl Features {
    fn report(&self, id: u8) -> Vec<u8> {
        [&[id, self.reporting, self.power][..], &self.interval_ms.to_le_bytes()].concat()
    }

    fn set(&mut self, report: &[u8]) {
        if let [_, reporting, power, a, b, c, d, ..] = *report {
            let interval_ms = u32::from_le_bytes([a, b, c, d]);
            *self = Self { reporting, power, interval_ms };
        }
    }
}

/// The hub; dropped, it is unplugged.
pub struct Hub {
    file: File,
    features: [Features; 2],
}

impl Hub {
    /// Plugs it in.
    pub fn plug_in() -> io::Result<Self> {
        // O_NONBLOCK: who plays has other things to do than to wait for questions.
        let file = OpenOptions::new().read(true).write(true).custom_flags(0o4000).open("/dev/uhid")?;
        let mut hub = Self { file, features: [Features { reporting: 1, power: 1, interval_ms: 100 }; 2] };
        let descriptor = descriptor();
        let mut event = CREATE2.to_le_bytes().to_vec();
        let mut text = |text: &str, bytes: usize| {
            let mut field = text.as_bytes().to_vec();
            field.resize(bytes, 0);
            event.extend(field);
        };
        text("Plumbline test hub", 128);
        text("", 64);
        text("", 64);
        event.extend((descriptor.len() as u16).to_le_bytes());
        event.extend(BUS_USB.to_le_bytes());
        for number in [0x1209_u32, 0x0001, 1, 0] {
            event.extend(number.to_le_bytes());
        }
        event.extend(descriptor);
        hub.file.write_all(&event)?;
        Ok(hub)
    }

    /// Plays until `is_over`: `values` gives acceleration, m/s², and rate, rad/s, as they are at the time of the call.
    pub fn play(mut self, is_over: &AtomicBool, mut values: impl FnMut() -> [[f64; 3]; 2]) -> io::Result<()> {
        let mut due = [std::time::Instant::now(); 2];
        while !is_over.load(Ordering::Relaxed) {
            while self.answer()? {}
            for (which, due) in due.iter_mut().enumerate() {
                let Features { reporting, power, interval_ms } = self.features[which];
                let now = std::time::Instant::now();
                if reporting == ALL_EVENTS && power == FULL_POWER && now >= *due {
                    let period = Duration::from_millis(u64::from(interval_ms.max(1)));
                    *due = (*due + period).max(now - period);
                    self.report(which, values()[which])?;
                }
            }
            std::thread::sleep(Duration::from_millis(1));
        }
        self.file.write_all(&DESTROY.to_le_bytes())
    }

    /// Answers a question of the kernel, where there is one.
    fn answer(&mut self) -> io::Result<bool> {
        let mut event = [0; EVENT_BYTES];
        match self.file.read(&mut event) {
            Ok(_) => {}
            Err(error) if error.kind() == io::ErrorKind::WouldBlock => return Ok(false),
            Err(error) => return Err(error),
        }
        let number = |at: usize| u32::from_le_bytes([event[at], event[at + 1], event[at + 2], event[at + 3]]);
        let (kind, id, report) = (number(0), number(4), event[8]);
        let which = usize::from(report).wrapping_sub(1);
        match (kind, self.features.get_mut(which)) {
            (GET_REPORT, features) => {
                let data = features.map(|features| features.report(report)).unwrap_or_default();
                let error = u16::from(data.is_empty()) * 5;
                let mut reply = [GET_REPORT_REPLY.to_le_bytes(), id.to_le_bytes()].concat();
                reply.extend(error.to_le_bytes());
                reply.extend((data.len() as u16).to_le_bytes());
                reply.extend(data);
                self.file.write_all(&reply)?;
            }
            (SET_REPORT, features) => {
                if let Some(features) = features {
                    let bytes = usize::from(u16::from_le_bytes([event[10], event[11]]));
                    features.set(&event[12..(12 + bytes).min(EVENT_BYTES)]);
                }
                let mut reply = [SET_REPORT_REPLY.to_le_bytes(), id.to_le_bytes()].concat();
                reply.extend(0_u16.to_le_bytes());
                self.file.write_all(&reply)?;
            }
            _ => {}
        }
        Ok(true)
    }

    fn report(&mut self, which: usize, values: [f64; 3]) -> io::Result<()> {
        let mut data = vec![which as u8 + 1];
        for value in values {
            data.extend(((value / SENSORS[which].unit).round() as i32).to_le_bytes());
        }
        let mut event = INPUT2.to_le_bytes().to_vec();
        event.extend((data.len() as u16).to_le_bytes());
        event.extend(data);
        self.file.write_all(&event)
    }
}

/// Report descriptor of the hub: both sensors, each with a report of its features and one of its axes.
fn descriptor() -> Vec<u8> {
    // Usage page (sensor), usage (collection of sensors), collection (application).
    let mut bytes = vec![0x05, 0x20, 0x09, 0x01, 0xa1, 0x01];
    for (k, sensor) in SENSORS.iter().enumerate() {
        // Usage, collection (physical), report id.
        bytes.extend([0x09, sensor.usage, 0xa1, 0x00, 0x85, k as u8 + 1]);
        // Reporting state: no events, all events. Power state: not told, full.
        for (state, first) in [(0x0316_u16, 0x0840_u16), (0x0319, 0x0850)] {
            bytes.push(0x0a);
            bytes.extend(state.to_le_bytes());
            // One byte, 1 to 2, in a collection (logical) of the choices, as a feature (array).
            bytes.extend([0x15, 1, 0x25, 2, 0x75, 8, 0x95, 1, 0xa1, 0x02]);
            for choice in [first, first + 1] {
                bytes.push(0x0a);
                bytes.extend(choice.to_le_bytes());
            }
            bytes.extend([0xb1, 0x00, 0xc0]);
        }
        // Report interval, ms, in 32 bits, as a feature (variable).
        bytes.extend([
            0x0a, 0x0e, 0x03, 0x15, 0, 0x27, 0xff, 0xff, 0xff, 0x7f, 0x75, 32, 0x95, 1, 0x55, 0, 0xb1, 0x02,
        ]);
        // Axes of 32 bits with a sign, as inputs (variable).
        bytes.extend([0x17, 0, 0, 0, 0x80, 0x27, 0xff, 0xff, 0xff, 0x7f, 0x55, sensor.exponent]);
        for axis in 0..3 {
            bytes.push(0x0a);
            bytes.extend((sensor.first_axis + axis).to_le_bytes());
            bytes.extend([0x81, 0x02]);
        }
        bytes.push(0xc0);
    }
    bytes.push(0xc0);
    bytes
}
