//! Asks vehicles for what did not come by itself: their clock, the path before they were seen, keyframes that
//! were lost on the way. One question at a time for each vehicle, each with a time limit, at low priority.

use super::clock::Exchange;
use super::fleet::Fleet;
use super::listen::lock;
use crate::net::answers::MAX_KEYFRAMES_PER_QUESTION;
use crate::net::{ROOT, now_ns, proto, read};
use nalgebra::Vector3;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};
use zenoh::Session;
use zenoh::qos::{CongestionControl, Priority};

/// How often is looked what is missing.
const PERIOD: Duration = Duration::from_millis(500);
/// How long an answer may take.
const PATIENCE: Duration = Duration::from_secs(3);
/// The clock is asked for this often once it is known.
const CLOCK_PERIOD: Duration = Duration::from_secs(5);
/// Exchanges in quick succession before that.
const FIRST_EXCHANGES: usize = 4;
/// The past is asked for in steps of this, ms.
const PAST_STEP_MS: u32 = 1_000;
/// Answers to one question that are read at most.
const MAX_ANSWERS: usize = 256;

/// What was last asked of a vehicle.
#[derive(Default)]
struct Asked {
    appeared: u64,
    clock: Option<Instant>,
    is_busy: bool,
}

/// Asks as long as the session is open.
pub async fn run(session: Session, fleet: Arc<Mutex<Fleet>>) {
    let asked: Arc<Mutex<BTreeMap<String, Asked>>> = Arc::default();
    while !session.is_closed() {
        let alive: Vec<String> = {
            let fleet = lock(&fleet);
            fleet.vehicles.iter().filter(|(_, v)| v.is_alive).map(|(name, _)| name.clone()).collect()
        };
        for name in alive {
            let is_free = {
                let mut asked = asked.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
                !std::mem::replace(&mut asked.entry(name.clone()).or_default().is_busy, true)
            };
            if is_free {
                tokio::spawn(ask(session.clone(), Arc::clone(&fleet), Arc::clone(&asked), name));
            }
        }
        tokio::time::sleep(PERIOD).await;
    }
}

/// Asks one vehicle for the first thing that is missing.
async fn ask(
    session: Session,
    fleet: Arc<Mutex<Fleet>>,
    asked: Arc<Mutex<BTreeMap<String, Asked>>>,
    name: String,
) {
    let (appeared, exchanges, missing) = match lock(&fleet).vehicles.get(&name) {
        Some(v) => (v.appeared, v.clock.len(), v.map.missing(MAX_KEYFRAMES_PER_QUESTION as u64)),
        None => return,
    };
    let (is_new, is_clock_due) = {
        let mut asked = asked.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        let entry = asked.entry(name.clone()).or_default();
        let is_new = std::mem::replace(&mut entry.appeared, appeared) != appeared;
        let is_due = entry.clock.is_none_or(|last| last.elapsed() >= CLOCK_PERIOD);
        if is_due || exchanges < FIRST_EXCHANGES {
            entry.clock = Some(Instant::now());
        }
        (is_new, is_due || exchanges < FIRST_EXCHANGES)
    };
    if is_clock_due {
        ask_clock(&session, &fleet, &name).await;
    }
    if is_new {
        ask_past(&session, &fleet, &name).await;
    }
    if let Some(missing) = missing {
        let selector = format!("{ROOT}/{name}/map/keyframe?from={};to={}", missing.start, missing.end);
        for keyframe in get::<proto::Keyframe>(&session, &fleet, &selector, Priority::DataLow).await {
            lock(&fleet).keyframe(&name, &keyframe);
        }
    }
    let mut asked = asked.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
    asked.entry(name).or_default().is_busy = false;
}

async fn ask_clock(session: &Session, fleet: &Mutex<Fleet>, name: &str) {
    let asked_ns = now_ns();
    let selector = format!("{ROOT}/{name}/clock");
    let answers = get::<proto::Clock>(session, fleet, &selector, Priority::RealTime).await;
    let came_ns = now_ns();
    if let (Some(clock), Some(vehicle)) = (answers.first(), lock(fleet).vehicles.get_mut(name)) {
        let (received_ns, answered_ns) = (clock.received_ns, clock.answered_ns);
        vehicle.clock.take(Exchange { asked_ns, received_ns, answered_ns, came_ns });
    }
}

async fn ask_past(session: &Session, fleet: &Mutex<Fleet>, name: &str) {
    let selector = format!("{ROOT}/{name}/trajectory?step_ms={PAST_STEP_MS}");
    let mut path: Vec<(i64, Vector3<f64>)> = Vec::new();
    for answer in get::<proto::Trajectory>(session, fleet, &selector, Priority::DataLow).await {
        let poses = answer.stamps_ns.iter().zip(answer.poses_o_b.chunks_exact(7));
        path.extend(poses.map(|(stamp_ns, pose)| (*stamp_ns, Vector3::new(pose[0], pose[1], pose[2]))));
    }
    path.sort_by_key(|(stamp_ns, _)| *stamp_ns);
    lock(fleet).past(name, &path);
}

/// Answers to a question; those that cannot be understood are counted.
async fn get<M: prost::Message + Default + read::Checked>(
    session: &Session,
    fleet: &Mutex<Fleet>,
    selector: &str,
    priority: Priority,
) -> Vec<M> {
    let question = session
        .get(selector)
        .timeout(PATIENCE)
        .priority(priority)
        .congestion_control(CongestionControl::Drop);
    let Ok(replies) = question.await else { return Vec::new() };
    let mut answers = Vec::new();
    while answers.len() < MAX_ANSWERS
        && let Ok(reply) = replies.recv_async().await
    {
        let Ok(sample) = reply.result() else { continue };
        let is_short = sample.payload().len() <= read::MAX_MESSAGE_BYTES;
        let message = is_short.then(|| read::decode::<M>(&sample.payload().to_bytes())).flatten();
        match message {
            Some(message) => answers.push(message),
            None => lock(fleet).malformed(),
        }
    }
    answers
}
