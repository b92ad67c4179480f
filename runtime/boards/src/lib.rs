//! Calibration boards in images, found by OpenCV: square markers, corners of chessboards, and corners to a fraction of a
//! pixel.
//!
//! A crate of its own, so that what flies has no OpenCV in it: `plumbline` depends on this with its feature `calibration`
//! alone. The functions take and give plain types, and know no board as a whole; that is `plumbline_lab::calibrate::camera`.
//! Written for OpenCV 4.6 with its contributed modules, as Debian 12 and Ubuntu 24.04 have it; `objdetect` of OpenCV 4.7 and
//! later has these functions in other places.
//!
//! Pixels are those of [`plumbline_config::camera`]: the centre of the first one is at `(0, 0)`.

use nalgebra::Vector2;
use opencv::core::{Mat, Point2f, Ptr, Size, TermCriteria, TermCriteria_Type, Vector, no_array};
use opencv::prelude::*;
use opencv::{aruco, calib3d, imgproc};
use plumbline_config::ImageView;
use std::error::Error;

/// Error of OpenCV.
pub type Fault = Box<dyn Error + Send + Sync>;

/// A marker's number, and its corners clockwise, px.
pub type Marker = (u32, [Vector2<f64>; 4]);
/// Places in an image, px.
pub type Places = Vec<Vector2<f64>>;

/// Steps of the sub-pixel search, at most, and the step at which it ends, px.
const REFINE_STEPS: i32 = 60;
const REFINE_END_PX: f64 = 1e-3;
/// Half the side of the window in which the corners of a marker are first refined, px: no larger than the gaps between
/// the tags of a small board in a small image.
const MARKER_HALF_WINDOW_PX: i32 = 3;
/// Uneven light is evened out; images without a chessboard are passed over quickly.
const CHESSBOARD_FLAGS: i32 =
    calib3d::CALIB_CB_ADAPTIVE_THRESH | calib3d::CALIB_CB_NORMALIZE_IMAGE | calib3d::CALIB_CB_FAST_CHECK;

/// Markers of the dictionary of OpenCV's number `dictionary` (`DICT_4X4_50` is 0), each with its number and its corners, px,
/// clockwise from the upper left one as OpenCV draws the marker; in the order of their numbers. `border_bits` is how wide
/// the black border is, in bits of the code.
///
/// # Errors
/// When OpenCV fails, or knows no such dictionary.
pub fn markers(image: &ImageView<'_>, dictionary: i32, border_bits: i32) -> Result<Vec<Marker>, Fault> {
    let pixels = contiguous(image);
    let pixels = mat(image, &pixels)?;
    let dictionary = aruco::get_predefined_dictionary_i32(dictionary)?;
    let mut parameters: Ptr<aruco::DetectorParameters> = aruco::DetectorParameters::create()?;
    parameters.set_corner_refinement_method(aruco::CornerRefineMethod::CORNER_REFINE_SUBPIX as i32);
    parameters.set_corner_refinement_win_size(MARKER_HALF_WINDOW_PX);
    parameters.set_marker_border_bits(border_bits);
    let (mut corners, mut numbers) = (Vector::<Vector<Point2f>>::new(), Vector::<i32>::new());
    aruco::detect_markers(&pixels, &dictionary, &mut corners, &mut numbers, &parameters, &mut no_array())?;
    let mut found: Vec<Marker> = numbers
        .iter()
        .zip(corners.iter())
        .filter_map(|(number, corners)| {
            let corners: Places = corners.iter().map(from_opencv).collect();
            Some((u32::try_from(number).ok()?, corners.try_into().ok()?))
        })
        .collect();
    found.sort_by_key(|(number, _)| *number);
    Ok(found)
}

/// The inner corners of a chessboard of `columns` x `rows` of them, px, row by row; `None` unless all are in sight. Which end
/// of the board is the first is left open where both look alike.
///
/// # Errors
/// When OpenCV fails.
pub fn chessboard(image: &ImageView<'_>, [columns, rows]: [usize; 2]) -> Result<Option<Places>, Fault> {
    let pixels = contiguous(image);
    let pixels = mat(image, &pixels)?;
    let size = Size::new(i32::try_from(columns)?, i32::try_from(rows)?);
    let mut corners = Vector::<Point2f>::new();
    let is_found = calib3d::find_chessboard_corners(&pixels, size, &mut corners, CHESSBOARD_FLAGS)?;
    let corners: Places = corners.iter().map(from_opencv).collect();
    Ok((is_found && corners.len() == columns * rows).then_some(corners))
}

/// Corners near `guesses_px` to a fraction of a pixel, px: the points whose windows' gradients are all across the line to them
/// (Förstner and Gülch 1987, in OpenCV `cornerSubPix`). The windows reach `half_window_px` to each side. A guess in whose
/// window there is no corner is given back.
///
/// # Errors
/// When OpenCV fails, as it does for a guess outside the image.
pub fn refine(
    image: &ImageView<'_>,
    guesses_px: &[Vector2<f64>],
    half_window_px: usize,
) -> Result<Places, Fault> {
    if guesses_px.is_empty() {
        return Ok(Vec::new());
    }
    let pixels = contiguous(image);
    let pixels = mat(image, &pixels)?;
    let mut corners: Vector<Point2f> =
        guesses_px.iter().map(|px| Point2f::new(px.x as f32, px.y as f32)).collect();
    let half = i32::try_from(half_window_px.max(1))?;
    let stop = TermCriteria_Type::COUNT as i32 + TermCriteria_Type::EPS as i32;
    let criteria = TermCriteria::new(stop, REFINE_STEPS, REFINE_END_PX)?;
    imgproc::corner_sub_pix(&pixels, &mut corners, Size::new(half, half), Size::new(-1, -1), criteria)?;
    Ok(corners.iter().map(from_opencv).collect())
}

/// The pixels of a marker as it is printed, black 0 and white 255, one for each bit: `side` of them to each side with a
/// border of `border_bits`, row by row.
///
/// # Errors
/// When OpenCV fails, or there is no such marker.
pub fn marker_bits(dictionary: i32, number: u32, border_bits: i32) -> Result<(usize, Vec<u8>), Fault> {
    let dictionary = aruco::get_predefined_dictionary_i32(dictionary)?;
    let side = dictionary.marker_size() + 2 * border_bits;
    let mut image = Mat::default();
    dictionary.draw_marker(i32::try_from(number)?, side, &mut image, border_bits)?;
    Ok((usize::try_from(side)?, image.data_bytes()?.to_vec()))
}

/// The pixels without padding between the rows.
fn contiguous(image: &ImageView<'_>) -> Vec<u8> {
    let mut pixels = Vec::with_capacity(image.width() * image.height());
    image.rows().for_each(|row| pixels.extend_from_slice(row));
    pixels
}

fn mat<'a>(image: &ImageView<'_>, pixels: &'a [u8]) -> opencv::Result<opencv::boxed_ref::BoxedRef<'a, Mat>> {
    Mat::new_rows_cols_with_data(image.height() as i32, image.width() as i32, pixels)
}

fn from_opencv(point: Point2f) -> Vector2<f64> {
    Vector2::new(f64::from(point.x), f64::from(point.y))
}
