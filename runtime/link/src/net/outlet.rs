//! A key of the network: declared by its row in the table of topics, it sends messages in their envelopes, at its pace.

use super::error::NetError;
use super::pace::Pace;
use super::{ROOT, now_ns};
use plumbline_config::Timestamp;
use plumbline_config::options::Link;
use plumbline_record::fields::Parts;
use plumbline_record::messages::Envelope;
use plumbline_record::protobuf::encode;
use plumbline_record::topics::{self, Topic};
use zenoh::Session;
use zenoh::bytes::Encoding;
use zenoh::pubsub::Publisher;
use zenoh::qos::{CongestionControl, Priority};

/// A key that a vehicle publishes.
pub struct Outlet {
    /// Publisher.
    pub publisher: Publisher<'static>,
    /// Lets through what the link can carry.
    pub pace: Pace,
    /// Messages so far.
    pub sequence: u64,
}

impl Outlet {
    /// Declares the key of a topic.
    ///
    /// # Errors
    /// When Zenoh refuses it.
    pub async fn declare(
        session: &Session,
        vehicle: &str,
        topic: Topic,
        link: Link,
    ) -> Result<Self, NetError> {
        let key = key_of(vehicle, topic);
        let priority = topic.row().key.map_or(Priority::Data, |key| priority(key.priority));
        let publisher = session
            .declare_publisher(key.clone())
            .encoding(encoding(topic))
            .priority(priority)
            .congestion_control(CongestionControl::Drop)
            .express(priority == Priority::RealTime);
        let publisher =
            publisher.await.map_err(|error| NetError::Declare { key, message: error.to_string() })?;
        Ok(Self { publisher, pace: Pace::new(topic.rate_hz(link)), sequence: 0 })
    }

    /// True if a message of this time is sent.
    pub fn admits(&mut self, stamp: Timestamp) -> bool {
        self.pace.admits(stamp)
    }

    /// Sends the message of a record as it is. One that cannot be sent is dropped, by its quality of service; receivers see a gap
    /// in the sequence numbers.
    pub async fn send(&mut self, record: &dyn Parts, message: Vec<u8>) {
        let envelope = Envelope::around(record, message, self.sequence, now_ns());
        self.put(&envelope).await;
    }

    /// Sends an envelope.
    pub async fn put(&mut self, envelope: &Envelope) {
        self.sequence += 1;
        let _ = self.publisher.put(encode(envelope)).await;
    }
}

/// Key of a topic of a vehicle.
pub fn key_of(vehicle: &str, topic: Topic) -> String {
    let row = topic.row();
    let name = row.key.map(|key| key.name).or(row.question.map(|question| question.name));
    format!("{ROOT}/{vehicle}/{}", name.unwrap_or_default())
}

/// Encoding of the messages of a topic.
pub fn encoding(topic: Topic) -> Encoding {
    Encoding::APPLICATION_PROTOBUF.with_schema(topic.row().message)
}

const fn priority(of: topics::Priority) -> Priority {
    match of {
        topics::Priority::RealTime => Priority::RealTime,
        topics::Priority::InteractiveHigh => Priority::InteractiveHigh,
        topics::Priority::DataHigh => Priority::DataHigh,
        topics::Priority::Data => Priority::Data,
        topics::Priority::DataLow => Priority::DataLow,
        topics::Priority::Background => Priority::Background,
    }
}
