//! A flight as one picture: its path from above and from the side over the truth, and its errors with three standard
//! deviations, velocity and biases over time, as SVG or PNG.
//!
//! A [`PlotSubject`] is what is shown, made of a trajectory or of a table of states, with the truth beside it where it is
//! known; [`write()`] draws it. The `panels` say which curves there are, the `figure` where they stand, and the `raster`
//! turns them into pixels; an SVG is drawn by the same code. The letters are Roboto (Apache-2.0), in the binary.
//! [`write_lenses`] draws the cameras of a calibration in the same way.

mod axes;
mod caption;
mod figure;
mod lenses;
mod log_log;
mod panels;
mod raster;
mod subject;

pub use caption::Caption;
pub use lenses::LensFigure;
pub use log_log::{LogCurve, LogFigure, LogPanel};
pub use subject::{PlotSubject, TruthAlignment};

use crate::picture::{PictureError, RgbImage};
use plotters::prelude::{DrawingBackend, IntoDrawingArea, SVGBackend};
use plotters::style::{FontStyle, register_font};
use raster::{FINENESS, Raster};
use std::path::{Path, PathBuf};
use thiserror::Error;

/// Size of a figure unless another is asked for, px.
pub const SIZE_PX: (u32, u32) = (1200, 900);
/// The smallest and largest side of a figure, px.
pub const SIDES_PX: std::ops::RangeInclusive<u32> = 400..=8000;

/// The letters: a viewer of the SVG takes the first of these that it has.
const FONT: &str = "Roboto, Arial, sans-serif";
const REGULAR: &[u8] = include_bytes!("../../assets/fonts/Roboto-Regular.subset.ttf");
const MEDIUM: &[u8] = include_bytes!("../../assets/fonts/Roboto-Medium.subset.ttf");

/// Why a figure is not on disk.
#[derive(Debug, Error)]
pub enum PlotError {
    /// The ending of the file says neither SVG nor PNG.
    #[error("{}: unknown kind of picture; end the name in .svg or .png", path.display())]
    UnknownKind {
        /// The file.
        path: PathBuf,
    },
    /// The file cannot be created or written.
    #[error("{}: {source}; choose another place to write to", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// Error of the system.
        source: std::io::Error,
    },
    /// The PNG cannot be written.
    #[error(transparent)]
    Png(#[from] PictureError),
    /// The plotting library refused.
    #[error("the figure cannot be drawn: {0}")]
    Drawing(String),
}

/// Format of a figure.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Svg,
    Png,
}

impl Kind {
    fn of(path: &Path) -> Result<Self, PlotError> {
        let ending = path.extension().map(|e| e.to_ascii_lowercase());
        match ending.as_ref().and_then(|e| e.to_str()) {
            Some("svg") => Ok(Self::Svg),
            Some("png") => Ok(Self::Png),
            _ => Err(PlotError::UnknownKind { path: path.into() }),
        }
    }
}

/// Accepts a file name that a figure can be written to.
///
/// # Errors
/// When its ending is neither `.svg` nor `.png`.
pub fn check_name(path: &Path) -> Result<(), PlotError> {
    Kind::of(path).map(|_| ())
}

/// Draws `subject` and writes it to `path`, whose ending says what it is.
///
/// # Errors
/// When the ending is unknown, or the file cannot be written.
pub fn write(subject: &PlotSubject, path: &Path, size_px: (u32, u32)) -> Result<(), PlotError> {
    write_drawing(&Drawing::Flight(subject), path, size_px)
}

/// Draws the cameras of a calibration below a title and a line of words, and writes the figure to `path`, whose ending says
/// what it is.
///
/// # Errors
/// When the ending is unknown, or the file cannot be written.
pub fn write_lenses(cameras: &[LensFigure], words: (&str, &str), path: &Path) -> Result<(), PlotError> {
    write_drawing(&Drawing::Lenses(cameras, words), path, lenses::size_px(cameras))
}

/// Draws panels of curves on logarithmic axes, and writes the figure to `path`, whose ending says what it is.
///
/// # Errors
/// When the ending is unknown, or the file cannot be written.
pub fn write_log_log(figure: &LogFigure, path: &Path) -> Result<(), PlotError> {
    write_drawing(&Drawing::LogLog(figure), path, SIZE_PX)
}

/// Contents of a figure.
enum Drawing<'a> {
    Flight(&'a PlotSubject),
    LogLog(&'a LogFigure),
    Lenses(&'a [LensFigure], (&'a str, &'a str)),
}

fn write_drawing(drawing: &Drawing<'_>, path: &Path, size_px: (u32, u32)) -> Result<(), PlotError> {
    match Kind::of(path)? {
        Kind::Svg => {
            let text = svg(drawing, size_px)?;
            std::fs::write(path, text).map_err(|source| PlotError::Io { path: path.into(), source })
        }
        Kind::Png => Ok(png(drawing, size_px)?.write_png(path)?),
    }
}

fn png(drawing: &Drawing<'_>, (width, height): (u32, u32)) -> Result<RgbImage, PlotError> {
    let mut picture = RgbImage::new(width as usize, height as usize, [255; 3]);
    draw(drawing, Raster::on(&mut picture))?;
    Ok(picture)
}

/// The figure as SVG: drawn on the fine surface, and shown in pixels.
fn svg(drawing: &Drawing<'_>, (width, height): (u32, u32)) -> Result<String, PlotError> {
    let mut text = String::new();
    let fine = (width * FINENESS as u32, height * FINENESS as u32);
    draw(drawing, SVGBackend::with_string(&mut text, fine))?;
    let size_of = |(width, height): (u32, u32)| format!("width=\"{width}\" height=\"{height}\"");
    let head = format!("{} stroke-linejoin=\"round\" stroke-linecap=\"round\"", size_of((width, height)));
    Ok(text.replacen(&size_of(fine), &head, 1))
}

/// Makes the letters known to the plotting library.
fn register_letters() -> Result<(), ()> {
    let all = [(FontStyle::Normal, REGULAR), (FontStyle::Bold, MEDIUM)];
    all.into_iter().try_for_each(|(style, letters)| register_font(FONT, style, letters).map_err(|_| ()))
}

fn draw<B: DrawingBackend>(drawing: &Drawing<'_>, backend: B) -> Result<(), PlotError> {
    register_letters().map_err(|()| PlotError::Drawing("its letters are damaged".into()))?;
    let area = backend.into_drawing_area();
    match drawing {
        Drawing::Flight(subject) => figure::draw(subject, &area),
        Drawing::LogLog(figure) => figure.draw(&area),
        Drawing::Lenses(cameras, words) => lenses::draw(cameras, *words, &area),
    }
    .map_err(|e| PlotError::Drawing(e.to_string()))?;
    area.present().map_err(|e| PlotError::Drawing(e.to_string()))
}
