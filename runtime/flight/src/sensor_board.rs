//! State of live sensors on its way to readers: posted by the thread that watches them, sent by the socket's thread.

use parking_lot::Mutex;
use std::fmt;
use std::sync::Arc;

/// Notices that are sent, at most.
const MAX_NOTICES: usize = 8;
/// Longest notice, bytes.
const MAX_NOTICE_BYTES: usize = 400;

/// State of live sensors.
pub use plumbline_record::messages::SensorNews;

/// True if a reader needs a state after another one: notices differ, or stamps went wrong. Sound frames are no news.
fn is_news(news: &SensorNews, before: &SensorNews) -> bool {
    news.notices != before.notices
        || news.frames.bad() != before.frames.bad()
        || news.samples.bad() != before.samples.bad()
}

/// A state with as many notices, and as long ones, as are sent.
fn bounded(mut news: SensorNews) -> SensorNews {
    news.notices.truncate(MAX_NOTICES);
    for notice in &mut news.notices {
        let end = (0..=MAX_NOTICE_BYTES.min(notice.len())).rev().find(|at| notice.is_char_boundary(*at));
        notice.truncate(end.unwrap_or(0));
    }
    news
}

/// The newest state, with a count of its changes.
#[derive(Debug, Default)]
pub(crate) struct SensorState(Mutex<Posted>);

/// State posted last.
#[derive(Debug, Default)]
struct Posted {
    changes: u64,
    sensors: SensorNews,
    /// Findings in the flight's data, one line each.
    findings: Vec<String>,
}

impl Posted {
    /// State of the sensors, with the findings among its notices.
    fn news(&self) -> SensorNews {
        let mut news = self.sensors.clone();
        news.notices.extend_from_slice(&self.findings);
        bounded(news)
    }
}

impl SensorState {
    /// The newest state, if it is another than that of count `seen`.
    pub(crate) fn after(&self, seen: u64) -> Option<(u64, SensorNews)> {
        let held = self.0.lock();
        (held.changes != seen).then(|| (held.changes, held.news()))
    }

    /// The newest state.
    pub(crate) fn newest(&self) -> SensorNews {
        self.0.lock().news()
    }
}

/// Board on which the state of live sensors and the findings of a flight are posted for the readers of the local socket.
#[derive(Clone)]
pub struct SensorBoard {
    state: Arc<SensorState>,
    ring: Arc<dyn Fn() + Send + Sync>,
}

impl fmt::Debug for SensorBoard {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("SensorBoard").field(&self.state).finish_non_exhaustive()
    }
}

impl SensorBoard {
    /// Board of `state`; `ring` wakes the thread that sends it.
    pub(crate) fn new(state: Arc<SensorState>, ring: impl Fn() + Send + Sync + 'static) -> Self {
        Self { state, ring: Arc::new(ring) }
    }

    /// Posts a state of the sensors; readers receive it if it is news.
    pub fn post(&self, news: SensorNews) {
        let news = bounded(news);
        self.change(|held| {
            let is_news = is_news(&news, &held.sensors);
            if is_news {
                held.sensors = news;
            }
            is_news
        });
    }

    /// Posts what the flight's data show to be wrong, one line each, the newest first; replaces what was posted before.
    pub fn post_findings(&self, findings: Vec<String>) {
        self.change(|held| {
            let is_news = findings != held.findings;
            held.findings = findings;
            is_news
        });
    }

    /// Wakes the thread that sends if `change` makes a difference.
    fn change(&self, change: impl FnOnce(&mut Posted) -> bool) {
        {
            let mut held = self.state.0.lock();
            if !change(&mut held) {
                return;
            }
            held.changes += 1;
        }
        (self.ring)();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use plumbline_drivers::clock::StampFigures;

    #[test]
    fn sound_frames_are_no_news_and_bad_stamps_are() {
        let stamps = |used, restamped| StampFigures { used, restamped, ..StampFigures::default() };
        let of = |frames| SensorNews { frames, ..SensorNews::default() };
        assert!(!is_news(&of(stamps(5, 0)), &of(stamps(1, 0))));
        assert!(is_news(&of(stamps(5, 1)), &of(stamps(5, 0))));
        let long = bounded(SensorNews { notices: vec!["\u{e9}".repeat(999); 20], ..SensorNews::default() });
        assert!(long.notices.len() == MAX_NOTICES && long.notices[0].len() <= MAX_NOTICE_BYTES);
    }

    #[test]
    fn findings_stand_among_the_notices_until_others_are_posted() {
        let state = Arc::<SensorState>::default();
        let board = SensorBoard::new(Arc::clone(&state), || ());
        board.post(SensorNews { notices: vec!["no frames".into()], ..SensorNews::default() });
        board.post_findings(vec!["columns exchanged".into()]);
        let (changes, news) = state.after(0).unwrap();
        assert_eq!(
            (changes, news.notices),
            (2, vec!["no frames".to_owned(), "columns exchanged".to_owned()])
        );
        board.post_findings(vec!["columns exchanged".into()]);
        assert!(state.after(changes).is_none());
        board.post(SensorNews::default());
        assert_eq!(state.newest().notices, ["columns exchanged"]);
    }
}
