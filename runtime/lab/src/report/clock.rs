//! Stamps of a flight whose clocks were set back or forward on purpose, on the clock of the truth.

use plumbline_config::Timestamp;
use plumbline_flight::flight::{Flown, Published, PublishedState};

/// Poses and states of a flight with stamps on the clock of the truth; `None` if its clocks did not step.
pub(super) fn on_true_clock(flown: &Flown) -> Option<(Vec<PublishedState>, Option<Published>)> {
    let (from_s, step_s) = flown.injected.iter().find_map(|fault| fault.clock_step_s())?;
    let mut poses = flown.poses.clone();
    let mut published = flown.published.clone();
    let begin = published
        .as_ref()
        .and_then(|p| Some(p.frames.first()?.stamp))
        .or_else(|| Some(poses.first()?.stamp))?;
    let step = Step { at: begin.plus_seconds(from_s), step_s };
    step.undo(poses.iter_mut().map(|pose| &mut pose.stamp));
    if let Some(published) = &mut published {
        step.undo(published.frames.iter_mut().map(|frame| &mut frame.stamp));
        step.undo(published.odometry.iter_mut().map(|pose| &mut pose.stamp));
        step.undo(published.steps.iter_mut().map(|step| &mut step.to));
        step.undo(published.steps.iter_mut().map(|step| &mut step.from));
    }
    Some((poses, published))
}

/// A step of a clock.
struct Step {
    at: Timestamp,
    step_s: f64,
}

impl Step {
    /// Puts stamps in the order of their arrival on the clock before the step. Those of later than the step, or that go back, are
    /// after it. One stamp within a period before the step is of before it: what follows is after it.
    fn undo<'a>(&self, stamps: impl Iterator<Item = &'a mut Timestamp>) {
        let stamps: Vec<_> = stamps.collect();
        let mut steps_s =
            stamps.windows(2).map(|pair| pair[1].seconds_since(*pair[0])).filter(|step_s| *step_s > 0.0);
        let period_s = steps_s.next().unwrap_or(0.0);
        let mut is_after = false;
        let mut last: Option<Timestamp> = None;
        for stamp in stamps {
            let is_near = |stamp: Timestamp| stamp.seconds_since(self.at) >= -period_s;
            is_after |= *stamp >= self.at
                || last.is_some_and(|last| *stamp < last || self.step_s < 0.0 && is_near(last));
            last = Some(*stamp);
            if is_after {
                *stamp = stamp.plus_seconds(-self.step_s);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn undone(step_s: f64, stamps_ms: &[i64]) -> Vec<i64> {
        let mut stamps: Vec<_> = stamps_ms.iter().map(|ms| Timestamp::from_nanos(ms * 1_000_000)).collect();
        let step = Step { at: Timestamp::from_nanos(1_000_000_000), step_s };
        step.undo(stamps.iter_mut());
        stamps.iter().map(|stamp| (stamp.as_nanos() + 500_000).div_euclid(1_000_000)).collect()
    }

    #[test]
    fn stamps_after_a_step_are_put_on_the_clock_of_before() {
        assert_eq!(undone(-0.52, &[900, 950, 480, 530]), [900, 950, 1000, 1050], "stamps go back");
        assert_eq!(
            undone(-0.52, &[900, 950, 980, 1030]),
            [900, 950, 1500, 1550],
            "frames of the past were refused"
        );
        assert_eq!(undone(0.5, &[900, 950, 1500, 1550]), [900, 950, 1000, 1050], "a step forward");
    }
}
