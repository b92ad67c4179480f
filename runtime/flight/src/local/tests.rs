//! The socket as its readers see it.

use super::record::{Header, Kind, Kinds, encoded};
use super::request::{Answer, At, Failure, Request, RequestStatus};
use super::{LinkWord, LocalSocket};
use crate::fuzzing::fixture;
use crate::pipeline::instants::{InstantDesk, Standing};
use crate::pipeline::listener::{Listener, ListenerView, Producer, Subscriber as _};
use crate::pipeline::{Control, Stamps};
use plumbline_client::{ClientError, Local};
use plumbline_config::{Config, Timestamp, ValidConfig};
use plumbline_estimator::{Estimate, Odometry, ResetKind, TrackingState};
use plumbline_record::local::content::LocalRecord;
use plumbline_record::messages::LadderRung;
use plumbline_record::said::FullEstimate;
use plumbline_record::{InstantAnswer, InstantSource, Said};
use std::io::Write as _;
use std::net::Shutdown;
use std::os::unix::net::UnixStream;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::mpsc::channel;
use std::time::{Duration, Instant};

/// No reader waits longer.
const PATIENCE: Duration = Duration::from_secs(10);

/// A flight that hands out what the test gives it.
struct Flight {
    socket: LocalSocket,
    control: Arc<Control>,
    tick: Box<dyn Listener>,
    window: Box<dyn Listener>,
    path: PathBuf,
    sequence: u64,
    _folder: tempfile::TempDir,
}

impl Flight {
    fn start() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("local");
        let change = |config: &mut Config| config.local.path = path.display().to_string();
        let config: ValidConfig = Config::preset("sim").unwrap().with("test", change).unwrap();
        let control = Arc::new(Control::default());
        let mut socket = LocalSocket::start(&config, Stamps::Replayed, Arc::clone(&control)).unwrap();
        let (tick, window) = (socket.listener(Producer::Tick), socket.listener(Producer::Window));
        Self { socket, control, tick, window, path, sequence: 0, _folder: folder }
    }

    fn stream(&self) -> UnixStream {
        let stream = UnixStream::connect(&self.path).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        stream
    }

    /// A reader that has been greeted.
    fn reader(&self) -> Local {
        let mut client = Local::over(self.stream());
        assert_eq!(client.next_record().unwrap(), LocalRecord::Hello(true));
        client
    }

    fn tick(&mut self) -> Odometry {
        self.sequence += 1;
        let odometry = Odometry { sequence: self.sequence, ..fixture::odometry() };
        self.tick.said(&Said::Odometry(odometry.clone()));
        odometry
    }

    fn end(self) {
        drop(self.socket);
    }
}

fn said(estimate: Estimate) -> Said {
    Said::Estimate(FullEstimate { estimate, frame_ms: 3.5 })
}

fn answer(client: &mut Local) -> Answer {
    loop {
        if let LocalRecord::Answer(answer) = client.next_record().unwrap() {
            return answer;
        }
    }
}

#[test]
fn a_reader_receives_odometry_and_estimates_without_a_request() {
    let mut flight = Flight::start();
    let mut reader = flight.reader();
    let sent = flight.tick();
    let LocalRecord::Odometry(got, _) = reader.next_record().unwrap() else { panic!() };
    assert_eq!(*got, sent);
    flight.window.said(&said(fixture::estimate()));
    assert_eq!(reader.next_record().unwrap(), LocalRecord::Other(Kind::Estimate.kind()));
    flight.end();
    assert_eq!(reader.next_record().unwrap(), LocalRecord::End);
    assert!(matches!(reader.next_record(), Err(ClientError::Closed)));
}

#[test]
fn a_reader_receives_what_it_subscribes_to_and_the_configuration_at_once() {
    let mut flight = Flight::start();
    let mut reader = flight.reader();
    let kinds = Kinds::of(&[Kind::Configuration, Kind::FullEstimate, Kind::Ladder]);
    reader.requests().unwrap().send(&Request::Subscribe(kinds)).unwrap();
    let LocalRecord::Configuration(configuration) = reader.next_record().unwrap() else { panic!() };
    assert!(configuration.toml.contains("[local]") && !configuration.stamps_of_host);
    assert_eq!(
        reader.next_record().unwrap(),
        LocalRecord::Ladder(LadderRung { level: 0, name: "full".into() })
    );
    flight.tick();
    let sent = Estimate { origin: Default::default(), ..fixture::estimate() };
    flight.window.said(&said(sent.clone()));
    assert_eq!(reader.next_record().unwrap(), LocalRecord::Estimate(Box::new(sent), 3.5));
}

