//! The degradation ladder: what is left out, and in which order, when the work does not fit.
//!
//! The ladder watches how long frames take and whether any had to be refused. Each step down is taken at
//! once when frames stop fitting; each step up waits for a calm stretch, and longer every time it proves
//! premature. The rung of a frame is an input of its estimate, so it is written down with the frame
//! ([`plumbline_record::orders`]) and followed when the flight is executed again.

use plumbline_estimator::WorkBudget;

/// Share of the period above which a frame is too long.
const TOO_LONG: f64 = 0.9;
/// Share of the period below which a frame leaves room for more.
const CALM: f64 = 0.55;
/// Frames in a row that are too long before a step down; a refused frame counts for all of them.
const STEP_DOWN_AFTER: u32 = 3;
/// Calm frames before a step up, at first and at most.
const STEP_UP_AFTER: (u32, u32) = (40, 640);
/// A step down within so many frames after a step up says that the step up came too early.
const PREMATURE_WITHIN: u32 = 100;
/// Frames from one that is taken to the next, on the rung of keyframes alone.
const KEYFRAME_STRIDE: u64 = 4;

/// Rungs of degradation. Each rung leaves out what those above it do, and more.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum Rung {
    /// Nothing.
    #[default]
    Full,
    /// Two fifths of points and segments.
    FewerFeatures,
    /// Lines.
    NoLines,
    /// All but two iterations of the solver.
    FewerIterations,
    /// Three of four frames.
    KeyframesOnly,
    /// All frames: the odometry goes on by the IMU.
    ImuOnly,
}

impl Rung {
    /// From top to bottom.
    pub const ALL: [Self; 6] = [
        Self::Full,
        Self::FewerFeatures,
        Self::NoLines,
        Self::FewerIterations,
        Self::KeyframesOnly,
        Self::ImuOnly,
    ];

    /// The rung `level` steps below the top, if there is one.
    pub fn of_level(level: u8) -> Option<Self> {
        Self::ALL.get(usize::from(level)).copied()
    }

    /// Steps below the top.
    #[must_use]
    pub const fn level(self) -> u8 {
        self as u8
    }

    /// In words.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Full => "full",
            Self::FewerFeatures => "fewer features",
            Self::NoLines => "no lines",
            Self::FewerIterations => "fewer iterations",
            Self::KeyframesOnly => "keyframes only",
            Self::ImuOnly => "IMU only",
        }
    }

    /// The work of a frame on this rung.
    #[must_use]
    pub const fn budget(self) -> WorkBudget {
        let features_percent = if matches!(self, Self::Full) { 100 } else { 60 };
        match self {
            Self::Full | Self::FewerFeatures => WorkBudget { features_percent, ..WorkBudget::FULL },
            Self::NoLines => WorkBudget { features_percent, lines: false, ..WorkBudget::FULL },
            Self::FewerIterations | Self::KeyframesOnly | Self::ImuOnly => {
                WorkBudget { features_percent, lines: false, max_iterations: 2 }
            }
        }
    }

    /// True if frame `sequence` is processed.
    #[must_use]
    pub const fn admits(self, sequence: u64) -> bool {
        match self {
            Self::ImuOnly => false,
            Self::KeyframesOnly => sequence.is_multiple_of(KEYFRAME_STRIDE),
            _ => true,
        }
    }

    fn below(self) -> Self {
        Self::of_level(self.level() + 1).unwrap_or(self)
    }

    fn above(self) -> Self {
        Self::of_level(self.level().saturating_sub(1)).unwrap_or(self)
    }
}

/// Decides on the rung, frame by frame.
#[derive(Clone, Debug)]
pub struct Ladder {
    rung: Rung,
    too_long: u32,
    calm: u32,
    patience: u32,
    since_step_up: Option<u32>,
}

impl Default for Ladder {
    fn default() -> Self {
        Self { rung: Rung::Full, too_long: 0, calm: 0, patience: STEP_UP_AFTER.0, since_step_up: None }
    }
}

