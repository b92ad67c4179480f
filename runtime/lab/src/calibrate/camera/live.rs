//! Pairs of live cameras, gathered while somebody moves the board before them.
//!
//! A thread reads the cameras at their pace, and leaves the newest frame; this one looks for the board in it, which takes
//! longer than a frame does. What is kept is written at once, so that nothing is lost when the calibration then fails.

use super::adjust::{Corner, Sight};
use super::detect;
use super::detector::{Detector, Fault};
use super::gather::{Gathered, Gatherer, Hint};
use super::images::{self, ImagesError};
use super::lens::LensKind;
use super::target::Target;
use super::{MIN_VIEWS, Pair};
use plumbline_config::ImageView;
use plumbline_drivers::{DriverError, StereoFrame, StereoSource, StopFlag};
use std::path::{Path, PathBuf};
use std::sync::{Condvar, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Longest time between progress reports.
const TELL: Duration = Duration::from_millis(200);

/// Why nothing was gathered.
#[derive(Debug, thiserror::Error)]
pub enum LiveError {
    /// The cameras broke off.
    #[error(transparent)]
    Driver(#[from] DriverError),
    /// The detector failed.
    #[error("cam{camera}: the detector failed ({fault})")]
    Detector {
        /// The camera.
        camera: usize,
        /// Its words.
        fault: Fault,
    },
    /// Gathered images cannot be kept.
    #[error(transparent)]
    Images(#[from] ImagesError),
    /// The reader's thread panicked.
    #[error("the thread that reads the cameras panicked")]
    Panicked,
    /// The user, or the time, ended it too early.
    #[error(
        "{kept} pairs of {looks} were kept, in {}, and at least {MIN_VIEWS} are needed; the board {target} must be in view and \
         almost still, at a different place each time (is --target that board?)", folder.display()
    )]
    TooFew {
        /// Pairs that were kept.
        kept: usize,
        /// Frames that were looked at.
        looks: u64,
        /// The board.
        target: Target,
        /// Where the pairs are.
        folder: PathBuf,
    },
}

/// Plan of the gathering.
#[derive(Clone, Copy, Debug)]
pub struct BoardCapture<'a> {
    /// The board.
    pub target: &'a Target,
    /// Lenses of the cameras.
    pub kind: LensKind,
    /// The eyes.
    pub detector: &'a Detector,
    /// Sizes of the images of one camera, or of two, px. Of one the right image is passed over.
    pub sizes_px: &'a [(usize, usize)],
    /// Pairs that are kept, at most.
    pub most: usize,
    /// Where they are kept, as [`images::make_folder`] made it.
    pub folder: &'a Path,
    /// When it ends in any case.
    pub end: Option<Instant>,
}

/// Gathers pairs from `source`, whose frames fit into `frame`, until there is enough, the time is over, or `stop`, which
/// the source was given, is set; in any case it is set then. `tell` hears how far it is.
///
/// # Errors
/// When the cameras, the detector or the disk fail, or too few pairs were kept.
pub fn gather(
    source: Box<dyn StereoSource>,
    frame: StereoFrame,
    gathering: &BoardCapture<'_>,
    stop: &StopFlag,
    tell: &mut dyn FnMut(&Gathered),
) -> Result<Vec<Pair>, LiveError> {
    let (newest, spare) = (Newest::default(), frame.clone());
    let (pairs, looks) = std::thread::scope(|threads| {
        let reader = threads.spawn(|| {
            let ended = read(source, frame, &newest);
            newest.end();
            ended
        });
        let gathered = look(&newest, spare, gathering, stop, tell);
        stop.stop();
        reader.join().map_err(|_| LiveError::Panicked)??;
        gathered
    })?;
    if pairs.len() < MIN_VIEWS {
        let (target, folder) = (*gathering.target, gathering.folder.to_owned());
        return Err(LiveError::TooFew { kept: pairs.len(), looks, target, folder });
    }
    Ok(pairs)
}

fn read(
    mut source: Box<dyn StereoSource>,
    mut frame: StereoFrame,
    newest: &Newest,
) -> Result<(), DriverError> {
    while source.next_frame(&mut frame)? {
        newest.put(&mut frame);
    }
    Ok(())
}