#[test]
fn a_reader_that_falls_behind_is_told_what_it_has_lost_and_the_others_lose_nothing() {
    const RECORDS: u64 = 4_000;
    let mut flight = Flight::start();
    let (mut slow, mut quick) = (flight.reader(), flight.reader());
    for _ in 0..RECORDS {
        let sent = flight.tick();
        let LocalRecord::Odometry(got, _) = quick.next_record().unwrap() else { panic!() };
        assert_eq!(got.sequence, sent.sequence);
    }
    let (mut lost, mut got) = (0, Vec::new());
    while !got.ends_with(&[RECORDS]) {
        match slow.next_record().unwrap() {
            LocalRecord::Lost(count) => lost = count,
            LocalRecord::Odometry(odometry, _) => got.push(odometry.sequence),
            other => panic!("{other:?}"),
        }
    }
    flight.end();
    assert!(lost > 0 && lost + got.len() as u64 == RECORDS, "{lost} lost, {} received", got.len());
    assert!(got.is_sorted());
}

#[test]
fn commands_reach_the_run_and_are_answered() {
    let flight = Flight::start();
    let mut reader = flight.reader();
    let mut requests = reader.requests().unwrap();
    let number = requests.send(&Request::Reset(ResetKind::Hard)).unwrap();
    let done = answer(&mut reader);
    assert_eq!((done.number, done.status), (number, RequestStatus::Done));
    assert_eq!(flight.control.take_reset(), Some(ResetKind::Hard));
    requests.send(&Request::SaveMap).unwrap();
    let refused = answer(&mut reader);
    assert_eq!(refused.status, RequestStatus::Failed);
    assert!(refused.words.contains("--save-map"), "{}", refused.words);
    flight.control.map_saves().open();
    requests.send(&Request::SaveMap).unwrap();
    requests.send(&Request::SaveMap).unwrap();
    assert!(answer(&mut reader).words.contains("busy"));
    assert!(flight.control.map_saves().take());
    flight.control.map_saves().tell(Ok(7));
    let saved = answer(&mut reader);
    assert_eq!((saved.status, saved.value), (RequestStatus::Done, 7));
}

#[test]
fn what_is_no_request_is_refused_and_does_nothing() {
    let flight = Flight::start();
    let mut stream = flight.stream();
    let mut reader = Local::over(stream.try_clone().unwrap());
    stream.write_all(&encoded(999, 4, |to| to.push(1))).unwrap();
    stream.write_all(&Request::Alive.encode(5)).unwrap();
    let failed = Request::Failed(Failure { is_usage: false, words: "no".into() });
    stream.write_all(&failed.encode(6)).unwrap();
    let statuses =
        [answer(&mut reader), answer(&mut reader), answer(&mut reader)].map(|a| (a.number, a.status));
    assert_eq!(
        statuses,
        [(4, RequestStatus::Malformed), (5, RequestStatus::Refused), (6, RequestStatus::Refused)]
    );
    // After a length beyond bounds nothing can be understood.
    stream.write_all(&Header { kind: 1, length: u32::MAX, ..Header::default() }.encode()).unwrap();
    assert!(matches!(reader.next_record(), Err(ClientError::Closed)));
    assert_eq!(flight.control.take_reset(), None);
}

#[test]
fn a_reader_that_floods_requests_and_reads_nothing_is_not_read_from() {
    let flight = Flight::start();
    let mut stream = flight.stream();
    stream.set_write_timeout(Some(Duration::from_millis(300))).unwrap();
    let request = Request::Reset(ResetKind::Soft).encode(1);
    let mut sent = 0;
    while stream.write_all(&request).is_ok() {
        sent += 1;
        assert!(sent < 100_000, "its requests are read without end");
    }
    // The others are served.
    let mut reader = flight.reader();
    reader.requests().unwrap().send(&Request::Reset(ResetKind::Hard)).unwrap();
    assert_eq!(answer(&mut reader).status, RequestStatus::Done);
}

