//! Calibration of one or two cameras by images of a board: intrinsics, the pose between the cameras, and how well both are
//! known.
//!
//! The way of the data: [`images`] lists files, or a [`recording`] is read; a `detector` (OpenCV, in the crate `plumbline-boards`)
//! finds what is in them, `detect` makes corners of the board ([`target`]) of that, `initial` guesses cameras and poses, `adjust` fits them,
//! `second_look` finds the corners that the first sight missed. Three rounds of the last two, and [`result`] sums up.
//!
//! The adjustment is ours and not OpenCV's `calibrateCamera` and `stereoCalibrate`, which tests compare it with: it fits both
//! cameras at once, by all views of either, for both lens models, and it tells the covariance of all of it.

mod adjust;
mod detect;
pub mod detector;
pub mod images;
mod initial;
pub mod lens;
pub mod output;
mod plane;
pub mod recording;
pub mod result;
mod second_look;
pub mod table;
pub mod target;

pub use adjust::{Cameras, Corner, Sight};
pub use detector::Detector;
pub use images::{Images, ImagesError};
pub use lens::LENSES;
pub use result::Calibration;
pub use target::{Target, TargetError};

use adjust::{Adjusted, adjust};
use detect::FirstSight;
use detector::{Fault, Marker};
use nalgebra::{Isometry3, Vector2};
use plumbline_config::GrayImage;
use plumbline_config::camera::Distortion;

/// Rounds of second look and adjustment.
const ROUNDS: usize = 3;
/// Fewest views of a camera.
pub const MIN_VIEWS: usize = 5;
/// At first sight corners are found to half a pixel. Where they lie further off on the whole, the board is another one.
const MOST_MISFIT_PX: f64 = 2.5;
/// Corners that lie further off than so many medians are dropped, if it is more than so many pixels too: after the first
/// adjustment what is wrong, after the last, twice, what is blurred. Of normal errors one in 500 is beyond three medians; of
/// the real images of the tests one corner in 40 is, and the RMS falls from 0.29 to 0.25 px without them.
const FIRST_TRIM: Trim = Trim { medians: 6.0, px: 1.0 };
const LAST_TRIM: Trim = Trim { medians: 3.0, px: 0.0 };
const LAST_TRIMS: usize = 2;

/// Largest offset of a corner.
#[derive(Clone, Copy, Debug)]
struct Trim {
    medians: f64,
    px: f64,
}

/// Images that both cameras took at one time.
#[derive(Clone, Debug)]
pub struct Pair {
    /// Name in tables.
    pub name: String,
    /// The image of the left and of the right camera; `None` where there is none.
    pub images: [Option<GrayImage>; 2],
}

/// Why there is no calibration, and the cure.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct CalibrateError(String);

impl CalibrateError {
    fn undetermined() -> Self {
        Self(
            "the views do not determine the cameras; add views with the board tilted by 30 to 45 degrees about both axes, near and \
             far"
                .into(),
        )
    }

    fn of_detector(camera: usize, pair: &Pair, fault: &Fault) -> Self {
        Self(format!("cam{camera}/{}: the detector failed ({fault})", pair.name))
    }
}

/// Calibrates the cameras that took `pairs`, from the distortion of `lens` on; `seen` hears of every image that was looked at.
///
/// # Errors
/// When the board is not seen often enough, or does not fit what is seen.
pub fn calibrate(
    pairs: &[Pair],
    target: &Target,
    lens: Distortion,
    detector: &Detector,
    seen: &mut dyn FnMut(),
) -> Result<Calibration, CalibrateError> {
    let sizes = sizes(pairs)?;
    let mut sights = first_sights(pairs, target, detector, seen)?;
    let points = target.corners_m();
    turn_alike(target, &mut sights);
    let (cameras, mut poses) = start(target, &points, lens, &sizes, &sights)?;
    let fit = Fit { points: &points, target: *target };
    let mut cameras = fit.trimmed(&mut sights, &cameras, &mut poses, FIRST_TRIM)?;
    for _ in 0..ROUNDS {
        second_sights(pairs, target, detector, &cameras, &poses, &mut sights)?;
        cameras = fit.adjusted(&sights, &cameras, &mut poses)?.cameras;
    }
    for _ in 0..LAST_TRIMS {
        cameras = fit.trimmed(&mut sights, &cameras, &mut poses, LAST_TRIM)?;
    }
    let last = fit.adjusted(&sights, &cameras, &mut poses)?;
    let (used, kept) = used(&sights, &poses);
    let covariance = adjust::covariance(&points, &kept, &last).ok_or_else(CalibrateError::undetermined)?;
    let names = used.iter().map(|k| pairs[*k].name.clone()).collect();
    let unused =
        pairs.iter().enumerate().filter(|(k, _)| !used.contains(k)).map(|(_, p)| p.name.clone()).collect();
    Ok(Calibration::sum_up(target, &points, &kept, &last, &covariance, (names, unused)))
}

