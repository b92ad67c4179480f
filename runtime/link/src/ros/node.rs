//! The node `plumbline` with its publishers and services, on a session of Zenoh.

use super::frames::RosFrames;
use super::identity::Identity;
use super::interface::{Interface, InterfaceType};
use super::messages::{OdometryMessage, Path, PoseStamped, TfMessage, Time};
use super::names::{NodeName, RosTopic};
use super::path::PathHistory;
use super::reset::{ResetServices, Resets};
use super::system_clock::on_system_clock;
use super::topic::{Declaring, TopicPublisher, declare_token};
use super::trigger::{TriggerSubscription, Triggers};
use crate::net::pace::Pace;
use crate::net::{NetError, now_ns};
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
/// Paths a second of data, while there are subscribers.
const PATH_HZ: f64 = 1.0;

/// A node of ROS 2 with its publishers, for as long as it lives.
pub struct RosNode {
    identity: Identity,
    odom: TopicPublisher,
    pose: TopicPublisher,
    tf: Option<TopicPublisher>,
    path: TopicPublisher,
    pace: Pace,
    path_pace: Pace,
    at: Option<AtTriggers>,
    _reset: Option<ResetServices>,
    _node: LivelinessToken,
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
    pub async fn declare(session: &Session, identity: &Identity, resets: &Resets) -> Result<Self, NetError> {
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
        let path = declare::<Path<'_>>(&mut declaring, node.qualified("path"), PATH_DEPTH).await?;
        let reset = match options.reset {
            true => Some(ResetServices::declare(&mut declaring, resets.clone()).await?),
            false => None,
        };
        let at = match options.trigger {
            true => {
                let odom =
                    declare::<OdometryMessage<'_>>(&mut declaring, node.qualified("odom_at"), DEPTH).await?;
                let (triggers, commands) = (Triggers::default(), Arc::clone(&resets.commands));
                let asking = triggers.clone();
                let subscription =
                    TriggerSubscription::declare(&mut declaring, asking, identity.stamps, commands).await?;
                Some(AtTriggers { odom, triggers, _subscription: subscription })
            }
            false => None,
        };
        // Zero means every sample here.
        let rate_hz = if options.rate_hz > 0.0 { options.rate_hz } else { f64::INFINITY };
        let (pace, path_pace) = (Pace::new(rate_hz), Pace::new(PATH_HZ));
        let identity = identity.clone();
        Ok(Self { identity, odom, pose, tf, path, pace, path_pace, at, _reset: reset, _node: token })
    }

    /// Publishes an odometry, if it is due and has a pose, with the pose of its frame in the map, if that is known; then
    /// the path, if that is due. What cannot be sent is lost; the sequence numbers of the samples show it.
    pub async fn odometry(
        &mut self,
        odometry: &Odometry,
        pose_m_o: Option<&Isometry3<f64>>,
        path: &PathHistory,
    ) {
        if !is_worth_sending(odometry) {
            return;
        }
        let now_ns = now_ns();
        let time = self.identity.clock(now_ns);
        let frames = self.identity.frames();
        if self.pace.admits(odometry.stamp) {
            let stamp = time(odometry.stamp);
            self.odom.put(&frames.odometry(odometry, stamp), now_ns).await;
            self.pose.put(&frames.pose(odometry, stamp), now_ns).await;
            if let Some(tf) = &mut self.tf {
                tf.put(&frames.transforms(odometry, pose_m_o, stamp), now_ns).await;
            }
        }
        if self.path_pace.admits(odometry.stamp) && self.path.has_subscribers().await {
            self.path.put(&frames.path(path.poses(), time), now_ns).await;
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

    /// Times of measurement as headers of what is published at `now_ns` have them.
    fn clock(&self, now_ns: i64) -> impl Fn(Timestamp) -> Time + use<> {
        let (stamp, stamps) = (self.options.stamp, self.stamps);
        move |measured: Timestamp| match stamp {
            RosStamp::Measurement => Time::from_nanos(on_system_clock(stamps, measured, now_ns)),
            RosStamp::Publication => Time::from_nanos(now_ns),
        }
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
