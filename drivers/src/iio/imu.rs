//! A kernel-driven inertial sensor as a source of samples.

use super::devices::IioRoots;
use super::layout::{Quantity, ScanValues};
use super::merge::Merge;
use super::unit::{Unit, UnitFigures, Wanted};
use crate::clock::monotonic_ns;
use crate::inertial::{FramingFigures, ImuFigures, ImuMonitor, LinkFigures, Numbering, Post, SampleWatch};
use crate::{DriverError, Faults, ImuReading, ImuSource, StopFlag};
use nalgebra::Vector3;
use plumbline_config::options::{ImuConfig, ImuDriverConfig, ImuEndpoint};
use plumbline_config::{ImuSample, Timestamp};
use rustix::event::{PollFd, PollFlags, Timespec, poll};

/// A wait, ns: how soon a device that came back is seen.
const PATIENCE: Timespec = Timespec { tv_sec: 0, tv_nsec: StopFlag::PATIENCE_MS as i64 * 1_000_000 };

/// A kernel-driven inertial sensor, of one device or of two: each may be missing at the start, and may go away and come
/// back.
#[derive(Debug)]
pub struct IioImu {
    gyro: Unit,
    /// The accelerometer, where it is a device of its own, and how both come together.
    accel: Option<(Unit, Merge)>,
    delay_ns: i64,
    watch: SampleWatch,
    numbering: Numbering,
    stop: StopFlag,
    post: Post,
    samples: u64,
}

impl IioImu {
    /// Opens the device or devices of `driver.connect`; `imu` tells rate and ranges.
    ///
    /// # Errors
    /// When the address says no device of this kind, or what is there cannot be used. A device that is not there is waited
    /// for.
    pub fn open(driver: &ImuDriverConfig, imu: &ImuConfig, stop: StopFlag) -> Result<Self, DriverError> {
        Self::open_below(&IioRoots::default(), driver, imu, stop)
    }

