//! Progress of a run for people: drawn by a thread of its own from what a listener leaves in a ring. The threads of the run
//! neither format nor print, and a terminal that stalls blocks none of them.

use indicatif::{ProgressBar, ProgressStyle};
use nalgebra::{Isometry3, Vector3};
use plumbline_flight::pipeline::listener::{Listener, Producer, Subscriber};
use plumbline_flight::schedule::ring::{Bell, Reader, Writer, ring};
use plumbline_record::Said;
use plumbline_record::said::FullEstimate;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// The terminal is brought up to date this often.
const REDRAW: Duration = Duration::from_millis(100);
/// The end of a run waits so long for the terminal.
const PATIENCE: Duration = Duration::from_secs(1);
/// Estimates that wait to be drawn; what finds no room is not drawn.
const RING: usize = 256;

/// Part of an estimate that is shown.
#[derive(Clone, Copy, Debug)]
pub struct Glance {
    /// Frames so far, this one included.
    pub frames: u64,
    /// True if there is a pose.
    pub has_pose: bool,
    /// Pose of the body in the odometry frame.
    pub pose_o_b: Isometry3<f64>,
    /// Velocity of the body in the odometry frame, m/s.
    pub v_o_b: Vector3<f64>,
    /// Points tracked in the frame.
    pub points: u32,
    /// Quality in percent, -1 when failed.
    pub quality: i8,
    /// Computation of the frame, ms of wall time.
    pub frame_ms: f64,
}

/// Shows a run to people.
pub struct Progress {
    writer: Option<Writer<Glance>>,
    thread: Option<JoinHandle<()>>,
}

impl Progress {
    /// Calls `show` for every estimate, on a thread of normal priority, until the run is over, and some times a second with
    /// none; then `end`.
    ///
    /// # Errors
    /// When the system refuses a thread.
    pub fn start(
        show: impl FnMut(Option<&Glance>) + Send + 'static,
        end: impl FnOnce() + Send + 'static,
    ) -> std::io::Result<Self> {
        let (writer, reader) = ring(RING, &Bell::default());
        let thread =
            std::thread::Builder::new().name("progress".into()).spawn(move || draw(reader, show, end))?;
        Ok(Self { writer: Some(writer), thread: Some(thread) })
    }

    /// A bar of the frames out of those expected.
    ///
    /// # Errors
    /// When the system refuses a thread.
    pub fn bar(expected: Option<u64>) -> std::io::Result<Self> {
        let bar = bar(expected, "{pos}/{len} frames  {msg}");
        let theirs = bar.clone();
        let show = move |glance: Option<&Glance>| {
            let Some(glance) = glance else { return };
            let p = glance.pose_o_b.translation.vector;
            bar.set_position(glance.frames);
            bar.set_message(format!("({:.2} {:.2} {:.2}) m, {:.1} ms", p.x, p.y, p.z, glance.frame_ms));
        };
        Self::start(show, move || theirs.finish_and_clear())
    }

    /// After the run: waits until everything is drawn, but not for a terminal that stands still.
    pub fn finish(mut self) {
        self.writer = None;
        if let Some(thread) = self.thread.take() {
            let end = Instant::now() + PATIENCE;
            while !thread.is_finished() && Instant::now() < end {
                std::thread::sleep(Duration::from_millis(2));
            }
        }
    }
}

/// A bar of this length with `words`, the time it took, and the time that is left.
pub(super) fn bar(length: Option<u64>, words: &str) -> ProgressBar {
    let template = format!("{{bar:32}} {words}  {{elapsed}} (eta {{eta}})");
    let style = ProgressStyle::with_template(&template).unwrap_or_else(|_| ProgressStyle::default_bar());
    length.map_or_else(ProgressBar::new_spinner, ProgressBar::new).with_style(style)
}

fn draw(mut glances: Reader<Glance>, mut show: impl FnMut(Option<&Glance>), end: impl FnOnce()) {
    while !glances.is_closed() {
        while let Some(glance) = glances.pop() {
            show(Some(&glance));
        }
        show(None);
        std::thread::sleep(REDRAW);
    }
    end();
}

impl Subscriber for Progress {
    fn listener(&mut self, producer: Producer) -> Box<dyn Listener> {
        match self.writer.take_if(|_| producer == Producer::Window) {
            Some(writer) => Box::new(WindowListener { writer, frames: 0 }),
            None => Box::new(()),
        }
    }
}

/// Hears of estimates; only stores numbers.
struct WindowListener {
    writer: Writer<Glance>,
    frames: u64,
}

impl Listener for WindowListener {
    fn said(&mut self, said: &Said) {
        let Said::Estimate(FullEstimate { estimate, frame_ms }) = said else { return };
        self.frames += 1;
        let _ = self.writer.push(Glance {
            frames: self.frames,
            has_pose: estimate.has_pose(),
            pose_o_b: estimate.pose_o_b,
            v_o_b: estimate.v_o_b,
            points: estimate.figures.points_tracked,
            quality: estimate.quality,
            frame_ms: *frame_ms,
        });
    }
}
