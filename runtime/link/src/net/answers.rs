//! Queries that a vehicle answers: trajectory, keyframes, corrected path, configuration, clock, reset, saving the map.
//!
//! Questions wait in a short queue and are answered one after the other by a thread of their own: who asks much
//! holds up nobody but those who ask. Commands have a queue and a task of their own, and questions about time a thread. Answers travel with the quality of
//! service of their question; ground stations ask with one that drops them when the link is full, and ask again. Where a peer asks with
//! one that waits, and does not read, its link is closed after half a second (`MAX_BLOCKED_US` of [`super::session`]).
//!
//! A client keeps the newest of several answers under one key, unless it asks for no consolidation. Where there can be
//! several, each therefore has a key of its own below the one that was asked for (`trajectory/<stamp of its first
//! pose>`, `map/keyframe/<sequence number>`), which a question ending in `/**` allows. A question for the exact key is
//! answered by one message, or refused when one cannot hold the answer: nothing is lost silently.

use super::commands::reset_words;
use super::error::NetError;
use super::history::{History, MAX_POSES};
use super::now_ns;
use super::outlet::{encoding, key_of};
use super::vehicle::VehicleFacts;
use parking_lot::Mutex;
use plumbline_estimator::ResetKind;
use plumbline_record::messages::{Clock, MapSaved, PastTrajectory, ResetDone};
use plumbline_record::protobuf::encode;
use plumbline_record::topics::{Question, Topic};
use std::ops::Range;
use std::sync::Arc;
use tokio::sync::{mpsc, watch};
use zenoh::bytes::Encoding;
use zenoh::key_expr::keyexpr;
use zenoh::query::Query;
use zenoh::{Session, Wait};

/// Questions that wait.
const MAX_QUESTIONS: usize = 32;
/// Commands that wait.
const MAX_COMMANDS: usize = 8;
/// Questions about time that wait, and refusals.
const MAX_SHORT: usize = 256;
/// Poses in one answer.
const POSES_PER_ANSWER: usize = 500;
/// Largest distance between poses that can be asked for, ms.
const MAX_STEP_MS: i64 = 3_600_000;
/// Keyframes in one answer to a question.
pub const MAX_KEYFRAMES_PER_QUESTION: usize = 64;

/// Sources of the answers.
pub struct Answers {
    /// Vehicle that answers.
    pub vehicle: Arc<VehicleFacts>,
    /// Poses, keyframes and path.
    pub history: Arc<Mutex<History>>,
    /// The newest count of resets.
    pub resets: watch::Receiver<u32>,
}

/// Declares the queryables of a vehicle and answers until the session ends.
///
/// # Errors
/// When a key cannot be declared.
pub async fn declare(session: &Session, answers: Answers) -> Result<(), NetError> {
    let (questions, waiting) = mpsc::channel::<(Topic, Query)>(MAX_QUESTIONS);
    let (commands, given) = mpsc::channel::<(Topic, Query)>(MAX_COMMANDS);
    let (short, at_once) = mpsc::channel::<Short>(MAX_SHORT);
    let asked = |topic: Topic| topic.row().question.map(|question| (topic, question));
    for (topic, Question { is_command, has_several, .. }) in Topic::ALL.into_iter().filter_map(asked) {
        let base = key_of(&answers.vehicle.name, topic);
        let key = if has_several { format!("{base}/**") } else { base.clone() };
        let queue = if is_command { commands.clone() } else { questions.clone() };
        let (short, clock_key) = (short.clone(), Arc::<str>::from(base));
        let failed = |error: zenoh::Error| NetError::Declare { key: key.clone(), message: error.to_string() };
        session
            .declare_queryable(&key)
            .callback(move |query| {
                // No answer is sent on a thread of Zenoh: who does not read would hold up all that comes in.
                if topic == Topic::Clock {
                    // A question about time does not wait behind others.
                    let _ = short.try_send(Short::Time {
                        query,
                        key: Arc::clone(&clock_key),
                        received_ns: now_ns(),
                    });
                } else if let Err(error) = queue.try_send((topic, query)) {
                    let (_, query) = error.into_inner();
                    let _ = short.try_send(Short::Busy(query));
                }
            })
            .background()
            .await
            .map_err(failed)?;
    }
    let answers = Arc::new(answers);
    answer_questions(Arc::clone(&answers), waiting)?;
    answer_at_once(at_once)?;
    tokio::spawn(obey(answers, given));
    Ok(())
}

