//! Quaternions whose components were read in the other order, or that are inverted: figures of position stay right, and those of
//! attitude are nonsense.
//!
//! A quaternion in the other order is a constant rotation, the inverse of the true one, and another constant rotation. Where a rig
//! turns about one axis only, the inverse may be the true rotation again, seen from another frame (a rig whose x axis points up, as
//! EuRoC's, that only yaws): attitudes do not scatter then, and all are off by the same half turn.

use super::{Pairs, Side, Similarity};
use nalgebra::{Matrix3, Quaternion, Rotation3, UnitQuaternion};
use plumbline_drivers::StampedPose;
use serde::Serialize;

/// Attitudes that scatter less than this are taken as they were read, degrees.
const SUSPICIOUS_DEG: f64 = 2.0;
/// Another order is named if attitudes scatter less than this share of what they do as read.
const FAR_LESS: f64 = 0.1;
/// It is also named if attitudes are off by this angle as read, degrees, which no drift brings about,
const FAR_OFF_DEG: f64 = 60.0;
/// and by at most this one in the other order, where they scatter no more.
const NEAR_DEG: f64 = 10.0;
/// Poses that are compared, at most.
const POSES: usize = 2_000;

/// Sign that the quaternions of a trajectory have another order than they were read in.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Misordered {
    /// Which trajectory.
    pub side: Side,
    /// Order in which the columns seem to be, where they were read in another one.
    pub order: QuaternionOrder,
    /// Difference of the attitudes as they were read, root mean square, degrees: about their mean, or as it is where they hardly
    /// scatter.
    pub read_deg: f64,
    /// Difference in the other order.
    pub other_deg: f64,
}

/// Order of the components of a quaternion in a file, or its direction.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum QuaternionOrder {
    /// As tables of EuRoC have it: w x y z.
    ScalarFirst,
    /// As TUM files have it: x y z w.
    ScalarLast,
    /// The inverse: rotations from the world to the body, or quaternions in JPL's convention.
    Inverse,
}

impl QuaternionOrder {
    /// The rotation whose components were read in the other order.
    fn reread(self, rotation: &UnitQuaternion<f64>) -> UnitQuaternion<f64> {
        let [x, y, z, w]: [f64; 4] = rotation.coords.into();
        UnitQuaternion::new_normalize(match self {
            Self::ScalarFirst => Quaternion::new(x, y, z, w),
            Self::ScalarLast => Quaternion::new(z, w, x, y),
            Self::Inverse => Quaternion::new(w, -x, -y, -z),
        })
    }

    /// Defect, and cure.
    fn words(self) -> (&'static str, &'static str) {
        const EXCHANGE: &str =
            "exchange the columns (TUM files: t x y z qx qy qz qw, tables of EuRoC: qw first)";
        match self {
            Self::ScalarFirst => ("in the order w x y z, and were read as x y z w", EXCHANGE),
            Self::ScalarLast => ("in the order x y z w, and were read as w x y z", EXCHANGE),
            Self::Inverse => (
                "inverted (rotations from the world to the body, or JPL's convention)",
                "negate qx, qy and qz (a pose here is that of the body in the world, by Hamilton's convention)",
            ),
        }
    }
}

impl std::fmt::Display for Misordered {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let (defect, cure) = self.order.words();
        write!(
            f,
            "the quaternions of the {} seem to be {defect}: attitudes differ by {:.1} degrees as read, by {:.1} otherwise; rotation \
             errors mean nothing until that is mended: {cure}",
            self.side, self.read_deg, self.other_deg
        )
    }
}

