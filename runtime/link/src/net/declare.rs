//! A key of a vehicle, declared with its quality of service.

use super::ROOT;
use super::error::NetError;
use zenoh::Session;
use zenoh::bytes::Encoding;
use zenoh::pubsub::Publisher;
use zenoh::qos::{CongestionControl, Priority};

/// Declares a key of a vehicle with its quality of service.
///
/// # Errors
/// When Zenoh refuses the key.
pub async fn declare_publisher(
    session: &Session,
    vehicle: &str,
    name: &'static str,
    schema: &'static str,
    priority: Priority,
) -> Result<Publisher<'static>, NetError> {
    let key = format!("{ROOT}/{vehicle}/{name}");
    let publisher = session
        .declare_publisher(key.clone())
        .encoding(Encoding::APPLICATION_PROTOBUF.with_schema(format!("plumbline.v1.{schema}")))
        .priority(priority)
        .congestion_control(CongestionControl::Drop)
        .express(priority == Priority::RealTime);
    publisher.await.map_err(|error| NetError::Declare { key, message: error.to_string() })
}
