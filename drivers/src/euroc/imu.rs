//! The inertial stream of a data set.

use super::table::{Row, RowFault, Stamped, Table, numbers, stamp};
use crate::grid::{median_period_ns, steps};
use crate::{DriverError, Faults, ImuReading, ImuSource};
use nalgebra::Vector3;
use plumbline_config::{ImuSample, Timestamp};
use std::sync::Arc;

/// Ten times what any gyroscope of a drone reports, rad/s; beyond are flipped bits.
const MAX_GYRO_RAD_S: f64 = 350.0;
/// Ten times what any accelerometer of a drone reports, m/s².
const MAX_ACCEL_M_S2: f64 = 3500.0;

impl Stamped for ImuSample {
    fn stamp(&self) -> Timestamp {
        self.stamp
    }
}

/// Columns of the table; further ones are ignored.
pub(crate) const IMU_COLUMNS: &str = "timestamp [ns], gyro x y z [rad/s], accel x y z [m/s^2]";

/// A row of [`IMU_COLUMNS`].
pub(crate) fn parse_imu_row(row: &Row) -> Result<ImuSample, RowFault> {
    let stamp = stamp(row)?;
    let (gyro, accel) = (Vector3::from(numbers(row, 1)?), Vector3::from(numbers(row, 4)?));
    if gyro.amax() > MAX_GYRO_RAD_S {
        return Err(RowFault::Impossible("a rotation rate is beyond 350 rad/s; write it in rad/s"));
    }
    if accel.amax() > MAX_ACCEL_M_S2 {
        return Err(RowFault::Impossible("an acceleration is beyond 3500 m/s^2; write it in m/s^2"));
    }
    Ok(ImuSample { stamp, gyro, accel })
}

/// True if a sensor can measure such values.
pub(crate) fn is_possible(sample: &ImuSample) -> bool {
    let is_within = |v: &Vector3<f64>, most: f64| v.iter().all(|x| x.abs() <= most);
    is_within(&sample.gyro, MAX_GYRO_RAD_S) && is_within(&sample.accel, MAX_ACCEL_M_S2)
}

/// All samples of a data set with their sequence numbers, shared by the sources made of it.
#[derive(Debug, Default)]
pub(crate) struct ImuRecord {
    readings: Vec<ImuReading>,
    faults: Faults,
}

impl ImuRecord {
    pub(crate) fn new(table: Table<ImuSample>) -> Self {
        let period = median_period_ns(table.rows.iter().map(|row| row.stamp));
        let mut readings: Vec<ImuReading> = Vec::with_capacity(table.rows.len());
        for sample in table.rows {
            let sequence = readings
                .last()
                .map_or(0, |last| last.sequence + steps(sample.stamp.nanos_since(last.sample.stamp), period));
            readings.push(ImuReading { sequence, sample });
        }
        let mut faults = Faults { corrupt: table.corrupt, ..Faults::default() };
        table.order.add_to(&mut faults);
        Self { readings, faults }
    }

    /// First and last stamp.
    pub(crate) fn span(&self) -> Option<(Timestamp, Timestamp)> {
        Some((self.readings.first()?.sample.stamp, self.readings.last()?.sample.stamp))
    }

    /// Indices of the samples with stamps in `from..=to`.
    pub(crate) fn range(&self, from: Timestamp, to: Timestamp) -> std::ops::Range<usize> {
        let start = self.readings.partition_point(|r| r.sample.stamp < from);
        start..self.readings.partition_point(|r| r.sample.stamp <= to).max(start)
    }
}

/// Hands out the inertial samples of an [`EurocDataset`](super::EurocDataset) around its frames.
///
/// Sequence numbers count from the first sample of the file; a sample skipped as corrupt shows as a gap
/// like one that was never recorded. Corrupt and disordered rows are those of the whole file.
#[derive(Clone, Debug, Default)]
pub struct EurocImu {
    record: Arc<ImuRecord>,
    rest: std::ops::Range<usize>,
    last_sequence: Option<u64>,
    faults: Faults,
}

impl EurocImu {
    pub(crate) fn new(record: ImuRecord, rest: std::ops::Range<usize>) -> Self {
        let faults = record.faults;
        Self { record: Arc::new(record), rest, last_sequence: None, faults }
    }
}

impl ImuSource for EurocImu {
    fn next_reading(&mut self) -> Result<Option<ImuReading>, DriverError> {
        let Some(reading) = self.rest.next().and_then(|i| self.record.readings.get(i)).copied() else {
            return Ok(None);
        };
        if let Some(last) = self.last_sequence.replace(reading.sequence) {
            self.faults.missing += reading.sequence - last - 1;
        }
        Ok(Some(reading))
    }

    fn faults(&self) -> Faults {
        self.faults
    }
}
