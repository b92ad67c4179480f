//! How `rmw_zenoh` names things: keys of topics, liveliness tokens, and what is attached to a sample.

use plumbline_config::options::RosDistribution;
use xxhash_rust::xxh3::xxh3_128;

/// What stands in keys for the hash of a type in a release that has none.
const NO_HASH: &str = "TypeHashNotSupported";
/// Bytes attached to every sample.
const ATTACHMENT_BYTES: usize = 33;

/// A type of message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MessageType {
    /// As people write it.
    pub name: &'static str,
    /// As DDS mangles it, which is how keys have it.
    pub dds_name: &'static str,
    /// SHA-256 of its definition (REP-2016), the same from Iron to Rolling.
    pub hash: &'static str,
}

/// `nav_msgs/msg/Odometry`.
pub const ODOMETRY: MessageType = MessageType {
    name: "nav_msgs/msg/Odometry",
    dds_name: "nav_msgs::msg::dds_::Odometry_",
    hash: "RIHS01_3cc97dc7fb7502f8714462c526d369e35b603cfc34d946e3f2eda2766dfec6e0",
};
/// `geometry_msgs/msg/PoseStamped`.
pub const POSE_STAMPED: MessageType = MessageType {
    name: "geometry_msgs/msg/PoseStamped",
    dds_name: "geometry_msgs::msg::dds_::PoseStamped_",
    hash: "RIHS01_10f3786d7d40fd2b54367835614bff85d4ad3b5dab62bf8bca0cc232d73b4cd8",
};
/// `tf2_msgs/msg/TFMessage`.
pub const TF_MESSAGE: MessageType = MessageType {
    name: "tf2_msgs/msg/TFMessage",
    dds_name: "tf2_msgs::msg::dds_::TFMessage_",
    hash: "RIHS01_e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087",
};

impl MessageType {
    fn hash_in(&self, distribution: RosDistribution) -> &'static str {
        if distribution == RosDistribution::Humble { NO_HASH } else { self.hash }
    }
}

/// A topic that is published.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Topic {
    /// Fully qualified, such as `/drone/odom`.
    pub name: String,
    /// Type of its messages.
    pub message: MessageType,
    /// Messages that a subscriber is advised to hold.
    pub depth: u32,
}

/// A node on a session of Zenoh.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Node {
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

impl Node {
    /// A name in the node's namespace, fully qualified.
    #[must_use]
    pub fn qualified(&self, name: &str) -> String {
        format!("{}/{name}", self.namespace.trim_end_matches('/'))
    }

    /// The key on which messages of a topic go out.
    #[must_use]
    pub fn key(&self, topic: &Topic) -> String {
        let name = topic.name.trim_matches('/');
        format!("{}/{name}/{}", self.domain_id, self.type_chunks(topic))
    }

    /// The token by which the node is listed. The node is the session's only one, so its number is 0.
    #[must_use]
    pub fn token(&self) -> String {
        self.token_of("0/NN")
    }

    /// The token by which a publisher of this node is listed; `entity` is its number in the node, from 1.
    #[must_use]
    pub fn publisher_token(&self, entity: u32, topic: &Topic) -> String {
        let token = self.token_of(&format!("{entity}/MP"));
        format!("{token}/{}/{}/{}", mangled(&topic.name), self.type_chunks(topic), qos(topic))
    }

    /// `@ros2_lv/<domain>/<session>/<node>/<entity>/<kind>/<enclave>/<namespace>/<name>`, no enclave.
    fn token_of(&self, entity_and_kind: &str) -> String {
        let Self { domain_id, session, name, .. } = self;
        let namespace = mangled(&self.namespace);
        format!("@ros2_lv/{domain_id}/{session}/0/{entity_and_kind}/%/{namespace}/{name}")
    }

    fn type_chunks(&self, topic: &Topic) -> String {
        format!("{}/{}", topic.message.dds_name, topic.message.hash_in(self.distribution))
    }
}

/// A name as one chunk of a key.
fn mangled(name: &str) -> String {
    name.replace('/', "%")
}