/// Looks at frames; the pairs that were kept, and how many were looked at.
fn look(
    newest: &Newest,
    mut frame: StereoFrame,
    gathering: &BoardCapture<'_>,
    stop: &StopFlag,
    tell: &mut dyn FnMut(&Gathered),
) -> Result<(Vec<Pair>, u64), LiveError> {
    let mut gatherer = Gatherer::new(gathering.target, gathering.kind, gathering.sizes_px);
    let (mut eyes, mut pairs) = (Eyes { gathering, border: None }, Vec::new());
    loop {
        let came = newest.take(&mut frame, TELL);
        if came == Came::Frame {
            let sight = eyes.sight(&frame)?;
            if gatherer.look(frame.stamp, &sight) {
                let image = |camera: usize| eyes.has(&frame, camera).then(|| frame.images[camera].clone());
                let pair = Pair { name: format!("{:04}", pairs.len() + 1), images: [image(0), image(1)] };
                images::write(gathering.folder, &pair)?;
                pairs.push(pair);
            }
        }
        let gathered = gatherer.gathered();
        tell(&gathered);
        let is_over = stop.is_stopped() || gathering.end.is_some_and(|end| Instant::now() >= end);
        let is_enough = gathered.hint == Hint::Enough || pairs.len() >= gathering.most;
        if is_over || is_enough || came == Came::End {
            return Ok((pairs, gathered.looks));
        }
    }
}

/// Finds the board in frames.
struct Eyes<'a> {
    gathering: &'a BoardCapture<'a>,
    /// The width of the border of its markers, once some were found.
    border: Option<i32>,
}

impl Eyes<'_> {
    fn has(&self, frame: &StereoFrame, camera: usize) -> bool {
        camera < self.gathering.sizes_px.len() && frame.valid[camera]
    }

    fn sight(&mut self, frame: &StereoFrame) -> Result<Sight, LiveError> {
        let mut sight = [Vec::new(), Vec::new()];
        for (camera, seen) in sight.iter_mut().enumerate() {
            if self.has(frame, camera) {
                let found = self.corners(&frame.images[camera].view());
                *seen = found.map_err(|fault| LiveError::Detector { camera, fault })?;
            }
        }
        Ok(sight)
    }

    fn corners(&mut self, image: &ImageView<'_>) -> Result<Vec<Corner>, Fault> {
        let BoardCapture { target, detector, .. } = *self.gathering;
        if let Target::Chessboard { columns, rows, .. } = *target {
            return Ok(detect::chessboard(detector, [columns, rows], image)?.corners);
        }
        for border in detect::borders(target).iter().filter(|b| self.border.is_none_or(|known| known == **b))
        {
            let found = detect::markers(detector, target, *border, image)?;
            let layout = detect::layout_of(target, std::slice::from_ref(&found));
            let corners = detect::by_markers(target, layout, &found).corners;
            if !corners.is_empty() {
                self.border = Some(*border);
                return Ok(corners);
            }
        }
        Ok(Vec::new())
    }
}

/// The newest frame of a thread for another: an older one that nobody took is written over.
#[derive(Default)]
struct Newest {
    held: Mutex<Held>,
    changed: Condvar,
}

#[derive(Default)]
struct Held {
    frame: Option<StereoFrame>,
    is_fresh: bool,
    is_over: bool,
}

/// Outcome of a wait.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Came {
    Frame,
    Nothing,
    End,
}

impl Newest {
    /// Takes the frame, and leaves other buffers in its place.
    fn put(&self, frame: &mut StereoFrame) {
        let mut held = self.held.lock().unwrap_or_else(PoisonError::into_inner);
        let place = held.frame.get_or_insert_with(|| frame.clone());
        std::mem::swap(place, frame);
        held.is_fresh = true;
        self.changed.notify_one();
    }

    fn end(&self) {
        self.held.lock().unwrap_or_else(PoisonError::into_inner).is_over = true;
        self.changed.notify_one();
    }

    /// Waits for a frame that was not taken yet.
    fn take(&self, frame: &mut StereoFrame, patience: Duration) -> Came {
        let held = self.held.lock().unwrap_or_else(PoisonError::into_inner);
        let waits = |held: &mut Held| !held.is_fresh && !held.is_over;
        let woken = self.changed.wait_timeout_while(held, patience, waits);
        let (mut held, _) = woken.unwrap_or_else(PoisonError::into_inner);
        if std::mem::take(&mut held.is_fresh)
            && let Some(newest) = &mut held.frame
        {
            std::mem::swap(newest, frame);
            return Came::Frame;
        }
        if held.is_over { Came::End } else { Came::Nothing }
    }
}