impl Ladder {
    /// The rung of the next frame.
    pub fn rung(&self) -> Rung {
        self.rung
    }

    /// Takes what became of a frame: the longest of its stages as a share of the period (0 for a frame that
    /// the rung does not admit), and whether one was refused for lack of time. Returns the new rung if it
    /// changes.
    pub fn observe(&mut self, load: f64, was_refused: bool) -> Option<Rung> {
        self.since_step_up = self.since_step_up.map(|n| n + 1).filter(|n| *n <= PREMATURE_WITHIN);
        self.too_long = match (was_refused, load > TOO_LONG) {
            (true, _) => STEP_DOWN_AFTER,
            (false, true) => self.too_long + 1,
            (false, false) => 0,
        };
        self.calm = if load < CALM && !was_refused { self.calm + 1 } else { 0 };
        if self.too_long >= STEP_DOWN_AFTER {
            return self.step_down();
        }
        if self.calm >= self.patience && self.rung != Rung::Full {
            (self.calm, self.since_step_up) = (0, Some(0));
            self.rung = self.rung.above();
            return Some(self.rung);
        }
        None
    }

    fn step_down(&mut self) -> Option<Rung> {
        (self.too_long, self.calm) = (0, 0);
        self.patience = match self.since_step_up.take() {
            Some(_) => (self.patience * 2).min(STEP_UP_AFTER.1),
            None => STEP_UP_AFTER.0,
        };
        if self.rung == Rung::ImuOnly {
            return None;
        }
        self.rung = self.rung.below();
        Some(self.rung)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frames(ladder: &mut Ladder, count: u32, load: f64) -> Vec<Rung> {
        (0..count).filter_map(|_| ladder.observe(load, false)).collect()
    }

    #[test]
    fn every_rung_leaves_out_what_those_above_it_do() {
        for pair in Rung::ALL.windows(2) {
            let (a, b) = (pair[0].budget(), pair[1].budget());
            assert!(b.features_percent <= a.features_percent && b.lines <= a.lines);
            assert!(b.max_iterations <= a.max_iterations);
            assert_eq!(pair[0].below(), pair[1]);
            assert_eq!(Rung::of_level(pair[1].level()), Some(pair[1]));
        }
        assert_eq!(Rung::of_level(6), None);
    }

    #[test]
    fn one_long_frame_changes_nothing_a_refused_one_does() {
        let mut ladder = Ladder::default();
        assert_eq!(ladder.observe(1.4, false), None);
        assert_eq!(ladder.observe(0.4, false), None);
        assert_eq!(ladder.observe(0.4, true), Some(Rung::FewerFeatures));
    }

    #[test]
    fn it_goes_down_to_the_imu_and_all_the_way_back() {
        let mut ladder = Ladder::default();
        let down = frames(&mut ladder, 30, 1.2);
        assert_eq!(down, Rung::ALL[1..]);
        let up = frames(&mut ladder, 300, 0.2);
        assert_eq!(up, [4, 3, 2, 1, 0].map(|level| Rung::ALL[level]));
    }

    #[test]
    fn neither_long_nor_calm_stays_where_it_is() {
        let mut ladder = Ladder::default();
        frames(&mut ladder, 3, 1.2);
        assert!(frames(&mut ladder, 1000, 0.7).is_empty());
    }

    #[test]
    fn a_step_up_that_proves_premature_is_tried_less_often() {
        let mut ladder = Ladder::default();
        let mut steps_up = Vec::new();
        // The lower rung is calm, the upper one too long: a naive rule would swing for ever.
        for frame in 0..4000 {
            let load = if ladder.rung() == Rung::Full { 1.1 } else { 0.4 };
            if ladder.observe(load, false) == Some(Rung::Full) {
                steps_up.push(frame);
            }
        }
        let gaps: Vec<_> = steps_up.windows(2).map(|w| w[1] - w[0]).collect();
        assert!(gaps.windows(2).all(|w| w[1] >= w[0]), "{gaps:?}");
        assert!(steps_up.len() <= 10, "{steps_up:?}");
    }
}
