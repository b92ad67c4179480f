//! The socket's thread: encodes what the run hands over, once, and serves the readers. It waits for nobody.

use super::LocalError;
use super::asked::Asked;
use super::commands::CommandExecutor;
use super::door::Door;
use super::listener::{Handed, SocketState, now_ns};
use super::picture::Shot;
use super::reader::{LocalReader, Rights};
use super::record::{Kind, Kinds, MAX_RECORD_BYTES, encoded};
use super::request::{Numbered, Request};
use super::words::{Admission, LinkWord};
use crate::pipeline::Control;
use crate::schedule::ladder::Rung;
use crate::schedule::lane::LaneReader;
use plumbline_estimator::places::MapPath;
use plumbline_record::messages::{Configuration, LadderRung, Picture};
use plumbline_record::{InstantSource, Said, layout, protobuf};
use plumbline_rings::places::gives_way;
use rustix::buffer::spare_capacity;
use rustix::event::Timespec;
use rustix::event::epoll::{self, CreateFlags, Event, EventData, EventFlags};
use rustix::fd::OwnedFd;
use std::os::unix::net::UnixStream;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::sync::mpsc::Receiver;
use std::time::{Duration, Instant};

/// Readers by the socket's path at a time, and those of one user.
const MAX_READERS: usize = 128;
const MAX_READERS_OF_A_USER: usize = 96;
/// That places are taken is logged this often at most.
const LOG_PERIOD: Duration = Duration::from_secs(30);
/// Records that wait for one reader, bytes: four seconds of odometry and estimates.
const OUTBOX_BYTES: usize = 512 * 1024;
/// Pictures that wait besides for a reader that wants them.
const OUTBOX_PICTURES: usize = 2;
/// At the end of the flight readers have so long to take what waits.
const LAST_WORDS: Duration = Duration::from_millis(500);
/// Where the system refuses another descriptor, nobody is accepted for so long.
const PAUSE: Duration = Duration::from_millis(200);
/// Time between two looks for a map that was saved.
const GLANCE: Duration = Duration::from_millis(20);
/// The thread looks around at least this often.
const IDLE: Duration = Duration::from_millis(500);
/// Events that are taken at a time.
const EVENTS: usize = 64;
/// Subject of an event: the bell, the listening socket, or a reader by its place and, above it, its number.
const BELL: u64 = 0;
const DOOR: u64 = 1;
const FIRST_READER: u64 = 2;
const NUMBER_SHIFT: u32 = 16;

/// The socket's thread.
pub struct Server {
    epoll: OwnedFd,
    shared: Arc<SocketState>,
    waiting: Vec<LaneReader<Handed>>,
    door: Option<Door>,
    /// Time before which no reader is accepted.
    pause_end: Option<Instant>,
    /// When it was logged last that places are taken.
    logged: Option<Instant>,
    admissions: Receiver<Admission>,
    readers: Vec<Option<LocalReader>>,
    /// Readers so far.
    admitted: u64,
    /// Bytes of the pictures that wait for one reader.
    picture_bytes: usize,
    commands: CommandExecutor,
    asked: Asked,
    configuration: Arc<[u8]>,
    newest_path: Option<MapPath>,
    health_bits: u32,
    rung: u8,
    /// Count of the changes of the sensors' state that were sent.
    sensor_changes: u64,
    sequences: [u64; Kind::ALL.len()],
}