#[test]
fn a_half_open_reader_goes_on_reading_beside_more_readers_than_places() {
    let mut flight = Flight::start();
    let stream = flight.stream();
    let mut half_open = Local::over(stream.try_clone().unwrap());
    assert_eq!(half_open.next_record().unwrap(), LocalRecord::Hello(true));
    stream.shutdown(Shutdown::Write).unwrap();
    // It is known to read: it has taken more than a socket holds.
    for _ in 0..6_000 {
        let sent = flight.tick();
        let LocalRecord::Odometry(got, _) = half_open.next_record().unwrap() else { panic!() };
        assert_eq!(got.sequence, sent.sequence);
    }
    // Each newcomer is greeted; the one that came first and has asked nothing makes way.
    let mut readers: Vec<Local> = (0..128).map(|_| flight.reader()).collect();
    assert!(matches!(readers[0].next_record(), Err(ClientError::Closed)));
    drop(readers);
    let sent = flight.tick();
    let LocalRecord::Odometry(got, _) = half_open.next_record().unwrap() else { panic!() };
    assert_eq!(got.sequence, sent.sequence);
}

#[test]
fn reports_of_the_network_process_reach_its_keeper() {
    let flight = Flight::start();
    let ((ours, theirs), (words, said)) = (UnixStream::pair().unwrap(), channel());
    assert!(flight.socket.link_door().admit(ours, words));
    let mut requests = Local::over(theirs).requests().unwrap();
    requests.send(&Request::Subscribe(Kinds::DEFAULT)).unwrap();
    requests.send(&Request::Ready).unwrap();
    requests.send(&Request::Alive).unwrap();
    for word in [LinkWord::Begun, LinkWord::Ready, LinkWord::Alive] {
        assert_eq!(said.recv_timeout(PATIENCE).unwrap(), word);
    }
    requests.close();
    assert!(said.recv_timeout(PATIENCE).is_err(), "its keeper learns that it has gone");
}

/// True if a reader that comes now is greeted, and receives the odometry of the next tick.
fn is_served(flight: &mut Flight) -> bool {
    let mut client = Local::over(flight.stream());
    if client.next_record().ok() != Some(LocalRecord::Hello(true)) {
        return false;
    }
    flight.tick();
    (0..600).any(|_| matches!(client.next_record(), Ok(LocalRecord::Odometry(..))))
}

#[test]
fn silent_readers_give_way_to_new_ones_and_one_that_reads_stays() {
    let mut flight = Flight::start();
    let mut honest = flight.reader();
    // It has taken more than a socket holds.
    for _ in 0..6_000 {
        flight.tick();
        while !matches!(honest.next_record().unwrap(), LocalRecord::Odometry(..)) {}
    }
    let silent: Vec<UnixStream> = (0..150).map(|_| flight.stream()).collect();
    (0..10).for_each(|_| assert!(is_served(&mut flight), "those that asked nothing give way"));
    // Until their sockets are full.
    let end = Instant::now() + Duration::from_secs(4);
    while Instant::now() < end {
        flight.tick();
        while !matches!(honest.next_record().unwrap(), LocalRecord::Odometry(..)) {}
    }
    (0..10).for_each(|_| assert!(is_served(&mut flight), "those that do not read give way"));
    flight.tick();
    while !matches!(honest.next_record().unwrap(), LocalRecord::Odometry(..)) {}
    drop(silent);
    flight.end();
}

#[test]
fn odometry_goes_on_blind_and_late_readings_are_left_out() {
    let mut flight = Flight::start();
    let mut reader = flight.reader();
    let last = flight.tick();
    let at = |ms: i64| last.stamp.plus_nanos(ms * 1_000_000);
    let blind = Odometry { stamp: at(300), state: TrackingState::Blind, quality: 0, ..last.clone() };
    flight.tick.shown(ListenerView::Blind(&blind));
    for ms in [100, 299, 305] {
        let odometry = Odometry { stamp: at(ms), sequence: last.sequence + 1, ..last.clone() };
        flight.tick.said(&Said::Odometry(odometry));
    }
    let mut next = || loop {
        if let LocalRecord::Odometry(odometry, _) = reader.next_record().unwrap() {
            break (odometry.stamp, odometry.state, odometry.quality);
        }
    };
    assert_eq!(next(), (last.stamp, last.state, last.quality));
    assert_eq!(next(), (at(300), TrackingState::Blind, 0));
    assert_eq!(next(), (at(305), last.state, last.quality));
    flight.end();
}

