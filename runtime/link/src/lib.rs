//! What others can reach of a flight: [`net`] publishes it over Zenoh and answers questions, [`ros`] sends it to ROS 2.
//!
//! Both live in a process of their own ([`process`]), which reads the flight from its local socket and sends commands back.

#[cfg(any(test, feature = "fuzzing"))]
#[doc(hidden)]
pub mod fuzzing;
pub mod net;
pub mod process;
pub mod ros;
