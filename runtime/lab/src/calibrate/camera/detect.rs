//! The first look at an image: which corners of the board are in it, and roughly where.

use super::adjust::Corner;
use super::detector::{Detector, Fault, Marker};
use super::plane::{homography, transfer};
use super::target::{CharucoLayout, Target};
use nalgebra::Vector2;
use plumbline_config::ImageView;

/// Widths of the black border of a tag, in bits: Kalibr's grids have two, plain AprilTags one.
pub const KALIBR_BORDER: i32 = 2;
const PLAIN_BORDER: i32 = 1;
/// Fewest tags of an AprilGrid, and corners of a ChArUco board, for an image to count.
const MIN_TAGS: usize = 4;
const MIN_CHARUCO_CORNERS: usize = 8;
/// Points around a corner of a ChArUco board that are looked at for its neighbourhood: those of two markers.
const NEAR_MARKERS: usize = 2;

/// The corners of a marker.
type Four = [Vector2<f64>; 4];

/// Finds in an image at first sight.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FirstSight {
    /// Corners of the board, by their numbers.
    pub corners: Vec<Corner>,
    /// Markers of the right code whose number the board does not have.
    pub strangers: Vec<u32>,
    /// Markers of the board.
    pub markers: usize,
}

/// The markers in an image.
///
/// # Errors
/// When the detector fails.
pub fn markers(
    detector: &Detector,
    target: &Target,
    border_bits: i32,
    image: &ImageView<'_>,
) -> Result<Vec<Marker>, Fault> {
    let Some(dictionary) = target.dictionary() else { return Ok(Vec::new()) };
    (detector.markers)(image, dictionary, border_bits)
}

/// Widths of borders that a board's markers may have, the usual one first.
pub fn borders(target: &Target) -> &'static [i32] {
    match target {
        Target::Chessboard { .. } => &[],
        Target::Charuco { .. } => &[PLAIN_BORDER],
        Target::AprilGrid { .. } => &[KALIBR_BORDER, PLAIN_BORDER],
    }
}

/// The corners of a chessboard in an image; none unless all are in sight.
///
/// # Errors
/// When the detector fails.
pub fn chessboard(
    detector: &Detector,
    [columns, rows]: [usize; 2],
    image: &ImageView<'_>,
) -> Result<FirstSight, Fault> {
    let found = (detector.chessboard)(image, [columns, rows])?.unwrap_or_default();
    let corners = found.into_iter().enumerate().map(|(number, px)| Corner { number, px }).collect();
    Ok(FirstSight { corners, ..FirstSight::default() })
}

/// The corners of a board that the markers in an image tell; none of too few.
pub fn by_markers(target: &Target, layout: CharucoLayout, markers: &[Marker]) -> FirstSight {
    let of_board = |marker: &&Marker| usize::try_from(marker.0).is_ok_and(|n| n < target.marker_count());
    let known: Vec<&Marker> = markers.iter().filter(of_board).collect();
    let strangers = markers.iter().filter(|marker| !of_board(marker)).map(|marker| marker.0).collect();
    let corners = match target {
        Target::AprilGrid { .. } if known.len() >= MIN_TAGS => tag_corners(target, &known),
        Target::Charuco { .. } => charuco_corners(target, layout, &known),
        _ => Vec::new(),
    };
    FirstSight { corners, strangers, markers: known.len() }
}

fn tag_corners(target: &Target, markers: &[&Marker]) -> Vec<Corner> {
    let mut corners: Vec<Corner> = markers
        .iter()
        .filter_map(|(number, px)| Some(target.numbers_of_tag(*number)?.into_iter().zip(*px)))
        .flatten()
        .map(|(number, px)| Corner { number, px })
        .collect();
    corners.sort_by_key(|corner| corner.number);
    // Of a tag that was found twice neither is believed.
    let count = |number: usize| corners.iter().filter(|corner| corner.number == number).count();
    let once: Vec<bool> = corners.iter().map(|corner| count(corner.number) == 1).collect();
    corners.into_iter().zip(once).filter(|(_, once)| *once).map(|(corner, _)| corner).collect()
}

