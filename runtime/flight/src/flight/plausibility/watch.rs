//! Feeds [`Plausibility`] from a run, on a thread of normal priority.
//!
//! The listeners copy samples and stamps into memory that stands since before the run. In a live run what finds
//! no room is left out; in virtual time the run waits, so that the findings are the same every time.

use crate::pipeline::listener::{Listener, ListenerView, Producer, Subscriber};
use crate::schedule::queue::Queue;
use crate::schedule::worker::Worker;
use crate::sensor_board::SensorBoard;
use plumbline_checkup::plausibility::{Finding, GIVEN_UP, Plausibility};
use plumbline_config::{Config, ImuSample, Timestamp};
use plumbline_estimator::HealthBits;
use plumbline_record::said::FullEstimate;
use plumbline_record::{Event, Said, Severity};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// Things that wait to be looked at.
const QUEUE: usize = 4096;
/// The queue is looked into this often, and by a producer that may wait.
const POLL: Duration = Duration::from_millis(5);
const WAIT: Duration = Duration::from_micros(200);
/// Findings are judged anew after so many frames.
const JUDGED_EVERY: u64 = 100;

/// One thing to look at.
enum Item {
    Sample(u64, ImuSample),
    Frame(u64, Timestamp),
    Estimate(HealthBits),
    Event(Event),
}

struct Shared {
    items: Queue<Item>,
    may_wait: bool,
    is_over: AtomicBool,
}

impl Shared {
    /// Hands over. What finds no room waits in a run that may wait, else it is left out.
    fn offer(&self, item: Item) {
        loop {
            match self.items.place() {
                Some(place) => return place.fill(item),
                None if self.may_wait && !self.is_over.load(Ordering::Relaxed) => std::thread::sleep(WAIT),
                None => return,
            }
        }
    }
}

/// Looks at the data of a run, and warns of what cannot be right as soon as it shows.
pub struct Watch {
    shared: Arc<Shared>,
    worker: Worker<Vec<Finding>>,
}

impl Watch {
    /// Starts the thread. `known` was found before; `is_live` when the run must not wait. What is found is logged, and posted
    /// on `board`.
    ///
    /// # Errors
    /// When the system refuses a thread.
    pub fn start(
        config: &Config,
        is_live: bool,
        known: Vec<Finding>,
        board: Option<SensorBoard>,
    ) -> std::io::Result<Self> {
        let shared = Arc::new(Shared {
            items: Queue::new(QUEUE),
            may_wait: !is_live,
            is_over: AtomicBool::new(false),
        });
        let (theirs, ours) = (Arc::clone(&shared), Arc::clone(&shared));
        let plausibility = Plausibility::new(config, is_live);
        let stop = move || ours.is_over.store(true, Ordering::Release);
        let worker = Worker::start("plausibility", stop, move || {
            look(&theirs, plausibility, Told { findings: Vec::new(), board }, known)
        })?;
        Ok(Self { shared, worker })
    }

    /// After the run: everything that cannot be right.
    #[must_use]
    pub fn finish(mut self) -> Vec<Finding> {
        self.worker.end().unwrap_or_default()
    }
}

impl Subscriber for Watch {
    fn listener(&mut self, producer: Producer) -> Box<dyn Listener> {
        match producer {
            Producer::Tick | Producer::FrontEnd | Producer::Window => Box::new(Ear(Arc::clone(&self.shared))),
            Producer::Places | Producer::Watchdog => Box::new(()),
        }
    }
}

/// The listener of one thread of the run. Never allocates.
struct Ear(Arc<Shared>);

impl Listener for Ear {
    fn said(&mut self, said: &Said) {
        match said {
            Said::Imu(reading) => self.0.offer(Item::Sample(reading.sequence, reading.sample)),
            Said::Estimate(FullEstimate { estimate, .. }) => {
                self.0.offer(Item::Estimate(estimate.health));
            }
            Said::Event(event) => self.0.offer(Item::Event(event.clone())),
            _ => {}
        }
    }

    fn shown(&mut self, view: ListenerView<'_>) {
        if let ListenerView::Frame(frame) = view {
            self.0.offer(Item::Frame(frame.sequence, frame.stamp));
        }
    }
}

/// The thread: takes what comes until the run is over, and warns of each finding once.
fn look(
    shared: &Shared,
    mut plausibility: Plausibility,
    mut told: Told,
    known: Vec<Finding>,
) -> Vec<Finding> {
    told.tell(known);
    let mut frames = 0;
    loop {
        // Looked at first: what was offered before it was set is in the queue.
        let is_over = shared.is_over.load(Ordering::Acquire);
        while let Some(item) = shared.items.pop() {
            match item {
                Item::Sample(sequence, sample) => plausibility.add_sample(sequence, &sample),
                Item::Estimate(health) => {
                    plausibility.add_estimate(health);
                    frames += 1;
                    if frames % JUDGED_EVERY == 0 {
                        told.tell(plausibility.findings(false));
                    }
                }
                Item::Event(event) if event.severity == Severity::Error => {
                    plausibility.add_reset(&event.text, event.cure)
                }
                Item::Event(event) => tracing::info!("{}", event.text),
                Item::Frame(sequence, stamp) => plausibility.add_frame(sequence, stamp),
            }
        }
        if is_over {
            told.tell(plausibility.findings(true));
            return told.findings;
        }
        std::thread::sleep(POLL);
    }
}

/// Findings reported so far.
struct Told {
    findings: Vec<Finding>,
    board: Option<SensorBoard>,
}

impl Told {
    /// Warns of what is new. The figures of a finding change as a flight goes on; it is told once.
    fn tell(&mut self, findings: Vec<Finding>) {
        let mut has_news = false;
        for finding in findings {
            // Resets are told one by one: each has a reason of its own.
            let is_known = |other: &Finding| {
                (&other.what, &other.cause) == (&finding.what, &finding.cause)
                    && (finding.what != GIVEN_UP || other.evidence == finding.evidence)
            };
            match self.findings.iter().position(is_known) {
                Some(place) => self.findings[place] = finding,
                None => {
                    tracing::warn!("{finding}");
                    self.findings.push(finding);
                    has_news = true;
                }
            }
        }
        if let Some(board) = self.board.as_ref().filter(|_| has_news) {
            board.post_findings(self.findings.iter().rev().map(ToString::to_string).collect());
        }
    }
}
