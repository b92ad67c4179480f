//! Messages of Foxglove's WebSocket protocol: what a server says as JSON, data as bytes, and what a client asks for.

use base64::Engine as _;
use base64::prelude::BASE64_STANDARD;
use plumbline_scene::descriptors;
use serde::Deserialize;
use serde_json::{Value, json};

/// Longest message of a client, bytes: one that subscribes to all channels at once is far shorter.
pub const MAX_REQUEST_BYTES: usize = 256 << 10;
/// First byte of a message of a channel, and of the time.
const MESSAGE_DATA: u8 = 1;
const TIME: u8 = 2;

/// Severity of a status.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Level {
    /// Something is missing.
    Warning,
    /// A request was refused.
    Error,
}

/// Channel that is advertised.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Advertised {
    /// Number of the channel on this connection.
    pub id: u32,
    /// Topic.
    pub topic: String,
    /// Name of its schema.
    pub schema: &'static str,
}

/// First message of a server, which describes it.
pub fn server_info(session: &str) -> String {
    json!({
        "op": "serverInfo",
        "name": "plumbline ground",
        "capabilities": ["time"],
        "supportedEncodings": [],
        "metadata": {},
        "sessionId": session,
    })
    .to_string()
}

/// Offers channels.
pub fn advertise(channels: &[Advertised]) -> String {
    let channel = |channel: &Advertised| {
        json!({
            "id": channel.id,
            "topic": channel.topic,
            "encoding": "protobuf",
            "schemaName": channel.schema,
            "schema": BASE64_STANDARD.encode(descriptors(channel.schema).unwrap_or_default()),
            "schemaEncoding": "protobuf",
        })
    };
    json!({"op": "advertise", "channels": channels.iter().map(channel).collect::<Value>()}).to_string()
}

/// Takes channels back.
pub fn unadvertise(channels: &[u32]) -> String {
    json!({"op": "unadvertise", "channelIds": channels}).to_string()
}

/// Says something for people.
pub fn status(level: Level, message: &str) -> String {
    let level = if level == Level::Warning { 1 } else { 2 };
    json!({"op": "status", "level": level, "message": message}).to_string()
}

/// A message of a channel for a subscription, and when it was measured, ns.
pub fn message_data(subscription: u32, time_ns: u64, payload: &[u8]) -> Vec<u8> {
    [&[MESSAGE_DATA][..], &subscription.to_le_bytes(), &time_ns.to_le_bytes(), payload].concat()
}

/// The time of the data, ns.
pub fn time(time_ns: u64) -> Vec<u8> {
    [&[TIME][..], &time_ns.to_le_bytes()].concat()
}

/// Requests of a client.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
#[serde(tag = "op", rename_all = "camelCase")]
pub enum ClientRequest {
    /// Messages of channels.
    Subscribe {
        /// The channels, with the numbers that the client gives.
        subscriptions: Vec<ClientSubscription>,
    },
    /// No more of them.
    Unsubscribe {
        /// Numbers of subscriptions.
        #[serde(rename = "subscriptionIds")]
        subscription_ids: Vec<u32>,
    },
    /// Something that this server does not offer.
    #[serde(other)]
    Other,
}

/// A subscription.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
pub struct ClientSubscription {
    /// Number, which the client gives.
    pub id: u32,
    /// Number of the channel.
    #[serde(rename = "channelId")]
    pub channel_id: u32,
}

/// The request in `text`; `None` where it is none.
pub fn request(text: &str) -> Option<ClientRequest> {
    serde_json::from_str(text).ok()
}
