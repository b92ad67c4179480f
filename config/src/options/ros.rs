//! Options of the publication as ROS 2 messages.

use plumbline_keys::keys;

/// Publication of odometry, path and transforms as ROS 2 messages over Zenoh, as `rmw_zenoh` would publish them, beside
/// Plumbline's own keys and by a session of its own.
#[keys]
pub struct RosConfig {
    /// Publish to ROS 2.
    #[key(default = false)]
    pub enabled: bool,
    /// Endpoint of rmw_zenoh's router (`ros2 run rmw_zenoh_cpp rmw_zenohd`). It may start before or after the flight.
    #[key(default = "tcp/localhost:7447")]
    pub router: String,
    /// ROS_DOMAIN_ID of the subscribers.
    #[key(default = 0, range = 0..=232, cure = "give the ROS_DOMAIN_ID of the others")]
    pub domain_id: u32,
    /// ROS 2 release of the subscribers: "humble", "iron", "jazzy", "kilted", "rolling".
    #[key(default)]
    pub distribution: RosDistribution,
    /// Namespace, such as "/robots/one"; "" for `/<vehicle>`, "/" for none.
    #[key(default)]
    pub namespace: String,
    /// Name of the map frame M. It is the parent of odom_frame once the vehicle is located in the map.
    #[key(default = "map")]
    pub map_frame: String,
    /// Name of the odometry frame O, here and in flight logs.
    #[key(default = "odom")]
    pub odom_frame: String,
    /// Name of the vehicle's frame V, here and in flight logs. Its axes are x forward, y left, z up, its origin is
    /// the IMU.
    #[key(default = "base_link")]
    pub base_frame: String,
    /// Name of the body frame B, that of the IMU, here and in flight logs.
    #[key(default = "body")]
    pub body_frame: String,
    /// Rate of odom, pose and /tf; 0 for one message each inertial sample.
    #[key(default = 50.0, range = 0.0..=4000.0, unit = HZ, cure = "write it in Hz, 0 for every sample")]
    pub rate_hz: f64,
    /// Time in header.stamp: "measurement" (live flights: converted to system time, as ROS expects; recordings and simulations:
    /// their own time) or "publication" (system time).
    #[key(default)]
    pub stamp: RosStamp,
    /// Publish /tf; false if another node does. The transforms are map_frame -> odom_frame -> base_frame ->
    /// body_frame.
    #[key(default = true)]
    pub tf: bool,
    /// Standard deviation of the angular rate in the twist.
    #[key(default = 0.01, range = 0.0..=10.0, unit = RADIANS_PER_SECOND)]
    pub angular_rate_sigma_rad_s: f64,
    /// Publish the path in odom_frame (nav_msgs/Path) on `path`. It is computed only while there are subscribers.
    #[key(default = true)]
    pub path: bool,
    /// Take stamps on the topic `trigger`, and publish the state at each on `odom_at`. The type is std_msgs/Header;
    /// states at camera triggers of the autopilot are published too.
    #[key(default = false)]
    pub trigger: bool,
}

/// Releases of ROS 2 that have `rmw_zenoh`.
#[keys("lowercase")]
pub enum RosDistribution {
    /// The only one without hashes of types.
    Humble,
    /// 2023.
    Iron,
    /// 2024.
    #[default]
    Jazzy,
    /// 2025.
    Kilted,
    /// The one under development.
    Rolling,
}

/// Meaning of the time in a message's header.
#[keys("lowercase")]
pub enum RosStamp {
    /// The measurement: live by the system clock, as ROS expects; of a recording or a simulation by its own time.
    #[default]
    Measurement,
    /// Time of publication, system clock: for sensors that use another clock.
    Publication,
}

impl RosConfig {
    /// The absolute namespace, `/` for none; `vehicle` is the name that stands in when none is given.
    pub fn namespace(&self, vehicle: &str) -> String {
        if self.namespace.is_empty() {
            format!("/{}", vehicle.replace('-', "_"))
        } else {
            self.namespace.clone()
        }
    }
}
