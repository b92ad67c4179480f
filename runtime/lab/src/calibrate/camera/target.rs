//! Boards that are held before the cameras: how they are named, and where their corners are.
//!
//! Coordinates are in metres in the plane of the board. Those of an AprilGrid are Kalibr's: x right, y up from the lower
//! left corner of tag 0. Those of the others are OpenCV's: x right, y down from the upper left corner.

use nalgebra::Vector2;
use std::fmt;
use std::ops::RangeInclusive;
use std::str::FromStr;

/// Codes of markers that OpenCV knows, in the order of its numbers.
pub const DICTIONARIES: [&str; 21] = [
    "4X4_50",
    "4X4_100",
    "4X4_250",
    "4X4_1000",
    "5X5_50",
    "5X5_100",
    "5X5_250",
    "5X5_1000",
    "6X6_50",
    "6X6_100",
    "6X6_250",
    "6X6_1000",
    "7X7_50",
    "7X7_100",
    "7X7_250",
    "7X7_1000",
    "ARUCO_ORIGINAL",
    "APRILTAG_16H5",
    "APRILTAG_25H9",
    "APRILTAG_36H10",
    "APRILTAG_36H11",
];
/// The code of AprilGrids.
const APRILTAG_36H11: usize = 20;
/// The code of ChArUco boards unless another is named: that of OpenCV's tutorial.
const DEFAULT_DICTIONARY: usize = 10;
/// Where Kalibr's [lower left, lower right, upper right, upper left] stand among OpenCV's corners of a tag 36h11.
const KALIBR_ORDER: [usize; 4] = [1, 0, 3, 2];

/// Columns or rows of a board.
const COUNT: RangeInclusive<usize> = 2..=40;
/// Tags that the code of AprilGrids has.
const MOST_TAGS: usize = 587;
/// Sides of squares and tags, m.
const SIDE_M: RangeInclusive<f64> = 0.001..=2.0;
/// The gap between the tags of an AprilGrid, in sides of a tag.
const SPACING: RangeInclusive<f64> = 0.05..=2.0;

/// A board.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Target {
    /// Black and white squares.
    Chessboard {
        /// Inner corners in a row.
        columns: usize,
        /// Inner corners in a column.
        rows: usize,
        /// Side of a square, m.
        square_m: f64,
    },
    /// A chessboard with a marker in every white square.
    Charuco {
        /// Squares in a row.
        columns: usize,
        /// Squares in a column.
        rows: usize,
        /// Side of a square, m.
        square_m: f64,
        /// Side of a marker with its black border, m.
        marker_m: f64,
        /// Index in [`DICTIONARIES`].
        dictionary: usize,
    },
    /// Kalibr's grid of AprilTags 36h11, joined by small black squares.
    AprilGrid {
        /// Tags in a row.
        columns: usize,
        /// Tags in a column.
        rows: usize,
        /// Side of a tag with its black border, m.
        tag_m: f64,
        /// Gap between tags, in sides of a tag.
        spacing: f64,
    },
}

/// Where the first white square of a ChArUco board with an even number of rows is. OpenCV changed it in version 4.6.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CharucoLayout {
    /// The upper left square is black.
    BlackFirst,
    /// It is white, and holds the first marker.
    WhiteFirst,
}

/// Why a text names no board.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct TargetError(String);

impl Target {
    /// The corners that are measured, by their numbers, m.
    pub fn corners_m(&self) -> Vec<Vector2<f64>> {
        match *self {
            Self::Chessboard { columns, rows, square_m } => grid(columns, rows, square_m, 0.0),
            Self::Charuco { columns, rows, square_m, .. } => grid(columns - 1, rows - 1, square_m, square_m),
            Self::AprilGrid { columns, rows, tag_m, spacing } => {
                let pitch = tag_m * (1.0 + spacing);
                let around = [(0.0, 0.0), (tag_m, 0.0), (tag_m, tag_m), (0.0, tag_m)];
                grid(columns, rows, pitch, 0.0)
                    .iter()
                    .flat_map(|p| around.map(|(x, y)| p + Vector2::new(x, y)))
                    .collect()
            }
        }
    }

