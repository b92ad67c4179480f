//! Fixed layouts of odometry and of the main part of an estimate. Numbers are little endian.

use nalgebra::{Isometry3, Quaternion, UnitQuaternion, Vector3};
use plumbline_config::Timestamp;
use plumbline_estimator::{Estimate, NavCovariance, Odometry, OriginUncertainty, TrackingState};

/// Bytes of odometry.
pub const ODOMETRY_BYTES: usize = 504;
/// Bytes of the main part of an estimate.
pub const ESTIMATE_BYTES: usize = 536;
/// Rows and columns of a covariance: position, attitude, velocity.
const ROWS: usize = 9;

/// Appends odometry that was handed over at `handed_over_ns` (since 1970), with the health bits of the newest estimate.
///
/// | bytes | content |
/// |---|---|
/// | 0..8 | stamp, ns (i64) |
/// | 8..16 | time of the hand-over, ns since 1970 (i64) |
/// | 16..24 | sequence number (u64) |
/// | 24..48 | position of B in O, m (3 f64) |
/// | 48..80 | rotation O from B, quaternion x y z w (4 f64) |
/// | 80..104 | velocity of B in O, m/s (3 f64) |
/// | 104..128 | angular rate of B, rad/s (3 f64) |
/// | 128..488 | covariance of position, attitude and velocity: upper triangle by rows (45 f64) |
/// | 488..492 | health bits (u32) |
/// | 492..496 | reset counter (u32) |
/// | 496..500 | jumps (u32) |
/// | 500 | state (u8): 0 initialising, 1 tracking, 2 blind, 3 failed |
/// | 501 | quality (i8): -1 failed, else 0 to 100 |
/// | 502..504 | zero |
pub fn put_odometry(o: &Odometry, handed_over_ns: i64, health_bits: u32, to: &mut Vec<u8>) {
    to.extend(o.stamp.as_nanos().to_le_bytes());
    to.extend(handed_over_ns.to_le_bytes());
    to.extend(o.sequence.to_le_bytes());
    put_pose(&o.pose_o_b, to);
    put_numbers(o.v_o_b.iter().chain(o.angular_rate_b.iter()), to);
    put_covariance(&o.covariance, to);
    to.extend(health_bits.to_le_bytes());
    to.extend(o.reset_counter.to_le_bytes());
    to.extend(o.jumps.to_le_bytes());
    to.extend([o.state as u8, o.quality.to_le_bytes()[0], 0, 0]);
}

/// Appends the main part of an estimate that was handed over at `handed_over_ns` (since 1970).
///
/// | bytes | content |
/// |---|---|
/// | 0..8 | stamp, ns (i64) |
/// | 8..16 | time of the hand-over, ns since 1970 (i64) |
/// | 16..24 | sequence number of the frame (u64) |
/// | 24..48 | position of B in O, m (3 f64) |
/// | 48..80 | rotation O from B, quaternion x y z w (4 f64) |
/// | 80..104 | velocity of B in O, m/s (3 f64) |
/// | 104..128 | bias of the gyroscope, rad/s (3 f64) |
/// | 128..152 | bias of the accelerometer, m/s^2 (3 f64) |
/// | 152..512 | covariance of position, attitude and velocity: upper triangle by rows (45 f64) |
/// | 512..520 | time offset of the camera, s (f64) |
/// | 520..524 | health bits (u32) |
/// | 524..528 | reset counter (u32) |
/// | 528 | state (u8), as above |
/// | 529 | quality (i8), as above |
/// | 530 | 1 if the frame is a keyframe (u8) |
/// | 531..536 | zero |
pub fn put_estimate(e: &Estimate, handed_over_ns: i64, to: &mut Vec<u8>) {
    to.extend(e.stamp.as_nanos().to_le_bytes());
    to.extend(handed_over_ns.to_le_bytes());
    to.extend(e.frame_sequence.to_le_bytes());
    put_pose(&e.pose_o_b, to);
    put_numbers(e.v_o_b.iter().chain(e.bias_gyro.iter()).chain(e.bias_accel.iter()), to);
    put_covariance(&e.covariance, to);
    put_numbers([&e.time_offset_s], to);
    to.extend(e.health.0.to_le_bytes());
    to.extend(e.reset_counter.to_le_bytes());
    to.extend([e.state as u8, e.quality.to_le_bytes()[0], u8::from(e.figures.is_keyframe), 0, 0, 0, 0, 0]);
}

fn put_numbers<'a>(numbers: impl IntoIterator<Item = &'a f64>, to: &mut Vec<u8>) {
    numbers.into_iter().for_each(|number| to.extend(number.to_le_bytes()));
}

fn put_pose(pose: &Isometry3<f64>, to: &mut Vec<u8>) {
    put_numbers(pose.translation.vector.iter().chain(pose.rotation.coords.iter()), to);
}