/// The size of the images of each camera, px: of one camera, or of two.
fn sizes(pairs: &[Pair]) -> Result<Vec<(usize, usize)>, CalibrateError> {
    let mut sizes = Vec::new();
    for camera in 0..2 {
        let images = pairs.iter().filter_map(|p| Some((&p.name, p.images[camera].as_ref()?)));
        let mut images = images.map(|(name, image)| (name, (image.width(), image.height())));
        let Some((_, expected)) = images.next() else { continue };
        if let Some((image, found)) = images.find(|(_, size)| *size != expected) {
            let [(wide, high), (others_wide, others_high)] = [found, expected];
            return Err(CalibrateError(format!(
                "{image}: is {wide}x{high} px where others of cam{camera} are {others_wide}x{others_high}; take all images at one \
                 size"
            )));
        }
        sizes.push(expected);
    }
    Ok(sizes)
}

/// Sight of the board in every image, at first.
fn first_sights(
    pairs: &[Pair],
    target: &Target,
    detector: &Detector,
    seen: &mut dyn FnMut(),
) -> Result<Vec<Sight>, CalibrateError> {
    let found = if let Target::Chessboard { columns, rows, .. } = *target {
        each_image(pairs, |image| detect::chessboard(detector, [columns, rows], &image.view()), seen)?
    } else {
        by_markers(pairs, target, detector, seen)?
    };
    for camera in 0..2 {
        check_views(pairs, target, camera, &found)?;
    }
    Ok(found.into_iter().map(|sights| sights.map(|sight| sight.unwrap_or_default().corners)).collect())
}

/// Something of every image.
fn each_image<T>(
    pairs: &[Pair],
    mut look: impl FnMut(&GrayImage) -> Result<T, Fault>,
    seen: &mut dyn FnMut(),
) -> Result<Vec<[Option<T>; 2]>, CalibrateError> {
    let mut all = Vec::with_capacity(pairs.len());
    for pair in pairs {
        let mut both = [None, None];
        for (camera, image) in pair.images.iter().enumerate() {
            let Some(image) = image else { continue };
            let failed = |fault| CalibrateError::of_detector(camera, pair, &fault);
            both[camera] = Some(look(image).map_err(failed)?);
            seen();
        }
        all.push(both);
    }
    Ok(all)
}

fn by_markers(
    pairs: &[Pair],
    target: &Target,
    detector: &Detector,
    seen: &mut dyn FnMut(),
) -> Result<Vec<[Option<FirstSight>; 2]>, CalibrateError> {
    let mut markers: Vec<[Option<Vec<Marker>>; 2]> = Vec::new();
    for border in detect::borders(target) {
        let look = |image: &GrayImage| detect::markers(detector, target, *border, &image.view());
        markers = each_image(pairs, look, seen)?;
        if markers.iter().flatten().flatten().any(|found| !found.is_empty()) {
            break;
        }
    }
    let all: Vec<Vec<Marker>> = markers.iter().flatten().flatten().cloned().collect();
    let layout = detect::layout_of(target, &all);
    let sight = |found: Vec<Marker>| detect::by_markers(target, layout, &found);
    Ok(markers.into_iter().map(|both| both.map(|found| found.map(sight))).collect())
}