/// The side whose quaternions fit far better in the other order, if there is one; `similarity` brings positions of the estimate to the
/// frame of the reference. A fixed rotation between the bodies of both is allowed for.
#[must_use]
pub fn misordered(pairs: &Pairs, similarity: &Similarity) -> Option<Misordered> {
    let step = pairs.len().div_ceil(POSES).max(1);
    let rotations = |poses: &[StampedPose]| -> Vec<UnitQuaternion<f64>> {
        poses.iter().step_by(step).map(|p| p.pose.rotation).collect()
    };
    let frame = similarity.rotation;
    let (estimate, reference) = (rotations(&pairs.estimate), rotations(&pairs.reference));
    let read = differences(&frame, &estimate, &reference)?;
    let orders = [QuaternionOrder::ScalarFirst, QuaternionOrder::ScalarLast, QuaternionOrder::Inverse];
    let others =
        [Side::Estimate, Side::Reference].into_iter().flat_map(|side| orders.map(|order| (side, order)));
    let judged: Vec<(Side, QuaternionOrder, Differences)> = others
        .filter_map(|(side, order)| {
            let reread = |of: &[UnitQuaternion<f64>]| of.iter().map(|q| order.reread(q)).collect::<Vec<_>>();
            let other = match side {
                Side::Estimate => differences(&frame, &reread(&estimate), &reference),
                Side::Reference => differences(&frame, &estimate, &reread(&reference)),
            }?;
            Some((side, order, other))
        })
        .collect();
    let best = |by: fn(&Differences) -> f64| judged.iter().min_by(|a, b| by(&a.2).total_cmp(&by(&b.2)));
    let named = |(side, order, other): &(Side, QuaternionOrder, Differences), by: fn(&Differences) -> f64| {
        Misordered { side: *side, order: *order, read_deg: by(&read), other_deg: by(other) }
    };
    let scatter = |d: &Differences| d.scatter_deg;
    let in_all = |d: &Differences| d.in_all_deg;
    let scatters_less = best(scatter)
        .filter(|(.., d)| read.scatter_deg >= SUSPICIOUS_DEG && d.scatter_deg < FAR_LESS * read.scatter_deg);
    let is_near = best(in_all).filter(|(.., d)| {
        let scatters = d.scatter_deg > read.scatter_deg + SUSPICIOUS_DEG;
        read.in_all_deg >= FAR_OFF_DEG && d.in_all_deg <= NEAR_DEG && !scatters
    });
    scatters_less.map(|found| named(found, scatter)).or_else(|| is_near.map(|found| named(found, in_all)))
}

/// Differences of the attitudes of two bodies, root mean square, degrees.
struct Differences {
    /// About their mean: a fixed rotation between the bodies is none.
    scatter_deg: f64,
    in_all_deg: f64,
}

/// Differences of attitudes, those of the estimate brought to the frame of the reference by `frame`.
fn differences(
    frame: &UnitQuaternion<f64>,
    estimate: &[UnitQuaternion<f64>],
    reference: &[UnitQuaternion<f64>],
) -> Option<Differences> {
    let between = || estimate.iter().zip(reference).map(|(e, r)| r.inverse() * frame * e);
    let sum: Matrix3<f64> = between().map(|q| q.to_rotation_matrix().into_inner()).sum();
    let svd = sum.svd(true, true);
    let (u, v_t) = svd.u.zip(svd.v_t)?;
    let mirror = Matrix3::from_diagonal(&[1.0, 1.0, (u.determinant() * v_t.determinant()).signum()].into());
    let mean = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(u * mirror * v_t));
    let rms_deg = |about: &UnitQuaternion<f64>| {
        let squares: f64 = between().map(|q| q.angle_to(about).powi(2)).sum();
        (squares / estimate.len().max(1) as f64).sqrt().to_degrees()
    };
    let found = Differences { scatter_deg: rms_deg(&mean), in_all_deg: rms_deg(&UnitQuaternion::identity()) };
    (found.scatter_deg.is_finite() && found.in_all_deg.is_finite()).then_some(found)
}

#[cfg(test)]
mod tests {
    use super::super::{AlignmentMode, align};
    use super::*;
    use nalgebra::{Isometry3, Translation3, Vector3};
    use plumbline_config::Timestamp;

    fn pairs() -> Pairs {
        let frame = Isometry3::new(Vector3::new(3.0, 1.0, 0.0), Vector3::z() * 1.3);
        let body = UnitQuaternion::from_euler_angles(0.0, 0.0, 0.4);
        let poses = (0..600).map(|k| {
            let t = 0.05 * f64::from(k);
            let position = Vector3::new(t.sin(), (0.7 * t).cos(), 0.4 * (1.3 * t).sin());
            let rotation = UnitQuaternion::from_euler_angles(
                0.3 * t.sin(),
                0.2 * (0.8 * t).cos(),
                1.5 * (0.3 * t).sin(),
            );
            let reference = Isometry3::from_parts(Translation3::from(position), rotation);
            let stamp = Timestamp::from_nanos(50_000_000 * i64::from(k));
            let estimate = frame * reference * body;
            (StampedPose { stamp, pose: estimate }, StampedPose { stamp, pose: reference })
        });
        let (estimate, reference) = poses.unzip();
        Pairs { estimate, reference }
    }

