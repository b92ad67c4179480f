//! The node `plumbline` with its publishers, on a session of Zenoh.

use super::frames::RosFrames;
use super::identity::Identity;
use super::interface::{Interface, InterfaceType};
use super::messages::{OdometryMessage, Path, PoseStamped, TfMessage, Time};
use super::names::{NodeName, RosTopic};
use super::path::{self, PathHistory};
use super::system_clock::on_system_clock;
use super::topic::{Declaring, TopicPublisher, declare_token};
use super::trigger::{TriggerSubscription, Triggers};
use crate::net::pace::Pace;
use crate::net::{CommandRelay, NetError, now_ns};
use nalgebra::Isometry3;
use plumbline_config::Timestamp;
use plumbline_config::options::RosStamp;
use plumbline_estimator::{Odometry, TrackingState};
use plumbline_record::{InstantAnswer, InstantOutcome};
use std::sync::Arc;
use zenoh::Session;
use zenoh::liveliness::LivelinessToken;
use zenoh::qos::Priority;

/// Name of the node.
const NODE: &str = "plumbline";
/// Messages that a subscriber is advised to hold; of transforms as many as tf2's own broadcaster says.
const DEPTH: u32 = 10;
const TF_DEPTH: u32 = 100;
/// A path replaces the one before.
const PATH_DEPTH: u32 = 1;
const PATH_HZ: f64 = 1.0;

/// A node of ROS 2 with its publishers, for as long as it lives.
pub struct RosNode {
    identity: Identity,
    odom: TopicPublisher,
    pose: TopicPublisher,
    tf: Option<TopicPublisher>,
    path: Option<(Pace, TopicPublisher)>,
    pace: Pace,
    at: Option<AtTriggers>,
    _node: LivelinessToken,
}

/// Stamps of one publication: as headers have them, and the present time, ns since 1970.
struct PublicationTimes<F> {
    /// Converts a time of measurement.
    time: F,
    /// Time of publication.
    now_ns: i64,
}

/// States at instants: where they go, and what was asked for.
struct AtTriggers {
    odom: TopicPublisher,
    triggers: Triggers,
    _subscription: TriggerSubscription,
}

