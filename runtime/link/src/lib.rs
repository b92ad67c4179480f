//! Access to a flight from other processes: [`net`] publishes it over Zenoh and answers queries, [`ros`]
//! sends it to ROS 2.
//!
//! Both live in a process of their own ([`process`]), which reads the flight from its local socket and sends commands back.

#[cfg(any(test, feature = "fuzzing"))]
#[doc(hidden)]
pub mod fuzzing;
pub mod net;
pub mod process;
pub mod ros;
