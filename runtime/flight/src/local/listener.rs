//! Listeners on the threads of the run: they copy what readers want into memory that stands, and ring. Nothing blocks or
//! allocates.

use super::picture::Shot;
use super::record::{Kind, Kinds};
use crate::pipeline::listener::{Listener, ListenerView};
use crate::schedule::event_bell::EventBell;
use crate::schedule::lane::{LaneLosses, LaneReader, LaneWriter, lane};
use crate::schedule::pace::Pace;
use crate::schedule::pool::Pool;
use crate::schedule::tasks::TaskId;
use crate::schedule::watchdog::Pulse;
use crate::sensor_board::SensorState;
use plumbline_config::{Timestamp, ValidConfig};
use plumbline_estimator::places::MapPath;
use plumbline_estimator::{MapSnapshot, Odometry, Tracked, Trail};
use plumbline_record::said::FullEstimate;
use plumbline_record::{FrameOrder, InstantAnswer, InstantSource, Said, Verdict};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU8, AtomicU32, AtomicU64, Ordering};
use std::time::{SystemTime, UNIX_EPOCH};

/// Odometry that waits for the socket: a quarter of a second.
const ODOMETRY_LANE: usize = 50;
/// Estimates that wait for the socket: two seconds.
const ESTIMATE_LANE: usize = 40;
/// States at instants that wait for the socket: as many as may be asked for at a time.
const INSTANT_LANE: usize = 256;
/// Other records that wait for the socket, of each thread: two seconds of one a frame.
const OTHERS_LANE: usize = 40;
/// Threads that say something.
const PRODUCERS: usize = 4;
/// Topics that have lanes of their own.
const OWN: [Kind; 3] = [Kind::Odometry, Kind::Instant, Kind::FullEstimate];
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

/// An entry with the time it was handed over, ns since 1970.
pub type Handed<T> = (T, i64);

/// Writing ends of odometry and of states at instants.
pub type TickWriters = (LaneWriter<Handed<Odometry>>, LaneWriter<Handed<InstantAnswer>>);

/// Writing ends, which the listeners of the run take.
#[derive(Debug)]
pub struct Writers {
    /// Taken by the listener on the tick's thread.
    pub tick: Option<TickWriters>,
    /// Taken by the listener on the window's thread.
    pub estimates: Option<LaneWriter<Handed<FullEstimate>>>,
    /// One for each thread that says something.
    pub others: Vec<LaneWriter<Said>>,
}

