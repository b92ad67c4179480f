//! Names of `rmw_zenoh`: keys of topics, liveliness tokens, and attachments of samples.

use super::interface::InterfaceType;
use plumbline_config::options::RosDistribution;
use xxhash_rust::xxh3::xxh3_128;

/// Placeholder in keys for the hash of a type in a release that has none.
const NO_HASH: &str = "TypeHashNotSupported";
/// Bytes attached to every sample, request and response.
pub const ATTACHMENT_BYTES: usize = 33;
/// Bytes of an identifier.
const GID_BYTES: usize = 16;

/// Topic that is published, or service that is offered.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RosTopic {
    /// Fully qualified name, such as `/drone/odom`.
    pub name: String,
    /// Type of its messages, or of the service.
    pub interface: InterfaceType,
    /// Messages, or requests, that a queue is advised to hold.
    pub depth: u32,
}

/// Kind of a node's endpoint.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Endpoint {
    /// Publisher of a topic.
    Publisher,
    /// Subscription to a topic.
    Subscription,
}

impl Endpoint {
    fn code(self) -> &'static str {
        match self {
            Self::Publisher => "MP",
            Self::Subscription => "MS",
        }
    }
}

/// A node on a session of Zenoh.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NodeName {
    /// `ROS_DOMAIN_ID`.
    pub domain_id: u32,
    /// The release whose names are used.
    pub distribution: RosDistribution,
    /// Identifier of the session, as Zenoh prints it.
    pub session: String,
    /// Absolute, `/` for none.
    pub namespace: String,
    /// Without a slash.
    pub name: String,
}

impl NodeName {
    /// A name in the node's namespace, fully qualified.
    pub fn qualified(&self, name: &str) -> String {
        format!("{}/{name}", self.namespace.trim_end_matches('/'))
    }

    /// Key on which messages of a topic go out, and on which a service is called.
    pub fn key(&self, topic: &RosTopic) -> String {
        let name = topic.name.trim_matches('/');
        format!("{}/{name}/{}", self.domain_id, self.type_chunks(topic))
    }

    /// The token by which the node is listed. The node is the session's only one, so its number is 0.
    pub fn token(&self) -> String {
        self.token_of("0/NN")
    }

    /// Token by which an endpoint of this node is listed; `entity` is its number in the node, from 1.
    pub fn endpoint_token(&self, endpoint: Endpoint, entity: u32, topic: &RosTopic) -> String {
        let token = self.token_of(&format!("{entity}/{}", endpoint.code()));
        format!("{token}/{}/{}/{}", mangled(&topic.name), self.type_chunks(topic), qos(topic))
    }

    /// `@ros2_lv/<domain>/<session>/<node>/<entity>/<kind>/<enclave>/<namespace>/<name>`, no enclave.
    fn token_of(&self, entity_and_kind: &str) -> String {
        let Self { domain_id, session, name, .. } = self;
        let namespace = mangled(&self.namespace);
        format!("@ros2_lv/{domain_id}/{session}/0/{entity_and_kind}/%/{namespace}/{name}")
    }

    fn type_chunks(&self, topic: &RosTopic) -> String {
        let InterfaceType { dds_name, hash, .. } = &topic.interface;
        let hash = if self.distribution == RosDistribution::Humble { NO_HASH } else { hash };
        format!("{dds_name}/{hash}")
    }
}

/// A name as one chunk of a key.
fn mangled(name: &str) -> String {
    name.replace('/', "%")
}

/// Quality of service: `reliability:durability:history,depth:deadline:lifespan:liveliness`, and nothing where it
/// is the default of `rmw_zenoh`: reliable, volatile, keep last.
fn qos(topic: &RosTopic) -> String {
    format!("::,{}:,:,:,,", topic.depth)
}

/// The identifier of a publisher: XXH3-128 of its token, low half first.
pub fn gid(token: &str) -> [u8; 16] {
    xxh3_128(token.as_bytes()).to_le_bytes()
}

/// Attachment of a sample, a request or a response.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Attachment {
    /// Number of the sample or request, from 1; that of its request in a response.
    pub sequence: i64,
    /// Time of publication, ns since 1970.
    pub source_ns: i64,
    /// Identifier of the publisher or client ([`gid`]); that of the client in a response.
    pub gid: [u8; GID_BYTES],
}

impl Attachment {
    /// Bytes of the attachment: both numbers little-endian, the identifier behind its length.
    pub fn encode(&self) -> [u8; ATTACHMENT_BYTES] {
        let mut bytes = [0; ATTACHMENT_BYTES];
        bytes[..8].copy_from_slice(&self.sequence.to_le_bytes());
        bytes[8..16].copy_from_slice(&self.source_ns.to_le_bytes());
        bytes[16] = GID_BYTES as u8;
        bytes[17..].copy_from_slice(&self.gid);
        bytes
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn node(domain_id: u32, session: &str, namespace: &str, name: &str) -> NodeName {
        NodeName {
            domain_id,
            distribution: RosDistribution::Jazzy,
            session: session.into(),
            namespace: namespace.into(),
            name: name.into(),
        }
    }

    fn topic(node: &NodeName, name: &str, depth: u32) -> RosTopic {
        let hash = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18";
        let interface = InterfaceType::new("std_msgs/msg/String", hash);
        RosTopic { name: node.qualified(name), interface, depth }
    }

    #[test]
    fn slashes_of_names_do_not_split_tokens() {
        let node = node(0, "1", "/robots/one", "plumbline");
        let token = node.endpoint_token(Endpoint::Publisher, 1, &topic(&node, "odom", 10));
        let chunks: Vec<&str> = token.split('/').collect();
        assert_eq!(chunks.len(), 13, "{token}");
        assert_eq!((chunks[7], chunks[9]), ("%robots%one", "%robots%one%odom"));
    }

    #[test]
    fn humble_has_no_hashes() {
        let node = NodeName { distribution: RosDistribution::Humble, ..node(0, "1", "/", "talker") };
        let chatter = topic(&node, "chatter", 7);
        assert_eq!(node.key(&chatter), "0/chatter/std_msgs::msg::dds_::String_/TypeHashNotSupported");
        assert!(node.endpoint_token(Endpoint::Publisher, 1, &chatter).contains("/TypeHashNotSupported/"));
    }
}