/// Answers one question after the other, on a thread of its own: an answer travels as its question asked, and may wait for
/// somebody who does not read.
fn answer_questions(
    answers: Arc<Answers>,
    mut waiting: mpsc::Receiver<(Topic, Query)>,
) -> std::io::Result<()> {
    let runtime = tokio::runtime::Handle::current();
    let thread = std::thread::Builder::new().name("plumbline-answers".into());
    thread.spawn(move || {
        while let Some((topic, query)) = waiting.blocking_recv() {
            runtime.block_on(answers.answer(topic, &query));
        }
    })?;
    Ok(())
}

/// Queries answered at once, by a thread of their own.
enum Short {
    Time { query: Query, key: Arc<str>, received_ns: i64 },
    Busy(Query),
}

fn answer_at_once(mut waiting: mpsc::Receiver<Short>) -> std::io::Result<()> {
    let thread = std::thread::Builder::new().name("plumbline-clock".into());
    thread.spawn(move || {
        while let Some(short) = waiting.blocking_recv() {
            match short {
                Short::Time { query, key, received_ns } => tell_time(&query, &key, received_ns),
                Short::Busy(query) => drop(query.reply_err("busy: ask again later").wait()),
            }
        }
    })?;
    Ok(())
}

/// Carries out commands, which wait behind no question. Bringing a map to the disk takes its time: a reset does not wait for
/// it, and there is one at a time.
async fn obey(answers: Arc<Answers>, mut given: mpsc::Receiver<(Topic, Query)>) {
    let saving = Arc::new(tokio::sync::Mutex::new(()));
    while let Some((topic, query)) = given.recv().await {
        if topic != Topic::MapSave {
            answers.answer(topic, &query).await;
        } else if let Ok(turn) = Arc::clone(&saving).try_lock_owned() {
            let answers = Arc::clone(&answers);
            tokio::spawn(async move {
                answers.answer(topic, &query).await;
                drop(turn);
            });
        } else {
            let _ = query.reply_err("busy: the map is being saved").await;
        }
    }
}

/// Keys under which answers to a query may be sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Room {
    /// Each under a key of its own.
    Several,
    /// One, under the key of the topic.
    One,
}

impl Room {
    fn of(query: &Query, base: &str) -> Self {
        Self::allowed_by(query.key_expr(), base)
    }

    /// By the key that was asked for: only a pattern may include the keys below that of the topic.
    fn allowed_by(asked: &keyexpr, base: &str) -> Self {
        let includes = |key: &str| keyexpr::new(key).is_ok_and(|key| asked.intersects(key));
        let is_topic_alone = includes(base) && !includes(&format!("{base}/0"));
        if is_topic_alone { Self::One } else { Self::Several }
    }
}

impl Answers {
    async fn answer(&self, topic: Topic, query: &Query) {
        let key = &key_of(&self.vehicle.name, topic);
        match topic {
            Topic::Trajectory => {
                let answers = self.trajectory(query, Room::of(query, key));
                send_each(query, key, topic, answers).await;
            }
            Topic::Keyframe => {
                let answers = self.keyframes(query, Room::of(query, key), key);
                send_each(query, key, topic, answers).await;
            }
            Topic::Path => {
                let path = self.history.lock().path.clone();
                let answer = if path.is_empty() { Vec::new() } else { vec![path] };
                send(query, key, topic, Ok(answer)).await;
            }
            Topic::Configuration => {
                send(query, key, topic, Ok(vec![encode(&self.vehicle.configuration)])).await;
            }
            Topic::Reset => {
                let outcome = self.reset(query, key).await;
                if let Err(reason) = &outcome {
                    tracing::warn!("reset refused: {reason}");
                }
                send(query, key, topic, outcome.map(|done| vec![encode(&done)])).await;
            }
            Topic::MapSave => {
                let outcome = self.save_map(query, key).await;
                if let Err(reason) = &outcome {
                    tracing::warn!("map not saved: {reason}");
                }
                send(query, key, topic, outcome.map(|done| vec![encode(&done)])).await;
            }
            _ => tell_time(query, key, now_ns()),
        }
    }

    /// The trajectory that a question asks for, each answer with its stamp, ns.
    fn trajectory(&self, query: &Query, room: Room) -> Result<Vec<(i64, Vec<u8>)>, String> {
        let wanted = range(query, i64::MIN, i64::MAX)?;
        let step_ns = number(query, "step_ms", 0i64)?.clamp(0, MAX_STEP_MS) * 1_000_000;
        let size = if room == Room::One { MAX_POSES } else { POSES_PER_ANSWER };
        let answers = self.history.lock().trajectory(&wanted, step_ns, size);
        let numbered = |answer: &PastTrajectory| {
            (answer.poses.first().map_or(0, |first| first.stamp.as_nanos()), encode(answer))
        };
        Ok(answers.iter().map(numbered).collect())
    }

