//! The bridge's thread: sends on its deadlines, and answers in between.

use super::feed::MessageFeed;
use super::frames::VehicleFrames;
use super::handover::{FlowHandover, Handover, Signals};
use super::inbox::{CHUNK, MavlinkInbox, Received};
use super::link::AutopilotLink;
use super::message;
use super::status::{Announcer, FlowSwitch, OdometryCondition};
use super::timesync::TimeSync;
use super::words::{News, apart, teller};
use crate::pipeline::{InstantRequest, Instants};
use crate::schedule::ring::{Reader, Writer};
use crate::schedule::ticker::{Monotonic, Ticker};
use crate::schedule::times::{Percentiles, Times};
use crate::schedule::watchdog::Pulse;
use mavlink::dialects::common::{
    CAMERA_TRIGGER_DATA, DISTANCE_SENSOR_DATA, HEARTBEAT_DATA, MavComponent, ODOMETRY_DATA,
    OPTICAL_FLOW_DATA, OPTICAL_FLOW_RAD_DATA, STATUSTEXT_DATA, TIMESYNC_DATA,
};
use mavlink::{MAVLinkV2MessageRaw, MavHeader, MessageData};
use plumbline_config::Timestamp;
use plumbline_config::options::{AutopilotClock, AutopilotConfig};
use plumbline_record::InstantSource;
use serde::Serialize;
use std::fmt;
use std::sync::Arc;
use std::sync::atomic::Ordering;

/// We are this component of the vehicle.
pub const COMPONENT: u8 = MavComponent::MAV_COMP_ID_VISUAL_INERTIAL_ODOMETRY as u8;
/// The autopilot is this one.
pub const AUTOPILOT: u8 = MavComponent::MAV_COMP_ID_AUTOPILOT1 as u8;
/// Between signs of life, ns.
const HEARTBEAT_NS: i64 = 1_000_000_000;
/// The autopilot is silent after this, ns.
const SILENCE_NS: i64 = 5_000_000_000;
/// Reads and answers between two deadlines, at most: who floods the line gets no more of the processor.
const MAX_READS: usize = 64;
const MAX_ANSWERS: usize = 8;
/// The state at a trigger is waited for so long, ns: a stamp that is later is of another clock.
const TRIGGER_PATIENCE_NS: i64 = 500_000_000;
/// Triggers that follow each other faster are passed over, ns: no camera is as fast, and whoever forges them gets no more of the
/// odometry's thread.
const TRIGGER_PERIOD_NS: i64 = 8_000_000;

/// Figures of the bridge.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct BridgeFigures {
    /// `ODOMETRY` messages that the system took.
    pub odometry: u64,
    /// Messages sent without a valid pose, with quality -1.
    pub invalid: u64,
    /// Messages of any kind that the system did not take.
    pub unsent: u64,
    /// Deadlines that passed unseen.
    pub missed: u64,
    /// Lateness of deadlines, ms.
    pub late_ms: Percentiles,
    /// Messages that came in.
    pub received: u64,
    /// Messages that came in and made no sense.
    pub malformed: u64,
    /// Bytes that came in and were part of no known message.
    pub passed_over_bytes: u64,
    /// The autopilot's clock less ours, ms, when TIMESYNC had locked.
    pub clock_offset_ms: Option<f64>,
    /// The quickest round trip of the last ones, ms.
    pub round_trip_ms: Option<f64>,
    /// Camera triggers whose state was asked for.
    pub triggers: u64,
    /// Measurements of optical flow that were sent.
    pub flow: u64,
    /// Distances of the ground that were sent.
    pub distances: u64,
}

impl fmt::Display for BridgeFigures {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} odometry messages, {} of them invalid (quality -1)", self.odometry, self.invalid)?;
        write!(
            f,
            "; late p50 {:.2}, p99 {:.2}, max {:.2} ms",
            self.late_ms.p50, self.late_ms.p99, self.late_ms.max
        )?;
        match self.clock_offset_ms {
            Some(offset) => write!(f, "; the autopilot's clock is {}", apart(offset)),
            None => write!(f, "; the autopilot's clock is unknown"),
        }
    }
}

