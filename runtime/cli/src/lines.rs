//! `plumbline lines`: the line segments of one image, as a table, a picture and a list.

mod panels;

use super::{Usage, check_outputs, load_config, say};
use anyhow::{Context, Result};
use clap::{Args, ValueEnum};
use plumbline_config::options::LinesConfig;
use plumbline_config::{Config, GrayImage, ValidConfig};
use plumbline_drivers::euroc::read_gray_png;
use plumbline_estimator::lines::{LineExtractor, Segment};
use plumbline_flight::flight::with_overrides;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Sides of the images that are taken, px.
const MIN_SIDE_PX: usize = 64;
const MAX_SIDE_PX: usize = 4096;
/// Number of extractions whose median time is reported: the first one has cold caches.
const TIMED_RUNS: usize = 5;

/// Arguments of `plumbline lines`.
#[derive(Debug, Args)]
pub struct LinesArgs {
    /// Image: a PNG of 64x64 to 4096x4096 pixels, grey or colour, 8 or 16 bits.
    pub image: PathBuf,
    /// Write a picture of the segments (PNG): raw, kept and merged side by side.
    #[arg(long, value_name = "OUT.png")]
    pub out: Option<PathBuf>,
    /// Draw only this layer, at the size of the image.
    #[arg(long, value_enum, requires = "out")]
    pub layer: Option<Layer>,
    /// Write the segments of all layers (CSV), in pixels. Viewed from x1,y1 towards x2,y2, the brighter side is on
    /// the right.
    #[arg(long, value_name = "OUT.csv")]
    pub csv: Option<PathBuf>,
    /// Configuration file or preset whose [estimator.lines] is used. Default: the preset `euroc`.
    #[arg(long)]
    pub config: Option<PathBuf>,
    /// Change a key of the configuration, such as estimator.lines.min_gradient=8; may be repeated.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub overrides: Vec<String>,
}

/// The stages of the extraction.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Layer {
    /// Segments before filtering.
    Raw,
    /// Segments after the length filter.
    Kept,
    /// Segments after merging, which the estimator uses.
    Merged,
}

impl Layer {
    /// All of them, in the order of the extraction.
    pub const ALL: [Self; 3] = [Self::Raw, Self::Kept, Self::Merged];

    /// Name in tables, captions and arguments.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Raw => "raw",
            Self::Kept => "kept",
            Self::Merged => "merged",
        }
    }

    fn of(self, extractor: &LineExtractor) -> &[Segment] {
        match self {
            Self::Raw => extractor.raw(),
            Self::Kept => extractor.kept(),
            Self::Merged => extractor.segments(),
        }
    }
}

/// Runs the command.
///
/// # Errors
/// When the image cannot be read, or a file cannot be written.
pub fn run(args: &LinesArgs) -> Result<()> {
    let config = checked(args)?;
    let image = read_gray_png(&args.image, MIN_SIDE_PX..=MAX_SIDE_PX)?;
    let options = &config.estimator.lines;
    let mut extractor = LineExtractor::new(image.width(), image.height(), options);
    let median_ms = extract(&mut extractor, &image);
    if let Some(path) = &args.out {
        let picture = match args.layer {
            Some(layer) => panels::panel(&image.view(), layer, layer.of(&extractor)),
            None => panels::side_by_side(&image.view(), Layer::ALL.map(|l| (l, l.of(&extractor)))),
        };
        picture.write_png(path)?;
    }
    if let Some(path) = &args.csv {
        std::fs::write(path, csv(&extractor)).with_context(|| format!("{}", path.display()))?;
    }
    say(table(&extractor, options, median_ms));
    Ok(())
}

/// The configuration, once it is known that the outputs can be written and overwrite nothing that is read.
fn checked(args: &LinesArgs) -> Result<ValidConfig> {
    let outputs = || [&args.out, &args.csv].into_iter().flatten();
    check_outputs(outputs())?;
    if let Some(file) = outputs().find(|file| is_same(file, &args.image)) {
        let message = format!("{}: is the image itself; name another file to write", file.display());
        return Err(Usage(message).into());
    }
    if args.out.is_some() && args.out == args.csv {
        return Err(Usage("--out and --csv name the same file; name two files".into()).into());
    }
    let config = match load_config(args.config.as_deref())? {
        Some(config) => config,
        None => Config::preset("euroc")?,
    };
    Ok(with_overrides(&config, &args.overrides)?)
}

