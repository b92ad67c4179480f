//! Listeners on the threads of the run: they copy what readers want into memory that stands, and ring. Nothing blocks or
//! allocates.

use super::picture::Shot;
use super::record::{Kind, Kinds};
use crate::pipeline::listener::{Listener, ListenerView, Solved};
use crate::schedule::event_bell::EventBell;
use crate::schedule::lane::{LaneLosses, LaneReader, LaneWriter, lane};
use crate::schedule::pace::Pace;
use crate::schedule::pool::Pool;
use crate::schedule::tasks::TaskId;
use crate::schedule::watchdog::Pulse;
use crate::sensor_board::SensorState;
use plumbline_config::{Timestamp, ValidConfig};
use plumbline_drivers::StereoFrame;
use plumbline_estimator::places::MapPath;
use plumbline_estimator::{MapSnapshot, Tracked, Trail};
use plumbline_record::{FrameOrder, InstantSource, Said, Verdict};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU8, AtomicU32, AtomicU64, Ordering};
use std::time::{SystemTime, UNIX_EPOCH};

/// What waits for the socket, of each producer in the order of `Producer`: states at as many instants as may be asked for at a
/// time, with a quarter of a second of odometry; two seconds of two records a frame.
const LANES: [usize; 4] = [306, 80, 80, 80];
/// Trails that are filled, wait or are read.
const TRAILS: usize = 8;
/// Snapshots of the window that are filled, wait or are read: they come with keyframes, a few a second.
const SNAPSHOTS: usize = 8;
/// Corrected paths that are filled, wait or are read: only the newest counts.
const PATHS: usize = 3;
/// Poses, and loops, of a corrected path at most.
const PATH_POSES: usize = 2_000;
/// Pictures that are filled, wait or are read.
const SHOTS: usize = 3;

/// Host's clock, nanoseconds since 1970.
pub fn now_ns() -> i64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |d| d.as_nanos() as i64)
}

/// Something that a flight says, with the time it was handed over, ns since 1970.
pub type Handed = (Said, i64);
/// Writing ends, by producer; the listeners of the run take them.
pub type Lanes = [Option<LaneWriter<Handed>>; LANES.len()];

/// State that the run and the socket's thread share.
#[derive(Debug)]
pub struct SocketState {
    /// Wakes the socket's thread.
    pub bell: EventBell,
    /// Heartbeat of the socket's thread.
    pub pulse: Arc<Pulse>,
    /// The flight is over.
    pub stop: AtomicBool,
    /// Rung of the degradation ladder.
    pub rung: AtomicU8,
    /// State of live sensors.
    pub sensors: Arc<SensorState>,
    /// Contents of the window, after each keyframe.
    pub snapshots: Pool<MapSnapshot>,
    /// The trail, after each frame.
    pub trails: Pool<Trail>,
    /// The corrected path, after each keyframe of the map.
    pub paths: Pool<MapPath>,
    /// Pictures.
    pub shots: Pool<Shot>,
    /// Union of the kinds that the readers want.
    wanted: AtomicU64,
    /// Highest rate of pictures that a reader wants, mHz.
    pictures_mhz: AtomicU32,
    losses: Vec<LaneLosses>,
}

impl SocketState {
    /// Everything allocated for the configuration.
    ///
    /// # Errors
    /// When the system has no more file descriptors.
    pub fn new(config: &ValidConfig) -> std::io::Result<(Self, Lanes, Vec<LaneReader<Handed>>)> {
        let (mut readers, mut losses) = (Vec::new(), Vec::new());
        let writers = LANES.map(|keep| {
            let (writer, reader, lost) = lane(keep);
            readers.push(reader);
            losses.push(lost);
            Some(writer)
        });
        let shared = Self {
            bell: EventBell::new()?,
            pulse: Arc::new(Pulse::new(TaskId::Local)),
            stop: AtomicBool::new(false),
            rung: AtomicU8::new(0),
            sensors: Arc::default(),
            snapshots: Pool::new(SNAPSHOTS, || MapSnapshot::new(config.setup())),
            trails: Pool::new(TRAILS, Trail::with_room),
            paths: Pool::new(PATHS, || MapPath::new(PATH_POSES)),
            shots: Pool::new(SHOTS, || Shot::new(config)),
            wanted: AtomicU64::new(0),
            pictures_mhz: AtomicU32::new(0),
            losses,
        };
        Ok((shared, writers, readers))
    }

    /// Sets what the readers want, and the highest rate of pictures among them, mHz.
    pub fn want(&self, kinds: Kinds, pictures_mhz: u32) {
        self.wanted.store(kinds.mask(), Ordering::Relaxed);
        self.pictures_mhz.store(pictures_mhz, Ordering::Relaxed);
    }