/// Owns the line.
pub struct Sender {
    link: AutopilotLink,
    feed: MessageFeed,
    clock: AutopilotClock,
    words: Writer<News>,
    header: MavHeader,
    timesync: TimeSync,
    /// The autopilot's clock less ours, ns, as it was told last.
    told_offset_ns: Option<i64>,
    /// System and component whose time answers count, if several answer.
    time_source: Option<(u32, u8)>,
    announcer: Announcer,
    flow_switch: FlowSwitch,
    heartbeat: Monotonic,
    /// When the autopilot was last heard.
    heard: Option<Monotonic>,
    is_heard: bool,
    began: Monotonic,
    late_ms: Times,
    figures: BridgeFigures,
    /// Entrance for requests of states at camera triggers; `None` if the flight does not answer them.
    instants: Option<Arc<Instants>>,
    /// Time of the host less that of the data, ns, once there was odometry.
    host_ahead_ns: Option<i64>,
    /// Time of the last trigger.
    triggered: Monotonic,
}

impl Sender {
    /// A sender that has sent nothing.
    pub fn new(config: &AutopilotConfig, link: AutopilotLink, frames: VehicleFrames) -> Self {
        Self {
            link,
            feed: MessageFeed::new(frames, config.lost_pose),
            clock: config.clock,
            words: teller(config.connect.clone()),
            header: MavHeader { system_id: config.system_id, component_id: COMPONENT, sequence: 0 },
            timesync: TimeSync::default(),
            told_offset_ns: None,
            time_source: None,
            announcer: Announcer::default(),
            flow_switch: FlowSwitch::new(config.flow),
            heartbeat: Monotonic(i64::MIN),
            heard: None,
            is_heard: true,
            began: Monotonic::now(),
            late_ms: Times::default(),
            figures: BridgeFigures::default(),
            instants: None,
            host_ahead_ns: None,
            triggered: Monotonic(i64::MIN),
        }
    }

    /// Sends at every release of `ticker` until told to stop, and says so at the end.
    #[must_use]
    pub fn run(
        mut self,
        signals: &Signals,
        mut waiting: Reader<Handover>,
        mut flows: Reader<FlowHandover>,
        mut ticker: Ticker,
        pulse: &Pulse,
    ) -> BridgeFigures {
        let mut inbox = MavlinkInbox::default();
        while !signals.stop.load(Ordering::Relaxed) {
            self.listen_until(ticker.due(), &mut inbox);
            let release = ticker.wait();
            pulse.busy();
            self.figures.missed += release.missed;
            self.late_ms.record(release.late_ms);
            if self.instants.is_none() {
                self.instants = signals.instants.get().cloned();
            }
            while let Some(newer) = waiting.pop() {
                let stamp_ns = newer.odometry.stamp.as_nanos();
                self.host_ahead_ns = Some(newer.measured.0.saturating_sub(stamp_ns));
                self.feed.take(newer);
            }
            let now = Monotonic::now();
            let condition = self.condition(signals.has_pose.load(Ordering::Relaxed), now);
            self.ask_for_the_time();
            self.send_odometry(condition, now);
            self.flow_switch.update(self.feed.is_usable(condition), now);
            while let Some(newer) = flows.pop() {
                self.send_flow(&newer, now);
            }
            self.send_others(condition, now);
            self.watch(now);
        }
        let now = Monotonic::now();
        self.send_odometry(OdometryCondition::Stopped, now);
        self.announce(OdometryCondition::Stopped, now);
        self.figures(&inbox)
    }

    fn figures(&self, inbox: &MavlinkInbox) -> BridgeFigures {
        let inbox = inbox.figures();
        let ms = |ns: i64| ns as f64 * 1e-6;
        BridgeFigures {
            late_ms: self.late_ms.percentiles(),
            received: inbox.messages,
            malformed: inbox.malformed,
            passed_over_bytes: inbox.passed_over,
            clock_offset_ms: self.timesync.offset_ns().map(ms),
            round_trip_ms: self.timesync.round_trip_ns().map(ms),
            ..self.figures
        }
    }

    /// Condition of the newest odometry.
    fn condition(&mut self, has_pose: bool, now: Monotonic) -> OdometryCondition {
        let (clock, timesync) = (self.clock, &self.timesync);
        self.feed.condition(has_pose, now, |at| stamp_usec(clock, timesync, at).is_some())
    }

