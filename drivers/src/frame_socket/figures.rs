//! Figures of the sending program, for other threads.

use crate::board::Board;
use crate::clock::StampProblem;
use plumbline_protocol::frame_header::FrameRefusal;
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Counts of the frames and connections of the socket.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct SocketFigures {
    /// Number of connections accepted.
    pub connected: u64,
    /// Number of connections lost.
    pub lost: u64,
    /// Number of connections closed because the bytes were no frame of this rig.
    pub refused: u64,
    /// Frames that were handed out.
    #[serde(skip)]
    pub frames: u64,
    /// Frames handed out with two images.
    #[serde(skip)]
    pub pairs: u64,
    /// Frames with a stamp that is not after that of the frame before; not handed out.
    pub disordered: u64,
    /// Frames stamped by their arrival, since their stamp was of no clock of this computer, or of the future.
    pub restamped: u64,
    /// Defect of the stamps, if any.
    #[serde(skip)]
    pub problem: Option<StampProblem>,
}

/// Reason why no frames arrive. The caller formats it: the thread that reads allocates nothing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Trouble {
    /// No program has connected.
    Nobody,
    /// The program went away between frames.
    Gone,
    /// It went away, or stopped, within a frame.
    GoneWithin,
    /// It was silent while another waited.
    Silent,
    /// It waits, and the system refuses its connection with this error.
    NotAccepted(i32),
    /// It was sent away.
    Refused(FrameRefusal),
}

/// Shows the figures of a [`SocketStereo`](super::SocketStereo) to other threads. Copies show the same.
#[derive(Clone, Debug)]
pub struct SocketMonitor {
    path: Arc<PathBuf>,
    rig_px: [(usize, usize); 2],
    figures: Board<SocketFigures>,
    trouble: Board<Option<Trouble>>,
}

impl SocketMonitor {
    /// Creates the monitor of the socket at `path`, for images of these sizes, px.
    pub(super) fn new(path: &Path, rig_px: [(usize, usize); 2]) -> Self {
        Self {
            path: Arc::new(path.to_owned()),
            rig_px,
            figures: Board::default(),
            trouble: Board::new(Some(Trouble::Nobody)),
        }
    }

    /// The figures up to the last frame.
    pub fn figures(&self) -> SocketFigures {
        self.figures.read()
    }

    /// Reason why no program sends; `None` while one does.
    pub fn trouble(&self) -> Option<String> {
        let trouble = self.trouble.read()?;
        let words = match trouble {
            Trouble::Nobody => "no program sends frames yet".to_owned(),
            Trouble::Gone => "the program that sent frames has disconnected".to_owned(),
            Trouble::GoneWithin => "the program that sent frames disconnected within a frame".to_owned(),
            Trouble::Silent => {
                "the program that sent frames was silent and was replaced by another".to_owned()
            }
            Trouble::NotAccepted(error) => format!(
                "a program waits and cannot be accepted ({}); retrying: close what else is open, or raise LimitNOFILE",
                std::io::Error::from_raw_os_error(error)
            ),
            Trouble::Refused(FrameRefusal::Foreign) => {
                "what was sent is no frame: see docs/own-sensors.md".to_owned()
            }
            Trouble::Refused(FrameRefusal::Empty) => "a frame without images was sent".to_owned(),
            Trouble::Refused(FrameRefusal::Size(camera, (width, height))) => {
                let (rig_width, rig_height) = self.rig_px[camera];
                format!(
                    "an image of {width} x {height} px was sent, and camera[{camera}] has {rig_width} x \
                     {rig_height}: send that size, or change the calibration"
                )
            }
        };
        Some(format!("{}: {words} (driver.frames.listen)", self.path.display()))
    }

    /// Shows these from now on; where somebody is reading at the moment, the next ones.
    pub(super) fn show(&self, figures: &SocketFigures) {
        self.figures.show(|| *figures);
    }

    pub(super) fn set_trouble(&self, trouble: Option<Trouble>) {
        self.trouble.change(|shown| *shown = trouble);
    }
}