    /// The file as the other order reads it.
    fn misread(poses: &mut [StampedPose], is: QuaternionOrder) {
        let read_as = match is {
            QuaternionOrder::ScalarFirst => QuaternionOrder::ScalarLast,
            QuaternionOrder::ScalarLast => QuaternionOrder::ScalarFirst,
            QuaternionOrder::Inverse => QuaternionOrder::Inverse,
        };
        poses.iter_mut().for_each(|p| p.pose.rotation = read_as.reread(&p.pose.rotation));
    }

    fn judged(pairs: &Pairs) -> Option<Misordered> {
        misordered(pairs, &align(pairs, AlignmentMode::Se3).unwrap())
    }

    #[test]
    fn quaternions_in_the_other_order_are_named_with_their_side() {
        assert_eq!(judged(&pairs()), None);
        for (order, words) in [
            (QuaternionOrder::ScalarFirst, "order w x y z"),
            (QuaternionOrder::ScalarLast, "order x y z w"),
            (QuaternionOrder::Inverse, "inverted"),
        ] {
            for side in [Side::Estimate, Side::Reference] {
                let mut pairs = pairs();
                match side {
                    Side::Estimate => misread(&mut pairs.estimate, order),
                    Side::Reference => misread(&mut pairs.reference, order),
                }
                let found = judged(&pairs).unwrap();
                assert_eq!((found.side, found.order), (side, order), "{found}");
                assert!(found.to_string().contains(words) && found.other_deg < 1.0, "{found}");
            }
        }
    }

    /// A rig with this mounting that only yaws, in a frame that is turned, with an estimate that drifts a little.
    fn yawing(mounting: UnitQuaternion<f64>) -> Pairs {
        let mut pairs = pairs();
        for (k, (e, r)) in pairs.estimate.iter_mut().zip(&mut pairs.reference).enumerate() {
            let t = 0.05 * k as f64;
            let yaw = |angle: f64| UnitQuaternion::from_euler_angles(0.0, 0.0, angle);
            r.pose.rotation = yaw(1.5 * (0.3 * t).sin()) * mounting;
            e.pose.rotation = yaw(1.3 + 0.001 * t) * r.pose.rotation;
        }
        pairs
    }

    /// EuRoC's rigs have the x axis up: a flight that only yaws was silent, as its attitudes scatter in neither order.
    #[test]
    fn rigs_of_every_mounting_that_only_yaw_are_named_too() {
        let half = std::f64::consts::FRAC_PI_2;
        for (roll, pitch) in
            [(0.0, 0.0), (0.0, half), (0.0, -half), (half, 0.0), (-half, 0.0), (2.0 * half, 0.0)]
        {
            let sound = yawing(UnitQuaternion::from_euler_angles(roll, pitch, 0.0));
            assert_eq!(judged(&sound), None, "{roll} {pitch}");
            for order in [QuaternionOrder::ScalarFirst, QuaternionOrder::ScalarLast] {
                let mut pairs = sound.clone();
                misread(&mut pairs.estimate, order);
                let found = judged(&pairs).unwrap_or_else(|| panic!("{roll} {pitch} {order:?}: silent"));
                assert!(found.other_deg < 3.0, "{found}");
            }
        }
    }

    /// Bodies that differ by a permutation of the axes, such as camera and IMU, are no other order.
    #[test]
    fn bodies_that_are_mounted_otherwise_are_no_other_order() {
        let half = std::f64::consts::FRAC_PI_2;
        let angles = [-half, 0.0, half, 2.0 * half];
        for roll in angles {
            for (pitch, yaw) in angles.iter().flat_map(|pitch| angles.map(|yaw| (*pitch, yaw))) {
                let mut pairs = pairs();
                let mounting = UnitQuaternion::from_euler_angles(roll, pitch, yaw);
                pairs.estimate.iter_mut().for_each(|p| p.pose.rotation *= mounting);
                assert_eq!(judged(&pairs), None, "{roll} {pitch} {yaw}");
            }
        }
    }

    #[test]
    fn attitudes_that_are_merely_wrong_are_no_other_order() {
        let mut pairs = pairs();
        for (k, p) in pairs.estimate.iter_mut().enumerate() {
            p.pose.rotation *=
                UnitQuaternion::from_euler_angles(0.0, 0.5 * (k as f64 * 0.37).sin(), 0.004 * k as f64);
        }
        assert_eq!(judged(&pairs), None);
    }
}