fn at(stamp_ns: i64, patience_ms: u32) -> Request {
    Request::At(At { stamp: Timestamp::from_nanos(stamp_ns), patience_ms, is_settled: false })
}

#[test]
fn a_state_at_an_instant_goes_to_the_one_who_asked() {
    let mut flight = Flight::start();
    let mut desk = InstantDesk::new(flight.control.keep_instants());
    let [mut first, mut second] = [flight.reader(), flight.reader()];
    let numbers: Vec<u64> =
        [&first, &second].map(|reader| reader.requests().unwrap().send(&at(7, 500)).unwrap()).into();
    assert_eq!(numbers, [1, 1], "readers number their requests themselves");
    let mut next = |is_reached| desk.next(&mut 0, |_| Standing { is_reached, is_settled: false });
    let mut asked = Vec::new();
    let end = Instant::now() + PATIENCE;
    while asked.len() < 2 && Instant::now() < end {
        asked.extend(next(true));
    }
    for (source, number, stamp) in asked.into_iter().rev() {
        let mut answer = InstantAnswer { number, source, ..InstantAnswer::default() };
        (answer.instant.stamp, answer.instant.quality) = (stamp, number as i8);
        flight.tick.said(&Said::Instant(answer));
    }
    for (reader, quality) in [&mut first, &mut second].into_iter().zip([0, 1]) {
        let LocalRecord::Instant(answer, _) = reader.next_record().unwrap() else { panic!("no answer") };
        assert_eq!((answer.sequence, answer.number, answer.instant.quality), (1, 1, quality));
        assert_eq!((answer.source, answer.instant.stamp.as_nanos()), (InstantSource::Request, 7));
    }
}

#[test]
fn an_instant_that_does_not_come_is_refused_when_the_patience_ends() {
    let flight = Flight::start();
    let mut desk = InstantDesk::new(flight.control.keep_instants());
    let reader = flight.reader();
    let begin = Instant::now();
    reader.requests().unwrap().send(&at(7, 60)).unwrap();
    let mut next = || desk.next(&mut 0, |_| Standing { is_reached: false, is_settled: false });
    while next().is_none() {
        assert!(begin.elapsed() < PATIENCE);
    }
    assert!(begin.elapsed() >= Duration::from_millis(60));
}

#[test]
fn states_at_triggers_go_to_those_who_subscribed() {
    let mut flight = Flight::start();
    let [mut wants, mut does_not] = [flight.reader(), flight.reader()];
    wants.requests().unwrap().send(&Request::Subscribe(Kinds::of(&[Kind::Instant]))).unwrap();
    let end = Instant::now() + PATIENCE;
    let trigger =
        |number| InstantAnswer { number, source: InstantSource::Trigger, ..InstantAnswer::default() };
    // Until the subscription has arrived.
    for number in 1.. {
        flight.tick.said(&Said::Instant(trigger(number)));
        std::thread::sleep(Duration::from_millis(5));
        if number > 20 || Instant::now() > end {
            break;
        }
    }
    let LocalRecord::Instant(answer, _) = wants.next_record().unwrap() else { panic!("no answer") };
    assert_eq!(answer.source, InstantSource::Trigger);
    flight.end();
    assert_eq!(does_not.next_record().unwrap(), LocalRecord::End);
}

#[test]
fn more_requests_than_are_answered_are_refused_and_cost_nobody_else() {
    let flight = Flight::start();
    let mut desk = InstantDesk::new(flight.control.keep_instants());
    let mut greedy = flight.reader();
    let mut requests = greedy.requests().unwrap();
    for _ in 0..100 {
        requests.send(&at(i64::MAX, 2_000)).unwrap();
    }
    for _ in 0..100 - 32 {
        let LocalRecord::Answer(answer) = greedy.next_record().unwrap() else { panic!("no answer") };
        assert!(answer.status == RequestStatus::Failed && answer.words.starts_with("busy"), "{answer:?}");
    }
    let modest = flight.reader();
    modest.requests().unwrap().send(&at(7, 2_000)).unwrap();
    let end = Instant::now() + PATIENCE;
    let reached = |stamp: Timestamp| Standing { is_reached: stamp.as_nanos() == 7, is_settled: false };
    while desk.next(&mut 0, reached).is_none() {
        assert!(Instant::now() < end);
    }
}
