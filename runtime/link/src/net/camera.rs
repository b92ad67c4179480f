//! The camera key: images are compressed only while there are subscribers, in a task that does not delay odometry.

use super::pace::Rates;
use super::rings::Rings;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};
use zenoh::pubsub::Publisher;

/// Period at which subscribers are counted.
const LOOK_PERIOD: Duration = Duration::from_millis(200);

/// Compresses and sends waiting images, and tells the run whether there are subscribers. Ends with the task.
pub async fn serve(camera: Publisher<'static>, rings: Arc<Rings>, rates: Rates) {
    let (mut sequence, mut looked) = (0, None::<Instant>);
    let bell = match rings.picture_bell.listen() {
        Ok(bell) => bell,
        Err(error) => return tracing::error!("cannot publish pictures: {error}"),
    };
    loop {
        let _ = tokio::time::timeout(LOOK_PERIOD, bell.rung()).await;
        if looked.is_none_or(|looked| looked.elapsed() >= LOOK_PERIOD) {
            looked = Some(Instant::now());
            let is_watched = camera.matching_status().await.is_ok_and(|status| status.matching());
            rings.is_watched.store(is_watched, Ordering::Relaxed);
        }
        let encode = |shot: &mut super::picture::Shot| {
            shot.message(rates.camera_width_px, rates.camera_quality, sequence)
        };
        if let Some(message) = rings.shots.read(encode).flatten() {
            sequence += 1;
            let _ = camera.put(message).await;
        }
    }
}