impl Server {
    /// Server with nobody to serve; pictures are as large as `shot`.
    ///
    /// # Errors
    /// When the system has no more file descriptors.
    pub fn new(
        (shared, waiting): (Arc<SocketState>, Vec<LaneReader<Handed>>),
        door: Option<Door>,
        admissions: Receiver<Admission>,
        control: Arc<Control>,
        configuration: &Configuration,
        shot: &Shot,
    ) -> Result<Self, LocalError> {
        let failed = |error: rustix::io::Errno| LocalError::Thread(error.into());
        let epoll = epoll::create(CreateFlags::CLOEXEC).map_err(failed)?;
        epoll::add(&epoll, &shared.bell, EventData::new_u64(BELL), EventFlags::IN).map_err(failed)?;
        if let Some(door) = &door {
            epoll::add(&epoll, &door.listener, EventData::new_u64(DOOR), EventFlags::IN).map_err(failed)?;
        }
        let configuration = encoded(Kind::Configuration.kind(), 0, |to| protobuf::append(configuration, to));
        let picture_bytes = shot.image.pixels().len().min(MAX_RECORD_BYTES);
        Ok(Self {
            epoll,
            shared,
            waiting,
            door,
            pause_end: None,
            logged: None,
            admissions,
            readers: Vec::new(),
            admitted: 0,
            picture_bytes: OUTBOX_PICTURES * picture_bytes,
            asked: Asked::new(control.keep_instants()),
            commands: CommandExecutor::new(control),
            configuration: configuration.into(),
            newest_path: None,
            health_bits: 0,
            rung: 0,
            sensor_changes: 0,
            sequences: [0; Kind::ALL.len()],
        })
    }

    /// Serves until the flight is over, then sends what waits.
    pub fn run(mut self) {
        let mut events = Vec::with_capacity(EVENTS);
        loop {
            let is_last = self.shared.stop.load(Ordering::Acquire);
            let timeout = if is_last { Duration::ZERO } else { self.patience() };
            self.wait(&mut events, timeout);
            self.shared.pulse.busy();
            self.shared.bell.silence();
            self.encode_all();
            self.serve(&events);
            self.shared.pulse.idle();
            if is_last {
                return self.finish(&mut events);
            }
        }
    }

    fn patience(&self) -> Duration {
        if self.commands.is_saving() {
            GLANCE
        } else if self.pause_end.is_some() {
            PAUSE
        } else {
            IDLE
        }
    }

    fn wait(&self, events: &mut Vec<Event>, timeout: Duration) {
        let timeout = Timespec { tv_sec: 0, tv_nsec: timeout.subsec_nanos().into() };
        events.clear();
        // An interrupted wait has no events.
        let _ = epoll::wait(&self.epoll, spare_capacity(events), Some(&timeout));
    }

    /// Takes requests, hands out answers and records, and lets new readers in.
    fn serve(&mut self, events: &[Event]) {
        for event in events {
            let (data, flags) = (event.data, event.flags);
            match data.u64() {
                BELL => {}
                DOOR => self.accept(),
                subject => self.read(subject, flags),
            }
        }
        if self.pause_end.take_if(|end| Instant::now() >= *end).is_some() {
            self.listen(EventFlags::IN);
        }
        while let Ok(Admission { stream, words }) = self.admissions.try_recv() {
            self.admit(stream, (Rights::Link(words), None));
        }
        if let Some((place, answer)) = self.commands.saved()
            && let Some(reader) = self.readers.get_mut(place).and_then(Option::as_mut)
        {
            reader.outbox.push_kept(answer.encode());
        }
        self.flush();
    }

    fn accept(&mut self) {
        let Some(door) = &self.door else { return };
        match door.listener.accept() {
            Ok((stream, _)) => {
                let (rights, user) = door.rights(&stream);
                // Who finds no place is closed at once, and finds out.
                if self.has_place(user) {
                    self.admit(stream, (rights, user));
                }
            }
            Err(error) if error.kind() == std::io::ErrorKind::WouldBlock => {}
            Err(_) => {
                self.pause_end = Some(Instant::now() + PAUSE);
                self.listen(EventFlags::empty());
            }
        }
    }