/// Accepts a camera that sees the board often enough, and one that has no image, which is not there.
fn check_views(
    pairs: &[Pair],
    target: &Target,
    camera: usize,
    found: &[[Option<FirstSight>; 2]],
) -> Result<(), CalibrateError> {
    let images = pairs.iter().filter(|pair| pair.images[camera].is_some()).count();
    let sights = || found.iter().filter_map(|both| both[camera].as_ref());
    let views = sights().filter(|sight| !sight.corners.is_empty()).count();
    let strange = sights().filter(|sight| !sight.strangers.is_empty()).count();
    if (views >= MIN_VIEWS && 2 * strange < views) || images == 0 {
        return Ok(());
    }
    if views > 0 && 2 * strange < views {
        return Err(CalibrateError(format!(
            "cam{camera}: the board {target} is in {views} of {images} images; at least {MIN_VIEWS} are needed, 20 to 40 are good"
        )));
    }
    let strangers = sights().flat_map(|sight| &sight.strangers).max();
    let most = sights().map(|sight| sight.markers).max().unwrap_or(0);
    let hint = match strangers {
        Some(number) => format!("a marker {number} was seen, which is not on it; check COLSxROWS"),
        None => format!(
            "at most {most} of its markers were seen; check --target, hold it still, near and evenly lit"
        ),
    };
    Err(CalibrateError(format!("cam{camera}: no board {target} in {images} images; {hint}")))
}

/// Gives the corners of chessboards in the right images the order of those in the left ones: a board that looks the same
/// when turned is taken to be turned least between the two.
fn turn_alike(target: &Target, sights: &mut [Sight]) {
    let turns = target.turns();
    if turns.len() < 2 {
        return;
    }
    for [left, right] in sights.iter_mut().filter(|[left, right]| left.len() == right.len()) {
        let about_mean = |corners: &[Corner]| -> Vec<Vector2<f64>> {
            let mean = corners.iter().map(|c| c.px).sum::<Vector2<f64>>() / corners.len().max(1) as f64;
            corners.iter().map(|c| c.px - mean).collect()
        };
        let (a, b) = (about_mean(left), about_mean(right));
        if a.len() != turns[0].len() {
            continue;
        }
        let distance =
            |turn: &Vec<usize>| (0..a.len()).map(|k| (a[k] - b[turn[k]]).norm_squared()).sum::<f64>();
        if let Some(turn) = turns.iter().min_by(|s, t| distance(s).total_cmp(&distance(t))) {
            *right = (0..a.len()).map(|number| Corner { number, px: right[turn[number]].px }).collect();
        }
    }
}

/// Cameras and poses to begin with, each camera adjusted by itself.
fn start(
    target: &Target,
    points: &[Vector2<f64>],
    lens: Distortion,
    sizes: &[(usize, usize)],
    sights: &[Sight],
) -> Result<(Cameras, Poses), CalibrateError> {
    let mut models = Vec::new();
    for (camera, size) in sizes.iter().enumerate() {
        let views: Vec<&[Corner]> =
            sights.iter().map(|s| s[camera].as_slice()).filter(|v| !v.is_empty()).collect();
        let guess =
            initial::first_guess(lens, *size, points, &views).ok_or_else(CalibrateError::undetermined)?;
        let alone: Vec<Sight> = views.iter().map(|view| [view.to_vec(), Vec::new()]).collect();
        let mut poses: Vec<_> = views.iter().map(|view| initial::pose(&guess, points, view)).collect();
        let fit = Fit { points, target: *target };
        models.push(fit.adjusted(&alone, &Cameras::single(guess), &mut poses)?.cameras.models[0]);
    }
    let pose = |camera: usize, sight: &Sight| {
        models.get(camera).and_then(|model| initial::pose(model, points, &sight[camera]))
    };
    let both: Vec<_> = sights.iter().filter_map(|s| Some((pose(0, s)?, pose(1, s)?))).collect();
    let between = initial::pose_between(&both);
    if models.len() == 2 && between.is_none() {
        let reason = "both cameras never see the board at the same time; hold it where both see it, or give --mono to use the left \
                      one only";
        return Err(CalibrateError(reason.into()));
    }
    let pose_c1_c0 = between.unwrap_or_else(Isometry3::identity);
    let from_right = |sight: &Sight| Some(pose_c1_c0.inverse() * pose(1, sight)?);
    let poses = sights.iter().map(|sight| pose(0, sight).or_else(|| from_right(sight))).collect();
    Ok((Cameras { models, pose_c1_c0 }, poses))
}

