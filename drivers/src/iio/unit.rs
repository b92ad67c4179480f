//! One device: its buffer, read without waiting, its stamps on the host's clock.

use super::devices::{IioDeviceInfo, IioRoots, find};
use super::layout::{Layout, MAX_SCAN, Quantity, ScanValues};
use super::setup;
use crate::DriverError;
use crate::clock::{ClockFigures, DeviceClock, StampPace, StampProblem, Stamped, monotonic_ns};
use crate::inertial::LinkFigures;
use rustix::fd::OwnedFd;
use rustix::fs::{Mode, OFlags};
use rustix::io::Errno;

/// A device that went away is looked for this often, ns.
const REOPEN_NS: i64 = 500_000_000;
/// Bytes that are taken at a time.
const BYTES: usize = 32 * MAX_SCAN;
/// A stamp of the host's clock is not older than this when it is read, ns, nor in the future.
const OLDEST_NS: i64 = 2_000_000_000;
/// Stamps in a row of another clock that are believed.
const BELIEVED: u32 = 8;

/// Device to open, by name, and what it must measure at what rate.
#[derive(Clone, Debug)]
pub struct Wanted {
    /// Name, label or place.
    pub name: String,
    /// Quantities that it must measure.
    pub quantities: &'static [Quantity],
    /// Samples a second.
    pub rate_hz: f64,
    /// True if no other rate will do.
    pub is_rate_exact: bool,
}

/// A device that may come and go.
#[derive(Debug)]
pub struct Unit {
    roots: IioRoots,
    wanted: Wanted,
    open: Option<Open>,
    bytes: Box<[u8]>,
    /// Start of the bytes not yet decoded.
    from: usize,
    to: usize,
    arrival_ns: i64,
    /// The device's clock, where the stamps are its own and not those of the host's monotonic clock.
    clock: DeviceClock,
    pace: StampPace,
    has_own_clock: bool,
    /// Stamps in a row that are not of the host's clock.
    strange: u32,
    last_ns: i64,
    tried_ns: i64,
    figures: UnitFigures,
}

#[derive(Debug)]
struct Open {
    file: OwnedFd,
    device: IioDeviceInfo,
    layout: Layout,
}

/// Counts of a device's scans.
#[derive(Clone, Copy, Debug, Default)]
pub struct UnitFigures {
    pub link: LinkFigures,
    pub bytes: u64,
    pub scans: u64,
    pub settling: u64,
    pub disordered: u64,
}

impl Unit {
    /// Opens the device; one that is not there yet is waited for.
    ///
    /// # Errors
    /// When what is there cannot be used.
    pub fn open(roots: &IioRoots, wanted: Wanted) -> Result<Self, DriverError> {
        let mut unit = Self {
            roots: roots.clone(),
            wanted,
            open: None,
            bytes: vec![0; BYTES].into(),
            from: 0,
            to: 0,
            arrival_ns: 0,
            clock: DeviceClock::new(false),
            pace: StampPace::default(),
            has_own_clock: false,
            strange: 0,
            last_ns: i64::MIN,
            tried_ns: 0,
            figures: UnitFigures::default(),
        };
        unit.try_open()?;
        Ok(unit)
    }

    /// The buffer to wait for, while the device is there.
    pub fn file(&self) -> Option<&OwnedFd> {
        self.open.as_ref().map(|open| &open.file)
    }

    /// Looks for a device that is away, now and then; whether it came.
    pub fn look_for(&mut self) -> bool {
        let now_ns = monotonic_ns();
        if self.open.is_some() || now_ns.saturating_sub(self.tried_ns) < REOPEN_NS {
            return false;
        }
        // Whatever is wrong now may be right in a moment: udev is still at it.
        self.try_open().is_ok() && self.open.is_some()
    }

    /// Takes what is in the buffer. Everything that came before has to be taken with [`Self::next`].
    pub fn read(&mut self) {
        let Some(open) = &self.open else { return };
        self.bytes.copy_within(self.from..self.to, 0);
        (self.from, self.to) = (0, self.to - self.from);
        match rustix::io::read(&open.file, &mut self.bytes[self.to..]) {
            Ok(count) if count > 0 => {
                self.arrival_ns = monotonic_ns();
                self.to += count;
                self.figures.bytes += count as u64;
            }
            Err(Errno::AGAIN | Errno::INTR) => {}
            outcome => self.lose(outcome.err()),
        }
    }