    /// True if there is a place for a reader of this user; the one of the most numerous user's that does not read, or has been
    /// silent for longest, gives way to it.
    fn has_place(&mut self, user: Option<u32>) -> bool {
        let readers = || self.readers.iter().flatten();
        let is_crowd = readers().filter(|reader| reader.user == user).count() >= MAX_READERS_OF_A_USER;
        if !is_crowd && readers().count() < MAX_READERS {
            return true;
        }
        let now = Instant::now();
        let candidates = self.readers.iter().enumerate().filter_map(|(place, slot)| {
            let reader = slot.as_ref().filter(|reader| !is_crowd || reader.user == user)?;
            Some((place, reader.user, reader.silence(now)))
        });
        let Some((place, silence)) = gives_way(candidates) else { return false };
        let crowd = self.readers[place].take().and_then(|reader| reader.user);
        if self.logged.is_none_or(|logged| now.saturating_duration_since(logged) >= LOG_PERIOD) {
            self.logged = Some(now);
            let whose = crowd.map_or_else(|| "an unknown user".into(), |user| format!("user {user}"));
            let how =
                if silence.is_unread() { "that does not read" } else { "that has asked nothing for longest" };
            tracing::warn!(
                "local socket: no place is free for another reader ({MAX_READERS} in all, {MAX_READERS_OF_A_USER} of one user); \
                 the one of {whose} {how} is disconnected"
            );
        }
        self.forget(place);
        true
    }

    /// Waits for new readers, or does not.
    fn listen(&self, flags: EventFlags) {
        if let Some(door) = &self.door {
            let _ = epoll::modify(&self.epoll, &door.listener, EventData::new_u64(DOOR), flags);
        }
    }

    fn admit(&mut self, stream: UnixStream, rights: (Rights, Option<u32>)) {
        let place = self.readers.iter().position(Option::is_none).unwrap_or(self.readers.len());
        let subject = (self.admitted << NUMBER_SHIFT) + place as u64 + FIRST_READER;
        let is_set = stream.set_nonblocking(true).is_ok();
        if !is_set || epoll::add(&self.epoll, &stream, EventData::new_u64(subject), EventFlags::IN).is_err() {
            return;
        }
        self.admitted += 1;
        let reader = LocalReader::new(stream, subject, rights, OUTBOX_BYTES, self.shared.lost());
        if place == self.readers.len() {
            self.readers.push(None);
        }
        self.readers[place] = Some(reader);
        self.note_wants();
    }

    /// Reads the requests of a reader, and carries them out; one that has gone is let go. The event may be of a reader that gave way
    /// to another, which has its place.
    fn read(&mut self, subject: u64, flags: EventFlags) {
        let place = (subject & ((1 << NUMBER_SHIFT) - 1)).saturating_sub(FIRST_READER) as usize;
        let Some(slot) = self.readers.get_mut(place) else { return };
        let Some(mut reader) = slot.take_if(|reader| reader.subject == subject) else { return };
        if flags.contains(EventFlags::OUT) {
            reader.has_room();
        }
        let before = (reader.kinds, reader.pictures_mhz);
        let outcome = reader.read(|reader, request| self.obey(place, reader, request));
        let is_there = outcome.is_ok() && !flags.intersects(EventFlags::HUP | EventFlags::ERR);
        let has_changed = !is_there || before != (reader.kinds, reader.pictures_mhz);
        if is_there {
            self.readers[place] = Some(reader);
        } else {
            self.forget(place);
        }
        if has_changed {
            self.note_wants();
        }
    }

    fn obey(&mut self, place: usize, reader: &mut LocalReader, Numbered { number, request }: Numbered) {
        if let Some(Request::Subscribe(kinds)) = request {
            reader.kinds = kinds;
            if kinds.has(Kind::Configuration) {
                reader.outbox.push_kept(Arc::clone(&self.configuration));
            }
            if kinds.has(Kind::Ladder) {
                reader.outbox.push_kept(self.ladder());
            }
            if kinds.has(Kind::Sensors) {
                let news = self.shared.sensors.newest();
                let sequence = self.sequences[Kind::Sensors as usize];
                reader.outbox.push_kept(encoded(Kind::Sensors.kind(), sequence, |to| {
                    protobuf::append(&news, to);
                }));
            }
            if let (true, Some(path)) = (kinds.has(Kind::Path), &self.newest_path) {
                reader.outbox.push(&encode_path(path, self.sequences[Kind::Path as usize]));
            }
            if let Rights::Link(words) = &reader.rights {
                words.tell(LinkWord::Begun);
            }
            return;
        }
        let answer = match request {
            Some(Request::At(at)) => self.asked.ask(place, reader, number, at),
            request => self.commands.obey(place, reader, number, request),
        };
        if let Some(answer) = answer {
            reader.outbox.push_kept(answer.encode());
            let pictures = if reader.pictures_mhz > 0 { self.picture_bytes } else { 0 };
            reader.outbox.bound(OUTBOX_BYTES + pictures);
        }
    }