    /// Opens the device below other roots than `/sys` and `/dev`.
    ///
    /// # Errors
    /// As [`Self::open`].
    pub fn open_below(
        roots: &IioRoots,
        driver: &ImuDriverConfig,
        imu: &ImuConfig,
        stop: StopFlag,
    ) -> Result<Self, DriverError> {
        let ImuEndpoint::Iio { gyro, accel } =
            ImuEndpoint::parse(&driver.connect).map_err(DriverError::ImuAddress)?
        else {
            return Err(DriverError::ImuAddress("names no device of the kernel; write iio://NAME".into()));
        };
        let wanted = |name: String, quantities: &'static [Quantity], is_rate_exact: bool| Wanted {
            name,
            quantities,
            rate_hz: imu.rate_hz,
            is_rate_exact,
        };
        let both = accel.is_none();
        let quantities: &[Quantity] =
            if both { &[Quantity::Gyro, Quantity::Accel] } else { &[Quantity::Gyro] };
        let accel = match accel {
            Some(name) => {
                Some((Unit::open(roots, wanted(name, &[Quantity::Accel], false))?, Merge::default()))
            }
            None => None,
        };
        Ok(Self {
            gyro: Unit::open(roots, wanted(gyro, quantities, true))?,
            accel,
            delay_ns: (driver.delay_s * 1e9).round() as i64,
            watch: SampleWatch::new(imu),
            numbering: Numbering::new(imu.rate_hz),
            stop,
            post: Post::default(),
            samples: 0,
        })
    }

    /// Figures of the samples so far.
    pub fn figures(&self) -> ImuFigures {
        let units = || std::iter::once(&self.gyro).chain(self.accel.iter().map(|(unit, _)| unit));
        let sum = |what: fn(UnitFigures) -> u64| units().map(|unit| what(unit.figures())).sum::<u64>();
        let link = LinkFigures {
            is_open: units().all(|unit| unit.figures().link.is_open),
            opened: sum(|figures| figures.link.opened),
            lost: sum(|figures| figures.link.lost),
            last_error: units().find_map(|unit| unit.figures().link.last_error),
        };
        ImuFigures {
            samples: self.samples,
            settling: sum(|figures| figures.settling),
            disordered: sum(|figures| figures.disordered),
            unpaired: self.accel.as_ref().map_or(0, |(_, merge)| merge.alone()),
            missing: self.numbering.missing(),
            watch: self.watch.figures(),
            clock: self.gyro.clock(),
            stamp_problem: units().find_map(Unit::stamp_problem),
            link,
            framing: FramingFigures {
                bytes: sum(|figures| figures.bytes),
                frames: sum(|figures| figures.scans),
                ..FramingFigures::default()
            },
            ..ImuFigures::default()
        }
    }

    /// Monitor of the figures for other threads; it lags by a moment.
    pub fn monitor(&self) -> ImuMonitor {
        self.post.monitor()
    }

    /// The next reading of what was read.
    fn take(&mut self) -> Option<ImuReading> {
        loop {
            let (stamp_ns, gyro, accel) = match &mut self.accel {
                None => {
                    let ScanValues { stamp_ns, gyro, accel } = self.gyro.next()?;
                    (stamp_ns, gyro?, accel?)
                }
                Some((unit, merge)) => {
                    while let Some(scan) = self.gyro.next() {
                        merge.gyro((scan.stamp_ns, scan.gyro?));
                    }
                    while let Some(scan) = unit.next() {
                        merge.accel((scan.stamp_ns, scan.accel?));
                    }
                    let ((stamp_ns, gyro), accel) = merge.next()?;
                    (stamp_ns, gyro, accel)
                }
            };
            if let Some(reading) = self.reading(stamp_ns, gyro, accel) {
                return Some(reading);
            }
        }
    }

    fn reading(&mut self, stamp_ns: i64, gyro: Vector3<f64>, accel: Vector3<f64>) -> Option<ImuReading> {
        if !self.watch.look(&gyro, &accel, false) {
            return None;
        }
        self.samples += 1;
        let stamp_ns = stamp_ns.saturating_sub(self.delay_ns);
        let sequence = self.numbering.next(None, stamp_ns);
        Some(ImuReading {
            sequence,
            sample: ImuSample { stamp: Timestamp::from_nanos(stamp_ns), gyro, accel },
        })
    }

    /// Waits for what is in the buffers and takes it.
    pub(super) fn exchange(&mut self) {
        let came = self.gyro.look_for() | self.accel.as_mut().is_some_and(|(unit, _)| unit.look_for());
        if let (true, Some((_, merge))) = (came, &mut self.accel) {
            merge.clear();
        }
        let files = (self.gyro.file(), self.accel.as_ref().and_then(|(unit, _)| unit.file()));
        let waited = match files {
            (Some(a), Some(b)) => {
                poll(&mut [PollFd::new(a, PollFlags::IN), PollFd::new(b, PollFlags::IN)], Some(&PATIENCE))
            }
            (Some(file), None) | (None, Some(file)) => {
                poll(&mut [PollFd::new(file, PollFlags::IN)], Some(&PATIENCE))
            }
            (None, None) => poll(&mut [], Some(&PATIENCE)),
        };
        // A device that went away is told by reading from it, and by nothing else: the kernel's poll is silent then.
        if waited.is_ok() {
            self.gyro.read();
            if let Some((unit, _)) = &mut self.accel {
                unit.read();
            }
        }
    }
}

impl ImuSource for IioImu {
    fn next_reading(&mut self) -> Result<Option<ImuReading>, DriverError> {
        loop {
            if let Some(reading) = self.take() {
                return Ok(Some(reading));
            }
            if self.post.is_due(monotonic_ns()) {
                let figures = self.figures();
                self.post.put(monotonic_ns(), || figures);
            }
            if self.stop.is_stopped() {
                let figures = self.figures();
                self.post.last(figures);
                return Ok(None);
            }
            self.exchange();
        }
    }

    fn faults(&self) -> Faults {
        self.figures().faults()
    }
}
