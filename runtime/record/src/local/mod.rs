//! Format of the local socket (`docs/local-socket.md`): records that a flight sends, requests of its readers.
//!
//! [`record`] has header and kinds of a record, [`request`] what readers send and its answers, [`incoming`] finds records in
//! bytes as they come, [`content`] makes values of them. The content of odometry and estimates is in [`layout`](crate::layout).

pub mod content;
pub mod incoming;
pub mod picture;
pub mod record;
pub mod request;