    fn forget(&mut self, place: usize) {
        self.commands.forget(place);
        self.asked.forget(place);
    }

    /// Tells the run what is wanted.
    fn note_wants(&self) {
        let readers = || self.readers.iter().flatten();
        let kinds = readers().fold(Kinds::default(), |all, reader| all.and(reader.kinds));
        self.shared.want(kinds, readers().map(|reader| reader.pictures_mhz).max().unwrap_or(0));
    }

    /// Writes what waits; readers that have gone are let go.
    fn flush(&mut self) {
        let (upstream, mut has_gone) = (self.shared.lost(), false);
        for (place, slot) in self.readers.iter_mut().enumerate() {
            let Some(reader) = slot else { continue };
            let mut is_there = reader.flush(upstream).is_ok();
            let interest = reader.wanted_interest();
            if is_there && interest != reader.interest {
                reader.interest = interest;
                let data = EventData::new_u64(reader.subject);
                is_there = epoll::modify(&self.epoll, &reader.stream, data, interest).is_ok();
            }
            if !is_there {
                *slot = None;
                self.commands.forget(place);
                self.asked.forget(place);
                has_gone = true;
            }
        }
        if has_gone {
            self.note_wants();
        }
    }

    /// Encodes what the run has handed over, and gives it to those who want it.
    fn encode_all(&mut self) {
        for producer in 0..self.waiting.len() {
            while let Some(handed) = self.waiting[producer].pop() {
                self.encode(&handed);
            }
        }
        let shared = Arc::clone(&self.shared);
        while shared.snapshots.read(|s| self.send(Kind::Window, |to| protobuf::append(s, to))).is_some() {}
        while shared.trails.read(|trail| self.send(Kind::Trail, |to| protobuf::append(trail, to))).is_some() {
        }
        while shared
            .shots
            .read(|s| self.send(Kind::Picture, |to| protobuf::append(&Picture::from(&*s), to)))
            .is_some()
        {}
        self.encode_path();
        if let Some((changes, news)) = shared.sensors.after(self.sensor_changes) {
            self.sensor_changes = changes;
            self.send(Kind::Sensors, |to| protobuf::append(&news, to));
        }
        let rung = shared.rung.load(Ordering::Relaxed);
        if rung != self.rung {
            self.rung = rung;
            self.offer(Kind::Ladder, self.ladder());
        }
    }

    /// Encodes something that the run has said.
    fn encode(&mut self, (said, handed_over_ns): &Handed) {
        match said {
            Said::Odometry(odometry) => {
                let health_bits = self.health_bits;
                let record = encoded(Kind::Odometry.kind(), odometry.sequence, |to| {
                    layout::put_odometry(odometry, *handed_over_ns, health_bits, to);
                });
                self.offer(Kind::Odometry, record);
            }
            Said::Instant(answer) if answer.source == InstantSource::Request => {
                if let Some((place, record)) = self.asked.answered(answer, *handed_over_ns)
                    && let Some(reader) = self.readers.get_mut(place).and_then(Option::as_mut)
                {
                    reader.outbox.push_kept(record);
                }
            }
            Said::Instant(answer) => {
                self.send(Kind::Instant, |to| layout::put_instant(answer, *handed_over_ns, to));
            }
            Said::Estimate(full) => {
                self.health_bits = full.estimate.health.0;
                self.send(Kind::Estimate, |to| layout::put_estimate(&full.estimate, *handed_over_ns, to));
                self.send(Kind::FullEstimate, |to| protobuf::append(full, to));
            }
            said => {
                if let Some(record) = said.record() {
                    self.send(said.topic(), |to| protobuf::append(record, to));
                }
            }
        }
    }

