//! One client of the live server.

use super::super::cameras::Cameras;
use super::super::drawn::{DrawnTopic, Sent};
use super::super::fleet::FleetEvent;
use super::Server;
use super::protocol::{self, Advertised, ClientRequest, Level};
use axum::extract::ws::{Message, WebSocket};
use plumbline_config::Timestamp;
use plumbline_scene::{event, log_time};
use prost::Message as _;
use std::collections::BTreeMap;
use std::time::{Duration, Instant};
use tokio::time::MissedTickBehavior;

/// Period of updates.
const PERIOD: Duration = Duration::from_millis(50);
/// A client that takes longer than this for the news of one period is told what it missed.
const LATE: Duration = Duration::from_millis(500);
/// A client that accepts no data for so long is closed.
const SEND_PATIENCE: Duration = Duration::from_secs(30);
/// A client is asked this often whether it is there.
const PING_PERIOD: Duration = Duration::from_secs(1);
/// A client that has answered no ping for so long is disconnected.
const SILENT: Duration = Duration::from_secs(5);
/// Subscriptions of a client at a time.
const MAX_SUBSCRIPTIONS: usize = 1_024;
/// Number of the channel of events; those of vehicles follow.
const EVENTS: u32 = 1;

/// Content of a channel: vehicle and topic.
type Shown = (String, DrawnTopic);

/// The state of one connection.
pub(super) struct Client<'a> {
    server: &'a Server,
    pinged: Instant,
    /// When it said something last, or answered a ping.
    heard: Instant,
    channels: BTreeMap<u32, Shown>,
    next_channel: u32,
    /// Channels by the numbers of their subscriptions, and what was sent of them.
    subscriptions: BTreeMap<u32, (u32, Sent)>,
    events: u64,
    cameras: Cameras,
    time_ns: u64,
    missed: u64,
}

/// The client has gone, or takes nothing any more.
struct Gone;

impl<'a> Client<'a> {
    pub(super) fn new(server: &'a Server) -> Self {
        Self {
            server,
            pinged: Instant::now(),
            heard: Instant::now(),
            channels: BTreeMap::new(),
            next_channel: EVENTS + 1,
            subscriptions: BTreeMap::new(),
            events: 0,
            cameras: Cameras::default(),
            time_ns: 0,
            missed: 0,
        }
    }

    pub(super) async fn run(mut self, mut socket: WebSocket) {
        // However it ends, the socket is closed with it.
        let _ = self.serve(&mut socket).await;
    }

    async fn serve(&mut self, socket: &mut WebSocket) -> Result<(), Gone> {
        send(socket, Message::text(protocol::server_info(&self.server.session))).await?;
        let events = Advertised { id: EVENTS, topic: "/events".into(), schema: "foxglove.Log" };
        send(socket, Message::text(protocol::advertise(&[events]))).await?;
        let mut clock = tokio::time::interval(PERIOD);
        clock.set_missed_tick_behavior(MissedTickBehavior::Delay);
        loop {
            tokio::select! {
                _ = clock.tick() => self.update(socket).await?,
                received = socket.recv() => {
                    self.heard = Instant::now();
                    match received {
                        Some(Ok(Message::Text(text))) => self.receive(socket, text.as_str()).await?,
                        Some(Ok(Message::Binary(_))) => {
                            send(socket, refusal("this server takes no data")).await?;
                        }
                        Some(Ok(Message::Ping(_) | Message::Pong(_))) => {}
                        Some(Ok(Message::Close(_)) | Err(_)) | None => return Err(Gone),
                    }
                }
            }
        }
    }

    /// Sends what is new; afterwards, if that took long, what was missed meanwhile.
    async fn update(&mut self, socket: &mut WebSocket) -> Result<(), Gone> {
        let start = Instant::now();
        if start.saturating_duration_since(self.heard) > SILENT {
            tracing::warn!("Foxglove: a client that does not answer was disconnected");
            return Err(Gone);
        }
        if start.saturating_duration_since(self.pinged) >= PING_PERIOD {
            self.pinged = start;
            send(socket, Message::Ping(Vec::new().into())).await?;
        }
        self.advertise(socket).await?;
        self.send_time(socket).await?;
        let numbers: Vec<u32> = self.subscriptions.keys().copied().collect();
        for number in numbers {
            for message in self.news(number) {
                send(socket, message).await?;
            }
        }
        let lost = start.elapsed();
        if lost > LATE {
            self.missed += 1;
            let words = format!(
                "this client or its link is too slow: {:.1} s of updates were left out ({} such gaps); subscribe to fewer topics",
                lost.as_secs_f64(),
                self.missed
            );
            send(socket, Message::text(protocol::status(Level::Warning, &words))).await?;
        }
        Ok(())
    }

