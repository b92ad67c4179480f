//! State of live sensors on its way to readers: posted by the thread that watches them, sent by the socket's thread.

use plumbline_drivers::clock::StampFigures;
use std::fmt;
use std::sync::{Arc, Mutex, PoisonError};

/// Notices that are sent, at most.
const MAX_NOTICES: usize = 8;
/// Longest notice, bytes.
const MAX_NOTICE_BYTES: usize = 400;

/// State of live sensors.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SensorNews {
    /// What is wrong, and what to do: one line each.
    pub notices: Vec<String>,
    /// Stamps of the frames.
    pub frames: StampFigures,
    /// Stamps of the inertial samples.
    pub samples: StampFigures,
}

impl SensorNews {
    /// Whether a reader has to be told: notices are other ones, or stamps went wrong. Frames that are sound are no news.
    fn is_news_after(&self, before: &Self) -> bool {
        self.notices != before.notices
            || self.frames.bad() != before.frames.bad()
            || self.samples.bad() != before.samples.bad()
    }

    fn bounded(mut self) -> Self {
        self.notices.truncate(MAX_NOTICES);
        for notice in &mut self.notices {
            let end = (0..=MAX_NOTICE_BYTES.min(notice.len())).rev().find(|at| notice.is_char_boundary(*at));
            notice.truncate(end.unwrap_or(0));
        }
        self
    }
}

/// The newest state, with a count of its changes.
#[derive(Debug, Default)]
pub(crate) struct SensorState(Mutex<(u64, SensorNews)>);

impl SensorState {
    /// The newest state, if it is another than that of count `seen`.
    pub(crate) fn after(&self, seen: u64) -> Option<(u64, SensorNews)> {
        let held = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        (held.0 != seen).then(|| held.clone())
    }

    /// The newest state.
    pub(crate) fn newest(&self) -> SensorNews {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).1.clone()
    }
}

/// Where the state of live sensors is posted for the readers of the local socket.
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

    /// Posts a state; readers receive it if it is news.
    pub fn post(&self, news: SensorNews) {
        let news = news.bounded();
        {
            let mut held = self.state.0.lock().unwrap_or_else(PoisonError::into_inner);
            if !news.is_news_after(&held.1) {
                return;
            }
            *held = (held.0 + 1, news);
        }
        (self.ring)();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sound_frames_are_no_news_and_bad_stamps_are() {
        let stamps = |used, restamped| StampFigures { used, restamped, ..StampFigures::default() };
        let of = |frames| SensorNews { frames, ..SensorNews::default() };
        assert!(!of(stamps(5, 0)).is_news_after(&of(stamps(1, 0))));
        assert!(of(stamps(5, 1)).is_news_after(&of(stamps(5, 0))));
        let long = SensorNews { notices: vec!["\u{e9}".repeat(999); 20], ..SensorNews::default() }.bounded();
        assert!(long.notices.len() == MAX_NOTICES && long.notices[0].len() <= MAX_NOTICE_BYTES);
    }
}