    /// Encodes the newest of the paths that wait, and keeps it for readers that come later.
    fn encode_path(&mut self) {
        let shared = Arc::clone(&self.shared);
        let mut is_new = false;
        while shared.paths.read(|path| self.newest_path.get_or_insert_default().clone_from(path)).is_some() {
            is_new = true;
        }
        if let Some(path) = self.newest_path.take_if(|_| is_new) {
            self.send(Kind::Path, |to| protobuf::append(&path, to));
            self.newest_path = Some(path);
        }
    }

    fn ladder(&self) -> Vec<u8> {
        encoded(Kind::Ladder.kind(), 0, |to| protobuf::append(&ladder(self.rung), to))
    }

    /// Encodes a record if a reader wants its kind.
    fn send(&mut self, kind: Kind, fill: impl FnOnce(&mut Vec<u8>)) {
        if self.readers.iter().flatten().any(|reader| reader.wants(kind)) {
            let record = encoded(kind.kind(), self.sequences[kind as usize], fill);
            self.offer(kind, record);
        }
        self.sequences[kind as usize] += 1;
    }

    fn offer(&mut self, kind: Kind, record: Vec<u8>) {
        if record.len() > MAX_RECORD_BYTES {
            return;
        }
        let record: Arc<[u8]> = record.into();
        self.readers.iter_mut().flatten().for_each(|reader| reader.offer(kind, &record));
    }

    /// The flight is over: readers have a while to take what waits.
    fn finish(mut self, events: &mut Vec<Event>) {
        let end: Arc<[u8]> = encoded(Kind::End.kind(), 0, |to| to.extend(now_ns().to_le_bytes())).into();
        self.readers.iter_mut().flatten().for_each(|reader| reader.outbox.push_kept(Arc::clone(&end)));
        let patience_end = Instant::now() + LAST_WORDS;
        loop {
            self.flush();
            let is_done = self.readers.iter().flatten().all(|reader| reader.outbox.is_empty());
            if is_done || Instant::now() >= patience_end {
                return;
            }
            self.wait(events, GLANCE);
        }
    }
}

/// Message of a rung of the ladder.
fn ladder(level: u8) -> LadderRung {
    let name = Rung::of_level(level).unwrap_or(Rung::Full).name();
    LadderRung { level: level.into(), name: name.into() }
}

fn encode_path(path: &MapPath, sequence: u64) -> Arc<[u8]> {
    encoded(Kind::Path.kind(), sequence, |to| protobuf::append(path, to)).into()
}

#[cfg(test)]
mod tests {
    use super::*;
    use plumbline_config::Config;
    use std::sync::mpsc::channel;

    #[test]
    fn a_hang_up_of_an_evicted_reader_leaves_its_successor_connected() {
        let config = Config::preset("sim").unwrap();
        let (shared, _writers, waiting) = SocketState::new(&config).unwrap();
        let (_admissions, admitted) = channel();
        let (control, about) = (Arc::default(), Configuration::default());
        let readers = (Arc::new(shared), waiting);
        let mut server = Server::new(readers, None, admitted, control, &about, &Shot::new(&config)).unwrap();
        let (first, second) = (UnixStream::pair().unwrap(), UnixStream::pair().unwrap());
        server.admit(first.0, (Rights::Read, None));
        let hang_up = Event {
            flags: EventFlags::HUP,
            data: EventData::new_u64(server.readers[0].as_ref().unwrap().subject),
        };
        server.readers[0] = None;
        server.admit(second.0, (Rights::Read, None));
        server.serve(&[hang_up]);
        assert!(server.readers[0].is_some());
    }
}