fn put_covariance(covariance: &NavCovariance, to: &mut Vec<u8>) {
    for row in 0..ROWS {
        put_numbers((row..ROWS).map(|column| &covariance[(row, column)]), to);
    }
}

/// Odometry and the time it was handed over, ns since 1970. Bytes beyond the layout belong to a later version.
///
/// # Errors
/// When the bytes are none.
pub fn odometry(bytes: &[u8]) -> Result<(Odometry, i64), &'static str> {
    let mut from = Fields(bytes.get(..ODOMETRY_BYTES).ok_or("odometry is too short")?);
    let (stamp_ns, handed_over_ns) = (from.next(i64::from_le_bytes), from.next(i64::from_le_bytes));
    let sequence = from.next(u64::from_le_bytes);
    let pose_o_b = from.pose();
    let (v_o_b, angular_rate_b) = (from.vector(), from.vector());
    let covariance = from.covariance();
    let _health_bits = from.next(u32::from_le_bytes);
    let (reset_counter, jumps) = (from.next(u32::from_le_bytes), from.next(u32::from_le_bytes));
    let state = match from.next(u8::from_le_bytes) {
        0 => TrackingState::Initialising,
        1 => TrackingState::Tracking,
        2 => TrackingState::Blind,
        3 => TrackingState::Failed,
        _ => return Err("an unknown state"),
    };
    let quality = from.next(i8::from_le_bytes);
    let stamp = Timestamp::from_nanos(stamp_ns);
    let odometry = Odometry {
        sequence,
        stamp,
        pose_o_b,
        v_o_b,
        angular_rate_b,
        covariance,
        state,
        quality,
        reset_counter,
        jumps,
        // Its share is in the covariance.
        origin: OriginUncertainty::default(),
    };
    Ok((odometry, handed_over_ns))
}

/// The fields that are left; the caller has checked that there are enough bytes. Missing ones read as zero.
struct Fields<'a>(&'a [u8]);

impl Fields<'_> {
    fn next<T, const N: usize>(&mut self, from_bytes: fn([u8; N]) -> T) -> T {
        let Some((field, rest)) = self.0.split_first_chunk::<N>() else { return from_bytes([0; N]) };
        self.0 = rest;
        from_bytes(*field)
    }

    fn number(&mut self) -> f64 {
        self.next(f64::from_le_bytes)
    }

    fn vector(&mut self) -> Vector3<f64> {
        Vector3::from_fn(|_, _| self.number())
    }

    fn pose(&mut self) -> Isometry3<f64> {
        let position = self.vector();
        let [x, y, z, w] = std::array::from_fn(|_| self.number());
        // Unchanged: normalising would change bits.
        let rotation = UnitQuaternion::new_unchecked(Quaternion::new(w, x, y, z));
        Isometry3::from_parts(position.into(), rotation)
    }

    fn covariance(&mut self) -> NavCovariance {
        let mut covariance = NavCovariance::zeros();
        for row in 0..ROWS {
            for column in row..ROWS {
                let number = self.number();
                covariance[(row, column)] = number;
                covariance[(column, row)] = number;
            }
        }
        covariance
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fuzzing::fixture;

    #[test]
    fn odometry_comes_back_as_it_was() {
        let mut sent = fixture::odometry();
        sent.covariance = NavCovariance::from_fn(|row, column| (row * column) as f64 + 1.0);
        let mut bytes = Vec::new();
        put_odometry(&sent, 7, 5, &mut bytes);
        assert_eq!(bytes.len(), ODOMETRY_BYTES);
        assert_eq!(odometry(&bytes), Ok((Odometry { origin: OriginUncertainty::default(), ..sent }, 7)));
        assert_eq!(bytes[488..492], 5u32.to_le_bytes());
        assert!(odometry(&bytes[1..]).is_err());
        bytes[500] = 4;
        assert_eq!(odometry(&bytes), Err("an unknown state"));
    }

    #[test]
    fn an_estimate_has_its_fields_where_the_table_has_them() {
        let sent = fixture::estimate();
        let mut bytes = Vec::new();
        put_estimate(&sent, 9, &mut bytes);
        assert_eq!(bytes.len(), ESTIMATE_BYTES);
        assert_eq!(bytes[16..24], sent.frame_sequence.to_le_bytes());
        assert_eq!(bytes[80..88], sent.v_o_b.x.to_le_bytes());
        assert_eq!(bytes[512..520], sent.time_offset_s.to_le_bytes());
        assert_eq!(bytes[524..528], sent.reset_counter.to_le_bytes());
        assert_eq!((bytes[528], bytes[529]), (sent.state as u8, sent.quality.to_le_bytes()[0]));
    }
}