/// Inner corners of the chessboard from the markers around each: by the homography of the nearest two, which are so near
/// that the lens hardly bends what is between them.
fn charuco_corners(target: &Target, layout: CharucoLayout, markers: &[&Marker]) -> Vec<Corner> {
    let Target::Charuco { square_m, .. } = *target else { return Vec::new() };
    let known: Vec<(Four, Four)> = markers
        .iter()
        .filter_map(|(number, px)| Some((target.marker_corners_m(*number, layout)?, *px)))
        .collect();
    let corner = |(number, point): (usize, Vector2<f64>)| {
        let centre = |m: &Four| (m[0] + m[2]) * 0.5;
        let mut near: Vec<_> = known.iter().filter(|(m, _)| (centre(m) - point).norm() < square_m).collect();
        near.truncate(NEAR_MARKERS);
        let pairs: Vec<_> =
            near.iter().flat_map(|(m, px)| m.iter().copied().zip(px.iter().copied())).collect();
        Some(Corner { number, px: transfer(&homography(&pairs)?, &point)? })
    };
    let corners: Vec<Corner> = target.corners_m().into_iter().enumerate().filter_map(corner).collect();
    if corners.len() < MIN_CHARUCO_CORNERS { Vec::new() } else { corners }
}

/// Print of a ChArUco board: the layout under which its markers lie in a plane.
pub fn layout_of(target: &Target, images: &[Vec<Marker>]) -> CharucoLayout {
    let Target::Charuco { rows, .. } = *target else { return CharucoLayout::BlackFirst };
    if !rows.is_multiple_of(2) {
        return CharucoLayout::BlackFirst;
    }
    let misfit = |layout| -> f64 { images.iter().filter_map(|image| misfit_px(target, layout, image)).sum() };
    if misfit(CharucoLayout::WhiteFirst) < misfit(CharucoLayout::BlackFirst) {
        CharucoLayout::WhiteFirst
    } else {
        CharucoLayout::BlackFirst
    }
}

/// The mean distance of the markers' corners from where one homography of all takes them, px.
fn misfit_px(target: &Target, layout: CharucoLayout, markers: &[Marker]) -> Option<f64> {
    let pairs: Vec<_> = markers
        .iter()
        .filter_map(|(number, px)| Some(target.marker_corners_m(*number, layout)?.into_iter().zip(*px)))
        .flatten()
        .collect();
    let h = homography(&pairs).filter(|_| pairs.len() > 4)?;
    let distances = pairs.iter().map(|(point, px)| Some((transfer(&h, point)? - px).norm()));
    Some(distances.sum::<Option<f64>>()? / pairs.len() as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Markers of a board seen squarely, 500 px a metre, some of them left out.
    fn seen(target: &Target, layout: CharucoLayout, numbers: impl Iterator<Item = u32>) -> Vec<Marker> {
        let px = |p: Vector2<f64>| p * 500.0 + Vector2::new(20.0, 30.0);
        numbers.filter_map(|n| Some((n, target.marker_corners_m(n, layout)?.map(px)))).collect()
    }

    #[test]
    fn a_charuco_board_is_found_from_some_of_its_markers_in_either_layout() {
        let target: Target = "charuco:7x6:0.1:0.07".parse().unwrap();
        for layout in [CharucoLayout::BlackFirst, CharucoLayout::WhiteFirst] {
            let markers = seen(&target, layout, (0..21).filter(|n| n % 5 != 0));
            assert_eq!(layout_of(&target, std::slice::from_ref(&markers)), layout);
            let sight = by_markers(&target, layout, &markers);
            assert!(sight.corners.len() > 20 && sight.markers == markers.len(), "{}", sight.corners.len());
            for corner in &sight.corners {
                let expected = target.corners_m()[corner.number] * 500.0 + Vector2::new(20.0, 30.0);
                assert!((corner.px - expected).norm() < 1e-6, "{layout:?} {}", corner.number);
            }
        }
    }

    #[test]
    fn strangers_and_tags_seen_twice_are_not_taken_for_the_board() {
        let target: Target = "aprilgrid:3x3:0.1:0.3".parse().unwrap();
        let mut markers = seen(&target, CharucoLayout::BlackFirst, 0..9);
        markers.push((40, [Vector2::zeros(); 4]));
        let sight = by_markers(&target, CharucoLayout::BlackFirst, &markers);
        assert_eq!((sight.corners.len(), sight.strangers, sight.markers), (36, vec![40], 9));
        markers.push(markers[2]);
        assert_eq!(by_markers(&target, CharucoLayout::BlackFirst, &markers).corners.len(), 32);
        assert_eq!(by_markers(&target, CharucoLayout::BlackFirst, &markers[..3]).corners, []);
    }
}
