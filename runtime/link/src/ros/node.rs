//! The node `plumbline` and its publishers, on a session of Zenoh.

use super::cdr;
use super::messages::{Frames, Time};
use super::names::{self, Node, Topic};
use crate::net::pace::Pace;
use crate::net::{NetError, now_ns};
use nalgebra::{Isometry3, UnitQuaternion};
use plumbline_config::Timestamp;
use plumbline_config::options::{RosConfig, RosStamp};
use plumbline_estimator::{Odometry, TrackingState};
use plumbline_flight::pipeline::Stamps;
use plumbline_flight::schedule::ticker::Monotonic;
use serde::Serialize;
use zenoh::Session;
use zenoh::bytes::Encoding;
use zenoh::liveliness::LivelinessToken;
use zenoh::qos::{CongestionControl, Priority};

/// Name of the node.
const NODE: &str = "plumbline";
/// Messages that a subscriber is advised to hold; of transforms as many as tf2's own broadcaster says.
const DEPTH: u32 = 10;
const TF_DEPTH: u32 = 100;

/// A node of ROS 2 with its publishers, for as long as it lives.
pub struct RosNode {
    options: RosConfig,
    rot_v_b: UnitQuaternion<f64>,
    stamps: Stamps,
    odom: TopicPublisher,
    pose: TopicPublisher,
    tf: Option<TopicPublisher>,
    pace: Pace,
    _node: LivelinessToken,
}

impl RosNode {
    /// Declares the node of `vehicle`, its publishers and the tokens by which both are listed; `rot_v_b` takes
    /// coordinates from the IMU to the vehicle.
    ///
    /// # Errors
    /// When Zenoh refuses a key.
    pub async fn declare(
        session: &Session,
        options: &RosConfig,
        vehicle: &str,
        rot_v_b: UnitQuaternion<f64>,
        stamps: Stamps,
    ) -> Result<Self, NetError> {
        let node = Node {
            domain_id: options.domain_id,
            distribution: options.distribution,
            session: session.zid().to_string(),
            namespace: options.namespace(vehicle),
            name: NODE.into(),
        };
        let named = |name: &str, message| Topic { name: node.qualified(name), message, depth: DEPTH };
        let token = declare_token(session, node.token()).await?;
        let odom = TopicPublisher::declare(session, &node, 1, &named("odom", names::ODOMETRY)).await?;
        let pose = TopicPublisher::declare(session, &node, 2, &named("pose", names::POSE_STAMPED)).await?;
        // Transforms are on one topic for all, whatever the namespace.
        let topic = Topic { name: "/tf".into(), message: names::TF_MESSAGE, depth: TF_DEPTH };
        let tf = match options.tf {
            true => Some(TopicPublisher::declare(session, &node, 3, &topic).await?),
            false => None,
        };
        // Zero means every sample here.
        let rate_hz = if options.rate_hz > 0.0 { options.rate_hz } else { f64::INFINITY };
        let pace = Pace::new(rate_hz);
        Ok(Self { options: options.clone(), rot_v_b, stamps, odom, pose, tf, pace, _node: token })
    }

    /// Publishes an odometry, if it is due and has a pose, with where its frame lies in the map, if that is known. What
    /// cannot be sent is lost; the sequence numbers of the samples tell.
    pub async fn odometry(&mut self, odometry: &Odometry, pose_m_o: Option<&Isometry3<f64>>) {
        if !is_worth_sending(odometry) || !self.pace.admits(odometry.stamp) {
            return;
        }
        let now_ns = now_ns();
        let stamp = match self.options.stamp {
            RosStamp::Measurement => Time::from_nanos(self.on_system_clock(odometry.stamp, now_ns)),
            RosStamp::Publication => Time::from_nanos(now_ns),
        };
        let frames = Frames {
            map: &self.options.map_frame,
            odom: &self.options.odom_frame,
            base: &self.options.base_frame,
            body: &self.options.body_frame,
            rot_v_b: self.rot_v_b,
            angular_rate_sigma_rad_s: self.options.angular_rate_sigma_rad_s,
        };
        self.odom.put(&frames.odometry(odometry, stamp), now_ns).await;
        self.pose.put(&frames.pose(odometry, stamp), now_ns).await;
        if let Some(tf) = &mut self.tf {
            tf.put(&frames.transforms(odometry, pose_m_o, stamp), now_ns).await;
        }
    }

    /// A time of measurement as ROS expects it; recordings keep theirs.
    fn on_system_clock(&self, stamp: Timestamp, now_ns: i64) -> i64 {
        let age_ns = Monotonic::now().0.saturating_sub(stamp.as_nanos());
        match self.stamps {
            Stamps::OfHost => now_ns.saturating_sub(age_ns),
            Stamps::Replayed => stamp.as_nanos(),
        }
    }
}

/// ROS has no word for an estimate that is none: nothing is published instead.
fn is_worth_sending(o: &Odometry) -> bool {
    let numbers = o.pose_o_b.translation.vector.iter().chain(o.pose_o_b.rotation.coords.iter());
    let is_finite = numbers.chain(o.v_o_b.iter()).chain(o.angular_rate_b.iter()).all(|x| x.is_finite());
    is_finite && matches!(o.state, TrackingState::Tracking | TrackingState::Blind)
}

/// One publisher with its token.
struct TopicPublisher {
    publisher: zenoh::pubsub::Publisher<'static>,
    gid: [u8; 16],
    sequence: i64,
    _token: LivelinessToken,
}

impl TopicPublisher {
    async fn declare(session: &Session, node: &Node, entity: u32, topic: &Topic) -> Result<Self, NetError> {
        let key = node.key(topic);
        let publisher = session
            .declare_publisher(key.clone())
            .encoding(Encoding::APPLICATION_CDR.with_schema(topic.message.name))
            .priority(Priority::DataHigh)
            .congestion_control(CongestionControl::Drop)
            .await
            .map_err(|error| NetError::Declare { key, message: error.to_string() })?;
        let token = node.publisher_token(entity, topic);
        let gid = names::gid(&token);
        Ok(Self { publisher, gid, sequence: 0, _token: declare_token(session, token).await? })
    }

    async fn put(&mut self, message: &impl Serialize, now_ns: i64) {
        let Ok(bytes) = cdr::encode(message) else { return };
        self.sequence += 1;
        let attachment = names::attachment(self.sequence, now_ns, &self.gid);
        let _ = self.publisher.put(bytes).attachment(attachment.as_slice()).await;
    }
}

async fn declare_token(session: &Session, key: String) -> Result<LivelinessToken, NetError> {
    let token = session.liveliness().declare_token(key.clone()).await;
    token.map_err(|error| NetError::Declare { key, message: error.to_string() })
}