    /// The code of its markers as OpenCV counts them; `None` for a chessboard.
    pub fn dictionary(&self) -> Option<i32> {
        match *self {
            Self::Chessboard { .. } => None,
            Self::Charuco { dictionary, .. } => i32::try_from(dictionary).ok(),
            Self::AprilGrid { .. } => i32::try_from(APRILTAG_36H11).ok(),
        }
    }

    /// Number of its markers.
    pub fn marker_count(&self) -> usize {
        match *self {
            Self::Chessboard { .. } => 0,
            Self::Charuco { columns, rows, .. } => columns * rows / 2,
            Self::AprilGrid { columns, rows, .. } => columns * rows,
        }
    }

    /// The corners of a marker in the order in which OpenCV finds them, m; `None` of a number that the board does not have.
    pub fn marker_corners_m(&self, number: u32, layout: CharucoLayout) -> Option<[Vector2<f64>; 4]> {
        let number = usize::try_from(number).ok().filter(|number| *number < self.marker_count())?;
        match *self {
            Self::Chessboard { .. } => None,
            Self::Charuco { columns, square_m, marker_m, .. } => {
                let (column, row) = white_square(number, columns, layout);
                let gap_m = 0.5 * (square_m - marker_m);
                let first = Vector2::new(column as f64, row as f64) * square_m + Vector2::repeat(gap_m);
                let clockwise = [(0.0, 0.0), (marker_m, 0.0), (marker_m, marker_m), (0.0, marker_m)];
                Some(clockwise.map(|(x, y)| first + Vector2::new(x, y)))
            }
            Self::AprilGrid { .. } => {
                let corners = self.corners_m();
                // The order is its own inverse.
                Some(KALIBR_ORDER.map(|k| corners[4 * number + k]))
            }
        }
    }

    /// The numbers of the corners that are those of a marker of an AprilGrid, in the order in which OpenCV finds them.
    pub fn numbers_of_tag(&self, number: u32) -> Option<[usize; 4]> {
        let number = usize::try_from(number).ok().filter(|number| *number < self.marker_count())?;
        matches!(self, Self::AprilGrid { .. }).then(|| KALIBR_ORDER.map(|k| 4 * number + k))
    }

    /// Orders of the corners of a chessboard that look alike: the board as it is, and turned.
    pub fn turns(&self) -> Vec<Vec<usize>> {
        let count = self.corners_m().len();
        let as_it_is: Vec<usize> = (0..count).collect();
        let Self::Chessboard { columns, rows, .. } = *self else { return vec![as_it_is] };
        let half: Vec<usize> = (0..count).rev().collect();
        if columns != rows {
            return vec![as_it_is, half];
        }
        let quarter: Vec<usize> =
            (0..count).map(|k| (k % columns) * columns + (columns - 1 - k / columns)).collect();
        let three_quarters = quarter.iter().rev().copied().collect();
        vec![as_it_is, quarter, half, three_quarters]
    }
}

/// Column and row of the white square that holds a marker.
fn white_square(number: usize, columns: usize, layout: CharucoLayout) -> (usize, usize) {
    let first_white = usize::from(layout == CharucoLayout::BlackFirst);
    let mut left = number;
    for row in 0.. {
        let start = (first_white + row) % 2;
        let in_row = (columns - start).div_ceil(2);
        if left < in_row {
            return (start + 2 * left, row);
        }
        left -= in_row;
    }
    unreachable!("every board has a row for each marker")
}

fn grid(columns: usize, rows: usize, pitch_m: f64, first_m: f64) -> Vec<Vector2<f64>> {
    let at = |k: usize| first_m + pitch_m * k as f64;
    (0..rows).flat_map(|row| (0..columns).map(move |column| Vector2::new(at(column), at(row)))).collect()
}

impl FromStr for Target {
    type Err = TargetError;

