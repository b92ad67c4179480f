//! Which pairs of live cameras are kept while somebody moves the board before them: those that show it, held still enough,
//! somewhere or somehow new. A function of what is seen and when; [`live`](super::live) brings that.

use super::adjust::{Corner, Sight};
use super::initial;
use super::lens::LensKind;
use super::result::{CELLS, LEAST_TILT_DEG, cell_of};
use super::target::Target;
use nalgebra::{Vector2, Vector3};
use plumbline_config::{CameraModel, Timestamp};
use std::fmt;

/// A pair shows something new where the board has moved by so much of the image's width since each pair that was kept, or,
/// where it stayed, its corners against each other by so much of their spread: a tilt by some 20 degrees does that, or a turn.
const MOVED: f64 = 0.07;
const CHANGED: f64 = 0.05;
/// A board that moves by more of the image's width in a second is blurred: 1 px of 750 in 5 ms of exposure.
const MOST_SPEED: f64 = 0.25;
/// Looks that are further apart than this tell no speed, ns.
const FURTHEST_NS: i64 = 1_000_000_000;
/// When there is enough: pairs, of two cameras those that show the board to both, share of each image, and of views that are
/// tilted. A good result has more than 85 % of coverage.
const ENOUGH_PAIRS: usize = 20;
const ENOUGH_SHARED: usize = 12;
const ENOUGH_COVERAGE: f64 = 0.86;
const ENOUGH_TILTED: f64 = 1.0 / 3.0;
/// Tilts are those under a camera that is guessed afresh at these numbers of pairs.
const GUESSED_AT: [usize; 4] = [6, 12, 24, 48];

/// Request to the person who moves the board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Hint {
    /// No camera sees it.
    Show,
    /// It moves too fast.
    HoldStill,
    /// This part of the image of a camera has seen least of it.
    MoveTo {
        /// The camera.
        camera: usize,
        /// The part, in words.
        part: &'static str,
    },
    /// Too few views are tilted.
    Tilt,
    /// Too few pairs show it to both cameras.
    ShowToBoth,
    /// More of anything.
    More,
    /// Nothing: there is enough.
    Enough,
}

impl fmt::Display for Hint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Show => f.write_str("the board is not in sight"),
            Self::HoldStill => f.write_str("hold it stiller"),
            Self::MoveTo { camera, part } => write!(f, "move it to the {part} of cam{camera}"),
            Self::Tilt => f.write_str("tilt it by 30 to 45 degrees, to all sides"),
            Self::ShowToBoth => f.write_str("hold it where both cameras see it"),
            Self::More => f.write_str("a few more, also nearer and turned by a quarter"),
            Self::Enough => f.write_str("that is enough"),
        }
    }
}

/// Progress of the gathering.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gathered {
    /// Frames that were looked at.
    pub looks: u64,
    /// Pairs that were kept.
    pub pairs: usize,
    /// Number of them that show the board to both cameras.
    pub shared: usize,
    /// Number of them that are tilted, by a camera that is guessed; 0 until there are some.
    pub tilted: usize,
    /// Share of the cells of each camera's image in which corners were seen.
    pub coverage: [f64; 2],
    /// Missing view.
    pub hint: Hint,
}

/// Decides which pairs are kept.
#[derive(Debug)]
pub struct Gatherer {
    points: Vec<Vector2<f64>>,
    turns: Vec<Vec<usize>>,
    kind: LensKind,
    /// Image sizes of one camera or two, px.
    sizes_px: Vec<(usize, usize)>,
    last: Option<(Timestamp, Sight)>,
    kept: Vec<Sight>,
    covered: [[bool; CELLS[0] * CELLS[1]]; 2],
    guess: Option<CameraModel>,
    tilted: usize,
    looks: u64,
    is_too_fast: bool,
}

impl Gatherer {
    /// For a board before one camera or two, whose images have these sizes, px.
    #[must_use]
    pub fn new(target: &Target, kind: LensKind, sizes_px: &[(usize, usize)]) -> Self {
        Self {
            points: target.corners_m(),
            turns: target.turns(),
            kind,
            sizes_px: sizes_px.to_vec(),
            last: None,
            kept: Vec::new(),
            covered: [[false; CELLS[0] * CELLS[1]]; 2],
            guess: None,
            tilted: 0,
            looks: 0,
            is_too_fast: false,
        }
    }

    /// Looks at the board at this time; true if the view is to be kept.
    pub fn look(&mut self, stamp: Timestamp, sight: &Sight) -> bool {
        self.looks += 1;
        let last = self.last.replace((stamp, sight.clone()));
        self.is_too_fast = false;
        if sight.iter().all(Vec::is_empty) {
            return false;
        }
        let Some(speed) = last.and_then(|(before, seen)| self.speed(stamp.nanos_since(before), &seen, sight))
        else {
            return false;
        };
        self.is_too_fast = speed > MOST_SPEED;
        if self.is_too_fast || !self.is_new(sight) {
            return false;
        }
        self.keep(sight);
        true
    }

