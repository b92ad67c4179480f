//! Subject of a figure: an estimated flight and, where it is known, where the vehicle really was.

use crate::evaluate::{
    AlignmentMode, EvaluateError, Pairs, Similarity, absolute_errors, align, aligned, path_length_m,
    pose_error,
};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use plumbline_config::{Timestamp, median_by};
use plumbline_drivers::StampedPose;
use plumbline_estimator::Estimate;

/// The truth is interpolated between poses up to this far apart, ns.
const MAX_TRUTH_GAP_NS: i64 = 100_000_000;
/// A pause of the estimate this many times its usual period breaks a curve.
const GAP_PERIODS: f64 = 3.5;

/// Way in which the truth is brought into the frame of the estimate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TruthAlignment {
    /// By position and yaw at the first pose: what the covariance, which begins there, speaks of.
    FirstPose,
    /// Fitted over the whole flight, as `plumbline evaluate` does.
    Fitted(AlignmentMode),
}

impl TruthAlignment {
    /// In words, for the figure.
    pub(super) fn words(self) -> &'static str {
        match self {
            Self::FirstPose => "truth aligned at the first pose (position, yaw)",
            Self::Fitted(AlignmentMode::None) => "truth not aligned",
            Self::Fitted(AlignmentMode::Origin) => "truth aligned at the first pose (position, attitude)",
            Self::Fitted(AlignmentMode::Yaw) => "truth aligned over all (position, yaw)",
            Self::Fitted(AlignmentMode::Se3) => "truth aligned over all, SE(3)",
            Self::Fitted(AlignmentMode::Sim3) => "truth aligned over all, Sim(3)",
        }
    }
}

/// One pose of the estimate, and what is known with it.
#[derive(Clone, Debug)]
pub(super) struct Sample {
    pub stamp: Timestamp,
    pub pose_o_b: Isometry3<f64>,
    /// The state, where the source has more than poses.
    pub nav: Option<Estimate>,
    /// A number that changes where the curve must break: after a reset or without a pose.
    pub piece: u32,
    /// Points tracked and lines matched, where known.
    pub features: Option<(u32, u32)>,
    /// The true pose of the body in the odometry frame, where known.
    pub truth_o_b: Option<Isometry3<f64>>,
}

/// An estimated flight, to be drawn.
#[derive(Clone, Debug)]
pub struct PlotSubject {
    pub(super) name: String,
    pub(super) samples: Vec<Sample>,
    /// All of the truth within the time of the flight, in the odometry frame.
    pub(super) truth: Vec<StampedPose>,
    /// When the estimate was reset.
    pub(super) resets: Vec<Timestamp>,
    /// Way in which the truth was brought to the estimate.
    pub(super) alignment: Option<TruthAlignment>,
    /// Root mean square position error after SE(3) alignment, m, and the length of the true path, m.
    pub(super) ate_rmse_m: Option<(f64, f64)>,
}

impl PlotSubject {
    /// A flight of which only poses are known; `None` without any.
    #[must_use]
    pub fn of_trajectory(name: &str, poses: &[StampedPose]) -> Option<Self> {
        let sample = |p: &StampedPose| Sample {
            stamp: p.stamp,
            pose_o_b: p.pose,
            nav: None,
            piece: 0,
            features: None,
            truth_o_b: None,
        };
        Self::of(name, poses.iter().map(sample).collect(), Vec::new())
    }

    /// A flight of which everything is known; `None` if no row has a pose.
    #[must_use]
    pub fn of_states(name: &str, rows: &[Estimate]) -> Option<Self> {
        let (mut piece, mut samples) = (0, Vec::new());
        for row in rows {
            let Some(pose_o_b) = row.pose() else {
                piece += 1;
                continue;
            };
            samples.push(Sample {
                stamp: row.stamp,
                pose_o_b: *pose_o_b,
                nav: Some(row.clone()),
                piece: piece + row.reset_counter,
                features: Some((row.figures.points_tracked, row.figures.lines_matched)),
                truth_o_b: None,
            });
        }
        let is_reset = |pair: &&[Estimate]| pair[1].reset_counter != pair[0].reset_counter;
        let resets = rows.windows(2).filter(is_reset).map(|pair| pair[1].stamp).collect();
        Self::of(name, samples, resets)
    }

    fn of(name: &str, mut samples: Vec<Sample>, resets: Vec<Timestamp>) -> Option<Self> {
        samples.first()?;
        let limit_s = GAP_PERIODS * median_period_s(&samples);
        let mut gaps = 0;
        for index in 1..samples.len() {
            let pause_s = samples[index].stamp.nanos_since(samples[index - 1].stamp) as f64 * 1e-9;
            gaps += u32::from(pause_s > limit_s);
            samples[index].piece += gaps;
        }
        Some(Self {
            name: name.to_owned(),
            samples,
            truth: Vec::new(),
            resets,
            alignment: None,
            ate_rmse_m: None,
        })
    }

