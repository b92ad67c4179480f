//! What others can reach of a flight: [`net`] publishes it over Zenoh and answers questions, [`ros`] sends it to ROS 2.
//!
//! Both listen to a run, and are handed to it by who starts it.

pub mod net;
pub mod ros;