    /// The next scan of what was read, its stamp on the host's clock.
    pub fn next(&mut self) -> Option<ScanValues> {
        loop {
            let layout = &self.open.as_ref()?.layout;
            let scan = self.bytes[..self.to].get(self.from..self.from + layout.bytes)?;
            let mut values = layout.values(scan);
            self.from += layout.bytes;
            self.figures.scans += 1;
            let Some(stamp_ns) = self.stamp(values.stamp_ns) else { continue };
            values.stamp_ns = stamp_ns;
            return Some(values);
        }
    }

    /// Figures of the scans so far.
    pub fn figures(&self) -> UnitFigures {
        self.figures
    }

    /// Defect of the device's stamps, if any.
    pub fn stamp_problem(&self) -> Option<StampProblem> {
        self.pace.problem()
    }

    /// The clock of the device, where its stamps are its own.
    pub fn clock(&self) -> ClockFigures {
        self.clock.figures()
    }

    /// The stamp of a scan on the host's clock, once it is known and after the one before.
    fn stamp(&mut self, kernel_ns: i64) -> Option<i64> {
        self.pace.take(kernel_ns, self.arrival_ns);
        let stamp_ns = if self.has_own_clock {
            match self.clock.sample(kernel_ns, self.arrival_ns) {
                Stamped::At(stamp_ns) => stamp_ns,
                Stamped::Settling => {
                    self.figures.settling += 1;
                    return None;
                }
                Stamped::Refused => return None,
            }
        } else {
            let age_ns = self.arrival_ns.saturating_sub(kernel_ns);
            if !(0..OLDEST_NS).contains(&age_ns) {
                self.strange_stamp(kernel_ns);
                return None;
            }
            self.strange = 0;
            kernel_ns
        };
        if stamp_ns <= self.last_ns {
            self.figures.disordered += 1;
            return None;
        }
        self.last_ns = stamp_ns;
        Some(stamp_ns)
    }

    /// A stamp that the host's clock did not give: many of them are of another clock.
    fn strange_stamp(&mut self, kernel_ns: i64) {
        self.strange += 1;
        self.figures.disordered += 1;
        if self.strange >= BELIEVED {
            self.clock.sample(kernel_ns, self.arrival_ns);
            self.has_own_clock = true;
        }
    }

    fn try_open(&mut self) -> Result<(), DriverError> {
        self.tried_ns = monotonic_ns();
        let Wanted { name, quantities, rate_hz, is_rate_exact } = &self.wanted;
        let Some(device) = find(&self.roots, name, quantities)? else { return Ok(()) };
        // Opened before it is set up: a device that another program has open is left as it is.
        let path = self.roots.dev.join(&device.device);
        let file = rustix::fs::open(
            &path,
            OFlags::RDONLY | OFlags::NONBLOCK | OFlags::CLOEXEC,
            Mode::empty(),
        )
        .map_err(|error| match error {
            Errno::ACCESS | Errno::PERM => DriverError::refused(
                &path,
                "this user may not open it; run as root, or give the user's group the device by a udev rule",
            ),
            Errno::BUSY => DriverError::refused(
                &path,
                "another program, such as iio-sensor-proxy, has it open; stop that program",
            ),
            _ => DriverError::io(&path, error.into()),
        })?;
        let layout = setup::start(&device, &self.roots, quantities, *rate_hz, *is_rate_exact)?;
        self.open = Some(Open { file, device, layout });
        (self.from, self.to) = (0, 0);
        self.figures.link.is_open = true;
        self.figures.link.opened += 1;
        Ok(())
    }

    fn lose(&mut self, error: Option<Errno>) {
        self.open = None;
        self.clock.forget();
        (self.has_own_clock, self.strange) = (false, 0);
        self.figures.link.is_open = false;
        self.figures.link.lost += 1;
        self.figures.link.last_error = error.map(Errno::raw_os_error);
    }
}

impl Drop for Unit {
    fn drop(&mut self) {
        if let Some(Open { device, .. }) = &self.open {
            setup::stop(&device.folder);
        }
    }
}