impl RosNode {
    /// Declares the node, its publishers and services, and the tokens by which they are listed.
    ///
    /// # Errors
    /// When Zenoh refuses a key.
    pub async fn declare(
        session: &Session,
        identity: &Identity,
        commands: &Arc<CommandRelay>,
    ) -> Result<Self, NetError> {
        let options = &identity.options;
        let node = NodeName {
            domain_id: options.domain_id,
            distribution: options.distribution,
            session: session.zid().to_string(),
            namespace: options.namespace(&identity.vehicle),
            name: NODE.into(),
        };
        let token = declare_token(session, node.token()).await?;
        let mut declaring = Declaring::new(session, &node);
        let odom = declare::<OdometryMessage<'_>>(&mut declaring, node.qualified("odom"), DEPTH).await?;
        let pose = declare::<PoseStamped<'_>>(&mut declaring, node.qualified("pose"), DEPTH).await?;
        // Transforms are on one topic for all, whatever the namespace.
        let tf = match options.tf {
            true => Some(declare::<TfMessage<'_>>(&mut declaring, "/tf".into(), TF_DEPTH).await?),
            false => None,
        };
        let path = match options.path {
            true => {
                let topic = declare::<Path<'_>>(&mut declaring, node.qualified("path"), PATH_DEPTH).await?;
                Some((Pace::new(PATH_HZ), topic))
            }
            false => None,
        };
        let at = match options.trigger {
            true => {
                let odom =
                    declare::<OdometryMessage<'_>>(&mut declaring, node.qualified("odom_at"), DEPTH).await?;
                let (triggers, commands) = (Triggers::default(), Arc::clone(commands));
                let asking = triggers.clone();
                let subscription =
                    TriggerSubscription::declare(&mut declaring, asking, identity.stamps, commands).await?;
                Some(AtTriggers { odom, triggers, _subscription: subscription })
            }
            false => None,
        };
        // Zero means every sample here.
        let rate_hz = if options.rate_hz > 0.0 { options.rate_hz } else { f64::INFINITY };
        let pace = Pace::new(rate_hz);
        Ok(Self { identity: identity.clone(), odom, pose, tf, path, pace, at, _node: token })
    }

    /// Publishes an odometry, if it is due and has a pose, with the pose of its frame in the map, if that is known; then the
    /// path. What cannot be sent is lost; the sequence numbers of the samples show it.
    pub async fn odometry(
        &mut self,
        odometry: &Odometry,
        pose_m_o: Option<&Isometry3<f64>>,
        path: &PathHistory,
    ) {
        if !is_worth_sending(odometry) {
            return;
        }
        let clock = self.identity.clock(now_ns());
        let frames = self.identity.frames();
        if self.pace.admits(odometry.stamp) {
            let stamp = (clock.time)(odometry.stamp);
            self.odom.put(&frames.odometry(odometry, stamp), clock.now_ns).await;
            self.pose.put(&frames.pose(odometry, stamp), clock.now_ns).await;
            if let Some(tf) = &mut self.tf {
                tf.put(&frames.transforms(odometry, pose_m_o, stamp), clock.now_ns).await;
            }
        }
        let Some((pace, topic)) = &mut self.path else { return };
        if pace.admits(odometry.stamp) && topic.has_subscribers().await {
            topic.put(&path::message(&frames, path.poses(), &clock.time), clock.now_ns).await;
        }
    }

    /// Publishes the state at an instant, if there is one. A trigger without one is told in the log.
    pub async fn instant(&mut self, answer: &InstantAnswer) {
        let Some(at) = &mut self.at else { return };
        let asked_ns = at.triggers.asked(answer);
        let instant = &answer.instant;
        if answer.outcome != InstantOutcome::Answered {
            let why = answer.outcome.refusal().unwrap_or_default();
            return tracing::warn!("no state at the trigger of {} ns: {why}", instant.stamp.as_nanos());
        }
        let now_ns = now_ns();
        let stamp_ns =
            asked_ns.unwrap_or_else(|| on_system_clock(self.identity.stamps, instant.stamp, now_ns));
        let odometry = Odometry {
            stamp: instant.stamp,
            pose_o_b: instant.pose_o_b,
            v_o_b: instant.v_o_b,
            angular_rate_b: instant.angular_rate_b,
            covariance: instant.covariance,
            state: instant.state,
            quality: instant.quality,
            reset_counter: instant.reset_counter,
            ..Odometry::default()
        };
        if is_worth_sending(&odometry) {
            let message = self.identity.frames().odometry(&odometry, Time::from_nanos(stamp_ns));
            at.odom.put(&message, now_ns).await;
        }
    }
}

impl Identity {
    fn frames(&self) -> RosFrames<'_> {
        RosFrames::new(&self.options, self.rot_v_b)
    }

    /// Stamps of what is published at `now_ns`.
    fn clock(&self, now_ns: i64) -> PublicationTimes<impl Fn(Timestamp) -> Time + use<>> {
        let (stamp, stamps) = (self.options.stamp, self.stamps);
        let time = move |measured: Timestamp| match stamp {
            RosStamp::Measurement => Time::from_nanos(on_system_clock(stamps, measured, now_ns)),
            RosStamp::Publication => Time::from_nanos(now_ns),
        };
        PublicationTimes { time, now_ns }
    }
}

async fn declare<T: Interface>(
    declaring: &mut Declaring<'_>,
    name: String,
    depth: u32,
) -> Result<TopicPublisher, NetError> {
    let topic = RosTopic { name, interface: InterfaceType::of::<T>(), depth };
    TopicPublisher::declare(declaring, topic, Priority::DataHigh).await
}

/// ROS has no word for an estimate that is none: nothing is published instead.
pub(super) fn is_worth_sending(o: &Odometry) -> bool {
    let numbers = o.pose_o_b.translation.vector.iter().chain(o.pose_o_b.rotation.coords.iter());
    let is_finite = numbers.chain(o.v_o_b.iter()).chain(o.angular_rate_b.iter()).all(|x| x.is_finite());
    is_finite && matches!(o.state, TrackingState::Tracking | TrackingState::Blind)
}