    /// Records lost between the run and the socket's thread.
    pub fn lost(&self) -> u64 {
        self.losses.iter().map(LaneLosses::count).sum::<u64>()
            + self.snapshots.dropped()
            + self.trails.dropped()
    }

    fn wants(&self, kind: Kind) -> bool {
        Kinds::of_mask(self.wanted.load(Ordering::Relaxed)).has(kind)
    }

    fn wake(&self) {
        self.pulse.give();
        self.bell.ring();
    }
}

/// Copies what a thread says and shows, as far as a reader wants it.
pub struct RelayListener {
    shared: Arc<SocketState>,
    lane: LaneWriter<Handed>,
    /// Newest stamp that went out blind: what a sensor brings late is older, and stamps rise.
    blind: Timestamp,
    pictures: Pictures,
}

impl RelayListener {
    /// Listener that writes into `lane`; `shot` has room for any picture.
    pub fn new(shared: Arc<SocketState>, lane: LaneWriter<Handed>, shot: Option<Shot>) -> Self {
        let pictures = Pictures { pace: Pace::new(0.0), pace_mhz: 0, shot, is_pending: false };
        Self { shared, lane, blind: Timestamp::MIN, pictures }
    }

    fn is_wanted(&self, said: &Said) -> bool {
        let wants = |kind| self.shared.wants(kind);
        match said {
            Said::Odometry(odometry) => odometry.stamp > self.blind && wants(Kind::Odometry),
            Said::Instant(answer) => answer.source == InstantSource::Request || wants(Kind::Instant),
            // Odometry carries the health of the newest estimate.
            Said::Estimate(_) => [Kind::Estimate, Kind::FullEstimate, Kind::Odometry].into_iter().any(wants),
            said => wants(said.topic()),
        }
    }

    /// Copies the window.
    fn copy(&self, solved: &Solved<'_>) {
        if !solved.estimate.has_pose() {
            return;
        }
        if solved.estimate.figures.is_keyframe && self.shared.wants(Kind::Window) {
            self.shared.snapshots.fill(|snapshot| solved.copy_to(snapshot));
        }
        if self.shared.wants(Kind::Trail) {
            self.shared.trails.fill(|trail| solved.trail_to(trail));
            self.shared.wake();
        }
    }
}

impl Listener for RelayListener {
    fn said(&mut self, said: &Said) {
        if let Said::Order(FrameOrder { verdict: Verdict::Taken { level }, .. }) = said {
            self.shared.rung.store(*level, Ordering::Relaxed);
        }
        if self.is_wanted(said) {
            self.lane.push((said.clone(), now_ns()));
            self.shared.wake();
        }
    }

    fn shown(&mut self, view: ListenerView<'_>) {
        match view {
            ListenerView::Blind(odometry) => {
                self.said(&Said::Odometry(odometry.clone()));
                self.blind = odometry.stamp;
            }
            ListenerView::Solved(solved) => self.copy(solved),
            ListenerView::Mapped(mapped) if self.shared.wants(Kind::Path) => {
                self.shared.paths.fill(|path| mapped.mapper.copy_path(path));
                self.shared.wake();
            }
            ListenerView::Tracked(tracked) => self.pictures.note(tracked, &self.shared),
            ListenerView::Frame(frame) => self.pictures.take(frame, &self.shared),
            ListenerView::Mapped(_) => {}
        }
    }
}

/// Pictures that are taken while a reader wants them.
struct Pictures {
    pace: Pace,
    pace_mhz: u32,
    /// Changes places with one of the pool when it is whole.
    shot: Option<Shot>,
    /// It has notes on a frame whose image is still to come.
    is_pending: bool,
}

impl Pictures {
    fn note(&mut self, tracked: &Tracked, shared: &SocketState) {
        let mhz = shared.pictures_mhz.load(Ordering::Relaxed);
        if mhz != self.pace_mhz {
            (self.pace, self.pace_mhz) = (Pace::new(f64::from(mhz) * 1e-3), mhz);
        }
        if mhz > 0
            && self.pace.admits(tracked.time.stamp)
            && let Some(shot) = &mut self.shot
        {
            shot.note(tracked);
            self.is_pending = true;
        }
    }

    fn take(&mut self, frame: &StereoFrame, shared: &SocketState) {
        let Some(shot) = self.shot.as_mut().filter(|_| self.is_pending) else { return };
        if shot.expose(frame) {
            self.is_pending = false;
            shared.shots.fill(|waiting| std::mem::swap(waiting, shot));
            shared.wake();
        }
    }
}