/// Quality of service: `reliability:durability:history,depth:deadline:lifespan:liveliness`, and nothing where it
/// is the default of `rmw_zenoh`: reliable, volatile, keep last.
fn qos(topic: &Topic) -> String {
    format!("::,{}:,:,:,,", topic.depth)
}

/// The identifier of a publisher: XXH3-128 of its token, low half first.
#[must_use]
pub fn gid(token: &str) -> [u8; 16] {
    xxh3_128(token.as_bytes()).to_le_bytes()
}

/// What goes with every sample: `sequence` from 1, the time of publication in nanoseconds since 1970, and the
/// publisher's [`gid`] behind its length.
#[must_use]
pub fn attachment(sequence: i64, source_ns: i64, gid: &[u8; 16]) -> [u8; ATTACHMENT_BYTES] {
    let mut bytes = [0; ATTACHMENT_BYTES];
    bytes[..8].copy_from_slice(&sequence.to_le_bytes());
    bytes[8..16].copy_from_slice(&source_ns.to_le_bytes());
    bytes[16] = 16;
    bytes[17..].copy_from_slice(gid);
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    const CHATTER: MessageType = MessageType {
        name: "std_msgs/msg/String",
        dds_name: "std_msgs::msg::dds_::String_",
        hash: "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18",
    };

    fn node(domain_id: u32, session: &str, namespace: &str, name: &str) -> Node {
        Node {
            domain_id,
            distribution: RosDistribution::Jazzy,
            session: session.into(),
            namespace: namespace.into(),
            name: name.into(),
        }
    }

    fn topic(node: &Node, name: &str, depth: u32) -> Topic {
        Topic { name: node.qualified(name), message: CHATTER, depth }
    }

    /// The examples of `docs/design.md` of `rmw_zenoh`, letter by letter.
    #[test]
    fn keys_and_tokens_are_those_of_the_documentation() {
        let talker = node(2, "8b20917502ee955ac4476e0266340d5c", "/", "talker");
        let chatter = topic(&talker, "chatter", 7);
        assert_eq!(
            talker.publisher_token(10, &chatter),
            "@ros2_lv/2/8b20917502ee955ac4476e0266340d5c/0/10/MP/%/%/talker/%chatter/std_msgs::msg::dds_::String_/RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18/::,7:,:,:,,"
        );
        let listener = node(2, "aac3178e146ba6f1fc6e6a4085e77f21", "/", "listener");
        assert_eq!(listener.token(), "@ros2_lv/2/aac3178e146ba6f1fc6e6a4085e77f21/0/0/NN/%/%/listener");
        let there = node(0, "1", "/robot1", "talker");
        assert_eq!(
            there.key(&topic(&there, "chatter", 7)),
            "0/robot1/chatter/std_msgs::msg::dds_::String_/RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
        );
    }

    #[test]
    fn slashes_of_names_do_not_split_tokens() {
        let node = node(0, "1", "/robots/one", "plumbline");
        let token = node.publisher_token(1, &topic(&node, "odom", 10));
        let chunks: Vec<&str> = token.split('/').collect();
        assert_eq!(chunks.len(), 13, "{token}");
        assert_eq!((chunks[7], chunks[9]), ("%robots%one", "%robots%one%odom"));
    }

    #[test]
    fn humble_has_no_hashes() {
        let node = Node { distribution: RosDistribution::Humble, ..node(0, "1", "/", "talker") };
        let chatter = topic(&node, "chatter", 7);
        assert_eq!(node.key(&chatter), "0/chatter/std_msgs::msg::dds_::String_/TypeHashNotSupported");
        assert!(node.publisher_token(1, &chatter).contains("/TypeHashNotSupported/"));
    }

    #[test]
    fn an_attachment_is_sequence_time_and_identifier_behind_its_length() {
        let gid = gid("a token");
        let bytes = attachment(1, -2, &gid);
        assert_eq!(bytes[..8], [1, 0, 0, 0, 0, 0, 0, 0]);
        assert_eq!(bytes[8..16], (-2i64).to_le_bytes());
        assert_eq!(bytes[16], 16);
        assert_eq!(bytes[17..], gid);
    }
}
