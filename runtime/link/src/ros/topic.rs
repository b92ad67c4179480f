//! One publisher of a node, with its token.

use super::cdr;
use super::interface::Interface;
use super::names::{self, Attachment, Endpoint, NodeName, RosTopic};
use crate::net::NetError;
use serde::Serialize;
use zenoh::Session;
use zenoh::bytes::Encoding;
use zenoh::liveliness::LivelinessToken;
use zenoh::qos::{CongestionControl, Priority};

/// Declares endpoints of a node on its session.
pub struct Declaring<'a> {
    session: &'a Session,
    node: &'a NodeName,
    /// Number of the newest endpoint in the node.
    entity: u32,
}

impl<'a> Declaring<'a> {
    /// Declares for `node`, which has no endpoints yet.
    pub fn new(session: &'a Session, node: &'a NodeName) -> Self {
        Self { session, node, entity: 0 }
    }

    /// Session of the node.
    pub fn session(&self) -> &'a Session {
        self.session
    }

    /// Node of the endpoints.
    pub fn node(&self) -> &'a NodeName {
        self.node
    }

    /// Declares the token of the next endpoint; also its text, of which its identifier is made.
    ///
    /// # Errors
    /// When Zenoh refuses the key.
    pub async fn token(
        &mut self,
        endpoint: Endpoint,
        topic: &RosTopic,
    ) -> Result<(LivelinessToken, String), NetError> {
        self.entity += 1;
        let key = self.node.endpoint_token(endpoint, self.entity, topic);
        Ok((declare_token(self.session, key.clone()).await?, key))
    }
}

/// Declares a liveliness token.
///
/// # Errors
/// When Zenoh refuses the key.
pub async fn declare_token(session: &Session, key: String) -> Result<LivelinessToken, NetError> {
    let token = session.liveliness().declare_token(key.clone()).await;
    token.map_err(|error| NetError::Declare { key, message: error.to_string() })
}

/// Publisher of a topic.
pub struct TopicPublisher {
    publisher: zenoh::pubsub::Publisher<'static>,
    interface: String,
    gid: [u8; 16],
    sequence: i64,
    _token: LivelinessToken,
}

impl TopicPublisher {
    /// Declares the publisher of `topic`.
    ///
    /// # Errors
    /// When Zenoh refuses a key.
    pub async fn declare(
        declaring: &mut Declaring<'_>,
        topic: RosTopic,
        priority: Priority,
    ) -> Result<Self, NetError> {
        let key = declaring.node().key(&topic);
        let publisher = declaring
            .session()
            .declare_publisher(key.clone())
            .encoding(Encoding::APPLICATION_CDR.with_schema(topic.interface.name.clone()))
            .priority(priority)
            .congestion_control(CongestionControl::Drop)
            .await
            .map_err(|error| NetError::Declare { key, message: error.to_string() })?;
        let (token, text) = declaring.token(Endpoint::Publisher, &topic).await?;
        let interface = topic.interface.name;
        Ok(Self { publisher, interface, gid: names::gid(&text), sequence: 0, _token: token })
    }

    /// True if there are subscribers.
    pub async fn has_subscribers(&self) -> bool {
        self.publisher.matching_status().await.is_ok_and(|status| status.matching())
    }

    /// Publishes a message of the topic's type. What cannot be sent is lost; the sequence numbers of the samples show it.
    pub async fn put<T: Interface + Serialize>(&mut self, message: &T, now_ns: i64) {
        debug_assert_eq!(T::NAME, self.interface);
        let Ok(bytes) = cdr::encode(message) else { return };
        self.sequence += 1;
        let attachment = Attachment { sequence: self.sequence, source_ns: now_ns, gid: self.gid };
        let _ = self.publisher.put(bytes).attachment(attachment.encode().as_slice()).await;
    }
}
