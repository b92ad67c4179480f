//! Optical flow of points, ours and OpenCV's, under one roof: the same points, forward and back, over
//! pyramids that both image pairs share.

use nalgebra::{Matrix2, Vector2};
use opencv::core::{
    BORDER_CONSTANT, BORDER_REFLECT_101, Mat, Point2f, Size, TermCriteria, TermCriteria_Type, Vector,
};
use opencv::imgproc::good_features_to_track_def;
use opencv::video::{build_optical_flow_pyramid, calc_optical_flow_pyr_lk};
use plumbline_config::GrayImage;
use plumbline_estimator::image::Pyramid;
use plumbline_estimator::points::flow::{FlowOptions, track_patch};

/// Coarsest level; level 0 is the image.
const TOP_LEVEL: usize = 3;
/// Gauss-Newton steps a level, as in the defaults of the configuration.
const MAX_ITERATIONS: usize = 8;
/// Largest distance between a point and its return, px.
const MAX_RETURN_PX: f32 = 0.5;
/// Corners are no nearer to each other, px.
const MIN_DISTANCE_PX: f64 = 12.0;

/// A way to follow points from one image to another.
pub trait Flow {
    /// An image, prepared.
    type Prepared;

    /// Builds what both pairs of an image share.
    ///
    /// # Errors
    /// When OpenCV fails, as in [`Self::follow`].
    fn prepare(&mut self, image: &GrayImage) -> opencv::Result<Self::Prepared>;

    /// Places in `to` of the points of `from`, for those that come back to where they were.
    ///
    /// # Errors
    /// When OpenCV fails.
    fn follow(
        &mut self,
        from: &Self::Prepared,
        to: &Self::Prepared,
        points_px: &[Vector2<f32>],
    ) -> opencv::Result<Vec<Option<Vector2<f32>>>>;
}

/// Ours.
#[derive(Debug)]
pub struct Ours;

impl Flow for Ours {
    type Prepared = Pyramid;

    fn prepare(&mut self, image: &GrayImage) -> opencv::Result<Pyramid> {
        let mut pyramid = Pyramid::new(image.width(), image.height(), TOP_LEVEL + 1);
        pyramid.build(&image.view());
        Ok(pyramid)
    }

    fn follow(
        &mut self,
        from: &Pyramid,
        to: &Pyramid,
        points_px: &[Vector2<f32>],
    ) -> opencv::Result<Vec<Option<Vector2<f32>>>> {
        let options = FlowOptions { top_level: TOP_LEVEL, max_iterations: MAX_ITERATIONS };
        let back = FlowOptions { top_level: 0, ..options };
        let upright = Matrix2::identity();
        let follow = |px: &Vector2<f32>| {
            let there = track_patch((from, px), (to, px), &upright, &options)?;
            let again = track_patch((to, &there.px), (from, px), &upright, &back)?;
            ((again.px - px).norm() < MAX_RETURN_PX).then_some(there.px)
        };
        Ok(points_px.iter().map(follow).collect())
    }
}

/// OpenCV's, with a window of so many pixels a side.
#[derive(Debug)]
pub struct OpenCv {
    /// Side of the window, px.
    pub window_px: i32,
}

impl OpenCv {
    fn size(&self) -> Size {
        Size::new(self.window_px, self.window_px)
    }

    fn track(
        &self,
        from: &Vector<Mat>,
        to: &Vector<Mat>,
        points: &Vector<Point2f>,
        guess: Option<&Vector<Point2f>>,
    ) -> opencv::Result<(Vector<Point2f>, Vector<u8>)> {
        let mut found = guess.cloned().unwrap_or_default();
        let (mut status, mut error) = (Vector::<u8>::new(), Vector::<f32>::new());
        let stop = TermCriteria_Type::COUNT as i32 + TermCriteria_Type::EPS as i32;
        let criteria = TermCriteria::new(stop, 30, 0.01)?;
        // The way back begins where it should end, on the finest level alone: as VINS-Fusion does it.
        let (levels, flags) = if guess.is_some() { (0, 4) } else { (TOP_LEVEL as i32, 0) };
        calc_optical_flow_pyr_lk(
            from,
            to,
            points,
            &mut found,
            &mut status,
            &mut error,
            self.size(),
            levels,
            criteria,
            flags,
            1e-4,
        )?;
        Ok((found, status))
    }
}

impl Flow for OpenCv {
    type Prepared = Vector<Mat>;

    fn prepare(&mut self, image: &GrayImage) -> opencv::Result<Vector<Mat>> {
        let pixels =
            Mat::new_rows_cols_with_data(image.height() as i32, image.width() as i32, image.pixels())?;
        let mut pyramid = Vector::<Mat>::new();
        build_optical_flow_pyramid(
            &pixels,
            &mut pyramid,
            self.size(),
            TOP_LEVEL as i32,
            true,
            BORDER_REFLECT_101,
            BORDER_CONSTANT,
            false,
        )?;
        Ok(pyramid)
    }

    fn follow(
        &mut self,
        from: &Vector<Mat>,
        to: &Vector<Mat>,
        points_px: &[Vector2<f32>],
    ) -> opencv::Result<Vec<Option<Vector2<f32>>>> {
        let points: Vector<Point2f> = points_px.iter().map(|p| Point2f::new(p.x, p.y)).collect();
        let (there, found) = self.track(from, to, &points, None)?;
        let (again, returned) = self.track(to, from, &there, Some(&points))?;
        let outcome = |k: usize| {
            let (p, q) = (there.get(k).ok()?, again.get(k).ok()?);
            let is_found = found.get(k).ok()? == 1 && returned.get(k).ok()? == 1;
            let gap = (Vector2::new(q.x, q.y) - points_px[k]).norm();
            (is_found && gap < MAX_RETURN_PX).then(|| Vector2::new(p.x, p.y))
        };
        Ok((0..points_px.len()).map(outcome).collect())
    }
}

/// Up to `count` corners of an image, by OpenCV's choice, none within `border_px` of its edge.
///
/// # Errors
/// When OpenCV fails.
pub fn corners(image: &GrayImage, count: usize, border_px: f32) -> opencv::Result<Vec<Vector2<f32>>> {
    let pixels = Mat::new_rows_cols_with_data(image.height() as i32, image.width() as i32, image.pixels())?;
    let mut found = Vector::<Point2f>::new();
    good_features_to_track_def(&pixels, &mut found, 4 * count as i32, 0.01, MIN_DISTANCE_PX)?;
    let (right, bottom) = (image.width() as f32 - border_px, image.height() as f32 - border_px);
    let inside = |p: &Vector2<f32>| p.x > border_px && p.y > border_px && p.x < right && p.y < bottom;
    Ok(found.iter().map(|p| Vector2::new(p.x, p.y)).filter(inside).take(count).collect())
}