    fn from_str(text: &str) -> Result<Self, TargetError> {
        let mut fields = text.split(':');
        let kind = fields.next().unwrap_or_default();
        let fields: Vec<&str> = fields.collect();
        match (kind, fields.as_slice()) {
            ("chessboard", [size, square]) => {
                let (columns, rows) = counts(size)?;
                Ok(Self::Chessboard { columns, rows, square_m: side("SIZE", square)? })
            }
            ("charuco", [size, square, marker, dictionary @ ..]) if dictionary.len() < 2 => {
                charuco(counts(size)?, (side("SQUARE", square)?, side("MARKER", marker)?), dictionary.first())
            }
            ("aprilgrid", [size, tag, spacing]) => aprilgrid(counts(size)?, side("TAG", tag)?, spacing),
            _ => Err(TargetError(format!(
                "'{text}' is not a board: write chessboard:COLSxROWS:SIZE, charuco:COLSxROWS:SQUARE:MARKER[:DICT] or \
                 aprilgrid:COLSxROWS:TAG:SPACING, lengths in metres, such as aprilgrid:6x6:0.088:0.3"
            ))),
        }
    }
}

fn charuco(
    (columns, rows): (usize, usize),
    (square_m, marker_m): (f64, f64),
    name: Option<&&str>,
) -> Result<Target, TargetError> {
    if marker_m >= square_m {
        let message =
            format!("MARKER {marker_m} m does not fit into SQUARE {square_m} m; give the square first");
        return Err(TargetError(message));
    }
    let plain = |name: &str| name.to_ascii_uppercase().trim_start_matches("DICT_").to_owned();
    let index = match name {
        None => Some(DEFAULT_DICTIONARY),
        Some(name) => DICTIONARIES.iter().position(|known| *known == plain(name)),
    };
    let known =
        || format!("DICT '{}' is not known; choose one of {}", name.unwrap_or(&""), DICTIONARIES.join(", "));
    Ok(Target::Charuco {
        columns,
        rows,
        square_m,
        marker_m,
        dictionary: index.ok_or_else(|| TargetError(known()))?,
    })
}

fn aprilgrid((columns, rows): (usize, usize), tag_m: f64, spacing: &str) -> Result<Target, TargetError> {
    if columns * rows > MOST_TAGS {
        return Err(TargetError(format!(
            "{columns}x{rows} are more than the {MOST_TAGS} tags that 36h11 has"
        )));
    }
    let ratio = spacing.parse().ok().filter(|ratio| SPACING.contains(ratio));
    let spacing = ratio.ok_or_else(|| {
        let (low, high) = (SPACING.start(), SPACING.end());
        TargetError(format!(
            "SPACING '{spacing}' is not a number from {low} to {high}; it is the gap between tags divided by the side of a tag"
        ))
    })?;
    Ok(Target::AprilGrid { columns, rows, tag_m, spacing })
}

fn counts(text: &str) -> Result<(usize, usize), TargetError> {
    let count = |text: &str| text.parse().ok().filter(|count| COUNT.contains(count));
    let counts = text.split_once('x').and_then(|(columns, rows)| Some((count(columns)?, count(rows)?)));
    let (low, high) = (COUNT.start(), COUNT.end());
    counts.ok_or_else(|| {
        TargetError(format!("'{text}' is not a size: write COLSxROWS, each {low} to {high}, such as 6x6"))
    })
}

fn side(name: &str, text: &str) -> Result<f64, TargetError> {
    let side = text.parse().ok().filter(|side| SIDE_M.contains(side));
    side.ok_or_else(|| {
        let (low, high) = (SIDE_M.start(), SIDE_M.end());
        TargetError(format!(
            "{name} '{text}' is not a length from {low} to {high}; measure it with a ruler and write it in metres"
        ))
    })
}