/// Used views, and their sights.
fn used(sights: &[Sight], poses: &[Option<Isometry3<f64>>]) -> (Vec<usize>, Vec<Sight>) {
    let sees = |k: &usize| poses[*k].is_some() && sights[*k].iter().any(|corners| !corners.is_empty());
    let used: Vec<usize> = (0..sights.len()).filter(sees).collect();
    let kept = used.iter().map(|k| sights[*k].clone()).collect();
    (used, kept)
}

/// The pose `T_C0T` of the board in each view, where it is known.
type Poses = Vec<Option<Isometry3<f64>>>;

/// Adjustments of the views that have a pose.
#[derive(Clone, Copy)]
struct Fit<'a> {
    points: &'a [Vector2<f64>],
    target: Target,
}

impl Fit<'_> {
    /// Adjusts cameras and poses to what is seen.
    fn adjusted(
        &self,
        sights: &[Sight],
        cameras: &Cameras,
        poses: &mut [Option<Isometry3<f64>>],
    ) -> Result<Adjusted, CalibrateError> {
        let (used, kept) = used(sights, poses);
        let start: Vec<Isometry3<f64>> = used.iter().filter_map(|k| poses[*k]).collect();
        let adjusted =
            adjust(self.points, &kept, cameras, &start).ok_or_else(CalibrateError::undetermined)?;
        for (k, pose) in used.into_iter().zip(&adjusted.poses_c0_t) {
            poses[k] = Some(*pose);
        }
        Ok(adjusted)
    }

    /// Adjusts, refuses a board that does not fit, drops corners that lie far off, and adjusts again.
    fn trimmed(
        &self,
        sights: &mut [Sight],
        cameras: &Cameras,
        poses: &mut [Option<Isometry3<f64>>],
        trim: Trim,
    ) -> Result<Cameras, CalibrateError> {
        let cameras = self.adjusted(sights, cameras, poses)?.cameras;
        let mut errors: Vec<f64> = Vec::new();
        for (sight, pose) in sights.iter().zip(poses.iter()) {
            let Some(pose) = pose else { continue };
            for (camera, corners) in sight.iter().enumerate() {
                errors.extend(corners.iter().map(|corner| self.error_px(&cameras, camera, pose, corner)));
            }
        }
        errors.sort_by(f64::total_cmp);
        let median = errors.get(errors.len() / 2).copied().unwrap_or(f64::INFINITY);
        if median.is_nan() || median > MOST_MISFIT_PX {
            return Err(CalibrateError(format!(
                "the corners are {median:.1} px from those of {}; check the numbers of --target and that the board is flat; for a \
                 fisheye lens give --lens equidistant",
                self.target
            )));
        }
        let limit = trim.px.max(trim.medians * median);
        for (sight, pose) in sights.iter_mut().zip(poses.iter()) {
            let Some(pose) = pose else { continue };
            for (camera, corners) in sight.iter_mut().enumerate() {
                corners.retain(|corner| self.error_px(&cameras, camera, pose, corner) <= limit);
            }
        }
        Ok(self.adjusted(sights, &cameras, poses)?.cameras)
    }

    fn error_px(&self, cameras: &Cameras, camera: usize, pose: &Isometry3<f64>, corner: &Corner) -> f64 {
        let p_c = cameras.seen_from(camera, pose, &self.points[corner.number]);
        lens::project(&cameras.models[camera], &p_c).map_or(f64::INFINITY, |at| (at.px - corner.px).norm())
    }
}

/// Looks at all images again, for every corner that should be in them.
fn second_sights(
    pairs: &[Pair],
    target: &Target,
    detector: &Detector,
    cameras: &Cameras,
    poses: &[Option<Isometry3<f64>>],
    sights: &mut [Sight],
) -> Result<(), CalibrateError> {
    let fewest = (target.corners_m().len() / 4).clamp(6, 16);
    for ((pair, pose), sight) in pairs.iter().zip(poses).zip(sights) {
        let Some(pose) = pose else { continue };
        for (camera, image) in pair.images.iter().enumerate().take(cameras.models.len()) {
            let Some(image) = image else { continue };
            let failed = |fault| CalibrateError::of_detector(camera, pair, &fault);
            let corners =
                second_look::look(detector, target, &image.view(), cameras, camera, pose).map_err(failed)?;
            sight[camera] = if corners.len() < fewest { Vec::new() } else { corners };
        }
    }
    Ok(())
}