    fn send_odometry(&mut self, condition: OdometryCondition, now: Monotonic) {
        let (clock, timesync) = (self.clock, &self.timesync);
        let message = self.feed.message(condition, now, |at| stamp_usec(clock, timesync, at));
        if let Some(message) = message
            && self.send::<ODOMETRY_DATA>(&message, now)
        {
            self.figures.odometry += 1;
            self.figures.invalid += u64::from(message.quality < 0);
        }
    }

    /// Distance of each frame, and flow while it is wanted; none where no time can stamp them. The distance goes out before it is
    /// needed: PX4 fuses a range finder only after it has seen it agree with a climb.
    fn send_flow(&mut self, newer: &FlowHandover, now: Monotonic) {
        let Some(usec) = stamp_usec(self.clock, &self.timesync, newer.measured) else { return };
        let flow = &newer.flow;
        if self.flow_switch.is_on() {
            let is_sent = self.send::<OPTICAL_FLOW_RAD_DATA>(&message::flow_rad(flow, usec), now);
            self.figures.flow += u64::from(is_sent);
            self.send::<OPTICAL_FLOW_DATA>(&message::flow_rate(flow, usec), now);
        }
        if let Some(ground) = &flow.distance {
            let is_sent = self.send::<DISTANCE_SENSOR_DATA>(&message::distance(ground, usec), now);
            self.figures.distances += u64::from(is_sent);
        }
    }

    fn send_others(&mut self, condition: OdometryCondition, now: Monotonic) {
        if now.0.saturating_sub(self.heartbeat.0) >= HEARTBEAT_NS {
            self.heartbeat = now;
            self.send::<HEARTBEAT_DATA>(&message::heartbeat(condition.mav_state()), now);
        }
        self.announce(condition, now);
    }

    /// Before the odometry: behind it, the question would take longer than its answer on a serial line, and
    /// half of the difference would be taken for one of the clocks.
    fn ask_for_the_time(&mut self) {
        let now = Monotonic::now();
        if let Some(ts1) = self.timesync.request(now) {
            let target_system = u8::try_from(self.header.system_id).unwrap_or(0);
            let ask = TIMESYNC_DATA { tc1: 0, ts1, target_system, target_component: AUTOPILOT };
            self.send::<TIMESYNC_DATA>(&ask, now);
        }
    }

    fn announce(&mut self, condition: OdometryCondition, now: Monotonic) {
        for (severity, words) in
            [self.announcer.news(condition, now), self.flow_switch.news()].into_iter().flatten()
        {
            self.send::<STATUSTEXT_DATA>(&message::statustext(severity, words), now);
        }
    }

    /// Tells people once when the autopilot is not heard, and what became of the line.
    fn watch(&mut self, now: Monotonic) {
        let since = self.heard.unwrap_or(self.began);
        if self.is_heard && now.0.saturating_sub(since.0) > SILENCE_NS {
            self.is_heard = false;
            self.tell(News::Silent);
        }
        if let Some(news) = self.link.news() {
            self.tell(news);
        }
    }

    /// Tells the news; one that finds no room is not waited for.
    fn tell(&mut self, news: News) {
        let _ = self.words.push(news);
    }

    fn send<D: MessageData>(&mut self, data: &D, now: Monotonic) -> bool {
        let mut raw = MAVLinkV2MessageRaw::new();
        raw.serialize_message_data(self.header, data);
        self.header.sequence = self.header.sequence.wrapping_add(1);
        let is_sent = self.link.send(raw.raw_bytes(), now);
        self.figures.unsent += u64::from(!is_sent);
        is_sent
    }

    /// Takes what comes in until `due`.
    fn listen_until(&mut self, due: Monotonic, inbox: &mut MavlinkInbox) {
        let mut answers = 0;
        for _ in 0..MAX_READS {
            if Monotonic::now() >= due || !self.link.wait(due) {
                return;
            }
            let mut bytes = [0; CHUNK];
            let now = Monotonic::now();
            let count = self.link.read(&mut bytes, now);
            inbox.put(&bytes[..count], |received| self.take(&received, now, &mut answers));
        }
        due.sleep_until();
    }