    /// True if more than poses is known.
    #[must_use]
    pub fn has_states(&self) -> bool {
        self.samples.iter().any(|sample| sample.nav.is_some())
    }

    /// Adds the ground truth, aligned to the odometry frame.
    ///
    /// # Errors
    /// When the two have no time in common, or too little for the alignment.
    pub fn with_truth(
        mut self,
        truth: &[StampedPose],
        alignment: TruthAlignment,
    ) -> Result<Self, EvaluateError> {
        let estimate: Vec<StampedPose> =
            self.samples.iter().map(|s| StampedPose { stamp: s.stamp, pose: s.pose_o_b }).collect();
        let mut truth = truth.to_vec();
        truth.sort_by_key(|pose| pose.stamp);
        let known = |p: &&StampedPose| pose_at(&truth, p.stamp).is_some();
        let estimate_known: Vec<StampedPose> = estimate.iter().filter(known).copied().collect();
        let reference = estimate_known
            .iter()
            .filter_map(|p| Some(StampedPose { stamp: p.stamp, pose: pose_at(&truth, p.stamp)? }))
            .collect();
        if estimate_known.is_empty() {
            // Says which times do not meet.
            crate::evaluate::associate(&estimate, &truth, 0.5 * MAX_TRUTH_GAP_NS as f64 * 1e-9)?;
            return Err(EvaluateError::TooFew { found: 0, needed: 1 });
        }
        let pairs = Pairs { estimate: estimate_known, reference };
        let to_estimate = Inverse::of(&match alignment {
            TruthAlignment::FirstPose => at_first_pose(&pairs),
            TruthAlignment::Fitted(mode) => align(&pairs, mode)?,
        });
        for pose in &mut truth {
            pose.pose = to_estimate.apply(&pose.pose);
        }
        for sample in &mut self.samples {
            sample.truth_o_b = pose_at(&truth, sample.stamp);
        }
        let (first, last) = (self.samples[0].stamp, self.samples[self.samples.len() - 1].stamp);
        truth.retain(|pose| (first..=last).contains(&pose.stamp));
        (self.truth, self.alignment) = (truth, Some(alignment));
        self.ate_rmse_m = align(&pairs, AlignmentMode::Se3).ok().and_then(|by| {
            let (ate_m, _) = absolute_errors(&aligned(&pairs, &by)).ok()?;
            Some((ate_m.rmse, path_length_m(&pairs.reference)))
        });
        Ok(self)
    }

    /// Time since the first pose, s.
    pub(super) fn time_s(&self, stamp: Timestamp) -> f64 {
        stamp.nanos_since(self.samples[0].stamp) as f64 * 1e-9
    }
}

impl Sample {
    /// Position error in `O`, m, and attitude error about the axes of `O`, rad: estimate minus truth.
    pub(super) fn error(&self) -> Option<(Vector3<f64>, Vector3<f64>)> {
        let error = pose_error(&self.pose_o_b, self.truth_o_b.as_ref()?);
        let attitude_o = self.pose_o_b.rotation * error.fixed_rows::<3>(3).into_owned();
        Some((-error.fixed_rows::<3>(0).into_owned(), -attitude_o))
    }
}

/// The way back of a similarity.
struct Inverse(Similarity);

impl Inverse {
    fn of(similarity: &Similarity) -> Self {
        Self(*similarity)
    }

    fn apply(&self, pose: &Isometry3<f64>) -> Isometry3<f64> {
        let Similarity { rotation, translation, scale } = self.0;
        let back = rotation.inverse();
        let position = back * (pose.translation.vector - translation) / scale;
        Isometry3::from_parts(Translation3::from(position), back * pose.rotation)
    }
}

/// The similarity of position and yaw that brings the first estimate to its truth.
fn at_first_pose(pairs: &Pairs) -> Similarity {
    let (estimate, truth) = (pairs.estimate[0].pose, pairs.reference[0].pose);
    let relative = truth.rotation * estimate.rotation.inverse();
    let yaw = 2.0 * relative.k.atan2(relative.w);
    let rotation = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw);
    let translation = truth.translation.vector - rotation * estimate.translation.vector;
    Similarity { rotation, translation, scale: 1.0 }
}

/// The pose at `stamp` between its neighbours in `poses`, which are in order of time.
fn pose_at(poses: &[StampedPose], stamp: Timestamp) -> Option<Isometry3<f64>> {
    let after = poses.partition_point(|pose| pose.stamp < stamp);
    let right = poses.get(after)?;
    if right.stamp == stamp {
        return Some(right.pose);
    }
    let left = poses.get(after.checked_sub(1)?)?;
    let gap_ns = right.stamp.nanos_since(left.stamp);
    if gap_ns > MAX_TRUTH_GAP_NS {
        return None;
    }
    let share = stamp.nanos_since(left.stamp) as f64 / gap_ns as f64;
    left.pose.try_lerp_slerp(&right.pose, share, 1e-12)
}

