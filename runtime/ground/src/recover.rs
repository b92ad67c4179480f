//! Queries what subscriptions do not bring: a vehicle's clock, its path before and during interruptions, keyframes and
//! the corrected path where they were lost on the link. One query at a time for each vehicle, each with a timeout, at low priority.

use super::clock::Exchange;
use super::fleet::Fleet;
use parking_lot::Mutex;
use plumbline_estimator::MapSnapshot;
use plumbline_estimator::places::MapPath;
use plumbline_link::net::answers::MAX_KEYFRAMES_PER_QUESTION;
use plumbline_link::net::read::{self, Heard};
use plumbline_link::net::{ROOT, now_ns};
use plumbline_record::messages::{Clock, PastPose, PastTrajectory};
use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::Arc;
use std::time::{Duration, Instant};
use tokio::task::JoinHandle;
use zenoh::Session;
use zenoh::qos::{CongestionControl, Priority};
use zenoh::query::ConsolidationMode;

/// Period of the search for missing data.
const PERIOD: Duration = Duration::from_millis(500);
/// Timeout of an answer.
const PATIENCE: Duration = Duration::from_secs(3);
/// The clock is asked for this often once it is known.
const CLOCK_PERIOD: Duration = Duration::from_secs(5);
/// Exchanges in quick succession before that.
const FIRST_EXCHANGES: usize = 4;
/// The past is asked for in steps of this, ms.
const PAST_STEP_MS: u32 = 1_000;
/// Answers to one question that are read at most.
const MAX_ANSWERS: usize = 256;

/// Attends to every vehicle as long as the session is open.
pub async fn run(session: Session, fleet: Arc<Mutex<Fleet>>) {
    let mut attended: BTreeMap<String, JoinHandle<()>> = BTreeMap::new();
    while !session.is_closed() {
        attended.retain(|_, task| !task.is_finished());
        let known: Vec<String> = fleet.lock().vehicles.keys().cloned().collect();
        for name in known {
            let (session, fleet) = (&session, &fleet);
            attended.entry(name).or_insert_with_key(|name| {
                tokio::spawn(attend(session.clone(), Arc::clone(fleet), name.clone()))
            });
        }
        tokio::time::sleep(PERIOD).await;
    }
}

/// Asks one vehicle for what is missing, one question after the other, as long as it is known.
async fn attend(session: Session, fleet: Arc<Mutex<Fleet>>, name: String) {
    let (mut asked_clock, mut asked_past, mut missed_path) = (None::<Instant>, 0, None);
    while !session.is_closed() {
        let wanted = {
            let fleet = fleet.lock();
            let Some(vehicle) = fleet.vehicles.get(&name) else { return };
            let missing = vehicle.map.missing(MAX_KEYFRAMES_PER_QUESTION as u64);
            let wanted = (vehicle.appeared, vehicle.clock.len(), missing, vehicle.corrected.missing());
            vehicle.is_alive.then_some(wanted)
        };
        if let Some((appeared, exchanges, missing, path)) = wanted {
            let is_clock_due = asked_clock.is_none_or(|last| last.elapsed() >= CLOCK_PERIOD);
            if is_clock_due || exchanges < FIRST_EXCHANGES {
                asked_clock = Some(Instant::now());
                ask_clock(&session, &fleet, &name).await;
            }
            if appeared != asked_past && ask_past(&session, &fleet, &name).await {
                asked_past = appeared;
            }
            if let Some(missing) = missing {
                ask_keyframes(&session, &fleet, &name, missing).await;
            }
            // One that has just been announced is on its way.
            if path.is_some() && std::mem::replace(&mut missed_path, path) == path {
                ask_path(&session, &fleet, &name).await;
            }
        }
        tokio::time::sleep(PERIOD).await;
    }
}

async fn ask_clock(session: &Session, fleet: &Mutex<Fleet>, name: &str) {
    let asked_ns = now_ns();
    let selector = format!("{ROOT}/{name}/clock");
    let answers = get::<Clock>(session, fleet, &selector, Priority::RealTime, read::clock).await;
    let came_ns = now_ns();
    if let (Some(clock), Some(vehicle)) = (answers.first(), fleet.lock().vehicles.get_mut(name)) {
        let (received_ns, answered_ns) = (clock.received_ns, clock.answered_ns);
        vehicle.clock.add(Exchange { asked_ns, received_ns, answered_ns, came_ns });
    }
}

async fn ask_keyframes(session: &Session, fleet: &Mutex<Fleet>, name: &str, missing: Range<u64>) {
    let selector = format!("{ROOT}/{name}/map/keyframe/**?from={};to={}", missing.start, missing.end);
    let read = read::heard::<MapSnapshot>;
    for keyframe in get::<Heard<MapSnapshot>>(session, fleet, &selector, Priority::DataLow, read).await {
        if let Some(vehicle) = fleet.lock().vehicle(name) {
            vehicle.map.insert(&keyframe);
        }
    }
}

