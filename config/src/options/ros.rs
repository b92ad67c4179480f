//! Options of the publication as ROS 2 messages.

use super::network::Link;
use serde::{Deserialize, Serialize};

/// Publication of odometry, path, map and pictures as ROS 2 messages over Zenoh, as `rmw_zenoh` would publish them, beside
/// Plumbline's own keys and by a session of its own.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RosConfig {
    /// Publish to ROS 2.
    pub enabled: bool,
    /// Endpoint of the router of `rmw_zenoh`. It may come and go: it is looked for until it is there.
    pub router: String,
    /// `ROS_DOMAIN_ID` of the subscribers.
    pub domain_id: u32,
    /// ROS 2 release of the subscribers, which determines the names of types in keys.
    pub distribution: RosDistribution,
    /// Namespace of the node and its topics `odom` and `pose`, such as `/robots/one`. Empty: `/<vehicle>`,
    /// with `_` for `-`; `/`: none.
    pub namespace: String,
    /// Name of the map frame `M`, the parent of `odom_frame` while the vehicle is located in the map.
    pub map_frame: String,
    /// Name of the odometry frame `O`; flight logs have this name and the next two as well.
    pub odom_frame: String,
    /// Name of the vehicle's frame `V`: x forward, y left, z up (REP 103), with its origin in the IMU. Odometry
    /// and pose are its own.
    pub base_frame: String,
    /// Name of the body frame `B`, which is the IMU's; its rotation in the vehicle goes out on `/tf`.
    pub body_frame: String,
    /// Messages of `odom`, `pose` and `/tf` a second; 0 for one with every inertial sample.
    pub rate_hz: f64,
    /// Time in `header.stamp`.
    pub stamp: RosStamp,
    /// Whether the transforms from `odom_frame` to `base_frame` and on to `body_frame`, and that from `map_frame` to
    /// `odom_frame`, go out on `/tf` too.
    pub tf: bool,
    /// Standard deviation of the angular rate in the twist's covariance, rad/s: the estimator has none.
    pub angular_rate_sigma_rad_s: f64,
    /// Capacity of the connection to the router: sets rates and sizes of what follows.
    pub link: Link,
    /// Publish the path in `odom_frame`, topic `path`.
    pub path: bool,
    /// Publish landmarks and lines of the window in `odom_frame`, topics `landmarks` and `lines`.
    pub landmarks: bool,
    /// Publish the corrected path, its loops, and landmarks and lines in `map_frame`, topics `map/path`, `map/landmarks`
    /// and `map/markers`.
    pub map: bool,
    /// Publish camera pictures with what is tracked in them, topic `tracks`.
    pub tracks: RosPictures,
    /// Offer the services `reset` (keeps the pose) and `reset_hard` (starts at the origin).
    pub reset: bool,
    /// Take stamps on the topic `trigger` (`std_msgs/msg/Header`), and publish the state at each on `odom_at`; also those at camera
    /// triggers of the autopilot.
    pub trigger: bool,
}

/// Format of pictures for ROS 2.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum RosPictures {
    /// No pictures.
    Off,
    /// `sensor_msgs/msg/CompressedImage` (JPEG) on `tracks/compressed`.
    Compressed,
    /// `sensor_msgs/msg/Image` (`rgb8`) on `tracks`.
    Raw,
}

/// Releases of ROS 2 that have `rmw_zenoh`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum RosDistribution {
    /// The only one without hashes of types.
    Humble,
    /// 2023.
    Iron,
    /// 2024.
    Jazzy,
    /// 2025.
    Kilted,
    /// The one under development.
    Rolling,
}

/// Meaning of the time in a message's header.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum RosStamp {
    /// The measurement: live by the system clock, as ROS expects; of a recording or a simulation by its own time.
    Measurement,
    /// Time of publication, system clock: for sensors that use another clock.
    Publication,
}

impl Default for RosConfig {
    fn default() -> Self {
        Self {
            enabled: false,
            router: "tcp/localhost:7447".into(),
            domain_id: 0,
            distribution: RosDistribution::Jazzy,
            namespace: String::new(),
            map_frame: "map".into(),
            odom_frame: "odom".into(),
            base_frame: "base_link".into(),
            body_frame: "body".into(),
            rate_hz: 50.0,
            stamp: RosStamp::Measurement,
            tf: true,
            angular_rate_sigma_rad_s: 0.01,
            link: Link::Lan,
            path: true,
            landmarks: true,
            map: true,
            tracks: RosPictures::Off,
            reset: false,
            trigger: false,
        }
    }
}

impl RosConfig {
    /// The absolute namespace, `/` for none; `vehicle` is the name that stands in when none is given.
    #[must_use]
    pub fn namespace(&self, vehicle: &str) -> String {
        if self.namespace.is_empty() {
            format!("/{}", vehicle.replace('-', "_"))
        } else {
            self.namespace.clone()
        }
    }
}