fn median_period_s(samples: &[Sample]) -> f64 {
    let mut periods: Vec<i64> =
        samples.windows(2).map(|pair| pair[1].stamp.nanos_since(pair[0].stamp)).collect();
    median_by(&mut periods, Ord::cmp).map_or(f64::INFINITY, |period| period as f64 * 1e-9)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A circle that is flown once, seen from a frame that is turned and moved.
    fn circle(frame: &Isometry3<f64>, step_ms: i64) -> Vec<StampedPose> {
        let pose = |ms: i64| {
            let angle = ms as f64 * 1e-3;
            let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle);
            frame * Isometry3::from_parts(Vector3::new(angle.cos(), angle.sin(), 1.0).into(), turn)
        };
        let stamped = |ms| StampedPose { stamp: Timestamp::from_nanos(ms * 1_000_000), pose: pose(ms) };
        (0..6000 / step_ms).map(|k| stamped(k * step_ms)).collect()
    }

    fn largest_error(subject: &PlotSubject) -> (f64, f64) {
        let errors: Vec<_> = subject.samples.iter().filter_map(Sample::error).collect();
        assert!(errors.len() + 20 > subject.samples.len());
        let largest = |norms: &mut dyn Iterator<Item = f64>| norms.fold(0.0, f64::max);
        (
            largest(&mut errors.iter().map(|(position, _)| position.norm())),
            largest(&mut errors.iter().map(|(_, attitude)| attitude.norm())),
        )
    }

    #[test]
    fn the_same_flight_in_another_frame_has_no_error() {
        let world = Isometry3::new(Vector3::new(5.0, -3.0, 2.0), Vector3::z() * 2.1);
        for alignment in [
            TruthAlignment::FirstPose,
            TruthAlignment::Fitted(AlignmentMode::Se3),
            TruthAlignment::Fitted(AlignmentMode::Yaw),
        ] {
            let subject = PlotSubject::of_trajectory("circle", &circle(&Isometry3::identity(), 50)).unwrap();
            let subject = subject.with_truth(&circle(&world, 5), alignment).unwrap();
            let (position, attitude) = largest_error(&subject);
            assert!(position < 1e-9 && attitude < 1e-9, "{alignment:?}: {position} {attitude}");
        }
    }

    #[test]
    fn the_truth_between_two_poses_is_interpolated() {
        let truth = circle(&Isometry3::identity(), 40);
        let subject = PlotSubject::of_trajectory("circle", &circle(&Isometry3::identity(), 25)).unwrap();
        let (position, attitude) =
            largest_error(&subject.with_truth(&truth, TruthAlignment::FirstPose).unwrap());
        // A chord of 0.04 rad lies 0.2 mm within the circle.
        assert!(position < 3e-4 && attitude < 1e-9, "{position} {attitude}");
    }

    #[test]
    fn an_attitude_error_is_told_about_the_axes_of_the_odometry_frame() {
        let poses = circle(&Isometry3::identity(), 50);
        let turned: Vec<_> = poses
            .iter()
            .map(|p| StampedPose {
                pose: Isometry3::new(Vector3::zeros(), Vector3::z() * 0.01) * p.pose,
                ..*p
            })
            .collect();
        let subject = PlotSubject::of_trajectory("circle", &poses).unwrap();
        let subject = subject.with_truth(&turned, TruthAlignment::Fitted(AlignmentMode::None)).unwrap();
        for (_, attitude) in subject.samples.iter().filter_map(Sample::error) {
            assert!((attitude + Vector3::z() * 0.01).norm() < 1e-9, "{attitude}");
        }
    }

    #[test]
    fn a_pause_breaks_the_curve() {
        let mut poses = circle(&Isometry3::identity(), 50);
        poses.drain(40..60);
        let subject = PlotSubject::of_trajectory("circle", &poses).unwrap();
        assert_eq!((subject.samples[39].piece, subject.samples[40].piece), (0, 1));
        assert!(PlotSubject::of_trajectory("nothing", &[]).is_none());
    }

    #[test]
    fn flights_of_other_times_are_told_apart() {
        let later: Vec<_> = circle(&Isometry3::identity(), 5)
            .iter()
            .map(|p| StampedPose { stamp: p.stamp.plus_nanos(1_000_000_000_000), ..*p })
            .collect();
        let subject = PlotSubject::of_trajectory("circle", &circle(&Isometry3::identity(), 50)).unwrap();
        let message = subject.with_truth(&later, TruthAlignment::FirstPose).unwrap_err().to_string();
        assert!(message.contains("no stamps within"), "{message}");
    }
}