    /// Offers the channels of vehicles that came, and takes back those of vehicles that went.
    async fn advertise(&mut self, socket: &mut WebSocket) -> Result<(), Gone> {
        let names: Vec<String> = self.server.fleet.lock().vehicles.keys().cloned().collect();
        let gone: Vec<u32> =
            self.channels.iter().filter(|(_, (name, _))| !names.contains(name)).map(|(id, _)| *id).collect();
        if !gone.is_empty() {
            self.channels.retain(|id, _| !gone.contains(id));
            self.subscriptions.retain(|_, (channel, _)| !gone.contains(channel));
            send(socket, Message::text(protocol::unadvertise(&gone))).await?;
        }
        for name in names {
            if self.channels.values().any(|(known, _)| *known == name) {
                continue;
            }
            let mut offered = Vec::new();
            for topic in DrawnTopic::ALL {
                let id = self.next_channel;
                // Vehicles are few and evicted slowly: four billion channels are not reached.
                self.next_channel = id.wrapping_add(1).max(EVENTS + 1);
                offered.push(Advertised { id, topic: topic.of(&name), schema: topic.schema() });
                self.channels.insert(id, (name.clone(), topic));
            }
            send(socket, Message::text(protocol::advertise(&offered))).await?;
        }
        Ok(())
    }

    /// Sends the time of the data.
    async fn send_time(&mut self, socket: &mut WebSocket) -> Result<(), Gone> {
        let stamp_ns = self.server.fleet.lock().data_time_ns(Instant::now());
        let time_ns = stamp_ns.map_or(0, |stamp_ns| log_time(Timestamp::from_nanos(stamp_ns)));
        if time_ns == 0 || std::mem::replace(&mut self.time_ns, time_ns) == time_ns {
            return Ok(());
        }
        send(socket, Message::binary(protocol::time(time_ns))).await
    }

    /// News for a subscription.
    fn news(&mut self, number: u32) -> Vec<Message> {
        let Some((channel, sent)) = self.subscriptions.get_mut(&number) else { return Vec::new() };
        let fleet = self.server.fleet.lock();
        let drawn = if *channel == EVENTS {
            let time_ns = self.time_ns;
            let events =
                fleet.events.since(self.events).map(|event| (time_ns, log(event, time_ns))).collect();
            self.events = fleet.events.total();
            events
        } else {
            let shown = self.channels.get(channel);
            let vehicle = shown.and_then(|(name, topic)| Some((name, topic, fleet.vehicles.get(name)?)));
            vehicle.map_or_else(Vec::new, |(name, topic, vehicle)| topic.news(name, vehicle, sent))
        };
        let message = |(time_ns, payload): &(u64, Vec<u8>)| {
            Message::binary(protocol::message_data(number, *time_ns, payload))
        };
        drawn.iter().map(message).collect()
    }

    async fn receive(&mut self, socket: &mut WebSocket, text: &str) -> Result<(), Gone> {
        match protocol::request(text) {
            Some(ClientRequest::Subscribe { subscriptions }) => {
                for wanted in subscriptions {
                    if let Err(reason) = self.subscribe(wanted).await {
                        send(socket, refusal(&reason)).await?;
                    }
                }
                Ok(())
            }
            Some(ClientRequest::Unsubscribe { subscription_ids }) => {
                self.subscriptions.retain(|number, _| !subscription_ids.contains(number));
                self.forget_cameras();
                Ok(())
            }
            Some(ClientRequest::Other) => send(socket, refusal("this server has topics alone")).await,
            None => send(socket, refusal("the message is no request of the protocol")).await,
        }
    }

    async fn subscribe(&mut self, wanted: protocol::ClientSubscription) -> Result<(), String> {
        let (number, channel) = (wanted.id, wanted.channel_id);
        let shown = self.channels.get(&channel).cloned();
        if channel != EVENTS && shown.is_none() {
            return Err(format!("there is no channel {channel}"));
        }
        if self.subscriptions.contains_key(&number) {
            return Err(format!("there is a subscription {number} already"));
        }
        if self.subscriptions.len() >= MAX_SUBSCRIPTIONS {
            return Err(format!("there are {MAX_SUBSCRIPTIONS} subscriptions already"));
        }
        if let Some((name, DrawnTopic::Image)) = shown {
            self.cameras.watch(&self.server.connection, &self.server.fleet, name).await?;
        }
        self.subscriptions.insert(number, (channel, Sent::default()));
        Ok(())
    }

    fn forget_cameras(&mut self) {
        let (subscriptions, channels) = (&self.subscriptions, &self.channels);
        let is_watched = |name: &String| {
            subscriptions.values().any(|(channel, _)| {
                channels.get(channel).is_some_and(|(of, topic)| of == name && *topic == DrawnTopic::Image)
            })
        };
        self.cameras.retain(is_watched);
    }
}

fn refusal(reason: &str) -> Message {
    Message::text(protocol::status(Level::Error, reason))
}

/// An event as Foxglove's log shows it.
fn log(of: &FleetEvent, time_ns: u64) -> Vec<u8> {
    let stamp = Timestamp::from_nanos(i64::try_from(time_ns).unwrap_or(i64::MAX));
    event(stamp, of.severity, of.vehicle.as_deref().unwrap_or("ground"), &of.text).encode_to_vec()
}

/// Sends a message, if the client takes it in time.
async fn send(socket: &mut WebSocket, message: Message) -> Result<(), Gone> {
    match tokio::time::timeout(SEND_PATIENCE, socket.send(message)).await {
        Ok(Ok(())) => Ok(()),
        _ => Err(Gone),
    }
}