    /// Progress of the gathering.
    #[must_use]
    pub fn gathered(&self) -> Gathered {
        let share = |camera: usize| {
            let covered = self.covered[camera].iter().filter(|is_covered| **is_covered).count();
            covered as f64 / self.covered[camera].len() as f64
        };
        let shared = self.kept.iter().filter(|sight| sight.iter().all(|seen| !seen.is_empty())).count();
        let coverage = [share(0), share(1)];
        Gathered {
            looks: self.looks,
            pairs: self.kept.len(),
            shared,
            tilted: self.tilted,
            coverage,
            hint: self.hint(coverage, shared),
        }
    }

    fn hint(&self, coverage: [f64; 2], shared: usize) -> Hint {
        let is_missing = self.last.as_ref().is_none_or(|(_, sight)| sight.iter().all(Vec::is_empty));
        let cameras = self.sizes_px.len();
        let least = if cameras == 2 && coverage[1] < coverage[0] { 1 } else { 0 };
        let has_all = |enough: usize| self.kept.len() >= enough;
        let lacks_tilt = (self.tilted as f64) < ENOUGH_TILTED * self.kept.len() as f64;
        match () {
            () if coverage[least] >= ENOUGH_COVERAGE
                && has_all(ENOUGH_PAIRS)
                && !lacks_tilt
                && (cameras < 2 || shared >= ENOUGH_SHARED) =>
            {
                Hint::Enough
            }
            () if is_missing => Hint::Show,
            () if self.is_too_fast => Hint::HoldStill,
            // Tilt goes with any place, so it is asked for half of the time.
            () if has_all(GUESSED_AT[0]) && lacks_tilt && self.kept.len() % 2 == 1 => Hint::Tilt,
            () if coverage[least] < ENOUGH_COVERAGE => {
                Hint::MoveTo { camera: least, part: self.emptiest(least) }
            }
            () if lacks_tilt => Hint::Tilt,
            () if cameras == 2 && shared < ENOUGH_SHARED => Hint::ShowToBoth,
            () => Hint::More,
        }
    }

    /// The part of a camera's image in which the smallest share of the cells has seen a corner.
    fn emptiest(&self, camera: usize) -> &'static str {
        const PARTS: [[&str; 3]; 3] = [
            ["upper left", "upper edge", "upper right"],
            ["left edge", "middle", "right edge"],
            ["lower left", "lower edge", "lower right"],
        ];
        let mut counts = [[(0_u32, 0_u32); 3]; 3];
        for (cell, is_covered) in self.covered[camera].iter().enumerate() {
            let [x, y] = [cell % CELLS[0] * 3 / CELLS[0], cell / CELLS[0] * 3 / CELLS[1]];
            counts[y][x].0 += u32::from(*is_covered);
            counts[y][x].1 += 1;
        }
        let share = |k: &usize| {
            let (covered, cells) = counts[k / 3][k % 3];
            f64::from(covered) / f64::from(cells.max(1))
        };
        // Corners are hardest to fill, so of equal parts the first of these.
        let order = [0, 2, 8, 6, 1, 5, 7, 3, 4];
        let least = order.into_iter().min_by(|a, b| share(a).total_cmp(&share(b))).unwrap_or(4);
        PARTS[least / 3][least % 3]
    }

    fn keep(&mut self, sight: &Sight) {
        for (camera, size_px) in self.sizes_px.iter().enumerate() {
            for corner in &sight[camera] {
                self.covered[camera][cell_of(&corner.px, *size_px)] = true;
            }
        }
        self.kept.push(sight.clone());
        if GUESSED_AT.contains(&self.kept.len()) {
            let views: Vec<&[Corner]> =
                self.kept.iter().map(|sight| sight[0].as_slice()).filter(|view| !view.is_empty()).collect();
            self.guess = initial::first_guess(self.kind, self.sizes_px[0], &self.points, &views);
            self.tilted = self.kept.iter().filter(|sight| self.is_tilted(sight)).count();
        } else {
            self.tilted += usize::from(self.is_tilted(sight));
        }
    }

    /// True if the board is tilted against the left camera.
    fn is_tilted(&self, sight: &Sight) -> bool {
        let pose = |guess: &CameraModel| initial::pose(guess, &self.points, &sight[0]);
        self.guess.as_ref().filter(|_| !sight[0].is_empty()).and_then(pose).is_some_and(|pose_c_t| {
            let normal = pose_c_t.rotation * Vector3::z();
            normal.z.abs().clamp(0.0, 1.0).acos().to_degrees() > LEAST_TILT_DEG
        })
    }

    /// Speed of the board between two looks, widths of the image a second; `None` where it is not known.
    fn speed(&self, interval_ns: i64, before: &Sight, now: &Sight) -> Option<f64> {
        let way = self.motion(before, now)?;
        (1..FURTHEST_NS).contains(&interval_ns).then(|| way.all / (interval_ns as f64 * 1e-9))
    }

    /// True if the board was seen nowhere near before.
    fn is_new(&self, sight: &Sight) -> bool {
        let is_near = |kept: &Sight| {
            self.motion(kept, sight).is_some_and(|way| way.shift < MOVED && way.change < CHANGED)
        };
        !self.kept.iter().any(is_near)
    }

    /// Motion of corners in the first camera that sees some of them both times; `None` where none does.
    fn motion(&self, before: &Sight, now: &Sight) -> Option<Motion> {
        (0..self.sizes_px.len()).find_map(|camera| {
            let width = self.sizes_px[camera].0.max(1) as f64;
            let ways = self.turns.iter().filter_map(|turn| self.way(turn, &before[camera], &now[camera]));
            let way = ways.min_by(|a, b| a.all.total_cmp(&b.all))?;
            Some(Motion { all: way.all / width, shift: way.shift / width, ..way })
        })
    }

    /// The motion, `all` and `shift` in px, if the corners now are those before under a turn of the board.
    fn way(&self, turn: &[usize], before: &[Corner], now: &[Corner]) -> Option<Motion> {
        let mut places = vec![None; self.points.len()];
        for corner in now {
            *places.get_mut(corner.number)? = Some(corner.px);
        }
        let both = |corner: &Corner| Some((corner.px, places[*turn.get(corner.number)?]? - corner.px));
        let (seen, steps): (Vec<_>, Vec<_>) = before.iter().filter_map(both).unzip();
        let (_, spread) = mean_and_spread(&seen)?;
        let (mean, scatter) = mean_and_spread(&steps)?;
        Some(Motion {
            all: mean.norm().hypot(scatter),
            shift: mean.norm(),
            change: scatter / spread.max(f64::MIN_POSITIVE),
        })
    }
}

