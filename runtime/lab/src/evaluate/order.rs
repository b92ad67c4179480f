//! Quaternions whose components were read in the other order: figures of position stay right, and those of attitude are nonsense.

use super::{Pairs, Side, Similarity};
use nalgebra::{Matrix3, Quaternion, Rotation3, UnitQuaternion};
use plumbline_drivers::StampedPose;
use serde::Serialize;

/// Attitudes that scatter less than this are taken as they were read, degrees.
const SUSPICIOUS_DEG: f64 = 2.0;
/// Another order is named if attitudes scatter less than this share of what they do as read.
const FAR_LESS: f64 = 0.25;
/// Poses that are compared, at most.
const POSES: usize = 2_000;

/// Sign that the quaternions of a trajectory have another order than they were read in.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Misordered {
    /// Which trajectory.
    pub side: Side,
    /// Order in which the columns seem to be, where they were read in the other one.
    pub order: Order,
    /// Scatter of the attitudes as they were read, root mean square, degrees.
    pub read_deg: f64,
    /// Scatter in the other order.
    pub other_deg: f64,
}

/// Order of the components of a quaternion in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Order {
    /// As tables of EuRoC have it: w x y z.
    ScalarFirst,
    /// As TUM files have it: x y z w.
    ScalarLast,
}

impl Order {
    /// The rotation whose components were read in the other order.
    fn reread(self, rotation: &UnitQuaternion<f64>) -> UnitQuaternion<f64> {
        let [x, y, z, w]: [f64; 4] = rotation.coords.into();
        UnitQuaternion::new_normalize(match self {
            Self::ScalarFirst => Quaternion::new(x, y, z, w),
            Self::ScalarLast => Quaternion::new(z, w, x, y),
        })
    }

    fn words(self) -> &'static str {
        match self {
            Self::ScalarFirst => "w x y z",
            Self::ScalarLast => "x y z w",
        }
    }
}

impl std::fmt::Display for Misordered {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let read = match self.order {
            Order::ScalarFirst => Order::ScalarLast,
            Order::ScalarLast => Order::ScalarFirst,
        };
        write!(
            f,
            "the quaternions of the {} seem to be in the order {}, and were read as {}: attitudes scatter by {:.1} degrees as read, \
             by {:.1} in the other order; rotation errors mean nothing until the columns are exchanged (TUM files: t x y z qx qy qz \
             qw, tables of EuRoC: qw first)",
            self.side,
            self.order.words(),
            read.words(),
            self.read_deg,
            self.other_deg
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
    let read_deg = scatter_deg(&frame, &estimate, &reference)?;
    if read_deg < SUSPICIOUS_DEG {
        return None;
    }
    let orders = [Order::ScalarFirst, Order::ScalarLast];
    let others =
        [Side::Estimate, Side::Reference].into_iter().flat_map(|side| orders.map(|order| (side, order)));
    let judged = others.filter_map(|(side, order)| {
        let reread = |of: &[UnitQuaternion<f64>]| of.iter().map(|q| order.reread(q)).collect::<Vec<_>>();
        let other_deg = match side {
            Side::Estimate => scatter_deg(&frame, &reread(&estimate), &reference),
            Side::Reference => scatter_deg(&frame, &estimate, &reread(&reference)),
        }?;
        Some(Misordered { side, order, read_deg, other_deg })
    });
    judged
        .min_by(|a, b| a.other_deg.total_cmp(&b.other_deg))
        .filter(|best| best.other_deg < FAR_LESS * read_deg)
}

/// Root mean square angle of the attitudes of one body in the other about their mean, degrees.
fn scatter_deg(
    frame: &UnitQuaternion<f64>,
    estimate: &[UnitQuaternion<f64>],
    reference: &[UnitQuaternion<f64>],
) -> Option<f64> {
    let between = || estimate.iter().zip(reference).map(|(e, r)| r.inverse() * frame * e);
    let sum: Matrix3<f64> = between().map(|q| q.to_rotation_matrix().into_inner()).sum();
    let svd = sum.svd(true, true);
    let (u, v_t) = svd.u.zip(svd.v_t)?;
    let mirror = Matrix3::from_diagonal(&[1.0, 1.0, (u.determinant() * v_t.determinant()).signum()].into());
    let mean = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(u * mirror * v_t));
    let squares: f64 = between().map(|q| q.angle_to(&mean).powi(2)).sum();
    let scatter = (squares / estimate.len().max(1) as f64).sqrt().to_degrees();
    scatter.is_finite().then_some(scatter)
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
    fn misread(poses: &mut [StampedPose], is: Order) {
        let read_as = match is {
            Order::ScalarFirst => Order::ScalarLast,
            Order::ScalarLast => Order::ScalarFirst,
        };
        poses.iter_mut().for_each(|p| p.pose.rotation = read_as.reread(&p.pose.rotation));
    }

    fn judged(pairs: &Pairs) -> Option<Misordered> {
        misordered(pairs, &align(pairs, AlignmentMode::Se3).unwrap())
    }

    #[test]
    fn quaternions_in_the_other_order_are_named_with_their_side() {
        assert_eq!(judged(&pairs()), None);
        for (order, words) in [(Order::ScalarFirst, "order w x y z"), (Order::ScalarLast, "order x y z w")] {
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
