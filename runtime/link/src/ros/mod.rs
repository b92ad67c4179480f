//! ROS 2 without ROS: odometry, path and transforms as RViz 2 and `ros2` expect them.
//!
//! Machines that run ROS 2 with `RMW_IMPLEMENTATION=rmw_zenoh_cpp` speak Zenoh, as we do. What is missing
//! between the two is a way of writing, and that is all there is here; no part of ROS is needed:
//!
//! - [`interface`]: names and hashes of types of ROS; [`messages`]: those that are sent;
//! - [`cdr`]: their bytes;
//! - [`names`]: the keys on which `rmw_zenoh` looks for them, the liveliness tokens by which it lists nodes and
//!   their endpoints, and what it attaches to samples;
//! - [`frames`]: odometry, pose and transforms from an estimate, with what ROS means by a covariance and by a twist
//!   ([`covariance`]);
//! - [`path`]: the path since the last reset;
//! - [`node`]: a node `plumbline` with its publishers ([`topic`]);
//! - [`publisher`]: the session with the router of `rmw_zenoh` that it lives on;
//! - [`output`]: the thread that feeds it with the records of a flight.
//!
//! It stands above [`crate::net`], whose rings and pace it uses, and which does not know of it:
//! [`crate::process`] starts both.
//!
//! Source: `docs/design.md` of ros2/rmw_zenoh, and its `liveliness_utils.cpp` where that is not precise.

pub mod cdr;
pub mod covariance;
pub mod frames;
mod identity;
pub mod interface;
pub mod messages;
pub mod names;
pub mod node;
pub mod output;
pub mod path;
pub mod publisher;
pub mod system_clock;
mod topic;
pub mod trigger;

pub use output::{RosFeed, RosOutput};