impl fmt::Display for Target {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Chessboard { columns, rows, square_m } => {
                write!(f, "chessboard:{columns}x{rows}:{square_m}")
            }
            Self::Charuco { columns, rows, square_m, marker_m, dictionary } => {
                write!(f, "charuco:{columns}x{rows}:{square_m}:{marker_m}:{}", DICTIONARIES[dictionary])
            }
            Self::AprilGrid { columns, rows, tag_m, spacing } => {
                write!(f, "aprilgrid:{columns}x{rows}:{tag_m}:{spacing}")
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn boards_are_written_as_they_are_read() {
        for text in ["chessboard:9x6:0.025", "charuco:8x5:0.04:0.03:5X5_100", "aprilgrid:6x6:0.088:0.3"] {
            assert_eq!(text.parse::<Target>().unwrap().to_string(), text);
        }
        let named = "charuco:8x5:0.04:0.03:dict_apriltag_36h11".parse::<Target>().unwrap();
        assert_eq!(named.dictionary(), Some(20));
        assert_eq!("charuco:8x5:0.04:0.03".parse::<Target>().unwrap().dictionary(), Some(10));
    }

    #[test]
    fn what_is_no_board_is_refused_with_the_cure() {
        for (text, cure) in [
            ("", "aprilgrid:6x6:0.088:0.3"),
            ("aprilgrid:6x6:0.088", "aprilgrid:COLSxROWS:TAG:SPACING"),
            ("aprilgrid:6:0.088:0.3", "COLSxROWS"),
            ("aprilgrid:40x40:0.088:0.3", "587"),
            ("aprilgrid:6x6:88:0.3", "in metres"),
            ("aprilgrid:6x6:0.088:26.4", "divided by"),
            ("chessboard:1x6:0.02", "2 to 40"),
            ("chessboard:9x6:NaN", "in metres"),
            ("charuco:8x5:0.03:0.04", "square first"),
            ("charuco:8x5:0.04:0.03:8X8", "6X6_250"),
        ] {
            let refusal = text.parse::<Target>().unwrap_err().to_string();
            assert!(refusal.contains(cure) && !refusal.contains('\n'), "{text}: {refusal}");
        }
    }

    #[test]
    fn corners_of_an_aprilgrid_are_those_of_kalibr() {
        let target: Target = "aprilgrid:6x6:0.088:0.3".parse().unwrap();
        let corners = target.corners_m();
        assert_eq!(corners.len(), 144);
        // Of tag 7, the second of the second row: lower left, and upper right.
        let pitch = 0.088 * 1.3;
        assert!((corners[28] - Vector2::new(pitch, pitch)).norm() < 1e-12);
        assert!((corners[30] - Vector2::new(pitch + 0.088, pitch + 0.088)).norm() < 1e-12);
        let found = target.marker_corners_m(7, CharucoLayout::BlackFirst).unwrap();
        assert_eq!(found.map(|p| corners.iter().position(|q| *q == p).unwrap()), [29, 28, 31, 30]);
        assert_eq!(target.numbers_of_tag(7), Some([29, 28, 31, 30]));
        assert_eq!(target.numbers_of_tag(36), None);
    }

    #[test]
    fn markers_of_a_charuco_board_lie_in_its_white_squares() {
        let target: Target = "charuco:5x4:0.1:0.08".parse().unwrap();
        assert_eq!((target.corners_m().len(), target.marker_count()), (12, 10));
        let square = |number, layout| {
            let first: Vector2<f64> = target.marker_corners_m(number, layout).unwrap()[0];
            ((first.x / 0.1) as usize, (first.y / 0.1) as usize)
        };
        let black_first: Vec<_> = (0..5).map(|n| square(n, CharucoLayout::BlackFirst)).collect();
        assert_eq!(black_first, [(1, 0), (3, 0), (0, 1), (2, 1), (4, 1)]);
        let white_first: Vec<_> = (0..5).map(|n| square(n, CharucoLayout::WhiteFirst)).collect();
        assert_eq!(white_first, [(0, 0), (2, 0), (4, 0), (1, 1), (3, 1)]);
        assert_eq!(target.marker_corners_m(10, CharucoLayout::BlackFirst), None);
    }

    #[test]
    fn a_turned_chessboard_has_each_corner_once_and_the_same_neighbours() {
        for text in ["chessboard:4x3:0.1", "chessboard:3x3:0.1"] {
            let target: Target = text.parse().unwrap();
            let corners = target.corners_m();
            let turns = target.turns();
            assert_eq!(turns.len(), if text.contains("3x3") { 4 } else { 2 });
            for turn in turns {
                let mut sorted = turn.clone();
                sorted.sort_unstable();
                assert_eq!(sorted, (0..corners.len()).collect::<Vec<_>>());
                for k in 0..corners.len() {
                    let distance = |a: usize, b: usize| (corners[a] - corners[b]).norm();
                    assert!((distance(k, 0) - distance(turn[k], turn[0])).abs() < 1e-12, "{text}: {turn:?}");
                }
            }
        }
    }
}
