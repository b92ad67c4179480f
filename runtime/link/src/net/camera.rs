//! The camera key: images are compressed only while there are subscribers, in a task that does not delay odometry.

use super::commands::CommandRelay;
use super::pace::Rates;
use super::picture;
use super::relay::RelayState;
use plumbline_record::local::picture::Shot;
use plumbline_record::topics::Topic;
use plumbline_rings::lane::LaneReader;
use std::sync::Arc;
use std::time::{Duration, Instant};
use zenoh::pubsub::Publisher;

/// Period at which subscribers are counted.
const LOOK_PERIOD: Duration = Duration::from_millis(200);

/// Compresses and sends waiting images, which the flight makes while there are subscribers. Ends with the task.
pub async fn serve(
    camera: Publisher<'static>,
    shared: Arc<RelayState>,
    mut pictures: LaneReader<Shot>,
    rates: Rates,
    commands: Arc<CommandRelay>,
) {
    let (mut sequence, mut looked, mut was_watched) = (0, None::<Instant>, false);
    loop {
        let _ = tokio::time::timeout(LOOK_PERIOD, shared.picture_bell.notified()).await;
        if looked.is_none_or(|looked| looked.elapsed() >= LOOK_PERIOD) {
            looked = Some(Instant::now());
            let is_watched = camera.matching_status().await.is_ok_and(|status| status.matching());
            if is_watched != was_watched {
                commands.watch(if is_watched { rates.hz(Topic::Picture) } else { 0.0 });
                was_watched = is_watched;
            }
        }
        let mut newest = None;
        while let Some(shot) = pictures.pop() {
            newest = Some(shot);
        }
        // Otherwise made for those before.
        let wanted = newest.filter(|_| was_watched);
        let encode =
            |shot: Shot| picture::message(&shot, rates.camera_width_px, rates.camera_quality, sequence);
        if let Some(message) = wanted.and_then(encode) {
            sequence += 1;
            let _ = camera.put(message).await;
        }
    }
}
