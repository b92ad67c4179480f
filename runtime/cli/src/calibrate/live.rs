//! `plumbline calibrate camera live`: pairs of the cameras of a configuration, gathered while somebody moves the board.

use crate::{Usage, load_config, say, stop_on_signal};
use anyhow::{Context as _, Result};
use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};
use plumbline_drivers::{CameraMonitor, StereoFrame, StopFlag};
use plumbline_flight::flight::open_cameras_alone;
use plumbline_lab::calibrate::camera::gather::Gathered;
use plumbline_lab::calibrate::camera::images::make_folder;
use plumbline_lab::calibrate::camera::live::{BoardCapture, gather};
use plumbline_lab::calibrate::camera::{Detector, LensKind, Pair, Target};
use std::io::IsTerminal as _;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Longest time that may be asked for, s.
const MOST_S: f64 = 86_400.0;

/// Arguments for live cameras alone.
#[derive(Debug, Args)]
pub(super) struct LiveArgs {
    /// With `live`: configuration with the devices of the cameras and all other values.
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// With `live`: stop after S seconds at the latest. Ctrl-C stops too; in both cases the pairs kept so far are used.
    #[arg(long, value_name = "S")]
    pub duration: Option<f64>,
    /// With `live`: folder for the images, for a later calibration. Default: beside OUT.
    #[arg(long, value_name = "FOLDER")]
    pub images: Option<PathBuf>,
}

/// Request to a calibration of any images.
pub(super) struct Wanted<'a> {
    pub target: &'a Target,
    pub kind: LensKind,
    pub detector: &'a Detector,
    pub mono: bool,
    pub most: usize,
}

/// Refuses these arguments of what is not live.
pub(super) fn check_absent(args: &LiveArgs) -> Result<(), Usage> {
    let given = [
        ("--config", args.config.is_some()),
        ("--duration", args.duration.is_some()),
        ("--images", args.images.is_some()),
    ];
    match given.iter().find(|(_, is_given)| *is_given) {
        Some((name, _)) => Err(Usage(format!("{name}: is for live cameras; give `live` as the SOURCE"))),
        None => Ok(()),
    }
}

/// Refuses what makes no sense, before a camera is opened; the configuration will be written to `out`.
pub(super) fn check(args: &LiveArgs, out: &Path, overwrite: bool) -> Result<(), Usage> {
    if args.config.is_none() {
        return Err(Usage("live: give the configuration of the cameras with --config FILE".into()));
    }
    if args.duration.is_some_and(|s| !(s > 0.0 && s <= MOST_S)) {
        return Err(Usage("--duration: give a positive number of seconds, such as 120".into()));
    }
    let folder = folder(args, out);
    let is_used = ["cam0", "cam1"].iter().any(|camera| folder.join(camera).exists());
    if is_used && !overwrite {
        let message = format!(
            "{}: holds images; name another folder with --images, or give --overwrite",
            folder.display()
        );
        return Err(Usage(message));
    }
    Ok(())
}

/// Where the pairs are kept.
fn folder(args: &LiveArgs, out: &Path) -> PathBuf {
    let beside = || {
        let stem = out.file_stem().unwrap_or_default().to_string_lossy();
        out.with_file_name(format!("{stem}-images"))
    };
    args.images.clone().unwrap_or_else(beside)
}

/// Gathers pairs, and says where they are; `check` has been passed.
pub(super) fn pairs(args: &LiveArgs, out: &Path, wanted: &Wanted<'_>) -> Result<(Vec<Pair>, String)> {
    let named = args.config.as_deref().context("a configuration was named")?;
    let config = load_config(Some(named))?.context("a configuration was named")?;
    let stop = StopFlag::of(stop_on_signal()?);
    let cameras = open_cameras_alone(&config, &stop).with_context(|| named.display().to_string())?;
    let folder = folder(args, out);
    let sizes_px: Vec<_> = config.camera.iter().map(|c| (c.width_px, c.height_px)).collect();
    let used = if wanted.mono { 1 } else { sizes_px.len() };
    make_folder(&folder, used, true)?;
    let gathering = BoardCapture {
        target: wanted.target,
        kind: wanted.kind,
        detector: wanted.detector,
        sizes_px: &sizes_px[..used],
        most: wanted.most,
        folder: &folder,
        end: args.duration.map(|s| Instant::now() + Duration::from_secs_f64(s)),
    };
    let size = |camera: usize| sizes_px.get(camera).copied().unwrap_or((0, 0));
    let mut teller = Teller::new(cameras.monitor, used);
    let pairs =
        gather(cameras.source, StereoFrame::new([size(0), size(1)]), &gathering, &stop, &mut |gathered| {
            teller.tell(gathered)
        });
    teller.bar.finish_and_clear();
    let pairs = pairs?;
    say(format_args!("{} pairs are in {}", pairs.len(), folder.display()));
    Ok((pairs, folder.display().to_string()))
}

/// Tells how far it is: on a terminal in a line that changes, else in a line for each pair that is kept.
struct Teller {
    bar: ProgressBar,
    monitor: CameraMonitor,
    cameras: usize,
    told: usize,
    is_terminal: bool,
}

impl Teller {
    fn new(monitor: CameraMonitor, cameras: usize) -> Self {
        let bar = ProgressBar::new_spinner();
        let style = ProgressStyle::with_template("{spinner} {elapsed}  {msg}");
        bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_spinner()));
        let is_terminal = std::io::stderr().is_terminal();
        Self { bar, monitor, cameras, told: 0, is_terminal }
    }

    fn tell(&mut self, gathered: &Gathered) {
        if self.is_terminal {
            self.bar.set_message(self.words(gathered));
            self.bar.tick();
        } else if gathered.pairs > self.told {
            self.told = gathered.pairs;
            say(words(gathered, self.cameras));
        }
    }

    /// Cameras that bring nothing come first.
    fn words(&self, gathered: &Gathered) -> String {
        let troubles = self.monitor.trouble();
        let trouble = troubles.into_iter().flatten().next();
        trouble.unwrap_or_else(|| words(gathered, self.cameras))
    }
}

fn words(gathered: &Gathered, cameras: usize) -> String {
    let covered = gathered.coverage.iter().take(cameras).enumerate();
    let covered: Vec<String> =
        covered.map(|(camera, share)| format!("cam{camera} {:.0} %", 100.0 * share)).collect();
    format!(
        "{} pairs kept, {} tilted; covered: {}; {}",
        gathered.pairs,
        gathered.tilted,
        covered.join(", "),
        gathered.hint
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use plumbline_lab::calibrate::camera::gather::Hint;

    #[test]
    fn the_line_says_what_was_kept_and_what_to_do_next() {
        let gathered = Gathered {
            looks: 90,
            pairs: 12,
            shared: 11,
            tilted: 3,
            coverage: [0.64, 0.58],
            hint: Hint::MoveTo { camera: 1, part: "upper left" },
        };
        assert_eq!(
            words(&gathered, 2),
            "12 pairs kept, 3 tilted; covered: cam0 64 %, cam1 58 %; move it to the upper left of cam1"
        );
    }
}