/// Motion of corners: all in all, in the mean, and against each other in shares of their spread.
#[derive(Clone, Copy, Debug)]
struct Motion {
    all: f64,
    shift: f64,
    change: f64,
}

/// The mean, and the root of the mean squared distance from it; `None` of nothing.
fn mean_and_spread(all: &[Vector2<f64>]) -> Option<(Vector2<f64>, f64)> {
    let count = all.len() as f64;
    let mean = all.iter().sum::<Vector2<f64>>() / count;
    let spread = (all.iter().map(|one| (one - mean).norm_squared()).sum::<f64>() / count).sqrt();
    (!all.is_empty()).then_some((mean, spread))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibrate::camera::adjust::Cameras;
    use nalgebra::Isometry3;

    const MS: i64 = 1_000_000;
    const SIZE: (usize, usize) = (640, 480);

    struct Rig {
        gatherer: Gatherer,
        cameras: Cameras,
        now_ns: i64,
    }

    fn rig(target: &str, cameras: usize) -> Rig {
        let target: Target = target.parse().unwrap();
        let model = CameraModel {
            width_px: SIZE.0,
            height_px: SIZE.1,
            focal_px: Vector2::repeat(420.0),
            centre_px: Vector2::new(319.5, 239.5),
            distortion: LensKind::RadialTangential.distortion([0.0; 4]),
        };
        let pose_c1_c0 = Isometry3::translation(-0.1, 0.0, 0.0);
        let cameras_of = Cameras { models: vec![model; cameras], pose_c1_c0 };
        let gatherer = Gatherer::new(&target, LensKind::RadialTangential, &vec![SIZE; cameras]);
        Rig { gatherer, cameras: cameras_of, now_ns: 0 }
    }

    impl Rig {
        /// Sight of the board whose middle is there, m, tilted by so much.
        fn sight(&self, middle: [f64; 3], tilt: [f64; 3]) -> Sight {
            let points = &self.gatherer.points;
            let centre = points.iter().sum::<Vector2<f64>>() / points.len() as f64;
            let pose = Isometry3::new(Vector3::from(middle), Vector3::from(tilt))
                * Isometry3::translation(-centre.x, -centre.y, 0.0);
            std::array::from_fn(|camera| {
                let Some(model) = self.cameras.models.get(camera) else { return Vec::new() };
                let is_inside =
                    |px: &Vector2<f64>| (1.0..638.0).contains(&px.x) && (1.0..478.0).contains(&px.y);
                let corner = |(number, point)| {
                    let px = model.project(&self.cameras.seen_from(camera, &pose, point))?;
                    is_inside(&px).then_some(Corner { number, px })
                };
                points.iter().enumerate().filter_map(corner).collect()
            })
        }

        /// Two looks at the board at rest there, 50 ms apart; whether the second was kept.
        fn shown(&mut self, middle: [f64; 3], tilt: [f64; 3]) -> bool {
            let sight = self.sight(middle, tilt);
            let mut kept = false;
            for _ in 0..2 {
                self.now_ns += 50 * MS;
                kept = self.gatherer.look(Timestamp::from_nanos(self.now_ns), &sight);
            }
            // The way to the next place is not watched.
            self.now_ns += 2 * FURTHEST_NS;
            kept
        }
    }

    #[test]
    fn a_board_is_kept_where_it_is_new_and_not_again() {
        for target in ["aprilgrid:6x6:0.088:0.3", "chessboard:9x6:0.05", "charuco:9x6:0.06:0.045"] {
            let mut rig = rig(target, 2);
            assert!(rig.shown([0.0, 0.0, 1.5], [0.0; 3]), "{target}");
            assert!(!rig.shown([0.01, 0.0, 1.5], [0.0, 0.02, 0.0]), "{target}: as before");
            assert!(rig.shown([0.3, 0.0, 1.5], [0.0; 3]), "{target}: moved");
            assert!(rig.shown([0.0, 0.0, 1.5], [0.6, 0.0, 0.0]), "{target}: tilted");
            assert!(rig.shown([0.0, 0.0, 1.1], [0.0; 3]), "{target}: nearer");
            assert!(!rig.shown([0.3, 0.0, 1.5], [0.0; 3]), "{target}: as before");
            assert_eq!((rig.gatherer.gathered().pairs, rig.gatherer.gathered().shared), (4, 4));
        }
    }

    #[test]
    fn a_board_that_moves_fast_or_is_away_is_not_kept() {
        let mut rig = rig("aprilgrid:6x6:0.088:0.3", 1);
        for k in 0..20 {
            // 0.8 m in a second at 1.5 m: 224 px of 640.
            let sight = rig.sight([0.04 * f64::from(k) - 0.4, 0.0, 1.5], [0.0; 3]);
            assert!(!rig.gatherer.look(Timestamp::from_nanos(i64::from(k) * 50 * MS), &sight));
        }
        assert_eq!(rig.gatherer.gathered().hint, Hint::HoldStill);
        rig.now_ns = 60_000 * MS;
        assert!(!rig.shown([3.0, 0.0, 1.5], [0.0; 3]));
        assert_eq!(rig.gatherer.gathered().hint, Hint::Show);
    }

    #[test]
    fn a_chessboard_that_is_found_from_its_other_end_has_not_moved() {
        let mut rig = rig("chessboard:9x6:0.05", 1);
        assert!(rig.shown([0.0, 0.0, 1.0], [0.0; 3]));
        let count = rig.gatherer.points.len();
        let turned = |corner: &Corner| Corner { number: count - 1 - corner.number, ..*corner };
        let sight = rig.sight([0.0, 0.0, 1.0], [0.0; 3]).map(|seen| seen.iter().map(turned).collect());
        for k in 1..3 {
            let at = Timestamp::from_nanos(rig.now_ns + k * 50 * MS);
            assert!(!rig.gatherer.look(at, &sight) && !rig.gatherer.is_too_fast);
        }
    }

    #[test]
    fn the_person_is_led_to_what_is_missing_until_there_is_enough() {
        let mut rig = rig("aprilgrid:6x6:0.088:0.3", 2);
        assert_eq!(rig.gatherer.gathered().hint, Hint::Show);
        rig.shown([0.1, 0.1, 1.5], [0.0; 3]);
        assert_eq!(rig.gatherer.gathered().hint, Hint::MoveTo { camera: 0, part: "upper left" });
        let mut hints = Vec::new();
        for k in 0..60 {
            let [x, y] = [f64::from(k % 5 - 2), f64::from(k / 5 % 4) - 1.5];
            let tilt = if k < 30 { [0.0; 3] } else { [0.5 * f64::from(k % 3 - 1), 0.45, 0.3] };
            rig.shown([0.36 * x + 0.05, 0.28 * y, 1.1], tilt);
            hints.push(rig.gatherer.gathered().hint);
            if hints.last() == Some(&Hint::Enough) {
                break;
            }
        }
        let gathered = rig.gatherer.gathered();
        assert_eq!(gathered.hint, Hint::Enough, "{gathered:?} {hints:?}");
        assert!(hints.contains(&Hint::Tilt), "{hints:?}");
        assert!(gathered.pairs >= ENOUGH_PAIRS && gathered.tilted * 3 >= gathered.pairs, "{gathered:?}");
        assert!(gathered.coverage.iter().all(|share| *share >= ENOUGH_COVERAGE), "{gathered:?}");
    }
}