/// Reading ends of [`Writers`].
#[derive(Debug)]
pub struct LaneReaders {
    pub odometry: LaneReader<Handed<Odometry>>,
    pub instants: LaneReader<Handed<InstantAnswer>>,
    pub estimates: LaneReader<Handed<FullEstimate>>,
    pub others: Vec<LaneReader<Said>>,
}

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
    pub fn new(config: &ValidConfig) -> std::io::Result<(Self, Writers, LaneReaders)> {
        let (odometry_in, odometry, odometry_losses) = lane(ODOMETRY_LANE);
        let (instants_in, instants, instant_losses) = lane(INSTANT_LANE);
        let (estimates_in, estimates, estimate_losses) = lane(ESTIMATE_LANE);
        let mut losses = vec![odometry_losses, instant_losses, estimate_losses];
        let (mut others_in, mut others) = (Vec::new(), Vec::new());
        for _ in 0..PRODUCERS {
            let (writer, reader, lost) = lane(OTHERS_LANE);
            others_in.push(writer);
            others.push(reader);
            losses.push(lost);
        }
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
        let writers = Writers {
            tick: Some((odometry_in, instants_in)),
            estimates: Some(estimates_in),
            others: others_in,
        };
        Ok((shared, writers, LaneReaders { odometry, instants, estimates, others }))
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

/// Copies what a thread says and a reader wants, and has no way of its own; the rest is taken by `inner`.
pub struct RelayListener {
    pub shared: Arc<SocketState>,
    pub others: LaneWriter<Said>,
    pub inner: Box<dyn Listener>,
}

impl Listener for RelayListener {
    fn shown(&mut self, view: ListenerView<'_>) {
        self.inner.shown(view);
    }

    fn said(&mut self, said: &Said) {
        let topic = said.topic();
        if !OWN.contains(&topic) && self.shared.wants(topic) {
            self.others.push(said.clone());
            self.shared.wake();
        }
        self.inner.said(said);
    }
}

/// Copies odometry, and states at instants.
pub struct TickListener {
    shared: Arc<SocketState>,
    odometry: LaneWriter<Handed<Odometry>>,
    instants: LaneWriter<Handed<InstantAnswer>>,
    /// Newest stamp that went out blind: what a sensor brings late is older, and stamps rise.
    blind: Timestamp,
}

impl TickListener {
    pub fn new(
        shared: Arc<SocketState>,
        odometry: LaneWriter<Handed<Odometry>>,
        instants: LaneWriter<Handed<InstantAnswer>>,
    ) -> Self {
        Self { shared, odometry, instants, blind: Timestamp::MIN }
    }

    fn copy(&mut self, odometry: &Odometry) {
        if odometry.stamp > self.blind && self.shared.wants(Kind::Odometry) {
            self.odometry.push((odometry.clone(), now_ns()));
            self.shared.wake();
        }
    }
}

impl Listener for TickListener {
    fn said(&mut self, said: &Said) {
        match said {
            Said::Odometry(odometry) => self.copy(odometry),
            Said::Instant(answer)
                if answer.source == InstantSource::Request || self.shared.wants(Kind::Instant) =>
            {
                self.instants.push((answer.clone(), now_ns()));
                self.shared.wake();
            }
            _ => {}
        }
    }

    fn shown(&mut self, view: ListenerView<'_>) {
        if let ListenerView::Blind(odometry) = view {
            self.copy(odometry);
            self.blind = odometry.stamp;
        }
    }
}

/// Copies estimates, and the window.
pub struct WindowListener {
    pub shared: Arc<SocketState>,
    pub estimates: LaneWriter<Handed<FullEstimate>>,
}

impl Listener for WindowListener {
    fn shown(&mut self, view: ListenerView<'_>) {
        let ListenerView::Solved(solved) = view else { return };
        let is_news = solved.estimate.figures.is_keyframe && solved.estimate.has_pose();
        if is_news && self.shared.wants(Kind::Window) {
            self.shared.snapshots.fill(|snapshot| solved.copy_to(snapshot));
        }
        if solved.estimate.has_pose() && self.shared.wants(Kind::Trail) {
            self.shared.trails.fill(|trail| solved.trail_to(trail));
            self.shared.wake();
        }
    }

    fn said(&mut self, said: &Said) {
        let wants = |kind: &Kind| self.shared.wants(*kind);
        // Odometry carries the health of the newest estimate.
        if let Said::Estimate(full) = said
            && [Kind::Estimate, Kind::FullEstimate, Kind::Odometry].iter().any(wants)
        {
            self.estimates.push((full.clone(), now_ns()));
            self.shared.wake();
        }
    }
}

/// Copies the corrected path.
pub struct PlacesListener(pub Arc<SocketState>);

impl Listener for PlacesListener {
    fn shown(&mut self, view: ListenerView<'_>) {
        if let ListenerView::Mapped(mapped) = view
            && self.0.wants(Kind::Path)
        {
            self.0.paths.fill(|path| mapped.mapper.copy_path(path));
            self.0.wake();
        }
    }
}

/// Takes pictures, and notes the rung of the ladder.
pub struct FrontEndListener {
    shared: Arc<SocketState>,
    pace: Pace,
    pace_mhz: u32,
    /// Changes places with one of the pool when it is whole.
    shot: Shot,
    /// It has notes on a frame whose image is still to come.
    is_pending: bool,
}

impl FrontEndListener {
    /// Listener that takes pictures while a reader wants them; `shot` has room for any.
    pub fn new(shared: Arc<SocketState>, shot: Shot) -> Self {
        Self { shared, pace: Pace::new(0.0), pace_mhz: 0, shot, is_pending: false }
    }
}

impl FrontEndListener {
    fn note(&mut self, tracked: &Tracked) {
        let mhz = self.shared.pictures_mhz.load(Ordering::Relaxed);
        if mhz != self.pace_mhz {
            (self.pace, self.pace_mhz) = (Pace::new(f64::from(mhz) * 1e-3), mhz);
        }
        if mhz > 0 && self.pace.admits(tracked.time.stamp) {
            self.shot.note(tracked);
            self.is_pending = true;
        }
    }
}

impl Listener for FrontEndListener {
    fn shown(&mut self, view: ListenerView<'_>) {
        match view {
            ListenerView::Tracked(tracked) => self.note(tracked),
            ListenerView::Frame(frame) if self.is_pending && self.shot.expose(frame) => {
                self.is_pending = false;
                self.shared.shots.fill(|waiting| std::mem::swap(waiting, &mut self.shot));
                self.shared.wake();
            }
            _ => {}
        }
    }

    fn said(&mut self, said: &Said) {
        if let Said::Order(FrameOrder { verdict: Verdict::Taken { level }, .. }) = said {
            self.shared.rung.store(*level, Ordering::Relaxed);
        }
    }
}
