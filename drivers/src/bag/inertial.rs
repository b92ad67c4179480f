//! Inertial samples of a bag: of one topic, or gyroscope and accelerometer apart.
//!
//! Drivers such as that of the RealSense publish gyroscope and accelerometer on topics of their own by default, each as
//! `sensor_msgs/Imu` with zeros for the other quantity and -1 in its covariance. They are joined as those of the kernel are
//! ([`Merge`]): the accelerometer is interpolated to the gyroscope's times. Where both were remapped onto one topic, it is taken
//! apart first.

use super::holds::{Holds, is_gyro};
use super::messages::ImuMessage;
use super::topics::ImuTopics;
use crate::euroc::imu::is_possible;
use crate::euroc::order::{Order, not_stamped};
use crate::euroc::table::Table;
use crate::iio::merge::Merge;
use nalgebra::Vector3;
use plumbline_config::ImuSample;

/// The samples of `topics`, whose messages `take` gives; `name` names a topic.
///
/// # Errors
/// When there are none, or they cannot be flown; the message says why.
pub(super) fn samples(
    topics: ImuTopics,
    name: impl Fn(usize) -> String,
    mut take: impl FnMut(usize) -> (Vec<ImuMessage>, u64),
) -> Result<Samples, String> {
    let (messages, corrupt) = take(topics.gyro);
    if topics.gyro == topics.accel && topics.holds != Holds::Mixed {
        let table = table(&name(topics.gyro), messages, corrupt)?;
        let orders = vec![(name(topics.gyro), table.order)];
        return Ok(Samples { table, orders });
    }
    let (gyro, accel, corrupt) = if topics.gyro == topics.accel {
        let (gyro, accel) = messages.into_iter().partition(is_gyro);
        (gyro, accel, [corrupt, 0])
    } else {
        let (accel, more) = take(topics.accel);
        (messages, accel, [corrupt, more])
    };
    let alone = |mut messages: Vec<ImuMessage>, is_gyro: bool| {
        for message in &mut messages {
            let other = if is_gyro { &mut message.sample.accel } else { &mut message.sample.gyro };
            *other = Vector3::zeros();
        }
        messages
    };
    let names = [name(topics.gyro), name(topics.accel)];
    let gyro = table(&names[0], alone(gyro, true), corrupt[0])?;
    let accel = table(&names[1], alone(accel, false), corrupt[1])?;
    let rows = joined(&gyro.rows, &accel.rows);
    if rows.is_empty() {
        return Err(format!(
            "{} (gyroscope) and {} (accelerometer) have no time in common: there is no acceleration within 50 ms of a rate of \
             rotation; record both together, at 50 Hz or more",
            names[0], names[1]
        ));
    }
    let orders: Vec<(String, Order)> = names.into_iter().zip([gyro.order, accel.order]).collect();
    let table = Table {
        rows,
        corrupt: gyro.corrupt + accel.corrupt,
        order: gyro.order.with(&accel.order),
        first_bad: None,
    };
    Ok(Samples { table, orders })
}

/// Inertial samples, and the order in which their messages were recorded, by topic.
pub(super) struct Samples {
    pub(super) table: Table<ImuSample>,
    pub(super) orders: Vec<(String, Order)>,
}

fn table(name: &str, messages: Vec<ImuMessage>, corrupt: u64) -> Result<Table<ImuSample>, String> {
    let count = messages.len();
    let rows: Vec<ImuSample> =
        messages.into_iter().map(|message| message.sample).filter(is_possible).collect();
    let corrupt = corrupt + (count - rows.len()) as u64;
    let table = Table::of(rows, corrupt);
    match table.rows.as_slice() {
        [] => Err(format!("{name} holds no message that can be read; was it being published?")),
        [row] if table.order.is_constant() => Err(not_stamped(name, "messages", table.order.rows, row.stamp)),
        _ => Ok(table),
    }
}

/// Rates of rotation with the acceleration at their times; without one around them they are left out.
fn joined(gyro: &[ImuSample], accel: &[ImuSample]) -> Vec<ImuSample> {
    let (mut merge, mut accel, mut given_ns) = (Merge::default(), accel.iter(), i64::MIN);
    let mut rows = Vec::with_capacity(gyro.len());
    for sample in gyro {
        let at_ns = sample.stamp.as_nanos();
        merge.gyro((at_ns, sample.gyro));
        while given_ns < at_ns
            && let Some(next) = accel.next()
        {
            given_ns = next.stamp.as_nanos();
            merge.accel((given_ns, next.accel));
        }
        while let Some(((at_ns, gyro), accel)) = merge.next() {
            let stamp = plumbline_config::Timestamp::from_nanos(at_ns);
            rows.push(ImuSample { stamp, gyro, accel });
        }
    }
    rows
}

#[cfg(test)]
mod tests {
    use super::super::holds::tests::{MS, message};
    use super::*;

    #[test]
    fn either_may_be_faster_and_the_ends_without_both_are_left_out() {
        for (gyro_ms, accel_ms) in [(2.5, 4.0), (5.0, 16.0), (10.0, 4.0), (2.5, 1.0), (5.0, 5.0)] {
            let row = |ms: f64, accel: f64| message(ms, 1.0 + ms, accel, [false; 2]).sample;
            let gyro: Vec<ImuSample> = (0..400).map(|k| row(gyro_ms * f64::from(k), 0.0)).collect();
            let accel: Vec<ImuSample> =
                (1..90).map(|k| row(accel_ms * f64::from(k), accel_ms * f64::from(k))).collect();
            let rows = joined(&gyro, &accel);
            let (first, last) = (accel_ms, accel_ms * 89.0);
            let expected =
                gyro.iter().filter(|g| (first..=last).contains(&(g.stamp.as_nanos() as f64 / MS as f64)));
            assert_eq!(
                rows.iter().map(|r| r.stamp).collect::<Vec<_>>(),
                expected.map(|g| g.stamp).collect::<Vec<_>>()
            );
            assert!(rows.iter().all(|r| (r.accel.x - r.stamp.as_nanos() as f64 / MS as f64).abs() < 1e-6));
        }
    }

    #[test]
    fn a_topic_of_both_kinds_is_taken_apart() {
        let topics = ImuTopics { gyro: 0, accel: 0, holds: Holds::Mixed };
        let messages: Vec<ImuMessage> = (0..40)
            .flat_map(|k| {
                let ms = 5.0 * f64::from(k);
                // Zero rates at rest are rates.
                let gyro = if k == 7 { 0.0 } else { 1.0 };
                [message(ms, gyro, 0.0, [false, true]), message(ms, 0.0, 3.0, [true, false])]
            })
            .collect();
        let read = samples(topics, |_| "/imu".into(), |_| (messages.clone(), 2)).unwrap();
        assert_eq!((read.table.rows.len(), read.table.corrupt, read.table.order.repeated), (40, 2, 0));
        assert!(read.table.rows.iter().all(|row| row.accel.x == 3.0));
    }
}