fn is_same(a: &Path, b: &Path) -> bool {
    matches!((a.canonicalize(), b.canonicalize()), (Ok(a), Ok(b)) if a == b)
}

/// Extracts several times, with the same outcome, and tells the median time, ms.
fn extract(extractor: &mut LineExtractor, image: &GrayImage) -> f64 {
    let mut times_ms = [0.0; TIMED_RUNS];
    for time_ms in &mut times_ms {
        let start = Instant::now();
        let _ = extractor.extract(&image.view());
        *time_ms = start.elapsed().as_secs_f64() * 1e3;
    }
    times_ms.sort_by(f64::total_cmp);
    times_ms[TIMED_RUNS / 2]
}

fn table(extractor: &LineExtractor, options: &LinesConfig, median_ms: f64) -> String {
    let mut text =
        format!("{:8}{:>10}{:>19}{:>18}\n", "layer", "segments", "total length [px]", "mean length [px]");
    for layer in Layer::ALL {
        let segments = layer.of(extractor);
        // From 0: the sum of none is -0.
        let total = segments.iter().fold(0.0, |sum, s| sum + f64::from(s.length()));
        let mean = total / segments.len().max(1) as f64;
        let _ = writeln!(text, "{:8}{:>10}{total:>19.1}{mean:>18.1}", layer.name(), segments.len());
    }
    let (figures, budget) = (extractor.figures(), options.max_visits);
    let percent = 100.0 * f64::from(figures.visits) / budget.max(1) as f64;
    let _ = write!(text, "{} visits, {percent:.0} % of the budget of {budget}", figures.visits);
    if figures.is_cut_short {
        let limit = if extractor.raw().len() >= options.max_raw { "max_raw" } else { "max_visits" };
        let _ = write!(text, ", cut short by estimator.lines.{limit}: the weakest edges were left out");
    }
    let _ = write!(text, "; {median_ms:.2} ms, median of {TIMED_RUNS}");
    text
}

fn csv(extractor: &LineExtractor) -> String {
    let mut text = String::from("layer,x1,y1,x2,y2,strength\n");
    for layer in Layer::ALL {
        for Segment { start, end, strength, .. } in layer.of(extractor) {
            let (a, b, name) = (start, end, layer.name());
            let _ = writeln!(text, "{name},{:.3},{:.3},{:.3},{:.3},{strength:.3}", a.x, a.y, b.x, b.y);
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Extractor after an image with one bright square.
    fn extractor() -> LineExtractor {
        let pixels = (0..128 * 128)
            .map(|i| if (30..98).contains(&(i % 128)) && (30..98).contains(&(i / 128)) { 200 } else { 40 });
        let image = GrayImage::from_pixels(128, 128, pixels.collect()).unwrap();
        let mut extractor = LineExtractor::new(128, 128, &LinesConfig::default());
        extract(&mut extractor, &image);
        extractor
    }

    #[test]
    fn the_table_and_the_list_tell_every_segment() {
        let extractor = extractor();
        let table = table(&extractor, &LinesConfig::default(), 1.234);
        assert_eq!(table.lines().count(), 5);
        assert!(table.contains("merged           4") && table.contains("1.23 ms"), "{table}");
        let rows = Layer::ALL.map(|l| l.of(&extractor).len()).iter().sum::<usize>();
        assert_eq!(csv(&extractor).lines().count(), rows + 1);
        let without =
            super::table(&LineExtractor::new(64, 64, &LinesConfig::default()), &LinesConfig::default(), 1.0);
        assert!(!without.contains("-0"), "{without}");
        assert!(csv(&extractor).lines().all(|line| line.split(',').count() == 6));
    }
}
