//! Commands of readers, and what becomes of them.

use super::reader::{LocalReader, Rights};
use super::request::{Answer, Request, RequestStatus};
use crate::pipeline::{Control, MapRequest};
use plumbline_estimator::ResetKind;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Highest rate of pictures, mHz.
const MAX_PICTURES_MHZ: u32 = 30_000;
/// A map is copied with the next keyframe and brought to the disk: it takes at most this time.
const SAVE_PATIENCE: Duration = Duration::from_secs(15);

/// The one map that is being saved, and who asked for it.
#[derive(Debug)]
struct Save {
    /// Place of the reader; `None` once it has gone.
    place: Option<usize>,
    number: u64,
    request: MapRequest,
    end: Instant,
}

/// Carries out commands.
#[derive(Debug)]
pub struct CommandExecutor {
    control: Arc<Control>,
    save: Option<Save>,
}

impl CommandExecutor {
    /// Commands to the run of `control`.
    pub fn new(control: Arc<Control>) -> Self {
        Self { control, save: None }
    }

    /// True while a map is being saved.
    pub fn is_saving(&self) -> bool {
        self.save.is_some()
    }

    /// Carries out a request of the reader at `place`. The answer, unless it comes later.
    pub fn obey(
        &mut self,
        place: usize,
        reader: &mut LocalReader,
        number: u64,
        request: Option<Request>,
    ) -> Option<Answer> {
        let answer = |status, words: &str| Some(Answer { number, status, value: 0, words: words.into() });
        let Some(request) = request else {
            return answer(RequestStatus::Malformed, "no request of this version");
        };
        if !reader.rights.may_command() {
            let words = "commands are for root, the user of the flight and the group of the socket";
            return answer(RequestStatus::Refused, words);
        }
        match request {
            Request::Reset(kind) => {
                self.reset(kind, &reader.rights);
                answer(RequestStatus::Done, "the reset takes effect with the next frame")
            }
            Request::SaveMap => self.save_map(place, number),
            Request::Watch(mhz) => {
                reader.pictures_mhz = mhz.min(MAX_PICTURES_MHZ);
                answer(RequestStatus::Done, "")
            }
            Request::Subscribe(_) | Request::At(_) | Request::Ready | Request::Failed(_) | Request::Alive => {
                answer(RequestStatus::Refused, "only the network process of the flight reports")
            }
        }
    }

    fn reset(&self, kind: ResetKind, rights: &Rights) {
        // The network process says who asked.
        if let Rights::Command(user) = rights {
            let words = if kind == ResetKind::Soft { "soft" } else { "hard" };
            tracing::warn!("reset ({words}) on command of user {user} on the local socket");
        }
        self.control.ask_reset(kind);
    }

    fn save_map(&mut self, place: usize, number: u64) -> Option<Answer> {
        let refused = |words: &str| {
            Some(Answer { number, status: RequestStatus::Failed, value: 0, words: words.into() })
        };
        if self.is_saving() {
            return refused("busy: the map is being saved");
        }
        let Some(request) = self.control.map_saves().ask() else {
            return refused("this flight keeps no map: start it with --save-map FILE");
        };
        let end = Instant::now() + SAVE_PATIENCE;
        self.save = Some(Save { place: Some(place), number, request, end });
        None
    }

    /// The reader at `place` has gone.
    pub fn forget(&mut self, place: usize) {
        if let Some(save) = &mut self.save {
            save.place = save.place.filter(|waiting| *waiting != place);
        }
    }

    /// The answer to a map that was saved, or was not in time, and the place of its reader.
    pub fn saved(&mut self) -> Option<(usize, Answer)> {
        let save = self.save.as_ref()?;
        let (status, value, words) = match self.control.map_saves().outcome(save.request) {
            Some(Ok(keyframes)) => (RequestStatus::Done, keyframes, format!("{keyframes} keyframes saved")),
            Some(Err(words)) => (RequestStatus::Failed, 0, words),
            None if Instant::now() < save.end => return None,
            None => {
                let words = "the map was requested, but no keyframe has been added since; is there a pose?";
                (RequestStatus::Failed, 0, words.into())
            }
        };
        let answer = Answer { number: save.number, status, value, words };
        self.save.take().and_then(|save| save.place).map(|place| (place, answer))
    }
}