async fn ask_path(session: &Session, fleet: &Mutex<Fleet>, name: &str) {
    let selector = format!("{ROOT}/{name}/map/path");
    let read = read::heard::<MapPath>;
    for path in get::<Heard<MapPath>>(session, fleet, &selector, Priority::DataLow, read).await {
        if let Some(vehicle) = fleet.lock().vehicle(name) {
            vehicle.corrected.apply_path(&path);
        }
    }
}

/// Queries the path so far; returns whether a reply arrived.
async fn ask_past(session: &Session, fleet: &Mutex<Fleet>, name: &str) -> bool {
    let selector = format!("{ROOT}/{name}/trajectory/**?step_ms={PAST_STEP_MS}");
    let answers = get(session, fleet, &selector, Priority::DataLow, read::decode::<PastTrajectory>).await;
    let mut past: Vec<PastPose> = answers.iter().flat_map(|answer| answer.poses.iter().copied()).collect();
    past.sort_by_key(|pose| pose.stamp);
    if let Some(vehicle) = fleet.lock().vehicle(name) {
        vehicle.fill(&past);
    }
    !answers.is_empty()
}

/// Replies to a query; those that cannot be decoded are counted.
async fn get<M>(
    session: &Session,
    fleet: &Mutex<Fleet>,
    selector: &str,
    priority: Priority,
    read: impl Fn(&[u8]) -> Option<M>,
) -> Vec<M> {
    let (sender, mut replies) = tokio::sync::mpsc::channel(MAX_ANSWERS);
    let question = session
        .get(selector)
        // What finds no room is not wanted. Zenoh's own channel would log each of them.
        .callback(move |reply| drop(sender.try_send(reply)))
        .timeout(PATIENCE)
        // Nothing has to be held back: each answer has a key of its own.
        .consolidation(ConsolidationMode::None)
        .priority(priority)
        .congestion_control(CongestionControl::Drop);
    let mut answers = Vec::new();
    if question.await.is_err() {
        return answers;
    }
    for _ in 0..MAX_ANSWERS {
        let Some(reply) = replies.recv().await else { break };
        let Ok(sample) = reply.result() else { continue };
        let is_short = sample.payload().len() <= read::MAX_MESSAGE_BYTES;
        let message = is_short.then(|| read(&sample.payload().to_bytes())).flatten();
        match message {
            Some(message) => answers.push(message),
            None => fleet.lock().malformed(),
        }
    }
    answers
}

#[cfg(test)]
mod tests {
    use super::*;
    use plumbline_link::net::Endpoints;
    use plumbline_record::protobuf::encode;
    use std::net::TcpListener;
    use std::sync::atomic::{AtomicUsize, Ordering};
    use tracing::{Event, Level, Subscriber};
    use tracing_subscriber::layer::{Context, Layer, SubscriberExt as _};

    /// Lines about answers that nobody takes.
    static LINES: AtomicUsize = AtomicUsize::new(0);

    struct Count;

    impl<S: Subscriber> Layer<S> for Count {
        fn on_event(&self, event: &Event<'_>, _context: Context<'_, S>) {
            let is_theirs = event.metadata().target().starts_with("zenoh::api::handlers");
            let is_seen = is_theirs && *event.metadata().level() <= Level::WARN;
            LINES.fetch_add(usize::from(is_seen), Ordering::SeqCst);
        }
    }

    #[test]
    fn answers_without_end_are_bounded_and_log_nothing() {
        tracing::subscriber::set_global_default(tracing_subscriber::registry().with(Count)).unwrap();
        let free = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
        let endpoint = vec![format!("tcp/{free}")];
        let runtime =
            tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build().unwrap();
        runtime.block_on(async {
            let vehicle =
                Endpoints { listen: endpoint.clone(), ..Endpoints::default() }.open().await.unwrap();
            let answer = encode(&Clock { received_ns: 1, answered_ns: 2 });
            let endless = move |query: zenoh::query::Query| {
                for _ in 0..8 * MAX_ANSWERS {
                    drop(zenoh::Wait::wait(query.reply("plumbline/drone/clock", answer.clone())));
                }
            };
            vehicle.declare_queryable("plumbline/drone/clock").callback(endless).background().await.unwrap();
            let station = Endpoints { connect: endpoint, ..Endpoints::default() }.open().await.unwrap();
            let fleet = Mutex::new(Fleet::default());
            let mut answers = Vec::new();
            for _ in 0..50 {
                answers =
                    get(&station, &fleet, "plumbline/drone/clock", Priority::RealTime, read::clock).await;
                if !answers.is_empty() {
                    break;
                }
            }
            assert!((1..=MAX_ANSWERS).contains(&answers.len()), "{}", answers.len());
            // Those that nobody takes any more are still on their way.
            let _ = station.close().await;
            let _ = vehicle.close().await;
        });
        assert_eq!(LINES.load(Ordering::SeqCst), 0);
    }
}