    fn take(&mut self, received: &Received, now: Monotonic, answers: &mut usize) {
        let sender = (received.system_id, received.component_id);
        if sender == (self.header.system_id, COMPONENT) {
            // Ourselves, through a router that sends back.
            return;
        }
        // A ground station or a camera on the same port is not who the odometry is for.
        if sender == (self.header.system_id, AUTOPILOT) {
            self.link.confirm(now);
            if self.heard.is_none() || !self.is_heard {
                self.tell(News::Heard);
                self.announcer.repeat();
                self.flow_switch.repeat();
            }
            (self.heard, self.is_heard) = (Some(now), true);
            if let Some(trigger) = &received.trigger {
                self.ask_at(trigger, now);
            }
        }
        let Some(timesync) = received.timesync.as_ref().filter(|t| self.is_for_us(t)) else { return };
        if timesync.tc1 != 0 {
            self.take_answer(timesync, sender, now);
        } else if *answers < MAX_ANSWERS {
            *answers += 1;
            self.answer(timesync.ts1, sender);
        }
    }

    /// Asks for the state at a trigger. Its stamp is of the autopilot's clock.
    fn ask_at(&mut self, trigger: &CAMERA_TRIGGER_DATA, now: Monotonic) {
        let clocks = self.timesync.offset_ns().zip(self.host_ahead_ns);
        let (Some(instants), Some((autopilot_ahead_ns, host_ahead_ns))) = (&self.instants, clocks) else {
            return;
        };
        if now.0.saturating_sub(self.triggered.0) < TRIGGER_PERIOD_NS {
            return;
        }
        self.triggered = now;
        let stamp_ns = i64::try_from(trigger.time_usec).unwrap_or(i64::MAX).saturating_mul(1_000);
        let stamp_ns = stamp_ns.saturating_sub(autopilot_ahead_ns).saturating_sub(host_ahead_ns);
        let request = InstantRequest {
            number: trigger.seq.into(),
            stamp: Timestamp::from_nanos(stamp_ns),
            until: now.plus_nanos(TRIGGER_PATIENCE_NS),
            is_settled: true,
        };
        self.figures.triggers += u64::from(instants.ask(InstantSource::Trigger, request));
    }

    fn is_for_us(&self, t: &TIMESYNC_DATA) -> bool {
        (t.target_system == 0 || u32::from(t.target_system) == self.header.system_id)
            && (t.target_component == 0 || t.target_component == COMPONENT)
    }

    /// Where several answer, as behind a router, the autopilot's own clock counts.
    fn take_answer(&mut self, t: &TIMESYNC_DATA, sender: (u32, u8), now: Monotonic) {
        let autopilot = (self.header.system_id, AUTOPILOT);
        let source = *self.time_source.get_or_insert(sender);
        if source != sender {
            let is_source_silent = self.timesync.round_trip_ns().is_none();
            if sender != autopilot && !is_source_silent {
                return;
            }
            self.time_source = Some(sender);
            self.timesync.restart();
            return;
        }
        let was_locked = self.timesync.offset_ns().is_some();
        self.timesync.answer(t.tc1, t.ts1, now);
        if let Some(offset) = self.timesync.offset_ns().filter(|_| !was_locked) {
            let before = self.told_offset_ns.replace(offset);
            self.tell(News::of_clock(offset, before));
        }
    }

    /// Tells the time by which the odometry is stamped, as soon as there is one.
    fn answer(&mut self, ts1: i64, (system_id, component_id): (u32, u8)) {
        let now = Monotonic::now();
        if let Some(tc1) = stamp_ns(self.clock, &self.timesync, now).filter(|ns| *ns > 0) {
            let target_system = u8::try_from(system_id).unwrap_or(0);
            let answer = TIMESYNC_DATA { tc1, ts1, target_system, target_component: component_id };
            self.send::<TIMESYNC_DATA>(&answer, now);
        }
    }
}

/// `at` by the clock that stamps the odometry, microseconds.
fn stamp_usec(clock: AutopilotClock, timesync: &TimeSync, at: Monotonic) -> Option<u64> {
    stamp_ns(clock, timesync, at).and_then(|ns| u64::try_from(ns / 1000).ok())
}