    /// The keyframes that a question asks for, each with its sequence number.
    fn keyframes(&self, query: &Query, room: Room, key: &str) -> Result<Vec<(i64, Vec<u8>)>, String> {
        let wanted = range(query, 0, u64::MAX)?;
        let keyframes = self.history.lock().keyframes(&wanted, MAX_KEYFRAMES_PER_QUESTION);
        if room == Room::One && keyframes.len() > 1 {
            return Err(format!(
                "{} keyframes are wanted; ask for {key}/**, where each has its own key",
                keyframes.len()
            ));
        }
        Ok(keyframes.into_iter().map(|(number, bytes)| (number as i64, bytes)).collect())
    }

    /// Checks that a command may be carried out; the error is the reason as text.
    fn check_command(&self, query: &Query, key: &str) -> Result<(), String> {
        if query.key_expr().as_str() != key {
            // A pattern would pass rules that name the command.
            return Err(format!("a command needs its exact key: {key}"));
        }
        self.vehicle.refusal.clone().map_or(Ok(()), Err)
    }

    /// Has the map kept; the error is the reason as text.
    async fn save_map(&self, query: &Query, key: &str) -> Result<MapSaved, String> {
        self.check_command(query, key)?;
        let keyframes = self.vehicle.commands.save_map().await?;
        Ok(MapSaved { keyframes, words: format!("{keyframes} keyframes saved") })
    }

    /// Carries out a reset; the error is the reason as text.
    async fn reset(&self, query: &Query, key: &str) -> Result<ResetDone, String> {
        self.check_command(query, key)?;
        let kind = match query.parameters().get("kind") {
            Some("soft") => ResetKind::Soft,
            Some("hard") => ResetKind::Hard,
            _ => return Err("say ?kind=soft (keeps the pose) or ?kind=hard (starts at the origin)".into()),
        };
        let reset_counter = self.vehicle.commands.reset(kind, self.resets.clone()).await?;
        Ok(ResetDone { reset_counter, words: format!("{} reset done", reset_words(kind)) })
    }
}

/// A whole number of a question, such as `?from=5`.
fn number<T: std::str::FromStr>(query: &Query, name: &str, default: T) -> Result<T, String> {
    match query.parameters().get(name) {
        None | Some("") => Ok(default),
        Some(text) => text.parse().map_err(|_| format!("{name}={text:.40} is not a whole number")),
    }
}

/// The range `?from=..;to=..` of a question.
fn range<T: std::str::FromStr>(query: &Query, first: T, last: T) -> Result<Range<T>, String> {
    Ok(number(query, "from", first)?..number(query, "to", last)?)
}

/// Sends numbered answers: below our own `key`, or under it where nothing else was asked for.
async fn send_each(query: &Query, key: &str, topic: Topic, answers: Result<Vec<(i64, Vec<u8>)>, String>) {
    let answers = match answers {
        Ok(answers) => answers,
        Err(reason) => return send(query, key, topic, Err(reason)).await,
    };
    let has_own_keys = Room::of(query, key) == Room::Several;
    for (number, answer) in answers {
        let own = if has_own_keys { format!("{key}/{number}") } else { key.to_owned() };
        send(query, &own, topic, Ok(vec![answer])).await;
    }
}

/// Sends the answers under our own `key`, whatever pattern was asked with.
async fn send(query: &Query, key: &str, topic: Topic, answers: Result<Vec<Vec<u8>>, String>) {
    match answers {
        Ok(answers) => {
            for answer in answers {
                let _ = query.reply(key, answer).encoding(encoding(topic)).await;
            }
        }
        Err(reason) => drop(query.reply_err(reason).encoding(Encoding::TEXT_PLAIN).await),
    }
}

fn tell_time(query: &Query, key: &str, received_ns: i64) {
    let clock = Clock { received_ns, answered_ns: now_ns() };
    let _ = query.reply(key, encode(&clock)).encoding(encoding(Topic::Clock)).express(true).wait();
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn several_answers_go_where_the_question_includes_their_keys() {
        let room = |asked: &str| Room::allowed_by(keyexpr::new(asked).unwrap(), "plumbline/drone/trajectory");
        for asked in ["plumbline/drone/trajectory", "plumbline/*/trajectory", "plumbline/drone/*"] {
            assert_eq!(room(asked), Room::One, "{asked}");
        }
        for asked in ["plumbline/drone/trajectory/**", "plumbline/drone/trajectory/*", "plumbline/**"] {
            assert_eq!(room(asked), Room::Several, "{asked}");
        }
    }
}
