//! Our extractor and those of OpenCV under one roof.

use super::Line;
use opencv::boxed_ref::BoxedRef;
use opencv::core::{Mat, Vec4f, Vector};
use opencv::imgproc::{
    LineSegmentDetectorModes, create_line_segment_detector, create_line_segment_detector_def,
};
use opencv::prelude::*;
use opencv::ximgproc::{create_edge_drawing, create_fast_line_detector_def};
use plumbline_config::GrayImage;
use plumbline_config::options::LinesConfig;
use plumbline_estimator::lines::LineExtractor;

type Find = Box<dyn FnMut(&GrayImage) -> opencv::Result<Vec<Line>>>;

/// A detector of line segments, set up for images of one size.
pub struct Detector {
    /// Name in tables.
    pub name: &'static str,
    find: Find,
}

impl Detector {
    /// Segments of an image.
    ///
    /// # Errors
    /// When OpenCV fails.
    pub fn detect(&mut self, image: &GrayImage) -> opencv::Result<Vec<Line>> {
        (self.find)(image)
    }

    /// Ours with `options`; an image of another size has no segments.
    pub fn ours(name: &'static str, (width, height): (usize, usize), options: &LinesConfig) -> Self {
        let mut extractor = LineExtractor::new(width, height, options);
        let find = move |image: &GrayImage| {
            let segments = extractor.extract(&image.view()).unwrap_or_default();
            Ok(segments.iter().map(Line::from).collect())
        };
        Self { name, find: Box::new(find) }
    }

    /// OpenCV's LSD at its defaults.
    ///
    /// # Errors
    /// When OpenCV fails, as all below.
    pub fn lsd() -> opencv::Result<Self> {
        let mut lsd = create_line_segment_detector_def()?;
        Ok(Self::of_opencv("OpenCV LSD", move |image, lines| lsd.detect_def(image, lines)))
    }

    /// OpenCV's LSD at half the resolution, with the parameters of PL-VINS.
    ///
    /// # Errors
    /// See [`Self::lsd`].
    pub fn lsd_half() -> opencv::Result<Self> {
        let refine = LineSegmentDetectorModes::LSD_REFINE_STD;
        let mut lsd = create_line_segment_detector(refine.into(), 0.5, 0.6, 2.0, 22.5, 1.0, 0.6, 1024)?;
        Ok(Self::of_opencv("OpenCV LSD, scale 0.5", move |image, lines| lsd.detect_def(image, lines)))
    }

    /// OpenCV's EDLines.
    ///
    /// # Errors
    /// See [`Self::lsd`].
    pub fn edge_drawing() -> opencv::Result<Self> {
        let mut drawing = create_edge_drawing()?;
        Ok(Self::of_opencv("OpenCV EdgeDrawing", move |image, lines| {
            drawing.detect_edges(image)?;
            drawing.detect_lines(lines)
        }))
    }

    /// OpenCV's FastLineDetector at its defaults.
    ///
    /// # Errors
    /// See [`Self::lsd`].
    pub fn fast_line_detector() -> opencv::Result<Self> {
        let mut detector = create_fast_line_detector_def()?;
        Ok(Self::of_opencv("OpenCV FastLineDetector", move |image, lines| detector.detect(image, lines)))
    }

    fn of_opencv(
        name: &'static str,
        mut detect: impl FnMut(&BoxedRef<'_, Mat>, &mut Vector<Vec4f>) -> opencv::Result<()> + 'static,
    ) -> Self {
        let mut lines = Vector::<Vec4f>::new();
        let find = move |image: &GrayImage| {
            let pixels =
                Mat::new_rows_cols_with_data(image.height() as i32, image.width() as i32, image.pixels())?;
            lines.clear();
            detect(&pixels, &mut lines)?;
            Ok(lines.iter().map(|line| Line::new(line.0.map(f64::from))).collect())
        };
        Self { name, find: Box::new(find) }
    }
}

/// Options that keep all segments of an image, whatever their number and length.
pub fn unfiltered() -> LinesConfig {
    let defaults = LinesConfig::default();
    LinesConfig { length_filter: false, max_segments: defaults.max_raw, ..defaults }
}