fn stamp_ns(clock: AutopilotClock, timesync: &TimeSync, at: Monotonic) -> Option<i64> {
    match clock {
        AutopilotClock::Companion => Some(at.0),
        AutopilotClock::Autopilot => timesync.offset_ns().map(|offset| at.0.saturating_add(offset)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pipeline::instants::{InstantDesk, Standing};
    use plumbline_config::options::AutopilotEndpoint;

    #[test]
    fn only_the_autopilot_is_heard() {
        let free = std::net::UdpSocket::bind("127.0.0.1:0").and_then(|socket| socket.local_addr()).unwrap();
        let config = AutopilotConfig { connect: format!("udpin://{free}"), ..AutopilotConfig::default() };
        let endpoint = AutopilotEndpoint::parse(&config.connect).unwrap();
        let frames = VehicleFrames::new(&nalgebra::UnitQuaternion::identity());
        let mut sender = Sender::new(&config, AutopilotLink::open(&endpoint).unwrap(), frames);
        let began = sender.began;
        let at = |s: i64| Monotonic(began.0 + s * 1_000_000_000);
        let hear = |sender: &mut Sender, system_id: u32, component_id: u8, s: i64| {
            sender.take(&Received { system_id, component_id, timesync: None, trigger: None }, at(s), &mut 0);
            sender.watch(at(s));
            sender.is_heard
        };
        // A camera, a ground station and another vehicle's autopilot.
        let others = [(1, 100), (255, 190), (77, 1)];
        for s in 1..=5 {
            for (system, component) in others {
                hear(&mut sender, system, component, s);
            }
        }
        assert!(sender.heard.is_none());
        assert!(!hear(&mut sender, 1, 100, 6), "silence is told after five seconds, whoever else talks");
        assert!(hear(&mut sender, 1, 1, 7), "the autopilot ends it");
        assert!(hear(&mut sender, 77, 1, 11) && !hear(&mut sender, 77, 1, 13), "and may fall silent again");
    }

    #[test]
    fn the_state_at_a_trigger_is_asked_for_by_the_clock_of_the_data() {
        let config = AutopilotConfig { connect: "udp://127.0.0.1:9".into(), ..AutopilotConfig::default() };
        let endpoint = AutopilotEndpoint::parse(&config.connect).unwrap();
        let frames = VehicleFrames::new(&nalgebra::UnitQuaternion::identity());
        let mut sender = Sender::new(&config, AutopilotLink::open(&endpoint).unwrap(), frames);
        let instants = Arc::new(Instants::default());
        sender.instants = Some(Arc::clone(&instants));
        let mut desk = InstantDesk::new(instants);
        let mut next = || desk.next(&mut 0, |_| Standing { is_reached: true, is_settled: true });
        let mut trigger = |sender: &mut Sender, component_id: u8, time_usec: u64, ms: i64| {
            let trigger = Some(CAMERA_TRIGGER_DATA { time_usec, seq: 17 });
            let received = Received { system_id: 1, component_id, timesync: None, trigger };
            sender.take(&received, sender.began.plus_nanos(ms * 1_000_000), &mut 0);
            next()
        };
        assert_eq!(trigger(&mut sender, AUTOPILOT, 5_000_000, 0), None, "no clock is known");
        sender.host_ahead_ns = Some(-700);
        // The autopilot's clock is 2 s ahead of the host's, which is 700 ns behind that of the data.
        for k in 0..8 {
            let at = sender.began.plus_nanos(k * 200_000_000);
            let asked = sender.timesync.request(at).unwrap();
            sender.timesync.answer(asked + 2_000_000_000, asked, at);
        }
        let stamp = Timestamp::from_nanos(3_000_000_700);
        let expected = Some((InstantSource::Trigger, 17, stamp));
        assert_eq!(trigger(&mut sender, AUTOPILOT, 5_000_000, 10), expected);
        assert_eq!(trigger(&mut sender, AUTOPILOT, 5_000_000, 17), None, "faster than any camera");
        assert_eq!(trigger(&mut sender, 100, 5_000_000, 20), None, "of a camera, not of the autopilot");
        assert!(trigger(&mut sender, AUTOPILOT, u64::MAX, 20).is_some());
        assert_eq!(sender.figures.triggers, 2);
    }
}
