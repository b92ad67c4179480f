//! HTTP requests of the page: resets and downloads.

use super::super::command::{self, ResetWords};
use super::super::fleet::Fleet;
use super::super::track::{PoseSample, tum};
use super::Station;
use axum::Json;
use axum::body::{Body, Bytes};
use axum::extract::{Path, State};
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use parking_lot::Mutex;
use plumbline_record::Severity;
use serde::Deserialize;
use serde_json::json;
use std::sync::Arc;
use tokio::sync::OwnedSemaphorePermit;

/// Samples that are copied in one go.
const SAMPLES_AT_A_TIME: usize = 20_000;

/// Body of a reset request.
#[derive(Deserialize)]
pub struct ResetRequest {
    kind: ResetWords,
}

fn answer(status: StatusCode, is_ok: bool, text: &str) -> Response {
    (status, Json(json!({"ok": is_ok, "text": text}))).into_response()
}

fn unknown(vehicle: &str) -> Response {
    answer(StatusCode::NOT_FOUND, false, &format!("no vehicle {vehicle:?} was received"))
}

fn off() -> Response {
    let text = "commands are off at this station: it serves other hosts; start it with --allow-commands";
    answer(StatusCode::FORBIDDEN, false, text)
}

/// Resets a vehicle's estimate.
pub async fn reset(
    State(station): State<Arc<Station>>,
    Path(vehicle): Path<String>,
    Json(reset): Json<ResetRequest>,
) -> Response {
    if !station.commands {
        return off();
    }
    let is_known = station.fleet.lock().vehicles.contains_key(&vehicle);
    let Some(session) = station.connection.session().filter(|_| is_known) else {
        return unknown(&vehicle);
    };
    let outcome = command::reset(session, &vehicle, reset.kind).await;
    let (severity, text) = match &outcome {
        Ok(done) => (Severity::Info, done),
        Err(reason) => (Severity::Error, reason),
    };
    station.fleet.lock().announce(Some(&vehicle), severity, text.clone());
    match outcome {
        Ok(done) => answer(StatusCode::OK, true, &done),
        Err(reason) => answer(StatusCode::BAD_GATEWAY, false, &reason),
    }
}

/// A file on its way, and the place that it takes.
struct Download {
    text: String,
    _place: OwnedSemaphorePermit,
}

impl AsRef<[u8]> for Download {
    fn as_ref(&self) -> &[u8] {
        self.text.as_bytes()
    }
}

/// The poses that are kept of a vehicle, as a TUM file.
pub async fn download(State(station): State<Arc<Station>>, Path(vehicle): Path<String>) -> Response {
    // Held until the last byte is sent.
    let Ok(place) = Arc::clone(&station.downloads).try_acquire_owned() else {
        return answer(StatusCode::SERVICE_UNAVAILABLE, false, "other downloads are going on; try again");
    };
    let (fleet, of) = (Arc::clone(&station.fleet), vehicle.clone());
    // Megabytes are copied and written as text: not on a thread that serves others.
    let made = tokio::task::spawn_blocking(move || copied(&fleet, &of).map(|poses| tum(&poses)));
    let Ok(Some(text)) = made.await else { return unknown(&vehicle) };
    // Names of vehicles come from the network: only plain characters go into the header.
    let plain: String = vehicle.chars().filter(|c| c.is_ascii_alphanumeric() || "-_".contains(*c)).collect();
    let disposition = format!("attachment; filename=\"{plain}-trajectory.tum\"");
    let body = Body::from(Bytes::from_owner(Download { text, _place: place }));
    let media = "text/plain; charset=utf-8".to_owned();
    ([(header::CONTENT_TYPE, media), (header::CONTENT_DISPOSITION, disposition)], body).into_response()
}

/// Poses of a vehicle, copied a part at a time: vehicles go on being received meanwhile.
fn copied(fleet: &Mutex<Fleet>, vehicle: &str) -> Option<Vec<PoseSample>> {
    let mut copied: Option<(u64, Vec<PoseSample>)> = None;
    loop {
        let fleet = fleet.lock();
        let poses = &fleet.vehicles.get(vehicle)?.poses;
        let (next, all) = copied.get_or_insert((poses.first(), Vec::new()));
        let part = poses.since(*next).take(SAMPLES_AT_A_TIME);
        if part.len() == 0 {
            return copied.map(|(_, all)| all);
        }
        *next = poses.first().max(*next) + part.len() as u64;
        all.extend(part.copied());
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::connection::StationSession;
    use super::*;
    use std::pin::pin;
    use std::sync::atomic::AtomicU64;
    use std::task::{Context, Waker};
    use tokio::sync::Semaphore;

    #[tokio::test]
    async fn a_download_leaves_the_threads_of_the_page_free() {
        let fleet: Arc<Mutex<Fleet>> = Arc::default();
        fleet.lock().alive("drone", true);
        let station = Arc::new(Station {
            fleet: Arc::clone(&fleet),
            connection: StationSession::default(),
            commands: false,
            malformed: AtomicU64::new(0),
            pages: Semaphore::new(1),
            address: "127.0.0.1:80".parse().unwrap(),
            names: Vec::new(),
            downloads: Arc::new(Semaphore::new(1)),
        });
        let mut downloading = pin!(download(State(station), Path("drone".to_owned())));
        {
            let _taken = fleet.lock();
            assert!(downloading.as_mut().poll(&mut Context::from_waker(Waker::noop())).is_pending());
        }
        assert_eq!(downloading.await.status(), StatusCode::OK);
    }
}
